"""The conditions of the benchmark: named, seeded perturbations of clouds.

The paper's five are `2048`, `1024`, `512`, `noise-0.05` and `noise-0.10`. Paper and original code
differ in two places:

Down-sampling  The code takes each d-th row (roatienza/pc2pix@23b7b46d, render_by_pc2pix.py and
               downsample_ptcloud.py); the paper only says "down sampled". `1024` and `512` are the
               stride: our clouds are independent draws, so a stride is a uniform random subset, and
               it needs no random numbers. On clouds whose rows are ordered (a scanner's, say) it is
               none.
Noise          The paper adds N(0, sigma) to a cloud in a sphere of radius 1. The code adds the same
               sigma to coordinates in [-0.5, 0.5], which doubles it in our units. `noise-0.05` and
               `noise-0.10` are the paper's; `noise-0.10` and `noise-0.20` have the code's sigmas.

All others are ours. Few networks of this project have seen any in training: fewer points and more,
more noise, outliers, half an object, uneven density, and scans, which cast rays and stand in
`data_prep.rendering.scanned`. The true image always shows the whole object. Points keep their
colours, where clouds have some.

`bench.catalogue.conditions` has the table of all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

from data_prep.failures import BadInput

if TYPE_CHECKING:  # `bench list` answers at once
    import numpy as np
    from numpy.typing import NDArray

    from data_prep.scene import Mesh, PointCloud


class Perturbation(Protocol):
    """A change of a cloud: a small value that crosses process boundaries.

    Its `repr` is part of the key of a result.
    """

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return the perturbed cloud, with the same `source` unless that is moved along."""
        ...


@dataclass(frozen=True)
class Unchanged:
    """The cloud as it was sampled."""

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return the cloud itself."""
        del rng
        return cloud


@dataclass(frozen=True)
class Stride:
    """The rows 0, step, 2 step, ...: n points become ceil(n / step)."""

    step: int

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return each `step`-th row, without randomness."""
        del rng
        return cloud.take(slice(None, None, self.step))


@dataclass(frozen=True)
class MorePoints:
    """A cloud with further points of the mesh that it was sampled from, `count` in all.

    Its own points come first, in their order. By the same random numbers, the cloud of a larger
    `count` begins with that of a smaller one. A cloud of more points is cut to its first `count`.
    """

    count: int

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return the larger cloud. Raises BadInput where the cloud has no mesh."""
        import numpy as np

        from data_prep.clouds.sampling import sample_surface

        mesh, blocks = mesh_behind(cloud), [cloud]
        while sum(map(len, blocks)) < self.count:
            # Blocks of one size, so that a larger cloud begins with the draws of a smaller one.
            blocks.append(sample_surface(mesh, rng, coloured=cloud.colors is not None))
        points = np.concatenate([block.points for block in blocks])
        colors = [block.colors for block in blocks if block.colors is not None]
        joined = replace(cloud, points=points, colors=np.concatenate(colors) if colors else None)
        return joined.take(slice(self.count))


def mesh_behind(cloud: PointCloud) -> Mesh:
    """Return the mesh that a cloud was sampled from. Raises BadInput where there is none."""
    if cloud.source is None:
        raise BadInput(
            "the cloud has no mesh, which this condition samples anew; take an object with a mesh, "
            "or another condition"
        )
    return cloud.source


@dataclass(frozen=True)
class GaussianNoise:
    """Noise N(0, sigma) on each coordinate, in unit-sphere units; nothing is clipped."""

    sigma: float

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return the moved points."""
        noise = rng.normal(scale=self.sigma, size=cloud.points.shape)
        return replace(cloud, points=cloud.points + noise.astype(cloud.points.dtype))


@dataclass(frozen=True)
class Outliers:
    """Random points in place of a share of the points, in 0..1.

    round(share n) of n rows, drawn without replacement, become independent draws, uniform in the
    ball of radius 1 about the origin, in which every object lies. The number of points stays. Each
    keeps the colour of its row, which is that of a random point of the object.
    """

    share: float

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return the cloud with some rows replaced."""
        count = round(self.share * len(cloud))
        rows = rng.choice(len(cloud), size=count, replace=False)
        directions = rng.normal(size=(count, 3))
        directions /= (directions**2).sum(axis=1, keepdims=True) ** 0.5
        radii = rng.random((count, 1)) ** (1 / 3)  # the ball within r has r^3 of the volume
        points = cloud.points.copy()
        points[rows] = directions * radii
        return replace(cloud, points=points)


@dataclass(frozen=True)
class Missing:
    """A cut by a plane that removes a share of the points, in 0..1: an object seen in part.

    The normal of the plane is uniform over all directions, and the round(share n) points that lie
    farthest along it are removed. Of equally far points the last rows go first; NaN counts as the
    farthest. The others keep their order and place: the cloud is not centred or scaled again.
    """

    share: float

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return the rows on one side of the plane."""
        order = _along_random_axis(cloud, rng).argsort(kind="stable")
        kept = order[: len(cloud) - round(self.share * len(cloud))]
        kept.sort()
        return cloud.take(kept)


@dataclass(frozen=True)
class UnevenDensity:
    """A thinning to half of the points, `ratio` times as dense at one end as at the other.

    Along an axis of uniformly random direction, from the first of the points (t = 0) to the last
    (t = 1), the chance of a point to stay is proportional to 1 + (ratio - 1) t, ratio >= 1; n
    points become floor(n / 2). The dense end is the end with more of the points (mean t >= 1/2), so
    that no chance exceeds 1. A cloud without extent, or with a value that is not finite, is thinned
    evenly.

    The rows are drawn systematically (W. G. Madow, On the theory of systematic sampling, II, Ann.
    Math. Stat. 20, 1949): equal steps through the sums of chances, from a random start. The number
    of rows is fixed and every row has exactly its chance, unlike in successive draws without
    replacement. Rows keep their order.
    """

    ratio: float

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return half of the rows."""
        import numpy as np

        along = _along_random_axis(cloud, rng)
        start = rng.random()
        count = len(cloud) // 2
        if count == 0:
            return cloud.take(slice(0))
        t = np.zeros(len(cloud))
        if np.isfinite(along).all() and np.ptp(along) > 0:
            t = (along - along.min()) / np.ptp(along)
        if t.mean() < 0.5:
            t = 1 - t
        sums = (1 + (self.ratio - 1) * t).cumsum()
        steps = (start + np.arange(count)) / count
        rows = np.searchsorted((sums / sums[-1])[:-1], steps, side="right")
        return cloud.take(rows)


def _along_random_axis(cloud: PointCloud, rng: np.random.Generator) -> NDArray[Any]:
    """Return the coordinates float64 [N] along an axis of uniformly random direction."""
    import numpy as np

    axis = rng.normal(size=3)
    axis /= (axis**2).sum() ** 0.5
    with np.errstate(invalid="ignore"):  # infinite values may cancel
        return (cloud.points * axis).sum(axis=1)  # no BLAS: the same bits on every machine


@dataclass(frozen=True)
class Condition:
    """A perturbation with a name.

    Other packages add conditions by entry points of the group `pc2pix_bench.conditions`: the name
    is the condition's id, the object a `Condition`.

    Attributes
    ----------
    id : str
        Name in kebab-case.
    perturbation : Perturbation
        Change of the cloud. Its `repr` shows all parameters.
    source : str
        Origin of the condition, for people.
    version : int
        Raised by hand when a change of the code alters the clouds.
    identity : callable
        Returns what else the clouds depend on, such as versions of libraries and checksums of
        files; a str.
    """

    id: str
    perturbation: Perturbation
    source: str
    version: int = 1
    identity: Callable[[], str] = str

    @property
    def key(self) -> str:
        """Return everything that the clouds depend on, for the key of finished work."""
        identity = self.identity()
        further = f" version {self.version} {identity}" if self.version != 1 or identity else ""
        return repr(self.perturbation) + further
