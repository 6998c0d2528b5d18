"""How far the silhouette of the drawn object covers that of the true one, whatever is in it.

Intersection over union (Jaccard 1912) of two sets of pixels: what the true picture shows, and what
the picture draws, as `bench.metrics.foreground` defines them. Colour, shading and parts inside do
not count, so that a method that knows neither may score 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.metrics.foreground import drawn, foreground


def silhouette_iou(truth: NDArray[np.uint8], pictures: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Intersection over union of silhouettes [N], 0..1, of pictures against the true ones.

    Both uint8 [N, H, W, 3] on white. 1 for identical pictures and where neither shows anything: it
    always has a value. 0 where nothing is drawn of a true picture that shows something, and the
    other way round. A picture's value does not depend on its neighbours.

    Raises ValueError where an array is not uint8 or not [N, H, W, C], and where the shapes differ.
    """
    covered = drawn(truth, pictures, foreground(truth))
    shown = foreground(truth)
    both = np.count_nonzero(shown & covered, axis=(1, 2))
    either = np.count_nonzero(shown | covered, axis=(1, 2))
    return np.where(either == 0, 1.0, both / np.maximum(either, 1))
