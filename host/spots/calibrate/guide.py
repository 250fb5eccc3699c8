"""The picture of a calibration session: where to press next, and whether it is held."""

from __future__ import annotations

import math
import sys

from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from ..errors import SpotsError, printable
from ..terminal.view import bar, bars, live, strip_columns
from .session import Wanted
from .spectra import Reading

_MESSAGES = 4
_LOW = 24  # lines of a terminal that has room for one message


class Guide:
    """A picture on a terminal, plain lines elsewhere. Use it in a ``with`` block.

    Parameters
    ----------
    console : rich.console.Console, optional
    stdin : file, optional
        Where answers come from.
    """

    def __init__(self, console: Console | None = None, stdin=None):
        self._console = console or Console(highlight=False)
        self._stdin = stdin
        self._live: Live | None = None
        self._messages: list[str] = []
        self._wanted: Wanted | None = None
        self._reading: Reading | None = None
        self._trouble: str | None = None
        self._steady = 0.0
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
            for message in self._messages[-1:]:
                self._console.print(message, markup=False, soft_wrap=True)

    def begin(self, title: str, total: int, plan: tuple[str, ...], length_um: float) -> None:
        """Begin a series of presses.

        Parameters
        ----------
        title : str
        total : int
            How many presses.
        plan : tuple of str
            The channels.
        length_um : float
            Length of the strip, in um.
        """
        self._title, self._plan, self._length_um = title, plan, length_um
        self._done, self._total = 0, total
        self.say(f"{title}: {total} presses, channels {' '.join(plan)}")

    def skip(self, count: int = 1) -> None:
        """Count presses that were taken before."""
        self._done += count

    def want(self, wanted: Wanted) -> None:
        """Mark where to press."""
        self._wanted, self._reading = wanted, None
        self._draw()

    def watch(self, reading: Reading, trouble: str | None, steady: float) -> None:
        """Show a reading.

        Parameters
        ----------
        reading : Reading
        trouble : str or None
            The reason why the reading cannot be taken; None if it can.
        steady : float
            From 0 to 1, where it is taken.
        """
        self._reading, self._trouble, self._steady = reading, trouble, steady
        self._draw()

    def taken(self, wanted: Wanted, reading: Reading) -> None:
        """Show that a press was taken.

        Parameters
        ----------
        wanted : Wanted
            The press.
        reading : Reading
            Its counts are shown.
        """
        self._done += 1
        counts = " ".join(f"{count:.0f}" for count in reading.counts)
        self.say(f"{self._done}/{self._total}  {wanted}: {counts}")

    def say(self, text: str) -> None:
        """Show a message."""
        text = printable(text)
        self._messages = [*self._messages, text][-_MESSAGES:]
        if self._live is None:
            self._console.print(text, markup=False, soft_wrap=True)
        self._draw()

    def ask(self, question: str) -> str:
        """Return the answer to a question.

        Raises
        ------
        SpotsError
            If nobody is there to answer.
        """
        if self._live is not None:
            self._live.stop()
        self._console.print(printable(question), end="", markup=False)
        line = (self._stdin or sys.stdin).readline()
        if self._live is not None:
            self._live.start()
        if not line:
            raise SpotsError("standard input is closed: run this in a terminal")
        return line.strip()

    def ask_number(
        self, question: str, lowest: float = -math.inf, highest: float = math.inf
    ) -> float:
        """Return a number; ask until a valid one is given.

        Parameters
        ----------
        question : str
        lowest, highest : float
            The range, both included.

        Returns
        -------
        float
        """
        while True:
            answer = self.ask(question)
            try:
                value = float(answer.replace(",", "."))
            except ValueError:
                value = math.nan
            if math.isfinite(value) and lowest <= value <= highest:
                return value
            most = f", at most {highest:g}" if highest < math.inf else ""
            self.say(f"'{answer}' is not a number that fits: type one such as 1.5{most}")

    def _draw(self) -> None:
        if self._live is not None:
            self._live.update(self._picture(), refresh=True)

    def _picture(self) -> Panel:
        columns = strip_columns()
        parts = [self._strip(columns), Text(), self._bars(), Text()]
        shown = self._messages[-_MESSAGES if self._console.height > _LOW else -1 :]
        parts += [Text(message, style="dim") for message in shown[:-1]]
        parts += [Text(message, style="bold") for message in shown[-1:]]
        title = f"{self._title}  {self._done} of {self._total}"
        return Panel(
            Group(*parts), title=Text(printable(title)), width=columns + 16, padding=(1, 2)
        )

    def _strip(self, columns: int) -> Text:
        line = Text("sensor ▐" + "█" * columns, style="rgb(140,60,60)")
        if self._wanted is not None:
            share = self._wanted.place_um / self._length_um
            at = len("sensor ▐") + round(min(max(share, 0), 1) * (columns - 1))
            line.stylize("rgb(255,235,180)", at, at + 1)
            line.append("\n" + " " * at + "▲")
        return line

    def _bars(self) -> Table:
        counts = [0.0] * len(self._plan) if self._reading is None else self._reading.counts
        grid = bars(self._plan, counts, 100)
        if self._reading is not None:
            grid.add_row("held", "", Text(bar(self._steady), style="green"))
            style = "yellow" if self._trouble else "green"
            grid.add_row("", "", Text(self._trouble or "steady", style=style))
        return grid
