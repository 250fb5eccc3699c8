"""The standard deviation of a position agrees with the errors of the positions at every force."""

from math import isnan

import numpy as np
import pytest

from spots.calibrate.fit.decoded import Decoded
from spots.common.certainty import Certainty
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.frames import Touch, with_sigma
from spots_device.reading.calibration import Calibration
from spots_sim.board.lockstep import LockstepLink
from spots_sim.measure.bound import Bound
from spots_sim.strip.scenario import Held
from spots_web.one_strip import OneStrip

PLAN = "F3", "F4", "F5", "F6", "F7", "F8"
READ_NOISE = 0.18  # counts


@pytest.mark.board
def test_each_strip_has_the_sigma_of_its_own_calibration(sensor, calibration):
    with Board(LockstepLink(sensor, Held())) as board:
        touch = Touch(1, 1, 5000, 9, 0, 8 << 20, 42_000, 1500)
        OneStrip(board, 1).learn(calibration, {"average": 4})
        assert list(board.channel.certainties) == [1]
        expected_um = Certainty.of(calibration, 4).sigma_of(42_000, 8.0)
        assert with_sigma(touch, board.channel.certainties).sigma_um == round(expected_um, 1)
        assert isnan(with_sigma(touch._replace(sensor=0), board.channel.certainties).sigma_um)
        prepare(board, calibration)
        assert sorted(board.channel.certainties) == [0, 1]


@pytest.mark.parametrize("force_mN", [500.0, 1000.0, 3000.0, 9000.0])
def test_errors_are_as_large_as_their_sigma(sensor, calibration, force_mN):
    rng = np.random.default_rng(round(force_mN))
    light, certainty = Bound(sensor, PLAN, 9, 10_000, 20), Certainty.of(calibration)
    decode = Decoded()
    decode.calibration = Calibration(calibration)
    off = []
    for place_um in rng.uniform(4000, 81_000, 400):
        expected = light.counts(place_um, force_mN)
        counts = expected + np.sqrt(READ_NOISE**2 + 1.8e-5 * expected) * rng.normal(size=6)
        decode.update(counts.round().astype(int).tolist(), 1, [0] * 6, 0)
        sigma_um = certainty.sigma_of(decode.position_um, decode.brightness / (1 << 20))
        assert sigma_um == pytest.approx(
            float(certainty.sigma_um(decode.position_um, decode.brightness / (1 << 20)))
        )
        off.append((decode.position_um - place_um) / sigma_um)
    assert 0.8 < np.median(np.abs(off)) / 0.6745 < 1.25
