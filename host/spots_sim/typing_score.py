"""Scores typing: each key that a board pressed against the fingers that were on the strip."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from spots.keyboard.layout import KeyLayout

from .files import ScenarioFile

AFTER_S = 0.12  # a press belongs to a touch from its first light to so long after its end
_STUCK_S = 0.5  # a key that is down although no finger was there for so long


@dataclass(frozen=True)
class Stroke:
    """One finger on one key: from its first light to its end, in s."""

    began_s: float
    ended_s: float
    key: tuple[int, int] | None

    def covers(self, time_s: float) -> bool:
        """Return whether a press at this time may belong to this finger."""
        return self.began_s <= time_s <= self.ended_s + AFTER_S


def strokes(
    file: ScenarioFile, layout: KeyLayout, length_mm: float, from_s: float, to_s: float
) -> list[Stroke]:
    """Return the fingers of a scenario that begin and end in a time, by the keys of layer 0.

    Parameters
    ----------
    file : ScenarioFile
        It repeats.
    layout : KeyLayout
    length_mm : float
        Of the strip.
    from_s, to_s : float
        In seconds of the run; a finger counts if what it types comes within them.

    Returns
    -------
    list of Stroke
        By their first light. What a finger types is the tap of the key where it began.
    """
    keys = next(iter(layout.layers.values()))
    found = []
    for cycle in range(int(to_s // file.seconds) + 1):
        for touch in file.touch:
            began_s = touch.points[0][0] + cycle * file.seconds
            ended_s = touch.points[-1][0] + cycle * file.seconds
            if began_s >= from_s and ended_s + AFTER_S <= to_s:
                share = min(max(touch.points[0][1] / length_mm, 0.0), 1 - 1e-9)
                taps = [key.actions["tap"] for key in keys if key.low <= share < key.high]
                found.append(Stroke(began_s, ended_s, _usage(taps[0]) if taps else None))
    return sorted(found, key=lambda stroke: stroke.began_s)


def _usage(action: int) -> tuple[int, int]:
    return action >> 20, action & 0xFFF


class TypingScore:
    """Collects key events, and compares their presses with the fingers of a scenario.

    Parameters
    ----------
    file : ScenarioFile
    layout : KeyLayout
    length_mm : float
        Of the strip.
    from_s : float
        When the board began to type, in seconds of the scenario.
    """

    def __init__(self, file: ScenarioFile, layout: KeyLayout, length_mm: float, from_s: float):
        self._parts = file, layout, length_mm, from_s
        self._presses: list[tuple[float, tuple[int, int]]] = []
        self._spans: list[tuple[float, float]] = []  # each key from its press to its release
        self._down: dict[tuple[int, int], float] = {}

    def key(self, page: int, usage: int, pressed: bool, time_s: float) -> None:
        """Take a key event.

        Parameters
        ----------
        page, usage : int
            Of USB HID.
        pressed : bool
            Whether it goes down.
        time_s : float
            When the host got it, in seconds of the scenario.
        """
        key = page, usage
        if pressed:
            self._presses.append((time_s, key))
            self._down[key] = time_s
        elif key in self._down:
            self._spans.append((self._down.pop(key), time_s))

    def summary(self, to_s: float) -> dict:
        """Return the run up to a time in figures.

        Parameters
        ----------
        to_s : float
            End of the run, in seconds of the scenario.

        Returns
        -------
        dict
            ``touches``; ``right`` presses of the key where a finger was; ``wrong``, of another one
            instead; ``missed`` fingers; ``extra`` presses; ``no_finger``, those among wrong and
            extra whose key no finger was on; ``stuck`` keys; ``latency_ms`` of the right ones.
        """
        fingers = strokes(*self._parts, to_s)
        presses = [press for press in self._presses if press[0] <= to_s]
        right, open_presses = self._match(presses, fingers)
        taken = set(right.values())
        wrong = no_finger = 0
        for time_s, key in open_presses:
            free = next(
                (i for i, f in enumerate(fingers) if i not in taken and f.covers(time_s)), None
            )
            if free is not None:
                taken.add(free)
                wrong += 1
            no_finger += not any(f.key == key and f.covers(time_s) for f in fingers)
        late_ms = [1000 * (presses[p][0] - fingers[f].began_s) for p, f in right.items()]
        return {
            "touches": len(fingers),
            "right": len(right),
            "wrong": wrong,
            "missed": len(fingers) - len(taken),
            "extra": len(open_presses) - wrong,
            "no_finger": no_finger,
            "stuck": self._stuck(to_s),
            "latency_ms": {
                f"p{p}": round(float(np.percentile(late_ms, p)), 1) if late_ms else None
                for p in (50, 90, 99)
            },
        }

    @staticmethod
    def _match(presses, fingers):
        """Return which finger each right press is of, by their indices, and the other presses."""
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
        ends_s = sorted(s.ended_s for s in strokes(file, layout, length_mm, -1.0, to_s + 1e3))
        begins_s = sorted(s.began_s for s in strokes(file, layout, length_mm, -1.0, to_s + 1e3))
        stuck = 0
        for _, up_s in [*self._spans, *((down_s, to_s) for down_s in self._down.values())]:
            ended = bisect_right(ends_s, up_s)
            nobody = ended == bisect_right(begins_s, up_s)
            stuck += nobody and up_s - (ends_s[ended - 1] if ended else 0.0) > _STUCK_S
        return stuck
