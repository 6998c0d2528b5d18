"""The camera's view of the points in plain loops, to be held against `project`."""

from __future__ import annotations

import numpy as np

from baselines.splat_net.surfels import HOPS
from data_prep.rendering.camera import camera_to_world, project
from data_prep.scene import IMAGE_SIZE

# what windows of 1, 3, 7 and 9 px at 128 px are at other sizes: the nearest odd numbers
SCALED = {
    64: {1: 1, 3: 1, 5: 3, 7: 3, 9: 5},
    128: {1: 1, 3: 3, 5: 5, 7: 7, 9: 9},
    256: {1: 1, 3: 5, 5: 9, 7: 13, 9: 17},
}


class SlowProjection:
    """The view of one cloud, its arrays without a leading dimension."""

    def __init__(self, surfels, view, size=IMAGE_SIZE):
        self.surfels, self.view, self.size = surfels, view, size
        self.seen = list(visible(surfels.points, view, size))
        self.moved = [list(visible(some, view, size)) for some in surfels.flattened.unbind(1)]
        self.counts = shared_counts(self.seen, size)
        self.known = {}

    def channels(self, inputs):
        """float64 [C, size, size]."""
        narrow, wide = inputs.windows[0], inputs.windows[-1]
        wanted = [("near", window) for window in inputs.windows]
        wanted += [("far", wide)] * inputs.far
        wanted += [("count", window) for window in (1, 3, 9)] * inputs.density
        for i in range(len(self.moved)):
            wanted += [("moved", narrow, i), ("moved-count", 1, i)] * inputs.flattened
        for scale in range(self.surfels.normals.shape[1]):
            window = wide if scale else narrow
            wanted += [("look", window, scale, k) for k in range(4)] * inputs.normals
        wanted += [("noise", wide, i) for i in range(len(HOPS))] * inputs.noise
        return np.stack([self.plane(*key) for key in wanted])

    def plane(self, kind, window, *more):
        """A channel [size, size], made once."""
        key = (kind, window, *more)
        if key not in self.known:
            self.known[key] = self.make(kind, SCALED[self.size][window], *more)
        return self.known[key]

    def make(self, kind, side, *more):
        """The channel of windows `side` pixels across."""
        if kind == "look":
            return self.look(side, *more)
        if kind == "noise":
            return self.noise(side, *more)
        if kind == "count":
            return np.log1p(sums(self.counts, side))
        if kind == "moved-count":
            return np.log1p(shared_counts(self.moved[more[0]], self.size))
        seen = self.moved[more[0]] if kind == "moved" else self.seen
        return nearness(best(seen, side, self.size, -1 if kind == "far" else 1), self.size)

    def noise(self, side, scale):
        """Thrice the lower median of the cloud's variation, where a point is near."""
        of_points = sorted(self.surfels.variation[:, scale].tolist())
        plane = np.zeros((self.size, self.size))
        for pixel in best(self.seen, side, self.size):
            plane[pixel] = 3 * of_points[(len(of_points) - 1) // 2]
        return plane

    def look(self, side, scale, k):
        """Return the normal of the points (k = 0, 1, 2), or thrice the variation (3)."""
        pose = camera_to_world(self.view)
        plane = np.zeros((self.size, self.size))
        for pixel, (_, i) in best(self.seen, side, self.size).items():
            normal = self.surfels.normals[i, scale].double().numpy()
            if normal @ (pose[:3, 3] - self.surfels.points[i].double().numpy()) < 0:
                normal = -normal
            values = (*(normal @ pose[:3, :3]), 3 * float(self.surfels.variation[i, scale]))
            plane[pixel] = values[k]
        return plane


def visible(points, view, size):
    """(row, column, depth, number) of the points that are ahead and in the image."""
    places, depths = project(points.numpy(), view)
    for number, ((column, row), depth) in enumerate(
        zip(places * size / IMAGE_SIZE, depths, strict=True)
    ):
        if depth > 0.2 and 0 <= row < size and 0 <= column < size:
            yield row, column, depth, number


def best(seen, side, size, sign=1):
    """{pixel: (depth, number)} of the nearest point (the farthest: sign -1) of those whose own
    pixel is in a square around it; of equally near ones, that of the lowest number."""
    half = side // 2
    actual = {}
    for row, column, depth, number in seen:
        for r in range(int(row) - half, int(row) + half + 1):
            for c in range(int(column) - half, int(column) + half + 1):
                if 0 <= r < size and 0 <= c < size:
                    candidate = (sign * depth, number)
                    actual[r, c] = min(actual.get((r, c), candidate), candidate)
    return {pixel: (sign * depth, number) for pixel, (depth, number) in actual.items()}


def nearness(actual, size):
    """Half of how much nearer than 5.25 it is, 0..1.5."""
    values = np.zeros((size, size))
    for pixel, (depth, _) in actual.items():
        values[pixel] = min(max((4 + 1.25 - depth) / 2, 0), 1.5)
    return values


def shared_counts(seen, size):
    """A point counts in the four pixels whose centres are around it, the more the nearer."""
    counts = np.zeros((size, size))
    for row, column, _, _ in seen:
        for r in range(int(row) - 1, int(row) + 2):
            for c in range(int(column) - 1, int(column) + 2):
                share = max(0, 1 - abs(row - r - 0.5)) * max(0, 1 - abs(column - c - 0.5))
                if 0 <= r < size and 0 <= c < size:
                    counts[r, c] += share
    return counts


def sums(counts, side):
    """Over squares of `side` pixels around each: every pixel is in those of its neighbours."""
    half = side // 2
    actual = np.zeros_like(counts)
    for r, c in np.argwhere(counts > 0):
        actual[max(0, r - half) : r + half + 1, max(0, c - half) : c + half + 1] += counts[r, c]
    return actual
