"""Parametric Gauss reconstruction (Lin, Xiao, Shi and Wang, ACM Trans. Graph. 42(2), 2022).

By Gauss' formula the indicator of a solid (1 inside, 0 outside, 1/2 on its surface) is an integral
over its surface. With samples y_j for the surface, and unknown vectors mu_j for area times normal,

    chi(x) = sum_j K(x, y_j) . mu_j    K(x, y) = (x - y) / (4 pi r^3)    r = max(|x - y|, width)

and chi(y_i) = 1/2 at all samples is a linear system A mu = 1/2 with A of shape [N, 3 N]. Of its
many solutions the one of least norm is found, A's Gram matrix having its diagonal raised by 5 %. No
normals are needed. The surface is where chi has the mean of its values at the samples.

Cost    Of more than 2,500 points every nth is used: A takes 75 MB in float32, its Gram matrix 25.
Grid    chi is evaluated only where a sample is near; faces apart from the samples are not drawn,
        as in `baselines.reconstruction.poisson`.
Noise   Noisy points are smoothed first, as in `baselines.reconstruction.denoised`. The width alone
        does not deal with it: wide enough for the noise, it loses the parts.
Width   Follows the spacing of the points, which grows with noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.spatial import cKDTree

from baselines.reconstruction.denoised import cleaned
from baselines.reconstruction.stages import DrawsReconstruction, Reconstruction, in_grey
from baselines.reconstruction.surface_fit import FOOTPRINT
from data_prep.arrays import Floats32
from data_prep.failures import StageFailure
from data_prep.scene import Mesh, PointCloud

MOST_POINTS = 2500
RAISED_DIAGONAL = 1.05
REACH = 2.0  # of the surface from the samples, in spacings
CELL_PX = 1.74  # side of a cell of the grid, in pixels at the origin
LARGEST = 2.01  # longest side of a box that has such cells; larger ones have larger cells
CHUNK = 1024  # places at a time: 10 MB for each array of places x samples


@dataclass(frozen=True)
class ParametricGauss(DrawsReconstruction):
    """The parametric Gauss reconstruction.

    `width` is the kernel's, in spacings of the points, `cell_px` the side of a cell of the grid, in
    pixels at the origin.
    """

    width: float = 1.0
    cell_px: float = CELL_PX

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Reconstruct the surface; no randomness, and the order of the points does not matter.

        Points as far away as the camera, and farther, are left out.

        Raises StageFailure: `input` (fewer than 11 different points in sight, or a non-finite one),
        `gauss` (no solution) or `marching-cubes` (no surface near the points).
        """
        del rng
        clean = cleaned(cloud, 1.0, MOST_POINTS)
        width = self.width * clean.spacing
        samples = clean.points.astype(np.float32)
        vectors = solution(samples, np.float32(width))
        cell = self.cell_px * FOOTPRINT
        mesh = surface(samples, vectors, np.float32(width), REACH * clean.spacing, cell)
        return Reconstruction(mesh, (*clean.notes, f"width: {width:.3f}"))


@np.errstate(over="ignore", divide="ignore", invalid="ignore")
def solution(samples: Floats32, width: np.float32) -> Floats32:
    """Return the vectors mu [N, 3] of samples [N, 3]; `width` > 0.

    Raises StageFailure("gauss", ...) where rounding leaves the system without a solution.
    """
    inverse = inverse_cube(samples, samples, width)
    parts = [(samples[:, axis, None] - samples[:, axis]) * inverse for axis in range(3)]
    kernel = np.concatenate(parts, axis=1)  # K as a matrix [N, 3 N]: all x, then all y, then all z
    gram = kernel @ kernel.T
    gram[np.diag_indices_from(gram)] *= RAISED_DIAGONAL
    try:
        factor = cho_factor(gram, overwrite_a=True, check_finite=False)
    except LinAlgError as error:
        raise StageFailure("gauss", f"the samples' system has no solution: {error}") from error
    weights = cho_solve(factor, np.full(len(samples), 0.5, np.float32), check_finite=False)
    vectors = (kernel.T @ weights).reshape(3, -1).T.astype(np.float32)
    if not np.isfinite(vectors).all():  # of samples so near that 1 / r^3 overflows
        raise StageFailure("gauss", "the samples' system has no finite solution")
    return vectors


def indicator(
    places: Floats32, samples: Floats32, vectors: Floats32, width: np.float32
) -> Floats32:
    """Return chi [M] at places [M, 3]."""
    values = np.empty(len(places), np.float32)
    constant = (samples * vectors).sum(axis=1)
    for first in range(0, len(places), CHUNK):
        part = slice(first, first + CHUNK)
        flux = places[part] @ vectors.T - constant
        values[part] = (flux * inverse_cube(places[part], samples, width)).sum(axis=1)
    return values


def surface(
    samples: Floats32, vectors: Floats32, width: np.float32, reach: float, cell: float
) -> Mesh:
    """Return the level set through the samples, up to `reach` from them; its faces turn outwards.

    `cell` is the side of the grid's cells, which are larger where the samples' box is.

    Raises StageFailure("marching-cubes", ...) where there is none.
    """
    from skimage.measure import marching_cubes

    level = float(indicator(samples, samples, vectors, width).mean())
    cell *= max(1.0, float(np.ptp(samples, axis=0).max()) / LARGEST)
    margin = reach + 3 * cell
    low = samples.min(axis=0) - margin
    shape = np.ceil((samples.max(axis=0) + margin - low) / cell).astype(int) + 1
    grid = np.moveaxis(np.indices(shape, np.float32), 0, -1) * np.float32(cell) + low
    tree = cKDTree(samples)
    # A face within reach lies in a cell whose corners are at most a diagonal farther.
    farthest = reach + math.sqrt(3) * cell
    distance, _ = tree.query(grid.reshape(-1, 3), distance_upper_bound=farthest)
    near = np.isfinite(distance)
    values = np.zeros(near.shape, np.float32)
    values[near] = indicator(grid.reshape(-1, 3)[near], samples, vectors, width)
    try:
        vertices, faces, _, _ = marching_cubes(
            values.reshape(shape), level, gradient_direction="ascent"
        )
    except (ValueError, RuntimeError) as error:  # no value on one side of the level
        raise StageFailure("marching-cubes", str(error)) from error
    vertices = vertices * cell + low
    distance, _ = tree.query(vertices)
    kept = faces[(np.asarray(distance)[faces] <= reach).all(axis=1)]
    if len(kept) == 0:
        raise StageFailure("marching-cubes", f"no face within {reach:.3g} of the points")
    used, corners = np.unique(kept, return_inverse=True)
    return in_grey(vertices[used], corners.reshape(-1, 3))


def inverse_cube(places: Floats32, samples: Floats32, width: np.float32) -> Floats32:
    """Return 1 / (4 pi r^3), [M, N]."""
    square = (places**2).sum(axis=1)[:, None] - 2 * (places @ samples.T)
    square += (samples**2).sum(axis=1)
    np.maximum(square, width**2, out=square)
    cube = np.sqrt(square)
    cube *= square
    cube *= np.float32(4 * math.pi)
    return np.reciprocal(cube, out=cube)
