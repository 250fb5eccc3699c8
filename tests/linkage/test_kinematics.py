"""Kinematic calibration finds the parameters, or names those that the points do not determine."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest
from support.linkage_places import FOUND, FRAME, GAIN, OFFSET, TRUE, places
from support.refusals import refusal

from spots import SpotsError
from spots.errors import CalibrationError, RequirementError
from spots_linkage import Linkage, kinematics
from spots_linkage.limits import Limit

DRAWN = Linkage(100, 80)
SIGMAS = {"angle_sigma_rad": 2e-4, "place_sigma_mm": 0.02}
MEANT = {"offset_rad": (-1.885, -1.885)}


def test_without_noise_it_finds_the_linkage():
    angles, seen = places(40)
    found = kinematics.calibrate(
        angles, *seen, DRAWN, angle_sigma_rad=1e-7, place_sigma_mm=1e-5, **MEANT
    )
    for name, value in FOUND.items():
        assert found.values[name] == pytest.approx(value, abs=1e-4), name
    assert found.unidentified == found.outliers == ()
    assert found.rank == len(found.names) == 12
    assert found.residual_max_mm < 1e-4
    told = found.terminal(angles)
    assert np.hypot(*(np.array(told) - seen)).max() < 1e-4
    assert repr(found.linkage).startswith("Linkage((101, 99.3")


@pytest.mark.board
def test_the_standard_errors_are_those_of_the_scatter():
    off = []
    for seed in range(40):
        angles, seen = places(40, seed, noise=1.0)
        found = kinematics.calibrate(angles, *seen, DRAWN, **SIGMAS, **MEANT)
        errors = found.standard_errors
        off.append([(found.values[n] - FOUND[n]) / errors[n] for n in found.names])
        assert found.misfit == pytest.approx(1, abs=0.45)
    ratios = np.sqrt(np.mean(np.square(off), axis=0))
    assert ratios.min() > 0.6
    assert ratios.max() < 1.5
    assert errors["frame_scale"] == 0  # this parameter was fixed


def test_places_that_are_wrong_are_named_and_do_not_pull():
    angles, seen = places(40, noise=1.0)
    clean = kinematics.calibrate(angles, *seen, DRAWN, **SIGMAS, **MEANT)
    wrong = [3, 17, 20, 39]
    seen[:, wrong] += [[4.0, -3.0, 2.0, 5.0], [1.0, 3.0, -5.0, 2.0]]
    found = kinematics.calibrate(angles, *seen, DRAWN, **SIGMAS, **MEANT)
    assert found.outliers == tuple(wrong)
    for name in found.names:
        moved = abs(found.values[name] - clean.values[name])
        assert moved < 2.5 * clean.standard_errors[name], name
    assert "points that do not fit: 3, 17, 20, 39" in found.report()


def test_a_picture_of_unknown_scale_does_not_tell_the_lengths():
    angles, seen = places(60, noise=1.0, frame=FRAME | {"frame_scale": 1.03})
    found = kinematics.calibrate(angles, *seen, DRAWN, free=kinematics.NAMES, **SIGMAS, **MEANT)
    (group,) = found.unidentified
    assert set(group) == {*kinematics.LENGTHS, "frame_scale"}
    assert found.rank == len(found.names) - 1
    assert found.condition > 1e6
    # The ratios of the lengths are found, and also the mounting.
    ratios = np.array(found.linkage.bar_mm) / found.linkage.base_mm
    assert ratios == pytest.approx(np.array(TRUE.bar_mm) / TRUE.base_mm, rel=3e-3)
    assert found.standard_errors["gain1"] < 2e-3
    assert found.standard_errors["bar1_mm"] > 1
    assert "do not determine bar1_mm, bar2_mm" in found.report()
    # If one length is given, the points determine all other lengths.
    free = [name for name in kinematics.NAMES if name != "base_mm"]
    start = Linkage(100, TRUE.base_mm)
    given = kinematics.calibrate(angles, *seen, start, free=free, **SIGMAS, **MEANT)
    assert given.unidentified == ()
    assert given.values["frame_scale"] == pytest.approx(1.03, abs=3e-3)


def test_a_joint_that_never_turned_has_no_gain():
    # End points on a circle around an elbow that does not move.
    theta2 = np.linspace(-1.4, 0.2, 40)
    theta1 = np.full(40, -0.5)
    keep = TRUE.forward_limits(theta1, theta2) == Limit.NONE
    theta = np.array([theta1, theta2])[:, keep]
    seen = np.array(kinematics.framed(FRAME, *TRUE.forward(*theta)))
    angles = (theta - OFFSET) / GAIN
    found = kinematics.calibrate(angles, *seen, DRAWN, **SIGMAS, **MEANT)
    named = {name for group in found.unidentified for name in group}
    assert {"offset1_rad", "gain1"} <= named
    assert found.rank < len(found.names)


def test_without_a_grid_of_its_own_fewer_are_free():
    angles, seen = places(30, noise=1.0, frame=dict.fromkeys(FRAME, 0.0) | {"frame_scale": 1.0})
    free = kinematics.LENGTHS + kinematics.MOUNTING
    found = kinematics.calibrate(angles, *seen, DRAWN, free=free, **SIGMAS, **MEANT)
    assert found.names == free
    assert found.values["frame_x_mm"] == 0
    assert found.values["base_mm"] == pytest.approx(TRUE.base_mm, abs=0.2)
    assert found.report().count("fixed") == 4


def test_angles_that_belong_to_other_places_are_refused():
    angles, seen = places(40)
    with refusal(CalibrationError):
        kinematics.calibrate(angles, *seen[:, ::-1], DRAWN, **SIGMAS, **MEANT)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"free": ("bar9_mm",)}, "free must name one or more"),
        ({"free": ()}, "free must name one or more"),
        ({"place_sigma_mm": 0.0}, "more than 0"),
        ({"angle_sigma_rad": -1.0}, "more than 0"),
        ({"x_mm": [1.0, 2.0]}, "must have shape"),
        ({"y_mm": np.full(40, np.nan)}, "finite"),
    ],
)
def test_arguments_that_do_not_go_together(change, words):
    angles, (x, y) = places(40)
    arguments = {"angles_rad": angles, "x_mm": x, "y_mm": y, "start": DRAWN, **SIGMAS} | change
    with pytest.raises(SpotsError, match=words):
        kinematics.calibrate(**arguments)


def test_too_few_places_that_fit_are_refused():
    angles, seen = places(7, noise=1.0)
    seen[:, 2:4] += 8.0
    with refusal(CalibrationError):
        kinematics.calibrate(angles, *seen, DRAWN, **SIGMAS, **MEANT)


def test_too_few_places_are_refused():
    angles, seen = places(5)
    with refusal(CalibrationError):
        kinematics.calibrate(angles, *seen, DRAWN, **SIGMAS)


def test_without_scipy_it_says_what_to_install(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        kinematics, "find_spec", lambda name: None if name == "scipy" else find(name)
    )
    with refusal(RequirementError):
        kinematics.calibrate(*places(40), [], DRAWN, **SIGMAS)
