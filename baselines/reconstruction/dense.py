"""Clouds with more points than methods were made for: their noise, and fewer points without it.

Methods and networks here were made for clouds of 2,048 points. Of a clean cloud of more, a random
subset is such a cloud. Of a noisy one a subset is as noisy as the whole, although the whole tells
where the surface is: around each point of a subset there are hundreds whose noise averages out. So
the points of the subset are moved onto height fields that are fitted to points of the whole cloud
(moving least squares, as in `baselines.reconstruction.denoised`).

The constants were chosen by LPIPS of images by fused-net of seven objects of procedural:validation,
of 8,192 and 32,768 points with noise of standard deviation 0.005 to 0.1.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from baselines.reconstruction.denoised import (
    DENSITY_NEIGHBOURS,
    LEFT_OUT,
    MOST_LEFT_OUT,
    NOISY,
    PATCHES,
    WIDE,
    dense_part,
    noise_in_patches,
    projected,
)
from baselines.reconstruction.layers import in_layers
from baselines.reconstruction.stages import Nearest, spacing
from data_prep.arrays import Floats
from data_prep.clouds.sampling import random_rows
from data_prep.scene import Points

_SAMPLED = 2048  # patches that noise is estimated from; the fewest points of a thinned cloud
_THINNED = 8  # a cloud whose noise is wider than its patches is thinned to so many-th of its points
# Radius of the neighbourhood of a fit in standard deviations of the noise. That leaves half of the
# noise, which the network can bear; with 3, as for clouds of few points, thin parts vanish.
_PATCH = 1.5
_FEWEST, _MOST = 24, 256  # bounds of the points of a fit, which has six coefficients
_ROUNDS = 2  # times that each point is moved; 4 give the same LPIPS
_ASKED = 512  # points whose neighbourhoods are counted, to find how many points a fit has


def noise_to_remove(points: Points, used: int) -> float:
    """Return the noise of points [N, 3], or 0 where `used` of them count as clean.

    They do where the noise is small against the distance of neighbours among so many points, and
    where points lie in layers. N is at least 2,048, and no two points coincide.
    """
    noise = dense_noise(points)
    near = Nearest(points[random_rows(len(points), used)])
    return noise if noise > NOISY * spacing(near) and not in_layers(near) else 0.0


def dense_noise(points: Points) -> float:
    """Return the standard deviation of the noise of points [N, 3] along the surface's normal.

    It is estimated in the smallest patches that are wider than the noise: first in patches of
    neighbours in the whole cloud, which are nearly flat, then in patches of random subsets. N is at
    least 2,048, and no two points coincide.
    """
    noise = 0.0
    while True:
        tree = cKDTree(points)
        at = points[random_rows(len(points), _SAMPLED)]
        distance, index = map(np.asarray, tree.query(at, k=range(1, PATCHES[-1] + 1)))
        exact = points.astype(np.float64)
        for k in PATCHES:
            noise, share = noise_in_patches(exact, distance[:, k - 1], index[:, :k])
            if share <= WIDE:
                return noise
        if len(points) <= _SAMPLED:
            return noise
        points = points[random_rows(len(points), max(len(points) // _THINNED, _SAMPLED))]


def smoothed_subset(points: Points, noise: float, count: int) -> Points:
    """Return a random subset of `count` points [N, 3] without their noise, but for the sparsest.

    noise  the standard deviation, above 0
    count  of the subset before those points are left out that noise has moved far from all others,
           a share that grows with the noise
    """
    tree = cKDTree(points)
    asked = points[random_rows(len(points), _ASKED)]
    around = np.median(tree.query_ball_point(asked, _PATCH * noise, return_length=True))
    # Of more points around each other than a fit needs, a random subset is spread as widely.
    used = points[random_rows(len(points), max(_SAMPLED, round(len(points) * _MOST / around)))]
    neighbours = int(np.clip(around * len(used) / len(points), _FEWEST, _MOST))
    tree = cKDTree(used)
    surroundings = used.astype(np.float64)
    moved: Floats = points[random_rows(len(points), count)].astype(np.float64)
    for _ in range(_ROUNDS):
        _, index = tree.query(moved, k=range(1, neighbours + 1))
        moved = projected(moved, surroundings, np.asarray(index))
    share = 1 - min(LEFT_OUT * noise, MOST_LEFT_OUT)
    return dense_part(moved, share, DENSITY_NEIGHBOURS).astype(np.float32)
