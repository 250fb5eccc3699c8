"""Readings of the whole chain: press on the simulated strip, firmware, position on the host."""

import dataclasses
import math

import numpy as np
import pytest
from support.refusals import refusal
from support.sensors import replaced

from spots.errors import BoardError
from spots.link.board import Board
from spots.link.connect import prepare
from spots_device.reading import decode
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import (
    Ambient,
    Finger,
    ScenarioFile,
    load,
)
from spots_sim.strip.scenario import Pose, Scenario

pytestmark = pytest.mark.board


@pytest.mark.parametrize("position_mm", [5.0, 42.5, 80.0])
@pytest.mark.parametrize("force_mN", [1000.0, 4000.0])
def test_a_held_press_is_where_and_as_hard_as_it_is(rig, calibration, position_mm, force_mN):
    made = rig(calibration=calibration)
    made.press(position_mm, force_mN)
    readings = made.readings(50)
    assert all(reading.trusted for reading in readings)
    assert np.mean([r.position_um for r in readings]) == pytest.approx(1000 * position_mm, abs=100)
    assert np.mean([r.force_mN for r in readings]) == pytest.approx(force_mN, rel=0.03)


def test_force_does_not_move_the_position(rig, calibration):
    made = rig(calibration=calibration)
    places = []
    for force_mN in (1500.0, 9000.0):
        made.press(30.0, force_mN)
        places.append(np.mean([r.position_um for r in made.readings(50)]))
    assert places[0] == pytest.approx(places[1], abs=60)


def test_no_press_is_no_touch_and_no_position(rig, calibration):
    made = rig(calibration=calibration)
    for reading in made.readings(20):
        assert not reading.touching
        assert reading.flags & decode.TOO_DARK
        assert math.isnan(reading.position_um)
        assert reading.force_mN == 0


def test_samples_come_at_the_exposure_one_frame_each(rig, calibration):
    made = rig(calibration=calibration)
    readings = made.readings(200)
    times_us = np.array([r.t_us for r in readings])
    assert np.diff(times_us).mean() == pytest.approx(3597 * 2.78, rel=1e-3)
    assert [r.sequence for r in readings] == list(
        range(readings[0].sequence, readings[0].sequence + 200)
    )
    assert made.board.stats.lost == made.board.stats.bad_crc == 0


def test_time_stamps_are_those_of_the_scenario(rig, calibration):
    made = rig(calibration=calibration, scenario=Scenario(load(ScenarioFile, "demo")))
    assert made.board.channel.clocks.clock.uncertainty_s < 0.001
    sliding = [r for r in made.readings(450) if r.trusted and 2.9 < r.time_s < 3.5]
    assert len(sliding) > 50
    # At 85 mm/s, a time error of 1 ms is a position error of 85 um.
    truth = Scenario(load(ScenarioFile, "demo"))
    errors = [r.position_um - 1000 * truth.presses(r.time_s)[0].position_mm for r in sliding]
    assert abs(np.mean(errors)) < 50


def test_averaging_lowers_rate_and_noise_and_moves_nothing(rig, calibration):
    made = rig(calibration=calibration)
    made.press(60.0, 2500.0)
    single = made.readings(200)
    made.board.command("set average=16")
    averaged = made.readings(40)
    steps_us = np.diff([r.t_us for r in averaged])
    assert steps_us.mean() == pytest.approx(16 * 3597 * 2.78, rel=1e-2)
    ratio = np.std([r.position_um for r in averaged]) / np.std([r.position_um for r in single])
    assert ratio < 0.5
    assert np.mean([r.position_um for r in averaged]) == pytest.approx(
        np.mean([r.position_um for r in single]),
        abs=60,  # each has its own dark frame
    )


def test_steady_light_from_outside_is_subtracted(rig, calibration):
    lamp = Ambient(steps=[(0.0, 15.0)])
    made = rig(calibration=calibration)
    made.held.ambient_uW_cm2 = Scenario(ScenarioFile(seconds=10.0, ambient=lamp)).ambient_uW_cm2
    made.board.command("dark")
    assert min(made.board.command("get")["dark"]) > 25 * decode.DARK_SAMPLES
    made.press(42.5, 4000.0)
    readings = made.readings(50)
    assert all(r.trusted and r.flags & decode.DARK_SUBTRACTED for r in readings)
    assert np.mean([r.position_um for r in readings]) == pytest.approx(42_500, abs=150)


def test_a_tare_during_a_dark_sample_waits_for_the_light(rig, calibration):
    made = rig(calibration=calibration)
    made.held.pose = lambda time_s: Pose(leak_share=0.2, leak_mm=30.0)
    made.board.command("set exposure_us=2780")
    made.settle(2.0)
    made.link.write(b"dark\ntare\n")
    made.settle(2.0)
    in_the_window = made.board.command("get")["baseline"]
    made.board.command("tare")
    made.settle(0.5)
    assert in_the_window == pytest.approx(made.board.command("get")["baseline"], rel=0.1)
    assert min(in_the_window) > 50 * decode.DARK_SAMPLES


def lamp(level_uW_cm2):
    steps = [(0.0, level_uW_cm2)]
    return Scenario(ScenarioFile(seconds=1e6, ambient=Ambient(steps=steps))).ambient_uW_cm2


def test_a_faint_lamp_switched_on_is_learned_while_idle_and_not_while_touched(rig, calibration):
    made = rig(calibration=calibration)
    made.press(42.5, 4000.0)
    made.settle()
    made.board.command("dark")
    made.held.ambient_uW_cm2 = lamp(0.2)
    made.board.command("stream touch")
    made.settle(15.0)
    assert max(made.board.command("get")["dark"]) < 0.2 * decode.DARK_SAMPLES
    made.release()
    made.settle(15.0)
    # Two windows of the weight 1/8 have a fourth of the lamp's light; one window has an eighth.
    assert np.mean(made.board.command("get")["dark"]) > 0.2 * decode.DARK_SAMPLES


def test_a_lamp_that_spoils_what_is_touched_is_learned_at_once(rig, calibration):
    made = rig(calibration=calibration)
    made.press(42.5, 4000.0)
    made.settle()
    made.board.command("dark")
    made.settle(2.5)
    made.held.ambient_uW_cm2 = lamp(3.0)
    spoiled = [reading.flags & decode.MISFIT for reading in made.readings(150)]
    assert spoiled[0]
    assert not any(spoiled[-60:])
    assert min(made.board.command("get")["dark"]) > 2 * decode.DARK_SAMPLES


@pytest.mark.parametrize("board", ["virtual", "virtual_circuitpython"])
@pytest.mark.parametrize("polled", [False, True])
def test_steep_light_of_two_fingers_begins_a_touch_after_one_dark_window(
    sensor, calibration, board, polled
):
    places = [(0.001, 0), (0.002, 2000), (0.2, 2000), (0.201, 0)]
    fingers = [Finger(points=[(3.0 + s, x, f) for s, f in places]) for x in (20, 62)]
    light = Ambient(steps=[(0.0, 20.0)])  # else the counts of a reversed FIFO are all 0
    scenario = Scenario(ScenarioFile(seconds=4.0, ambient=light, touch=fingers))
    link = LockstepLink(sensor, scenario, board=board)
    link.chip._quirks = dataclasses.replace(link.chip._quirks, fifo_reversed=polled)
    with Board(link) as there:
        prepare(there, calibration)
        there.command("stream touch")
        frames = there.frames(3.5 - there.now_s())
        seen = [frame for frame in frames if 2.97 < frame.time_s < 3.195]
        assert there.command("get")["fifo"] != polled
    dark = [bool(frame.flags & decode.LED_OFF) for frame in seen]
    first = dark.index(True)
    assert sum(dark) == sum(dark[first : first + 6]) == 6
    # The reading before the window is the first one with light.
    assert [frame.force_mN > 1000 for frame in seen[:first]] == [False] * (first - 1) + [True]
    assert not any(frame.touching for frame in seen[: first + 6])
    assert all(frame.touching for frame in seen[first + 6 :])


def test_the_dark_frame_of_before_is_not_used_after_a_change(rig, calibration):
    made = rig(calibration=calibration)
    lamp = Scenario(ScenarioFile(seconds=1e6, ambient=Ambient(steps=[(0.0, 15.0)])))
    made.held.ambient_uW_cm2 = lamp.ambient_uW_cm2
    made.press(42.5, 4000.0)
    made.board.command("set exposure_us=100000")
    made.settle(2.0)
    made.board.command("stream touch")
    made.board.command("set exposure_us=10000")
    for reading in made.board.frames(0.5):
        if reading.flags & decode.TOUCHING and not reading.flags & decode.LED_OFF:
            assert reading.flags & decode.DARK_SUBTRACTED
            assert reading.position_um == pytest.approx(42_500, abs=600)


def test_dark_frames_are_marked_and_the_touch_continues_after_them(rig, calibration):
    made = rig(calibration=calibration)
    made.press(42.5, 4000.0)
    made.readings(5)
    made.link.write(b"dark\n")
    frames = (frame for frame in made.board.frames(1.0))
    readings = [frame for frame in frames if frame.time_s > 0]
    dark = [reading for reading in readings if reading.flags & decode.LED_OFF]
    assert len(dark) == decode.DARK_SAMPLES + 2  # the LED changes during the first and the last one
    assert not any(reading.touching or reading.trusted for reading in dark)
    lit = [reading for reading in readings if reading not in dark]
    assert lit[-1].time_s > dark[-1].time_s
    assert all(reading.touching and reading.trusted for reading in lit)


def test_a_saturated_reading_says_so(rig, sensor):
    bright = replaced(sensor, led={"irradiance_uW_cm2_per_mA": 100.0})
    made = rig(sensor=bright)
    made.press(5.0, 9000.0)
    assert all(r.flags & decode.SATURATED for r in made.spectra(10))
    assert made.board.command("get")["saturation"] in ("digital", "analog")


def test_a_press_too_light_for_its_place_is_no_touch(rig, sensor, calibration):
    made = rig(calibration=calibration)
    made.press(80.0, sensor.contact.threshold_mN + 20)
    assert not any(r.touching for r in made.readings(50))


def test_the_led_can_be_off(rig, calibration):
    made = rig(calibration=calibration)
    made.press(42.5, 4000.0)
    made.board.command("set led_mA=0")
    for frame in made.spectra(10):
        assert frame.flags & decode.LED_OFF
        assert max(frame.counts) <= 2


@pytest.mark.parametrize("irradiance", [1.0, 4.0, 14.0, 60.0, 400.0])
def test_auto_fills_the_converter_to_60_to_90_percent(rig, sensor, irradiance):
    made = rig(sensor=replaced(sensor, led={"irradiance_uW_cm2_per_mA": irradiance}))
    made.press(2.0, 10_000.0)
    made.board.command("autoexpose", timeout_s=20)
    full_scale = made.board.command("get")["full_scale"]
    peak = max(np.mean([frame.counts for frame in made.spectra(20)], axis=0))
    assert 0.58 < peak / full_scale < 0.92


def test_auto_without_light_changes_nothing_and_says_why(rig):
    made = rig()
    before = made.board.command("get")
    with refusal(BoardError, why="too_dark"):
        made.board.command("autoexpose", timeout_s=60)
    after = made.board.command("get")
    for name in ("gain", "led_mA", "exposure_us"):
        assert after[name] == before[name]
