"""The choice of channels, compared with the Cramér-Rao bound of the simulated sensor."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from support.refusals import refusal

from spots.calibrate.fit.choose import DIODES, choose, passes
from spots.calibrate.fit.presses import FIRM_MN, FULL_MN, Presses
from spots.errors import CalibrationError
from spots_sim.measure.bound import Bound
from spots_sim.person.stage import Stage

USUAL = ("F3", "F4", "F5", "F6", "F7", "F8")
BLUE = ("F1", "F2", "F3", "F4", "F5", "F6")
SETTINGS = {"gain": 9, "exposure_us": 10_000, "led_mA": 20}
FULL_SCALE = 3597


def measure(sensor, present, last_share=1.0):
    """Measure presses along the strip with two channel plans, in two passes.

    Parameters
    ----------
    sensor : SensorFile
        The simulated strip.
    present : tuple of str
        Present plan of the board (six diodes), from which `passes` makes the two plans.
    last_share : float
        Force of the last press of the second pass, as a share of the correct force. The force
        decreases along the pass; the recorded force is always the correct one.

    Returns
    -------
    plans, measured : tuple
        The two channel plans, and the presses of both passes.
    """
    plans = passes(present)
    measured = []
    with Stage(sensor, seed=5) as stage:
        places_um = np.linspace(0, stage.length_um, 9)
        for plan, end in zip(plans, (1.0, last_share)):
            stage.board.command("set channels=" + ",".join(plan))
            stage.reader.set_up()
            parts = [stage.read([2000.0], [FULL_MN], 24)]
            for x_um, share in zip(places_um, np.linspace(1, end, len(places_um))):
                pressed = stage.read([x_um], [FIRM_MN * share], 24)
                parts.append(replace(pressed, force_mN=np.array([FIRM_MN])))
            measured.append(Presses(*map(np.concatenate, zip(*(vars(p).values() for p in parts)))))
    return plans, tuple(measured)


@pytest.fixture(scope="module")
def blue(sensor):
    return measure(sensor, BLUE)


def bound_um(sensor, plan):
    """Return the mean along the strip of the Cramér-Rao bound of positions, in um."""
    bound = Bound(sensor, plan, **SETTINGS)
    places_um = np.linspace(0, 85_000, 15)
    return np.mean([bound.sigma(x, FIRM_MN)[0] for x in places_um])


@pytest.mark.board
def test_the_chosen_plan_is_within_3_percent_of_the_best_one_that_does_not_clip(sensor, blue):
    peak = max(Bound(sensor, ("CLEAR", *USUAL[:5]), **SETTINGS).counts(2000, FULL_MN))
    assert peak > FULL_SCALE  # CLEAR is no candidate here
    found = choose(*blue, FULL_SCALE)
    assert "CLEAR" not in found.plan
    best = min(bound_um(sensor, p) for p in itertools.combinations(DIODES[:8], 6))
    assert bound_um(sensor, found.plan) <= 1.03 * best
    assert found.sigma_um == pytest.approx(bound_um(sensor, found.plan), rel=0.15)
    assert found.present_sigma_um == pytest.approx(bound_um(sensor, BLUE), rel=0.15)
    assert found.present_sigma_um > 1.03 * found.sigma_um


def test_how_hard_the_second_pass_was_pressed_does_not_matter(sensor, blue):
    uneven = choose(*measure(sensor, BLUE, last_share=0.5), FULL_SCALE)
    even = choose(*blue, FULL_SCALE)
    # Two plans may be equally good; then noise decides which one is chosen.
    assert bound_um(sensor, uneven.plan) <= 1.03 * bound_um(sensor, even.plan)
    assert uneven.sigma_um == pytest.approx(even.sigma_um, rel=0.1)


def test_the_present_plan_is_kept_unless_another_is_clearly_better(sensor):
    plans, measured = measure(sensor, USUAL)
    found = choose(plans, measured, FULL_SCALE)
    assert found.plan == USUAL


def test_a_channel_that_clips_or_is_dark_is_not_chosen(blue):
    plans, measured = blue
    assert "F7" in choose(plans, measured, FULL_SCALE).plan
    full_scale = measured[1].counts[:, plans[1].index("F7")].max() / 0.96
    assert "F7" not in choose(plans, measured, full_scale).plan
    with refusal(CalibrationError):
        choose(plans, measured, 500.0)


@pytest.mark.parametrize("present", [USUAL, BLUE, ("F1", "F2", "F3", "F4", "F5", "NIR")])
def test_two_passes_see_every_diode_and_share_three(present):
    first, second = passes(present)
    assert set(first) | set(second) == set(DIODES)
    assert len(set(first) & set(second)) == 3
    assert first == (present if "NIR" not in present else USUAL)
