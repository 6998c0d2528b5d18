"""What the camera sees of the points: the pictures that the network is shown, one channel each.

Every channel is made by scattering all points of all pictures at once, in float32: in bfloat16
depths of neighbouring points would be equal. A point's disc is a window of `near` or `wide` pixels
across, of which the nearest point wins; windows grow with the picture, so that they cover the same
angle at any size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from baselines.splat_net.surfels import Surfels
from data_prep.camera import CAMERA_DISTANCE, FOCAL_PX, camera_to_world
from data_prep.scene import IMAGE_SIZE, View

NEAREST = 0.05 * CAMERA_DISTANCE  # what is nearer than this, the mesh renderer cuts off as well
EMPTY = 1e4  # depth where there is no point
FARTHEST = CAMERA_DISTANCE + 1.25  # nearness 0: the far end of the unit sphere, and room for noise


@dataclass(frozen=True)
class Inputs:
    """Which channels there are.

    windows    sides in pixels of the discs, at 128 px, from narrow to wide; odd
    normals    normals and surface variation: near for the first window, far for the last
    density    points in windows of 1, 3 and 9 px
    flattened  depth and density of the points moved onto the plane of their neighbours
    far        depth of the farthest point in the widest window
    """

    windows: tuple[int, ...] = (3, 7)
    normals: bool = True
    density: bool = True
    flattened: bool = True
    far: bool = True

    @property
    def channels(self) -> int:
        """How many."""
        scales = min(2, len(self.windows))
        return (
            len(self.windows)
            + 4 * scales * self.normals
            + 3 * self.density
            + 2 * self.flattened
            + self.far
        )


ALL_INPUTS = Inputs()


def cameras(views: Sequence[View]) -> Tensor:
    """World-to-camera matrices float32 [V, 3, 4], OpenGL's convention."""
    poses = np.stack([camera_to_world(view) for view in views])
    return torch.from_numpy(np.linalg.inv(poses)[:, :3].astype(np.float32))


def project(surfels: Surfels, cameras: Tensor, inputs: Inputs, size: int = IMAGE_SIZE) -> Tensor:
    """Channels float32 [P, inputs.channels, size, size], channels last, of P clouds and P cameras.

    surfels  with one leading dimension: P, or 1 where all cameras see the same cloud
    cameras  [P, 3, 4]
    size     of the pictures, a multiple of 64

    All zero where no point is near. Points behind the camera or off the picture are not seen.
    Depth is given as nearness, 0 for `FARTHEST` or nothing to about 1.1; counts n as log(1 + n).
    """
    count = len(cameras)
    points = _to_camera(surfels.points, cameras)  # [P, N, 3]
    buffer = _ZBuffer(points, size)
    planes = []
    rows = []
    depth, pixel = buffer.depth, buffer.own
    width = 1
    attributes = _attributes(surfels, cameras, points) if inputs.normals else None
    for place, window in enumerate(inputs.windows):
        window = _scaled(window, size)
        depth, pixel = _widen(depth, pixel, window - width + 1)
        width = window
        planes.append(_nearness(depth))
        if attributes is not None and place in (0, len(inputs.windows) - 1):
            scale = 0 if place == 0 else 1
            rows.append(_look_up(attributes[scale], buffer.winner, pixel))
    if inputs.far:
        away, _ = _widen(-buffer.farthest, None, _scaled(inputs.windows[-1], size))
        planes.append(_nearness(away.abs()))  # EMPTY where there is none
    if inputs.density:
        weight = _splat(buffer, size)
        planes.append(torch.log1p(weight))
        for window in (3, 9):
            planes.append(torch.log1p(_box_sum(weight, _scaled(window, size))))
    if inputs.flattened:
        flat = _ZBuffer(_to_camera(surfels.flattened, cameras), size)
        depth, _ = _widen(flat.depth, None, _scaled(inputs.windows[0], size))
        planes.append(_nearness(depth))
        planes.append(torch.log1p(_splat(flat, size)))
    whole = torch.cat([torch.stack([p.view(count, size, size) for p in planes], dim=3), *rows], 3)
    return whole.permute(0, 3, 1, 2)


def _scaled(window: int, size: int) -> int:
    return max(1, 2 * round((window * size / IMAGE_SIZE - 1) / 2) + 1)


def _to_camera(points: Tensor, cameras: Tensor) -> Tensor:
    return points @ cameras[:, :, :3].mT + cameras[:, None, :, 3]


class _ZBuffer:
    """Which point is seen in which pixel. Pixels are numbered row by row.

    depth     [P, 1, S, S], EMPTY where there is none
    farthest  likewise, of the farthest point; -EMPTY
    winner    int64 [P, S * S + 1]: the nearest point of each pixel, N for none
    own       int64 [1, 1, S, S]: each pixel's number
    """

    def __init__(self, points: Tensor, size: int) -> None:
        count, number, _ = points.shape
        z = -points[..., 2]
        seen = z > NEAREST
        scale = FOCAL_PX * size / IMAGE_SIZE / torch.where(seen, z, 1.0)
        self.column = size / 2 + points[..., 0] * scale
        self.row = size / 2 - points[..., 1] * scale
        self.seen = (
            seen & (self.column >= 0) & (self.column < size) & (self.row >= 0) & (self.row < size)
        )
        pixels = size * size
        # what is not seen goes to a pixel that nobody looks at
        cell = torch.where(self.seen, self.row.long() * size + self.column.long(), pixels)
        z = torch.where(self.seen, z, EMPTY)
        # positive floats are ordered like their bits: one minimum finds depth and point
        bits = z.view(torch.int32).long() << 32
        key = bits | torch.arange(number, device=z.device)
        nothing = int(torch.tensor(EMPTY).view(torch.int32)) << 32 | number
        table = torch.full((count, pixels + 1), nothing, dtype=torch.int64, device=z.device)
        table.scatter_reduce_(1, cell, key, "amin")
        self.winner = table & 0xFFFFFFFF
        shape = (count, 1, size, size)
        self.depth = (table[:, :-1] >> 32).int().view(torch.float32).view(shape)
        far = z.new_full((count, pixels + 1), -EMPTY).scatter_reduce_(1, cell, z, "amax")
        self.farthest = far[:, :-1].view(shape)
        self.own = torch.arange(pixels, device=z.device).view(1, 1, size, size)


def _widen(depth: Tensor, pixel: Tensor | None, window: int) -> tuple[Tensor, Tensor]:
    """The least depth in a square of `window` pixels, and the pixel that it comes from.

    Rows first, then columns: 2 `window` comparisons instead of their square.
    """
    near = -depth
    for kernel in ((1, window), (window, 1)):
        padding = (kernel[0] // 2, kernel[1] // 2)
        if pixel is None:
            near = functional.max_pool2d(near, kernel, stride=1, padding=padding)
        else:
            near, place = functional.max_pool2d(
                near, kernel, stride=1, padding=padding, return_indices=True
            )
            pixel = pixel.expand_as(place).flatten(1).gather(1, place.flatten(1)).view_as(place)
    return -near, pixel  # type: ignore[return-value]


def _box_sum(plane: Tensor, window: int) -> Tensor:
    """Sums over squares of `window` pixels; beyond the edge there is nothing."""
    half = window // 2
    for kernel, padding in (((1, window), (0, half)), ((window, 1), (half, 0))):
        plane = functional.avg_pool2d(plane, kernel, 1, padding, divisor_override=1)
    return plane


def _nearness(depth: Tensor) -> Tensor:
    return ((FARTHEST - depth) / 2).clamp_(0.0, 1.5)


def _attributes(surfels: Surfels, cameras: Tensor, points: Tensor) -> Tensor:
    """[2, P * (N + 1), 4]: normal towards the camera and variation, near and far; a row of zeros
    behind each cloud, for pixels without a point."""
    turn = cameras[:, None, :, :3].mT  # [P, 1, 3, 3]
    normals = surfels.normals @ turn  # [P, N, 2, 3]
    away = (normals * points[:, :, None]).sum(dim=-1, keepdim=True) > 0
    normals = torch.where(away, -normals, normals)
    variation = surfels.variation[..., None].expand(*normals.shape[:-1], 1)
    both = torch.cat([normals, 3 * variation], dim=-1)
    return functional.pad(both.permute(2, 0, 1, 3), (0, 0, 0, 1)).flatten(1, 2)


def _look_up(attributes: Tensor, winner: Tensor, pixel: Tensor) -> Tensor:
    """[P, S, S, 4]: what the point has that each pixel's disc comes from."""
    count, _, size, _ = pixel.shape
    points = len(attributes) // count
    index = winner.gather(1, pixel.flatten(1)) + torch.arange(
        0, len(attributes), points, device=winner.device
    ).view(-1, 1)
    return attributes.index_select(0, index.flatten()).view(count, size, size, -1)


def _splat(buffer: _ZBuffer, size: int) -> Tensor:
    """Points per pixel [P, 1, S, S], each shared among the four pixels around it."""
    x, y = buffer.column - 0.5, buffer.row - 0.5
    left, top = x.floor(), y.floor()
    dx, dy = x - left, y - top
    left, top = left.long(), top.long()
    wide = size + 2  # a margin all around takes what falls off
    count = len(x)
    table = x.new_zeros(count, wide * wide)
    seen = buffer.seen.float()
    first = torch.where(buffer.seen, (top + 1) * wide + left + 1, 0)
    for step, weight in (
        (0, (1 - dx) * (1 - dy)),
        (1, dx * (1 - dy)),
        (wide, (1 - dx) * dy),
        (wide + 1, dx * dy),
    ):
        table.scatter_add_(1, first + step, weight * seen)
    return table.view(count, 1, wide, wide)[:, :, 1:-1, 1:-1].contiguous()
