"""Perturbations for the suite `stability`: clouds at the edges of the domain, and beyond.

Each is a `data_prep.clouds.conditions.Perturbation`. The `source` of the cloud stays, unless the
table says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from inspect import signature
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_prep.clouds.normalise import normalise, normalise_points
from data_prep.clouds.sampling import random_subset, sample_surface
from data_prep.scene import CLOUD_SIZE, NEUTRAL_GREY, Mesh, PointCloud, Points


@dataclass(frozen=True, repr=False)
class Extreme:
    """A perturbation of the table by its name, with all its parameters."""

    name: str
    parameters: tuple[tuple[str, Any], ...]

    def __repr__(self) -> str:
        """Return a text such as `Flattened(axes=1)`, which is part of the keys of results."""
        return f"{self.name}({', '.join(f'{name}={value!r}' for name, value in self.parameters)})"

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return the perturbed cloud.

        Raises ValueError for more points than there are, where the source is not known.
        """
        values = dict(self.parameters)
        if self.name in _OF_POINTS:
            return replace(cloud, points=_OF_POINTS[self.name](cloud.points, **values))
        return _OF_CLOUDS[self.name](cloud, rng, **values)


def extreme(name: str, *values: Any) -> Extreme:
    """Return a perturbation of the table by its name, with its parameters in their order."""
    if name in _OF_POINTS:
        _, *parameters = signature(_OF_POINTS[name]).parameters
    else:
        _, _, *parameters = signature(_OF_CLOUDS[name]).parameters
    return Extreme(name, tuple(zip(parameters, values, strict=True)))


def _equal(points: Points) -> NDArray[Any]:
    return np.repeat(points[:1], len(points), axis=0)


def _flattened(points: Points, axes: int) -> NDArray[Any]:
    return np.where(np.arange(3) < axes, points, np.float32(0.0))


def _two_clusters(points: Points) -> NDArray[Any]:
    points = points * np.float32(0.1)
    points[: len(points) // 2, 0] -= np.float32(0.9)
    points[len(points) // 2 :, 0] += np.float32(0.9)
    return points


def _first_point(points: Points, value: float) -> NDArray[Any]:
    changed = points.copy()
    changed[0, 0] = value
    return changed


def _scaled(points: Points, factor: float) -> NDArray[Any]:
    return points * np.float32(factor)


def _shifted(points: Points, distance: float) -> NDArray[Any]:
    changed = points.copy()
    changed[:, 0] += np.float32(distance)
    return changed


def _cast(points: Points, dtype: Any) -> NDArray[Any]:
    return points.astype(dtype)


def _strided(points: Points) -> NDArray[Any]:
    larger = np.full((len(points), 6), np.nan, np.float32, order="F")
    larger[:, ::2] = points
    return larger[:, ::2]


def _repeated(points: Points, times: int) -> NDArray[Any]:
    return np.repeat(points[::times], times, axis=0)


def _half(points: Points) -> NDArray[Any]:
    return points[points[:, 0] < 0]


def _normalised(points: Points, factor: float, distance: float, whole: bool) -> NDArray[Any]:
    moved = points.astype(np.float64) * factor + distance
    return normalise_points(np.rint(moved).astype(np.int64) if whole else moved).points


# Changes of the points alone, without randomness.
_OF_POINTS: Mapping[str, Callable[..., NDArray[Any]]] = {
    # the same number of points, all equal to the first
    "Equal": _equal,
    # the first `axes` coordinates are kept, the others become 0: 2 a plane, 1 a line
    "Flattened": _flattened,
    # the cloud shrunk to a tenth, half of its rows at -0.9, half at +0.9 on X
    "TwoClusters": _two_clusters,
    # the first coordinate of the first point becomes `value`: an outlier, NaN or infinity
    "FirstPoint": _first_point,
    # all coordinates times `factor`, in float32
    "Scaled": _scaled,
    # all points moved by `distance` along X; float32 rounds them to its grid out there
    "Shifted": _shifted,
    # the points handed over as another dtype; `PointCloud` casts them back to float32
    "Cast": _cast,
    # the points handed over as every second column of a larger array in Fortran order
    "Strided": _strided,
    # every `times`-th row, `times` times in succession: so the original fills a network of 2,048
    # points (roatienza/pc2pix@23b7b46d, render_by_pc2pix.py)
    "Repeated": _repeated,
    # the points with a negative X: half of the object is cut away
    "Half": _half,
    # times `factor`, moved by `distance`, rounded to integers if `whole`, normalised in float64
    "Normalised": _normalised,
}


def _count(cloud: PointCloud, rng: np.random.Generator, count: int) -> PointCloud:
    if count <= len(cloud):
        return replace(cloud, points=cloud.points[:count])
    if cloud.source is None:
        raise ValueError(f"{count} points: the source of the cloud is not known")
    return sample_surface(cloud.source, rng, count)


def _last_bit(cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    step = rng.integers(-1, 2, cloud.points.shape)
    beyond = np.copysign(np.float32(np.inf), step).astype(np.float32)
    goal = np.where(step == 0, cloud.points, beyond)
    return replace(cloud, points=np.nextafter(cloud.points, goal))


def _shuffled(cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    return replace(cloud, points=rng.permutation(cloud.points))


def _kept(cloud: PointCloud, rng: np.random.Generator, share: float) -> PointCloud:
    count = max(round(share * len(cloud)), 1)
    return random_subset(cloud, count, rng)


def _unit_box(cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    del cloud
    # The corners stand in the order of `data_prep.shapes.solids.box`: samples depend on it.
    ring = [(0.5, -0.5), (0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5)]
    vertices = [(x, y, z) for y in (-0.5, 0.5) for x, z in ring]
    faces = [
        # the sides
        (5, 1, 0),
        (6, 2, 1),
        (7, 3, 2),
        (4, 0, 3),
        (4, 5, 0),
        (5, 6, 1),
        (6, 7, 2),
        (7, 4, 3),
        # below and on top
        (0, 1, 2),
        (0, 2, 3),
        (6, 5, 4),
        (7, 6, 4),
    ]
    cube = Mesh(np.array(vertices), np.array(faces), np.full((len(faces), 3), NEUTRAL_GREY))
    return sample_surface(normalise(cube), rng, CLOUD_SIZE)


def _turned(cloud: PointCloud, rng: np.random.Generator, degrees: float) -> PointCloud:
    del rng
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    # From above, azimuth grows clockwise: -Z goes towards +X.
    turn = np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])
    source = cloud.source
    if source is not None:
        source = Mesh(source.vertices @ turn.T, source.faces, source.face_colors)
    return PointCloud(cloud.points @ turn.T, source=source)


_OF_CLOUDS: Mapping[str, Callable[..., PointCloud]] = {
    "Count": _count,  # the first `count` rows, or a new sample of the source if there are fewer
    "LastBit": _last_bit,  # a rounding error: one unit in the last place up, down or not at all
    "Shuffled": _shuffled,  # the points in another order
    "Kept": _kept,  # a random `share` of the rows, in their order; at least one
    "UnitBox": _unit_box,  # a clean sample of a cube in the unit sphere, which becomes the source
    "Turned": _turned,  # with its source about Y, as a camera at azimuth + `degrees` sees the same
}
