"""MS-SSIM by published values and by its definition; closed forms are in `test_extreme_inputs`."""

from __future__ import annotations

import numpy as np
import pytest
from skimage.measure import block_reduce
from skimage.metrics import structural_similarity

from bench.metrics.multiscale_similarity import WEIGHTS, ms_ssim, scale_weights

from .similarity_images import PAIRS

# Of 192 px with five scales, by MS_SSIM(test_y_channel=False) of PyTorch Toolbox for Image Quality
# Assessment 0.1.16 in float64, 2026-11-25. Its powers add up to 1.0001.
PUBLISHED = {"phase": 0.98293666, "contrast": 0.88731718, "both": 0.93680192}


@pytest.mark.parametrize("name", PAIRS)
def test_published_values_at_five_scales(name):
    a, b = PAIRS[name](192)
    (actual,) = ms_ssim(a, b)
    assert actual == pytest.approx(PUBLISHED[name] ** (1 / sum(WEIGHTS)), abs=1e-6)


def by_scikit_image(a, b):
    """Return one pair's value by SSIM of scikit-image without its luminance: of images whose means
    are made equal there is no other way to its components."""
    x, y = (z[0].astype(np.float64) for z in (a, b))
    logs = 0.0
    for weight in scale_weights(128):
        value = structural_similarity(
            x, y, gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
            data_range=255, channel_axis=-1,
        )  # fmt: skip
        logs += weight * np.log(value)
        x, y = (block_reduce(z, (2, 2, 1), np.mean) for z in (x, y))
    return float(np.exp(logs))


def test_agrees_with_scikit_image_where_luminance_is_one():
    """Windows whose means agree have a luminance of 1: stripes of two pixels against none."""
    a = np.full((1, 128, 128, 3), 128, np.uint8)
    fine = a.copy()
    fine[:, ::2, ::2] += 20
    fine[:, 1::2, 1::2] += 20
    fine[:, ::2, 1::2] -= 20
    fine[:, 1::2, ::2] -= 20
    # Windows of 11 px do not average a chequered pattern away, but for 1e-3 of a level.
    assert ms_ssim(a, fine)[0] == pytest.approx(by_scikit_image(a, fine), abs=1e-6)


@pytest.mark.parametrize(
    ("side", "scales"), [(1, 1), (21, 1), (22, 2), (87, 3), (88, 4), (128, 4), (176, 5), (999, 5)]
)
def test_as_many_scales_as_have_a_whole_window(side, scales):
    weights = scale_weights(side)
    assert len(weights) == scales
    assert sum(weights) == pytest.approx(1, abs=1e-15)
    assert np.divide(weights, WEIGHTS[:scales]) == pytest.approx(1 / sum(WEIGHTS[:scales]))
