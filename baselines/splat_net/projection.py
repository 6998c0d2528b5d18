"""Projection of the points by the camera, which gives the input channels of the network.

Points are drawn into the pixels that they fall in, for all images at once, and then spread over a
square window of pixels; where windows overlap, the nearest point wins. Windows grow with the image,
so that they cover the same angle at any size. All is computed in float32, because in bfloat16 the
depths of neighbouring points would be equal.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from baselines.splat_net.surfels import FLATTENED, HOPS, Surfels
from data_prep.rendering.camera import (
    CAMERA_DISTANCE,
    NEAR,
    camera_to_world,
    farthest_depth,
    lens_of,
    origin_depth,
)
from data_prep.rendering.raycast import MAPS, MOST_NEARNESS
from data_prep.scene import IMAGE_SIZE, AnyView, View

_DENSITY_WINDOWS = (1, 3, 9)  # pixels, at 128 px: sides of the windows in which points are counted
EMPTY = 1e4  # depth of a pixel without a point: greater than any depth that is seen


@dataclass(frozen=True)
class Inputs:
    """A selection of input channels.

    windows    odd sides, in pixels of an image of 128, of the windows that points are spread over,
               ascending: for each one, the depth of the nearest point
    normals    normals and surface variation of the nearest point: of the first scale in the
               narrowest window, and of the other scales in the widest
    density    number of points in windows of 1, 3 and 9 pixels
    flattened  depth and density of the points moved onto the planes of their neighbourhoods
    far        depth of the farthest point in the widest window
    noise      median variation of the whole cloud at each scale, which tells how noisy it is; it
               is the same in all pixels that have a point in the widest window
    meshes     names of methods that reconstruct a mesh of the cloud, whose maps
               (`data_prep.rendering.raycast.surface_maps`) follow the channels of the points
    """

    windows: tuple[int, ...] = (3, 7)
    normals: bool = True
    density: bool = True
    flattened: bool = True
    far: bool = True
    noise: bool = False
    meshes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Return the name of each channel, in the order of `Projection.channels`."""
        names = [f"nearest in {window}" for window in self.windows]
        if self.far:
            names.append("farthest")
        if self.density:
            names += [f"density in {window}" for window in _DENSITY_WINDOWS]
        if self.flattened:
            for scale in FLATTENED:
                names += [f"flattened {scale} depth", f"flattened {scale} density"]
        if self.normals:
            for hops in HOPS:
                names += [f"normal {hops} {what}" for what in ("x", "y", "z", "variation")]
        if self.noise:
            names += [f"noise {hops}" for hops in HOPS]
        for mesh in self.meshes:
            names += [f"mesh {mesh} {what}" for what in MAPS]
        return tuple(names)

    @property
    def channels(self) -> int:
        """Return the number of channels."""
        return len(self.names)

    @property
    def of_points(self) -> int:
        """Return the number of channels that come from points: those before the maps of meshes."""
        return self.channels - len(MAPS) * len(self.meshes)

    @property
    def surfaces(self) -> bool:
        """Return whether any channel needs the neighbours of points."""
        return self.normals or self.flattened or self.noise


ALL_INPUTS = Inputs(noise=True)


def cameras(views: Sequence[AnyView]) -> Tensor:
    """Return world-to-camera matrices float32 [V, 3, 4], in OpenGL's convention."""
    poses = np.stack([camera_to_world(view) for view in views])
    return torch.from_numpy(np.linalg.inv(poses)[:, :3].astype(np.float32))


def lenses(views: Sequence[AnyView]) -> Tensor:
    """Return what an image depends on beside the pose of its camera, float64 [V, 5].

    These are the focal lengths along columns and rows, column and row of the centre, all in pixels
    of an image of IMAGE_SIZE, and how much deeper than CAMERA_DISTANCE the origin lies.
    """
    rows = []
    for view in views:
        lens = lens_of(view)
        rows.append((*lens.focal, *lens.centre, origin_depth(view) - CAMERA_DISTANCE))
    return torch.tensor(rows, dtype=torch.float64)


_FARTHEST = farthest_depth(View(0, 0))
_LENS = lenses([View(0, 0)])


def project(surfels: Surfels, cameras: Tensor, inputs: Inputs, size: int = IMAGE_SIZE) -> Tensor:
    """Return the channels [P, inputs.channels, size, size] of P images, see `Projection`."""
    return Projection(surfels, cameras, inputs, size).whole()


class Projection:
    """The points of P clouds as seen by P cameras.

    surfels  with one leading dimension: P, or 1 where all cameras see the same cloud
    cameras  world-to-camera matrices [P, 3, 4]
    inputs   the channels to make
    size     side of the images in pixels, a multiple of 16
    maps     of the meshes of `inputs.meshes`, [P, 5 * meshes, S, S]; None where there are none
    lenses   of the cameras, [P, 5] as `lenses` returns them; None for those of `View`

    points   [P, 3, N], in the camera's frame, moved along its axis so that the origin is
             CAMERA_DISTANCE away, where networks know objects; so are all depths

    Points behind the camera or outside of the image are not drawn.

    Raises ValueError where `maps` are missing, and where they are given for no meshes.
    """

    def __init__(
        self,
        surfels: Surfels,
        cameras: Tensor,
        inputs: Inputs,
        size: int = IMAGE_SIZE,
        maps: Tensor | None = None,
        lenses: Tensor | None = None,
    ) -> None:
        self.inputs, self.size = inputs, size
        if inputs.meshes and maps is None:
            raise ValueError(f"meshes {inputs.meshes}: their maps are missing; give them as maps=")
        if not inputs.meshes and maps is not None:
            raise ValueError("maps: the inputs have no meshes; leave maps= out")
        self.maps = None if maps is None else maps.permute(0, 2, 3, 1)
        points = _to_camera(surfels.points, cameras)
        lens = _at_size(_LENS if lenses is None else lenses, size).to(points.device)
        self.seen = _Pixels(points, size, lens)
        self.points = points if lenses is None else _moved(points, lens)
        moved = surfels.flattened.unbind(-2) if inputs.flattened else ()
        self.flattened = [_Pixels(_to_camera(some, cameras), size, lens) for some in moved]
        self.nearest = self.seen.nearest()
        self.farthest = self.seen.farthest() if inputs.far else None
        self.count = self.seen.count() if inputs.density else None
        self.flat = [(some.nearest_depth(), some.count()) for some in self.flattened]
        self.attributes = _attributes(surfels, cameras, points) if inputs.normals else None
        self.noise: Tensor | None = None
        if inputs.noise:
            # For each image, the median variation of its cloud at each scale, [P, scales], 0..1.
            medians = 3 * surfels.variation.median(dim=-2).values
            self.noise = medians.expand(len(cameras), -1)

    def whole(self) -> Tensor:
        """Return the channels of all images."""
        return self.channels(slice(None))

    def channels(self, images: slice, dtype: torch.dtype = torch.float32) -> Tensor:
        """Return channels [n, inputs.channels, S, S] of some images, in memory channels last.

        images  which of the P
        dtype   of the result; everything before the conversion is computed in float32

        Channels are 0 where no point is near. Depth is given as nearness, which is 0 at _FARTHEST
        and about 1.1 for the nearest points; a number n of points is given as log(1 + n).
        """
        inputs, size = self.inputs, self.size
        nearest = self.nearest[images]
        whole = torch.empty((*nearest.shape, inputs.channels), dtype=dtype, device=nearest.device)
        of_points = inputs.of_points
        normals = of_points  # the number of the first channel of normals
        if inputs.noise:
            normals -= len(HOPS)
        if inputs.normals:
            normals -= 4 * len(HOPS)
        # The channels before are computed plane by plane and put into `whole` together: writing
        # single planes into memory that is channels last takes longer.
        count, *shape = nearest.shape
        apart = torch.empty((count, normals, *shape), device=nearest.device)
        planes = iter(apart.unbind(1))
        narrowest = widest = nearest
        width = 1
        for place, window in enumerate(inputs.windows):
            window = scaled_window(window, size)
            widest, width = spread(widest, window - width + 1, torch.minimum), window
            narrowest = widest if place == 0 else narrowest
            _nearness(_depth_of(widest), next(planes))
        if self.farthest is not None:
            far = spread(self.farthest[images], width, torch.maximum)
            _nearness(far.abs(), next(planes))  # without a point it is -EMPTY, and so far away
        if self.count is not None:
            count = self.count[images]
            torch.log1p(count, out=next(planes))
            for window in _DENSITY_WINDOWS[1:]:
                torch.log1p(spread(count, scaled_window(window, size), torch.add), out=next(planes))
        for depth, count in self.flat:
            window = scaled_window(inputs.windows[0], size)
            _nearness(spread(depth[images], window, torch.minimum), next(planes))
            torch.log1p(count[images], out=next(planes))
        whole[..., :normals] = apart.permute(0, 2, 3, 1)
        if self.attributes is not None:
            first, others = self.attributes
            whole[..., normals : normals + 4] = _look_up(first[images], narrowest)
            end = normals + 4 * len(HOPS)
            whole[..., normals + 4 : end] = _look_up(others[images], widest)
        if self.noise is not None:
            near = (_depth_of(widest) < EMPTY)[..., None]
            whole[..., of_points - len(HOPS) : of_points] = near * self.noise[images, None, None]
        if self.maps is not None:
            whole[..., of_points:] = self.maps[images]
        return whole.permute(0, 3, 1, 2)


def scaled_window(window: int, size: int) -> int:
    """Return the odd side of a window of `window` pixels at 128 px in images of another size."""
    return max(1, 2 * round((window * size / IMAGE_SIZE - 1) / 2) + 1)


def _to_camera(points: Tensor, cameras: Tensor) -> Tensor:
    """Return points [..., N, 3] in the cameras' frames, [P, 3, N]."""
    return cameras[:, :, :3] @ points.mT + cameras[:, :, 3:]


def _at_size(lenses: Tensor, size: int) -> Tensor:
    """Return lenses in pixels of an image of another size, float32 [P, 5, 1]."""
    zoom = size / IMAGE_SIZE
    return (lenses * torch.tensor([zoom, zoom, zoom, zoom, 1.0]).to(lenses)).float()[..., None]


def _moved(points: Tensor, lens: Tensor) -> Tensor:
    """Return points [P, 3, N] moved along the axis, so that the origin is CAMERA_DISTANCE away."""
    beyond = lens[:, 4:]
    return torch.cat([points[:, :2], points[:, 2:] + beyond], dim=1)


class _Pixels:
    """The pixels in which points [P, 3, N], in the camera's frame, fall.

    lens  [P, 5, 1], or one for all images: of `_at_size`
    """

    def __init__(self, points: Tensor, size: int, lens: Tensor) -> None:
        self.size = size
        x, y, z = points.unbind(1)
        focal_x, focal_y, centre_x, centre_y, beyond = lens.unbind(1)
        depth = -z
        ahead = depth > NEAR
        inverse = torch.where(ahead, depth, 1.0).reciprocal()
        self.column = centre_x + x * (inverse * focal_x)
        self.row = centre_y - y * (inverse * focal_y)
        within = (self.column >= 0) & (self.column < size) & (self.row >= 0) & (self.row < size)
        self.seen = ahead & within
        # Points that are not drawn go into an extra pixel after the last, which nobody looks at.
        cell = self.row.long() * size + self.column.long()
        self.cell = torch.where(self.seen, cell, size * size)
        self.depth = torch.where(self.seen, depth - beyond, EMPTY)

    def nearest(self) -> Tensor:
        """Return the nearest point of each pixel, int64 [P, S, S].

        The upper 32 bits are those of its depth as float32, the lower 32 its number in the cloud.
        """
        # Positive floats have the order of their bits read as integers, so that the minimum of such
        # a number finds both the least depth and the point that has it.
        number = self.depth.shape[1]
        key = self.depth.view(torch.int32).long() << 32
        key |= torch.arange(number, device=key.device)
        nothing = int(torch.tensor(EMPTY).view(torch.int32)) << 32 | number
        return self._table(key, nothing, "amin")

    def nearest_depth(self) -> Tensor:
        """Return the depth of the nearest point of each pixel, [P, S, S]; EMPTY without one."""
        return self._table(self.depth, EMPTY, "amin")

    def farthest(self) -> Tensor:
        """Return the depth of the farthest point of each pixel, [P, S, S]; -EMPTY without one."""
        return self._table(self.depth, -EMPTY, "amax")

    def _table(self, values: Tensor, nothing: float, reduce: str) -> Tensor:
        """Return the values [P, N] of points reduced over each pixel, [P, S, S]."""
        pixels = self.size * self.size
        table = values.new_full((len(values), pixels + 1), nothing)
        table.scatter_reduce_(1, self.cell, values, reduce)
        return table[:, :-1].unflatten(1, (self.size, self.size))

    def count(self) -> Tensor:
        """Return the number of points in each pixel, [P, S, S].

        A point is shared among the four pixels whose centres are around it, bilinearly.
        """
        x, y = self.column - 0.5, self.row - 0.5
        left, top = x.floor(), y.floor()
        right_share, lower_share = x - left, y - top
        wide = self.size + 2  # with a margin of one pixel, which takes the shares outside
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


def spread(plane: Tensor, window: int, combine: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
    """Return the minimum, maximum or sum of a plane over a window around each pixel.

    plane    [P, S, S]
    window   side of the window in pixels, odd
    combine  `torch.minimum`, `torch.maximum` or `torch.add`
    """
    return _spread_along(_spread_along(plane, 2, window, combine), 1, window, combine)


def _spread_along(
    plane: Tensor, dim: int, window: int, combine: Callable[[Tensor, Tensor], Tensor]
) -> Tensor:
    """Return a plane combined over `window` pixels along one dimension.

    Pixels are combined over 1, 2, 4, ... in a row, each from two of the step before. A window is
    put together from such rows, so that one of 9 = 1 + 8 pixels takes four steps.
    """
    size, half = plane.shape[dim], window // 2
    shape = list(plane.shape)
    shape[dim] = half
    edge = plane.new_full(shape, _nothing(plane, combine))
    # `part` at i is combined over the pixels i to i + span - 1.
    part, span = torch.cat([edge, plane, edge], dim=dim), 1
    whole, covered = None, 0
    while True:
        if window & span:  # this power of two is in the sum that gives the window
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
    """Return the value that changes nothing where it is combined with others."""
    if combine is torch.add:
        return 0
    if combine is torch.maximum:
        return -EMPTY
    return EMPTY if plane.is_floating_point() else torch.iinfo(plane.dtype).max


def _depth_of(nearest: Tensor) -> Tensor:
    """Return the depths in what `_Pixels.nearest` returned."""
    return (nearest >> 32).int().view(torch.float32)


def _nearness(depth: Tensor, out: Tensor) -> None:
    """Write the nearness of depths into `out`: (_FARTHEST - depth) / 2, in 0..MOST_NEARNESS."""
    torch.mul(depth, -0.5, out=out).add_(_FARTHEST / 2).clamp_(0.0, MOST_NEARNESS)


def _attributes(surfels: Surfels, cameras: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
    """Return normals that face the camera, and variations, of the first scale and of the others.

    They are [P, N + 1, 4] and [P, N + 1, 4 (scales - 1)]. The last row has zeros, for pixels
    without a point, whose nearest point has the number N.
    """
    scales = surfels.normals.shape[-2]
    turned = cameras[:, :, :3] @ surfels.normals.permute(0, 3, 2, 1).flatten(2)
    normals = turned.unflatten(2, (scales, -1))  # [P, 3, scales, N]
    away = (normals * points[:, :, None]).sum(dim=1, keepdim=True) > 0
    normals = torch.where(away, -normals, normals)
    count, _, _, number = normals.shape
    both = normals.new_zeros(count, scales, 4, number + 1)
    both[:, :, :3, :-1] = normals.transpose(1, 2)
    both[:, :, 3, :-1] = 3 * surfels.variation.mT
    first, others = both.flatten(1, 2).split([4, 4 * (scales - 1)], dim=1)
    return first.mT.contiguous(), others.mT.contiguous()


def _look_up(attributes: Tensor, nearest: Tensor) -> Tensor:
    """Return the attributes [n, S, S, A] of the nearest point of each pixel.

    attributes  [n, N + 1, A]
    nearest     int64 [n, S, S], as of `_Pixels.nearest`
    """
    count, rows, _ = attributes.shape
    first = torch.arange(0, count * rows, rows, device=nearest.device)
    number = nearest & 0xFFFFFFFF  # the lower 32 bits
    index = number + first[:, None, None]
    values = attributes.flatten(0, 1).index_select(0, index.flatten())
    return values.view(*nearest.shape, -1)
