"""Clouds at the edges of the domain, and beyond: perturbations for the suite `stability`.

They are `data_prep.conditions.Perturbation`s: small values, whose `repr` is part of a key. Whatever
they do to the points, `source` stays the mesh of the cloud they were given, unless it is said.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from data_prep.mesh_files import NEUTRAL_GREY
from data_prep.normalise import normalise, normalise_points
from data_prep.sampling import sample_surface
from data_prep.scene import CLOUD_SIZE, Mesh, PointCloud
from data_prep.shapes.solids import box, join


@dataclass(frozen=True)
class Count:
    """`count` points: the first rows, or a new sample of the source where there are not as many."""

    count: int

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Raises ValueError for a larger count than the cloud's where its source is not known."""
        if self.count <= len(cloud):
            return replace(cloud, points=cloud.points[: self.count])
        if cloud.source is None:
            raise ValueError(f"{self.count} points: the source of the cloud is not known")
        return sample_surface(cloud.source, rng, self.count)


@dataclass(frozen=True)
class Equal:
    """As many points as before, all equal to the first."""

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """No randomness."""
        del rng
        return replace(cloud, points=np.repeat(cloud.points[:1], len(cloud), axis=0))


@dataclass(frozen=True)
class Flattened:
    """The first `axes` coordinates are kept, the others become 0: 2 a plane, 1 a line."""

    axes: int

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """No randomness."""
        del rng
        points = cloud.points.copy()
        points[:, self.axes :] = 0.0
        return replace(cloud, points=points)


@dataclass(frozen=True)
class TwoClusters:
    """The cloud shrunk to a tenth, half of its rows at -0.9, half at +0.9 on X."""

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """No randomness."""
        del rng
        points = cloud.points * np.float32(0.1)
        points[: len(points) // 2, 0] -= np.float32(0.9)
        points[len(points) // 2 :, 0] += np.float32(0.9)
        return replace(cloud, points=points)


@dataclass(frozen=True)
class FirstPoint:
    """The first coordinate of the first point becomes `value`: an outlier, NaN or infinity."""

    value: float

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """No randomness."""
        del rng
        points = cloud.points.copy()
        points[0, 0] = self.value
        return replace(cloud, points=points)


@dataclass(frozen=True)
class Scaled:
    """All coordinates times `factor`, in float32."""

    factor: float

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """No randomness."""
        del rng
        return replace(cloud, points=cloud.points * np.float32(self.factor))


@dataclass(frozen=True)
class Shifted:
    """All points moved by `distance` along X; float32 rounds them to its grid out there."""

    distance: float

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """No randomness."""
        del rng
        points = cloud.points.copy()
        points[:, 0] += np.float32(self.distance)
        return replace(cloud, points=points)


@dataclass(frozen=True)
class Cast:
    """The points handed over as another dtype, `PointCloud` casts them back to float32."""

    dtype: str

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """No randomness."""
        del rng
        return replace(cloud, points=cloud.points.astype(self.dtype))


@dataclass(frozen=True)
class Strided:
    """The points handed over as every second column of a larger array in Fortran order."""

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """No randomness."""
        del rng
        larger = np.full((len(cloud), 6), np.nan, np.float32, order="F")
        larger[:, ::2] = cloud.points
        return replace(cloud, points=larger[:, ::2])


@dataclass(frozen=True)
class Repeated:
    """Every `times`-th row, repeated `times` times in succession.

    How the original fills a network that takes 2,048 points (roatienza/pc2pix@23b7b46d,
    render_by_pc2pix.py).
    """

    times: int

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """No randomness."""
        del rng
        return replace(cloud, points=np.repeat(cloud.points[:: self.times], self.times, axis=0))


@dataclass(frozen=True)
class Shuffled:
    """The same points in another order."""

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """A permutation of the rows."""
        return replace(cloud, points=rng.permutation(cloud.points))


@dataclass(frozen=True)
class Kept:
    """A random `share` of the rows, in their order; at least one."""

    share: float

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """A subset of the rows."""
        count = max(round(self.share * len(cloud)), 1)
        rows = np.sort(rng.choice(len(cloud), size=count, replace=False))
        return replace(cloud, points=cloud.points[rows])


@dataclass(frozen=True)
class Half:
    """The points with a negative X: half of the object is cut away."""

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """No randomness."""
        del rng
        return replace(cloud, points=cloud.points[cloud.points[:, 0] < 0])


@dataclass(frozen=True)
class UnitBox:
    """A clean sample of a cube in the unit sphere, which becomes the source."""

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """2,048 points, whatever the cloud."""
        del cloud
        cube = normalise(join([box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), NEUTRAL_GREY)]))
        return sample_surface(cube, rng, CLOUD_SIZE)


@dataclass(frozen=True)
class Turned:
    """Cloud and source turned about Y, so that a camera at azimuth + `degrees` sees the same."""

    degrees: float

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """No randomness."""
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
class Normalised:
    """In float64: the cloud times `factor`, then moved by `distance`, then to the unit sphere.

    With `whole`, it is rounded to integers before it is normalised.
    """

    factor: float = 1.0
    distance: float = 0.0
    whole: bool = False

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """No randomness."""
        del rng
        points = cloud.points.astype(np.float64) * self.factor + self.distance
        raw = np.rint(points).astype(np.int64) if self.whole else points
        return replace(cloud, points=normalise_points(raw).points)
