"""Moulds, caps and drawings of a strip: their dimensions, measured in the files."""

import re

import numpy as np
import pytest
import trimesh
from manifold3d import CrossSection, FillRule, Manifold, Mesh, OpType
from support.refusals import refusal

from spots.errors import SettingError
from spots_make import drawing as strip_drawing
from spots_make import mould as strip_mould
from spots_make import shape as strip_shape
from spots_make.assembly import assembly, castings
from spots_make.shape import BED, BREAKOUTS, StripShape

LENGTHS_MM = 30.0, 200.0
BRIDGE_MM = 8.5  # longest bridge that a 3D printer prints without supports


@pytest.fixture(scope="module", params=LENGTHS_MM, ids="{:g} mm".format)
def made(request, tmp_path_factory):
    """A `StripShape`, its STL files as meshes by name, and its drawings as SVG texts by name."""
    folder = tmp_path_factory.mktemp("strip")
    shape = StripShape(request.param)
    meshes = {path.stem: trimesh.load(path) for path in strip_mould.write(shape, folder)}
    drawings = {path.stem: path.read_text() for path in strip_drawing.write(shape, folder)}
    return shape, meshes, drawings


def solid(mesh):
    return Manifold(Mesh(np.float32(mesh.vertices), np.uint32(mesh.faces)))


def size(one):
    box = one.bounding_box()
    return [high - low for low, high in zip(box[:3], box[3:])]


def dimensions(drawing):
    """Return the dimensions in a drawing as a dict of values in mm by name; check their texts.

    A dimension with several different values is left out.
    """
    found = {}
    pattern = r'<g class="dimension" data-name="(\w+)" data-mm="([\d.]+)">(.*?)</g>'
    for name, mm, inside in re.findall(pattern, drawing, re.DOTALL):
        assert re.search(r"([\d.]+)</text>", inside).group(1) == mm
        found.setdefault(name, set()).add(float(mm))
    assert found
    return {name: values.pop() for name, values in found.items() if len(values) == 1}


@pytest.mark.board
def test_each_part_is_one_closed_solid_that_fits_the_bed(made):
    _, meshes, _ = made
    assert len(meshes) == 11
    for name, mesh in meshes.items():
        assert mesh.is_watertight, name
        assert mesh.is_winding_consistent, name
        assert mesh.volume > 0, name
        assert mesh.body_count == 1, name
        low, high = mesh.bounds
        assert max(high - low) <= BED, name
        assert low[2] == 0, name


def test_no_part_needs_supports(made):
    _, meshes, _ = made
    for name, mesh in meshes.items():
        lowest = mesh.triangles[:, :, 2].min(axis=1)
        hanging = (mesh.face_normals[:, 2] < -np.sin(np.radians(45.1))) & (lowest > 1e-6)
        for z in np.unique(lowest[hanging].round(3)):
            level = mesh.triangles[hanging & (abs(lowest - z) < 2e-3)]
            assert bridged(level[:, :, :2]) <= BRIDGE_MM, (name, z)


def bridged(triangles):
    """Return the length in mm of the longest unsupported bridge at one height.

    `triangles` are the triangles that face down at this height. The length of a bridge is its
    shorter side.
    """
    whole = CrossSection([one[::-1] for one in triangles], FillRule.NonZero)
    spans = [np.subtract(part.bounds()[2:], part.bounds()[:2]) for part in whole.decompose()]
    return max(min(span) for span in spans)


def cast(meshes, name, depth):
    return castings(solid(meshes[f"{name}_tray"]), solid(meshes[f"{name}_lid"]), depth)


def test_the_cavities_have_the_volumes_of_the_recipe(made):
    shape, meshes, _ = made
    guides = cast(meshes, "guides", strip_shape.GUIDE_THICKNESS)
    assert [one.volume() for one in guides] == [pytest.approx(shape.guide_mm3, rel=1e-3)] * 2
    (support,) = cast(meshes, "support", strip_shape.STRIP_THICKNESS)
    assert support.volume() == pytest.approx(shape.support_mm3, rel=1e-3)
    tests = cast(meshes, "test", strip_shape.GUIDE_THICKNESS)
    whole = strip_shape.guide_mm3(strip_shape.TEST_LENGTH)
    assert [one.volume() for one in tests] == [pytest.approx(whole, rel=1e-3)] * 2


def test_the_meshes_have_the_dimensions_of_the_paper_and_of_the_drawings(made):
    shape, meshes, drawings = made
    (support,) = cast(meshes, "support", strip_shape.STRIP_THICKNESS)
    guide, _ = cast(meshes, "guides", strip_shape.GUIDE_THICKNESS)
    length, wide, thick = size(support)
    assert (wide, thick) == (pytest.approx(12), pytest.approx(3))  # as in the paper
    assert size(guide)[1:] == [pytest.approx(8), pytest.approx(1)]  # as in the paper
    gap = support.translate((0, 0, -strip_shape.FLOOR - 1 - 1e-4)).slice(0).to_polygons()
    hole = min((np.ptp(polygon, axis=0) for polygon in gap), key=lambda span: span[0] * span[1])
    drawn = dimensions(drawings["section"])
    assert drawn == {
        "strip_width": pytest.approx(wide, abs=0.01),
        "strip_thickness": pytest.approx(thick, abs=0.01),
        "guide_width": pytest.approx(size(guide)[1], abs=0.01),
        "guide_thickness": pytest.approx(size(guide)[2], abs=0.01),
        "gap_width": pytest.approx(hole[1], abs=0.01),
        "gap_height": pytest.approx(thick - 2 * size(guide)[2], abs=0.01),
    }
    assert hole[0] == pytest.approx(shape.length_mm, abs=0.01)
    drawn = dimensions(drawings["moulds"])
    for name, one in (("guides", guide), ("support", support)):
        tray, lid = meshes[f"{name}_tray"], meshes[f"{name}_lid"]
        extents = tray.extents
        floor = one.bounding_box()[2]
        flat = solid(lid).trim_by_plane((0, 0, -1), -strip_shape.LID - 1e-6)
        assert {key: value for key, value in drawn.items() if key.startswith(name)} == {
            f"{name}_cavity_length": pytest.approx(size(one)[0], rel=1e-3),
            f"{name}_cavity_width": pytest.approx(size(one)[1], abs=0.01),
            f"{name}_cavity_depth": pytest.approx(size(one)[2], abs=0.01),
            f"{name}_tray_length": pytest.approx(extents[0], rel=1e-3),
            f"{name}_tray_width": pytest.approx(extents[1], abs=0.01),
            f"{name}_floor": pytest.approx(floor, abs=0.01),
            f"{name}_lid": pytest.approx(size(flat)[2], abs=0.01),
        }
    drawn = dimensions(drawings["assembly"])
    assert drawn["length"] == pytest.approx(size(solid(meshes["base"]))[0] - 8, rel=1e-3)
    assert drawn["support_length"] == pytest.approx(length, rel=1e-3)
    assert drawn["guide_length"] == pytest.approx(size(guide)[0], rel=1e-3)
    caps = {name: sockets(meshes[name]) for name in ("sensor_cap", "led_cap")}
    for name, (depth, width, height) in caps.items():
        assert depth == pytest.approx(drawn["end_length"], abs=0.01), name
        assert (width, height) == (pytest.approx(12.4, abs=0.01), pytest.approx(3.4, abs=0.01))
    base = meshes["base"].bounds[1][2] - strip_shape.RAIL
    assert drawn["base_height"] == pytest.approx(base, abs=0.01)


def sockets(mesh):
    """Return depth, width and height in mm of the hole for the strip's end in a cap."""
    box = mesh.bounds
    room = Manifold.cube((40, 10, 20), True).translate((0, 1.5, 10))
    hollow = room ^ Manifold.cube(box[1] - box[0]).translate(box[0])
    hole = hollow - solid(mesh)
    at = hole.slice(1.0)
    x0, y0, x1, y1 = at.bounds()
    deep = [z for z in np.arange(0.05, 8, 0.01) if hole.slice(z).bounds()[2] > 6.1]
    below = max(z for z in deep if z < 4.5)
    return below + 0.005, x1 - x0, y1 - y0


def test_the_parts_of_a_strip_fit_together(made):
    shape, _, _ = made
    placed = assembly(shape)
    names = sorted(placed)
    touching = {
        (a, b): volume
        for i, a in enumerate(names)
        for b in names[i + 1 :]
        if (volume := (placed[a] ^ placed[b]).volume()) > 1e-6
    }
    # At both ends, support and clear part overlap by the thickness of the clearance.
    film = 2 * strip_shape.CLEARANCE * strip_shape.GUIDE_WIDTH * strip_shape.GUIDE_THICKNESS
    assert touching == {("clear", "support"): pytest.approx(film, rel=0.02)}


def test_the_jig_holds_a_test_piece_before_the_windows_of_both_caps(made):
    shape, meshes, _ = made
    placed = assembly(shape)
    far = shape.support_mm - strip_shape.TEST_JIG
    caps = [
        placed["sensor_cap"].translate((far / 2, 0, 0)),
        # Rotated upside down, around the middle of the strip's end.
        placed["led_cap"].translate((-far / 2, 0, -1.5)).rotate((180, 0, 0)).translate((0, 0, 1.5)),
    ]
    piece, _ = cast(meshes, "test", strip_shape.GUIDE_THICKNESS)
    box = piece.bounding_box()
    piece = piece.translate((0, -(box[1] + box[4]) / 2, -box[2])).rotate((180, 0, 0))
    parts = [*caps, piece.translate((0, 0, 1)), solid(meshes["test_jig"]).rotate((180, 0, 0))]
    parts[-1] = parts[-1].translate((0, 0, 3))
    for i, one in enumerate(parts):
        assert all((one ^ other).volume() < 1e-3 for other in parts[i + 1 :])
    assert parts[2].bounding_box()[3] - parts[2].bounding_box()[0] == pytest.approx(60, abs=0.01)
    chip = placed["chip"].translate((far / 2, 0, 0)).bounding_box()
    led = placed["led"].translate((-far / 2, 0, 0)).bounding_box()
    assert parts[2].bounding_box()[0] - chip[3] == pytest.approx(0.5, abs=0.01)
    assert led[0] - parts[2].bounding_box()[3] == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize("breakout", BREAKOUTS)
def test_no_light_gets_to_the_chip_but_through_the_dyed_guide(breakout):
    placed = assembly(StripShape(85, breakout))
    _, y0, z0, x1, y1, z1 = placed["chip"].bounding_box()
    guide = placed["dyed"].bounding_box()
    assert y0 < 0 < y1
    assert z0 < (guide[2] + guide[5]) / 2 < z1
    assert 0 < guide[0] - x1 < 1
    # Seen from the strip, the breakout lies completely behind these parts.
    names = "sensor_cap", "dyed", "support", "base"
    shadows = [placed[name].rotate((0, 90, 0)).project() for name in names]
    cover = CrossSection.batch_boolean(shadows, OpType.Add)
    assert (placed["board"].rotate((0, 90, 0)).project() - cover).area() < 1e-3


def test_the_lid_closes_the_mould_one_way_only(made):
    _, meshes, _ = made
    for name in ("guides", "support", "test"):
        tray, lid = solid(meshes[f"{name}_tray"]), solid(meshes[f"{name}_lid"])
        top = meshes[f"{name}_tray"].bounds[1][2] - strip_shape.PIN_HEIGHT
        on = lid.rotate((180, 0, 0)).translate((0, 0, top + strip_shape.LID))
        assert (tray ^ on).volume() < 1e-3, name
        assert (tray ^ on.rotate((0, 0, 180))).volume() > 1, name


def test_draft_lets_the_castings_out_of_the_trays_and_the_lids(made):
    _, meshes, _ = made
    for name, depth in (("guides", 1), ("test", 1), ("support", 3)):
        tray, lid = solid(meshes[f"{name}_tray"]), solid(meshes[f"{name}_lid"])
        on = lid.rotate((180, 0, 0)).translate((0, 0, strip_shape.FLOOR + depth + strip_shape.LID))
        for one in cast(meshes, name, depth):
            for up in np.linspace(0.05, depth, 5):
                assert (one.translate((0, 0, up)) ^ tray).volume() < 1e-3, (name, up)
                assert (one.translate((0, 0, -up)) ^ on).volume() < 1e-3, (name, up)
                # A wall without draft would still touch.
                assert (
                    one.translate((0, 0, up)) ^ tray.translate((0.0, 0.01 * up, 0))
                ).volume() < 1e-3


@pytest.mark.parametrize("length_mm", [29.9, 200.1])
def test_other_lengths_are_refused(length_mm):
    with refusal(SettingError):
        StripShape(length_mm)
