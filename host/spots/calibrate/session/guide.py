"""Shows a calibration session on a terminal: where to press, and whether the press is steady."""

from __future__ import annotations

import sys
from collections import deque

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from ...common import typed_ahead
from ...errors import StateError, printable
from ...terminal.view import bar, bars, framed, live, strip_columns
from ..fit.points import Wanted
from .dialog import Progress, UndoError
from .spectra import Reading
from .typed import FORCES

_MESSAGES = 4
_STRIP = "sensor ▐"
_BAR_COUNTS = 100  # least count at which the bar of a channel has full length
_RULER_MM, _PER_MM = 10, 6  # length of a simulated ruler, and columns for each mm
_LOW = 24  # a terminal with at most this number of lines shows only one message


def ruler_lines(place_um: float) -> list[str]:
    """Return a picture of a ruler near a position: numbers, lines, and a mark at the position."""
    begin_mm = max(round(place_um / 1000) - _RULER_MM // 2, 0)
    numbers = "".join(f"{begin_mm + i:<{_PER_MM}}" for i in range(_RULER_MM + 1))
    lines = ("|" + "." * (_PER_MM - 1)) * _RULER_MM + "|"
    at = round((place_um / 1000 - begin_mm) * _PER_MM)
    return [f"mm    {numbers}".rstrip(), f"ruler {lines}", " " * (6 + at) + "▲ finger"]


class Guide:
    """A `Dialog` that draws on a terminal, or prints lines to a file; use it in a ``with`` block.

    Standard output and input are used if nothing else is given.
    """

    def __init__(self, console: Console | None = None, stdin=None):
        self._console = console or Console(highlight=False)
        self._stdin = stdin
        self._live: Live | None = None
        self._messages: deque[str] = deque(maxlen=_MESSAGES)
        self._strip, self._bars = Text(), Table()
        self._title = ""
        self._plan: tuple[str, ...] = ()
        self._length_um = 1.0
        self._done = self._total = 0

    def __enter__(self) -> Guide:
        if self._console.is_terminal:
            self._live = live(self._console)
            self._live.start()
        return self

    def __exit__(self, *exception) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None
            if self._messages:
                self._console.print(self._messages[-1], markup=False, soft_wrap=True)

    def begin(self, title: str, total: int, plan: tuple[str, ...], length_um: float) -> None:
        """Begin a series of presses with a title, for the channels of a plan."""
        self._title, self._plan, self._length_um = title, plan, length_um
        self._done, self._total = 0, total
        presses = "1 press" if total == 1 else f"{total} presses"
        self.say(f"{title}: {presses}, channels {' '.join(plan)}")

    def skip(self, count: int = 1) -> None:
        """Add `count` to the displayed number of presses taken; a negative number subtracts."""
        self._done += count

    def want(self, wanted: Wanted) -> None:
        """Show where to press next."""
        columns, share = strip_columns(), wanted.place_um / self._length_um
        at = len(_STRIP) + round(min(max(share, 0), 1) * (columns - 1))
        self._strip = Text(_STRIP + "█" * columns, style="rgb(140,60,60)")
        self._strip.stylize("rgb(255,235,180)", at, at + 1)
        self._strip.append("\n" + " " * at + "▲")
        self._bars = bars(self._plan, [0.0] * len(self._plan), _BAR_COUNTS)
        self._draw()

    def watch(self, reading: Reading, trouble: str | None, steady: float) -> None:
        """Show a reading of the present press.

        `trouble` is why the press is not steady, or the request ``release``; None for a steady
        press. `steady` is the number of steady readings or the duration of the hold, as a share of
        what the press needs.
        """
        self._bars = bars(self._plan, reading.counts.tolist(), _BAR_COUNTS)
        self._bars.add_row("held", "", Text(bar(steady), style="green"))
        style = "yellow" if trouble else "green"
        self._bars.add_row("", "", Text(trouble or "steady", style=style))
        self._draw()

    def taken(self, wanted: Wanted, reading: Reading) -> None:
        """Show that a press was taken, with the counts of its reading."""
        self._done += 1
        counts = " ".join(f"{count:.0f}" for count in reading.counts)
        self.say(f"{self._done}/{self._total}  {wanted}: {counts}")

    def fitted(self, progress: Progress) -> None:
        """Show the accuracy expected after the last press, and where more presses are needed."""
        self._done, self._total = progress.done, progress.total
        thin = f"; too few presses {', '.join(progress.thin)}" if progress.thin else ""
        force = f", force {progress.sigma_share:.1%}" if progress.force_mN.any() else ""
        self.say(f"expected error: position {progress.sigma_um / 1000:.2f} mm{force}{thin}")

    def request(self, phase: str, text: str) -> None:
        """Show a request to press or to release the strip."""
        self.say(text)

    def say(self, text: str) -> None:
        """Show a message to the person."""
        text = printable(text)
        self._messages.append(text)
        if self._live is None:
            self._console.print(text, markup=False, soft_wrap=True)
        self._draw()

    def ask(
        self, question: str, place_um: float | None = None, force_mN: float | None = None
    ) -> str:
        """Ask a question and return the answer; drop what was typed before the question.

        StateError if standard input is closed; UndoError if the answer is ``undo``.
        """
        if self._live is not None:
            # Erased, because what is printed now would stand in the next picture.
            self._live.transient = True
            self._live.stop()
            for message in [*self._messages][-1:]:
                self._console.print(message, markup=False, soft_wrap=True, style="dim")
        stdin = self._stdin or sys.stdin
        typed_ahead.drop(stdin)
        shown = [] if place_um is None else ruler_lines(place_um)
        if force_mN is not None:
            shown.append(f"scale: {force_mN / FORCES['g']:.0f} g")
        for line in shown:
            self._console.print(line, markup=False, soft_wrap=True)
        self._console.print(printable(question), end="", markup=False)
        line = stdin.readline()
        if self._live is not None:
            self._live = live(self._console)
            self._live.start()
        if not line:
            raise StateError("standard input is closed: run this command in a terminal")
        if line.strip().lower() == "undo":
            raise UndoError
        return line.strip()

    def _draw(self) -> None:
        if self._live is None:
            return
        shown = [Text(message, style="dim") for message in self._messages]
        if shown:
            shown[-1].style = "bold"
        parts = shown if self._console.height > _LOW else shown[-1:]
        title = f"{self._title}  {self._done} of {self._total}"
        parts = [self._strip, Text(), self._bars, Text(), *parts]
        self._live.update(framed(parts, title, strip_columns() + 16), refresh=True)
