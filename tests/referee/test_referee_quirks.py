"""Behaviours that the chip's documents leave open: with each, every sample is read one time."""

from __future__ import annotations

import itertools

import pytest
from support.witnesses import (
    GAIN_1X_OF_64,
    LED_OFF,
    Numbered,
    board_with,
    noiseless,
    silent_chip,
    varied,
)

from spots.link.board import Board
from spots.link.frames import Spectrum
from spots_sim.board.lockstep import LockstepLink
from spots_sim.chip.quirks import Quirks
from spots_sim.strip.scenario import Held, Press

BOTH = (True, False)
CORNERS = [
    Quirks(zero, clears, needs, clock_error_percent=error)
    for zero, clears, needs, error in itertools.product(BOTH, BOTH, BOTH, (-3.0, 3.0))
]


def name(quirks):
    return (
        f"zero-{quirks.auto_zero_at_every_start}-clears-{quirks.avalid_clears_on_read}"
        f"-needs-{quirks.aint_needs_sp_ien}-clock{quirks.clock_error_percent:+g}%"
    )


@pytest.mark.board
@pytest.mark.parametrize("exposure_us", [2_780, 10_000])
@pytest.mark.parametrize("quirks", CORNERS, ids=name)
def test_every_sample_becomes_one_frame(sensor, quirks, exposure_us):
    board, link = board_with(sensor, silent_chip(Numbered(), quirks))
    with board:
        board.command(f"set exposure_us={exposure_us} gain={GAIN_1X_OF_64}")
        board.command("stream spectrum")
        frames, samples = [], []
        for frame in board.frames(seconds=0.5 + 220 * exposure_us * 1e-6):
            if isinstance(frame, Spectrum):
                frames.append(frame)
                samples.append(link.chip.samples)
        health = board.command("get")
        assert board.stats.lost == board.stats.bad_crc == 0
    after_dark = 1 + max(i for i, frame in enumerate(frames) if frame.flags & LED_OFF)
    numbers = [frame.counts[0] for frame in frames[after_dark:]]
    assert len(numbers) > 150
    assert {(b - a) % Numbered.around for a, b in itertools.pairwise(numbers)} == {1}
    assert [count - samples[0] for count in samples] == list(range(len(frames)))
    assert (health["missed"], health["faults"], health["dropped"]) == (0, 0, 0)


@pytest.mark.parametrize("exposure_us", [10_000, 100_000])
@pytest.mark.parametrize("error_percent", [-3.0, 0.0, 3.0])
def test_no_light_of_the_led_gets_into_the_dark_counts(sensor, exposure_us, error_percent):
    held = Held()
    held.press = Press(position_mm=10.0, force_mN=9000.0, width_mm=4.0)
    lit_only = varied(noiseless(sensor), dark_counts_512x=0.0, clock_error_percent=error_percent)
    with Board(LockstepLink(lit_only, held)) as board:
        board.command(f"set exposure_us={exposure_us}")
        assert board.command("dark")["dark"] == [0] * 6
