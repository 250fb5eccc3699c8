"""Drawings of a strip and its moulds as SVG with dimensions. Needs manifold3d (extra ``moulds``).

The outlines are cuts through the solids of mould.py, so they cannot differ from the STL files.
Each dimension has its name and its value in mm as the attributes ``data-name`` and ``data-mm``.
"""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import escape

from spots.common import atomic

from . import shape as dims
from .assembly import assembly, castings, closed
from .mould import parts
from .shape import StripShape

_STYLE = """
text { font: 12px sans-serif; fill: #222; }
.title { font-weight: bold; font-size: 15px; }
.dimension line { stroke: #222; stroke-width: 0.8; }
.extension { stroke: #999 !important; }
.leader { stroke: #222; stroke-width: 0.6; }
path { stroke: #222; stroke-width: 0.8; fill-rule: evenodd; }
"""
_FILLS = {
    "support": "#6b6b6b",
    "clear": "#d6ecff",
    "dyed": "#e8837b",
    "board": "#4d9b6a",
    "chip": "#222222",
    "sensor_cap": "#c9c4b8",
    "led_cap": "#c9c4b8",
    "sensor_lid": "#b0aa9b",
    "base": "#e6e2d8",
    "led": "#fff3b0",
    "tray": "#e6e2d8",
    "lid": "#c9c4b8",
}
_TICK = 4.0
_JUST_ABOVE = 0.1  # mm
_MARGIN = 40.0
_WIDTH = 1000.0
SVG = atomic.begins("an SVG picture", b"<svg", b"<?xml")
_NOTE = (
    f"All lengths in mm. Draft {dims.DRAFT_DEG:g} deg; widths are those of the wide faces. "
    "The paper gives 3 x 12 (strip) and 8 x 1 (guides); the other dimensions are not tried."
)


class _Sheet:
    """A sheet of a drawing: elements of an SVG, in pixels."""

    def __init__(self):
        self.height = 0.0
        self.elements: list[str] = []

    def end(self, height: float) -> _Sheet:
        """Set the height of the sheet in pixels; write the standard note at its lower edge."""
        self.height = height
        self.text(_MARGIN, height - 14, _NOTE)
        return self

    def text(self, x: float, y: float, text: str, anchor: str = "start", style: str = "") -> None:
        self.elements.append(
            f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" class="{style}">'
            f"{escape(text)}</text>"
        )

    def title(self, y: float, text: str) -> None:
        self.text(_MARGIN, y, text, style="title")

    def line(self, x1: float, y1: float, x2: float, y2: float, style: str = "") -> None:
        ends = f'x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
        self.elements.append(f'<line {ends} class="{style}"/>')

    def write(self, path: Path) -> Path:
        width, height = _WIDTH, self.height
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
            f'width="{width:g}" height="{height:g}">'
        )
        parts = [
            head,
            f"<style>{_STYLE}</style>",
            '<rect width="100%" height="100%" fill="white"/>',
        ]
        atomic.write_text("\n".join([*parts, *self.elements, "</svg>"]) + "\n", path, SVG)
        return path


class _View:
    """A view on a sheet, with its scale and origin. Coordinates u and v are in mm, v upwards."""

    def __init__(self, sheet: _Sheet, x: float, y: float, scale: float):
        self._sheet, self._x, self._y, self._scale = sheet, x, y, scale

    def at(self, u: float, v: float) -> tuple[float, float]:
        return self._x + u * self._scale, self._y - v * self._scale

    def outline(self, section, fill: str) -> None:
        """Draw the outline of `section`, a `manifold3d.CrossSection`; `fill` names its colour."""
        paths = []
        for polygon in section.to_polygons():
            points = " L".join("{:.2f} {:.2f}".format(*self.at(u, v)) for u, v in polygon)
            paths.append(f"M{points} Z")
        if paths:
            self._sheet.elements.append(f'<path d="{" ".join(paths)}" fill="{_FILLS[fill]}"/>')

    def across(self, name: str, u1: float, u2: float, v: float, off: float, what: str = "") -> None:
        """Draw the horizontal dimension `name` from `u1` to `u2`, `off` pixels below `v`.

        `what` is a text beside its value.
        """
        (x1, y), (x2, _) = self.at(u1, v), self.at(u2, v)
        self._dimension(name, (x1, y), (x2, y), (0, off), abs(u2 - u1), what)

    def upright(
        self, name: str, v1: float, v2: float, u: float, off: float, what: str = ""
    ) -> None:
        """Draw the vertical dimension `name` from `v1` to `v2`, `off` pixels right of `u`.

        `what` is a text beside its value.
        """
        (x, y1), (_, y2) = self.at(u, v1), self.at(u, v2)
        self._dimension(name, (x, y1), (x, y2), (off, 0), abs(v2 - v1), what)

    def _dimension(self, name, a, b, off, mm: float, what: str) -> None:
        sheet = self._sheet
        (dx, dy), (ax, ay), (bx, by) = off, a, b
        sheet.elements.append(f'<g class="dimension" data-name="{name}" data-mm="{mm:.4g}">')
        for x, y in (a, b):
            sheet.line(x, y, x + dx, y + dy, "extension")
        ax, ay, bx, by = ax + dx, ay + dy, bx + dx, by + dy
        sheet.line(ax, ay, bx, by)
        for x, y in ((ax, ay), (bx, by)):
            sheet.line(x - _TICK, y + _TICK, x + _TICK, y - _TICK)
        text = f"{what} {mm:.4g}".strip()
        if dx:
            side = 1 if dx > 0 else -1
            sheet.text(ax + side * 7, (ay + by) / 2 + 4, text, "start" if side > 0 else "end")
        else:
            sheet.text((ax + bx) / 2, ay + (16 if dy > 0 else -7), text, "middle")
        sheet.elements.append("</g>")

    def note(self, u: float, v: float, dx: float, dy: float, text: str) -> None:
        """Write a text (dx, dy) pixels from the point (u, v); draw a line from text to point."""
        x, y = self.at(u, v)
        self._sheet.line(x, y, x + dx, y + dy, "leader")
        right = dx >= 0
        self._sheet.text(
            x + dx + (4 if right else -4), y + dy + 4, text, "start" if right else "end"
        )


def write(shape: StripShape, folder: Path) -> list[Path]:
    """Draw a strip into ``section.svg``, ``assembly.svg`` and ``moulds.svg`` of a folder."""
    made, placed = parts(shape), assembly(shape)
    return [
        _section(shape, placed).write(folder / "section.svg"),
        _assembled(shape, placed).write(folder / "assembly.svg"),
        _moulds(shape, made).write(folder / "moulds.svg"),
    ]


def _across(solid, x: float = 0.0):
    """Cut a solid across its length at `x`; the result has y to the right and z upwards."""
    return solid.translate((-x, 0, 0)).rotate((0, -90, 0)).rotate((0, 0, -90)).slice(0)


def _along(solid, y: float = 0.0):
    """Cut a solid along its length at `y`; the result has x to the right and z upwards."""
    return solid.translate((0, -y, 0)).rotate((-90, 0, 0)).slice(0)


def _section(shape: StripShape, placed: dict) -> _Sheet:
    sheet = _Sheet()
    sheet.title(30, "Strip, cut across its middle")
    view = _View(sheet, _WIDTH / 2, 250, 36)
    for name in ("support", "dyed", "clear"):
        view.outline(_across(placed[name]), name)
    half, guide = dims.STRIP_WIDTH / 2, dims.GUIDE_WIDTH / 2
    high = dims.STRIP_THICKNESS - dims.GUIDE_THICKNESS
    view.across("strip_width", -half, half, dims.STRIP_THICKNESS, -62)
    view.across("guide_width", -guide, guide, dims.STRIP_THICKNESS, -30)
    view.across("guide_width", -guide, guide, 0, 30)
    view.across(
        "gap_width", -dims.GAP_WIDTH / 2, dims.GAP_WIDTH / 2, dims.GUIDE_THICKNESS, 104, "air gap"
    )
    view.upright("strip_thickness", 0, dims.STRIP_THICKNESS, -half, -60)
    view.upright("guide_thickness", high, dims.STRIP_THICKNESS, half, 30)
    view.upright("gap_height", dims.GUIDE_THICKNESS, high, half, 30, "gap")
    view.upright("guide_thickness", 0, dims.GUIDE_THICKNESS, half, 30)
    view.note(2.6, 2.6, 130, -105, "clear guide, polyurethane")
    view.note(2.6, 0.4, 130, 80, "dyed guide, polyurethane with red pigment")
    view.note(-5.2, 1.5, -60, 100, "support, black silicone")
    return sheet.end(400)


def _assembled(shape: StripShape, placed: dict) -> _Sheet:
    sheet = _Sheet()
    sheet.title(30, f"Strip of {shape.length_mm:g} mm on its base, cut along its middle")
    low, high = placed["sensor_lid"].bounding_box()[0], placed["led_cap"].bounding_box()[3]
    above, below = placed["sensor_cap"].bounding_box()[5], -shape.base_mm
    scale = min((_WIDTH - 2 * _MARGIN) / (high - low), 12)
    view = _View(sheet, _WIDTH / 2 - (low + high) / 2 * scale, 80 + above * scale, scale)
    _draw(view, placed)
    x, end = shape.length_mm / 2, shape.support_mm / 2
    view.across("length", -x, x, above, -20, "measured length")
    view.across("support_length", -end, end, below, 26, "support")
    view.across("guide_length", -end - dims.BEYOND, end, below, 58, "dyed guide")
    view.across("overall_length", low, high, below, 90, "overall")
    top = 80 + (above - below) * scale + 150
    top = _sensor_end(sheet, shape, placed, top)
    return sheet.end(_led_end(sheet, shape, placed, top))


def _sensor_end(sheet: _Sheet, shape: StripShape, placed: dict, top: float) -> float:
    """Draw the sensor's end of a strip below `top`; return the lower edge, both in pixels."""
    sheet.title(top, "The sensor's end")
    end, detail = -shape.length_mm / 2, 12.0
    above = placed["sensor_cap"].bounding_box()[5]
    view = _View(sheet, 480 - end * detail, top + 60 + above * detail, detail)
    _draw(view, placed, (end - 30, end + 10))
    inner = end - dims.END_LENGTH - dims.SEPTUM
    view.upright("base_height", -shape.base_mm, 0, end + 10, 40, "base")
    view.across("end_length", end - dims.END_LENGTH, end, above, -20, "end")
    view.across("septum", inner, end - dims.END_LENGTH, above, -50, "wall")
    view.across("parts_height", inner - dims.PARTS_HEIGHT, inner, above, -20, "parts")
    chip = placed["chip"].bounding_box()[3]
    below = -shape.base_mm
    view.across("chip_gap", chip, chip + dims.CHIP_GAP, below, 30, "gap to the chip")
    view.note(end + 6, 2.7, 160, -80, "clear guide, ends at the wall")
    view.note(end + 6, 1.5, 160, -30, "air gap")
    view.note(end + 6, 0.5, 160, 20, "dyed guide, ends before the chip")
    view.note(end - 2, 1.5, 200, -120, "the support closes the gap")
    view.note(inner - dims.PARTS_HEIGHT - 0.8, 6, -130, -20, "breakout")
    view.note(inner - dims.PARTS_HEIGHT - 2.8, 2, -95, 0, "lid, with black foam")
    return view.at(0, below)[1] + 90


def _led_end(sheet: _Sheet, shape: StripShape, placed: dict, top: float) -> float:
    """Draw the LED's end of a strip below `top`; return the lower edge, both in pixels."""
    sheet.title(top, "The LED's end")
    end, detail = shape.length_mm / 2, 12.0
    above = placed["led_cap"].bounding_box()[5]
    view = _View(sheet, 480 - end * detail, top + 60 + above * detail, detail)
    _draw(view, placed, (end - 10, end + 30))
    wall = end + dims.END_LENGTH + dims.BEYOND
    middle, hole = dims.STRIP_THICKNESS - dims.GUIDE_THICKNESS / 2, dims.LED_DIAMETER / 2
    view.across("led_depth", wall, wall + dims.LED_DEPTH, above, -20, "for the LED")
    view.across("end_length", end, end + dims.END_LENGTH, above, -20, "end")
    view.across("beyond", end + dims.END_LENGTH, wall, above, -50, "wall")
    view.upright("led_diameter", middle - hole, middle + hole, wall + dims.LED_DEPTH, 40, "LED")
    view.note(end - 4, 2.5, -160, -60, "clear guide, touches the LED")
    view.note(end - 4, 0.5, -160, 20, "dyed guide, ends at the wall")
    view.note(end - 5, -5, -160, 40, "base")
    return view.at(0, -shape.base_mm)[1] + 50


def _draw(view: _View, placed: dict, span: tuple[float, float] | None = None) -> None:
    from manifold3d import Manifold

    for name, solid in placed.items():
        if span is not None:
            room = Manifold.cube((span[1] - span[0], 100, 100), True)
            solid = solid ^ room.translate(((span[0] + span[1]) / 2, 0, 0))
        view.outline(_along(solid), name)


def _moulds(shape: StripShape, made: dict) -> _Sheet:
    sheet = _Sheet()
    for top, name, depth, cast, what in (
        (30, "guides", dims.GUIDE_THICKNESS, "clear", "Mould of both guides"),
        (630, "support", dims.STRIP_THICKNESS, "support", "Mould of the support"),
    ):
        tray, lid = made[f"{name}_tray"], made[f"{name}_lid"]
        sheet.title(top, f"{what}, closed, cut across its middle")
        x0, y0, _, x1, y1, _ = tray.bounding_box()
        castings_ = castings(tray, lid, depth)
        view = _View(sheet, _WIDTH / 2, top + 220, 16)
        view.outline(_across(tray), "tray")
        view.outline(_across(closed(tray, lid, depth) - tray), "lid")
        for solid in castings_:
            view.outline(_across(solid), cast)
        a0, b0, _, a1, b1, _ = castings_[0].bounding_box()
        view.across(f"{name}_cavity_width", b0, b1, dims.FLOOR + depth, -90, "cavity")
        view.across(f"{name}_tray_width", y0, y1, 0, 26, "tray")
        view.upright(f"{name}_cavity_depth", dims.FLOOR, dims.FLOOR + depth, y1, 30, "cavity")
        view.upright(f"{name}_floor", 0, dims.FLOOR, y1, 30, "floor")
        view.upright(
            f"{name}_lid", dims.FLOOR + depth, dims.FLOOR + depth + dims.LID, y1, 30, "lid"
        )
        sheet.title(top + 300, "The tray from above: cavity, grooves, pins, slots to lever it open")
        scale = min((_WIDTH - 2 * _MARGIN) / (x1 - x0), 170 / (y1 - y0))
        plan = _View(sheet, _WIDTH / 2, top + 410, scale)
        plan.outline(tray.project(), "tray")
        plan.outline(tray.slice(dims.FLOOR + depth / 2), "lid")  # with the core of the air gap
        plan.outline(tray.slice(dims.FLOOR + depth - dims.GROOVE_DEPTH / 2), "lid")
        plan.outline(tray.slice(dims.FLOOR + depth + _JUST_ABOVE), "chip")
        plan.across(f"{name}_cavity_length", a0, a1, y0, 24, "cavity")
        plan.across(f"{name}_tray_length", x0, x1, y0, 54, "tray")
    return sheet.end(1260)
