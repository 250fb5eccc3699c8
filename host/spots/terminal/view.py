"""Draws a strip, its spectrum and the state of the link in a terminal."""

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from shutil import get_terminal_size
from typing import Protocol

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from spots_device.reading import decode

from ..common import typed_ahead
from ..common.cursor import cursor_shown
from ..errors import printable
from ..link.frames import Frame, LinkStats, Spectrum, Touch
from ..link.timeouts import CONNECTED

_FULL_FORCE_MN = 10_000
_DEFAULT_LENGTH_UM = 85_000
_BAR_LEFT = 24  # columns by which a bar is shorter than a strip
_TRACE_COLUMNS = 64  # largest width of a strip's picture and of the history
_EIGHTHS = " ▏▎▍▌▋▊▉█"
_LEVELS = " ▁▂▃▄▅▆▇█"
_REDRAWS_PER_S = 15
# Colour of each channel's wavelengths, see the AS7341 data sheet DS000504.
_CHANNEL_COLOURS = {
    "F1": "#7600ed", "F2": "#0028ff", "F3": "#00d5ff", "F4": "#1fff00", "F5": "#b3ff00",
    "F6": "#ffdf00", "F7": "#ff4f00", "F8": "#d00000", "CLEAR": "#f0f0f0", "NIR": "#8a5a5a",
}  # fmt: skip
FLAG_WORDS = {
    decode.SATURATED: "saturated",
    decode.MISFIT: "not one press",
    decode.NOT_CALIBRATED: "not calibrated",
    decode.LED_OFF: "LED off",
}


class Judge(Protocol):
    """Compares readings with known true values, such as those of a simulated finger."""

    def take(self, touch: Touch, arrived_s: float) -> None:
        """Compare a reading, which arrived at a time of `Board.now_s`, with the true values."""

    def facts(self) -> dict:
        """Return the results of the comparison, as dicts of names and values to show.

        Key ``link``: dict to show in the same row as the numbers of received and lost frames. Key
        ``rows``: list of dicts, each of which is shown in a row of its own.
        """


class StripView:
    """A picture of the latest readings of one strip, from the board's reply to ``hello`` for it.

    `state` is that of `link.board.Board.state`; it is shown unless it is ``connected``. `advice` is
    shown below the picture. `unit` is that of ``force_mN / 1000``: ``N``, or ``relative`` if the
    strip was calibrated without a kitchen scale.
    """

    def __init__(self, info: dict, port: str):
        self.state, self.advice = CONNECTED, ""
        self._info = info
        self._port = port
        self._length_um = info.get("length_um") or _DEFAULT_LENGTH_UM
        self.unit = "relative" if info.get("relative_force") else "N"
        self._touch: Touch | None = None
        self._counts: Sequence[float] = [0] * len(info["channels"])
        self._trace: deque[Touch] = deque(maxlen=_TRACE_COLUMNS * 4)

    def take(self, frame: Frame) -> None:
        """Update the picture with a frame."""
        if isinstance(frame, Touch):
            self._touch = frame
            self._trace.append(frame)
        elif isinstance(frame, Spectrum):
            self._counts = frame.counts

    def picture(self, stats: LinkStats, judge: Judge | None = None) -> Panel:
        """Return a picture of the latest readings and of the link; `judge` adds their errors."""
        judged = judge.facts() if judge else {"link": {}, "rows": []}
        info = self._info
        parts = [self._strip(), self._scale(), Text(), self._numbers(), self._history(), Text()]
        link = {"frames": stats.frames, "lost": stats.lost, "bad": stats.bad_crc, **judged["link"]}
        parts += [bars(info["channels"], self._counts, 1000), Text()]
        parts += map(_row, (link, *judged["rows"]))
        if self.state != CONNECTED:
            parts.append(Text(f"link {self.state}", style="yellow"))
        if self.advice:
            parts.append(Text(self.advice, style="yellow"))
        title = f"SPOTS  {info['board']} · {info['runtime']} · {self._port}"
        return framed(parts, title, strip_columns() + 16)

    def _strip(self) -> Text:
        # The strip is drawn redder away from the sensor, and bright at the press.
        touch = self._touch
        columns = strip_columns()
        at = size = -1.0
        if touch is not None and _is_felt(touch):
            at = touch.position_um / self._length_um * (columns - 1)
            size = 0.6 + 2.5 * min(touch.force_mN / _FULL_FORCE_MN, 1)
        line = Text("sensor ▐")
        for column in range(columns):
            share = column / (columns - 1)
            red, rest = 120 + round(40 * (1 - share)), round(110 * (1 - share) ** 2 + 14)
            if at >= 0 and abs(column - at) <= size:
                red, rest = 255, 235 - round(60 * share)
            line.append("█", style=f"rgb({red},{rest},{rest})")
        return line

    def _scale(self) -> Text:
        half = strip_columns() // 2
        middle, end = (f"{self._length_um / 1000 * share:g} mm" for share in (0.5, 1))
        ticks = "0".ljust(half) + middle.ljust(half - len(end)) + end
        return Text(" " * len("sensor ▐") + ticks, style="dim")

    def _numbers(self) -> Table:
        touch = self._touch
        held = touch is not None and _is_felt(touch)
        place = f"{touch.position_um / 1000:.3f} mm" if held else "-"
        force = f"{touch.force_mN / 1000:.3f} {self.unit}" if held else "-"
        words = " ".join(flag_words(touch)) if touch is not None else ""
        share = touch.force_mN / _FULL_FORCE_MN if held else 0
        grid = bar_grid()
        grid.add_row("position", place, Text(words, style="yellow"))
        grid.add_row("force", force, Text(bar(share), style="cyan"))
        return grid

    def _history(self) -> Text:
        # The oldest readings are on the left. Each column shows the mean position of four readings.
        readings = list(self._trace)[-4 * strip_columns() :]
        line = Text("history".rjust(9) + " ")
        for i in range(0, len(readings), 4):
            held = [t.position_um for t in readings[i : i + 4] if _is_felt(t)]
            share = sum(held) / len(held) / self._length_um if held else 0
            level = 1 + max(0, min(int(share * 8), 7))
            line.append(_LEVELS[level] if held else " ", style="red")
        return line


def framed(parts: Iterable[RenderableType], title: str, columns: int, rows: int = 1) -> Panel:
    """Return a picture: parts below each other in a frame with a title.

    The frame is `columns` characters wide; `rows` empty rows are below and above the parts.
    """
    return Panel(Group(*parts), title=Text(printable(title)), width=columns, padding=(rows, 2))


def bars(plan: Sequence[str], counts: Sequence[float], least: float) -> Table:
    """Return a table with a bar for each channel.

    A bar has full length at the count `least`, unless a channel has a larger count.
    """
    grid = bar_grid()
    top = max([*counts, least])
    for name, count in zip(plan, counts):
        colour = _CHANNEL_COLOURS.get(name, "white")
        grid.add_row(Text(printable(name)), f"{count:.0f} ct", Text(bar(count / top), style=colour))
    return grid


def strip_columns() -> int:
    """Return the width of a strip's picture in characters: 32 to 64, by the terminal's width."""
    return max(_TRACE_COLUMNS // 2, min(_TRACE_COLUMNS, get_terminal_size().columns - 16))


def bar(share: float) -> str:
    """Return a bar of block characters; a `share` of 1 gives the longest bar."""
    eighths = round(max(0.0, min(share, 1.0)) * (strip_columns() - _BAR_LEFT) * 8)
    return "█" * (eighths // 8) + _EIGHTHS[eighths % 8].strip()


def bar_grid() -> Table:
    """Return an empty table with three columns: name, number and picture."""
    grid = Table.grid(padding=(0, 1))
    grid.add_column(justify="right", width=9)
    grid.add_column(justify="right", width=10)
    grid.add_column()
    return grid


def _row(row: dict) -> Text:
    return Text("   ").join(
        Text.assemble((name + " ", "dim"), str(value)) for name, value in row.items()
    )


def _is_felt(touch: Touch) -> bool:
    # During a dark frame the LED is off, and the position of a touch is unknown.
    return touch.touching and not math.isnan(touch.position_um)


def flag_words(touch: Touch) -> list[str]:
    """Return words for the flags that make a reading untrusted, except for `TOO_DARK`."""
    return [word for flag, word in FLAG_WORDS.items() if touch.flags & flag]


def plain(touch: Touch, started_s: float, unit: str = "N") -> str:
    """Return a reading as a line of text, with the time since `started_s` by ``touch.time_s``."""
    time_s = touch.time_s - started_s
    words = " ".join(flag_words(touch))
    if not _is_felt(touch):
        return f"{time_s:8.3f} s  no touch  {words}".rstrip()
    place, force = touch.position_um / 1000, touch.force_mN / 1000
    return f"{time_s:8.3f} s  {place:7.3f} mm  {force:6.3f} {unit}  {words}".rstrip()


class Display(Live):
    """A display that Ctrl-Z leaves with a visible cursor, and that no typed key scrolls."""

    def start(self, refresh: bool = False) -> None:
        """Hide the cursor, and begin to draw."""
        if not self.is_started:
            self._stops = ExitStack()
            self._stops.enter_context(cursor_shown(self.console))
            self._stops.enter_context(typed_ahead.unechoed())
        super().start(refresh)

    def stop(self) -> None:
        """Draw the last picture, and show the cursor."""
        if self.is_started:
            super().stop()
            self._stops.close()


def live(console: Console) -> Live:
    """Return a display that redraws in place with ``update(picture, refresh=True)``."""
    return Display(console=console, auto_refresh=False, transient=False)


@contextmanager
def drawn(wanted: bool) -> Iterator[Live | None]:
    """Yield a display; None if `wanted` is false, or if the output is not a terminal."""
    console = Console()
    with live(console) if wanted and console.is_terminal else nullcontext() as display:
        yield display


class Pace:
    """Limits how often to redraw, so that drawing does not delay readings."""

    def __init__(self, per_s: float = _REDRAWS_PER_S):
        self._every_s = 1 / per_s
        self._next_s = float("-inf")

    def due(self, now_s: float) -> bool:
        """Return whether to redraw at the time `now_s`, in seconds of a clock that never jumps."""
        if now_s < self._next_s:
            return False
        self._next_s = now_s + self._every_s
        return True
