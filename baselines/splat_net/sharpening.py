"""Sharp pixels for networks that see meshes: where drawing and mesh agree, the mesh is shown.

A network draws something like the mean of all possible images, so that its outlines and creases are
soft. Those of a mesh of the cloud are sharp, but sometimes wrong, and where a mesh is wrong the
network does not follow it. So pixels in which both nearly agree are taken from the mesh, and others
stay as drawn. The meshes are taken one after the other:

* Of any mesh only the pixels of outlines and creases are taken.
* The mesh of upsampled-wrap is more exact than a drawing where points are many and clean. There its
  even sides are taken as well, and larger differences count as agreement. Of sparse or noisy clouds
  nothing of it is taken, for there the drawing is the better one.

On 26 validation objects of 2,048 clean points LPIPS is .060 as drawn, .052 with the edges of the
first mesh, and .048 with both. It was also tried to let the network learn the share of the mesh in
each pixel, from the error of the mixed image or from errors of both; the shares came out near 0,
and LPIPS did not change. Nor did it help to take less of a mesh that agrees less on the whole.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from baselines.splat_net.network import NEUTRAL
from baselines.splat_net.projection import Inputs, scaled_window, spread
from baselines.splat_net.surfels import HOPS
from data_prep.rendering.raycast import GAMMA, MAPS


class _Agreement(NamedTuple):
    """The differences between drawing and mesh, in brightness 0..1, that count as agreement.

    At these the share of the mesh in a pixel has fallen to 1/e.

    outline  at outlines
    shading  elsewhere. It is smaller, because the shading of meshes has more errors
    """

    outline: float
    shading: float


_OF_EDGES = _Agreement(40 / 255, 20 / 255)
_OF_EXACT = _Agreement(50 / 255, 30 / 255)
_EXACT = "upsampled-wrap"  # the method whose mesh is exact where points are many and clean
# The number of points in the image from which on it is, and up to which nothing of it is taken: of
# 512 points LPIPS would be .080 instead of .076.
_SPARSE, _DENSE = 512, 2048
# Side of the window around a pixel in which the mesh must have an outline or a crease, in pixels of
# an image of 128.
_RIM = 5
# The range of the mesh's darkness, 0..1, within that window. Up to _EVEN it counts as no crease,
# because methods leave even surfaces a little uneven (a sphere of occupancy-net has ripples); from
# _CREASED on it counts as a crease wholly.
_EVEN, _CREASED = 20 / 255, 40 / 255
# The median surface variation of a cloud's smallest neighbourhoods, as in the channel "noise 1". Up
# to _CLEAN a cloud counts as clean. From _NOISY on the shading of its mesh shows nothing but noise,
# and is not taken.
_CLEAN, _NOISY = 0.30, 0.38
NEARLY_NOTHING = 1e-6  # smallest alpha that is divided by; below, what covers a pixel is not seen


def take_meshes(drawn: Tensor, channels: Tensor, inputs: Inputs) -> Tensor:
    """Return alpha and darkness [P, 2, S, S] of drawings, with some pixels from meshes.

    drawn     [P, 2, S, S]: alpha, and darkness, which is 1 less the grey of what covers a pixel;
              both 0..1
    channels  [P, C, S, S] that the network saw, with the maps of meshes
    inputs    what the channels are
    """
    maps = channels[:, inputs.of_points :].unflatten(1, (-1, len(MAPS))).float()
    clean = _clean(channels, inputs)
    for place, name in enumerate(inputs.meshes):
        of_mesh = planes_of_mesh(maps[:, place])
        if name == _EXACT:
            has_faces = maps[:, place, 0].amax(dim=(1, 2))[:, None, None] > 0
            weight = has_faces * clean * _dense(channels, inputs)
            share = weight * _share(drawn, of_mesh, _OF_EXACT, torch.ones_like(clean))
        else:
            share = _share(drawn, of_mesh, _OF_EDGES, clean * _creased(of_mesh[:, 1]))
        drawn = _mixed(drawn, of_mesh, share)
    return drawn


def planes_of_mesh(maps: Tensor) -> Tensor:
    """Return alpha, and 1 less the grey of what covers a pixel, [P, 2, S, S] in 0..1, of a mesh.

    maps  [P, 5, S, S], of `data_prep.rendering.raycast.surface_maps`
    """
    # The last map is how far a normal faces the camera, which gives the shading.
    darkness = 1 - NEUTRAL * maps[:, -1].pow(1 / GAMMA)
    return torch.stack([maps[:, MAPS.index("coverage")], darkness], dim=1)


def _mixed(drawn: Tensor, of_mesh: Tensor, share: Tensor) -> Tensor:
    """Return drawings [P, 2, S, S] with a share [P, S, S] of what is seen of a mesh."""
    alpha, cover = drawn[:, 0], of_mesh[:, 0]
    seen = (alpha * drawn[:, 1]).lerp(cover * of_mesh[:, 1], share)
    alpha = alpha.lerp(cover, share)
    return torch.stack([alpha, seen / alpha.clamp(min=NEARLY_NOTHING)], dim=1)


def _share(drawn: Tensor, of_mesh: Tensor, agreement: _Agreement, shaded: Tensor) -> Tensor:
    """Return the share of a mesh in each pixel by agreement, 0..1 [P, S, S].

    drawn, of_mesh  [P, 2, S, S]: alpha and darkness
    shaded          0..1, that a pixel's share is multiplied by where it is at no outline
    """
    alpha, cover = drawn[:, 0], of_mesh[:, 0]
    differences = alpha * drawn[:, 1] - cover * of_mesh[:, 1]
    window = scaled_window(_RIM, cover.shape[-1])
    most, least = spread(cover, window, torch.maximum), spread(cover, window, torch.minimum)
    at_outline = (most > 0.5) & (least < 0.5)
    outline = (-(differences / agreement.outline).square()).exp()
    shading = shaded * (-(differences / agreement.shading).square()).exp()
    # Where the network draws nothing at all, the mesh has a piece that does not belong to the
    # object. Its outline is not taken.
    near = spread(alpha, window, torch.maximum) > 0.5
    return torch.where(at_outline, outline, shading) * near


def _creased(darkness: Tensor) -> Tensor:
    """Return how much of a crease a mesh has around each pixel, 0..1 [P, S, S]."""
    window = scaled_window(_RIM, darkness.shape[-1])
    darkest = spread(darkness, window, torch.maximum)
    lightest = spread(darkness, window, torch.minimum)
    return ((darkest - lightest - _EVEN) / (_CREASED - _EVEN)).clamp(0, 1)


def _dense(channels: Tensor, inputs: Inputs) -> Tensor:
    """Return how dense the clouds are, [P, 1, 1] from 0 (sparse) to 1 (many points in sight)."""
    count = channels[:, inputs.names.index("density in 1")].float().expm1().sum(dim=(1, 2))
    return ((count - _SPARSE) / (_DENSE - _SPARSE)).clamp(0, 1)[:, None, None]


def _clean(channels: Tensor, inputs: Inputs) -> Tensor:
    """Return how clean the clouds are, [P, 1, 1] from 0 (noisy) to 1 (clean).

    It is 1 for networks that have no channels of the noise.
    """
    if not inputs.noise:
        return channels.new_ones(len(channels), 1, 1, dtype=torch.float32)
    noise = channels[:, inputs.names.index(f"noise {HOPS[0]}")].float().amax(dim=(1, 2))
    return ((_NOISY - noise) / (_NOISY - _CLEAN)).clamp(0, 1)[:, None, None]
