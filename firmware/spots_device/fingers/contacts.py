"""Sends CONTACT frames of the fingers of `tracker.ContactTracker`; see docs/extend/protocol.md.

The tracker is not that of the keys: a key decides whether a second finger counts, and the frames
must not depend on the keys. Imported only while contacts are streamed. Integers only; allocates
nothing but in `__init__`.
"""

from ..reading import decode
from .state import LEAVING
from .tracker import ContactTracker

# States of a finger.
DOWN = 0  # first frame of the finger
# The finger is not alone, or has just lifted. Its position is an estimate, or that of the last
# reading in which the finger was alone.
PROVISIONAL = 1
CONFIRMED = 2  # the finger is alone in this reading
UP = 3  # last frame of the finger
NEVER_ALONE = 4  # last frame of a finger whose positions were all estimates


class _Finger:
    """State of a finger; `pending` is True until its first frame is sent."""

    def __init__(self):
        self.there = self.pending = self.alone = False
        self.id = self.x_um = self.sigma_um = 0


class Fingers:
    """Sends a CONTACT frame for each finger and reading; receives the events of its `tracker`.

    The caller sets the tracker's layout, and passes the readings to it before `send`.
    """

    def __init__(self, framer):
        self._framer = framer
        self.tracker = ContactTracker(self)
        self._sensor = self._id = 0
        self._alone = False  # whether the reading is of the first finger alone
        self._first = _Finger()
        self._second = _Finger()

    def send(self, sensor, reading):
        """Send a frame for each finger of a reading that the tracker has already processed.

        `reading` is as `decode.Decode.state`.
        """
        self._sensor = sensor
        tracker = self.tracker
        first = self._first
        alone = self._alone and not (tracker.two or tracker.state[LEAVING])
        self._alone = False
        if alone:
            if not first.there:
                self._begin(first)
            first.alone = True
            first.x_um = reading[decode.POSITION_UM]
            first.sigma_um = tracker.noise_um(reading[decode.BRIGHTNESS])
            self._report(first, CONFIRMED, reading[decode.FORCE_MN])
        elif first.there:
            if tracker.two:
                first.x_um = tracker.x_um
            self._report(first, PROVISIONAL, 0)
        second = self._second
        if second.there:
            self._report(second, PROVISIONAL, 0)
            self.moved(second.x_um, second.sigma_um + 500)  # until it is located again

    def release(self):
        """Send each finger's last frame; a finger that still touches is ignored until it lifts."""
        self._end(self._first)
        self._end(self._second)
        self.tracker.spend()

    # Events of tracker.ContactTracker.

    def down(self, x_um, t):
        self._begin(self._first)
        self._alone = True

    def at(self, x_um, t):
        self._end(self._second)
        self._alone = True

    def firm(self, t):
        pass

    def up(self, t):
        self._alone = False
        self._end(self._first)
        self._end(self._second)

    def next(self, x_um, t):
        second = self._second
        if second.there and abs(x_um - second.x_um) < 2000:  # it was this finger
            self._swap()
        else:
            self._end(second)
            self._end(self._first)
            self._begin(self._first)
        self._first.x_um = x_um  # the reading may be of no finger, or of two
        self._alone = True

    def second(self, x_um, slack_um, t):
        second = self._second
        if not second.there:
            self._begin(second)
        self.moved(x_um, slack_um)
        return True

    def moved(self, x_um, slack_um):
        second = self._second
        second.x_um = x_um
        second.sigma_um = min(slack_um, 0xFFFF)

    def left(self, second, t):
        if second:
            self._end(self._second)
        else:
            self._swap()
            self._alone = not self.tracker.two

    def stuck(self):
        self._end(self._first)
        self._end(self._second)

    # Frames.

    def _begin(self, finger):
        finger.there = finger.pending = True
        finger.alone = False
        finger.sigma_um = 2000  # until it is located: another finger hides the rest of its way
        self._id = finger.id = self._id + 1 & 0xFF

    def _end(self, finger):
        if finger.there and not finger.pending:
            self._report(finger, UP if finger.alone else NEVER_ALONE, 0)
        finger.there = False

    def _swap(self):
        """Send the last frame of the first finger, which has left; the second becomes the first."""
        first = self._first
        self._end(first)
        self._first = self._second
        self._second = first

    def _report(self, finger, state, force_mN):
        if finger.pending:
            finger.pending = False
            state = DOWN
        self._framer.contact(self._sensor, finger.id, state, finger.x_um, finger.sigma_um, force_mN)
