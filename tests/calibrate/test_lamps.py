"""Lamps on the mains: exposures of whole half periods, by the board's clock."""

import numpy as np
import pytest
from msgspec import structs

from spots.link.connect import upload
from spots.link.frames import Touch
from spots_sim.files import SensorFile, Surroundings, load
from spots_sim.measurements import PLACES, Run, _position
from spots_sim.rig import Rig
from spots_sim.stage import Stage, calibrate


def lit(irradiance_uW_cm2, flicker_hz, clock_error_percent):
    sensor = load(SensorFile, "default")
    return structs.replace(
        sensor,
        surroundings=Surroundings(
            irradiance_uW_cm2=irradiance_uW_cm2, flicker_percent=100.0, flicker_hz=flicker_hz
        ),
        converter=structs.replace(sensor.converter, clock_error_percent=clock_error_percent),
    )


def accuracy_um(sensor, exposure_us):
    run = Run()
    with Rig(sensor, 0, exposure_us, 1) as rig:
        _position(rig, np.random.default_rng(1), run, PLACES[::3])
    return run.summary["position"]["accuracy_um"]


@pytest.mark.parametrize(
    ("flicker_hz", "clock_error_percent", "exposure_us"),
    [(100.0, -3.0, 10_000), (120.0, 3.0, 8333), (120.0, -3.0, 100_000)],
)
def test_bright_lamps_of_full_swing_cost_little_accuracy(
    flicker_hz, clock_error_percent, exposure_us
):
    dark = accuracy_um(load(SensorFile, "default"), exposure_us)
    assert accuracy_um(lit(150.0, flicker_hz, clock_error_percent), exposure_us) < 1.5 * dark


@pytest.mark.parametrize("clock_error_percent", [-3.0, 3.0])
def test_forty_of_forty_taps_of_a_calibration_made_in_the_dark(clock_error_percent):
    lines = calibrate(load(SensorFile, "default"))
    sensor = lit(150.0, 120.0, clock_error_percent)
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


@pytest.mark.parametrize(
    ("settings", "exposure_us"), [("mains_hz=60", 8333), ("mains_hz=50", 20_000)]
)
def test_force_and_position_hold_at_other_exposures_under_lamps(settings, exposure_us):
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
