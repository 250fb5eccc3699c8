"""Moulds, caps and base of a strip as closed meshes. Needs manifold3d and trimesh.

Each part lies as it is printed: with its lower face at z = 0, and without overhangs except short
bridges. A mould is a tray and a lid. The tray's pins fit the lid in one orientation only.
"""

from __future__ import annotations

import os
import struct
from importlib.util import find_spec
from pathlib import Path

from spots.common import atomic
from spots.errors import FileError, missing

from . import shape as dims
from .shape import StripShape

# A binary STL file: a header of 80 bytes, the number of triangles, and 50 bytes for each of them.
_HEAD, _TRIANGLE = struct.Struct("<80xI"), 50
_ROUND = 48  # sides of a circle
_CUT = 1.0  # a cut reaches this far out of the surface that it opens


def require() -> None:
    """Raise SpotsError if manifold3d or trimesh is not installed."""
    for package in ("manifold3d", "trimesh"):
        if find_spec(package) is None:
            raise missing("making moulds needs", package, "moulds")


def parts(shape: StripShape) -> dict:
    """Return the printed parts of a strip: closed solids in mm, by the names of their STL files."""
    guides, support = _cavities_y(2, dims.GUIDE_WIDTH), _cavities_y(1, dims.STRIP_WIDTH)
    return {
        "guides_tray": _guide_tray(shape.guide_mm),
        "guides_lid": _lid(shape.guide_mm, guides, dims.GUIDE_WIDTH),
        "support_tray": _support_tray(shape),
        "support_lid": _lid(shape.support_mm, support, dims.STRIP_WIDTH)
        + _frustum(
            dims.GUIDE_WIDTH, shape.support_mm - 2 * dims.CLEARANCE, dims.GUIDE_THICKNESS
        ).translate((0, 0, dims.LID)),
        "test_tray": _guide_tray(dims.TEST_LENGTH),
        "test_lid": _lid(dims.TEST_LENGTH, guides, dims.GUIDE_WIDTH),
        "test_jig": _box(dims.TEST_JIG, dims.STRIP_WIDTH, dims.STRIP_THICKNESS)
        - _box(
            dims.TEST_JIG + 2 * _CUT,
            dims.GUIDE_WIDTH + 2 * dims.CLEARANCE,
            dims.GUIDE_THICKNESS + _CUT,
        ).translate((0, 0, dims.STRIP_THICKNESS - dims.GUIDE_THICKNESS)),
        "sensor_cap": _sensor_cap(shape),
        "sensor_lid": _sensor_lid(shape),
        "led_cap": _led_cap(shape),
        "base": _base(shape),
    }


def write(shape: StripShape, folder: Path) -> list[Path]:
    """Write each part of a strip to a binary STL file in mm, in an existing folder.

    SpotsError if a package is missing, or a file cannot be written.
    """
    require()
    import trimesh

    made = []
    for name, solid in parts(shape).items():
        mesh = solid.to_mesh()
        faces = trimesh.Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts, process=False)
        path = folder / f"{name}.stl"
        with atomic.replacing(path, _STL) as file:
            file.write(faces.export(file_type="stl"))
        made.append(path)
    return made


def _read(path: Path) -> None:
    with open(path, "rb") as file:
        head = file.read(_HEAD.size)
        size = file.seek(0, os.SEEK_END)
    if len(head) < _HEAD.size or size != _HEAD.size + _TRIANGLE * _HEAD.unpack(head)[0]:
        raise FileError(f"{path} is not a binary STL file: name another file", path)


_STL = atomic.Kind("a binary STL file", _read)


def _rectangle(x: float, y: float):
    from manifold3d import CrossSection

    return CrossSection.square((x, y), center=True)


def _box(x: float, y: float, z: float):
    """Return a box of the size `x`, `y`, `z` in mm, on the plane z = 0, centred on the z axis."""
    return _rectangle(x, y).extrude(z)


def _between(x: tuple, y: tuple, z: tuple):
    """Return a box whose sides lie at (low, high) along `x`, `y` and `z`, in mm."""
    size = x[1] - x[0], y[1] - y[0], z[1] - z[0]
    return _box(*size).translate(((x[0] + x[1]) / 2, (y[0] + y[1]) / 2, z[0]))


def _frustum(width: float, length: float, height: float):
    """Return a box along x that narrows upwards; its foot is `width` by `length` mm.

    It is `height` mm high.
    """
    top = 1 - 2 * dims.SLOPE * height / length, 1 - 2 * dims.SLOPE * height / width
    return _rectangle(length, width).extrude(height, scale_top=top)


def _cylinder(height: float, foot: float, top: float | None = None):
    from manifold3d import Manifold

    return Manifold.cylinder(height, foot / 2, (foot if top is None else top) / 2, _ROUND)


def _cavities_y(count: int, width: float) -> list[float]:
    """Return the y coordinates in mm of the centre lines of `count` cavities in a mould.

    Each cavity is `width` mm wide.
    """
    pitch = width + dims.MIDDLE_WALL
    return [(i - (count - 1) / 2) * pitch for i in range(count)]


def _mould_width(middles: list[float], width: float) -> float:
    return max(middles) - min(middles) + width + 2 * dims.SIDE_WALL


def _pins(length: float, wide: float) -> list[tuple[float, float]]:
    """Return x and y in mm of the pins of a tray that is `length` by `wide` mm.

    The pins are not symmetric, so that the lid fits in one orientation only.
    """
    x, y = length / 2 - 2 * dims.PIN_INSET, wide / 2 - dims.PIN_INSET
    return [(-x, y), (x, y), (-x / 2, -y)]


def _tray(length: float, middles: list[float], width: float, depth: float):
    """Return a tray without its cavities: a block with pins, and grooves for overflowing rubber.

    `length`, `width` and `depth` are those of a cavity in mm; `middles` are the y coordinates of
    the cavities' centre lines.
    """
    wide, top = _mould_width(middles, width), dims.FLOOR + depth
    block = _box(length + 2 * dims.END_WALL, wide, top)
    for x, y in _pins(length, wide):
        block += _cylinder(dims.PIN_HEIGHT, dims.PIN_FOOT, dims.PIN_TOP).translate((x, y, top))
    beside = {
        round(m + side * (width / 2 + dims.LAND + dims.GROOVE_WIDTH / 2), 6)
        for m in middles
        for side in (-1, 1)
    }
    for y in beside:
        groove = _box(length, dims.GROOVE_WIDTH, dims.GROOVE_DEPTH + _CUT)
        block -= groove.translate((0, y, top - dims.GROOVE_DEPTH))
    # Slots to lever the lid off.
    for side in (-1, 1):
        slot = _box(10.0, 2.0, dims.GROOVE_DEPTH + _CUT)
        block -= slot.translate((length / 4, side * wide / 2, top - dims.GROOVE_DEPTH))
    return block


def _lid(length: float, middles: list[float], width: float):
    wide = _mould_width(middles, width)
    plate = _box(length + 2 * dims.END_WALL, wide, dims.LID)
    for x, y in _pins(length, wide):
        # The tray's pins, mirrored: the lid is turned over about its long axis.
        plate -= _cylinder(dims.LID + 2 * _CUT, dims.PIN_HOLE).translate((x, -y, -_CUT))
    return plate


def _cavity(width: float, length: float, depth: float):
    """Return a cavity whose opening, `width` by `length` mm, is at z = 0; it is `depth` mm deep."""
    return _frustum(width, length, depth).mirror((0, 0, 1))


def _guide_tray(length: float):
    middles = _cavities_y(2, dims.GUIDE_WIDTH)
    tray = _tray(length, middles, dims.GUIDE_WIDTH, dims.GUIDE_THICKNESS)
    for y in middles:
        opening = _opened(dims.GUIDE_WIDTH, length, dims.GUIDE_THICKNESS)
        tray -= opening.translate((0, y, dims.FLOOR + dims.GUIDE_THICKNESS))
    return tray


def _opened(width: float, length: float, depth: float):
    """Return a `_cavity` with a box above its opening, to be subtracted from a tray."""
    return _cavity(width, length, depth) + _box(length, width, _CUT)


def _support_tray(shape: StripShape):
    length, depth = shape.support_mm, dims.STRIP_THICKNESS
    tray = _tray(length, [0.0], dims.STRIP_WIDTH, depth)
    tray -= _opened(dims.STRIP_WIDTH, length, depth).translate((0, 0, dims.FLOOR + depth))
    # Cores of the dyed guide's pocket, which is open at both ends, and of the air gap above it.
    pocket = _frustum(dims.GUIDE_WIDTH, length + dims.END_WALL, dims.GUIDE_THICKNESS)
    gap_mm = depth - 2 * dims.GUIDE_THICKNESS
    gap = _frustum(dims.GAP_WIDTH, shape.length_mm, gap_mm).translate((0, 0, dims.GUIDE_THICKNESS))
    return tray + (pocket + gap).translate((0, 0, dims.FLOOR))


def _end_socket():
    """Return the hole for the end of a strip, open at z = 0; the strip's lower face is at y = 0."""
    c = dims.CLEARANCE
    return _between(
        (-dims.STRIP_WIDTH / 2 - c, dims.STRIP_WIDTH / 2 + c),
        (-c, dims.STRIP_THICKNESS + c),
        (-_CUT, dims.END_LENGTH),
    )


def _window(middle_y: float, top: float):
    """Return the hole in a cap for a light guide, from the socket of the strip up to `top`.

    `middle_y` is the height of the guide's centre line above the strip's lower face. All in mm.
    """
    width, high = dims.GUIDE_WIDTH / 2 + dims.CLEARANCE, dims.GUIDE_THICKNESS / 2 + dims.CLEARANCE
    return _between(
        (-width, width), (middle_y - high, middle_y + high), (dims.END_LENGTH - _CUT, top + _CUT)
    )


def _mortise(bottom: float):
    c = dims.CLEARANCE
    return _between(
        (-dims.TONGUE_WIDTH / 2 - c, dims.TONGUE_WIDTH / 2 + c),
        (bottom - _CUT, bottom + dims.TONGUE_HEIGHT + c),
        (-_CUT, dims.END_LENGTH + c),
    )


def _pocket(shape: StripShape) -> tuple[tuple, tuple]:
    """Return the x range and the y range in mm of the breakout's pocket in the sensor cap.

    The chip of a breakout in the pocket faces the dyed guide.
    """
    board, (x, y) = shape.board, shape.board.window_mm
    middle = dims.GUIDE_THICKNESS / 2
    return (
        (-x - dims.CLEARANCE, board.width_mm - x + dims.CLEARANCE),
        (middle - y - dims.CLEARANCE, middle + board.height_mm - y + dims.CLEARANCE),
    )


def _grown(span: tuple, by: float) -> tuple:
    return span[0] - by, span[1] + by


def _sensor_cap(shape: StripShape):
    x, y = _pocket(shape)
    floor = dims.END_LENGTH + dims.SEPTUM
    board = floor + dims.PARTS_HEIGHT
    top = board + dims.PCB + dims.BACK
    cap = _between(_grown(x, dims.CAP_WALL), _grown(y, dims.CAP_WALL), (0, top))
    cap -= _between(x, y, (floor, top + _CUT))
    # Posts for the breakout, a tube (nose) around the guide, and a notch for the cable.
    inside = _between(
        _grown(x, dims.CAP_WALL / 2), _grown(y, dims.CAP_WALL / 2), (floor - _CUT, board)
    )
    for px in (
        (x[0] - dims.CAP_WALL, x[0] + dims.POST[0]),
        (x[1] - dims.POST[0], x[1] + dims.CAP_WALL),
    ):
        for py in (
            (y[0] - dims.CAP_WALL, y[0] + dims.POST[1]),
            (y[1] - dims.POST[1], y[1] + dims.CAP_WALL),
        ):
            cap += _between(px, py, (floor, board)) ^ inside
    middle, around = dims.GUIDE_THICKNESS / 2, dims.CLEARANCE + dims.NOSE_WALL
    nose = board - dims.NOSE_GAP
    cap += _between(
        (-dims.GUIDE_WIDTH / 2 - around, dims.GUIDE_WIDTH / 2 + around),
        (middle - dims.GUIDE_THICKNESS / 2 - around, middle + dims.GUIDE_THICKNESS / 2 + around),
        (floor - _CUT, nose),
    )
    at = (y[0] + y[1] - dims.CABLE_NOTCH) / 2
    cap -= _between(
        (x[1] - _CUT, x[1] + dims.CAP_WALL + _CUT), (at, at + dims.CABLE_NOTCH), (floor, top + _CUT)
    )
    return cap - _end_socket() - _window(middle, nose) - _mortise(-shape.base_mm)


def _sensor_lid(shape: StripShape):
    x, y = _pocket(shape)
    x = -x[1], -x[0]  # the lid is turned over to close the cap
    plate = _between(_grown(x, dims.CAP_WALL), _grown(y, dims.CAP_WALL), (0, dims.LID_PLATE))
    plug = _between(
        _grown(x, -dims.CLEARANCE), _grown(y, -dims.CLEARANCE), (0, dims.LID_PLATE + dims.LID_PLUG)
    )
    return plate + plug


def _led_cap(shape: StripShape):
    middle = dims.STRIP_THICKNESS - dims.GUIDE_THICKNESS / 2
    half = dims.STRIP_WIDTH / 2 + dims.CLEARANCE + dims.CAP_WALL
    led = dims.END_LENGTH + dims.BEYOND
    high = middle + dims.LED_DIAMETER / 2 + dims.CLEARANCE + dims.CAP_WALL
    cap = _between((-half, half), (-shape.base_mm, high), (0, led + dims.LED_DEPTH))
    hole = _cylinder(dims.LED_DEPTH + _CUT, dims.LED_DIAMETER + 2 * dims.CLEARANCE)
    cap -= hole.translate((0, middle, led))
    return cap - _end_socket() - _window(middle, led) - _mortise(-shape.base_mm)


def _base(shape: StripShape):
    """Return the bar under the strip, with a tongue for each cap and rails beside the strip."""
    wide = dims.STRIP_WIDTH + 2 * (dims.CLEARANCE + dims.RAIL)
    bar = _box(shape.length_mm, wide, shape.base_mm + dims.RAIL)
    bed = _box(shape.length_mm + 2 * _CUT, dims.STRIP_WIDTH + 2 * dims.CLEARANCE, dims.RAIL + _CUT)
    tongue = _box(shape.support_mm, dims.TONGUE_WIDTH, dims.TONGUE_HEIGHT)
    return bar - bed.translate((0, 0, shape.base_mm)) + tongue
