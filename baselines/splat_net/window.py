"""Windows: the part of an image that the finest level of the network computes.

Most of an image is white. A box around the object's points and a few pixels more hold all that the
network draws; beyond, an image is white, and the finest level has what an image without points has
there. The coarser levels see whole images.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

RING = 2  # pixels at a window's edge that are wrong: the last two convolutions miss what is beyond
STEP = 8  # of heights and widths: each size needs kernels of its own


class Box(NamedTuple):
    """The rows top .. bottom - 1 and columns left .. right - 1 of an image."""

    top: int
    bottom: int
    left: int
    right: int

    def grown(self, pixels: int, size: int) -> Box:
        """Return the box enlarged by `pixels` on all sides, within an image of a size."""
        top, left = max(0, self.top - pixels), max(0, self.left - pixels)
        return Box(top, min(size, self.bottom + pixels), left, min(size, self.right + pixels))

    def moved(self, rows: int, columns: int) -> Box:
        """Return the box moved by rows and columns."""
        return Box(self.top + rows, self.bottom + rows, self.left + columns, self.right + columns)

    def of(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the box's part of an image [S, S, ...]: a view of the same memory."""
        return image[self.top : self.bottom, self.left : self.right]


@dataclass(frozen=True)
class Windows:
    """The windows of some of many images, of one size, so that they pass the network together.

    numbers        of the images
    corners        first row and column of each, even
    height, width  multiples of STEP, or the image's
    size           of the images
    """

    numbers: Sequence[int]
    corners: Sequence[tuple[int, int]]
    height: int
    width: int
    size: int

    @property
    def whole(self) -> bool:
        """Return whether the windows are whole images."""
        return self.height == self.width == self.size

    def cut(self, images: Tensor) -> Tensor:
        """Return the windows' parts [n, height, width, ...] of all images [P, size, size, ...]."""
        if self.whole and self.numbers == range(len(images)):
            return images
        h, w = self.height, self.width
        parts = zip(self.numbers, self.corners, strict=True)
        return torch.stack([images[i, y : y + h, x : x + w] for i, (y, x) in parts])

    def below(self) -> Windows:
        """Return the same windows of the n images of the level below."""
        corners = [(top // 2, left // 2) for top, left in self.corners]
        numbers = range(len(corners))
        return Windows(numbers, corners, self.height // 2, self.width // 2, self.size // 2)

    def paste(self, parts: Tensor, empty: Tensor) -> Tensor:
        """Return parts [n, height, width, c], surrounded by an image without points.

        The surroundings are `empty` [1, size, size, c].

        A convolution of stride 2 has made the parts. It looks at the pixel before their first row
        and column: where the image goes on, these are wrong, and those of `empty` right. All is as
        in a whole image if the channels are zero up to three pixels from the windows' edges.
        """
        if self.whole:
            return parts
        h, w = self.height, self.width
        images = empty.repeat(len(parts), 1, 1, 1)
        for image, part, (y, x) in zip(images, parts, self.corners, strict=True):
            image[y + (y > 0) : y + h, x + (x > 0) : x + w] = part[int(y > 0) :, int(x > 0) :]
        return images


def whole_images(numbers: Sequence[int], size: int) -> Windows:
    """Return windows that cover whole images."""
    return Windows(numbers, [(0, 0)] * len(numbers), size, size, size)


def in_groups(boxes: Mapping[int, Box], size: int, most: int) -> Iterator[Windows]:
    """Yield windows around boxes of images, by number, in groups of at most `most`.

    Images of like boxes are together. Windows reach RING beyond the boxes, or to the image's edge.
    """
    order = sorted(boxes, key=lambda i: boxes[i].right - boxes[i].left)
    count = -(-len(boxes) // most)
    for k in range(count):  # sizes differ by one at most: each needs kernels of its own, too
        numbers = order[k * len(order) // count : (k + 1) * len(order) // count]
        rows = [_span(boxes[i].top, boxes[i].bottom, size) for i in numbers]
        columns = [_span(boxes[i].left, boxes[i].right, size) for i in numbers]
        height = max(end - start for start, end in rows)
        width = max(end - start for start, end in columns)
        corners = [
            (min(top, size - height), min(left, size - width))
            for (top, _), (left, _) in zip(rows, columns, strict=True)
        ]
        yield Windows(numbers, corners, height, width, size)


def _span(start: int, end: int, size: int) -> tuple[int, int]:
    """Return start - RING .. end + RING in the image: the first even, their distance by STEP."""
    start, end = max(0, start - RING) // 2 * 2, min(size, end + RING)
    return start, start + min(size, -(-(end - start) // STEP) * STEP)
