"""The conditions of the benchmark: named, seeded perturbations of a cloud.

The paper's five are `2048`, `1024`, `512`, `noise-0.05` and `noise-0.10`. Paper and original code
differ in two places, and both readings have a name:

Down-sampling  The code takes each d-th row (roatienza/pc2pix@23b7b46d, render_by_pc2pix.py and
               downsample_ptcloud.py); the paper only says "down sampled". `1024` and `512` are the
               stride: our clouds are independent draws, so a stride is a uniform random subset, and
               it needs no random numbers. `1024-random` and `512-random` draw a subset; on clouds
               whose rows are ordered (a scanner's, say) the two differ.
Noise          The paper adds N(0, sigma) to a cloud in a sphere of radius 1. The code adds the same
               sigma to coordinates in [-0.5, 0.5], which doubles it in our units. `noise-0.05` and
               `noise-0.10` are the paper's; `noise-0.05-code` and `noise-0.10-code` the code's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:  # `bench list` answers at once
    import numpy as np

    from data_prep.scene import PointCloud


class Perturbation(Protocol):
    """What is done to a cloud; a small value that crosses process boundaries.

    Its `repr` is part of the key under which a result is kept.
    """

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """The perturbed cloud. It keeps its `source`, unless that is moved along."""
        ...


@dataclass(frozen=True)
class Unchanged:
    """The cloud as it was sampled."""

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """The cloud itself."""
        del rng
        return cloud


@dataclass(frozen=True)
class Stride:
    """Rows 0, step, 2 step, ...: n points become ceil(n / step)."""

    step: int

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Each `step`-th row. No randomness."""
        del rng
        return replace(cloud, points=cloud.points[:: self.step])


@dataclass(frozen=True)
class RandomSubset:
    """`count` rows drawn without replacement, kept in their order; smaller clouds stay whole."""

    count: int

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """A subset of the rows."""
        if len(cloud) <= self.count:
            return cloud
        rows = rng.choice(len(cloud), size=self.count, replace=False)
        rows.sort()
        return replace(cloud, points=cloud.points[rows])


@dataclass(frozen=True)
class GaussianNoise:
    """N(0, sigma) on each coordinate, sigma in unit-sphere units; nothing is clipped."""

    sigma: float

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """All points, moved."""
        noise = rng.normal(scale=self.sigma, size=cloud.points.shape)
        return replace(cloud, points=cloud.points + noise.astype(cloud.points.dtype))


@dataclass(frozen=True)
class Condition:
    """A perturbation with a name and the place it comes from."""

    id: str
    perturbation: Perturbation
    source: str


CONDITIONS = (
    Condition("2048", Unchanged(), "paper, Tables 3 and 4"),
    Condition("1024", Stride(2), "paper, Tables 3 and 4; stride as in the original code"),
    Condition("512", Stride(4), "paper, Tables 3 and 4; stride as in the original code"),
    Condition("noise-0.05", GaussianNoise(0.05), "paper, Tables 3 and 4"),
    Condition("noise-0.10", GaussianNoise(0.10), "paper, Tables 3 and 4"),
    Condition("1024-random", RandomSubset(1024), "the paper's words, read literally"),
    Condition("512-random", RandomSubset(512), "the paper's words, read literally"),
    Condition("noise-0.05-code", GaussianNoise(0.10), "original code: 0.05 on [-0.5, 0.5]"),
    Condition("noise-0.10-code", GaussianNoise(0.20), "original code: 0.10 on [-0.5, 0.5]"),
)
