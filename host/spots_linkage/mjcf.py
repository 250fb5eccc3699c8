"""Writes a linkage as a model for MuJoCo (MJCF), in metres and radians.

The linkage lies in the xy plane of the model. Each arm is a chain of two hinges, whose ``joint1``
and ``joint2`` have the angles of this package; ``connect`` closes the loop at the end point.
"""

from xml.etree import ElementTree as ET

import numpy as np

from .fivebar import Linkage

# The constraint's time constant is twice the time step: the stiffest one that is stable.
_STEP_S = 0.0005
_STIFF = f"{2 * _STEP_S:g} 1"
_RADIUS_M = 0.003
_DENSITY_KG_M3 = 1200  # of a printed bar


def mjcf(linkage: Linkage) -> str:
    """Return a linkage as a MuJoCo model (MJCF), for MuJoCo 3.2 or newer.

    The site ``end_point`` is the end point. The position actuators ``joint1`` and ``joint2`` take
    angles in rad. In the key frame ``home``, the loop is closed, and the linkage is far from a
    singular pose.
    """
    model = ET.Element("mujoco", model="five-bar linkage")
    ET.SubElement(model, "compiler", angle="radian", autolimits="true")
    ET.SubElement(model, "option", timestep=f"{_STEP_S:g}", integrator="implicitfast")
    default = ET.SubElement(model, "default")
    ET.SubElement(default, "joint", type="hinge", damping="0.001", armature="1e-5")
    # Bars lie above each other, so they do not collide.
    bar = {"type": "capsule", "size": f"{_RADIUS_M:g}", "density": f"{_DENSITY_KG_M3}"}
    ET.SubElement(default, "geom", contype="0", conaffinity="0", **bar)
    world = ET.SubElement(model, "worldbody")
    a1, b1, b2, a2 = (length / 1000 for length in linkage.bar_mm)
    _arm(world, "1", 0.0, a1, b1, "0 0 -1")
    _arm(world, "2", linkage.base_mm / 1000, a2, b2, "0 0 1")
    equality = ET.SubElement(model, "equality")
    ET.SubElement(equality, "connect", site1="end_point", site2="end_point_2", solref=_STIFF)
    actuator = ET.SubElement(model, "actuator")
    for joint in ("joint1", "joint2"):
        ET.SubElement(actuator, "position", name=joint, joint=joint, kp="2", dampratio="1")
    home = list(map(repr, pose(linkage, _home(linkage)).tolist()))
    keys = ET.SubElement(model, "keyframe")
    ET.SubElement(keys, "key", name="home", qpos=" ".join(home), ctrl=" ".join(home[::2]))
    ET.indent(model)
    return ET.tostring(model, encoding="unicode") + "\n"


def pose(linkage: Linkage, theta_rad: tuple[float, float]) -> np.ndarray:
    """Return MuJoCo's `qpos` of the model, in rad: joint 1, elbow 1, joint 2 and elbow 2.

    LimitError if the linkage has no solution at these angles.
    """
    x_mm, y_mm = linkage.forward(*theta_rad)
    found = []
    for theta, inner_mm, along_mm in (
        (theta_rad[0], linkage.bar_mm[0], x_mm),
        (theta_rad[1], linkage.bar_mm[3], linkage.base_mm - x_mm),
    ):
        outer_rad = np.arctan2(along_mm - inner_mm * np.sin(theta), y_mm - inner_mm * np.cos(theta))
        found += [theta, np.arctan2(np.sin(outer_rad - theta), np.cos(outer_rad - theta))]
    return np.array(found, dtype=float)


def _home(linkage: Linkage) -> tuple[float, float]:
    """Return the angles, in steps of 5 degrees, at which the outer bars are least in line."""
    theta_rad = np.radians(np.arange(-90, 91, 5))
    first, second = np.meshgrid(theta_rad, theta_rad)
    best = np.ma.argmax(linkage.outer_angle(first, second), fill_value=-1)
    return first.flat[best].item(), second.flat[best].item()


def _arm(world: ET.Element, name: str, x_m: float, inner_m: float, outer_m: float, axis: str):
    inner = ET.SubElement(world, "body", name=f"inner{name}", pos=f"{x_m!r} 0 0")
    ET.SubElement(inner, "joint", name=f"joint{name}", axis=axis)
    ET.SubElement(inner, "geom", fromto=f"0 0 0 0 {inner_m!r} 0")
    outer = ET.SubElement(inner, "body", name=f"outer{name}", pos=f"0 {inner_m!r} 0")
    ET.SubElement(outer, "joint", name=f"elbow{name}", axis=axis)
    ET.SubElement(outer, "geom", fromto=f"0 0 0 0 {outer_m!r} 0")
    end = "end_point" if name == "1" else f"end_point_{name}"
    ET.SubElement(outer, "site", name=end, pos=f"0 {outer_m!r} 0")
