"""The three kinds of strip LED: driven by the sensor, switched by a pin, or always on."""

import json

import pytest
from support.refusals import refusal

from spots.cli import main
from spots.errors import BoardError
from spots.link.connect import upload
from spots.link.frames import Touch
from spots_device.reading import decode
from spots_device.reading.decode import (
    DARK_SAMPLES,
    DARK_SUBTRACTED,
    LED_OFF,
    NOT_CALIBRATED,
)
from spots_sim.person.stage import Stage, calibrate
from spots_sim.strip.files import SensorFile, load

pytestmark = pytest.mark.board

BOARDS = ["virtual", "virtual_circuitpython"]
KINDS = ["gpio", "always"]


def unplugged_dark(made):
    """Take and return a dark frame, for which the person unplugs an LED that is always on."""
    made.held.unplugged = True
    reply = made.board.command("dark off", timeout_s=30)
    made.held.unplugged = False
    return reply["dark"]


def lit(made, kind, **options):
    """Return a rig with an LED of a kind (value of the setting ``led``), after its dark frame."""
    made = made(sensor=load(SensorFile, kind), **options)
    made.board.command(f"set led={kind}")
    if kind == "always":
        unplugged_dark(made)
    return made


@pytest.mark.parametrize("board", BOARDS)
def test_a_board_of_before_has_its_led_on_the_sensor(rig, board):
    info = rig(board=board).board.command("hello")
    assert (info["led"], info["led_mA"]) == ("ldr", 20)


@pytest.mark.parametrize(("board", "kind"), [*zip(BOARDS, KINDS)])
def test_the_breakouts_own_led_stays_off(rig, kind, board):
    made = lit(rig, kind, board=board)
    driven = []
    collect = made.link.chip._collect
    made.link.chip._collect = lambda *a, **k: driven.append(made.link.chip._led_mA()) or collect(*a)
    made.press(3.0, 6_000)
    assert made.board.command("hello")["led_mA"] == 0
    made.board.command("autoexpose", timeout_s=60)
    made.board.command("set led_mA=50 gain=5")
    made.spectra(30)
    assert set(driven) == {0.0}


@pytest.mark.parametrize(("board", "kind"), [*zip(BOARDS, KINDS)])
def test_a_press_is_seen_by_the_light_of_any_led(rig, kind, board):
    made = lit(rig, kind, board=board)
    dark = [sum_ / DARK_SAMPLES for sum_ in made.board.command("dark", timeout_s=30)["dark"]]
    assert max(dark) < 5
    made.press(3.0, 6_000)
    spectra = [s for s in made.spectra(20) if not s.flags & LED_OFF]
    assert min(max(spectrum.counts) for spectrum in spectra) > 300
    assert all(spectrum.flags & DARK_SUBTRACTED for spectrum in spectra)


@pytest.mark.parametrize("board", BOARDS)
def test_a_pin_switches_the_led_off_for_dark_frames_and_when_another_kind_is_set(rig, board):
    made = lit(rig, "gpio", board=board)
    made.press(3.0, 6_000)
    made.board.command("stream spectrum")
    made.board.command("dark", timeout_s=30)
    world = made.link.chip._light
    assert world._pin_on
    made.board.command("set led=ldr")
    assert not world._pin_on


@pytest.mark.parametrize(("board", "kind"), [*zip(BOARDS, KINDS)])
def test_auto_moves_gain_and_exposure_alone(rig, kind, board):
    made = lit(rig, kind, board=board)
    made.press(2.0, 8_000)
    found = made.board.command("autoexpose", timeout_s=120)
    assert found["led_mA"] == 0
    assert found["led"] == kind
    if kind == "always":
        assert "spots dark" in found["note"]
        unplugged_dark(made)
    full = made.board.command("get")["full_scale"]
    peak = max(max(s.counts) for s in made.spectra(10) if not s.flags & LED_OFF)
    assert 0.42 < peak / full < 0.92


def test_the_dark_frame_of_an_led_that_is_always_on_survives_a_restart(rig, tmp_path):
    made = lit(rig, "always", folder=tmp_path)
    dark = made.board.command("dark")["dark"]
    made.board.command("save")
    made.close()
    again = rig(sensor=load(SensorFile, "always"), folder=tmp_path)
    assert again.board.command("get")["led"] == "always"
    assert again.board.command("dark")["dark"] == dark
    assert again.board.command("get")["dark"] == dark


def test_an_led_that_is_always_on_is_never_switched_off_by_itself(rig):
    made = lit(rig, "always")
    frames = made.readings(3_000)  # 30 s: two windows are due on a board that switches its LED
    assert not any(frame.flags & LED_OFF for frame in frames)


def test_without_a_dark_frame_the_board_says_what_to_do_and_uses_no_calibration(rig):
    sensor = load(SensorFile, "always")
    made = rig(sensor=sensor)
    reply = made.board.command("set led=always")
    assert "spots dark" in reply["note"]
    with refusal(BoardError, why="no_dark"):
        made.board.command("dark")
    assert not made.spectra(1)[0].flags & DARK_SUBTRACTED


def test_a_dark_frame_of_other_settings_is_not_used(rig):
    sensor = load(SensorFile, "always")
    calibration = calibrate(sensor)
    _, gain, exposure_us, _ = next(line for line in calibration if line.startswith("made")).split()
    made = lit(rig, "always")
    made.board.command(f"set gain={gain} exposure_us={exposure_us}")
    plan = next(line for line in calibration if line.startswith("plan")).split()[1:]
    made.board.command("set channels=" + ",".join(plan))
    unplugged_dark(made)
    upload(made.board, list(calibration))
    assert not made.readings(5)[-1].flags & NOT_CALIBRATED
    other = 5 if int(gain) != 5 else 6
    assert "note" in made.board.command(f"set gain={other}")
    assert made.readings(5)[-1].flags & NOT_CALIBRATED
    reply = made.board.command(f"set gain={gain}")  # the stored frame fits again
    assert "note" not in reply
    assert not made.readings(5)[-1].flags & NOT_CALIBRATED


@pytest.mark.parametrize("kind", KINDS)
def test_a_strip_of_any_led_is_calibrated_and_measures(kind):
    sensor = load(SensorFile, kind)
    lines = calibrate(sensor)
    with Stage(sensor) as stage:
        stage.expose()
        upload(stage.board, list(lines))
        stage.board.command("stream touch")
        for place_mm in (10, 40, 75):
            stage.press(1000 * place_mm, 2_000)
            begun_s = stage.board.now_s() + 0.1
            touches = []
            for frame in stage.board.frames():
                if isinstance(frame, Touch) and frame.time_s > begun_s:
                    touches.append(frame)
                if len(touches) == 10:
                    break
            error_um = [touch.position_um - 1000 * place_mm for touch in touches]
            assert abs(sum(error_um) / 10) < 300
            assert not any(touch.flags & decode.MISFIT for touch in touches)


@pytest.mark.parametrize("kind", KINDS)
def test_the_demo_of_any_led_follows_the_finger(kind, capsys):
    arguments = ["--fast", "--seconds", "6", "--json", "--sensor", kind]
    assert main(["demo", *arguments]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["lost"] == result["bad_crc"] == 0
    assert result["touches"] >= 2
    assert result["position_rmse_um"] < 150
