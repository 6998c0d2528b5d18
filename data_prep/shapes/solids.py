"""Closed solids of one colour, from which the procedural shapes are put together.

Every solid is a loft: polygons of equal size ("rings") joined one to the next. Most are prisms:
their rings lie across one of the axes. Lengths are in whatever unit the caller builds in;
`data_prep.clouds.normalise` scales the finished shape.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_prep.arrays import Floats
from data_prep.scene import Mesh

Color = tuple[int, int, int]  # sRGB, 0..255
# The axes in which an outline is given that lies across x, across y and across z.
PLANES = ((2, 1), (0, 2), (0, 1))


@dataclass(frozen=True, eq=False)
class Part:
    """One watertight solid of one colour.

    vertices  float64 [V, 3]
    faces     int32 [F, 3], anticlockwise seen from outside
    color     sRGB
    """

    vertices: Floats
    faces: NDArray[np.int32]
    color: Color


def signed_volume(vertices: Floats, faces: NDArray[np.int32]) -> float:
    """Return the volume enclosed by a closed surface; negative where its faces look inwards."""
    a, b, c = (vertices[faces[:, i]] - vertices[0] for i in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


def loft(rings: ArrayLike, color: Color, *, closed: bool = False) -> Part:
    """Return the solid through rings [S, n, 3].

    The sides join each ring to the next, and fans cap the ends.

    The first and the last ring have to be convex. With `closed`, the last ring is joined to the
    first and there are no caps (a torus). The rings may run either way round: the faces are turned
    outwards at the end. Raises ValueError where nothing is enclosed (fewer than two rings, rings of
    fewer than three points, zero volume).
    """
    points = np.asarray(rings, dtype=np.float64)
    if points.ndim != 3 or points.shape[2] != 3 or points.shape[0] < 2 or points.shape[1] < 3:
        raise ValueError(f"rings: expected [S >= 2, n >= 3, 3], got {list(points.shape)}")
    count, sides = points.shape[:2]
    here = np.arange(count * sides, dtype=np.int32).reshape(count, sides)
    a, d = (here, np.roll(here, -1, axis=0)) if closed else (here[:-1], here[1:])
    b, c = np.roll(a, -1, axis=1), np.roll(d, -1, axis=1)
    faces = [np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    if not closed:
        k = np.arange(1, sides - 1, dtype=np.int32)
        fan = np.stack([np.zeros_like(k), k, k + 1], axis=1)
        faces += [fan[:, ::-1], fan + (count - 1) * sides]
    vertices = points.reshape(-1, 3)
    joined = np.concatenate(faces).astype(np.int32)
    volume = signed_volume(vertices, joined)
    if volume == 0.0:
        raise ValueError("rings: the solid has no volume")
    return Part(vertices, joined if volume > 0.0 else joined[:, ::-1], color)


def rings_across(axis: int, outlines: ArrayLike, places: ArrayLike) -> Floats:
    """Return rings [S, n, 3] of outlines that lie across an axis.

    outlines  [n, 2] or [S, n, 2], in (z, y) across x (axis 0), (x, z) across y, (x, y) across z
    places    [S], or [S, n], or [1, n]: where their points are along the axis
    """
    plane, along = np.asarray(outlines, dtype=np.float64), np.asarray(places, dtype=np.float64)
    if along.ndim == 1:
        along = along[:, None]
    rings = np.empty((*np.broadcast_shapes(plane.shape[:-1], along.shape), 3))
    first, second = PLANES[axis]
    rings[..., axis], rings[..., first], rings[..., second] = along, plane[..., 0], plane[..., 1]
    return rings


def prism(
    axis: int, outlines: ArrayLike, places: ArrayLike, color: Color, *, closed: bool = False
) -> Part:
    """Return the solid through outlines at places along an axis; see `rings_across` and `loft`."""
    return loft(rings_across(axis, outlines, places), color, closed=closed)


def sheet(
    axis: int,
    sides: tuple[ArrayLike, ArrayLike],
    ends: tuple[ArrayLike, ArrayLike],
    color: Color,
    *,
    closed: bool = False,
) -> Part:
    """Return a sheet between two lines across an axis, from one place along it to another.

    sides   both lines [n, 2], point by point opposite each other; see `rings_across` for the axes
    ends    two places along the axis, or two of each point [n]
    closed  the last points are joined to the first
    """
    first, second = (np.asarray(line, dtype=np.float64) for line in sides)
    low, high = (np.broadcast_to(end, len(first)) for end in ends)
    rings = rings_across(axis, [first, first, second, second], np.stack([low, high, high, low]))
    return loft(rings.swapaxes(0, 1), color, closed=closed)


def sections(outline: Floats, centres: ArrayLike, scales: ArrayLike) -> Floats:
    """Return outlines [S, n, 2]: one [n, 2] times `scales` about `centres`.

    These are [S or 1, 2 or 1].
    """
    middle, scale = np.asarray(centres, dtype=np.float64), np.asarray(scales, dtype=np.float64)
    return middle[:, None] + scale[:, None] * outline


def polygon(sides: int, radius: float) -> Floats:
    """Return a regular polygon [sides, 2], anticlockwise; the first edge is parallel to y."""
    angle = (np.arange(sides) - 0.5) * (2 * math.pi / sides)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def rectangle(width: float, height: float) -> Floats:
    """Return a rectangle [4, 2] around the origin, anticlockwise."""
    return np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) * (width / 2, height / 2)


def rounded(corners: ArrayLike, radius: float, steps: int = 3) -> Floats:
    """Return a polygon [n, 2] with each corner replaced by a curve of `steps` + 1 points.

    `radius` is the distance from the corner at which the curve begins, along both edges; it has to
    be less than half of the shortest edge. Convex in, convex out.
    """
    points = np.asarray(corners, dtype=np.float64)
    before, after = np.roll(points, 1, axis=0) - points, np.roll(points, -1, axis=0) - points
    before /= np.linalg.norm(before, axis=1, keepdims=True)
    after /= np.linalg.norm(after, axis=1, keepdims=True)
    t = np.linspace(0.0, 1.0, steps + 1)[None, :, None]
    # A quadratic Bezier curve: within 1 % of an arc at right angles, and defined at any angle.
    curve = points[:, None] + radius * ((1 - t) ** 2 * before[:, None] + t**2 * after[:, None])
    return curve.reshape(-1, points.shape[1])


def fillet(path: ArrayLike, radius: float, steps: int = 4) -> Floats:
    """Return a polyline [n, 3] whose inner corners are curves that begin at `radius` from them."""
    points = np.asarray(path, dtype=np.float64)
    if len(points) < 3:
        return points
    curves = rounded(points, radius, steps).reshape(len(points), steps + 1, 3)[1:-1]
    return np.concatenate([points[:1], curves.reshape(-1, 3), points[-1:]])


def box(centre: ArrayLike, size: ArrayLike, color: Color) -> Part:
    """Return an upright cuboid with the given centre [3] and edge lengths [3]."""
    return slab(rectangle(1.0, 1.0), centre, size, color)


def slab(
    outline: Floats, centre: ArrayLike, size: ArrayLike, color: Color, *, bevel: float = 0.0
) -> Part:
    """Return an upright plate: a convex outline [n, 2] in (x, z), scaled by `size`.

    The size is that of x and z, and y the thickness.

    `bevel` takes that length off all edges of the top and the bottom at 45 degrees; it has to be
    less than half of every edge length.
    """
    half = np.asarray(size, dtype=np.float64)[1] / 2
    levels = [(-half, 0.0), (half, 0.0)]
    if bevel > 0.0:
        levels = [(-half, bevel), (bevel - half, 0.0), (half - bevel, 0.0), (half, bevel)]
    return layered(outline, centre, size, levels, color)


def layered(
    outline: Floats, centre: ArrayLike, size: ArrayLike, levels: ArrayLike, color: Color
) -> Part:
    """Return an upright solid of one outline [n, 2] in (x, z), scaled by size x and z, drawn in.

    levels  [k, 2], from below: height above the centre, length by which the edge is drawn in there
    """
    middle, extent = np.asarray(centre, dtype=np.float64), np.asarray(size, dtype=np.float64)
    heights, insets = np.asarray(levels, dtype=np.float64).T
    outlines = sections(outline, middle[None, ::2], extent[::2] - 2 * insets[:, None])
    return prism(1, outlines, middle[1] + heights, color)


def post(
    foot: ArrayLike, head: ArrayLike, outline_foot: Floats, outline_head: Floats, color: Color
) -> Part:
    """Return a leg, column or rod between two points [3], with level ends.

    The outlines [n, 2] are its (x, z) sections at foot and head: equal ones make a (sheared) prism,
    similar ones a frustum.
    """
    ends = np.asarray([foot, head], dtype=np.float64)
    return prism(1, ends[:, None, ::2] + (outline_foot, outline_head), ends[:, 1], color)


def lathe(profile: ArrayLike, color: Color, *, sides: int = 16) -> Part:
    """Return a solid turned about the y axis; profile [k, 2]: (radius > 0, y) from one end on."""
    radii, heights = np.asarray(profile, dtype=np.float64).T
    return prism(1, radii[:, None, None] * polygon(sides, 1.0), heights, color)


def sweep(path: ArrayLike, profile: Floats, color: Color, *, up: ArrayLike = (0, 1, 0)) -> Part:
    """Return a bar of constant section along a polyline [n, 3], with mitred joints.

    profile  [m, 2], convex, in (sideways, upwards) of the first segment; centred profiles make bars
             whose volume is exactly section area x path length
    up       [3], which way the profile's second axis points; not parallel to the first segment

    Raises ValueError where `up` is parallel to the first segment or the path turns back on itself.
    """
    points = np.asarray(path, dtype=np.float64)
    along = np.diff(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.cross(along[0], np.asarray(up, dtype=np.float64))
    length = np.linalg.norm(aside)
    if length < 1e-9:
        raise ValueError("up: parallel to the first segment of the path")
    aside /= length
    upward = np.cross(aside, along[0])
    normals = np.concatenate([along[:1], along[:-1] + along[1:], along[-1:]])
    rings = np.empty((len(points), len(profile), 3))
    ring = points[0] + profile[:, :1] * aside + profile[:, 1:] * upward
    rings[0] = ring
    for i in range(1, len(points)):
        # Slide the section along its segment until it meets the plane that halves the next angle.
        direction, normal = along[i - 1], normals[i]
        slope = direction @ normal
        if slope < 1e-6:
            raise ValueError(f"path: turns back on itself at point {i}")
        ring = ring + ((points[i] - ring) @ normal / slope)[:, None] * direction
        rings[i] = ring
    return loft(rings, color)


def tube(path: ArrayLike, radius: float, color: Color, *, sides: int = 8) -> Part:
    """Return a round bar (`sides` faces) along a polyline [n, 3]; see `sweep`."""
    points = np.asarray(path, dtype=np.float64)
    along = points[1] - points[0]
    up = (0.0, 0.0, 1.0) if abs(along[1]) > 0.9 * np.linalg.norm(along) else (0.0, 1.0, 0.0)
    return sweep(points, polygon(sides, radius), color, up=up)


def hoop(
    centre: ArrayLike, radius: float, tube_radius: float, color: Color, *, steps: int = 16
) -> Part:
    """Return a level torus of round section (6 faces around the tube)."""
    section = polygon(6, tube_radius)
    angle = np.arange(steps) * (2 * math.pi / steps)
    x, y, z = np.asarray(centre, dtype=np.float64)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outlines = (radius + section[:, :1]) * around[:, None] + (x, z)
    return prism(1, outlines, section[None, :, 1] + y, color, closed=True)


def rim(outline: Floats, y_low: float, y_high: float, thickness: float, color: Color) -> Part:
    """Return an upright wall of a convex outline [n, 2] in (x, z), open inside (a seat frame).

    `thickness` is measured inwards along x and z; it has to be less than half of either extent.
    """
    extent = np.ptp(outline, axis=0)
    centre = (outline.min(axis=0) + outline.max(axis=0)) / 2
    inner = centre + (outline - centre) * (1 - 2 * thickness / extent)
    return sheet(1, (outline, inner), (y_low, y_high), color, closed=True)


def curved_panel(
    half_width: float,
    half_angle_rad: float,
    thickness: float,
    y_low: ArrayLike,
    y_high: ArrayLike,
    color: Color,
    *,
    steps: int = 10,
) -> Part:
    """Return an upright panel bent about a vertical axis in front of it, like a chair's back.

    The front is towards -z.

    half_width       half of its extent in x, measured in the middle of the thickness
    half_angle_rad   half of the arc, in (0, pi)
    y_low, y_high    a height, or `steps` + 1 of them from the -x end to the +x end

    The middle of the arc passes through x = 0, z = 0.
    """
    radius = half_width / math.sin(min(half_angle_rad, math.pi / 2))
    angle = np.linspace(-half_angle_rad, half_angle_rad, steps + 1)
    around = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    rear, front = ((radius + s * thickness) * around - (0.0, radius) for s in (0.5, -0.5))
    return sheet(1, (rear, front), (y_low, y_high), color)


def moved(part: Part, offset: ArrayLike, *, tilt_rad: float = 0.0) -> Part:
    """Return the part leaned by `tilt_rad` about the x axis, then shifted by [3].

    Leaning moves its +y towards +z.
    """
    cos, sin = math.cos(tilt_rad), math.sin(tilt_rad)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cos, sin], [0.0, -sin, cos]])
    return Part(part.vertices @ turn + np.asarray(offset, dtype=np.float64), part.faces, part.color)


def join(parts: Sequence[Part]) -> Mesh:
    """Return one mesh of all parts (at least one), in order; nothing is merged."""
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    counts = [len(part.faces) for part in parts]
    return Mesh(
        np.concatenate([part.vertices for part in parts]).astype(np.float32),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
        np.repeat(np.array([part.color for part in parts], dtype=np.uint8), counts, axis=0),
    )


def turned(part: Part, yaw_rad: float) -> Part:
    """Return the part turned about the y axis by `yaw_rad` (its +z towards +x)."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    turn = np.array([[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]])
    return Part(part.vertices @ turn, part.faces, part.color)
