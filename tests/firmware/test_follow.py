"""The baseline follows the light of the untouched strip: slowly up, quickly down."""

from spots_device.reading.decode import (
    DARK,
    FLOOR,
    FOLLOWS,
    IDLE_US,
    REST,
    SAMPLES,
    SETTLED_US,
    SHIFT,
    SUMS,
    Decode,
)
from spots_device.reading.kernel import _follow

Q = 10  # from counts in Q12 to sums over four samples


def followed(level, start=0, dark=4, readings=1, at_once=False):
    """Return the baseline after some readings with the same light.

    All light is a sum of counts over four samples, equal in all channels.

    Parameters
    ----------
    level : int
        Light of the readings.
    start : int
        Baseline before the readings.
    dark : int
        Dark frame.
    readings : int
        Number of readings.
    at_once : bool
        Whether each reading becomes the baseline immediately.
    """
    state = Decode().state
    state[SAMPLES], state[SHIFT], state[IDLE_US] = 1, Q, SETTLED_US
    for i in range(6):
        state[REST + i], state[DARK + i], state[SUMS + i] = start << Q, dark << Q, level
    for _ in range(readings):
        state[FOLLOWS] = 2 if at_once else 1
        _follow(state)
    for i in range(6):
        assert state[FLOOR + i] == dark + ((state[REST + i] + 512) >> Q)
    return state[REST] / 1024


def test_what_grows_is_followed_slowly_and_what_fades_quickly():
    grown = followed(101, readings=100)
    assert 0 < grown < 0.1 * 400
    faded = followed(1, start=400, readings=100)
    assert faded < 0.25 * 400
    assert abs(followed(101, readings=10_000) - 400) < 2


def test_at_once_if_asked():
    assert followed(101, at_once=True) == 400
    assert followed(1, start=400, at_once=True) == 0


def test_it_is_never_below_the_dark():
    assert followed(0, dark=40, readings=50) == 0
