"""Flickering lamps: the measured mains frequency, and exposures of whole half periods of it."""

import argparse
import io

import numpy as np
import pytest
from msgspec import structs
from rich.console import Console
from support.refusals import refusal

from spots.advice import lamps
from spots.calibrate.session import steps
from spots.calibrate.session.bench import Bench
from spots.calibrate.session.guide import Guide
from spots.calibrate.session.session_file import Session
from spots.deploy.doctor import examine_board
from spots.errors import StateError
from spots.link.board import Board
from spots.link.connect import upload
from spots.link.frames import Touch
from spots_sim.board.lockstep import LockstepLink
from spots_sim.demo.demo import demo
from spots_sim.measure.measurements import PLACES, Run, _position
from spots_sim.measure.rig import Rig
from spots_sim.person import stage as stage_module
from spots_sim.person.stage import (
    NEAR_UM,
    WARM_S,
    Stage,
    calibrate,
)
from spots_sim.person.stage_presser import StagePresser
from spots_sim.strip.files import (
    DATA,
    SensorFile,
    Surroundings,
    load,
)
from spots_sim.strip.scenario import Held, Press

SETTINGS = "exposure_us", "average", "gain", "led_mA", "led", "mains_hz", "channels"


def lit(irradiance_uW_cm2, flicker_hz, clock_error_percent, percent=100.0, sensor="default"):
    sensor = load(SensorFile, sensor)
    return structs.replace(
        sensor,
        surroundings=Surroundings(
            irradiance_uW_cm2=irradiance_uW_cm2, flicker_percent=percent, flicker_hz=flicker_hz
        ),
        converter=structs.replace(sensor.converter, clock_error_percent=clock_error_percent),
    )


def accuracy_um(sensor, exposure_us):
    run = Run()
    with Rig(sensor, 0, exposure_us, 1) as rig:
        _position(rig, np.random.default_rng(1), run, PLACES[::3])
    return run.summary["position"]["accuracy_um"]


@pytest.mark.board
@pytest.mark.parametrize(
    ("sensor", "flicker_hz", "clock_error_percent", "exposure_us"),
    [
        ("default", 120.0, 3.0, 8333),
        ("short_30mm", 100.0, -3.0, 100_000),
    ],
)
def test_bright_lamps_of_full_swing_cost_little_accuracy(
    sensor, flicker_hz, clock_error_percent, exposure_us
):
    dark = accuracy_um(load(SensorFile, sensor), exposure_us)
    under_lamp = lit(150.0, flicker_hz, clock_error_percent, sensor=sensor)
    assert accuracy_um(under_lamp, exposure_us) < 1.5 * dark


@pytest.mark.board
@pytest.mark.parametrize(
    ("exposure_us", "clock_error_percent"), [(100_000, -3.0), (100_000, 1.7), (300_000, 3.0)]
)
def test_a_long_exposure_is_corrected_by_few_restarts(exposure_us, clock_error_percent):
    starts = []
    link = LockstepLink(lit(150.0, 100.0, clock_error_percent), Held())
    with Board(link) as board:
        board.command(f"set mains_hz=50 exposure_us={exposure_us}")
        chip, write = link.chip, link.chip.write

        def written(data):
            if len(data) == 21:  # the SMUX image
                starts.append(board.now_s())
            write(data)

        chip.write = written
        board.command("stream spectrum")
        list(board.frames(90.0))
        registers = []
        for first in (0x81, 0xCA, 0xCB):  # ATIME, ASTEP
            write(bytes([first]))
            registers += chip.read(1)
    cycles, steps = registers[0] + 1, (registers[1] | registers[2] << 8) + 1
    step_us = 2.78 * cycles * (1 + clock_error_percent / 100)
    assert steps * step_us == pytest.approx(exposure_us, abs=0.8 * step_us)
    assert len(starts) <= 3
    assert max(starts) < 60.0


def test_forty_of_forty_taps_of_a_calibration_made_in_the_dark():
    lines = calibrate(load(SensorFile, "default"))
    sensor = lit(150.0, 120.0, 3.0)
    rng = np.random.default_rng(4)
    with Stage(sensor, seed=3) as stage:
        board = stage.board
        info = board.command("hello")
        assert info["exposure_us"] == 8333
        upload(board, [f"board {info['id']}", *lines[1:]])  # made at 10 ms
        board.command("dark", timeout_s=5)
        board.command("stream touch")
        right = false = 0
        for x_um in rng.uniform(5_000, 80_000, 40):
            stage.press(x_um, 2500.0)
            begun_s = board.now_s()
            held = [f for f in board.frames(0.08) if isinstance(f, Touch) and f.trusted]
            held = [f.position_um for f in held if f.touching and f.time_s > begun_s + 0.01]
            right += bool(held) and abs(np.median(held) - x_um) < 500
            stage.release()
            begun_s = board.now_s() + 0.02
            idle = [f for f in board.frames(0.1) if isinstance(f, Touch) and f.time_s > begun_s]
            false += any(f.touching for f in idle)
        assert (right, false) == (40, 0)


@pytest.mark.board
@pytest.mark.parametrize(
    ("settings", "exposure_us"),
    [("mains_hz=60", 8333), ("mains_hz=50", 20_000), ("mains_hz=0", 8333), ("mains_hz=0", 50_000)],
)
def test_force_and_position_hold_at_other_exposures(settings, exposure_us):
    sensor = load(SensorFile, "default")
    lines = calibrate(sensor)
    with Stage(sensor, seed=3, settings=settings) as stage:
        board = stage.board
        board.command(f"set exposure_us={exposure_us}")
        upload(board, lines)
        board.command("dark", timeout_s=5)
        board.command("stream touch")
        for x_um, force_mN in ((20_000, 3000), (60_000, 5000)):
            stage.press(x_um, force_mN)
            begun_s = board.now_s() + 0.02
            held = [f for f in board.frames(1.0) if isinstance(f, Touch) and f.time_s > begun_s]
            assert all(f.trusted for f in held)
            assert np.mean([f.position_um for f in held]) == pytest.approx(x_um, abs=60)
            assert np.mean([f.force_mN for f in held]) == pytest.approx(force_mN, rel=0.02)


def found_hz(sensor, settings="average=2", press=None, busy_us=None):
    """Return the mains frequency in Hz that is measured with a new board; 0 without flicker.

    Checks that the measurement does not change the settings of the board.

    Parameters
    ----------
    sensor : SensorFile
        Simulated strip and lamps.
    settings : str
        Settings of the board, for the command ``set``.
    press : Press, optional
        Finger on the strip.
    busy_us : float, optional
        Processor time of a sample, for a slow board.
    """
    held = Held()
    held.press = press
    with Board(LockstepLink(sensor, held, seed=1, busy_us=busy_us)) as board:
        board.command("set " + settings)
        before = board.command("get")
        found = lamps.mains_hz(board)
        after = board.command("get")
        assert [after[name] for name in SETTINGS] == [before[name] for name in SETTINGS]
        return found


@pytest.mark.board
@pytest.mark.parametrize(
    ("mains_hz", "clock_error_percent", "irradiance_uW_cm2", "percent"),
    [
        (50, -3.0, 20.0, 10.0),
        (50, 3.0, 20.0, 10.0),
        (60, 3.0, 20.0, 10.0),
        (50, 0.0, 150.0, 100.0),
        (60, -3.0, 150.0, 100.0),
    ],
)
def test_lamps_are_found_by_the_flicker_of_the_counts(
    mains_hz, clock_error_percent, irradiance_uW_cm2, percent
):
    sensor = lit(irradiance_uW_cm2, 2.0 * mains_hz, clock_error_percent, percent)
    assert found_hz(sensor) == mains_hz


@pytest.mark.parametrize("flicker_hz", [99.2, 120.8])
def test_lamps_are_found_on_a_mains_that_deviates(flicker_hz):
    assert found_hz(lit(150.0, flicker_hz, 2.0, 10.0)) == round(flicker_hz / 20) * 10


@pytest.mark.parametrize("kind", ["gpio", "always"])
def test_lamps_are_found_with_an_led_that_has_no_current_to_set(kind):
    sensor = lit(20.0, 120.0, 1.0, 10.0, sensor=kind)
    assert found_hz(sensor, "led=" + kind) == 60


def test_lamps_are_found_whatever_is_set_and_under_a_press():
    press = Press(NEAR_UM / 1000, 8_000, 4.0)
    assert found_hz(lit(20.0, 100.0, 1.0, 10.0), "mains_hz=60 gain=10", press) == 50


@pytest.mark.board
@pytest.mark.parametrize(
    ("irradiance_uW_cm2", "clock_error_percent"), [(0.0, 3.0), (20.0, -3.0), (150.0, 3.0)]
)
def test_no_lamp_and_a_lamp_that_does_not_flicker_are_not_found(
    irradiance_uW_cm2, clock_error_percent
):
    assert found_hz(lit(irradiance_uW_cm2, 100.0, clock_error_percent, 0.0)) == 0


# 259.7 and 979 Hz look like 100 Hz at one of the two exposures, and 479.7 Hz like 120 Hz.
@pytest.mark.board
@pytest.mark.parametrize("flicker_hz", [50.0, 110.0, 259.7, 300.0, 479.7, 979.0])
def test_a_flicker_of_another_frequency_is_not_found(flicker_hz):
    assert found_hz(lit(150.0, flicker_hz, 0.0)) == 0


@pytest.mark.parametrize("irradiance_uW_cm2", [0.0, 150.0])
def test_a_board_that_misses_most_samples_finds_lamps(irradiance_uW_cm2):
    sensor = lit(irradiance_uW_cm2, 100.0, 1.0)
    found = found_hz(sensor, busy_us=6_000.0)
    assert found == (50 if irradiance_uW_cm2 else 0)


@pytest.mark.board
def test_an_application_runs_with_a_calibration_made_under_lamps(tmp_path):
    path = tmp_path / "lamp.toml"
    lamp = "irradiance_uW_cm2 = 20\nflicker_percent = 100\nflicker_hz = 120\n"
    default = (DATA / "sensors" / "default.toml").read_text(encoding="utf-8")
    path.write_text(f"{default}\n[surroundings]\n{lamp}", encoding="utf-8")
    figures = demo(str(path), None, 0, 5.0, True, True)
    assert figures["position_rmse_um"] < 250


class Stops(StagePresser):
    """A presser that ends the session at its first press, after the lamps were measured."""

    def press(self, wanted):
        raise StateError("the session ends here")


@pytest.mark.board
@pytest.mark.parametrize(
    ("mains_hz", "irradiance_uW_cm2", "becomes"),
    [(0, 20.0, 60), (0, 0.0, 0), (50, 20.0, 50)],
)
def test_a_session_begins_with_the_lamps_unless_they_were_set(
    tmp_path, monkeypatch, mains_hz, irradiance_uW_cm2, becomes
):
    monkeypatch.setattr(stage_module, "_OSCILLATOR_S", 0.0)  # the session needs no exact period
    shown = io.StringIO()
    guide = Guide(Console(file=shown, width=200))
    with Stage(lit(irradiance_uW_cm2, 120.0, 2.0, 10.0), seed=1) as stage:
        stage.board.command(f"set mains_hz={mains_hz} exposure_us=10000")
        stage.reader.set_up()
        bench = Bench(stage.reader, Stops(stage), guide, stage.length_um, tmp_path / "a.toml")
        options = argparse.Namespace(channels=None, keep_settings=False)
        with refusal(StateError):
            steps.calibrate(bench, Session(tmp_path / "a.jsonl"), "position", 17, None, options)
        exposure_us = 8333 if becomes == 60 else 10_000
        assert stage.reader.conditions.exposure_us == exposure_us
        if becomes != mains_hz:
            assert "lamps flicker at 120 Hz: mains_hz=60" in shown.getvalue()
            stage.board.command("reboot")  # the session continues with the same exposure
            list(stage.board.frames(0.5))
        state = stage.board.command("get")
        assert (state["mains_hz"], state["exposure_us"]) == (becomes, exposure_us)


@pytest.mark.parametrize(
    ("mains_hz", "irradiance_uW_cm2", "ok", "text"),
    [
        (50, 20.0, True, "lamps flicker at 100 Hz: mains_hz=50"),
        (0, 20.0, False, "100 Hz: run 'spots command set mains_hz=50', then 'spots command save'"),
        (60, 20.0, False, "100 Hz: run 'spots command set mains_hz=50', then 'spots command save'"),
        (0, 0.0, True, "no lamp flickers: mains_hz=0"),
    ],
)
def test_doctor_compares_the_lamps_with_the_setting(mains_hz, irradiance_uW_cm2, ok, text):
    held = Held()
    held.press = Press(NEAR_UM / 1000, 8_000, 4.0)
    link = LockstepLink(lit(irradiance_uW_cm2, 100.0, 2.0, 10.0), held, seed=1, started_s=WARM_S)
    with Board(link) as board:
        board.command(f"set mains_hz={mains_hz}")
        (found,) = [one for one in examine_board(board) if one.check == "lamps"]
        assert board.command("get")["mains_hz"] == mains_hz
    assert found.ok is ok
    assert text in found.text
