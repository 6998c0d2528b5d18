"""Surfels of a cloud, independent of the camera: normals, density, and where the surface is flat.

There are several scales, by hops (`baselines.neighbourhoods`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.neighbourhoods import fit_planes

HOPS = (1, 2, 4)
FLATTENED = (1, 2)  # the scales that points are flattened by
_LARGEST = float(np.finfo(np.float32).max)


@dataclass(frozen=True, eq=False)
class Surfels:
    """The surfels of one cloud, or of several (leading dimensions ...), in unit-sphere coordinates.

    Tensors are float32.

    points     [..., N, 3]
    flattened  [..., N, 2, 3]: the points moved onto the planes of their neighbourhoods, by scale
               of FLATTENED
    normals    [..., N, 3, 3]: unit vectors of either sign, by scale of HOPS
    variation  [..., N, 3]: surface variation, by scale: the smallest of the three eigenvalues of
               the covariance over their sum (Pauly, Gross and Kobbelt 2002), 0..1/3
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
    """Return the surfels of a cloud [N, 3] of finite points, N > 0: sorted, and each place once.

    Their order says nothing, nor does a point that is listed twice. `workers` threads search for
    neighbours. Of a single place any vector is as good a normal as another: the result is finite,
    and variation 0. Without `surfaces` there are the points alone, of no scale: the search costs
    many times as much as they do.
    """
    place = np.unique(points, axis=0).astype(np.float64)
    if not surfaces:
        none = torch.empty((len(place), 0, 3))
        return Surfels(torch.from_numpy(place.astype(np.float32)), none, none, none[..., 0])
    normals, variation, flattened = [], [], []
    for scale, planes in enumerate(fit_planes(place, HOPS, workers)):
        normals.append(planes.normals)
        variation.append(planes.variation)
        if scale in FLATTENED:
            flattened.append(planes.flattened.clip(-_LARGEST, _LARGEST))
    stacked = (np.stack(scales, axis=1) for scales in (flattened, normals, variation))
    return Surfels(*(torch.from_numpy(part.astype(np.float32)) for part in (place, *stacked)))


def stack(surfels: list[Surfels]) -> Surfels:
    """Return clouds as one with a leading dimension; the last place of shorter ones repeats."""
    most = max(len(s) for s in surfels)

    def together(name: str) -> Tensor:
        parts = [vars(s)[name] for s in surfels]
        return torch.stack([part[torch.arange(most).clamp(max=len(part) - 1)] for part in parts])

    return Surfels(*(together(field.name) for field in fields(Surfels)))
