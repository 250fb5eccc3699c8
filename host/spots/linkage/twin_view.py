"""A linkage in the terminal: bars, where its terminal has been, and what is known of it."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from itertools import groupby

from rich.console import Group
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from ..errors import printable
from ..link.frames import LinkStats
from .digital_twin import Terminal, Twin

_COLUMNS, _ROWS = 74, 20
_ACROSS, _DOWN = 2 * _COLUMNS, 4 * _ROWS  # dots
# Of a braille character, by column and row.
_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
_BRAILLE = 0x2800

Point = tuple[float, float]


class TwinView:
    """The picture of a twin; its frame grows with what was seen.

    Parameters
    ----------
    twin : Twin
    names : list of str
        Of the ports.
    """

    def __init__(self, twin: Twin, names: list[str]):
        self._twin = twin
        self._title = f"SPOTS twin  {' · '.join(names)}"
        self._low, self._high = (math.inf, math.inf), (-math.inf, -math.inf)

    def picture(self, stats: list[LinkStats], now_s: float) -> Panel:
        """Return the picture at a time.

        Parameters
        ----------
        stats : list of LinkStats
            One for each board.
        now_s : float
            In seconds by the clock of the readings.

        Returns
        -------
        rich.panel.Panel
        """
        trail = self._twin.trail
        last = trail[-1] if trail else None
        path = [(t.x_mm, t.y_mm) for t in trail if not t.limit]
        bars = _outline(self._twin, last) if last else []
        self._see([*path, *(point for bar in bars for point in bar)])
        remark = self._twin.silence(now_s) or (last.remark if last else "")
        parts = [self._plot(path, bars, last), _numbers(last, remark), _facts(stats)]
        return Panel(
            Group(*parts), title=Text(printable(self._title)), width=_COLUMNS + 6, padding=(0, 2)
        )

    def _see(self, points: Iterable[Point]) -> None:
        for point in points:
            self._low = tuple(map(min, self._low, point))
            self._high = tuple(map(max, self._high, point))

    def _plot(self, path: list[Point], bars: list[list[Point]], last: Terminal | None) -> Text:
        drawn = [point for bar in bars for point in _filled(bar, self._scale())]
        quiet, lit = self._cells(drawn), self._cells(path)
        at = None
        if last and not last.limit:
            column, row = self._dot((last.x_mm, last.y_mm))
            at = column // 2, row // 4
        text = Text()
        for row in range(_ROWS):
            signs = [_sign((column, row), at, lit, quiet) for column in range(_COLUMNS)]
            # Runs of one style: a style for each character would take most of the time.
            for style, run in groupby(signs, key=lambda sign: sign[1]):
                text.append("".join(character for character, _ in run), style=style)
            text.append("\n")
        return text

    def _cells(self, points: list[Point]) -> dict[tuple[int, int], int]:
        """Return the dots of each character that has some."""
        cells: dict[tuple[int, int], int] = defaultdict(int)
        for column, row in map(self._dot, points):
            cells[column // 2, row // 4] |= _DOTS[column % 2][row % 4]
        return cells

    def _scale(self) -> float:
        """Return dots per mm."""
        spans = [high - low for low, high in zip(self._low, self._high)]
        room = (_ACROSS - 1, _DOWN - 1)
        return min((dots / mm for dots, mm in zip(room, spans) if mm > 0), default=1.0)

    def _dot(self, point: Point) -> tuple[int, int]:
        scale = self._scale()
        middle_mm = (self._low[0] + self._high[0]) / 2
        column = round((_ACROSS - 1) / 2 + (point[0] - middle_mm) * scale)
        row = round(_DOWN - 1 - (point[1] - self._low[1]) * scale)
        return min(max(column, 0), _ACROSS - 1), min(max(row, 0), _DOWN - 1)


def _sign(cell: tuple[int, int], at, lit: dict, quiet: dict) -> tuple[str, str]:
    """Return what stands at a place of the picture, and its style."""
    if cell == at:
        return "●", "bold red"
    dots = lit.get(cell) or quiet.get(cell)
    return chr(_BRAILLE + dots) if dots else " ", "cyan" if cell in lit else "dim"


def _outline(twin: Twin, terminal: Terminal) -> list[list[Point]]:
    """Return both arms, from joint to elbow, and on to the terminal if there is one."""
    inner1, _, _, inner2 = twin.linkage.bar_mm
    base_mm = twin.linkage.base_mm
    a, b = terminal.theta_rad
    elbows = (
        (inner1 * math.sin(a), inner1 * math.cos(a)),
        (base_mm - inner2 * math.sin(b), inner2 * math.cos(b)),
    )
    ends = [] if terminal.limit else [(terminal.x_mm, terminal.y_mm)]
    return [[(0.0, 0.0), elbows[0], *ends], [(base_mm, 0.0), elbows[1], *ends]]


def _filled(corners: list[Point], dots_per_mm: float) -> list[Point]:
    """Return points along the lines between corners, a dot apart."""
    found = []
    for (x, y), (to_x, to_y) in zip(corners, corners[1:]):
        count = max(math.ceil(math.hypot(to_x - x, to_y - y) * dots_per_mm), 1)
        shares = [i / count for i in range(count + 1)]
        found += [(x + share * (to_x - x), y + share * (to_y - y)) for share in shares]
    return found


def _numbers(last: Terminal | None, remark: str) -> Table:
    grid = Table.grid(padding=(0, 2, 0, 0))
    grid.add_column(justify="right", style="dim")
    grid.add_column()
    where = error = speed = joints = "-"
    if last is not None:
        joints = "  ".join(f"{math.degrees(angle):.2f}°" for angle in last.theta_rad)
        if not last.limit:
            major, minor, angle = last.ellipse
            where = f"{last.x_mm:.2f}  {last.y_mm:.2f} mm"
            error = f"{major:.3f} x {minor:.3f} mm at {math.degrees(angle):.0f}°, one sigma"
        if last.velocity_mm_s is not None:
            x, y = last.velocity_mm_s
            speed = f"{x:.1f}  {y:.1f} mm/s, {math.hypot(x, y):.1f} in all"
    grid.add_row("terminal", Text(where, style="bold"))
    grid.add_row("uncertainty", error)
    grid.add_row("velocity", speed)
    grid.add_row("joints", joints)
    grid.add_row("", Text(remark, style="yellow"))
    return grid


def _facts(stats: list[LinkStats]) -> Text:
    parts = [
        f"joint {i}: frames {one.frames}, lost {one.lost}, bad {one.bad_crc}"
        for i, one in enumerate(stats, 1)
    ]
    return Text("   ".join(parts), style="dim")
