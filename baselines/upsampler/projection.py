"""The surface that the network predicts for a cloud: it moves places near the cloud onto it.

A renderer uses it in two ways. New points are made by moving places around the points of the cloud
onto the surface. And a mesh is laid onto the surface: its corners are moved, and normals are asked
for at the middles of its faces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from baselines.upsampler.network import Upsampler
from baselines.upsampler.surroundings import places_around, surroundings
from data_prep.arrays import Floats
from data_prep.failures import StageFailure
from data_prep.rendering.camera import CAMERA_DISTANCE
from data_prep.scene import Points

# Distance from the nearest point, in spacings, up to which places are moved. In training, places
# were up to two spacings away along the surface, and a little above or below it.
_NEAR = 2.5
# Largest coordinate of a point of the surface, in scene units: twice the camera's distance. Weights
# of little training may give any number, and at 1e7 alpha wrapping does not end.
_FARTHEST = 2 * CAMERA_DISTANCE


@dataclass(frozen=True, eq=False)
class Projected:
    """Places that were moved onto the surface.

    A place far from all points of the cloud stays where it was, and has the normal of the nearest.

    points   float32 [Q, 3]
    normals  float32 [Q, 3], unit vectors of either sign
    """

    points: NDArray[np.float32]
    normals: NDArray[np.float32]


class LearnedSurface:
    """The surface that a network predicts for a cloud.

    network  in evaluation mode
    points   different, finite points [N, 3], N > 1

    spacing  the median spacing of the points, after smoothing where they are noisy
    smoothed whether the points are noisy, and were smoothed
    notes    what was done to the points, for the user
    """

    def __init__(self, network: Upsampler, points: Points) -> None:
        self.network = network
        device = next(network.parameters()).device
        seen, self.notes = surroundings(points)
        self.smoothed = bool(self.notes)
        self.spacing = float(np.median(seen.radius.numpy()))
        self.tree = cKDTree(seen.points.numpy())
        self.seen = seen.to(device)
        with torch.inference_mode():
            self.encoded = network.encode(self.seen)

    def upsampled(self, count: int) -> Projected:
        """Return `count` places around each point, [N * count, 3], moved onto the surface.

        Raises StageFailure("up-sampling", ...) where one is not finite, or far away, afterwards.
        """
        moved = self.project(places_around(self.seen, count).cpu().numpy())
        far = int((np.abs(moved.points) > _FARTHEST).any(axis=1).sum())
        if far:
            raise StageFailure("up-sampling", f"{far} of {len(moved.points)} points are far away")
        return moved

    def project(self, places: Points | Floats) -> Projected:
        """Return places [Q, 3] moved onto the surface.

        Raises StageFailure("up-sampling", ...) where one is not finite afterwards.
        """
        distance, nearest = self.tree.query(places)
        given = torch.from_numpy(np.asarray(places, np.float32)).to(self.seen.points.device)
        index = torch.from_numpy(nearest).to(given.device)
        with torch.inference_mode():
            moved, normals = self.network.project(self.encoded, given, index)
        near = torch.from_numpy(distance).to(index.device) <= _NEAR * self.seen.radius[index]
        points = torch.where(near[:, None], moved, given)
        told = torch.where(near[:, None], normals, self.seen.normals[index])
        bad = int((~torch.cat([points, told], dim=1).isfinite()).any(dim=1).sum())
        if bad:
            raise StageFailure("up-sampling", f"{bad} of {len(points)} points are not finite")
        return Projected(points.cpu().numpy(), told.cpu().numpy())
