"""MuJoCo's model of a linkage agrees with the closed solution."""

import mujoco
import numpy as np
import pytest

from spots.cli import main
from spots_linkage.fivebar import Linkage
from spots_linkage.limits import LimitError
from spots_linkage.mjcf import mjcf, pose

LINKAGES = {
    "equal": Linkage(100, 80),
    "unequal": Linkage((99, 121, 118, 103), 77),
    "near": Linkage((60, 90, 95, 63), 50, "near"),
}
ARM = """bar_mm = [99, 121, 118, 103]
base_mm = 77
[[joint]]
calibration = "one.toml"
offset_deg = 0
[[joint]]
calibration = "two.toml"
offset_deg = 0
"""


@pytest.fixture(params=LINKAGES)
def linkage(request):
    return LINKAGES[request.param]


def _poses(linkage, count, rng):
    while count:
        angles = tuple(rng.uniform(-0.9, 1.2, 2).tolist())
        try:
            x_mm, y_mm = linkage.forward(*angles)
            # Near a singular pose, the angles do not determine the end point.
            if linkage.outer_angle(*angles) < np.radians(10):
                continue
        except LimitError:
            continue
        count -= 1
        yield angles, np.array([x_mm, y_mm])


def _model(linkage):
    model = mujoco.MjModel.from_xml_string(mjcf(linkage))
    return model, mujoco.MjData(model)


def test_at_our_solution_the_loop_is_closed(linkage):
    model, data = _model(linkage)
    for angles, wanted_mm in _poses(linkage, 100, np.random.default_rng(5_501)):
        data.qpos[:] = pose(linkage, angles)
        mujoco.mj_forward(model, data)
        assert 1e3 * abs(data.site("end_point").xpos[:2] * 1000 - wanted_mm).max() < 1
        assert 1e6 * abs(data.efc_pos).max() < 1


def test_a_disturbed_linkage_comes_back_to_our_solution(linkage):
    model, data = _model(linkage)
    rng = np.random.default_rng(5_502)
    for angles, wanted_mm in _poses(linkage, 5, rng):
        data.qpos[:] = pose(linkage, angles) + rng.uniform(-0.05, 0.05, 4)
        data.qvel[:] = 0
        data.ctrl[:] = angles
        mujoco.mj_step(model, data, 4000)
        assert 1e3 * abs(data.site("end_point").xpos[:2] * 1000 - wanted_mm).max() < 10


def test_the_key_frame_has_a_closed_loop(linkage):
    model, data = _model(linkage)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    assert abs(data.efc_pos).max() < 1e-9
    assert linkage.outer_angle(*data.ctrl) > np.radians(30)


def test_the_command_writes_a_new_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.toml").write_text(ARM)
    assert main(["twin", "--linkage", "arm.toml", "--mjcf", "arm.xml"]) == 0
    model = mujoco.MjModel.from_xml_path("arm.xml")
    assert model.nu == 2
    assert main(["twin", "--linkage", "arm.toml", "--mjcf", "arm.xml"]) == 2
    assert main(["twin", "--linkage", "arm.toml", "--mjcf", "new.xml", "--json"]) == 2
    assert "--mjcf writes the linkage" in capsys.readouterr().err
    assert not (tmp_path / "new.xml").exists()
    assert main(["twin", "--linkage", "default", "--mjcf", "new.xml"]) == 2
    assert "the simulated linkage 'default'" in capsys.readouterr().err
