"""PSNR against scikit-image, and its largest value; refusals are in `test_extreme_inputs`."""

from __future__ import annotations

import math

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio

from bench.metrics import psnr
from bench.metrics.image_scores import scores

# The sum of squares is a whole number and exact; a quotient, a logarithm and a product round, each
# by at most 2 units of 2^-53 of values up to 100, here and in scikit-image.
TOLERANCE = 12 * 100 * 2.0**-53


def test_agrees_with_scikit_image():
    rng = np.random.default_rng(0)
    a = rng.integers(0, 256, (6, 40, 30, 3), np.uint8)
    b = a.copy()
    for i, share in enumerate((1.0, 0.5, 0.1, 0.03, 0.01, 0.003)):
        at = rng.random(a[i].shape) < share
        b[i][at] = rng.integers(0, 256, at.sum(), np.uint8)
    expected = [peak_signal_noise_ratio(x, y, data_range=255) for x, y in zip(a, b, strict=True)]
    assert 5 < min(expected) < 10
    assert max(expected) > 35
    np.testing.assert_allclose(psnr(a, b), expected, rtol=0, atol=TOLERANCE)
    wide = [np.tile(x, (1, 4, 5, 1))[:, :128, :128] for x in (a, b)]
    np.testing.assert_array_equal(scores(*wide)["psnr"], psnr(*wide))


def test_identical_images_have_the_value_of_one_level_in_one_channel():
    a = np.random.default_rng(1).integers(1, 255, (3, 128, 128, 3), np.uint8)
    b = a.copy()
    b[1, 70, 20, 1] += 1
    b[2, 70, 20, 1] += 1
    b[2, 0, 0, 0] -= 1
    most = 20 * math.log10(255) + 10 * math.log10(128 * 128 * 3)
    assert most == pytest.approx(95.05, abs=0.005)  # as the list of metrics says
    expected = [most, most, most - 10 * math.log10(2)]
    np.testing.assert_allclose(psnr(a, b), expected, rtol=0, atol=TOLERANCE)
