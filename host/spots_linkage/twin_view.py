"""Picture of a linkage as text: its bars, and the path, position and error of its end point."""

import math
from itertools import groupby, pairwise

import numpy as np
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from spots.link.frames import LinkStats
from spots.terminal.view import framed

from .digital_twin import Terminal, Twin

_COLUMNS, _ROWS = 74, 20  # characters of the plot
# A braille character has 4 rows and 2 columns of dots; these are the bits of its code.
_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
_BRAILLE = 0x2800
_LAST_DOT = np.array([4 * _ROWS - 1, 2 * _COLUMNS - 1])


class TwinView:
    """Draws a digital twin in a plot whose range grows to contain all points that were drawn.

    `names` are those of the ports, for the title.
    """

    def __init__(self, twin: Twin, names: list[str]):
        self._twin = twin
        self._title = f"SPOTS twin  {' · '.join(names)}"
        self._frame = np.empty((0, 2))  # lower left and upper right corner of the plot, in mm

    def picture(self, stats: list[LinkStats], now_s: float) -> Panel:
        """Return the picture of the digital twin at its newest position.

        `now_s` is by the clock of `Touch.time_s`: the picture warns of a joint that has had no
        angle for 3 s.
        """
        trail = self._twin.trail
        last = trail[-1] if trail else None
        path = np.array([(t.x_mm, t.y_mm) for t in trail if not t.limit]).reshape(-1, 2)
        bars = _outline(self._twin, last) if last else []
        seen = np.concatenate([self._frame, path, *bars])
        self._frame = np.array([seen.min(axis=0), seen.max(axis=0)]) if len(seen) else seen
        remark = self._twin.silence(now_s) or (last.remark if last else "")
        parts = [self._plot(path, bars, last), _numbers(last, remark), _facts(stats)]
        return framed(parts, self._title, _COLUMNS + 6, rows=0)

    def _plot(self, path: np.ndarray, bars: list[np.ndarray], last: Terminal | None) -> Text:
        lit = self._cells(path)
        quiet = self._cells(
            *(_filled(ends, self._scale()) for bar in bars for ends in pairwise(bar))
        )
        dots = np.where(lit > 0, lit, quiet)
        codes = np.where(dots > 0, _BRAILLE + dots, ord(" "))
        styles = np.where(lit > 0, "cyan", "dim").astype(object)
        if last and not last.limit:
            at = tuple(self._dots(np.array([last.x_mm, last.y_mm])) // _DOTS.shape)
            codes[at], styles[at] = ord("●"), "bold red"
        text = Text()
        for row in zip(codes, styles):
            # Characters of one style together: one style per character takes most of the time.
            for style, run in groupby(zip(*row), key=lambda cell: cell[1]):
                text.append("".join(chr(code) for code, _ in run), style=style)
            text.append("\n")
        return text

    def _cells(self, *lines: np.ndarray) -> np.ndarray:
        """Draw lines; return each character's braille dots as bits, shape (rows, columns).

        A line is an array of points in mm, shape (n, 2).
        """
        dots = np.zeros(_LAST_DOT + 1, int)
        for points in lines:
            if len(points):
                dots[tuple(self._dots(points).T)] = 1
        return np.einsum("rick,ik->rc", dots.reshape(_ROWS, 4, _COLUMNS, 2), _DOTS)

    def _scale(self) -> float:
        """Return the scale of the plot in braille dots per mm."""
        spans = zip(_LAST_DOT[::-1], np.ptp(self._frame, axis=0))
        return min((dots / mm for dots, mm in spans if mm > 0), default=1.0)

    def _dots(self, points: np.ndarray) -> np.ndarray:
        """Return row and column of the braille dot of each point; `points` are in mm."""
        low, high = self._frame
        x_mm, y_mm = (points - [(low[0] + high[0]) / 2, low[1]]).T * self._scale()
        dots = np.stack([_LAST_DOT[0] - y_mm, _LAST_DOT[1] / 2 + x_mm], axis=-1)
        return np.clip(np.rint(dots).astype(int), 0, _LAST_DOT)


def _outline(twin: Twin, terminal: Terminal) -> list[np.ndarray]:
    """Return the corners of each arm in mm, shape (n, 2): joint, elbow and, if known, end point.

    The elbows are computed from the joint angles in `terminal`.
    """
    inner1, _, _, inner2 = twin.linkage.bar_mm
    base_mm = twin.linkage.base_mm
    a, b = terminal.theta_rad
    elbow1 = inner1 * math.sin(a), inner1 * math.cos(a)
    elbow2 = base_mm - inner2 * math.sin(b), inner2 * math.cos(b)
    ends = [] if terminal.limit else [(terminal.x_mm, terminal.y_mm)]
    return [np.array([(0.0, 0.0), elbow1, *ends]), np.array([(base_mm, 0.0), elbow2, *ends])]


def _filled(ends: tuple[np.ndarray, np.ndarray], dots_per_mm: float) -> np.ndarray:
    """Return points in mm along the line between two points, one for each dot to draw.

    `ends` are the two points, and `dots_per_mm` is the scale of the plot.
    """
    return np.linspace(*ends, math.ceil(math.dist(*ends) * dots_per_mm) + 1)


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
            speed = f"{x:.1f}  {y:.1f} mm/s, {math.hypot(x, y):.1f} total"
    grid.add_row("end point", Text(where, style="bold"))
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
