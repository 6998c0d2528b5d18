"""Solids by closed forms; trimesh is the independent judge of volume, area and closedness."""

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
from tests.data_prep.shapes.solid_checks import EXACT, GREY


def polygon_area(sides: int, radius: float) -> float:
    """Of the regular polygon whose corners lie at this radius."""
    return sides / 2 * radius**2 * math.sin(2 * math.pi / sides)


def length(path: object) -> float:
    return float(np.linalg.norm(np.diff(np.array(path), axis=0), axis=1).sum())


def frustum(sides: int) -> float:
    a, b = polygon_area(sides, 0.5), polygon_area(sides, 0.2)
    return 1.5 / 3 * (a + b + math.sqrt(a * b))


def sectors(half_angle: float) -> float:
    """Return those of a curved panel of 10 steps, 0.06 thick and 0.7 high, 0.8 wide."""
    radius = 0.4 / math.sin(min(half_angle, math.pi / 2))
    outer, inner = radius + 0.03, radius - 0.03
    return 10 * 0.7 * math.sin(2 * half_angle / 10) / 2 * (outer**2 - inner**2)


def panel(half_angle: float) -> Part:
    return curved_panel(0.4, half_angle, 0.06, 0.1, 0.8, GREY, steps=10)


BENT = [(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 2, 1.5), (0.2, 2, 3)]
TRIANGLE = polygon(3, 0.4)
SOLIDS = {  # and their volumes, where there is a closed form
    "box": (box((1, 2, 3), (2, 3, 5), GREY), 30),
    "slab": (slab(polygon(20, 0.5), (0, 1, 0), (2, 0.3, 1), GREY, bevel=0.05), None),
    "prism": (post((0, 0, 0), (0, 2, 0), TRIANGLE, TRIANGLE, GREY), 2 * polygon_area(3, 0.4)),
    "sheared": (post((0, 0, 0), (1, 2, -3), TRIANGLE, TRIANGLE, GREY), 2 * polygon_area(3, 0.4)),
    "downwards": (post((0, 2, 0), (0, 0, 0), rectangle(1, 2), rectangle(1, 2), GREY), 4),
    "frustum": (
        post((0, 0, 0), (0, 1.5, 0), polygon(8, 0.5), polygon(8, 0.2), GREY), frustum(8)),
    "lathe": (lathe([(0.5, 0), (0.2, 1.5)], GREY, sides=8), frustum(8)),
    "vase": (lathe([(1, 0), (0.2, 0.1), (0.2, 2), (0.5, 2.1)], GREY), None),
    # Mitres cut wedges off one segment that its neighbour gets back, so volume = area x length.
    "sweep": (sweep(BENT, rectangle(0.1, 0.2), GREY), 0.02 * length(BENT)),
    "tube-upright": (tube([(0, 0, 0), (0, 1, 0)], 0.1, GREY), polygon_area(8, 0.1)),
    "tube-bent": (
        tube(fillet(BENT, 0.2), 0.05, GREY), polygon_area(8, 0.05) * length(fillet(BENT, 0.2))),
    # Sixteen mitred segments: the mitre planes hold the given section, so the section across a
    # segment is cos(pi/16) of it, and a segment is a chord 2 R sin(pi/16) long.
    "hoop": (
        hoop((0, 1, 0), 0.5, 0.05, GREY),
        polygon_area(6, 0.05) * 0.5 * 16 * math.sin(2 * math.pi / 16)),
    "rim": (rim(rectangle(2, 1), 0.3, 0.5, 0.1, GREY), 0.2 * (2 - 1.8 * 0.8)),
    "rounded-rim": (rim(rounded(rectangle(1, 2), 0.1), 0, 0.2, 0.1, GREY), None),
    **{f"curved-panel-{angle}": (panel(angle), sectors(angle)) for angle in (0.3, 1.2, 2.2)},
    "tub": (curved_panel(0.4, 2.2, 0.05, 0, np.linspace(0.5, 1, 11), GREY), None),
    "moved": (moved(box((1, 2, 3), (0.1, 0.2, 0.3), GREY), (0, 0, 1), tilt_rad=2.0), 0.006),
    "turned": (turned(box((0, 5, 2), (1, 2, 3), GREY), math.pi / 2), 6),
}  # fmt: skip


@pytest.mark.parametrize("name", SOLIDS)
def test_closed_and_outward_with_its_volume(name: str) -> None:
    part, volume = SOLIDS[name]
    judged = trimesh.Trimesh(part.vertices, part.faces, process=False)
    assert judged.is_watertight
    assert judged.is_winding_consistent
    assert judged.volume > 0
    assert signed_volume(part.vertices, part.faces) == pytest.approx(judged.volume, rel=EXACT)
    assert judged.area_faces.min() > 0
    assert (part.vertices.dtype, part.faces.dtype) == (np.float64, np.int32)
    if volume is not None:
        assert judged.volume == pytest.approx(volume, rel=10 * EXACT)


@pytest.mark.parametrize("steps", [1, 3])
def test_rounded_corners(steps: int) -> None:
    # A parabola cuts r^2 / 6 off a right angle; n chords of equal parameter cut r^2 / (3 n^2) more.
    outline = rounded(rectangle(2, 1), 0.2, steps=steps)
    x, y = outline.T
    area = 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
    assert area == pytest.approx(2 - 4 * 0.2**2 * (1 / 6 + 1 / (3 * steps**2)), rel=EXACT)
    assert len(outline) == 4 * (steps + 1)


def test_places_and_turns() -> None:
    """A panel bends forwards from the origin; moved leans backwards; turned brings +Z to +X."""
    for part, low, high in (
        (box((1, 2, 3), (2, 3, 5), GREY), (0, 0.5, 0.5), (2, 3.5, 5.5)),
        (moved(box((0, 0, 0), (1, 2, 3), GREY), (0, 0, 9), tilt_rad=math.pi / 2),
         (-0.5, -1.5, 8), (0.5, 1.5, 10)),
        (turned(box((0, 5, 2), (1, 2, 3), GREY), math.pi / 2), (0.5, 4, -0.5), (3.5, 6, 0.5)),
    ):  # fmt: skip
        np.testing.assert_allclose(part.vertices.min(axis=0), low, atol=EXACT)
        np.testing.assert_allclose(part.vertices.max(axis=0), high, atol=EXACT)
    rod = post((0, 0, 0), (0, 1, 0), rectangle(0.1, 0.1), rectangle(0.1, 0.1), GREY)
    assert moved(rod, (0, 0, 0), tilt_rad=0.3).vertices[:, 2].mean() > 0
    assert panel(1.2).vertices[:, 2].max() == pytest.approx(0.03)
    assert panel(1.2).vertices[:, 2].min() < 0


def test_join_keeps_parts_apart() -> None:
    mesh = join([box((0, 0, 0), (1, 1, 1), (1, 2, 3)), box((0, 0, 0), (2, 2, 2), (4, 5, 6))])
    assert len(mesh.vertices) == 16
    assert (mesh.faces[:12].max(), mesh.faces[12:].min()) == (7, 8)
    np.testing.assert_array_equal(mesh.face_colors[[0, 11, 12]], [[1, 2, 3], [1, 2, 3], [4, 5, 6]])


def test_what_encloses_nothing_or_has_no_direction_is_refused() -> None:
    for shape in ((1, 4, 3), (2, 2, 3), (2, 4, 2), (2, 4, 3)):
        with pytest.raises(ValueError, match="rings"):
            loft(np.zeros(shape), GREY)
    with pytest.raises(ValueError, match="up"):
        sweep([(0, 0, 0), (0, 1, 0)], rectangle(1, 1), GREY)
    with pytest.raises(ValueError, match="turns back on itself at point 1"):
        sweep([(0, 0, 0), (1, 0, 0), (0.5, 0, 0)], rectangle(1, 1), GREY)
