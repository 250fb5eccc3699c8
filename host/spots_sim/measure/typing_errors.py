"""Classifies typing errors by what the fingers did at a missed or wrong key."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

AFTER_S = 0.12  # a press may belong to a touch until this time after the end of the touch
_TOGETHER_S = 0.015
_NEAR_MM = 9.0
_SHORT_S = 0.045


@dataclass(frozen=True)
class Stroke:
    """One touch, in seconds of the scenario; `key` is HID page and usage, None between two keys.

    `place_mm` is the position at which the touch begins.
    """

    began_s: float
    ended_s: float
    key: tuple[int, int] | None
    place_mm: float

    def covers(self, time_s: float) -> bool:
        """Return whether this touch can cause a key press at `time_s`, in s of the scenario."""
        return self.began_s <= time_s <= self.ended_s + AFTER_S


# Circumstances of a touch, each with a test of the touch and those that overlap it in time. The
# first one that applies is the cause of the touch's error.
_OF_TOUCH = {
    "landed together (less than 15 ms apart)": lambda one, others: any(
        abs(other.began_s - one.began_s) < _TOGETHER_S for other in others
    ),
    "three fingers at once": lambda one, others: any(
        _overlap(a, b)
        and max(a.began_s, b.began_s) < one.ended_s
        and min(a.ended_s, b.ended_s) > one.began_s
        for i, a in enumerate(others)
        for b in others[:i]
    ),
    "two fingers less than 9 mm apart": lambda one, others: any(
        abs(other.place_mm - one.place_mm) < _NEAR_MM for other in others
    ),
    "a touch shorter than 45 ms": lambda one, _: one.ended_s - one.began_s < _SHORT_S,
    "the second of two fingers": lambda one, others: any(
        other.began_s < one.began_s for other in others
    ),
    "the first of two fingers": lambda _, others: bool(others),
    "one finger alone": lambda *_: True,
}
_TWICE, _NOBODY = "a key that was typed twice", "a key after the touch"
CAUSES = *_OF_TOUCH, _TWICE, _NOBODY


def cause_of_touch(one: Stroke, strokes: Sequence[Stroke]) -> str:
    """Return the circumstance in which a touch typed no key, or a wrong one: one of `CAUSES`."""
    others = [other for other in strokes if other is not one and _overlap(one, other)]
    return next(name for name, applies in _OF_TOUCH.items() if applies(one, others))


def cause_of_press(time_s: float, key: tuple[int, int], strokes: Sequence[Stroke]) -> str:
    """Return the circumstance of a press that belongs to no touch: one of `CAUSES`.

    It is that of the last touch which can have caused the press.
    """
    covering = [one for one in strokes if one.covers(time_s)]
    if any(one.key == key for one in covering):
        return _TWICE
    return cause_of_touch(covering[-1], strokes) if covering else _NOBODY


def _overlap(one: Stroke, other: Stroke) -> bool:
    return one.began_s < other.ended_s and other.began_s < one.ended_s
