from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh

from data_prep.shapes.solids import (
    Part,
    box,
    curved_panel,
    fillet,
    hoop,
    join,
    lathe,
    loft,
    moved,
    polygon,
    post,
    rectangle,
    rim,
    rounded,
    signed_volume,
    slab,
    sweep,
    tube,
    turned,
)
from tests.data_prep.shapes.solid_checks import EXACT, GREY, polygon_area


def solid(part: Part) -> trimesh.Trimesh:
    """The independent judge of volume, area and closedness."""
    return trimesh.Trimesh(part.vertices, part.faces, process=False)


def polygon_edge(sides: int, radius: float) -> float:
    return 2 * radius * math.sin(math.pi / sides)


BENT = [(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 2, 1.5), (0.2, 2, 3)]
SOLIDS = {
    "box": box((1, 2, 3), (0.1, 0.2, 0.3), GREY),
    "slab": slab(polygon(20, 0.5), (0, 1, 0), (2, 0.3, 1), GREY, bevel=0.05),
    "post": post((0, 0, 0), (0.3, 2, 0.1), polygon(8, 0.1), polygon(8, 0.2), GREY),
    "post-downwards": post((0, 2, 0), (0, 0, 0), rectangle(1, 2), rectangle(1, 2), GREY),
    "lathe": lathe([(1, 0), (0.2, 0.1), (0.2, 2), (0.5, 2.1)], GREY),
    "sweep": sweep(BENT, rectangle(0.1, 0.2), GREY),
    "tube-upright": tube([(0, 0, 0), (0, 1, 0)], 0.1, GREY),
    "tube-bent": tube(fillet(BENT, 0.2), 0.05, GREY),
    "hoop": hoop((0, 1, 0), 0.5, 0.05, GREY),
    "rim": rim(rounded(rectangle(1, 2), 0.1), 0, 0.2, 0.1, GREY),
    "curved-panel": curved_panel(0.4, 1.0, 0.05, 0, 1, GREY),
    "tub": curved_panel(0.4, 2.2, 0.05, 0, np.linspace(0.5, 1, 11), GREY),
    "moved": moved(box((1, 2, 3), (0.1, 0.2, 0.3), GREY), (0, 0, 1), tilt_rad=2.0),
}


@pytest.mark.parametrize("part", SOLIDS.values(), ids=SOLIDS.keys())
def test_closed_and_outward(part: Part) -> None:
    judged = solid(part)
    assert judged.is_watertight
    assert judged.is_winding_consistent
    assert judged.volume > 0
    assert signed_volume(part.vertices, part.faces) == pytest.approx(judged.volume, rel=EXACT)
    assert judged.area_faces.min() > 0
    assert (part.vertices.dtype, part.faces.dtype) == (np.float64, np.int32)


def test_box() -> None:
    part = box((1, 2, 3), (2, 3, 5), GREY)
    assert solid(part).volume == pytest.approx(30, rel=EXACT)
    assert solid(part).area == pytest.approx(2 * (6 + 10 + 15), rel=EXACT)
    np.testing.assert_allclose(part.vertices.min(axis=0), [0, 0.5, 0.5])
    np.testing.assert_allclose(part.vertices.max(axis=0), [2, 3.5, 5.5])


@pytest.mark.parametrize("sides", [3, 20])
def test_prism(sides: int) -> None:
    outline = polygon(sides, 0.4)
    base, edge = polygon_area(sides, 0.4), polygon_edge(sides, 0.4)
    upright = solid(post((0, 0, 0), (0, 2, 0), outline, outline, GREY))
    assert upright.volume == pytest.approx(2 * base, rel=EXACT)
    assert upright.area == pytest.approx(2 * base + sides * edge * 2, rel=EXACT)
    sheared = solid(post((0, 0, 0), (1, 2, -3), outline, outline, GREY))  # Cavalieri
    assert sheared.volume == pytest.approx(2 * base, rel=EXACT)


@pytest.mark.parametrize("sides", [4, 8])
def test_frustum(sides: int) -> None:
    low, high, height = 0.5, 0.2, 1.5
    a, b = polygon_area(sides, low), polygon_area(sides, high)
    slant = math.hypot(height, (low - high) * math.cos(math.pi / sides))
    edges = polygon_edge(sides, low) + polygon_edge(sides, high)
    expected_area = a + b + sides * edges / 2 * slant
    conical = lathe([(low, 0), (high, height)], GREY, sides=sides)
    standing = post((0, 0, 0), (0, height, 0), polygon(sides, low), polygon(sides, high), GREY)
    for part in (conical, standing):
        assert solid(part).volume == pytest.approx(
            height / 3 * (a + b + math.sqrt(a * b)), rel=EXACT
        )
        assert solid(part).area == pytest.approx(expected_area, rel=EXACT)


def test_mitred_sweeps_keep_their_section() -> None:
    # Mitres cut wedges off one segment that its neighbour gets back, so volume = area x length.
    length = np.linalg.norm(np.diff(np.array(BENT), axis=0), axis=1).sum()
    assert solid(SOLIDS["sweep"]).volume == pytest.approx(0.02 * length, rel=EXACT)
    path = fillet(BENT, 0.2)
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    expected = polygon_area(8, 0.05) * length
    assert solid(SOLIDS["tube-bent"]).volume == pytest.approx(expected, rel=EXACT)
    # Sixteen mitred segments: the mitre planes hold the given section, so the section across a
    # segment is cos(pi/16) of it, and a segment is a chord 2 R sin(pi/16) long.
    expected = polygon_area(6, 0.05) * 0.5 * 16 * math.sin(2 * math.pi / 16)
    assert solid(SOLIDS["hoop"]).volume == pytest.approx(expected, rel=EXACT)
    part = rim(rectangle(2, 1), 0.3, 0.5, 0.1, GREY)
    assert solid(part).volume == pytest.approx(0.2 * (2 - 1.8 * 0.8), rel=EXACT)


@pytest.mark.parametrize("half_angle", [0.3, 1.2, 2.2])
def test_curved_panel(half_angle: float) -> None:
    steps, thickness, height = 10, 0.06, 0.7
    part = curved_panel(0.4, half_angle, thickness, 0.1, 0.1 + height, GREY, steps=steps)
    radius = 0.4 / math.sin(min(half_angle, math.pi / 2))
    outer, inner = radius + thickness / 2, radius - thickness / 2
    sector = math.sin(2 * half_angle / steps) / 2 * (outer**2 - inner**2)
    assert solid(part).volume == pytest.approx(steps * sector * height, rel=EXACT)
    # The middle of the arc is at the origin, and the panel bends forwards from there.
    assert part.vertices[:, 2].max() == pytest.approx(thickness / 2)
    assert part.vertices[:, 2].min() < 0


@pytest.mark.parametrize("steps", [1, 3])
def test_rounded_corners(steps: int) -> None:
    # A parabola cuts r^2 / 6 off a right angle; n chords of equal parameter cut r^2 / (3 n^2) more.
    outline = rounded(rectangle(2, 1), 0.2, steps=steps)
    x, y = outline.T
    area = 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
    assert area == pytest.approx(2 - 4 * 0.2**2 * (1 / 6 + 1 / (3 * steps**2)), rel=EXACT)
    assert len(outline) == 4 * (steps + 1)


def test_moved_leans_backwards_then_shifts_and_turned_brings_plus_z_to_plus_x() -> None:
    part = moved(box((0, 0, 0), (1, 2, 3), GREY), (0, 0, 10), tilt_rad=math.pi / 2)
    np.testing.assert_allclose(np.ptp(part.vertices, axis=0), [1, 3, 2])
    rod = post((0, 0, 0), (0, 1, 0), rectangle(0.1, 0.1), rectangle(0.1, 0.1), GREY)
    assert moved(rod, (0, 0, 0), tilt_rad=0.3).vertices[:, 2].mean() > 0
    part = turned(box((0, 5, 2), (1, 2, 3), GREY), math.pi / 2)
    np.testing.assert_allclose(part.vertices.min(axis=0), [0.5, 4, -0.5], atol=EXACT)
    np.testing.assert_allclose(part.vertices.max(axis=0), [3.5, 6, 0.5], atol=EXACT)
    assert abs(signed_volume(part.vertices, part.faces) - 6) < 10 * EXACT


def test_join_keeps_parts_apart() -> None:
    mesh = join([box((0, 0, 0), (1, 1, 1), (1, 2, 3)), box((0, 0, 0), (2, 2, 2), (4, 5, 6))])
    assert len(mesh.vertices) == 16
    assert mesh.faces[:12].max() == 7
    assert mesh.faces[12:].min() == 8
    np.testing.assert_array_equal(mesh.face_colors[[0, 11, 12]], [[1, 2, 3], [1, 2, 3], [4, 5, 6]])


def test_what_encloses_nothing_or_has_no_direction_is_refused() -> None:
    for shape in ((1, 4, 3), (2, 2, 3), (2, 4, 2), (2, 4, 3)):
        with pytest.raises(ValueError, match="rings"):
            loft(np.zeros(shape), GREY)
    with pytest.raises(ValueError, match="up"):
        sweep([(0, 0, 0), (0, 1, 0)], rectangle(1, 1), GREY)
    with pytest.raises(ValueError, match="turns back on itself at point 1"):
        sweep([(0, 0, 0), (1, 0, 0), (0.5, 0, 0)], rectangle(1, 1), GREY)
