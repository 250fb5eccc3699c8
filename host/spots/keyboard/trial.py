"""Plays fingers on the key engine, to show when a key is a tap and when it is a hold."""

from typing import NamedTuple

from spots_device.keys.engine import Engine
from spots_device.keys.layout import BEHAVIOUR, HOLD_TAP, KEYBOARD, action, parse
from spots_device.keys.merge import Merger

TERM_MS = 200
_LENGTH_UM = 100_000
_BETWEEN_MS = 1000  # after a finger has lifted, everything is decided
# Usages that stand for what a key does.
_USAGES = {"tap": 4, "hold": 5, "other": 6}


class Span(NamedTuple):
    """Time in which a key of the computer is pressed; `what` is "tap", "hold" or "other"."""

    what: str
    begin_ms: int
    end_ms: int


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

    Parameters
    ----------
    flavor : int
        Index in `layout.FLAVORS`, plus `spots_device.keys.layout.RETRO_TAP`.
    gesture : str
        One of `GESTURES`.

    Returns
    -------
    list of Span
        What the computer gets, in the order of the presses. The tapping term is `TERM_MS`.
    """
    fingers = [[round(TERM_MS * share) for share in shares] for shares in GESTURES[gesture]]
    sink = _Sink()
    engine = Engine(sink, Merger())
    tap, hold, other = (action(KEYBOARD, usage) for usage in _USAGES.values())
    lines = [
        f"behaviour 0 {HOLD_TAP} {flavor} {TERM_MS} 0 0 {hold}",
        "layer 0 0",
        f"key 0 500 {tap} 0 {action(BEHAVIOUR, 0)} 0 0 0",
        f"key 500 1000 {other} 0 0 0 0 0",
    ]
    engine.set_layout(parse(lines), _LENGTH_UM)
    switches = {}
    for ms in range(max(end for _, end in fingers) + _BETWEEN_MS):
        sink.ms = ms
        t = ms * 1000 // 1024
        for i, (begin, end) in enumerate(fingers):
            if ms == begin:
                switches[i] = engine.press(_LENGTH_UM * (1 + 2 * i) // 4, t)
            elif ms == end:
                engine.release_one(switches[i], t)
        engine.tick(t)
    return sink.spans


class _Sink:
    """Records what the engine presses."""

    def __init__(self):
        self.ms = 0
        self.spans = []

    def has_room(self):
        return True

    def usage(self, page, usage, modifiers, pressed):
        pass

    def key(self, page, usage, modifiers, pressed):
        what = list(_USAGES)[usage - _USAGES["tap"]]
        if pressed:
            self.spans.append(Span(what, self.ms, self.ms))
        else:
            self.spans = [
                one._replace(end_ms=self.ms) if one.what == what else one for one in self.spans
            ]
