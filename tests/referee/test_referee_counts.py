"""The firmware's driver and Adafruit's driver read equal counts from one sensor with a press."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from bench.adafruit import driver_on
from support.witnesses import (
    GAIN_1X_OF_64,
    HIGH,
    LOW,
    Labelled,
    board_with,
    named_channels,
    noiseless,
    our_counts,
    silent_chip,
    since_now,
    steady,
    their_counts,
    varied,
)

from spots_sim.chip import converter
from spots_sim.chip.bus import I2CBus, SimulatedClock
from spots_sim.strip.scenario import Press

PRESSES = (
    Press(position_mm=5.0, force_mN=900.0, width_mm=4.0),
    Press(position_mm=42.5, force_mN=3000.0, width_mm=4.0),
    Press(position_mm=80.0, force_mN=9000.0, width_mm=4.0),
)
OTHER_QUIRKS = {
    "auto_zero_at_every_start": False,
    "avalid_clears_on_read": True,
    "aint_needs_sp_ien": False,
    "smux_us": 3000.0,
    "clock_error_percent": 3.0,
}


@pytest.mark.board
@pytest.mark.parametrize("plan", [LOW, HIGH], ids=["F1-F4", "F5-F8"])
@pytest.mark.parametrize(
    ("exposure_us", "gains"), [(2_780, (9,)), (10_000, (4, 7, 10)), (200_000, (5,))]
)
@pytest.mark.parametrize("quirks", [{}, OTHER_QUIRKS], ids=["default quirks", "other quirks"])
def test_without_noise_every_count_is_the_same(sensor, plan, exposure_us, gains, quirks):
    quiet = varied(noiseless(sensor), **quirks)
    ours = our_counts(quiet, plan, exposure_us, gains, PRESSES, samples=2)
    theirs = their_counts(quiet, exposure_us, gains, PRESSES, samples=2)
    for case, diode in itertools.product(ours, plan):
        assert list(ours[case][diode]) == list(theirs[case][diode]), (case, diode)


def test_the_presses_tell_channels_presses_and_gains_apart(sensor):
    # Equal counts would show nothing if most of them were 0 or full scale.
    read = their_counts(noiseless(sensor), 10_000, (4, 7, 10), PRESSES, samples=1)
    counts = [int(c[0]) for reading in read.values() for d, c in reading.items() if d != "NIR"]
    assert sum(10 < count < 3597 for count in counts) > 0.7 * len(counts)
    assert 3597 in counts


@pytest.fixture(scope="module")
def noisy(sensor):
    """Counts of the firmware for two plans of diodes, and of Adafruit's driver, with noise."""
    conditions = {"exposure_us": 10_000, "gains": (8, 9), "presses": PRESSES, "samples": 40}
    ours = {}
    for plan in (LOW, HIGH):
        for case, reading in our_counts(steady(sensor), plan, **conditions).items():
            ours.setdefault(case, {}).update(reading)
    return ours, their_counts(steady(sensor), **conditions)


def test_with_noise_every_mean_is_the_same(noisy):
    ours, theirs = noisy
    for case, reading in ours.items():
        assert set(reading) == set(theirs[case])
        for diode, counts in reading.items():
            peer = theirs[case][diode]
            error = np.hypot(_standard_error(counts), _standard_error(peer))
            assert abs(counts.mean() - peer.mean()) <= max(1.0, 5 * error), (case, diode)


def test_no_ratio_is_left_over_all_counts(noisy):
    ours, theirs = noisy
    ratios = [
        reading[diode].mean() / theirs[case][diode].mean()
        for case, reading in ours.items()
        for diode in reading
        if 500 < reading[diode].mean() < 3597
    ]
    # The noise of the LED is common to all channels of a sample; it leaves about 50 ppm in a case.
    assert len(ratios) > 20
    assert np.mean(ratios) == pytest.approx(1, abs=200e-6)


def _standard_error(counts):
    return counts.std(ddof=1) / np.sqrt(len(counts))


def our_labels(sensor, plan):
    board, _ = board_with(sensor, silent_chip(Labelled(10_000)))
    with board:
        board.command(f"set channels={','.join(plan)} gain={GAIN_1X_OF_64}")
        board.command("stream spectrum")
        return dict(zip(plan, since_now(board, 1, 10_000)[0]))


def their_labels():
    bus = I2CBus(silent_chip(Labelled(10_000)), SimulatedClock())
    with driver_on(bus) as driver:
        driver.atime, driver.astep = 0, 3596
        driver.gain = GAIN_1X_OF_64
        return named_channels(driver)


def label_of(diodes):
    return {diode: Labelled.labels[diode] for diode in diodes}


@pytest.mark.parametrize("plan", [LOW, HIGH, ("DARK", "F8", "F1", "NIR", "CLEAR", "F4")])
def test_our_driver_reads_each_diode_under_its_own_name(sensor, plan):
    assert our_labels(sensor, plan) == label_of(plan)


def test_the_referee_reads_each_diode_under_its_own_name():
    assert their_labels() == label_of(dict.fromkeys(LOW + HIGH))


def swap(monkeypatch, one, other):
    """Exchange the connections of two photodiodes of the simulated chip."""
    pixels = converter.PIXELS_OF
    first, second = pixels[one], pixels[other]
    monkeypatch.setitem(pixels, one, second)
    monkeypatch.setitem(pixels, other, first)


@pytest.mark.parametrize(
    ("one", "other"), list(itertools.combinations(dict.fromkeys(LOW + HIGH), 2))
)
def test_the_referee_notices_any_two_diodes_swapped_in_the_chip(monkeypatch, one, other):
    swap(monkeypatch, one, other)
    assert their_labels() != label_of(dict.fromkeys(LOW + HIGH))


def test_the_witnesses_disagree_when_one_chip_is_wired_wrong(monkeypatch, sensor):
    honest = their_labels()
    swap(monkeypatch, "F5", "F6")
    ours = our_labels(sensor, HIGH)
    assert {diode for diode in HIGH if ours[diode] != honest[diode]} == {"F5", "F6"}
