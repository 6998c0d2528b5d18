"""Random points on surfaces, uniform by area, fewer points of a cloud, and random cameras."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.scene import CLOUD_SIZE, Mesh, PointCloud, Points, View

AZIMUTH_RANGE_DEG = (-180.0, 180.0)
ELEVATION_RANGE_DEG = (-40.0, 40.0)
_ROWS_TOGETHER = 2**20  # chosen from at a time, which takes 8 MiB: a bound on memory


def face_areas(mesh: Mesh) -> NDArray[np.float64]:
    """Return the area of each face [F] in squared unit-sphere units."""
    return _areas(mesh.vertices.astype(np.float64)[mesh.faces])


def _areas(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    edges = corners[:, 1:] - corners[:, :1]
    return 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)


def sample_surface(
    mesh: Mesh, rng: np.random.Generator, count: int = CLOUD_SIZE, *, coloured: bool = False
) -> PointCloud:
    """Draw points independently and uniformly by area, in random order (paper, section 4).

    Because the draws are independent, any fixed subset of rows (every second row, for example) is
    itself a uniform sample. The `source` of the cloud is the mesh. If `coloured`, each point has
    the colour of its face.

    Raises BadInput where the mesh has no face of positive area.
    """
    points, face, _ = sample_faces(mesh.vertices.astype(np.float64)[mesh.faces], rng, count)
    colors = mesh.face_colors[face] if coloured else None
    return PointCloud(points.astype(np.float32), source=mesh, colors=colors)


def sample_faces(
    corners: NDArray[np.float64], rng: np.random.Generator, count: int
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Draw points as `sample_surface` does on triangles [F, 3, 3], with their places.

    Returns the points [N, 3], the face of each [N], and its shares of the three corners [N, 3].
    Raises BadInput where no face has an area.
    """
    areas = _areas(corners)
    total = areas.sum()
    if not (np.isfinite(total) and total > 0):
        raise BadInput(
            f"cannot sample a surface of area {total:g}: the mesh has no usable face; "
            "fix it, or leave it out"
        )
    face = rng.choice(len(areas), size=count, p=areas / total)
    # A uniform point of the unit square, folded into the triangle.
    along = rng.random((count, 2))
    folded = along.sum(axis=1) > 1
    along[folded] = 1 - along[folded]
    chosen = corners[face]
    points = (
        chosen[:, 0]
        + along[:, :1] * (chosen[:, 1] - chosen[:, 0])
        + along[:, 1:] * (chosen[:, 2] - chosen[:, 0])
    )
    return points, face, np.column_stack([1 - along.sum(axis=1), along])


def random_rows(count: int, most: int) -> NDArray[np.int64]:
    """Return the rows of a random subset of `count` points: exactly `most`, or all of fewer.

    Wherever a cloud has more points than can be used, these are taken. Every subset is equally
    likely, so that none of the cloud's structure counts: of a sorted cloud every k-th row may be
    one side of a table, and of a scan with 64 interleaved lasers every fourth row has 16 of them.
    The number of the points is the only seed. So the same points give the same subset, in any
    process, and a coordinate rounded otherwise changes no other point; a caller for which their
    order is not to matter sorts them first.

    Parameters
    ----------
    count : int
        Number of points, 0 to 10**9.
    most : int
        Number of rows to take, at least 0.

    Returns
    -------
    int64 array [min(count, most)]
        Rows in ascending order, none twice: colours and normals are taken by the same.
    """
    if count <= most:
        return np.arange(count)
    rng, wanted, rows = generator("fewer points", count), most, [np.empty(0, np.int64)]
    for first in range(0, count, _ROWS_TOGETHER):
        here = min(_ROWS_TOGETHER, count - first)
        # As many as a subset of all has in this part: together each subset is equally likely.
        taken = int(rng.hypergeometric(here, count - first - here, wanted))
        rows.append(first + np.sort(rng.choice(here, taken, replace=False)))
        wanted -= taken
    return np.concatenate(rows)


def at_most(most: int, points: Points) -> tuple[Points, tuple[str, ...]]:
    """Return a random choice of `most` points, or all of fewer, and a note if some are left out."""
    if len(points) <= most:
        return points, ()
    used = points[random_rows(len(points), most)]
    return used, (f"input: {len(used)} of {len(points)} points used",)


def random_subset(cloud: PointCloud, count: int, rng: np.random.Generator) -> PointCloud:
    """Return `count` points of a cloud in their order, or the cloud itself if it has no more.

    They are drawn without replacement, by the caller's random numbers: another subset each time.
    """
    if len(cloud) <= count:
        return cloud
    rows = rng.choice(len(cloud), size=count, replace=False)
    rows.sort()
    return cloud.take(rows)


def even_rows(count: int, wanted: int) -> NDArray[np.int64]:
    """Return `wanted` rows of `count` points, repeated or left out as evenly as can be.

    Row i of the result is floor(i count / wanted).
    """
    return np.arange(wanted) * count // wanted


def random_views(count: int, rng: np.random.Generator) -> tuple[View, ...]:
    """Draw views with uniform azimuth in +-180 and elevation in +-40 degrees (section 4)."""
    azimuth = rng.uniform(*AZIMUTH_RANGE_DEG, size=count)
    elevation = rng.uniform(*ELEVATION_RANGE_DEG, size=count)
    return tuple(View(float(a), float(e)) for a, e in zip(azimuth, elevation, strict=True))
