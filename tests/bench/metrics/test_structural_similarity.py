"""SSIM against independent implementations; closed forms and refusals are in
`test_extreme_inputs`."""

from __future__ import annotations

import hashlib
import re

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import binary_dilation
from skimage.metrics import structural_similarity
from threadpoolctl import threadpool_limits

from bench.metrics import ssim
from bench.metrics.structural_similarity import Ssim, ssim_per_image, ssim_per_image_and_mask

from .reference import reference_cases

# Error budget. A variance in float64 errs by at most about 1e-11 (moments of up to 255^2 = 6.5e4
# with 2^-53 = 1.1e-16 each, a few roundings). `ssim` divides by C2 = 58.5 and more: 1e-12 a window,
# less in the mean. In `structure` and `contrast` a window of small variance v errs by
# 1e-11 / (2 sqrt(v)) * sqrt(v2) / C3: 2e-8 in the worst window that is not flat (v = 1e-6, v2 =
# 1e4), and such windows are rare: 1e-9 in the mean. Flat windows are exact.
TOLERANCE = Ssim(ssim=1e-10, luminance=1e-10, contrast=1e-9, structure=1e-9)


def assert_close(actual: Ssim, expected: Ssim) -> None:
    for name in Ssim._fields:
        error = abs(getattr(actual, name) - getattr(expected, name))
        assert error <= getattr(TOLERANCE, name), f"{name} is off by {error:.2e}"


C1, C2, C3 = 2.55**2, 7.65**2, 7.65**2 / 2  # by the protocol, not the code's own


def rnd(seed, h=128, w=128, c=3):
    return np.random.default_rng(seed).integers(0, 256, size=(h, w, c), dtype=np.uint8)


def hgrad():
    row = ((255 * np.arange(128)) // 127).astype(np.uint8)
    return np.tile(row[None, :, None], (128, 1, 3))


def vgrad():
    return hgrad().transpose(1, 0, 2)


def disc(cx=64, cy=64, r=40, fg=(200, 60, 30), bg=255):
    image = np.full((128, 128, 3), bg, dtype=np.uint8)
    y, x = np.mgrid[:128, :128]
    image[(x - cx) ** 2 + (y - cy) ** 2 <= r**2] = fg
    return image


def noise(image, sigma, seed):
    values = image.astype(np.float64)
    values += sigma * np.random.default_rng(seed).standard_normal(image.shape)
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def const(v):
    return np.full((128, 128, 3), v, dtype=np.uint8)


def chairish(k):
    image = const(255)
    for y0, y1, x0, x1, color in (
        (30, 70, 44, 52, (120, 80, 40)),
        (66, 74, 44, 86, (150, 100, 50)),
        (74, 104, 46, 50, (90, 60, 30)),
        (74, 104, 80, 84, (90, 60, 30)),
    ):
        image[y0:y1, x0 + k : x1 + k] = color
    return image


MAKERS = {f.__name__: f for f in (rnd, hgrad, vgrad, disc, noise, const, chairish)}


def draw(expression, **names):
    """`disc` is written for `disc()`."""
    bare = rf"\b({'|'.join(MAKERS)})\b(?!\()"
    code = re.sub(bare, r"\1()", expression.strip())
    return eval(code, {"__builtins__": {}, **MAKERS, **names})


def draw_pair(recipe):
    recipe = recipe.split(";")[0]
    indices = [0]
    if stack := re.fullmatch(r"stack_i (.*), i=(\d+)\.\.(\d+)", recipe):
        recipe = stack[1]
        indices = range(int(stack[2]), int(stack[3]) + 1)
    left, right = recipe.split(" vs ")
    a = [draw(left, i=i) for i in indices]
    right = right.replace("(.,", "(left,")
    b = [draw(right, i=i, left=image) for i, image in zip(indices, a, strict=True)]
    return np.stack(a), np.stack(b)


@pytest.mark.parametrize("case", reference_cases("ssim_reference.json"))
def test_conforms_to_reference(case):
    a, b = draw_pair(case["recipe"])
    assert hashlib.sha256(a.tobytes()).hexdigest() == case["sha256_img1"]
    assert hashlib.sha256(b.tobytes()).hexdigest() == case["sha256_img2"]
    exact = case["direct_longdouble"]
    assert_close(ssim(a, b), Ssim(exact["ssim"], exact["l"], exact["c"], exact["s"]))


def two_pass(a, b):
    """The definition, window by window about its own mean, in the longest float there is."""
    size = min(*a.shape[:2], 11)
    offsets = np.arange(size, dtype=np.longdouble) - np.longdouble(size - 1) / 2
    weights = np.exp(-(offsets**2) / (2 * (np.longdouble(size) * 1.5 / 11) ** 2))
    weights = weights[:, None] * weights / weights.sum() ** 2
    a, b = (
        sliding_window_view(image.astype(np.longdouble), (size, size), axis=(0, 1))
        for image in (a, b)
    )
    mean_a, mean_b = ((weights * x).sum((-2, -1)) for x in (a, b))
    off_a, off_b = a - mean_a[..., None, None], b - mean_b[..., None, None]
    var_a, var_b, cov = (
        (weights * product).sum((-2, -1)) for product in (off_a**2, off_b**2, off_a * off_b)
    )
    # What a longdouble leaves of a flat window's variance is 1e-36 here and does not matter.
    deviations = np.sqrt(var_a) * np.sqrt(var_b)
    luminance = (2 * mean_a * mean_b + C1) / (mean_a**2 + mean_b**2 + C1)
    contrast = (2 * deviations + C2) / (var_a + var_b + C2)
    structure = (cov + C3) / (deviations + C3)
    maps = (luminance * contrast * structure, luminance, contrast, structure)
    return Ssim(*(float(values.mean()) for values in maps))


def specks(image, step, offset, by=1):
    image = image.copy()
    image[offset::step, offset::step] += np.uint8(by)
    return image


def shape(v, side=60):
    return np.full((side, side, 3), v, dtype=np.uint8)


HARD = {
    "coloured-flat-against-noise": (disc(30, 30, 20)[:60, :60], rnd(1, 60, 60)),
    "dark-grey-against-texture": (shape(3), rnd(3, 60, 60)),
    "one-pixel-in-one-image": (shape(77), specks(shape(77), 100, 31)),
    "one-pixel-against-noise": (specks(shape(130), 100, 31), rnd(4, 60, 60)),
    # every window differs from flat by one level in one pixel, often in a corner
    "faint-specks-on-black-against-noise": (specks(shape(0), 11, 5), rnd(5, 60, 60)),
    "faint-against-faint": (specks(shape(90), 11, 5), specks(shape(200), 11, 2)),
    # The middle of every tile, pixels 17 and 41, differs from the flat colour around it, which is
    # therefore not 0 after the tile is centred: rounding leaves a variance of up to 1e-11.
    "flat-but-for-the-middles-of-tiles-against-noise": (
        specks(shape((30, 120, 200), 58), 24, 17, by=128),
        rnd(22, 58, 58),
    ),
    "one-level-step": (np.sort(rnd(7, 60, 60) // 128 + 100, axis=1), rnd(8, 60, 60)),
    "even-window": (rnd(9, 10, 60), rnd(10, 10, 60)),
    "flat-even-window": (shape(61, 8), rnd(11, 8, 8)),
    "window-of-two": (rnd(12, 2, 30), rnd(13, 2, 30)),
    "one-row-of-windows": (rnd(16, 11, 60), rnd(17, 11, 60)),
    "tile-and-one-window": (rnd(18, 35, 36), rnd(19, 35, 36)),
    "four-channels": (rnd(20, 40, 50, 4), rnd(21, 40, 50, 4)),
}


@pytest.mark.parametrize("name", HARD)
def test_agrees_with_two_pass_longdouble(name):
    a, b = HARD[name]
    assert_close(ssim(a[None], b[None]), two_pass(a, b))


def test_depends_on_neither_order_nor_threads_nor_memory_layout():
    """Bit for bit."""
    a = np.stack([*(chairish(k) for k in (-9, 0, 5)), disc(), rnd(0), const(255), hgrad()])
    b = np.stack([*(chairish(k) for k in (-7, 0, 9)), disc(50), rnd(1), disc(), vgrad()])
    with threadpool_limits(1):
        together = np.array(ssim_per_image(a, b))
    with threadpool_limits(2):
        np.testing.assert_array_equal(np.array(ssim_per_image(b, a)), together)
    # the mean of a stack is the mean over its images
    np.testing.assert_array_equal(np.array(ssim(a, b)), together.mean(axis=1))
    planes = [np.ascontiguousarray(x.transpose(0, 3, 1, 2)).transpose(0, 2, 3, 1) for x in (a, b)]
    assert ssim(*planes) == ssim(a, b)
    assert ssim(a.repeat(2, axis=0)[::2], b) == ssim(a, b)


def map_of(a, b):
    """The SSIM map [118, 118] of one pair, mean over channels, by scikit-image."""
    weights = {"gaussian_weights": True, "sigma": 1.5, "truncate": 3.5}
    weights |= {"use_sample_covariance": False, "data_range": 255}
    _, full = structural_similarity(a, b, full=True, channel_axis=-1, **weights)
    return full[5:-5, 5:-5].mean(axis=-1)


def pixels(*boxes, shape=(128, 128)):
    """A mask of boxes (top, bottom, left, right), ends exclusive."""
    mask = np.zeros(shape, bool)
    for top, bottom, left, right in boxes:
        mask[top:bottom, left:right] = True
    return mask


def test_a_mask_is_the_part_of_the_map_whose_windows_it_meets():
    a = np.stack([rnd(1), chairish(0), disc(), disc(40, 90, 20), rnd(4), rnd(5)])
    b = np.stack([rnd(2), chairish(3), noise(disc(), 20, 3), disc(44, 80, 20), rnd(5), rnd(7)])
    masks = np.stack(
        [
            pixels((0, 128, 0, 128)),
            (chairish(0) < 255).any(axis=-1) | (chairish(3) < 255).any(axis=-1),
            pixels((20, 21, 64, 65)),
            pixels((127, 128, 0, 1), (0, 9, 100, 128)),  # corners: windows at the frame
            np.random.default_rng(0).random((128, 128)) < 0.002,
            ~pixels((30, 60, 40, 90)),
        ]
    )
    whole, actual = ssim_per_image_and_mask(a, b, masks)
    np.testing.assert_array_equal(np.array(whole), np.array(ssim_per_image(a, b)))
    for i, mask in enumerate(masks):
        # the window in row r of the map is centred on pixel r + 5 and reaches 5 px to each side
        meets = binary_dilation(mask, np.ones((11, 11)))[5:-5, 5:-5]
        assert 0 < meets.sum() < 118**2 or i == 0
        assert actual[i] == pytest.approx(map_of(a[i], b[i])[meets].mean(), abs=TOLERANCE.ssim)
    # the map has no window that the whole frame does not meet
    assert actual[0] == pytest.approx(whole.ssim[0], abs=1e-15)


@pytest.mark.parametrize(("height", "width"), [(1, 9), (4, 30), (10, 10), (11, 30), (35, 36)])
def test_windows_of_small_images_meet_a_mask_too(height, width):
    """All values that differ are within the mask, hence all that the other windows hold is equal:
    the sum over the windows in the mask is the sum over all, less 1 for each of the others."""
    size = min(height, width, 11)
    a = rnd(1, height, width)
    b = a.copy()
    mask = pixels((height // 2, height // 2 + 2, width // 3, width // 3 + 1), shape=(height, width))
    b[mask] = 255 - b[mask]
    meets = sliding_window_view(mask, (size, size)).any(axis=(-2, -1))
    expected = 1 + (two_pass(a, b).ssim - 1) * meets.size / meets.sum()
    _, actual = ssim_per_image_and_mask(a[None], b[None], mask[None])
    # the factor widens the error of the mean
    assert actual == pytest.approx(expected, abs=TOLERANCE.ssim * meets.size / meets.sum())


def test_an_empty_mask_has_no_value_and_identical_images_are_1():
    masks = np.stack([pixels(), pixels((60, 61, 60, 61)), pixels((0, 1, 0, 1))])
    pair = np.repeat(rnd(6)[None], 3, axis=0), np.repeat(rnd(7)[None], 3, axis=0)
    assert np.isnan(ssim_per_image_and_mask(*pair, masks)[1]).tolist() == [True, False, False]
    same = ssim_per_image_and_mask(pair[0], pair[0], masks)[1]
    assert np.isnan(same[0])
    assert same[1:].tolist() == [1.0, 1.0]


def test_masks_of_another_number_or_type():
    pair = rnd(1)[None], rnd(2)[None]
    message = r"\[1, 128, 128, 3\] images need bool masks \[1, 128, 128\], got"
    for masks in (np.zeros((2, 128, 128), bool), np.zeros((1, 128, 128))):
        with pytest.raises(ValueError, match=message):
            ssim_per_image_and_mask(*pair, masks)
