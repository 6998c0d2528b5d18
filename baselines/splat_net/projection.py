"""Projection of the points by the camera: the input channels of the network.

Every channel is made by scattering all points of all images at once, in float32: in bfloat16
depths of neighbouring points would be equal. A point's disc is a square of pixels, of which the
nearest point wins (where it matters the network makes it round); squares grow with the image, so
that they cover the same angle at any size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from baselines.splat_net.surfels import FLATTENED, HOPS, Surfels
from data_prep.camera import CAMERA_DISTANCE, FOCAL_PX, camera_to_world
from data_prep.scene import IMAGE_SIZE, View

NEAREST = 0.05 * CAMERA_DISTANCE  # what is nearer than this, the mesh renderer cuts off as well
DENSITY_WINDOWS = (1, 3, 9)  # sides in pixels, at 128 px
EMPTY = 1e4  # depth where there is no point
FARTHEST = CAMERA_DISTANCE + 1.25  # nearness 0: the far end of the unit sphere, and room for noise


@dataclass(frozen=True)
class Inputs:
    """Which channels there are.

    windows    sides in pixels of the discs, at 128 px, from narrow to wide; odd
    normals    normals and surface variation: of the first scale for the narrowest discs, of the
               others for the widest
    density    points in windows of 1, 3 and 9 px
    flattened  depth and density of the points moved onto the planes of their neighbourhoods
    far        depth of the farthest point in the widest window
    """

    windows: tuple[int, ...] = (3, 7)
    normals: bool = True
    density: bool = True
    flattened: bool = True
    far: bool = True

    @property
    def names(self) -> tuple[str, ...]:
        """What each channel is, in the order of `project`."""
        return (
            *(f"nearest in {window}" for window in self.windows),
            *(["farthest"] if self.far else []),
            *(f"density in {window}" for window in DENSITY_WINDOWS if self.density),
            *(
                f"flattened {i} {what}"
                for i in FLATTENED
                for what in ("depth", "density")
                if self.flattened
            ),
            *(
                f"normal {i} {what}"
                for i in HOPS
                for what in ("x", "y", "z", "variation")
                if self.normals
            ),
        )

    @property
    def channels(self) -> int:
        """How many."""
        return len(self.names)

    @property
    def surfaces(self) -> bool:
        """Whether any channel needs the neighbours of points."""
        return self.normals or self.flattened


ALL_INPUTS = Inputs()


def cameras(views: Sequence[View]) -> Tensor:
    """World-to-camera matrices float32 [V, 3, 4], OpenGL's convention."""
    poses = np.stack([camera_to_world(view) for view in views])
    return torch.from_numpy(np.linalg.inv(poses)[:, :3].astype(np.float32))


def project(
    surfels: Surfels,
    cameras: Tensor,
    inputs: Inputs,
    size: int = IMAGE_SIZE,
    dtype: torch.dtype = torch.float32,
) -> Tensor:
    """Channels [P, inputs.channels, size, size], channels last, of P clouds and P cameras.

    surfels  with one leading dimension: P, or 1 where all cameras see the same cloud
    cameras  [P, 3, 4]
    size     of the images, a multiple of 16
    dtype    of the result; everything before it is float32

    All zero where no point is near. Points behind the camera or off the image are not seen.
    Depth is given as nearness, 0 for `FARTHEST` or nothing to about 1.1; counts n as log(1 + n).
    """
    points = _to_camera(surfels.points, cameras)  # [P, N, 3]
    seen = _Pixels(points, size)
    whole = torch.empty(
        (len(cameras), size, size, inputs.channels), dtype=dtype, device=cameras.device
    )
    planes = iter(whole.unbind(3))
    narrowest = widest = seen.nearest()
    width = 1
    for place, window in enumerate(inputs.windows):
        window = _scaled(window, size)
        widest, width = _spread(widest, window - width + 1, torch.minimum), window
        narrowest = widest if place == 0 else narrowest
        next(planes).copy_(_nearness(_depth_of(widest)))
    if inputs.far:
        far = _spread(seen.farthest(), width, torch.maximum)
        next(planes).copy_(_nearness(far.abs()))  # EMPTY where there is none
    if inputs.density:
        count = seen.count()
        next(planes).copy_(torch.log1p(count))
        for window in DENSITY_WINDOWS[1:]:
            next(planes).copy_(torch.log1p(_spread(count, _scaled(window, size), torch.add)))
    if inputs.flattened:
        for moved in surfels.flattened.unbind(-2):
            flat = _Pixels(_to_camera(moved, cameras), size)
            window = _scaled(inputs.windows[0], size)
            near = _spread(flat.nearest_depth(), window, torch.minimum)
            next(planes).copy_(_nearness(near))
            next(planes).copy_(torch.log1p(flat.count()))
    if inputs.normals:
        attributes = _attributes(surfels, cameras, points)
        start = inputs.channels - 4 * len(HOPS)
        whole[..., start : start + 4] = _look_up(attributes[0], narrowest)
        whole[..., start + 4 :] = _look_up(attributes[1], widest)
    return whole.permute(0, 3, 1, 2)


def _scaled(window: int, size: int) -> int:
    return max(1, 2 * round((window * size / IMAGE_SIZE - 1) / 2) + 1)


def _to_camera(points: Tensor, cameras: Tensor) -> Tensor:
    return points @ cameras[:, :, :3].mT + cameras[:, None, :, 3]


class _Pixels:
    """Where points [P, N, 3], in the camera's frame, fall: one table of S * S pixels an image."""

    def __init__(self, points: Tensor, size: int) -> None:
        self.size = size
        depth = -points[..., 2]
        ahead = depth > NEAREST
        scale = FOCAL_PX * size / IMAGE_SIZE / torch.where(ahead, depth, 1.0)
        self.column = size / 2 + points[..., 0] * scale
        self.row = size / 2 - points[..., 1] * scale
        within = (self.column >= 0) & (self.column < size) & (self.row >= 0) & (self.row < size)
        self.seen = ahead & within
        # what is not seen goes to a pixel that nobody looks at
        cell = self.row.long() * size + self.column.long()
        self.cell = torch.where(self.seen, cell, size * size)
        self.depth = torch.where(self.seen, depth, EMPTY)

    def nearest(self) -> Tensor:
        """The nearest point of each pixel, int64 [P, S, S]: the bits of its depth above its number.

        Positive floats are ordered like their bits, so that one minimum finds depth and point.
        Where there is none, EMPTY and the number N.
        """
        number = self.depth.shape[1]
        key = self.depth.view(torch.int32).long() << 32
        key |= torch.arange(number, device=key.device)
        nothing = int(torch.tensor(EMPTY).view(torch.int32)) << 32 | number
        return self._table(key, nothing, "amin")

    def nearest_depth(self) -> Tensor:
        """Depth of the nearest point of each pixel [P, S, S]; EMPTY where there is none."""
        return self._table(self.depth, EMPTY, "amin")

    def farthest(self) -> Tensor:
        """Depth of the farthest point of each pixel [P, S, S]; -EMPTY where there is none."""
        return self._table(self.depth, -EMPTY, "amax")

    def _table(self, values: Tensor, nothing: float, reduce: str) -> Tensor:
        pixels = self.size * self.size
        table = values.new_full((len(values), pixels + 1), nothing)
        table.scatter_reduce_(1, self.cell, values, reduce)
        return table[:, :-1].unflatten(1, (self.size, self.size))

    def count(self) -> Tensor:
        """Points per pixel [P, S, S], each shared among the four pixels around it."""
        x, y = self.column - 0.5, self.row - 0.5
        left, top = x.floor(), y.floor()
        right_share, lower_share = x - left, y - top
        wide = self.size + 2  # a margin all around takes what falls off
        table = x.new_zeros(len(x), wide * wide)
        seen = self.seen.to(x.dtype)
        upper = seen * (1 - lower_share)
        lower = seen * lower_share
        first = (top.long() + 1) * wide + left.long() + 1
        first = torch.where(self.seen, first, 0)
        for step, share in (
            (0, upper - upper * right_share),
            (1, upper * right_share),
            (wide, lower - lower * right_share),
            (wide + 1, lower * right_share),
        ):
            table.scatter_add_(1, first + step, torch.where(self.seen, share, 0.0))
        return table.unflatten(1, (wide, wide))[:, 1:-1, 1:-1]


def _spread(plane: Tensor, window: int, combine: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
    """`combine` (minimum, maximum or add) over a square of `window` pixels around each pixel.

    plane [P, S, S] -> [P, S, S]; beyond the edge there is nothing. Rows first, then columns, each
    from parts of 1, 2, 4, ... pixels, so that 9 pixels take four steps.
    """
    for dim in (2, 1):
        plane = _spread_along(plane, dim, window, combine)
    return plane


def _spread_along(
    plane: Tensor, dim: int, window: int, combine: Callable[[Tensor, Tensor], Tensor]
) -> Tensor:
    size, half = plane.shape[dim], window // 2
    shape = list(plane.shape)
    shape[dim] = half
    edge = torch.full(shape, _nothing(plane, combine), dtype=plane.dtype, device=plane.device)
    part, span = torch.cat([edge, plane, edge], dim=dim), 1  # of pixels i .. i + span - 1
    whole, covered = None, 0
    while True:
        if window & span:  # the window's length as a sum of powers of two
            taken = part.narrow(dim, covered, size)
            whole = taken if whole is None else combine(whole, taken)
            covered += span
        if covered == window:
            assert whole is not None
            return whole
        length = part.shape[dim] - span
        part = combine(part.narrow(dim, 0, length), part.narrow(dim, span, length))
        span *= 2


def _nothing(plane: Tensor, combine: Callable[[Tensor, Tensor], Tensor]) -> float:
    if combine is torch.add:
        return 0
    if combine is torch.maximum:
        return -EMPTY
    return EMPTY if plane.is_floating_point() else torch.iinfo(plane.dtype).max


def _depth_of(nearest: Tensor) -> Tensor:
    return (nearest >> 32).int().view(torch.float32)


def _nearness(depth: Tensor) -> Tensor:
    return ((FARTHEST - depth) / 2).clamp_(0.0, 1.5)


def _attributes(surfels: Surfels, cameras: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
    """Normals towards the camera, and variation: [P * (N + 1), 4] of the first scale, and
    [P * (N + 1), 4 (scales - 1)] of the others.

    A row of zeros stands behind each cloud, for pixels without a point.
    """
    turn = cameras[:, None, :, :3].mT  # [P, 1, 3, 3]
    normals = surfels.normals @ turn  # [P, N, scales, 3]
    away = (normals * points[:, :, None]).sum(dim=-1, keepdim=True) > 0
    normals = torch.where(away, -normals, normals)
    variation = surfels.variation[..., None].expand(*normals.shape[:-1], 1)
    both = torch.cat([normals, 3 * variation], dim=-1).flatten(2)  # [P, N, 4 scales]
    both = functional.pad(both, (0, 0, 0, 1)).flatten(0, 1)
    return both[:, :4], both[:, 4:]


def _look_up(attributes: Tensor, nearest: Tensor) -> Tensor:
    """[P, S, S, numbers]: what the point has that each pixel's disc comes from."""
    count = len(nearest)
    rows = len(attributes) // count
    first = torch.arange(0, len(attributes), rows, device=nearest.device)
    index = (nearest & 0xFFFFFFFF) + first[:, None, None]
    return attributes.index_select(0, index.flatten()).view(*nearest.shape, -1)
