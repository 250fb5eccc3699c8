"""Draws the moving picture of a strip: a finger, the measured press, and the light of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from string import Template
from typing import NamedTuple

_LEFT, _WIDE = 40, 600  # the strip in the picture
_TOP = 96
_FIRST_S = 3.2  # of the run: a picture that does not move shows this moment
_FORCE_MAX_N = 8.0
_BAR_HIGH = 90
_COLOURS = "#3b6fd4", "#1c9a8b", "#5aa02c", "#b99a00", "#d9731a", "#c23b3b"
_PICTURE = Template("""\
<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 860 250" role="img"
  font-family="system-ui, 'DejaVu Sans', sans-serif" font-size="14">
  <title>A finger presses and slides on a simulated strip; a mark shows the measured position, \
bars show force and light</title>
  <style>
    .card { fill: #ffffff; } text { fill: #1f2430; } .line { stroke: #8a93a3; }
    @media (prefers-color-scheme: dark) {
      .card { fill: #14181f; } text { fill: #e6e9ef; }
    }
    .moves { animation-duration: ${seconds}s; animation-iteration-count: infinite;
      animation-timing-function: linear; animation-delay: -${first}s; transform-box: view-box; }
    @media (prefers-reduced-motion: reduce) { .moves { animation-play-state: paused; } }
$keyframes
  </style>
  <defs><linearGradient id="dye"><stop offset="0" stop-color="#f6d9d3"/>
    <stop offset="1" stop-color="#c8321e"/></linearGradient></defs>
  <rect class="card" width="860" height="250" rx="10"/>
  <g class="moves" style="animation-name: finger">
    <ellipse cx="0" cy="68" rx="15" ry="24" fill="#d9a077" stroke="#8d5a3a"/></g>
  <rect x="$left" y="$top" width="$wide" height="22" rx="5" fill="url(#dye)" stroke="#7c2a1d"/>
  <g class="moves" style="animation-name: measured">
    <path d="M0 122 l-8 14 h16 z" fill="#2f7de1"/></g>
$ticks
  <text x="$left" y="196">measured position in mm, 0 at the sensor</text>
  <text x="$left" y="222" font-size="12">\
real firmware on a simulated sensor, 100 readings a second</text>
  <text x="676" y="28">force</text>
  <rect x="682" y="$bar_top" width="24" height="$bar_high" fill="none" class="line"/>
  <g class="moves" style="animation-name: force; transform-origin: 0 ${bar_end}px">
    <rect x="682" y="$bar_top" width="24" height="$bar_high" fill="#2f7de1"/></g>
  <text x="676" y="196">$force_max N</text>
  <text x="740" y="28">light</text>
$bars
  <text x="740" y="196">six colours,</text>
  <text x="740" y="214">√ counts</text>
</svg>
""")


class Moment(NamedTuple):
    """A moment of the run.

    Attributes
    ----------
    time_s : float
    finger_mm : float or None
        True position of the finger; None without a finger.
    place_mm : float or None
        Measured position; None without a trusted touch.
    force_N : float
        Measured force.
    light : sequence of float
        Height of each channel's bar, from 0 to 1.
    """

    time_s: float
    finger_mm: float | None
    place_mm: float | None
    force_N: float
    light: Sequence[float]


def picture(moments: list[Moment], length_mm: float) -> str:
    """Return the picture as SVG; it repeats the moments without end.

    Parameters
    ----------
    moments : list of Moment
        At equal intervals.
    length_mm : float
        Length of the strip.

    Returns
    -------
    str
    """

    def x(place_mm: float) -> float:
        return _LEFT + _WIDE * place_mm / length_mm

    def along(place: Callable[[Moment], float | None], lift: float) -> Callable[[int], str]:
        def style(index: int) -> str:
            now = place(moments[index])
            # Between two touches, the next place: it does not slide there while it is visible.
            later = (place(one) for one in moments[index:] + moments[:index])
            at = next(one for one in later if one is not None)
            up = 0 if now is not None else lift
            return (
                f"transform: translate({x(at):.0f}px, {up:.0f}px); opacity: {int(now is not None)}"
            )

        return style

    frames = {
        "finger": along(lambda one: one.finger_mm, -20),
        "measured": along(lambda one: one.place_mm, 0),
        "force": lambda i: f"transform: scaleY({min(1, moments[i].force_N / _FORCE_MAX_N):.3f})",
    }
    for channel in range(len(_COLOURS)):
        frames[f"light{channel}"] = lambda i, c=channel: (
            f"transform: scaleY({max(0.0, moments[i].light[c]):.3f})"
        )
    top = _TOP - _BAR_HIGH // 2
    bars = (
        f'  <g class="moves" style="animation-name: light{channel}; '
        f'transform-origin: 0 {top + _BAR_HIGH}px">'
        f'<rect x="{740 + 15 * channel}" y="{top}" width="12" height="{_BAR_HIGH}" '
        f'fill="{colour}"/></g>'
        for channel, colour in enumerate(_COLOURS)
    )
    ticks = (
        f'  <text x="{x(mm):.0f}" y="164" text-anchor="middle">{mm}</text>'
        for mm in range(0, int(length_mm) + 1, 20)
    )
    keyframes = (_keyframes(name, style, len(moments)) for name, style in frames.items())
    return _PICTURE.substitute(
        seconds=f"{len(moments) * (moments[1].time_s - moments[0].time_s):g}",
        keyframes="\n".join(keyframes),
        ticks="\n".join(ticks),
        bars="\n".join(bars),
        first=_FIRST_S,
        left=_LEFT,
        wide=_WIDE,
        top=_TOP,
        bar_top=top,
        bar_high=_BAR_HIGH,
        bar_end=top + _BAR_HIGH,
        force_max=f"{_FORCE_MAX_N:g}",
    )


def _keyframes(name: str, style: Callable[[int], str], count: int) -> str:
    """Return the keyframes of an element; what does not change is left out."""
    styles = [style(index) for index in range(count)]
    parts = [
        f"{100 * i / count:.4g}% {{ {styles[i]} }}"
        for i in range(count)
        if i in (0, count - 1) or not styles[i - 1] == styles[i] == styles[i + 1]
    ]
    return f"    @keyframes {name} {{ {' '.join(parts)} 100% {{ {styles[0]} }} }}"
