"""Scores typing: compares a board's key presses with the keys that a scenario's fingers touch."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter

import numpy as np

from spots.keyboard.key_layout import KeyLayout, parts_of

from ..strip.files import ScenarioFile
from .typing_errors import AFTER_S, Stroke, cause_of_press, cause_of_touch

_STUCK_S = 0.5  # a key is stuck if it is down for this time without a finger


def strokes(
    file: ScenarioFile, layout: KeyLayout, length_mm: float, from_s: float, to_s: float
) -> list[Stroke]:
    """Return the touches of a scenario in an interval, with the key that each touch types.

    A touch is assumed to tap the key of the first layer at the position where the touch begins. The
    scenario repeats without end. A touch is included if it does not begin before `from_s`, and ends
    at least `AFTER_S` before `to_s`.
    """
    keys = next(iter(layout.layers.values()))
    found = []
    for cycle in range(int(to_s // file.seconds) + 1):
        for touch in file.touch:
            began_s = touch.points[0][0] + cycle * file.seconds
            ended_s = touch.points[-1][0] + cycle * file.seconds
            if began_s >= from_s and ended_s + AFTER_S <= to_s:
                place_mm = touch.points[0][1]
                share = min(max(place_mm / length_mm, 0.0), 1 - 1e-9)
                taps = [key.actions["tap"] for key in keys if key.low <= share < key.high]
                key = parts_of(taps[0])[:2] if taps else None
                found.append(Stroke(began_s, ended_s, key, place_mm))
    return sorted(found, key=lambda stroke: stroke.began_s)


class TypingScore:
    """Collects key events, and compares the presses with the fingers of a scenario.

    All times are in seconds of the scenario; the board began to type at `from_s`.
    """

    def __init__(self, file: ScenarioFile, layout: KeyLayout, length_mm: float, from_s: float):
        self._parts = file, layout, length_mm, from_s
        self._presses: list[tuple[float, tuple[int, int]]] = []
        self._spans: list[tuple[float, float]] = []  # each key from its press to its release
        self._down: dict[tuple[int, int], float] = {}
        self.late_ms: list[float] = []  # latency of each correct press, after `summary`

    def key(self, page: int, usage: int, pressed: bool, time_s: float) -> None:
        """Record a press or a release of a key; the time is that at which the host received it."""
        key = page, usage
        if pressed:
            self._presses.append((time_s, key))
            self._down[key] = time_s
        elif key in self._down:
            self._spans.append((self._down.pop(key), time_s))

    def summary(self, to_s: float) -> dict:
        """Return the results of the run up to a time.

        ``wrong`` are presses of another key than the touched one, ``missed`` touches without a
        press, ``extra`` presses without a touch, ``no_finger`` wrong or extra presses of a key that
        no finger touched, ``stuck`` keys that stay pressed for more than 0.5 s after the last
        finger has left the strip. ``causes`` has the number of wrong, missed and extra keys in each
        circumstance, see `typing_errors`. ``latency_ms`` is from the start of a touch to the
        correct press.
        """
        fingers = strokes(*self._parts, to_s)
        presses = [press for press in self._presses if press[0] <= to_s]
        right, open_presses = self._match(presses, fingers)
        taken = set(right.values())
        wrong = no_finger = 0
        causes: Counter[str] = Counter()
        for time_s, key in open_presses:
            free = next(
                (i for i, f in enumerate(fingers) if i not in taken and f.covers(time_s)), None
            )
            if free is not None:
                taken.add(free)
                wrong += 1
                causes[cause_of_touch(fingers[free], fingers)] += 1
            else:
                causes[cause_of_press(time_s, key, fingers)] += 1
            no_finger += not any(f.key == key and f.covers(time_s) for f in fingers)
        missed = [finger for i, finger in enumerate(fingers) if i not in taken]
        causes.update(cause_of_touch(finger, fingers) for finger in missed)
        self.late_ms = late_ms = [
            1000 * (presses[p][0] - fingers[f].began_s) for p, f in right.items()
        ]
        return {
            "touches": len(fingers),
            "right": len(right),
            "wrong": wrong,
            "missed": len(missed),
            "extra": len(open_presses) - wrong,
            "no_finger": no_finger,
            "stuck": self._stuck(to_s),
            "causes": dict(causes),
            "latency_ms": {
                f"p{p}": round(float(np.percentile(late_ms, p)), 1) if late_ms else None
                for p in (50, 90, 99)
            },
        }

    @staticmethod
    def _match(presses, fingers):
        """Match key presses with touches (`fingers`) of the same key.

        Each touch is matched with at most one press. Returns a dict of touch index by press index,
        and a list of the unmatched presses.
        """
        right: dict[int, int] = {}
        matched, others = set(), []
        for p, (time_s, key) in enumerate(presses):
            for f, finger in enumerate(fingers):
                if f not in matched and finger.key == key and finger.covers(time_s):
                    right[p] = f
                    matched.add(f)
                    break
            else:
                others.append((time_s, key))
        return right, others

    def _stuck(self, to_s: float) -> int:
        file, layout, length_mm, _ = self._parts
        # A touch that has begun by `to_s` ends at most one scenario later.
        touches = strokes(file, layout, length_mm, -1.0, to_s + file.seconds + AFTER_S)
        ends_s = sorted(touch.ended_s for touch in touches)
        begins_s = [touch.began_s for touch in touches]
        stuck = 0
        for _, up_s in [*self._spans, *((down_s, to_s) for down_s in self._down.values())]:
            ended = bisect_right(ends_s, up_s)
            nobody = ended == bisect_right(begins_s, up_s)
            stuck += nobody and up_s - (ends_s[ended - 1] if ended else 0.0) > _STUCK_S
        return stuck
