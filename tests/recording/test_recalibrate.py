"""A recording gives the readings that another calibration would have given, bit for bit."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

import spots
from spots import cli
from spots.calibrate import calibration_file
from spots.calibrate.fit.shift import shifted
from spots.errors import SpotsError
from spots.link.board import Board
from spots.link.connect import prepare, upload
from spots.recording.recalibrate import recalibrate
from spots.recording.recorder import Recorder
from spots_device.reading import decode
from spots_device.reading.calibration import Calibration
from spots_sim.board.lockstep import LockstepLink
from spots_sim.person.stage import strip_lines
from spots_sim.strip.files import Ambient, Finger, ScenarioFile, SensorFile, load
from spots_sim.strip.scenario import Scenario

pytestmark = pytest.mark.board

FIELDS = "t_us", "sequence", "sensor", "flags", "contrast_q20", "brightness_q20", "position_um"
FIELDS = *FIELDS, "force_mN"
SILICONE = "silicone 4096 300 1000 3000 400 300 150 400 4000 40000 60 50 40"
WARM = "temperature 20000 10000 40000", "warm 42500 12000 5000 1000 -4000 -7000 -7000"
FINGERS = [
    Finger(points=[(at_s, x_mm, 0), (at_s + 0.1, x_mm, 2000), (at_s + 2.0, x_mm, 0)])
    for at_s, x_mm in [(3, 30), (4, 62), (9, 30), (9.5, 62), (12, 50), (12.5, 20)]
]
DATA = Path(__file__).parents[1] / "data"
LEAVES = Ambient(steps=[(0.0, 0.0), (2.5, 12.0)], leaves_percent=70.0, leaves_hz=0.5)


def scenario(**more) -> Scenario:
    return Scenario(msgspec.structs.replace(load(ScenarioFile, "demo"), **more))


def play(board, path, seconds, commands=()):
    """Record a board; send each command after its share of the time."""
    with Recorder(board, path, rotate_bytes=150_000):
        board.stream("touch", "spectrum")
        for command in (*commands, None):
            for _ in board.frames(seconds / (len(commands) + 1)):
                pass
            if command:
                board.command(command)


def touches_of(path, *calibrations):
    """Return the touches of a recording before and after; assert that they are the same."""
    before = spots.read_arrays(path).touches
    after = spots.recalibrated(path, *calibrations).touches
    assert len(after) == len(before)
    for name in FIELDS:
        wrong = np.flatnonzero(before[name] != after[name])
        assert not len(wrong), (name, before[wrong[:3]], after[wrong[:3]])
    return after


KINDS = {
    "touches": {},
    "leaves": {"scenario": {"ambient": LEAVES}},
    "settings": {
        "commands": [
            "set gain=8",
            "set gain=9 exposure_us=5000",
            "set exposure_us=10000 dark_every=40",
            "dark",
            "set dark_every=0 mains_hz=50",
            "tare",
            "set led_mA=12",
            "autoexpose",
            "set led_mA=20 gain=9 exposure_us=2780",
        ]
    },
    "real": {"sensor": "real", "lines": [SILICONE, *WARM]},
    "dim": {"sensor": "daylight", "commands": ["set exposure_us=20000", "dark"]},
    "fingers": {"scenario": {"touch": FINGERS, "seconds": 16.0}, "commands": ["set keys=1"]},
    "fast": {"commands": ["set exposure_us=2780", "set exposure_us=1500"]},
}


@pytest.mark.parametrize("kind", KINDS)
def test_its_own_calibration_gives_what_the_board_sent(kind, calibration, tmp_path):
    how = KINDS[kind]
    light = scenario(**how.get("scenario", {}))
    with Board(LockstepLink(load(SensorFile, how.get("sensor", "default")), light, 1)) as board:
        made = [f"board {board.info['id']}", *calibration[1:], *how.get("lines", [])]
        prepare(board, made)
        play(board, tmp_path / "run.spots", 16, how.get("commands", ()))
    touches = touches_of(tmp_path / "run.spots", made)
    assert (touches["flags"] & decode.LED_OFF != 0).sum() > 5  # dark windows
    assert touches["known"].sum() > 200
    made = recalibrate(tmp_path / "run.spots", [made], tmp_path / "new.spots")
    unknown = (touches["flags"] & decode.NOT_CALIBRATED != 0).sum()
    assert (made.known, made.unknown) == (len(touches) - unknown, unknown)


def test_each_of_two_strips_has_its_calibration(sensor, calibration, tmp_path):
    light, path = scenario(), tmp_path / "run.spots"
    with Board(LockstepLink(sensor, light, 1, second=(light, 2))) as board:
        lines = [strip_lines(calibration, i) for i in board.sensors]
        for i in board.sensors:
            upload(board, lines[i], i)
        play(board, path, 12)
    assert {*touches_of(path, *lines)["sensor"]} == {0, 1}
    touches_of(path, lines[1])  # strip 0 stays as recorded


def test_a_position_needs_one_spectrum_only(calibration, sensor, tmp_path):
    path, damaged = tmp_path / "run.spots", tmp_path / "damaged.spots"
    with Board(LockstepLink(sensor, scenario(), 1)) as board:
        prepare(board, calibration)
        with Recorder(board, path):
            board.stream("touch", "spectrum")
            for _ in board.frames(24):
                pass
    before = spots.read_arrays(path).touches
    pieces = path.read_bytes().split(b"\0")
    del pieces[len(pieces) // 3 : len(pieces) // 3 + 30]
    damaged.write_bytes(b"\0".join(pieces))
    with pytest.warns(UserWarning, match="of its frames are missing"):
        after = spots.recalibrated(damaged, calibration).touches
    old = before[np.isin(before["sequence"], after["sequence"])]
    lost = np.flatnonzero(after["flags"] & decode.NOT_CALIBRATED)
    assert len(lost) <= 1  # the reading whose spectrum is missing
    known = np.delete(np.arange(len(old)), lost)
    for name in FIELDS:
        assert (old[name] == after[name])[known].all(), name


def test_another_calibration_gives_what_a_board_with_it_sends(calibration, sensor, tmp_path):
    other = shifted(
        calibration, [8500, 42_500, 76_500], 0.002 * np.array([[1, 0, 0, -1, 0, 0]] * 3)
    )
    paths = tmp_path / "one.spots", tmp_path / "two.spots"
    for path, lines in zip(paths, (calibration, other)):
        with Board(LockstepLink(sensor, scenario(), 1)) as board:
            prepare(board, lines)
            play(board, path, 15)
    mine = spots.recalibrated(paths[0], other).touches
    theirs = spots.read_arrays(paths[1]).touches
    assert (spots.read_arrays(paths[0]).touches["position_um"] != mine["position_um"]).sum() > 300
    # The same light, noise and times of dark windows.
    for name in set(FIELDS) - {"sequence"}:
        assert (mine[name] == theirs[name]).all(), name


def test_the_command_writes_a_recording(calibration, sensor, tmp_path, capsys):
    path, toml = tmp_path / "run.spots", tmp_path / "new.toml"
    with Board(LockstepLink(sensor, scenario(), 1)) as board:
        prepare(board, calibration)
        play(board, path, 4)
    conditions = Calibration(calibration).conditions
    made = calibration_file.CalibrationFile(
        date=calibration_file.now(), **conditions._asdict(), lines=calibration
    )
    calibration_file.save(made, toml, None)
    assert cli.main(["recalibrate", str(path), "--calibration", str(toml)]) == 0
    shown = capsys.readouterr()
    out = tmp_path / "run-recalibrated.spots"
    assert shown.out.strip() == str(out)
    assert "readings computed, 0 unknown" in shown.err
    touches = [spots.read_arrays(one).touches for one in (out, path)]
    assert touches[0].tobytes() == touches[1].tobytes()  # NaN is not NaN
    again = ["recalibrate", str(path), "--calibration", str(toml)]
    assert cli.main(again) == 2
    assert "exists" in capsys.readouterr().err
    assert cli.main(["recalibrate", str(out), "--calibration", str(toml)]) == 2
    assert "is already recalibrated: name the original" in capsys.readouterr().err


def test_what_cannot_be_computed_is_refused_with_its_reason(calibration, sensor, tmp_path):
    def recorded(name, *commands, streams=("touch", "spectrum")):
        path = tmp_path / name
        with Board(LockstepLink(sensor, scenario(), 1)) as board:
            prepare(board, calibration)
            for command in commands:
                board.command(command)
            with Recorder(board, path):
                board.stream(*streams)
                for _ in board.frames(0.5):
                    pass
        return path

    averages = recorded("averages.spots", "set average=4")
    other = recorded("other.spots", "set led_mA=12")
    plain = recorded("plain.spots", streams=("touch",))
    foreign = ["board 0123456789abcdef", *calibration[1:]]
    for path, lines, why in [
        (averages, calibration, "record with average=1"),
        (other, calibration, r"the recording at gain=9 led_mA=12 .*calibrate with --keep-settings"),
        (DATA / "run.spots", calibration, "do not contain the light .* with the present firmware"),
        (plain, calibration, "it has no spectra"),
        (plain, foreign, "name a calibration of this board"),
        (plain, calibration[:3], "a calibration is invalid"),
    ]:
        with pytest.raises(SpotsError, match=why):
            recalibrate(path, [lines], tmp_path / "new.spots")
        assert not (tmp_path / "new.spots").exists()
