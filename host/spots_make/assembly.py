"""Solids of a strip: its castings, and all parts in place. Needs manifold3d (extra ``moulds``).

The strip lies along x, with the sensor at its low end. The lower face of the strip is at z = 0.
"""

from __future__ import annotations

from .mould import parts
from .shape import (
    BACK,
    BEYOND,
    END_LENGTH,
    FLOOR,
    GUIDE_THICKNESS,
    LED_DEPTH,
    LED_DIAMETER,
    LID,
    LID_PLATE,
    PARTS_HEIGHT,
    PCB,
    SEPTUM,
    STRIP_THICKNESS,
    StripShape,
)

_LEAST_WIDTH = 5.0  # mm: grooves are narrower, cavities are wider


def closed(tray, lid, depth: float):
    """Return the solid of a closed mould: the lid is turned over about its long axis."""
    return tray + lid.rotate((180, 0, 0)).translate((0, 0, FLOOR + depth + LID))


def castings(tray, lid, depth: float) -> list:
    """Return the parts that are cast in a mould, as they lie in it, without the overflow grooves.

    `depth` is that of the tray's cavities in mm.
    """
    from manifold3d import Manifold

    x0, y0, z0, x1, y1, _ = tray.bounding_box()
    room = Manifold.cube((x1 - x0, y1 - y0, FLOOR + depth - z0)).translate((x0, y0, z0))
    hollow = (room - closed(tray, lid, depth)).decompose()
    # A cavity that is open to the outside, such as a slot to lever the lid off, is no casting.
    return [one for one in hollow if _width(one) > _LEAST_WIDTH and one.bounding_box()[1] > y0]


def _width(solid) -> float:
    box = solid.bounding_box()
    return min(box[3] - box[0], box[4] - box[1])


def assembly(shape: StripShape) -> dict:
    """Return the parts of a finished strip at their positions.

    The solids are ``support``, ``clear`` and ``dyed`` (the two guides), ``board`` (breakout),
    ``chip`` and ``led``; the printed parts are ``base``, ``sensor_cap``, ``sensor_lid`` and
    ``led_cap``.
    """
    from manifold3d import Manifold

    made = parts(shape)
    (support,) = castings(made["support_tray"], made["support_lid"], STRIP_THICKNESS)
    guide = castings(made["guides_tray"], made["guides_lid"], GUIDE_THICKNESS)[0]
    x0, y0, _, x1, y1, _ = guide.bounding_box()
    guide = guide.translate((-(x0 + x1) / 2, -(y0 + y1) / 2, -FLOOR))
    inner = END_LENGTH + SEPTUM + PARTS_HEIGHT
    x, y = shape.board.window_mm
    pcb = Manifold.cube((shape.board.width_mm, shape.board.height_mm, PCB))
    middle = GUIDE_THICKNESS / 2
    chip = Manifold.cube((2.0, 3.1, 1.0), True).translate((0, middle - 0.67, inner - 0.5))
    lid = made["sensor_lid"].rotate((0, 180, 0))
    lid = lid.translate((0, 0, inner + PCB + BACK + LID_PLATE))
    led_middle = STRIP_THICKNESS - GUIDE_THICKNESS / 2
    led = Manifold.cylinder(LED_DEPTH, LED_DIAMETER / 2, circular_segments=48)
    return {
        "base": made["base"].translate((0, 0, -shape.base_mm)),
        "support": support.translate((0, 0, -FLOOR)),
        # The wide face of each guide is outside.
        "dyed": guide.rotate((180, 0, 0)).translate((-BEYOND / 2, 0, GUIDE_THICKNESS)),
        "clear": guide.translate((BEYOND / 2, 0, STRIP_THICKNESS - GUIDE_THICKNESS)),
        "sensor_cap": _low(made["sensor_cap"], shape),
        "led_cap": _high(made["led_cap"], shape),
        "board": _low(pcb.translate((-x, middle - y, inner)), shape),
        "chip": _low(chip, shape),
        "sensor_lid": _low(lid, shape),
        "led": _high(led.translate((0, led_middle, END_LENGTH + BEYOND)), shape),
    }


def _high(cap, shape: StripShape):
    """Turn a cap from its position as printed, and move it to the LED's end of the strip.

    The cap's z axis becomes x, and its y axis becomes z.
    """
    return cap.rotate((90, 0, 90)).translate((shape.length_mm / 2, 0, 0))


def _low(cap, shape: StripShape):
    return cap.rotate((90, 0, -90)).translate((-shape.length_mm / 2, 0, 0))
