"""The part that fused-net sees of a cloud with more points than it was trained for.

The network knows clouds of at most 2,048 points, and its mesh is made of as many. Of many more it
is shown a random subset. What the other points tell reaches it in these ways:

Noise   Where the points are noisy, the subset is moved to where the whole cloud tells that the
        surface is (`baselines.reconstruction.dense`).
Mesh    Where the noise is not strong, the mesh that the network sees is that of upsampled-wrap, of
        8,192 points as they are; without noise it is drawn alone (`enlarging`). Else the mesh is
        made of the subset, as of a cloud of few points.

Chosen on five to seven objects of procedural:validation. LPIPS at 128 pixels of 32,768 points,
where the network is shown all of them, and as it is drawn now: with noise of 0.01 .051 and .036, of
0.05 .128 and .074, of 0.1 .232 and .150. Clean points are .027 now.
"""

from __future__ import annotations

from typing import NamedTuple

from baselines.reconstruction.alpha_wrap import MOST_WRAPPED
from baselines.reconstruction.dense import noise_to_remove, smoothed_subset
from baselines.reconstruction.stages import used_points
from data_prep.clouds.sampling import at_most
from data_prep.scene import PointCloud, Points

# Number of different points up to which the network is shown all of them. Of 4,096 points with
# noise of 0.05 LPIPS is .096 then; with what is done for more points it would be .109.
FEW = 4096
_SHOWN = 8192  # points of a larger cloud that are shown, or moved
# From this noise on (standard deviation) fewer of the moved points are shown: what is left of their
# noise is then small against the distance of neighbours.
_STRONG = 0.02
_SHOWN_OF_STRONG = 2048
# From this noise on the points are shown as they are: the network, which was trained with noise of
# 0.1, knows better than a fit.
_STRONGEST = 0.08


class Shown(NamedTuple):
    """The part of a cloud that is shown to the network, with how it was chosen.

    cloud   the points
    source  all points of a cloud with many, of which the mesh is made; None where it is made of
            `cloud`
    noise   the standard deviation of their noise; 0 where it is small
    notes   what was done to the cloud, for the user
    """

    cloud: PointCloud
    source: Points | None = None
    noise: float = 0.0
    notes: tuple[str, ...] = ()


def shown_to_network(cloud: PointCloud) -> Shown:
    """Return what the network is shown of a cloud: all of it, where it has at most FEW points.

    Points beyond the camera are left out of a larger cloud, and all but one of points that
    coincide. The order of the points does not matter.

    Raises StageFailure at the stage "input" for a larger cloud with a point that is not finite, or
    without any point nearer than the camera.
    """
    if len(cloud) <= FEW:
        return Shown(cloud)
    points, left_out = used_points(cloud, 1, len(cloud), "images")
    if len(points) <= FEW:
        return Shown(cloud)
    noise = noise_to_remove(points, MOST_WRAPPED)
    source = points if noise < _STRONG else None
    if noise == 0 or noise > _STRONGEST:
        few, used = at_most(_SHOWN_OF_STRONG if noise else _SHOWN, points)
    else:
        moved = smoothed_subset(points, noise, _SHOWN)
        few, _ = at_most(_SHOWN if noise < _STRONG else _SHOWN_OF_STRONG, moved)
        used = (f"input: {len(few)} points used, smoothed by all {len(points)}",)
    of_noise = (f"noise: {noise:.3f}",) if noise else ()
    return Shown(PointCloud(few), source, noise, (*of_noise, *left_out, *used))
