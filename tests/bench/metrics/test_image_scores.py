"""All scores together: `ssim_object` by its definition, and what the scores share."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import binary_dilation
from skimage.metrics import structural_similarity

from bench.metrics.image_scores import scores
from bench.metrics.peak_signal_to_noise import psnr
from bench.metrics.silhouette import silhouette_iou
from bench.metrics.structural_similarity import ssim_per_image
from bench.metrics.thin_parts import thin_scores

# As in `test_structural_similarity`: a window of the map errs by 1e-12, here and in scikit-image.
TOLERANCE = 1e-10


def ssim_object_by_definition(truth, drawing):
    """One pair uint8 [H, W, 3]: scikit-image's map over the dilated union of silhouettes.

    Silhouettes in whole numbers: three times the contrast, twice the threshold.
    """
    true, actual = (765 - image.astype(int).sum(axis=-1) for image in (truth, drawing))
    shown = (truth < 255).any(axis=-1)
    median = np.median(true[shown]) if shown.any() else 225
    drawn = 2 * actual >= np.minimum(np.where(shown, true, median), 225)
    _, full = structural_similarity(
        truth,
        drawing,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        data_range=255,
        channel_axis=-1,
        full=True,
    )
    near = binary_dilation(shown | drawn, np.ones((11, 11)))
    return full.mean(axis=-1)[5:-5, 5:-5][near[5:-5, 5:-5]].mean()


def chair(shift=0, color=(120, 80, 40), side=128):
    """A seat with two legs and a back, far from the frame; [1, side, side, 3]."""
    image = np.full((1, side, side, 3), 255, np.uint8)
    for top, bottom, left, right in (
        (30, 58, 44, 50),
        (54, 60, 44, 80),
        (60, 88, 46, 49),
        (60, 88, 75, 78),
    ):
        image[:, top + shift : bottom + shift, left + shift : right + shift] = color
    return image


def hazy(image, level):
    return np.minimum(image, np.uint8(level))


def pairs():
    """Objects that miss each other, haze that counts and haze that does not, objects at the frame,
    noise, light and dark colours."""
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (2, 1, 128, 128, 3), np.uint8)
    blank = np.full((1, 128, 128, 3), 255, np.uint8)
    cut = chair()[:, 34:, 46:].repeat(2, axis=1)[:, :128].repeat(2, axis=2)[:, :, :128]
    result = [
        (chair(), chair(3)),
        (chair(), chair(30)),
        (chair(), chair(color=(185, 180, 175))),
        (chair(), hazy(chair(2), 218)),
        (chair(), hazy(chair(2), 217)),
        (chair(color=(240, 244, 250)), hazy(chair(1), 251)),
        (chair(), blank),
        (blank, chair()),
        (cut[:, :128, :128], chair()),
        (noise[0], noise[1]),
        (chair(), np.where(rng.random((1, 128, 128, 1)) < 0.01, 0, chair(1)).astype(np.uint8)),
    ]
    truth, drawing = zip(*result, strict=True)
    return np.concatenate(truth), np.concatenate(drawing)


def test_ssim_object_is_by_its_definition():
    truth, drawing = pairs()
    expected = [ssim_object_by_definition(t, d) for t, d in zip(truth, drawing, strict=True)]
    assert min(expected) < 0.01
    assert max(expected) > 0.7
    actual = scores(truth, drawing)["ssim_object"]
    np.testing.assert_allclose(actual, expected, rtol=0, atol=TOLERANCE)


def test_white_around_the_object_does_not_count():
    """In larger frames ssim of the same object rises, ssim-object stays; so it does where white is
    drawn in its place."""
    for drawing in (chair(3), np.full_like(chair(), 255)):
        wide = [np.pad(x, ((0, 0), (40, 60), (50, 50), (0, 0)), constant_values=255)
                for x in (chair(), drawing)]  # fmt: skip
        near, far = scores(chair(), drawing), scores(*wide)
        assert far["ssim"] > near["ssim"] + 0.05
        assert far["ssim_object"] == pytest.approx(near["ssim_object"], abs=TOLERANCE)


def test_what_is_drawn_beside_the_object_counts():
    """A second chair, where the true image is white, lowers it."""
    both = np.minimum(chair(), np.roll(chair(), 40, axis=2))
    actual = scores(np.concatenate([chair(), chair()]), np.concatenate([both, chair()]))
    assert actual["ssim_object"][0] < 0.7
    assert actual["ssim_object"][1] == 1.0


def test_scores_are_those_of_each_metric_by_itself():
    """Bit for bit, and an image's do not depend on its neighbours."""
    truth, drawing = pairs()
    actual = scores(truth, drawing)
    alone = ssim_per_image(truth, drawing)._asdict()
    alone |= {"psnr": psnr(truth, drawing)}
    alone |= {"silhouette_iou": silhouette_iou(truth, drawing)}
    alone |= {f"thin_{k}": v for k, v in thin_scores(truth, drawing)._asdict().items()}
    assert actual.keys() == {*alone, "ssim_object"}
    for name, values in alone.items():
        np.testing.assert_array_equal(actual[name], values)
    for i in range(len(truth)):
        first = scores(truth[i : i + 1], drawing[i : i + 1])
        for name, values in first.items():
            np.testing.assert_array_equal(actual[name][i : i + 1], values)
