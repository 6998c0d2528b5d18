"""Perturbations for the suite `stability`: clouds at the edges of the domain, and beyond.

Each is a `data_prep.clouds.conditions.Perturbation`. The `source` of the cloud stays, unless the
perturbation says otherwise.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_prep.clouds.normalise import normalise, normalise_points
from data_prep.clouds.sampling import sample_surface
from data_prep.scene import CLOUD_SIZE, NEUTRAL_GREY, Mesh, PointCloud, Points


class _ChangesPoints(ABC):
    """A perturbation of the points alone, without randomness."""

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return the cloud with other points, without randomness."""
        del rng
        return replace(cloud, points=self._changed(cloud.points))

    @abstractmethod
    def _changed(self, points: Points) -> NDArray[Any]:
        """Return changed points: real numbers [M, 3]."""


@dataclass(frozen=True)
class Count:
    """The first `count` rows, or a new sample of the source if the cloud has fewer."""

    count: int

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return `count` points. Raises ValueError for too many without a known source."""
        if self.count <= len(cloud):
            return replace(cloud, points=cloud.points[: self.count])
        if cloud.source is None:
            raise ValueError(f"{self.count} points: the source of the cloud is not known")
        return sample_surface(cloud.source, rng, self.count)


@dataclass(frozen=True)
class Equal(_ChangesPoints):
    """A cloud of the same number of points, all equal to the first."""

    def _changed(self, points: Points) -> NDArray[Any]:
        return np.repeat(points[:1], len(points), axis=0)


@dataclass(frozen=True)
class Flattened(_ChangesPoints):
    """The first `axes` coordinates are kept, the others become 0: 2 a plane, 1 a line."""

    axes: int

    def _changed(self, points: Points) -> NDArray[Any]:
        changed = points.copy()
        changed[:, self.axes :] = 0.0
        return changed


@dataclass(frozen=True)
class TwoClusters(_ChangesPoints):
    """The cloud shrunk to a tenth, half of its rows at -0.9, half at +0.9 on X."""

    def _changed(self, points: Points) -> NDArray[Any]:
        points = points * np.float32(0.1)
        points[: len(points) // 2, 0] -= np.float32(0.9)
        points[len(points) // 2 :, 0] += np.float32(0.9)
        return points


@dataclass(frozen=True)
class FirstPoint(_ChangesPoints):
    """The first coordinate of the first point becomes `value`: an outlier, NaN or infinity."""

    value: float

    def _changed(self, points: Points) -> NDArray[Any]:
        changed = points.copy()
        changed[0, 0] = self.value
        return changed


@dataclass(frozen=True)
class Scaled(_ChangesPoints):
    """All coordinates times `factor`, in float32."""

    factor: float

    def _changed(self, points: Points) -> NDArray[Any]:
        return points * np.float32(self.factor)


@dataclass(frozen=True)
class Shifted(_ChangesPoints):
    """All points moved by `distance` along X; float32 rounds them to its grid out there."""

    distance: float

    def _changed(self, points: Points) -> NDArray[Any]:
        changed = points.copy()
        changed[:, 0] += np.float32(self.distance)
        return changed


@dataclass(frozen=True)
class Cast(_ChangesPoints):
    """The points handed over as another dtype, `PointCloud` casts them back to float32."""

    dtype: str

    def _changed(self, points: Points) -> NDArray[Any]:
        return points.astype(self.dtype)


@dataclass(frozen=True)
class Strided(_ChangesPoints):
    """The points handed over as every second column of a larger array in Fortran order."""

    def _changed(self, points: Points) -> NDArray[Any]:
        larger = np.full((len(points), 6), np.nan, np.float32, order="F")
        larger[:, ::2] = points
        return larger[:, ::2]


@dataclass(frozen=True)
class Repeated(_ChangesPoints):
    """Every `times`-th row, repeated `times` times in succession.

    The original fills a network of 2,048 points in this way (roatienza/pc2pix@23b7b46d,
    render_by_pc2pix.py).
    """

    times: int

    def _changed(self, points: Points) -> NDArray[Any]:
        return np.repeat(points[:: self.times], self.times, axis=0)


@dataclass(frozen=True)
class LastBit:
    """A rounding error: coordinates move by one unit in the last place, up, down or not at all."""

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return the cloud with coordinates that are off by a rounding error."""
        step = rng.integers(-1, 2, cloud.points.shape)
        beyond = np.copysign(np.float32(np.inf), step).astype(np.float32)
        goal = np.where(step == 0, cloud.points, beyond)
        return replace(cloud, points=np.nextafter(cloud.points, goal))


@dataclass(frozen=True)
class Shuffled:
    """A cloud with its points in another order."""

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return a permutation of the rows."""
        return replace(cloud, points=rng.permutation(cloud.points))


@dataclass(frozen=True)
class Kept:
    """A random `share` of the rows, in their order; at least one."""

    share: float

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return a subset of the rows."""
        count = max(round(self.share * len(cloud)), 1)
        rows = np.sort(rng.choice(len(cloud), size=count, replace=False))
        return replace(cloud, points=cloud.points[rows])


@dataclass(frozen=True)
class Half(_ChangesPoints):
    """The points with a negative X: half of the object is cut away."""

    def _changed(self, points: Points) -> NDArray[Any]:
        return points[points[:, 0] < 0]


@dataclass(frozen=True)
class UnitBox:
    """A clean sample of a cube in the unit sphere, which becomes the source."""

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return 2,048 points of the cube, whatever the cloud."""
        del cloud
        return sample_surface(normalise(_unit_cube()), rng, CLOUD_SIZE)


def _unit_cube() -> Mesh:
    """Return the grey cube of edge 1 about the origin."""
    # The corners stand in the order of `data_prep.shapes.solids.box`: samples depend on it.
    ring = [(0.5, -0.5), (0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5)]
    vertices = [(x, y, z) for y in (-0.5, 0.5) for x, z in ring]
    faces = [
        *[(5, 1, 0), (6, 2, 1), (7, 3, 2), (4, 0, 3), (4, 5, 0), (5, 6, 1), (6, 7, 2), (7, 4, 3)],
        *[(0, 1, 2), (0, 2, 3), (6, 5, 4), (7, 6, 4)],
    ]
    return Mesh(np.array(vertices), np.array(faces), np.full((len(faces), 3), NEUTRAL_GREY))


@dataclass(frozen=True)
class Turned:
    """Cloud and source turned about Y, so that a camera at azimuth + `degrees` sees the same."""

    degrees: float

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return the turned cloud and source, without randomness."""
        del rng
        angle = np.radians(self.degrees)
        sine, cosine = np.sin(angle), np.cos(angle)
        # From above, azimuth grows clockwise: -Z goes towards +X.
        turn = np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])
        source = cloud.source
        if source is not None:
            source = Mesh(source.vertices @ turn.T, source.faces, source.face_colors)
        return PointCloud(cloud.points @ turn.T, source=source)


@dataclass(frozen=True)
class Normalised(_ChangesPoints):
    """The cloud times `factor`, moved by `distance` and normalised again, in float64.

    With `whole`, it is rounded to integers before it is normalised.
    """

    factor: float = 1.0
    distance: float = 0.0
    whole: bool = False

    def _changed(self, points: Points) -> NDArray[Any]:
        moved = points.astype(np.float64) * self.factor + self.distance
        raw = np.rint(moved).astype(np.int64) if self.whole else moved
        return normalise_points(raw).points
