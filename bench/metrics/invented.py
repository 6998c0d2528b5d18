"""Invented holes and parts: what a drawing lacks inside the true object, and has beside it.

Scores of pixels or of features hardly differ between a thousand pixels of slightly wrong colour and
a hole in the back of a chair; a viewer sees the hole at once.

* Inside are the pixels of the true silhouette whose centres lie at least 3 px from all that is not
  silhouette, outside those that lie as far from the silhouette: what is off by a pixel or two, as
  edges of a slightly moved part are, is no invention. Beyond the frame is background.
* A hole is what is inside and not drawn, a part what is outside and drawn; what counts as drawn,
  and that haze does not, is said in `bench.metrics.silhouette`. Where the true image is white there
  is background, also within the outline of an object.
* Their pixels count in connected groups of at least 20, which is what the eye finds at this size.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.metrics.silhouette import Masks, Pairs, large_groups

_LEAST_GROUP = 20  # pixels, connected also at corners
# Side of the square around a pixel that holds exactly the pixels nearer than 3 px: its corners are
# 2.83 px from the centre, and the nearest pixel outside it is 3 px away.
_SQUARE = 5  # px


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
    """Return the pixels [N, H, W] whose centres are less than 3 px from one in the mask.

    `beyond_the_frame` is the mask there.
    """
    from scipy.ndimage import maximum_filter

    size = (1, _SQUARE, _SQUARE)
    return maximum_filter(masks, size, mode="constant", cval=beyond_the_frame)


def _counted(masks: Masks) -> NDArray[np.float64]:
    return np.count_nonzero(large_groups(masks, _LEAST_GROUP), axis=(1, 2)).astype(np.float64)
