"""Draws how a press becomes a position, in four steps, with the optics of the default sensor."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from spots.common import atomic
from spots_make.drawing import SVG
from spots_sim.strip.files import SensorFile, load
from spots_sim.strip.optics import WAVELENGTH_NM, Optics, decay_per_mm, led_spectrum

from .svg import picture, text

_WIDTH, _HEIGHT = 720, 560
_NEAR_MM, _FAR_MM = 15.0, 60.0  # the two presses of the picture
_PRESSES = ((_NEAR_MM, "near"), (_FAR_MM, "far"))
_CHANNELS = ("F3", "F4", "F5", "F6", "F7", "F8")
_VISIBLE = (WAVELENGTH_NM >= 420) & (WAVELENGTH_NM <= 720)
_STYLE = """<style>
text { font: 13px system-ui, sans-serif; fill: #1d1b19; }
.title { font-weight: 600; font-size: 14px; }
.quiet { fill: #6d6761; }
.axis { stroke: #8d8780; fill: none; }
.near { stroke: #1f7a8c; fill: #1f7a8c; }
.far { stroke: #c22f3a; fill: #c22f3a; }
.line { fill: none; stroke-width: 2.5; }
.clear { fill: #e9edf2; stroke: #8d8780; }
.dyed { fill: #f0b35e; stroke: #8d8780; }
.part { fill: #8d8780; }
.on { fill: #1d1b19; }
.ground { fill: #ffffff; }
@media (prefers-color-scheme: dark) {
  text { fill: #ecebe9; }
  .quiet { fill: #a19e99; }
  .near { stroke: #59bccf; fill: #59bccf; }
  .far { stroke: #ff6a73; fill: #ff6a73; }
  .line { fill: none; }
  .clear { fill: #3a4048; }
  .dyed { fill: #a8702a; }
  .on { fill: #ecebe9; }
  .ground { fill: #1a1a1d; }
}
.near.line, .far.line { fill: none; }
</style>"""


def document() -> str:
    """Return the picture as SVG."""
    sensor = load(SensorFile, "default")
    parts = [*_strip(), *_spectra(sensor), *_counts(sensor), *_contrast(sensor)]
    title = "How a press becomes a position, in four steps"
    return picture(title, _WIDTH, _HEIGHT, _STYLE, parts)


def _head(x: float, y: float, title: str, words: str) -> list[str]:
    return [text(x, y, title, "title"), text(x, y + 18, words, "quiet")]


def _strip() -> list[str]:
    left, mm = 90, 6.0  # x of the sensor's end; units per mm
    right = left + 85 * mm
    parts = _head(
        20,
        30,
        "1. A press lets light cross",
        "Two guides with an air gap between them; a press closes the gap.",
    )
    parts += [
        f'<rect class="clear" x="{left}" y="102" width="{right - left:g}" height="16" rx="3"/>',
        f'<rect class="dyed" x="{left}" y="124" width="{right - left:g}" height="16" rx="3"/>',
        f'<rect class="part" x="{right + 4:g}" y="100" width="56" height="20" rx="3"/>',
        f'<rect class="part" x="{left - 60}" y="122" width="56" height="20" rx="3"/>',
        text(right + 32, 92, "LED", anchor="middle"),
        text(left - 32, 160, "sensor", anchor="middle"),
        text(left, 95, "clear guide"),
        text(right, 158, "dyed guide", anchor="end"),
    ]
    for (place, kind), (up, down) in zip(_PRESSES, ((113, 129), (107, 135))):
        x = left + place * mm
        parts += [
            f'<path class="{kind}" d="M{x:g} 100l-7 -14h14z"/>',
            f'<path class="{kind} line" d="M{right - 4:g} {up}H{x:g}V{down}H{left + 6}"/>',
            f'<path class="{kind}" d="M{left} {down}l10 -4v8z"/>',
            text(x, 78, f"press at {place:g} mm", anchor="middle"),
        ]
    parts.append(text(left + 12, 162, "From the press to the sensor, the dye absorbs blue light."))
    return parts


def _spectra(sensor: SensorFile) -> list[str]:
    x0, y0, width, height = 40, 350, 290, 110
    parts = _head(
        20, 200, "2. The dye changes its colour", "Light at the sensor by wavelength, equal forces."
    )
    lamp = led_spectrum(sensor.led)[_VISIBLE]
    decay = decay_per_mm(sensor.dye)[_VISIBLE]
    nm = WAVELENGTH_NM[_VISIBLE]
    most = (lamp * np.exp(-decay * _NEAR_MM)).max()
    for place, kind in _PRESSES:
        light = lamp * np.exp(-decay * place) / most
        points = " ".join(
            f"{x0 + width * (at - nm[0]) / (nm[-1] - nm[0]):.1f},{y0 - height * share:.1f}"
            for at, share in zip(nm, light)
        )
        parts.append(f'<polyline class="{kind} line" points="{points}"/>')
    parts += [
        f'<path class="axis" d="M{x0} {y0 - height}V{y0}H{x0 + width}"/>',
        text(x0, y0 + 18, "420 nm"),
        text(x0 + width, y0 + 18, "720 nm", anchor="end"),
    ]
    return parts


def _counts_of(sensor: SensorFile, place_mm: float) -> np.ndarray:
    optics = Optics(sensor)
    rates = optics.narrow(np.array([place_mm]))[0]
    return np.array([rates[optics.names.index(name)] for name in _CHANNELS])


def _counts(sensor: SensorFile) -> list[str]:
    x0, y0, step, height = 400, 350, 48, 110
    parts = _head(380, 200, "3. Six channels count it", "Logarithm of the counts, F3 to F8.")
    counts = {kind: _counts_of(sensor, place) for place, kind in _PRESSES}
    logs = {kind: np.log2(of) for kind, of in counts.items()}
    top = max(one.max() for one in logs.values())
    bottom = min(one.min() for one in logs.values()) - 0.5
    for i, name in enumerate(_CHANNELS):
        for j, (kind, of) in enumerate(logs.items()):
            tall = height * (of[i] - bottom) / (top - bottom)
            parts.append(
                f'<rect class="{kind}" x="{x0 + i * step + 17 * j}" y="{y0 - tall:.1f}" '
                f'width="14" height="{tall:.1f}"/>'
            )
        parts.append(text(x0 + i * step + 15, y0 + 18, name, anchor="middle"))
    parts.append(f'<path class="axis" d="M{x0 - 6} {y0}H{x0 + 6 * step - 8}"/>')
    return parts


def _contrast(sensor: SensorFile) -> list[str]:
    x0, y0, width, height = 90, 530, 330, 90
    parts = _head(
        20,
        405,
        "4. Ratios give the position, brightness gives the force",
        "A harder press raises all six bars alike: their ratios, and the position, stay.",
    )
    places = np.linspace(5, 80, 40)
    ratio = np.array([np.log2(one[-1] / one[1]) for one in (_counts_of(sensor, x) for x in places)])
    low, high = ratio.min(), ratio.max()

    def at(place: float, value: float) -> tuple[float, float]:
        return x0 + width * place / 85, y0 - height * (value - low) / (high - low)

    points = " ".join("{:.1f},{:.1f}".format(*at(x, v)) for x, v in zip(places, ratio))
    parts.append(f'<polyline class="axis line" points="{points}"/>')
    for place, kind in _PRESSES:
        one = _counts_of(sensor, place)
        x, y = at(place, np.log2(one[-1] / one[1]))
        parts += [
            f'<path class="{kind} line" stroke-dasharray="3 3" d="M{x0} {y:.1f}H{x:.1f}V{y0}"/>',
            f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="5"/>',
            text(x, y0 + 17, f"{place:g} mm", anchor="middle"),
        ]
    parts += [
        f'<path class="axis" d="M{x0} {y0 - height}V{y0}H{x0 + width}"/>',
        text(x0 - 6, y0 - height + 30, "log F8/F4", anchor="end"),
        text(x0 + width + 30, y0 - 62, "position: a weighted sum of the six"),
        text(x0 + width + 30, y0 - 44, "logarithms, weights adding up to 0"),
        text(x0 + width + 30, y0 - 18, "force: another sum of the six,"),
        text(x0 + width + 30, y0, "weights adding up to 1"),
    ]
    return parts


def main(folder: Path = Path(__file__).parents[1] / "pictures") -> None:
    """Draw press.svg, and print its path."""
    path = folder / "press.svg"
    atomic.write_text(document(), path, SVG)
    print(path)


if __name__ == "__main__":
    main()
