"""Invented holes and parts: what an image lacks inside the true object, and what it shows outside.

Scores that compare pixels or features hardly tell a thousand pixels of slightly wrong colour from a
hole in the back of a chair; a viewer sees the hole at once.

* The inside is all pixels of the true silhouette whose centres lie at least 3 px from everything
  that is not silhouette. The outside is all pixels that lie as far from the silhouette. Between the
  two nothing counts, because edges that are off by a pixel or two, as those of a slightly moved
  part, invent nothing. What lies beyond the frame is background.
* A hole is inside and not drawn, a part is outside and drawn. `bench.metrics.silhouette` says what
  counts as drawn; haze does not. Where the true image is white there is background, even within the
  outline of the object.
* Pixels of holes and parts count only in connected groups of at least 20, since smaller ones are
  hardly seen in images of this size.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.metrics.silhouette import Masks, Pairs, large_groups

# The smallest group of pixels that counts. Pixels that touch at a corner are connected, too.
_LEAST_GROUP = 20
# The side, in pixels, of the square around a pixel that has exactly the pixels nearer than 3 px:
# its corners are 2.83 px from the centre, and the nearest pixel outside it is 3 px away.
_SQUARE = 5


def invented_holes(truth: NDArray[np.uint8], images: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the number of pixels of invented holes of each image, float64 [N]; 0 is best.

    `truth` and `images` are uint8 [N, H, W, C]. Raises ValueError as `Pairs`.
    """
    pairs = Pairs(truth, images)
    inside = ~_near(~pairs.shown, beyond_the_frame=True)
    return _counted(inside & ~pairs.drawn(pairs.shown))


def invented_parts(truth: NDArray[np.uint8], images: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the number of pixels of invented parts of each image, float64 [N]; 0 is best.

    `truth` and `images` are uint8 [N, H, W, C]. Raises ValueError as `Pairs`.
    """
    pairs = Pairs(truth, images)
    outside = ~_near(pairs.shown, beyond_the_frame=False)
    return _counted(outside & pairs.drawn(pairs.shown))


def _near(masks: Masks, *, beyond_the_frame: bool) -> Masks:
    """Return the pixels [N, H, W] whose centres are less than 3 px from a pixel in the mask.

    beyond_the_frame  whether pixels beyond the frame are in the mask
    """
    from scipy.ndimage import maximum_filter

    size = (1, _SQUARE, _SQUARE)
    return maximum_filter(masks, size, mode="constant", cval=beyond_the_frame)


def _counted(masks: Masks) -> NDArray[np.float64]:
    """Return the number of pixels [N] of each mask that are in groups of at least _LEAST_GROUP."""
    return np.count_nonzero(large_groups(masks, _LEAST_GROUP), axis=(1, 2)).astype(np.float64)
