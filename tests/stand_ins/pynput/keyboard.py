"""A substitute for `pynput.keyboard`, on a computer that knows only a few special keys."""

from enum import Enum


class Key(Enum):
    enter, shift_l, shift_r, ctrl_l, f5, media_play_pause = range(6)


class Controller:
    """Substitute that stores the pressed keys; to press a key in `refuses` raises an error."""

    made: list = []

    def __init__(self):
        self.history: list = []
        self.down: list = []
        self.refuses: set = set()
        Controller.made.append(self)

    def press(self, key):
        self._take(key, True)
        self.down.append(key)

    def release(self, key):
        self._take(key, False)
        self.down.remove(key)

    def _take(self, key, pressed):
        if (key, pressed) in self.refuses:
            raise RuntimeError("the desktop is locked")
        self.history.append((key, pressed))
