"""Strips whose colour depends on the force: positions are as good as those of an ideal strip."""

from unittest.mock import Mock

import msgspec
import numpy as np
import pytest
from support.press_model import ALONG, OFF_CENTRE, PRESSED, Strip, has_cross

from evidence.effects import errors, with_keys
from spots.calibrate.fit.decoded import Decoded
from spots.calibrate.fit.fit import fit
from spots.calibrate.fit.presses import FIRM_MN, FORCE_PLACES, FULL_MN, Noise, Presses
from spots.link.replies import validated
from spots_device.fingers.tracker import ContactTracker
from spots_device.keys.layout import default_lines, parse
from spots_device.reading.calibration import Calibration
from spots_device.reading.decode import FOUND, MISFIT, MISFIT_Q12, TOLERANCE_Q12, TOO_DARK
from spots_device.reading.rescale import rescale
from spots_sim.measure.rig import Rig

FORCES_MN = 600.0, 1100.0, 2700.0, 9000.0


# Half effects of equal and of opposite signs, and others than those with which the fit was tuned.
COLOURED = [
    {"gap_percent": -11.0},
    {"mode_percent": 4.5},
    {"gap_percent": -4.0, "mode_percent": 3.0},
]


@pytest.mark.parametrize("contact", COLOURED)
def test_a_colour_that_depends_on_the_force_does_not_move_the_position(contact):
    strip = Strip(seed=4, **contact)
    lines = strip.lines()
    assert has_cross(lines)
    found = [strip.errors_mm(lines, force_mN) for force_mN in FORCES_MN]
    assert np.mean([mean for mean, _ in found]) <= 0.03
    assert max(worst for _, worst in found) <= 0.12


def test_without_the_correction_the_error_is_large():
    strip = Strip(gap_percent=10.0)
    plain = [
        " ".join(line.split()[: 4 if line[0] == "f" else 5]) if line[:2] in ("f ", "x ") else line
        for line in strip.lines()
    ]
    mean, _ = strip.errors_mm(plain, 1000.0)
    assert mean > 0.4


def test_a_strong_effect_is_corrected_too():
    strip = Strip(seed=2, gap_percent=30.0)
    lines = strip.lines()
    assert np.mean([strip.errors_mm(lines, f)[0] for f in FORCES_MN]) <= 0.05


@pytest.mark.board
@pytest.mark.parametrize("contact", [{"gap_percent": -9.0}])
def test_at_10_ms_the_noise_is_that_of_an_ideal_strip(contact):
    def mean_mm(**contact):
        strip = Strip(exposure_us=10_000, seed=8, **contact)
        lines = strip.lines()
        return [strip.errors_mm(lines, force_mN, readings=20)[0] for force_mN in FORCES_MN]

    assert np.mean(mean_mm(**contact)) <= 1.25 * np.mean(mean_mm())


@pytest.mark.parametrize(
    ("name", "exposure_us"), [("default", 10_000), ("long_200mm", 60_000), ("weak_dye", 10_000)]
)
def test_an_ideal_strip_gets_no_correction(name, exposure_us):
    for seed in range(3):
        assert not has_cross(Strip(name, exposure_us, seed).lines())


@pytest.mark.board
def test_a_correction_below_20_um_is_not_written():
    strip = Strip(seed=1, gap_percent=0.08)
    assert not has_cross(strip.lines())
    assert has_cross(Strip(seed=1, gap_percent=1.5).lines())


@pytest.mark.board
def test_positions_that_a_person_misses_do_not_look_like_a_colour():
    # The errors of the presses are much larger than the noise, and each has its own.
    for seed in range(4):
        assert not has_cross(Strip(exposure_us=60_000, seed=seed).lines(slip_um=300.0))
    strip = Strip(seed=3, gap_percent=10.0)
    lines = strip.lines(slip_um=300.0)
    assert has_cross(lines)
    assert strip.errors_mm(lines, 1000.0)[1] < 0.35


def test_the_expected_misfit_follows_the_force():
    strip = Strip(seed=6, mode_percent=-5.0)
    decode = Decoded()
    decode.calibration = Calibration(strip.lines())
    for force_mN in FORCES_MN:
        misfits = []
        for share in OFF_CENTRE:
            decode.update_mean(strip.counts(share * strip.length_um, force_mN, 8))
            misfits.append(decode.state[MISFIT_Q12])
        assert abs(np.mean(misfits)) < decode.state[TOLERANCE_Q12] / 4


def test_the_share_of_a_force_below_all_touches_is_that_of_the_weakest_touch():
    lines = Strip(seed=5, gap_percent=10.0).lines()
    end_mN = next(int(line.split()[2]) for line in lines if line.startswith("touch "))
    knots = [tuple(map(int, line.split()[1:])) for line in lines if line.startswith("f ")]
    weak = [share for _, force_mN, _, share in knots if force_mN < end_mN]
    assert len(weak) > 1
    assert len(set(weak)) == 1
    firm = min(knots, key=lambda knot: abs(knot[1] - FIRM_MN))
    assert abs(firm[3]) < 100 < max(abs(knot[3]) for knot in knots)


@pytest.mark.parametrize("contact", [{"mode_percent": -6.0}, {"gap_percent": 30.0}])
def test_positions_at_the_ends_are_right_and_those_beyond_untrusted(contact):
    strip = Strip(seed=9, **contact)
    end_um = strip.length_um
    decode = Decoded()
    decode.calibration = Calibration(strip.lines())
    for force_mN in FORCES_MN:
        for place_um in (0, 300, 1000, end_um - 1000, end_um - 300, end_um):
            decode.update_mean(strip.bound.counts(place_um, force_mN))
            assert 0 <= decode.position_um <= end_um
            assert abs(decode.position_um - place_um) < 120
            assert not decode.flags & TOO_DARK
        for far_um in (-5000, -2000, end_um + 2000, end_um + 8000):
            decode.update_mean(strip.bound.counts(far_um, force_mN))
            assert decode.flags & (TOO_DARK | MISFIT)
            assert decode.position_um in (0, end_um)


def test_a_stretched_strip_has_the_correction_too():
    strip = Strip(seed=7, mode_percent=5.0)
    along = strip.presses(np.linspace(0, strip.length_um, 33), [FIRM_MN], ALONG)
    places_um = np.array(FORCE_PLACES) * strip.length_um
    pressed = strip.presses(places_um, np.geomspace(strip.least_mN(), FULL_MN, 30), PRESSED)
    longer = Presses(1.1 * along.position_um, *list(vars(along).values())[1:])
    noise = Noise.of(along, pressed)
    lines = fit({0: along, 100_000: longer}, pressed, noise, strip.conditions)
    decode = Decoded()
    decode.calibration = Calibration(lines, 100_000)
    for share in OFF_CENTRE:
        decode.update_mean(strip.counts(share * strip.length_um, 1000.0, 8))
        assert decode.position_um == pytest.approx(1.1 * share * strip.length_um, abs=150)


@pytest.mark.board
@pytest.mark.parametrize("keys", [{"gap_percent": -7.0, "mode_percent": 3.0}])
def test_the_firmware_corrects_a_coloured_strip(sensor, keys):
    coloured = with_keys(sensor, {f"contact.{key}": value for key, value in keys.items()})
    with Rig(coloured, 5, 100_000, 1) as rig:
        assert has_cross(rig.lines)
        rows = errors(rig, (0.6, 2.0, 9.0), readings=2, places=OFF_CENTRE)
        assert np.mean([row.error_mm for row in rows]) <= 0.03
        assert max(row.worst_error_mm for row in rows) <= 0.12
        assert not any(row.untrusted_percent or row.missing_percent for row in rows)


def second_finger_um(strip, lines, at_mm, force_mN, to_mm, to_mN):
    """Return where a second finger is found at `to_mm` while the first one rests at `at_mm`."""
    decode = Decoded()
    decode.calibration = made = Calibration(lines)
    fingers = Mock(**{"second.return_value": True, "at.return_value": False})
    tracker = ContactTracker(fingers)
    tracker.set_layout(parse(default_lines()), made.length_um, made.decay, made.cross)
    alone = strip.bound.counts(1000 * at_mm, force_mN)
    rising = [np.zeros(6)] + [strip.bound.counts(1000 * to_mm, s * to_mN) for s in (0.5, 0.8, 1, 1)]
    for t in range(0, 100, 10):  # a new tracker ignores a finger that touches already
        tracker.take(TOO_DARK, 0, 0, 0, t)
    for number, second in enumerate([0, 0, 0, 0, *rising]):
        decode.update_mean(alone + second)
        what = decode.flags, decode.position_um, decode.force_mN, decode.brightness
        tracker.take(*what, 100 + 10 * number)
    assert fingers.down.called
    return fingers.moved.call_args[0][0] if fingers.moved.called else fingers.second.call_args[0][0]


@pytest.mark.parametrize(
    ("contact", "at_mm"), [({"gap_percent": 12.0}, (25, 65)), ({"mode_percent": 6.0}, (60, 20))]
)
def test_each_of_two_fingers_has_the_colour_of_its_own_force(contact, at_mm):
    strip, ideal = Strip(seed=4, **contact), Strip(seed=4)
    one_mm, other_mm = at_mm
    found, wanted = (
        second_finger_um(one, one.lines(), one_mm, 2500.0, other_mm, 1800.0)
        for one in (strip, ideal)
    )
    assert found == pytest.approx(wanted, abs=450)


@pytest.mark.parametrize("keys", [{"gap_percent": 12.0}, {"mode_percent": -5.0}])
def test_the_slope_of_the_correction_follows_the_exposure(keys):
    strip = Strip(seed=6, **keys)
    made = Calibration(strip.lines())
    near_um, far_um, brightness = made.cross
    decode = Decoded()
    decode.calibration = made
    for share, slope_um in ((0, near_um), (1, far_um)):
        weak, firm = (
            moved_um(decode, strip.bound.counts(share * strip.length_um, force_mN))
            for force_mN in (600, FULL_MN)
        )
        assert weak - firm == pytest.approx(slope_um, abs=0.25 * max(abs(near_um), abs(far_um)))
    assert brightness == made.brightnesses[-1]
    rescale(made, 50_000)
    assert made.cross == (near_um, far_um, pytest.approx(brightness - (1 << 20), abs=4))
    assert Calibration(Strip(seed=6).lines()).cross is None


def moved_um(decode, counts):
    """Return by how much the cross-sensitivity corrects a position."""
    decode.update_mean(counts)
    return decode.state[FOUND + 3] * decode.state[FOUND + 2] / 4096


def test_a_host_gets_the_cross_sensitivity_from_the_reply_to_hello():
    found = list(Calibration(Strip(seed=6, gap_percent=-9.0).lines()).cross)
    assert validated("hello", {"cross": found})["cross"] == found
    assert validated("hello", {})["cross"] is None
    for wrong in ([1, 2], "abc", [1 << 29, 0, 0]):
        with pytest.raises(msgspec.ValidationError):
            validated("hello", {"cross": wrong})
