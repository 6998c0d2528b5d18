"""Surfels of a cloud: its points with the normals and flatness of the surface around them.

They do not depend on the camera. Normals and flatness are given at several scales, by the hops of
`baselines.neighbourhoods`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.neighbourhoods import fit_planes
from data_prep.clouds.sorting import different_points

HOPS = (1, 2, 4)  # hops of the neighbourhoods at the three scales
FLATTENED = (1, 2)  # scales, as indices into HOPS, onto whose planes points are also moved
_LARGEST = float(np.finfo(np.float32).max)  # bound of coordinates, so that they stay finite


@dataclass(frozen=True, eq=False)
class Surfels:
    """The surfels of one cloud, or of several, which are then along leading dimensions `...`.

    Tensors are float32, in unit-sphere coordinates.

    points     [..., N, 3]
    flattened  [..., N, 2, 3]: the points moved onto the planes of their neighbourhoods, at the two
               scales of FLATTENED
    normals    [..., N, 3, 3]: at the three scales, unit vectors of either sign
    variation  [..., N, 3]: at the three scales, the surface variation (`neighbourhoods.Planes`),
               from 0 for a plane to 1/3

    Surfels that were made without surfaces have no scale: sizes of 0 in place of 2 and 3.
    """

    points: Tensor
    flattened: Tensor
    normals: Tensor
    variation: Tensor

    def __len__(self) -> int:
        return self.points.shape[-2]


def find_surfels(
    points: NDArray[np.float32], workers: int = 1, *, surfaces: bool = True
) -> Surfels:
    """Return the surfels of a cloud, sorted by coordinates and without points that coincide.

    So neither the order of the points nor repeated ones change the result.

    points    [N, 3], finite, N > 0
    workers   threads that search for neighbours
    surfaces  whether `normals`, `variation` and `flattened` are needed. Without them the result has
              the points alone, which takes a small part of the time

    Where all points of a neighbourhood coincide, its normal is an arbitrary unit vector, and its
    variation is 0.
    """
    place = different_points(points).astype(np.float64)
    if not surfaces:
        no_scale = torch.empty((len(place), 0, 3))
        return Surfels(
            points=torch.from_numpy(place.astype(np.float32)),
            flattened=no_scale,
            normals=no_scale,
            variation=no_scale[..., 0],
        )
    normals, variation, flattened = [], [], []
    for scale, planes in enumerate(fit_planes(place, HOPS, workers)):
        normals.append(planes.normals)
        variation.append(planes.variation)
        if scale in FLATTENED:
            flattened.append(planes.flattened.clip(-_LARGEST, _LARGEST))
    return Surfels(
        points=torch.from_numpy(place.astype(np.float32)),
        flattened=torch.from_numpy(np.stack(flattened, axis=1).astype(np.float32)),
        normals=torch.from_numpy(np.stack(normals, axis=1).astype(np.float32)),
        variation=torch.from_numpy(np.stack(variation, axis=1).astype(np.float32)),
    )


def stack(surfels: list[Surfels]) -> Surfels:
    """Return several clouds as one `Surfels`, with a leading dimension for the clouds.

    The last surfel of a cloud with fewer than the largest is repeated.
    """
    most = max(len(cloud) for cloud in surfels)

    def together(name: str) -> Tensor:
        filled = []
        for cloud in surfels:
            rows = torch.arange(most).clamp(max=len(cloud) - 1)
            filled.append(vars(cloud)[name][rows])
        return torch.stack(filled)

    return Surfels(**{field.name: together(field.name) for field in fields(Surfels)})
