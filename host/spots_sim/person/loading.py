"""Loads and unloads a simulated strip, to measure creep and hysteresis of its silicone.

A load is a press whose force rises, may stay constant for some time, and falls again.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spots.calibrate.fit.silicone import fit_silicone
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.frames import Touch
from spots.link.lines import of_sensor
from spots_device.reading.decode import LED_OFF

from ..board.lockstep import LockstepLink
from ..strip.files import Finger, ScenarioFile, SensorFile
from ..strip.scenario import Scenario

START_S, REST_S = 3.0, 10.0  # time of the first load, and pause after each load
# Loads that calibrate the silicone: position as a share of the length, largest force in mN, and
# durations of loading and hold in s. The first load holds its force for creep.
SESSION = (
    (0.5, 5000.0, 0.1, 60.0),
    (0.3, 9500.0, 1.0, 0.0), (0.3, 9500.0, 4.0, 0.0), (0.3, 9500.0, 12.0, 0.0),
    (0.7, 4500.0, 2.0, 0.0), (0.7, 2000.0, 1.0, 0.0),
)  # fmt: skip


def points(loads) -> list[list[tuple[float, float, float]]]:
    """Return the force over time of each load, as points joined by straight lines.

    Each point is a tuple: time in s, position as a share of the strip's length, force in mN. The
    loads are those of `record`.
    """
    found, at_s = [], START_S
    for share, force_mN, ramp_s, hold_s in loads:
        times_s = at_s + np.cumsum([0.0, ramp_s, hold_s or 1e-3, ramp_s])
        found.append([(t, share, f) for t, f in zip(times_s, (0.0, force_mN, force_mN, 0.0))])
        at_s = times_s[-1] + REST_S
    return found


def record(
    sensor: SensorFile,
    lines: Sequence[str],
    loads: Sequence[tuple[float, float, float, float]],
    seed: int = 0,
    led: str = "",
):
    """Press a simulated strip with a series of loads, and read the strip through the firmware.

    Each load is its position as a share of the length, its largest force in mN, the duration of the
    loading in s, and that of the hold in s. The unloading lasts as long as the loading. `lines` is
    the text of the calibration. `led` has assignments for the command ``set``, such as
    ``led=always``; empty if the LED is on the pin LDR of the AS7341.

    Returned is an array of shape (5, n), with a column for each reading with the LED on: time in s,
    true force in mN, measured force in mN, true position as a share of the length, and measured
    position in um.
    """
    whole = points(loads)
    end_s = whole[-1][-1][0] + REST_S
    fingers = [
        Finger(points=[(t, share * sensor.length_mm, force) for t, share, force in load])
        for load in whole
    ]
    scenario = Scenario(ScenarioFile(seconds=end_s, touch=fingers))
    with Board(LockstepLink(sensor, scenario, seed=seed, warm=True)) as board:
        set_light(board, sensor, led)
        prepare(board, lines)
        board.command("stream touch")
        rows = [
            (frame.time_s, frame.force_mN, frame.position_um)
            for frame in board.frames(end_s - board.now_s())
            if isinstance(frame, Touch) and not frame.flags & LED_OFF
        ]
    time_s, read_mN, read_um = np.nan_to_num(np.array(rows, float).T)
    force_mN, place = loaded(loads, time_s)
    return np.array([time_s, force_mN, read_mN, place, read_um])


def silicone_lines(sensor: SensorFile, lines: Sequence[str], led: str = "") -> tuple[str, ...]:
    """Measure hysteresis and creep of a simulated strip, so that the board can compensate them.

    `lines` is a calibration that compensates neither effect; the table ``[change]`` is ignored.
    Returned is the calibration line ``silicone``; nothing if the silicone is ideal or the fit finds
    no effect.
    """
    if sensor.silicone.ideal:
        return ()
    line = fit_silicone(*record(sensor.unchanged(), lines, SESSION, led=led)[:4]).line
    return (line,) if line else ()


def set_light(board: Board, sensor: SensorFile, led: str, number: int = 0) -> None:
    """Send the mains frequency of flickering lamps and the LED settings of `record` to a board."""
    if sensor.mains_hz:
        board.command(of_sensor(f"set mains_hz={sensor.mains_hz}", number))
    if led:
        board.command(of_sensor("set " + led, number))


def loaded(
    loads: Sequence[tuple[float, float, float, float]], time_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return true force in mN and position (share of the length) of loads of `record` at times."""
    whole = np.array(points(loads))
    force_mN = np.interp(time_s, whole[:, :, 0].ravel(), whole[:, :, 2].ravel())
    last = np.searchsorted(whole[:, 0, 0], time_s, side="right") - 1
    return force_mN, whole[last.clip(0), 0, 1]
