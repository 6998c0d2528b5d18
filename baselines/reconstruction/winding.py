"""Screened Poisson reconstruction from normals that agree with their winding-number field.

Orientation is that of Lin, Shi and Liu (Fast and globally consistent normal orientation based on
the winding number normal consistency, ACM Trans. Graph. 43(6), 2024). Samples y_j with vectors
mu_j, area times outward normal, have the field

    chi(x) = sum_j (y_j - x) . mu_j / (4 pi r^3)    r = max(|x - y_j|, width)

which is 1 inside, 0 outside and 1/2 on the surface where the vectors are right, and whose negative
gradient at a sample then has the direction of its vector. From vectors of 0, two steps alternate:

Half        A step of steepest descent, as long as is best, towards chi = 1/2 at all samples.
Consistency The directions become those of the negative gradient; the lengths stay.

The width falls from round to round, so that the whole is decided before the parts. No neighbour
hands its orientation on to the next, which is how noise and thin parts mislead other methods.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from baselines.reconstruction.denoised import CLEAN_DEPTH, NOISY_DEPTH, cleaned
from baselines.reconstruction.gauss import inverse_cube
from baselines.reconstruction.poisson import trimmed_poisson
from baselines.reconstruction.stages import DrawsReconstruction, Reconstruction, spacing
from data_prep.arrays import Floats32
from data_prep.failures import StageFailure
from data_prep.scene import PointCloud, Points

MOST_POINTS = 2500  # two matrices of 25 MB
ROUNDS = 40
WIDEST, NARROWEST = 2.0, 0.25  # width in the first and the last round, in spacings of the points
REACH = 1.5  # of the surface from the samples, in spacings
WEIGHT = 10.0  # of the points against the normals


@dataclass(frozen=True)
class WindingPoisson(DrawsReconstruction):
    """Screened Poisson from winding-number normals, trimmed."""

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Reconstruct the surface; no randomness, and the order of the points does not matter.

        Points as far away as the camera, and farther, are left out.

        Raises StageFailure: `input` (fewer than 11 different points in sight, or a non-finite one),
        `winding` (no direction), `poisson` or `trim` where no face is near the points.
        """
        del rng
        clean = cleaned(cloud, 1.0, MOST_POINTS)
        normals = outward_normals(clean.points)
        depth = NOISY_DEPTH if clean.noise else CLEAN_DEPTH
        result = trimmed_poisson(clean.points, depth, normals, WEIGHT, REACH)
        return Reconstruction(result.mesh, (*clean.notes, *result.notes))


@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def outward_normals(points: Points) -> Floats32:
    """Return outward unit normals [N, 3] of different points [N, 3], N > 1.

    Raises StageFailure("winding", ...) where the vectors vanish or are not finite.
    """
    exact = points.astype(np.float64)
    # In spacings, so that no power of a distance leaves the range of float32.
    samples = ((exact - exact.mean(axis=0)) / spacing(points)).astype(np.float32)
    cube, fifth, near = _kernels(samples)
    vectors = np.zeros_like(samples)
    for width in np.linspace(WIDEST, NARROWEST, ROUNDS, dtype=np.float32):
        near.cut_off(cube, fifth, width)
        step = _transposed(cube, samples, 0.5 - _field(cube, samples, vectors))
        response = _field(cube, samples, step)
        vectors = vectors + step * ((step**2).sum() / (response**2).sum())
        length = np.linalg.norm(vectors, axis=1, keepdims=True)
        vectors = length * _unit(_descent(cube, fifth, samples, vectors))
    normals = _unit(vectors)
    if not np.isfinite(normals).all() or not normals.any():
        raise StageFailure("winding", "the points determine no direction")
    return normals


@dataclass(frozen=True, eq=False)
class _NearPairs:
    """The pairs nearer than the widest width: their places in a raveled matrix, and distances."""

    places: NDArray[np.intp]
    distances: Floats32

    def cut_off(self, cube: Floats32, fifth: Floats32, width: np.float32) -> None:
        """Set the entries of the pairs in both kernels, which nothing but the width changes."""
        r = np.maximum(self.distances, width)
        cube.ravel()[self.places] = 1 / (4 * math.pi * r**3)
        fifth.ravel()[self.places] = (self.distances >= width) / (4 * math.pi * r**5)


def _kernels(samples: Floats32) -> tuple[Floats32, Floats32, _NearPairs]:
    """Return 1 / (4 pi r^3) and 1 / (4 pi r^5), [N, N] each, and the pairs that a width changes."""
    cube = inverse_cube(samples, samples, np.float32(NARROWEST))
    fifth = cube * np.cbrt((np.float32(4 * math.pi) * cube) ** 2)
    pairs = cKDTree(samples).query_pairs(WIDEST, output_type="ndarray")
    alone = np.arange(len(samples))
    first = np.concatenate([pairs[:, 0], pairs[:, 1], alone])
    second = np.concatenate([pairs[:, 1], pairs[:, 0], alone])
    distances = np.linalg.norm(samples[first] - samples[second], axis=1)
    return cube, fifth, _NearPairs(first * len(samples) + second, distances)


def _field(cube: Floats32, samples: Floats32, vectors: Floats32) -> Floats32:
    """Return chi [N] at the samples: with d = y_j - y_i the sum of d . mu_j / (4 pi r^3)."""
    flux = (samples * vectors).sum(axis=1, keepdims=True)
    sums = cube @ np.hstack([vectors, flux])
    return sums[:, 3] - (samples * sums[:, :3]).sum(axis=1)


def _transposed(cube: Floats32, samples: Floats32, values: Floats32) -> Floats32:
    """Return the vectors [N, 3] that the transpose of `_field` makes of values [N]."""
    sums = cube @ np.hstack([samples * values[:, None], values[:, None]])
    return (samples * sums[:, 3:] - sums[:, :3]).astype(np.float32)


def _descent(cube: Floats32, fifth: Floats32, samples: Floats32, vectors: Floats32) -> Floats32:
    """Return the negative gradient [N, 3] of chi at the samples.

    It is the sum of mu / (4 pi r^3) - 3 d (d . mu) / (4 pi r^5) with d = y_j - y_i, the second term
    only beyond the width. Multiplied out, it is two products of matrices: no array is [N, N, 3].
    """
    flux = (samples * vectors).sum(axis=1, keepdims=True)
    outer = (samples[:, :, None] * vectors[:, None]).reshape(-1, 9)
    sums = fifth @ np.hstack([vectors, flux, outer, samples * flux])
    along = (samples * sums[:, :3]).sum(axis=1, keepdims=True) - sums[:, 3:4]
    mixed = (sums[:, 4:13].reshape(-1, 3, 3) @ samples[:, :, None])[:, :, 0]
    result = cube @ vectors - 3 * (sums[:, 13:] - mixed + samples * along)
    return result.astype(np.float32)


def _unit(vectors: Floats32) -> Floats32:
    """Return vectors [N, 3] with length 1; those of no length as they are."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return (vectors / np.where(length > 0, length, 1)).astype(np.float32, copy=False)
