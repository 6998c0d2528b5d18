from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from scipy.ndimage import convolve

from baselines.splat_net.projection import ALL_INPUTS, Inputs, Projection, cameras, project
from baselines.splat_net.surfels import FLATTENED, HOPS, Surfels, stack
from data_prep.rendering.camera import camera_to_world
from data_prep.rendering.camera import project as pixels_of
from data_prep.scene import View

VIEWS = [View(0, 0), View(37, -20), View(-140, 35), View(90, 90)]
# Coordinates up to 128 px, in float32 from a depth of 1 or more: 2**-18 of a pixel for their own
# digits, and 128 times the 2**-21 of a depth of 4, make 1e-4, of which each share of a point has
# its part; a few points share a pixel. A nearness is good to 1e-6, a turned normal to 1e-6.
CLOSE = 5e-4


def made_up(count, seed=0, spread=0.7):
    """Surfels whose parts have nothing to do with each other, so that none is taken for another.

    No point is so near an edge between pixels, the end of what is seen, or at right angles to its
    own normal, that float32 might decide otherwise.
    """
    rng = np.random.default_rng(seed)
    points, *moved = rng.normal(scale=spread, size=(1 + len(FLATTENED), 9 * count, 3))
    points, flattened = points.astype(np.float32), np.stack(moved, axis=1).astype(np.float32)
    normals = rng.normal(size=(9 * count, len(HOPS), 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    safe = np.ones(9 * count, bool)
    for view in VIEWS:
        camera = camera_to_world(view)[:3, 3]
        toward = (normals * (camera - points)[:, None]).sum(axis=2)
        safe &= (np.abs(toward) > 1e-3).all(axis=1)
        for some in (points, *flattened.swapaxes(0, 1)):
            places, depths = pixels_of(some, view)
            for size in (64, 128, 256):
                scaled = places * size / 128
                safe &= (np.abs(scaled - np.rint(scaled)) > 2e-3).all(axis=1)
            safe &= (depths > 1) | (depths < 0)
    assert safe.sum() >= count
    kept = np.flatnonzero(safe)[:count]
    variation = rng.uniform(0, 1 / 3, (count, len(HOPS)))
    parts = (points[kept], flattened[kept], normals[kept], variation)
    return Surfels(*(torch.from_numpy(part.astype(np.float32)) for part in parts))


# what windows of 1, 3, 7 and 9 px at 128 px are at other sizes: the nearest odd numbers
SIDES = {
    64: {1: 1, 3: 1, 5: 3, 7: 3, 9: 5},
    128: {1: 1, 3: 3, 5: 5, 7: 7, 9: 9},
    256: {1: 1, 3: 5, 5: 9, 7: 13, 9: 17},
}


def painted(surfels, view, inputs, size):
    """The channels float64 [C, size, size] of a view, point by point, the nearest last."""
    pose, sides = camera_to_world(view), SIDES[size]

    def seen(points):
        places, depths = pixels_of(points.numpy(), view)
        for number, ((column, row), depth) in enumerate(
            zip(places * size / 128, depths, strict=True)
        ):
            if depth > 0.2 and 0 <= row < size and 0 <= column < size:
                yield depth, number, row, column

    def discs(points, window, value, farthest=False):
        plane, half = np.zeros((size, size)), sides[window] // 2
        for depth, number, row, column in sorted(seen(points), reverse=not farthest):
            r, c = int(row), int(column)
            disc = slice(max(0, r - half), r + half + 1), slice(max(0, c - half), c + half + 1)
            plane[disc] = value(depth, number)
        return plane

    def density(points, window):
        """A point counts in the four pixels whose centres are around it, the more the nearer."""
        counts = np.zeros((size, size))
        for _, _, row, column in seen(points):
            for r, c in neighbours(row, column, size):
                counts[r, c] += (1 - abs(row - r - 0.5)) * (1 - abs(column - c - 0.5))
        return np.log1p(convolve(counts, np.ones([sides[window]] * 2), mode="constant"))

    def nearness(depth, _):
        return min(max((5.25 - depth) / 2, 0), 1.5)

    def look(scale, k):
        def value(_, i):
            normal = surfels.normals[i, scale].double().numpy()
            if normal @ (pose[:3, 3] - surfels.points[i].double().numpy()) < 0:
                normal = -normal
            return (*(normal @ pose[:3, :3]), 3 * float(surfels.variation[i, scale]))[k]

        return value

    def median(scale):
        values = surfels.variation[:, scale].sort().values
        return lambda *_: 3 * values[(len(values) - 1) // 2].item()

    points, narrow, wide = surfels.points, inputs.windows[0], inputs.windows[-1]
    planes = [discs(points, window, nearness) for window in inputs.windows]
    planes += [discs(points, wide, nearness, farthest=True)] * inputs.far
    if inputs.density:
        planes += [density(points, window) for window in (1, 3, 9)]
    for moved in surfels.flattened.unbind(1) if inputs.flattened else ():
        planes += [discs(moved, narrow, nearness), density(moved, 1)]
    for scale in range(len(HOPS)) if inputs.normals else ():
        window = wide if scale else narrow
        planes += [discs(points, window, look(scale, k)) for k in range(4)]
    planes += [discs(points, wide, median(i)) for i in range(len(HOPS)) if inputs.noise]
    return np.stack(planes)


def neighbours(row, column, size):
    """The pixels in the image whose centres are less than a pixel away in both directions."""
    top, left = int(np.floor(row - 0.5)), int(np.floor(column - 0.5))
    pixels = ((r, c) for r in (top, top + 1) for c in (left, left + 1))
    return [(r, c) for r, c in pixels if 0 <= r < size and 0 <= c < size]


def check(surfels, views, inputs, size=128):
    actual = project(stack([surfels]), cameras(views), inputs, size)
    assert actual.shape == (len(views), inputs.channels, size, size)
    assert actual.dtype == torch.float32
    assert actual.is_contiguous(memory_format=torch.channels_last)
    for image, view in zip(actual, views, strict=True):
        expected = painted(surfels, view, inputs, size)
        np.testing.assert_allclose(image, expected, rtol=0, atol=CLOSE)
    return actual


@pytest.mark.parametrize("spread", [0.4, 3.0])
def test_every_channel_against_plain_loops(spread):
    """A cloud inside the image, and one that is mostly beside it and behind the camera."""
    surfels = made_up(80, spread=spread)
    depths = np.concatenate([pixels_of(surfels.points.numpy(), view)[1] for view in VIEWS])
    assert (depths < 0).any() == (spread == 3.0)
    actual = check(surfels, VIEWS, ALL_INPUTS)
    assert (actual.amax(dim=(0, 2, 3)) > 0.1).all()  # no channel is empty


@pytest.mark.parametrize("size", [64, 256])
def test_other_sizes_have_windows_of_the_same_angle(size):
    check(made_up(40), VIEWS[1:3], Inputs(windows=(1, 3, 5, 7)), size)


@pytest.mark.parametrize("windows", [(3,), (7,), (1, 5, 9)])
@pytest.mark.parametrize("flags", [*np.eye(5, dtype=bool), (False,) * 5])
def test_number_and_order_of_the_channels(windows, flags):
    check(made_up(30), VIEWS[1:2], Inputs(windows, *map(bool, flags)))


def one_point(place, normals, variation):
    """Surfels [1, 1, ...] of a point where it is flattened to."""
    point = torch.tensor([[place]])
    flattened = point[:, :, None].expand(-1, -1, len(FLATTENED), -1)
    return Surfels(point, flattened, torch.tensor([[normals]]), torch.tensor([[variation]]))


def test_ties_in_depth_go_to_the_first_point():
    """A plane across the view: all depths are equal, to the last digit."""
    surfels = made_up(150)
    points = surfels.points.clone()
    points[:, 2] = 0.25
    points[75:, :2] = points[:75, :2]  # twice: in one pixel as well
    flat = dataclasses.replace(surfels, points=points)
    actual = check(flat, VIEWS[:1], ALL_INPUTS)
    depths = actual[0, 0].unique()
    assert len(depths) == 2
    assert depths.tolist() == [0, 0.5]  # (5.25 - 4.25) / 2


def test_what_is_not_seen_leaves_no_trace():
    """Behind the camera, in it, too near, beside, above and far beyond the image; infinite."""
    hidden = torch.tensor([
        (0.1, 0.1, -4.5), (0.0, 0.0, -4.0), (0.0, 0.0, -3.81), (1.2, 0.0, 0.0), (-1.2, 0.0, 0.0),
        (0.0, 1.2, 0.0), (0.0, -1.2, 0.0), (0.3, 0.2, -1e30), (3e38, 3e38, -3e38), (2e38, 0.0, 0.0),
        (-64 / 58, 0.0, 0.0), (0.0, -64 / 58, 0.0),  # at 128.0, one pixel too far
    ])  # fmt: skip
    seen = made_up(20)
    where = {"points": hidden, "flattened": hidden[:, None].expand(-1, len(FLATTENED), -1)}
    more = {
        name: torch.cat([where.get(name, vars(seen)[name][: len(hidden)]), value])
        for name, value in vars(seen).items()
    }
    views = [View(0, 0)]
    inputs = dataclasses.replace(ALL_INPUTS, noise=False)  # which is of the whole cloud
    alone = project(stack([seen]), cameras(views), inputs)
    together = project(stack([Surfels(**more)]), cameras(views), inputs)
    assert torch.equal(alone, together)
    nothing = Surfels(**{name: value[: len(hidden)] for name, value in more.items()})
    assert (project(stack([nothing]), cameras(views), ALL_INPUTS) == 0).all()


def test_nearness_ends_where_it_says():
    """0 at 1.25 beyond the origin; at most 1.5; what is nearer than 0.2 is cut off."""
    for z, expected in ((1.25, 0.0), (1.5, 0.0), (-3.0, 1.5), (-3.79, 1.5), (-1.0, 1.125)):
        surfels = one_point([0.0, 0.0, z], [[0.0] * 3] * len(HOPS), [0.0] * len(HOPS))
        (actual,) = project(surfels, cameras([View(0, 0)]), ALL_INPUTS)
        assert actual[[0, 1, 2, 6], 64, 64].tolist() == [expected] * 4
        assert actual[3, 64, 64] > 0  # it is counted


def test_one_cloud_for_all_cameras_or_one_each_and_clouds_do_not_mix():
    surfels = made_up(150)
    seen = cameras(VIEWS)
    once = project(stack([surfels]), seen, ALL_INPUTS)
    each = project(stack([surfels] * len(VIEWS)), seen, ALL_INPUTS)
    assert torch.equal(once, each)
    clouds = [made_up(90, seed) for seed in range(3)]
    together = project(stack(clouds), cameras(VIEWS[:3]), ALL_INPUTS)
    for i, surfels in enumerate(clouds):
        alone = project(stack([surfels]), cameras(VIEWS[i : i + 1]), ALL_INPUTS)
        # one cloud may go another way through the matrix product: coordinates by a last digit
        torch.testing.assert_close(together[i : i + 1], alone, rtol=0, atol=CLOSE)


def test_bfloat16_is_the_last_step_and_some_images_are_those_of_all():
    projection = Projection(stack([made_up(200)]), cameras(VIEWS), ALL_INPUTS)
    exact = projection.whole()
    coarse = projection.channels(slice(1, 3), torch.bfloat16)
    assert coarse.is_contiguous(memory_format=torch.channels_last)
    assert torch.equal(coarse, exact[1:3].bfloat16())
    assert torch.equal(projection.channels(slice(1, 3)), exact[1:3])


def test_a_mirrored_cloud_has_mirrored_channels():
    """A network that draws the mirror image otherwise has learned to."""
    surfels = made_up(200)
    x = torch.tensor([-1.0, 1.0, 1.0])
    mirrored = Surfels(
        surfels.points * x, surfels.flattened * x, surfels.normals * x, surfels.variation
    )
    for view in VIEWS[:2]:
        other = View(-view.azimuth_deg, view.elevation_deg)
        seen, reflected = (
            project(stack([some]), cameras([camera]), ALL_INPUTS)[0]
            for some, camera in ((surfels, view), (mirrored, other))
        )
        sign = torch.tensor([-1.0 if n.endswith(" x") else 1.0 for n in ALL_INPUTS.names])
        back = reflected.flip(2) * sign[:, None, None]
        assert (back - seen).abs().max() < CLOSE
        assert (reflected - seen).abs().max() > 0.5
