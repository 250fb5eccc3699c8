"""A simulated person, who follows the instructions of a calibration session and presses a strip."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec.structs import astuple, replace

from spots.common.guarded import Guarded

from ..strip.scenario import Held, Press

_PRESS = re.compile(
    r"press (?:at|the (mark) at) ([\d.]+) mm with "
    r"(?:(?:about )?(\d+) g|(a firm|your hardest)|([\d.]+) N)"
)
_CHANGE = re.compile(r"without lifting, go to about (\d+) g")
_QUESTION = re.compile(r"what (?:does|do) (?:the )?(?:ruler|scale)")
_FINGER_MM, _INDENTER_MM = 8.0, 4.0  # widths along the strip
_MARK_MM = 0.3  # standard deviation of presses on a mark that is drawn on the strip; assumed
_FIRM_MN, _HARD_MN = (2500.0, 6000.0), (6000.0, 10_000.0)  # of presses without a scale
_GRAM_MN = 9.80665  # weight of 1 g in mN
_STARTS_S = 0.4  # from the request to the press
_EARLY_S = 0.5  # a press that is lifted early lasts for this time or twice this time
_RAMP_S, _RAMP_STEPS = 0.6, 6  # duration and steps of a change of the force
_FORGOTTEN_S = 20.0  # from the request to a press that the person has forgotten

# Movement of a finger, as a list of presses. Each element: start and end in s after the start of
# the movement, and the press in between. The end may be infinite.
Way = list[tuple[float, float, Press]]


@dataclass(frozen=True)
class Habits:
    """Errors that a simulated person makes.

    `place_mm` is the largest error of a position that the person reads off the ruler, `force_share`
    that of a force off the scale. `slips` is the share of presses with a slip: the press begins 20
    s after the request, or the finger lifts too early and presses again. `typos` is the share of
    presses whose position the person types wrongly, by 30 to 70 % of the strip's length; a position
    has `decimals` digits after the point. `width_mm` is that of the finger, for presses without a
    scale; presses on a scale are made with an indenter.
    """

    place_mm: float = 0.5
    force_share: float = 0.05
    slips: float = 0.2
    typos: float = 0.0
    width_mm: float = _FINGER_MM
    decimals: int = 1


class Person:
    """Reads the messages of a calibration session, moves a finger, and answers questions.

    ``move(way)`` starts a movement of the finger; an empty `Way` lifts it. `presses` counts the
    presses that were requested and made.
    """

    def __init__(self, move: Callable[[Way], None], length_mm: float, habits: Habits, seed: int):
        self._move, self._length_mm, self._habits = move, length_mm, habits
        self._rng = np.random.default_rng((seed, 5))
        self._shown: tuple[float, float] = (0.0, 0.0)
        self._then_mN = 0.0
        self._press_now = Press(0.0, 0.0, _INDENTER_MM)
        self.presses = 0

    def hear(self, text: str) -> None:
        """Press or lift the simulated finger if the message `text` of the session asks for it."""
        if found := _PRESS.match(text):
            mark, place_mm, grams, firm, newtons = found.groups()
            low, high = _HARD_MN if firm == "your hardest" else _FIRM_MN
            force_mN = (
                _GRAM_MN * float(grams)
                if grams
                else self._rng.uniform(low, high)
                if firm
                else 1000 * float(newtons)
            )
            misses_mm = _MARK_MM * self._rng.standard_normal() if mark else None
            self._press(float(place_mm), force_mN, bool(firm), misses_mm)
        elif found := _CHANGE.search(text):
            self._change(_GRAM_MN * float(found[1]))
        elif text.startswith("release"):
            self._move([])

    def _press(
        self, asked_mm: float, asked_mN: float, is_finger: bool, misses_mm: float | None
    ) -> None:
        rng, habits = self._rng, self._habits
        self.presses += 1
        # Position and force differ from those asked for; the person reads them off with an error.
        misses_mm = rng.uniform(-2, 2) if misses_mm is None else misses_mm
        at_mm = np.clip(asked_mm + misses_mm, 0, self._length_mm)
        force_mN = asked_mN * rng.uniform(0.85, 1.15)
        width_mm = habits.width_mm if is_finger else _INDENTER_MM
        press = Press(float(at_mm), float(force_mN), width_mm, skin=is_finger)
        self._shown = (
            float(np.clip(at_mm + habits.place_mm * rng.uniform(-1, 1), 0, self._length_mm)),
            float(force_mN * (1 + habits.force_share * rng.uniform(-1, 1))),
        )
        start_s = _STARTS_S
        way: Way = []
        if rng.random() < habits.slips:
            slip = rng.integers(3)
            if slip == 0:
                start_s = _FORGOTTEN_S
            else:
                way.append((start_s, start_s + _EARLY_S * slip, press))
                start_s += 1.5
        self._press_now = press
        self._move([*way, (start_s, float("inf"), press)])

    def _change(self, asked_mN: float) -> None:
        rng, before = self._rng, self._press_now
        after_mN = float(asked_mN * rng.uniform(0.85, 1.15))
        self._then_mN = after_mN * (1 + self._habits.force_share * rng.uniform(-1, 1))
        way: Way = [(0.0, _STARTS_S, before)]
        for share in np.linspace(0, 1, _RAMP_STEPS + 1)[1:].tolist():
            force_mN = before.force_mN + share * (after_mN - before.force_mN)
            begin_s = _STARTS_S + share * _RAMP_S
            way.append(
                (begin_s, begin_s + _RAMP_S / _RAMP_STEPS, replace(before, force_mN=force_mN))
            )
        way[-1] = way[-1][0], float("inf"), way[-1][2]
        way[0] = 0.0, way[1][0], before
        self._move(way)

    def shown(self, question: str) -> tuple[float | None, float | None]:
        """Return position in mm and force in mN that the person reads off to answer a question.

        Each is None if the question does not ask for it.
        """
        if not _QUESTION.search(question):
            return None, None
        if "second" in question:
            return None, self._then_mN
        place_mm, force_mN = self._shown
        return place_mm, force_mN if "scale" in question else None

    def answer(self, question: str) -> str:
        """Return the line that the person types, without its line end.

        The line is empty if the question asks neither for a position nor for a force.
        """
        if not _QUESTION.search(question):
            return ""
        place_mm, force_mN = self._shown
        rng = self._rng
        if "second" in question:
            return f"{self._then_mN / _GRAM_MN:.0f}g"
        if rng.random() < self._habits.typos:
            place_mm = (place_mm + self._length_mm * rng.uniform(0.3, 0.7)) % self._length_mm
        digits = self._habits.decimals
        in_mm, in_cm = f"{place_mm:.{digits}f}mm", f"{place_mm / 10:.{digits + 1}f} cm"
        words = [in_mm if rng.random() < 0.7 else in_cm]
        if "scale" in question:
            newtons = f"{force_mN / 1000:.3g}N"
            if rng.random() < 0.3:
                newtons = newtons.replace(".", ",").replace("N", " N")
            words.append(f"{force_mN / _GRAM_MN:.0f}g" if rng.random() < 0.6 else newtons)
            rng.shuffle(words)
        return " ".join(words)


def follow(held: Held, way: Way) -> None:
    """Move the simulated finger along a path, from the board's next exposure on.

    Each part of the path has its start and its end, in s after the start of the movement, and the
    `Press` during this part.
    """
    began: list[float] = []

    def presses(time_s: float) -> list[Press]:
        began.append(time_s)
        since_s = time_s - began[0]
        del began[1:]
        return [press for start_s, end_s, press in way if start_s <= since_s < end_s]

    held.presses = presses


def line_of(way: Way) -> str:
    """Return a movement of the finger as a line of text for `follow_pipe`."""
    rows = [[start_s, end_s, *astuple(press)] for start_s, end_s, press in way]
    return json.dumps(rows) + "\n"


def follow_pipe(held: Held, pipe: Path) -> threading.Thread:
    """Start a thread that reads paths from a named pipe, and moves the simulated finger along them.

    Each line has a path, see `line_of`. The thread ends when the pipe is closed.
    """

    def take(line: str) -> None:
        rows = json.loads(line)
        follow(held, [(start_s, end_s, Press(*press)) for start_s, end_s, *press in rows])

    guarded = Guarded(take, "the simulated finger")

    def read() -> None:
        with pipe.open() as lines:
            for line in lines:
                guarded(line)

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    return thread
