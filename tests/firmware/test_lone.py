"""One finger teaches the drift of the misfit, and two that touch together do not."""

from array import array

import pytest

from spots_device.reading import decode as d
from spots_device.reading import lone
from spots_device.sensor.smux import CHANNELS

TOLERANCE = 40  # Q12
WEIGHTS = array("i", [1000] * (d.WEIGHTS + 4 * CHANNELS))


@pytest.fixture
def state():
    """State after touches of one finger that showed no drift, in the first reading of the next."""
    made = array("i", bytes(4 * d.STATE_SIZE))
    made[d.TOLERANCE_Q12], made[d.DRIFT_MAX] = TOLERANCE, 1000
    made[d.SAMPLES] = made[d.FLOOR_SAMPLES] = made[d.TAKEN] = 1
    made[d.EXPOSURE_US] = 10_000
    made[d.SEEN] = d.NONE
    for i in range(d.SUMS, d.SUMS + CHANNELS):
        made[i] = 10_000  # counts, of which noise is a small part
    return made


def touch(state, off, x_um=20_000):
    """Let a touch of one finger show a misfit of `off`, and end."""
    lone.begin(state)
    state[d.OFF_Q12] = off
    lone.move(state)
    state[d.X_FIRM_UM] = x_um
    state[d.DOUBT] = 0
    lone.learn(state)


@pytest.mark.parametrize(
    ("first", "second", "learned"),
    [(100, 110, True), (100, 145, False), (100, -100, False), (84, 45, False)],
)
def test_two_touches_that_agree_show_a_drift(state, first, second, learned):
    """Fails if the second of two different misfits is taken for a drift of the strip."""
    touch(state, first)
    assert not state[d.DRIFT]
    touch(state, second)
    assert state[d.DRIFT] == (second if learned else 0)


@pytest.mark.parametrize("agrees", [True, False])
def test_a_reading_confirms_the_drift_that_the_last_touch_showed(state, agrees):
    touch(state, 100)
    lone.begin(state)
    state[d.OFF_Q12] = 105 if agrees else 200
    assert lone.confirm(state) == (0 if agrees else 200)


@pytest.mark.parametrize("fallen", [True, False])
def test_a_touch_that_loses_light_where_it_was_is_one_finger(state, fallen):
    """Fails if a lone finger in doubt stays so until it lifts: its key would be lost."""
    lone.begin(state)
    state[d.OFF_Q12], state[d.BEGUN_US], state[d.PEAK] = TOLERANCE, 20_000, 10 << 20
    state[d.BRIGHTNESS] = state[d.PEAK] - (1 << 20 if fallen else 0)
    assert lone.is_doubtful(state, WEIGHTS) is not fallen


def test_what_a_touch_in_doubt_shows_confirms_nothing(state):
    touch(state, 100)
    lone.begin(state)
    state[d.OFF_Q12] = 100
    lone.move(state)
    state[d.X_FIRM_UM] = 20_000
    lone.move(state)  # a second place: of two fingers, one has lifted
    state[d.DOUBT] = 1
    lone.learn(state)
    touch(state, 100)
    assert not state[d.DRIFT]
