"""SSIM against independent implementations; closed forms and refusals are in
`test_extreme_inputs`."""

from __future__ import annotations

import re

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
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
    "the-corner": (shape(255), specks(shape(255), 100, 0)),
    "one-pixel-against-noise": (specks(shape(130), 100, 31), rnd(4, 60, 60)),
    # every window differs from flat by one level in one pixel, often in a corner
    "faint-specks-on-black-against-noise": (specks(shape(0), 11, 5), rnd(5, 60, 60)),
    "faint-against-faint": (specks(shape(90), 11, 5), specks(shape(200), 11, 2)),
    # The middle, pixel 29, differs from the flat colour around it, which is therefore not 0 after
    # the pixels are taken from it: rounding leaves a variance of up to 1e-11.
    "flat-but-for-the-middle-against-noise": (
        specks(shape((30, 120, 200), 58), 24, 5, by=128),
        rnd(22, 58, 58),
    ),
    "one-level-step": (np.sort(rnd(7, 60, 60) // 128 + 100, axis=1), rnd(8, 60, 60)),
    "even-window": (rnd(9, 10, 60), rnd(10, 10, 60)),
    "flat-even-window": (shape(61, 8), rnd(11, 8, 8)),
    "window-of-two": (rnd(12, 2, 30), rnd(13, 2, 30)),
    "window-of-one": (rnd(14, 1, 30), rnd(15, 1, 30)),
    "one-window-and-its-negative": (rnd(2, 11, 11), 255 - rnd(2, 11, 11)),
    "odd-and-even-sides": (rnd(18, 35, 36), rnd(19, 35, 36)),
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


def pixels(*boxes, shape=(128, 128)):
    """A mask of boxes (top, bottom, left, right), ends exclusive."""
    mask = np.zeros(shape, bool)
    for top, bottom, left, right in boxes:
        mask[top:bottom, left:right] = True
    return mask


@pytest.mark.parametrize(("height", "width"), [(1, 9), (4, 30), (11, 30), (35, 36), (60, 60)])
def test_a_mask_has_the_windows_that_it_meets(height, width):
    """All values that differ are within the mask, hence all that the other windows hold is equal:
    the sum over the windows in the mask is the sum over all, less 1 for each of the others."""
    size = min(height, width, 11)
    a = rnd(1, height, width)
    b = a.copy()
    mask = pixels((height // 2, height // 2 + 2, width // 3, width // 3 + 1), shape=(height, width))
    b[mask] = 255 - b[mask]
    meets = sliding_window_view(mask, (size, size)).any(axis=(-2, -1))
    expected = 1 + (two_pass(a, b).ssim - 1) * meets.size / meets.sum()
    whole, actual = ssim_per_image_and_mask(a[None], b[None], mask[None])
    np.testing.assert_array_equal(np.array(whole), np.array(ssim_per_image(a[None], b[None])))
    # the factor widens the error of the mean
    assert actual == pytest.approx(expected, abs=TOLERANCE.ssim * meets.size / meets.sum())


def test_masks_that_are_empty_or_of_another_number_or_type():
    masks = np.stack([pixels(), pixels((60, 61, 60, 61)), pixels((0, 1, 0, 1))])
    pair = np.repeat(rnd(6)[None], 3, axis=0), np.repeat(rnd(7)[None], 3, axis=0)
    assert np.isnan(ssim_per_image_and_mask(*pair, masks)[1]).tolist() == [True, False, False]
    same = ssim_per_image_and_mask(pair[0], pair[0], masks)[1]
    np.testing.assert_array_equal(same, [np.nan, 1.0, 1.0])
    message = r"\[3, 128, 128, 3\] images need bool masks \[3, 128, 128\], got"
    for wrong in (masks[:2], masks.astype(float)):
        with pytest.raises(ValueError, match=message):
            ssim_per_image_and_mask(*pair, wrong)
