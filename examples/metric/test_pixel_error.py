"""The metric of identical images, and of black and white ones."""

import numpy as np
from pixel_error import METRIC


def test_identical_images_are_best():
    """Black differs from white by 255 grey levels."""
    white = np.full((2, 128, 128, 3), 255, np.uint8)
    black = np.zeros_like(white)
    assert METRIC.score(white, white).tolist() == [0, 0]
    assert METRIC.score(white, black).tolist() == [255, 255]
