"""Spectra that a calibration predicts agree with one press, but not with two presses."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from spots.calibrate.fit.expect import expected
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.frames import Spectrum, Touch
from spots_device.board.settings import checksum
from spots_device.reading.decode import DARK_SAMPLES, LED_OFF
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.scenario import Held, Press
from spots_web.expected import expected_shown

SETTLED_S, READ_S = 0.3, 0.2
OFF = 0.03  # limit of the difference, as a share of the brightest channel's count


class Several(Held):
    """A scenario with any number of constant presses."""

    held = ()

    def presses(self, time_s):
        return list(self.held)


@pytest.fixture(scope="module")
def strip(sensor, calibration):
    several = Several()
    with Board(LockstepLink(sensor, several)) as board:
        prepare(board, calibration)
        board.command("stream touch spectrum")
        yield several, board


def departure(strip, calibration, *presses):
    """Return the largest difference between measured and expected counts of a channel.

    The difference is divided by the count of the brightest channel. `presses` are pairs of position
    in mm and force in mN, which act at the same time.
    """
    several, board = strip
    several.held = [Press(place_mm, force_mN, 4.0) for place_mm, force_mN in presses]
    for _ in board.frames(SETTLED_S):
        pass
    frames = [frame for frame in board.frames(READ_S) if not frame.flags & LED_OFF]
    counts = np.mean([frame.counts for frame in frames if isinstance(frame, Spectrum)], axis=0)
    counts -= np.array(board.command("get")["dark"]) / DARK_SAMPLES
    touches = [frame for frame in frames if isinstance(frame, Touch)]
    position_um = np.mean([touch.position_um for touch in touches])
    brightness = np.mean([touch.brightness for touch in touches])
    places_um, logs = expected(calibration)
    wanted = [2 ** (np.interp(position_um, places_um, log) + brightness) for log in logs.T]
    return np.abs(counts - wanted).max() / counts.max()


@pytest.mark.parametrize("place_mm", [3.0, 20.0, 42.5, 60.0, 80.0])
@pytest.mark.parametrize("force_mN", [1500, 8000])
def test_one_press_is_as_expected(strip, calibration, place_mm, force_mN):
    assert departure(strip, calibration, (place_mm, force_mN)) < OFF


def test_two_presses_are_less_so(strip, calibration):
    presses = (5.0, 8000), (60.0, 8000)
    alone = max(departure(strip, calibration, press) for press in presses)
    assert departure(strip, calibration, *presses) > 2 * alone


def test_lines_that_are_no_calibration_expect_nothing():
    board = SimpleNamespace(calibration=["nonsense 1"])
    info = {"calibration": checksum(board.calibration)}
    assert expected_shown(board, info, [0] * 6) is None
