"""Draws docs/demo.svg: what ``make demo`` shows, from a run in simulated time."""

from __future__ import annotations

import io
from pathlib import Path

from rich.console import Console

from spots.demo import open_fast
from spots.frames import Touch
from spots.score import Score
from spots.sim.files import ScenarioFile, load
from spots.sim.scenario import Scenario
from spots.view import View

# In the demo scenario a finger slides back towards the sensor at this moment.
MOMENT_S = 4.0


def main() -> None:
    """Run the demo up to the moment and draw its picture."""
    truth = Scenario(load(ScenarioFile, "demo"))
    board, _ = open_fast("default", truth, seed=0)
    score = Score(truth, 0.0)
    with board:
        board.command("stream touch spectrum")
        view = View(board.command("hello"), board.port)
        for frame in board.frames():
            view.take(frame)
            if isinstance(frame, Touch):
                score.take(frame, board.now_s())
            if board.now_s() > MOMENT_S:
                break
        picture = view.picture(board.stats, score)
    console = Console(
        file=io.StringIO(), record=True, width=82, force_terminal=True, color_system="truecolor"
    )
    console.print(picture)
    path = Path(__file__).with_name("demo.svg")
    console.save_svg(str(path), title="make demo")
    print(path)


if __name__ == "__main__":
    main()
