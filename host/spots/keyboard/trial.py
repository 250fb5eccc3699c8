"""Plays fingers on the key engine, to show when a key is a tap and when it is a hold."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from spots_device.keys.engine import Engine
from spots_device.keys.layout import BEHAVIOUR, HOLD_TAP, action, parse
from spots_device.keys.merge import Merger
from spots_device.usb.usages import KEYBOARD

TERM_MS = 200
_LENGTH_UM = 100_000
_BETWEEN_MS = 1000  # after a finger has lifted, everything is decided
_WHAT = {4: "tap", 5: "hold", 6: "other"}  # what a key does, by the usage that stands for it


class Span(NamedTuple):
    """Time in which a key of the computer is pressed."""

    what: str
    begin_ms: int
    end_ms: int


class Touch(NamedTuple):
    """A finger on the strip; `place` and `slide` are shares of the strip's length.

    From `firm_ms` on, it presses firmly. It slides during the whole touch.
    """

    place: float
    begin_ms: int
    end_ms: int
    firm_ms: int | None = None
    slide: float = 0.0


# Gestures: shares of the tapping term in which each finger is down, the key's own finger first.
GESTURES = {
    "tap": ((0, 0.5),),
    "held": ((0, 1.6),),
    "nested": ((0, 0.9), (0.3, 0.6)),
    "rolled": ((0, 0.6), (0.3, 0.9)),
    "later": ((0, 1.9), (1.3, 1.6)),
}
WORDS = {
    "tap": "a short touch",
    "held": "a long touch",
    "nested": "another finger lifts first",
    "rolled": "another finger lifts later",
    "later": "another finger after the term",
}


def play(flavor: int, gesture: str) -> list[Span]:
    """Play a gesture on the engine, on a key and, with a second finger, on a plain key beside it.

    `flavor` is an index in `layout.FLAVORS`, plus `spots_device.keys.layout.RETRO_TAP`. Returned is
    what the computer gets ("tap", "hold" or "other"), in the order of the presses.
    """
    tap, hold, other = (action(KEYBOARD, usage) for usage in _WHAT)
    lines = [
        f"behaviour 0 {HOLD_TAP} {flavor} {TERM_MS} 0 0 {hold}",
        "layer 0 0",
        f"key 0 500 {tap} 0 {action(BEHAVIOUR, 0)} 0 0 0",
        f"key 500 1000 {other} 0 0 0 0 0",
    ]
    touches = [
        Touch(0.25 + 0.5 * i, *(round(TERM_MS * share) for share in shares))
        for i, shares in enumerate(GESTURES[gesture])
    ]
    return played(lines, touches, _BETWEEN_MS, lambda page, usage, modifiers: _WHAT[usage])


def played(
    lines: Sequence[str],
    touches: Sequence[Touch],
    after_ms: int,
    named: Callable[[int, int, int], str],
) -> list[Span]:
    """Play touches on a layout; return what the computer gets, in the order of the presses.

    Within `after_ms` after the last finger, everything must be decided. ``named(page, usage,
    modifiers)`` returns the text for a pressed key.
    """
    sink = _Sink(named)
    engine = Engine(sink, Merger())
    engine.set_layout(parse(lines), _LENGTH_UM)
    switches = {}
    for ms in range(max(one.end_ms for one in touches) + after_ms):
        sink.ms = ms
        t = ms * 1000 // 1024
        for i, one in enumerate(touches):
            x_um = round(_LENGTH_UM * one.place)
            if ms == one.begin_ms:
                switches[i] = engine.press(x_um, t)
            elif ms == one.end_ms:
                engine.release_one(switches[i], t)
            elif one.begin_ms < ms < one.end_ms and one.slide:
                share = (ms - one.begin_ms) / (one.end_ms - one.begin_ms)
                engine.move(switches[i], x_um + round(_LENGTH_UM * one.slide * share), t)
            if ms == one.firm_ms:
                engine.firm(switches[i], t)
        engine.tick(t)
    return sink.spans


class _Sink:
    """Records which keys the engine presses."""

    def __init__(self, named: Callable[[int, int, int], str]):
        self.ms = 0
        self.spans: list[Span] = []
        self._named = named
        self._last: dict[tuple[int, int], int] = {}  # index of a key's last span

    def has_room(self):
        return True

    def usage(self, page, usage, modifiers, pressed):
        pass

    def key(self, page, usage, modifiers, pressed):
        if pressed:
            self._last[page, usage] = len(self.spans)
            self.spans.append(Span(self._named(page, usage, modifiers), self.ms, self.ms))
        else:
            at = self._last[page, usage]
            self.spans[at] = self.spans[at]._replace(end_ms=self.ms)
