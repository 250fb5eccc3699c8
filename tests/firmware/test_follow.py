"""The baseline follows the untouched strip's light: slowly if it grows, quickly if it falls."""

from spots_device.dark import follow

UP, DOWN = 10, 6
Q = 10  # from counts in Q12 to sums over four samples


def followed(level, start=0, dark=4, readings=1, up=UP, down=DOWN):
    """Return the baseline after some readings with a level of counts.

    The result is in counts of four samples.
    """
    rest, floor = [start << Q] * 6, [0] * 6
    for _ in range(readings):
        follow(rest, floor, [level] * 6, 1, [dark << Q] * 6, Q, up, down)
    assert floor == [dark + ((one + 512) >> Q) for one in rest]
    return rest[0] / 1024


def test_what_grows_is_followed_slowly_and_what_fades_quickly():
    grown = followed(101, readings=100)
    assert 0 < grown < 0.1 * 400
    faded = followed(1, start=400, readings=100)
    assert faded < 0.25 * 400
    assert abs(followed(101, readings=10_000) - 400) < 2


def test_at_once_if_asked():
    assert followed(101, up=0, down=0) == 400
    assert followed(1, start=400, up=0, down=0) == 0


def test_it_is_never_below_the_dark():
    assert followed(0, dark=40, readings=50) == 0
