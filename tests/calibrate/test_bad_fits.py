"""A calibration that does not fit its presses is refused, and neither file nor board changes."""

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from support.refusals import refusal

from spots import SpotsError, cli
from spots.calibrate.session.joint import fit_joint
from spots.calibrate.session.make import make
from spots.calibrate.session.session_file import Session
from spots.errors import CalibrationError

pytestmark = pytest.mark.board


def run(*arguments):
    return cli.main(["calibrate", *map(str, arguments), "--port", "virtual"])


def changed(folder, tmp_path, change):
    """Write a session whose points are changed by ``change(number, point)``; return its path."""
    counts: dict[str, int] = {}
    lines = []
    for point in Session(folder / "a.jsonl").points:
        number = counts[point.kind] = counts.get(point.kind, -1) + 1
        lines.append(msgspec.json.encode(replace(point, **change(number, point))) + b"\n")
    out = tmp_path / "b.jsonl"
    out.write_bytes(b"".join(lines))
    return out


def moved(kind, number, um):
    """Return a change that moves one press, or all presses from a number on if it is negative."""

    def change(at, point):
        found = point.kind == kind and (at == number or at >= -number > 0)
        end_um = 85_000.0 * (1 + point.strain_ppm * 1e-6)
        place_um = min(max(point.place_um + um, 0.0), end_um)
        return {"place_um": place_um} if found else {}

    return change


@pytest.mark.parametrize(
    ("session", "change", "says"),
    [
        ("staged", moved("position", 8, 4000.0), r"0\.\d+ mm rms .*the press at 46\.5 mm with 6 N"),
        ("staged", moved("strain", 8, -4000.0), r"\d mm rms .*the press at 42\.8 mm with 6 N"),
        ("pressed", moved("hand", -10, 3000.0), r"\d mm rms .*line \d+ of .*b\.jsonl to repeat"),
        ("pressed", moved("hand", 8, 9000.0), r"\d mm rms .*the press at \d+\.\d mm"),
    ],
)
def test_wrong_positions_are_refused(session, change, says, request, tmp_path):
    path = changed(request.getfixturevalue(session), tmp_path, change)
    with pytest.raises(SpotsError, match=r"does not fit its presses, and was not stored.*" + says):
        make(Session(path), say=lambda text: None)


def test_positions_that_give_no_table_are_refused(pressed, tmp_path):
    path = changed(pressed, tmp_path, moved("hand", -10, 9000.0))
    with refusal(CalibrationError):
        make(Session(path), say=lambda text: None)


def test_wrong_forces_are_refused(pressed, tmp_path):
    rng = np.random.default_rng(2)

    def change(number, point):
        return {"force_mN": point.force_mN * float(rng.choice([0.6, 1.0, 1.6]))}

    path = changed(pressed, tmp_path, change)
    with refusal(CalibrationError):
        make(Session(path), say=lambda text: None)


def test_wrong_second_forces_are_refused(pressed, tmp_path):
    def change(number, point):
        return {"then_mN": 9500.0 - point.then_mN} if point.then_mN else {}

    path = changed(pressed, tmp_path, change)
    with refusal(CalibrationError):
        make(Session(path), say=lambda text: None)


def test_a_wrong_angle_is_refused(staged, tmp_path):
    def change(number, point):
        wrong = point.kind == "joint" and number == 5
        return {"angle_deg": point.angle_deg + 10.0} if wrong else {}

    turned = Session(changed(staged, tmp_path, change)).of("joint")
    with refusal(CalibrationError):
        fit_joint(turned)


def test_a_refused_fit_changes_no_file(staged, tmp_path, capsys):
    path = changed(staged, tmp_path, moved("position", 8, 4000.0))
    out = path.with_suffix(".toml")
    out.write_bytes((staged / "a.toml").read_bytes())
    before = out.read_bytes()
    capsys.readouterr()
    assert run("force", "--session", path) == 2
    errors = capsys.readouterr().err
    assert errors.startswith("spots: the calibration does not fit its presses")
    assert errors.count("\n") == 1
    assert out.read_bytes() == before


@pytest.mark.parametrize("session", ["staged", "pressed"])
def test_a_length_that_contradicts_the_session_is_refused_before_a_press(
    session, request, tmp_path, capsys
):
    path = changed(request.getfixturevalue(session), tmp_path, lambda number, point: {})
    kind = ["position"] if session == "staged" else []
    assert run(*kind, "--session", path, "--length-mm", 40, "--places", 50) == 2
    assert "belongs to a strip of 85 mm, not of 40 mm" in capsys.readouterr().err
    lines = (request.getfixturevalue(session) / "a.jsonl").read_bytes().splitlines()
    assert len(Session(path).points) == len(lines)
