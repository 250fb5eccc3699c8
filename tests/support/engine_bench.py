"""Runs the firmware's key engine with switches instead of fingers; a computer gets its keys."""

from spots_device.fingers.state import TICKS
from spots_device.keys.engine import Engine
from spots_device.keys.layout import parse
from spots_device.keys.merge import Merger
from spots_device.usb.reports import KeyboardReports, OneKeyReports
from support.computer import Computer, text_of

LENGTH_UM = 100_000
_START_MS = TICKS * 1024 // 1000 - 300  # the ticks wrap after 300 ms
_TICK_MS = 10  # from one reading to the next


class Keyboard:
    """A keyboard of a board, with its host, and a keyboard of a computer: both get the same."""

    def __init__(self):
        self.computer = Computer()
        self.reports = []
        self.takes = True
        self.merger = Merger()
        self.keys = KeyboardReports(self._send, int)
        self.media = OneKeyReports(lambda report: self.takes, int)

    def _send(self, report):
        if self.takes:
            self.reports.append(bytes(report))
        return self.takes

    def pump(self):
        for each in (self.keys, self.media):
            while self.takes and not each.outbox.pump():
                pass
            each.flush()
            while self.takes and not each.outbox.pump():
                pass

    def text(self):
        """Return what was typed, after a check that board and host agree and no key is down."""
        self.pump()
        assert not self.computer.down
        assert not (self.reports and any(self.reports[-1]))
        on_board = text_of(self.reports)
        assert on_board == "".join(self.computer.typed_on(7)), (self.computer.log, self.reports)
        return self.computer.text


class Bench:
    """The engine of one strip; `keyboard` is that of all strips.

    Attributes
    ----------
    events : list of tuple
        Arguments of each key event.
    """

    def __init__(self, lines, keyboard=None):
        self.keyboard = keyboard or Keyboard()
        self.events = []
        self.engine = Engine(self, self.keyboard.merger)
        self.engine.set_layout(parse(lines), LENGTH_UM)
        self.ms = 0
        self._switches = {}

    def usage(self, page, usage, modifiers, pressed):
        if page == 7:
            self.keyboard.keys.key(usage, modifiers, pressed)
        else:
            self.keyboard.media.key(usage, modifiers, pressed)
        self.keyboard.computer.usage(page, usage, modifiers, pressed)

    def key(self, *event):
        self.events.append(event)
        self.keyboard.keys.flush()
        self.keyboard.media.flush()

    def has_room(self):
        return self.keyboard.keys.outbox.has_room() and self.keyboard.media.outbox.has_room()

    @property
    def ticks(self):
        return (_START_MS + self.ms) * 1000 // 1024 % TICKS

    def at(self, ms):
        """Let the time pass until `ms`, with a reading every 10 ms."""
        while True:
            self.keyboard.pump()
            self.engine.tick(self.ticks)
            if self.ms >= ms:
                return
            self.ms = min(ms, self.ms + _TICK_MS)

    def press(self, name, share, ago_ms=0):
        """Press a switch at a share of the strip, `ago_ms` ago."""
        t = (self.ticks - ago_ms * 1000 // 1024) % TICKS
        self._switches[name] = self.engine.press(round(LENGTH_UM * share), t)
        self.engine.run()

    def release(self, name):
        self.engine.release_one(self._switches.pop(name), self.ticks)
        self.engine.run()

    def tap(self, name, share, ms=60):
        self.press(name, share)
        self.at(self.ms + ms)
        self.release(name)

    def move(self, name, share):
        is_done = self.engine.move(self._switches[name], round(LENGTH_UM * share), self.ticks)
        self.engine.run()
        return is_done

    def firm(self, name):
        self.engine.firm(self._switches[name], self.ticks)
        self.engine.run()
