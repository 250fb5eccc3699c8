"""Decoding of readings: exact dot products and tables, within 31 bits; no wrong position."""

import itertools
from fractions import Fraction

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from support.smallint import SmallInt, small

from spots.calibrate.fit.decoded import Decoded, segments_of
from spots_device.reading import decode, kernel
from spots_device.reading.calibration import Calibration
from spots_device.reading.calibration_lines import ONE_Q13, WEIGHT_SUM_MAX
from spots_device.reading.log2 import ONE

LOG_MAX = 24 * ONE
logs = st.lists(st.integers(0, LOG_MAX), min_size=6, max_size=6)


@st.composite
def weights(draw):
    values = draw(st.lists(st.integers(-WEIGHT_SUM_MAX, WEIGHT_SUM_MAX), min_size=6, max_size=6))
    total = max(1, sum(abs(v) for v in values))
    return [v * WEIGHT_SUM_MAX // total if total > WEIGHT_SUM_MAX else v for v in values]


def dots(rows, values):
    state = small([0] * decode.LOGS + values + [0] * decode.STATE_SIZE)
    kernel._dots(small([weight for row in rows for weight in row]), 0, state)
    return state[decode.FOUND : decode.FOUND + len(rows)]


@given(weights(), weights(), logs)
def test_dots_are_the_exact_sums_rounded_down(first, second, values):
    rows = first, second
    assume(max(sum(map(abs, row)) for row in rows) <= WEIGHT_SUM_MAX)
    for row, result in zip(rows, dots(rows, values)):
        exact = Fraction(sum(a * b for a, b in zip(row, values)), ONE_Q13)
        assert exact - 1 < result <= exact


def test_dots_at_the_largest_weights_and_logs_stay_inside_31_bits():
    for signs in itertools.product((1, -1), repeat=2):
        w = [signs[0] * WEIGHT_SUM_MAX // 2, signs[1] * WEIGHT_SUM_MAX // 2, 0, 0, 0, 0]
        dots([w, w[::-1]], [LOG_MAX] * 6)


@st.composite
def tables(draw):
    count = draw(st.integers(2, 20))
    steps = draw(st.lists(st.integers(1, 1 << 17), min_size=count - 1, max_size=count - 1))
    rises = draw(st.lists(st.integers(1, 8000), min_size=count - 1, max_size=count - 1))
    direction = draw(st.sampled_from((1, -1)))
    start = draw(st.integers(-(1 << 24), 1 << 24))
    knots = [start + s for s in itertools.accumulate([0, *steps])]
    values = [direction * r for r in itertools.accumulate([0, *rises])]
    return knots, values


def looked_up(knots, values, at):
    state = [None] * decode.STATE_SIZE
    kernel.look_up([0, 0, 0, SmallInt(len(knots)), *knots, *values], 3, at, state, 1)
    return state[decode.FOUND]


@given(tables(), st.integers(-(1 << 25), 1 << 25))
def test_interpolation_is_the_exact_line_rounded(table, at):
    knots, values = table
    result = looked_up(small(knots), small(values), SmallInt(at))
    clamped = min(max(at, knots[0]), knots[-1])
    j = max(k for k in range(len(knots) - 1) if knots[k] <= clamped)
    width = knots[j + 1] - knots[j]
    exact = values[j] + Fraction((clamped - knots[j]) * (values[j + 1] - values[j]), width)
    assert abs(result - exact) <= Fraction(1, 2)


@given(tables())
def test_knots_give_their_own_values(table):
    knots, values = table
    for knot, value in zip(knots, values):
        assert looked_up(knots, values, knot) == value


@pytest.fixture
def decoder(calibration):
    made = Decoded()
    made.calibration = Calibration(calibration)
    return made


NO_DARK = [0] * 6
LIT = [570, 580, 750, 920, 1200, 640]  # a press of the default sensor near 12 mm


def test_a_lit_spectrum_is_a_trusted_touch(decoder):
    decoder.update(LIT, 1, NO_DARK, decode.DARK_SUBTRACTED)
    assert decoder.flags == decode.TOUCHING | decode.DARK_SUBTRACTED
    assert 10_000 < decoder.position_um < 14_000
    assert 2_000 < decoder.force_mN < 3_000


@given(st.integers(1, 64))
def test_averaging_changes_nothing_but_the_noise(calibration, samples):
    one, many = Decoded(), Decoded()
    one.calibration = many.calibration = Calibration(calibration)
    one.update(LIT, 1, NO_DARK, 0)
    many.update([samples * count for count in LIT], samples, NO_DARK, 0)
    assert abs(one.position_um - many.position_um) <= 1
    assert abs(one.force_mN - many.force_mN) <= 1


@given(
    st.lists(st.integers(0, 65_535), min_size=6, max_size=6),
    st.lists(st.integers(0, 4 * 65_535), min_size=6, max_size=6),
    st.integers(1, 64),
)
def test_any_counts_give_a_position_on_the_strip_or_a_flag(calibration, counts, dark, samples):
    made = Decoded()
    made.calibration = Calibration(calibration)
    made.update(small(samples * c for c in counts), samples, small(dark), 0)
    assert 0 <= made.position_um <= 85_000
    assert 0 <= made.force_mN <= 10_000
    if any(4 * c <= d for c, d in zip(counts, dark)):
        assert made.flags & decode.TOO_DARK
        assert not made.flags & decode.TOUCHING
        assert made.position_um == made.force_mN == 0


@pytest.mark.parametrize("channel", range(6))
def test_one_channel_no_brighter_than_its_dark_ends_the_touch(decoder, channel):
    decoder.update(LIT, 1, NO_DARK, 0)
    dark = [4 * LIT[i] if i == channel else 0 for i in range(6)]
    decoder.update(LIT, 1, dark, 0)
    assert decoder.flags == decode.TOO_DARK


def shifted(made, misfit):
    """Shift the misfits that a calibration expects, so that `LIT` has the misfit `misfit` (Q12)."""
    for segment in segments_of(made.calibration):
        for i in range(len(segment.fits)):
            segment.fits[i] -= misfit


FLAWED = decode.TOUCHING | decode.MISFIT
KEY = FLAWED | decode.TOO_DARK


@pytest.mark.parametrize("sign", [1, -1])
def test_a_misfit_that_every_press_has_is_untrusted_but_good_for_a_key(decoder, sign):
    shifted(decoder, 100 * sign)
    for _ in range(3):
        seen = []
        for _ in range(8):
            decoder.update(LIT, 1, NO_DARK, 0)
            seen.append(decoder.flags)
        decoder.update(NO_DARK, 1, NO_DARK, 0)
    assert seen == [KEY] * 8


FAR = [251, 260, 381, 698, 1382, 881]  # a press elsewhere


def touches_of_two(made, times):
    """Repeat a touch whose light moves, with one misfit until then; return the flags before."""
    before = []
    for _ in range(times):
        shifted(made, 100)
        for _ in range(5):
            made.update(LIT, 1, NO_DARK, 0)
            before.append(made.flags)
        shifted(made, -100)
        for _ in range(3):
            made.update(FAR, 1, NO_DARK, 0)  # one finger has lifted
        made.update(NO_DARK, 1, NO_DARK, 0)
    return before


def test_two_fingers_that_lift_one_after_the_other_teach_no_drift(decoder):
    assert touches_of_two(decoder, 4) == [FLAWED] * 20


def test_a_touch_of_two_fingers_undoes_the_drift_that_another_one_seemed_to_confirm(decoder):
    state = decoder.state
    state[decode.SEEN] = 100  # as if two fingers had touched and lifted exactly together
    touches_of_two(decoder, 1)
    assert state[decode.DRIFT] == 0
    assert decoder.flags & decode.MISFIT == 0
    assert touches_of_two(decoder, 1) == [FLAWED] * 5


def touch_of_one(made):
    """Touch and lift; return the flags of the last reading of the touch."""
    for _ in range(6):
        made.update(LIT, 1, NO_DARK, 0)
    seen = made.flags
    made.update(NO_DARK, 1, NO_DARK, 0)
    return seen


@pytest.mark.parametrize("known", [True, False])
def test_a_misfit_below_the_tolerance_is_doubtful_if_recent_touches_had_less(decoder, known):
    decoder.update(LIT, 1, NO_DARK, 0)
    excess = decoder.state[decode.TOLERANCE_Q12] * 2 // 3
    for _ in range(8 if known else 0):
        touch_of_one(decoder)
    shifted(decoder, excess)
    seen = [touch_of_one(decoder) for _ in range(8)]
    assert seen[0] == (FLAWED if known else decode.TOUCHING)
    assert seen[-1] == decode.TOUCHING
    assert abs(decoder.state[decode.OFF_Q12]) < excess // 2


def test_a_misfit_that_begins_within_a_touch_of_one_finger_is_in_doubt_only_if_it_moves(decoder):
    for _ in range(8):
        touch_of_one(decoder)
    for _ in range(3):
        decoder.update(LIT, 1, NO_DARK, 0)
    shifted(decoder, decoder.state[decode.TOLERANCE_Q12] * 2 // 3)
    decoder.update(LIT, 1, NO_DARK, 0)
    assert decoder.flags == decode.TOUCHING
    decoder.update(FAR, 1, NO_DARK, 0)
    assert decoder.flags == FLAWED
    assert abs(decoder.state[decode.MISFIT_Q12]) <= decoder.state[decode.TOLERANCE_Q12]


FAINT = [count * 8 // 100 for count in LIT]  # a touch that is too noisy to measure a drift


def test_a_faint_reading_does_not_change_the_drift(decoder):
    shifted(decoder, 70)
    for _ in range(2):
        for _ in range(8):
            decoder.update(LIT, 1, NO_DARK, 0)
        decoder.update(NO_DARK, 1, NO_DARK, 0)
    shifted(decoder, 60)  # as much as the noise of a faint reading
    for _ in range(8):
        decoder.update(FAINT, 1, NO_DARK, 0)
        assert decoder.flags == decode.TOUCHING
    shifted(decoder, -60)
    for _ in range(8):
        decoder.update(LIT, 1, NO_DARK, 0)
        assert decoder.flags == KEY


def test_a_touch_that_begins_faintly_shows_its_drift_later(decoder):
    for _ in range(2):
        for _ in range(8):
            decoder.update(FAINT, 1, NO_DARK, 0)
        shifted(decoder, 70)
        for _ in range(3):
            decoder.update(LIT, 1, NO_DARK, 0)
        seen = decoder.flags
        shifted(decoder, -70)
        decoder.update(NO_DARK, 1, NO_DARK, 0)
    assert seen == KEY


def test_a_misfit_that_begins_within_a_touch_is_good_for_nothing(decoder):
    for _ in range(8):
        decoder.update(LIT, 1, NO_DARK, 0)
    assert decoder.flags == decode.TOUCHING
    shifted(decoder, 100)
    for _ in range(200):
        decoder.update(LIT, 1, NO_DARK, 0)
        assert decoder.flags == FLAWED


def test_a_misfit_too_large_for_a_drift_is_good_for_nothing(decoder):
    shifted(decoder, decoder.calibration.drift_max + 100)
    for _ in range(50):
        decoder.update(LIT, 1, NO_DARK, 0)
        assert decoder.flags == FLAWED
        decoder.update(NO_DARK, 1, NO_DARK, 0)


WEAK = [count * 35 // 100 for count in LIT]


def test_light_that_fits_no_press_begins_a_touch_at_four_times_the_force(decoder):
    begin = decoder.calibration.touch_on_mN
    decoder.state[decode.AGE_STEP_US] = 10_000  # a board that switches its LED
    shifted(decoder, 1000)
    for share in range(1, 101):
        decoder.update([count * share // 100 for count in LIT], 1, NO_DARK, 0)
        assert decoder.flags & decode.TOUCHING == (decoder.force_mN >= 4 * begin)
        decoder.update(NO_DARK, 1, NO_DARK, 0)


def test_light_that_fits_no_press_is_checked_with_a_dark_window_before_it_begins_a_touch(decoder):
    shifted(decoder, 1000)
    state = decoder.state
    state[decode.AGE_STEP_US] = 10_000  # the LED can be switched
    state[decode.LEVEL] = 1  # a reading without a touch, after the dark window
    decoder.update(WEAK, 1, NO_DARK, 0)
    assert (decoder.flags, state[decode.WANTED]) == (decode.MISFIT, 0)
    decoder.update(LIT, 1, NO_DARK, 0)
    assert (decoder.flags, state[decode.WANTED]) == (decode.MISFIT, decode.CHECK)
    state[decode.LEVEL] = state[decode.WANTED] = 0  # after the window
    decoder.update(LIT, 1, NO_DARK, 0)
    assert (decoder.flags, state[decode.WANTED]) == (FLAWED, 0)


def test_light_below_the_dark_ends_a_touch_only_after_a_dark_window(decoder):
    # A lamp that is switched off under a finger; without the rule, the key is typed twice.
    below = [decode.BELOW_COUNTS + 1 + count for count in LIT]
    for led_switches in (0, 10_000):
        state = decoder.state
        state[decode.AGE_STEP_US] = led_switches
        decoder.update(LIT, 1, NO_DARK, 0)
        decoder.update(LIT, 1, [decode.DARK_SAMPLES * one for one in below], 0)
        assert decoder.flags == (FLAWED if led_switches else decode.TOO_DARK)
        assert state[decode.WANTED] == (decode.CHECK if led_switches else 0)
        assert decoder.position_um == decoder.force_mN == 0
    decoder.update(LIT, 1, NO_DARK, 0)  # the window
    assert decoder.flags == decode.TOUCHING
    for flags in (FLAWED, decode.TOO_DARK):  # if it changes nothing, the finger has left
        decoder.update(LIT, 1, [decode.DARK_SAMPLES * one for one in below], 0)
        assert decoder.flags == flags


def test_light_that_fits_a_press_is_not_checked(decoder):
    decoder.state[decode.AGE_STEP_US] = 10_000
    decoder.state[decode.LEVEL] = 1
    decoder.update(LIT, 1, NO_DARK, 0)
    assert (decoder.flags, decoder.state[decode.WANTED]) == (decode.TOUCHING, 0)


def test_light_that_fits_a_press_on_a_drifted_strip_begins_a_touch_at_its_force(decoder):
    begin = decoder.calibration.touch_on_mN
    shifted(decoder, decoder.calibration.drift_max)
    begun = []
    for _ in range(2):
        decoder.update(WEAK, 1, NO_DARK, 0)
        begun.append(decoder.flags)
        assert begin < decoder.force_mN < 4 * begin
        for _ in range(2):
            for _ in range(3):
                decoder.update(LIT, 1, NO_DARK, 0)
            decoder.update(NO_DARK, 1, NO_DARK, 0)
    assert begun == [decode.MISFIT, KEY]


def test_without_a_calibration_nothing_is_claimed():
    made = Decoded()
    made.update(LIT, 1, NO_DARK, 0)
    assert made.flags == decode.NOT_CALIBRATED
    assert made.position_um == made.force_mN == 0


def test_touch_has_hysteresis(decoder, calibration):
    begin, end = decoder.calibration.touch_on_mN, decoder.calibration.touch_off_mN
    seen = []
    shares = list(range(600, 20, -1))  # light in thousandths of that of a firm press
    for share in shares + shares[::-1]:
        decoder.update([count * share // 1000 for count in LIT], 1, NO_DARK, 0)
        seen.append((decoder.force_mN, bool(decoder.flags & decode.TOUCHING)))
    down, up = seen[: len(shares)], seen[len(shares) :]
    assert any(end <= force < begin and touching for force, touching in down)
    assert any(end <= force < begin and not touching for force, touching in up)
    assert all(touching == (force >= end) for force, touching in down)
    assert all(touching == (force >= begin) for force, touching in up)


def test_two_presses_at_once_do_not_fit_one(decoder):
    near, far = [1372, 1392, 1751, 2027, 2449, 1275], [251, 260, 381, 698, 1382, 881]
    for counts in (near, far):
        decoder.update(counts, 1, NO_DARK, 0)
        assert not decoder.flags & decode.MISFIT
    decoder.update([a + b for a, b in zip(near, far)], 1, NO_DARK, 0)
    assert decoder.flags & decode.MISFIT


def test_a_dark_window_neither_begins_nor_ends_a_touch(decoder):
    decoder.update(LIT, 1, NO_DARK, 0)
    decoder.update(NO_DARK, 1, NO_DARK, decode.LED_OFF)
    assert decoder.flags == decode.LED_OFF
    assert decoder.position_um == 0
