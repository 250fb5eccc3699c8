"""Types for hours on strips without an error, and counts advice; there must be none.

    make soak ARGS="--advice --hours 8"

The strips are `default`, and `real` after a re-zero with a warm LED. Fingers type at 20 to 100
words a minute, with touches that overlap. Prints one line of JSON for each strip: hours, presses
that were used, sentences of advice, and the largest estimated error of the position in mm.
"""

from __future__ import annotations

import json

import numpy as np

from spots.advice.advice import advice_for
from spots.keyboard.layout import load as load_layout
from spots_sim.demo.demo import open_fast
from spots_sim.person.typist import fast_typing
from spots_sim.strip.files import SensorFile, load
from spots_sim.strip.scenario import Scenario

_STRIPS = "default", "real"
_TOUCHES = 600  # of a run; each run has another seed and speed
_WORDS_PER_MIN = 20, 40, 60, 100


def count(hours: float, seed: int, strips: tuple[str, ...] = _STRIPS) -> int:
    """Type on each strip for some hours, and print the results.

    Parameters
    ----------
    hours : float
        Simulated time for each strip.
    seed : int
        Random seed of the first run.
    strips : tuple of str, optional
        Names of sensor files.

    Returns
    -------
    int
        Number of sentences of advice, on all strips.
    """
    total = 0
    for name in strips:
        said: list[str] = []
        left_s, run, presses, largest_um = 3600 * hours, 0, 0, 0.0
        while left_s > 0:
            seconds, used, worst_um, sentences = _typed(name, seed + run, run, left_s)
            left_s, run, presses = left_s - seconds, run + 1, presses + used
            said, largest_um = said + sentences, max(largest_um, worst_um)
        row = {"strip": name, "hours": hours, "presses": presses, "advice": said}
        print(json.dumps({**row, "largest_mm": round(largest_um / 1000, 2)}), flush=True)
        total += len(said)
    return total


def _typed(name: str, seed: int, run: int, most_s: float) -> tuple[float, int, float, list[str]]:
    speed = _WORDS_PER_MIN[run % len(_WORDS_PER_MIN)]
    what = load_layout("digits"), speed, _TOUCHES, load(SensorFile, name).length_mm, seed
    file = fast_typing(*what)
    board, _ = open_fast(name, Scenario(file), seed, rezeroed=True, warm=True)
    said, worst_um, before = [], 0.0, ""
    with board:
        advice = advice_for(board, board.info)
        board.stream("touch", "spectrum")
        begun_s = board.now_s()
        for frame in board.frames(min(file.seconds, most_s) - begun_s):
            advice.take(frame, board.now_s())
            if advice.sentence and advice.sentence != before:
                said.append(advice.sentence)
            before = advice.sentence
            if advice.notice.presses > 10:
                worst_um = max(worst_um, float(np.abs(advice.notice.error_um[-1])))
        return board.now_s(), advice.notice.presses, worst_um, said
