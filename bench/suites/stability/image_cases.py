"""Cases on metrics of images: SSIM, thin parts, silhouettes, and arrays that are not images."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.metrics import JUDGE
from bench.metrics.frechet import TooFewSamples
from bench.suites.stability.metric_cases import (
    C1,
    C2,
    C3,
    FD_VIEWS,
    ONE_WINDOW,
    SIGMA,
    SSIM,
    SUMS,
    THIN,
    UNIT_CODES,
    WHOLE_LEG,
    WINDOW,
    Case,
    Near,
    Pictures,
    Refused,
    Stated,
    U,
    flat,
    leg,
    luminance_of_flat,
    noise,
    ones,
    speck,
    twice,
    undefined,
)
from data_prep.scene import IMAGE_SIZE

Floats = NDArray[np.float64]


def gaussian_window(size: int) -> Floats:
    """The Gaussian window [size, size], from its definition."""
    offsets = np.arange(size) - (size - 1) / 2
    sigma = SIGMA * size / WINDOW
    weights = np.exp(-(offsets[:, None] ** 2 + offsets**2) / (2 * sigma**2))
    return weights / weights.sum()


def _flat_pair(p: int, q: int, words: str, in_box: bool = True) -> dict[str, Stated]:
    """Two flat images: nothing varies, hence contrast C2 / C2 and structure C3 / C3."""
    of_box = (
        {"ssim-object": Near(words, luminance_of_flat(p, q), SUMS)}
        if in_box
        else undefined("ssim-object")
    )
    return {
        "ssim": Near(words, luminance_of_flat(p, q), SUMS),
        "luminance": Near(words, luminance_of_flat(p, q), SUMS),
        "contrast": Near("C2 / C2", 1.0),
        "structure": Near("C3 / C3", 1.0),
        **of_box,
        **undefined(*THIN),
    }


def _speck_components(p: int, q: int, weights: Floats) -> dict[str, Floats]:
    """A flat image of p against windows that hold one pixel q, with these weights.

    Mean p + (q - p) w, variance (q - p)^2 w (1 - w); against a flat window the structure is C3/C3.
    """
    mean, variance = p + (q - p) * weights, (q - p) ** 2 * weights * (1 - weights)
    luminance = (2 * p * mean + C1) / (p * p + mean**2 + C1)
    contrast = C2 / (variance + C2)
    return {
        "ssim": luminance * contrast,
        "luminance": luminance,
        "contrast": contrast,
        "structure": np.ones_like(weights),
    }


def _speck_pair(p: int, q: int, at: int) -> dict[str, Stated]:
    """`speck`, in the second image only: all other windows score 1."""
    weights = gaussian_window(WINDOW)
    weights = weights[:1, :1] if at == 0 else weights
    n_windows = (IMAGE_SIZE - WINDOW + 1) ** 2
    words = f"closed form over the {weights.size} windows with the pixel"
    stated: dict[str, Stated] = {
        name: Near(words, 1.0 + float((values - 1.0).sum()) / n_windows, SUMS)
        for name, values in _speck_components(p, q, weights).items()
    }
    return stated | undefined(*THIN)


def _one_window(name: str, a: Pictures, b: Pictures) -> float:
    """A component of images [1, s, s, C] with a single window: two passes in longdouble."""
    size = a.shape[1]
    weights = gaussian_window(size).astype(np.longdouble)[..., None]
    x, y = a[0].astype(np.longdouble), b[0].astype(np.longdouble)
    mean_x, mean_y = (weights * x).sum((0, 1)), (weights * y).sum((0, 1))
    var_x = (weights * (x - mean_x) ** 2).sum((0, 1))
    var_y = (weights * (y - mean_y) ** 2).sum((0, 1))
    cov = (weights * (x - mean_x) * (y - mean_y)).sum((0, 1))
    root = np.sqrt(var_x * var_y)
    luminance = (2 * mean_x * mean_y + C1) / (mean_x**2 + mean_y**2 + C1)
    contrast = (2 * root + C2) / (var_x + var_y + C2)
    structure = (cov + C3) / (root + C3)
    found = {
        "ssim": luminance * contrast * structure,
        "luminance": luminance,
        "contrast": contrast,
        "structure": structure,
    }
    return float(found[name].mean())


def _small(side: int) -> Case:
    words = "its one window, computed from the definition"
    stated = {name: Near(words, functools.partial(_one_window, name), ONE_WINDOW) for name in SSIM}
    return Case(
        f"noise-of-{side}x{side}",
        "small images",
        lambda: (noise(side, side), noise(side + 100, side)),
        stated | {"ssim-object": stated["ssim"]} | undefined(*THIN),
    )


def _strip(a: Pictures, b: Pictures) -> float:
    """Mean luminance of single pixels."""
    p, q = a.astype(np.float64), b.astype(np.float64)
    return float(((2 * p * q + C1) / (p * p + q * q + C1)).mean())


_STRIP: Mapping[str, Stated] = {
    "ssim": Near("windows of one pixel: luminance", _strip, SUMS),
    "luminance": Near("mean of (2 p q + C1) / (p^2 + q^2 + C1)", _strip, SUMS),
    **ones("windows of one pixel vary in nothing", "contrast", "structure"),
}

SSIM_CASES = (
    Case(
        "identical-noise",
        "identical",
        lambda: twice(noise(1)),
        ones("identical", *SSIM, "ssim-object") | undefined(*THIN),
    ),
    Case(
        "identical-leg",
        "identical",
        lambda: twice(leg()),
        ones("identical", *SSIM, "ssim-object") | WHOLE_LEG,
    ),
    Case(
        "identical-white",
        "identical",
        lambda: twice(flat(255)),
        ones("identical", *SSIM) | undefined("ssim-object", *THIN),
    ),
    Case(
        "identical-black",
        "identical",
        lambda: twice(flat(0)),
        ones("identical", *SSIM, "ssim-object") | undefined(*THIN),
    ),
    Case(
        "black-against-white",
        "flat images",
        lambda: (flat(0), flat(255)),
        _flat_pair(0, 255, "C1 / (255^2 + C1)"),
    ),
    Case(
        "white-against-black",
        "flat images",
        lambda: (flat(255), flat(0)),
        _flat_pair(255, 0, "C1 / (255^2 + C1)", in_box=False),
    ),
    Case(
        "black-against-one-level",
        "flat images",
        lambda: (flat(0), flat(1)),
        _flat_pair(0, 1, "C1 / (1 + C1)"),
    ),
    Case(
        "grey-against-one-level-less",
        "flat images",
        lambda: (flat(128), flat(127)),
        _flat_pair(128, 127, "(2 p q + C1) / (p^2 + q^2 + C1)"),
    ),
    Case(
        "light-against-dark",
        "flat images",
        lambda: (flat(200), flat(7)),
        _flat_pair(200, 7, "(2 p q + C1) / (p^2 + q^2 + C1)"),
    ),
    Case(
        "noise-against-its-negative",
        "flat images",
        lambda: (noise(2, WINDOW), 255 - noise(2, WINDOW)),
        {
            "contrast": Near("equal variances", 1.0, ONE_WINDOW),
            "structure": Near(
                "its one window, computed from the definition",
                functools.partial(_one_window, "structure"),
                ONE_WINDOW,
            ),
        },
    ),
    *(
        Case(
            f"{size}-{where}-on-{ground}",
            "one pixel",
            functools.partial(lambda p, q, at: (flat(p), speck(p, q, at)), p, q, at),
            _speck_pair(p, q, at),
        )
        for ground, p, size, q in (
            ("white", 255, "one-level", 254),
            ("white", 255, "full-range", 0),
            ("black", 0, "one-level", 1),
            ("black", 0, "full-range", 255),
            ("grey", 128, "one-level", 127),
        )
        for where, at in (("middle", 64), ("corner", 0))
    ),
    Case(
        "true-object-of-one-pixel",
        "one pixel",
        lambda: (speck(255, 0, 64), flat(255)),
        {
            "ssim-object": Near(
                "closed form of the window that is centred on the pixel",
                float(_speck_components(255, 0, gaussian_window(WINDOW)[5:6, 5:6])["ssim"].item()),
                ONE_WINDOW,
            ),
            **undefined(*THIN),
        },
    ),
    Case(
        "true-object-in-the-corner",
        "one pixel",
        lambda: (speck(255, 0, 0), flat(255)),
        undefined("ssim-object", *THIN),
    ),
    *(_small(side) for side in (1, 7, 8, 11)),
    Case(
        "strip-of-1x30",
        "small images",
        lambda: (noise(3, 30)[:, :1], noise(4, 30)[:, :1]),
        _STRIP,
    ),
    Case(
        "strip-of-30x1",
        "small images",
        lambda: (noise(3, 30)[:, :, :1], noise(4, 30)[:, :, :1]),
        _STRIP,
    ),
)


_LEG_IS_GONE = {"thin-recall": Near("nothing of it is drawn", 0.0), **undefined("thin-precision")}
# Within 4 px of 40 x 3 px: 4 px at its sides and ends, 8 px with x^2 + y^2 <= 16 at each corner.
_NEAR_LEG = 120 + 2 * 4 * 40 + 2 * 4 * 3 + 4 * 8

THIN_CASES = (
    Case(
        "leg-not-drawn",
        "thin parts",
        lambda: (leg(), flat(255)),
        _LEG_IS_GONE,
    ),
    Case(
        "leg-half-drawn",
        "thin parts",
        lambda: (leg(), leg(rows=slice(40, 60))),
        {
            "thin-recall": Near("20 of 40 rows", 0.5),
            "thin-precision": Near("nothing beside it", 1.0),
        },
    ),
    Case(
        "leg-one-pixel-off",
        "thin parts",
        lambda: (leg(), leg(columns=slice(61, 64))),
        {metric: Near("2 of 3 columns", 2 / 3, U) for metric in THIN},
    ),
    Case(
        "leg-on-black",
        "thin parts",
        lambda: (leg(), flat(0)),
        {
            "thin-recall": Near("all is painted", 1.0),
            "thin-precision": Near("120 px of all within 4 px", 120 / _NEAR_LEG, U),
        },
    ),
    Case(
        "faintest-leg",
        "thin parts",
        lambda: (leg(254), leg(254)),
        WHOLE_LEG,
    ),
    Case(
        "faintest-leg-not-drawn",
        "thin parts",
        lambda: (leg(254), flat(255)),
        _LEG_IS_GONE,
    ),
    Case(
        "light-leg-half-as-dark",
        "thin parts",
        lambda: (leg(235), leg(245)),
        WHOLE_LEG,
    ),
    Case(
        "light-leg-less-than-half-as-dark",
        "thin parts",
        lambda: (leg(235), leg(246)),
        _LEG_IS_GONE,
    ),
    Case(
        "stub-of-8-px",
        "thin parts",
        lambda: twice(leg(rows=slice(40, 44), columns=slice(60, 62))),
        WHOLE_LEG,
    ),
    Case(
        "stub-of-7-px",
        "thin parts",
        lambda: twice(leg(rows=slice(40, 47), columns=slice(60, 61))),
        undefined(*THIN),
    ),
    Case(
        "leg-along-the-frame",
        "thin parts",
        lambda: twice(leg(columns=slice(0, 3))),
        WHOLE_LEG,
    ),
)


SILHOUETTE = "silhouette-iou"


def _stated(words: str, value: float, within: float = 0.0) -> dict[str, Stated]:
    return {SILHOUETTE: Near(words, value, within)}


def _refused(says: str) -> dict[str, Stated]:
    return {SILHOUETTE: Refused(ValueError, says)}


SILHOUETTE_CASES = (
    Case("same-leg", "silhouettes", lambda: twice(leg()), _stated("the same pixels", 1.0)),
    Case("same-noise", "silhouettes", lambda: twice(noise(3)), _stated("the same pixels", 1.0)),
    Case(
        "nothing-on-nothing",
        "silhouettes",
        lambda: twice(flat(255)),
        _stated("neither shows anything: they agree", 1.0),
    ),
    Case(
        "nothing-of-a-leg",
        "silhouettes",
        lambda: (leg(), flat(255)),
        _stated("nothing of 120 px", 0.0),
    ),
    Case(
        "a-leg-on-nothing",
        "silhouettes",
        lambda: (flat(255), leg()),
        _stated("120 px where nothing is", 0.0),
    ),
    Case(
        "half-a-leg",
        "silhouettes",
        lambda: (leg(), leg(rows=slice(40, 60))),
        _stated("20 of 40 rows", 0.5),
    ),
    Case(
        "shifted-leg",
        "silhouettes",
        lambda: (leg(), leg(columns=slice(61, 64))),
        _stated("2 of 3 columns drawn, 1 beside them: 2 / 4", 0.5),
    ),
    Case(
        "a-leg-painted-over",
        "silhouettes",
        lambda: (leg(), flat(0)),
        _stated("120 px of 128 x 128", 120 / 128**2, U),
    ),
    Case(
        "a-leg-in-another-colour",
        "silhouettes",
        lambda: (leg(0), leg(217)),
        _stated("contrast 38 of the 37.5 asked for: what is in it does not count", 1.0),
    ),
    Case(
        "a-leg-too-faint",
        "silhouettes",
        lambda: (leg(0), leg(218)),
        _stated("contrast 37 of the 37.5 asked for", 0.0),
    ),
    Case(
        "haze-around-a-leg",
        "silhouettes",
        lambda: (leg(), np.minimum(leg(), flat(218))),
        _stated("contrast 37 all over the background is no object", 1.0),
    ),
    Case(
        "a-light-leg-in-haze",
        "silhouettes",
        lambda: (leg(235), np.minimum(leg(235), flat(245))),
        _stated("contrast 10, half of the leg's, all over: 120 px of 128 x 128", 120 / 128**2, U),
    ),
    Case(
        "faintest-haze-on-nothing",
        "silhouettes",
        lambda: (flat(255), flat(218)),
        _stated("contrast 37 of the 37.5 asked for where nothing is", 1.0),
    ),
    Case(
        "silhouettes-of-no-images",
        "silhouettes",
        lambda: twice(flat(0, 0)),
        {SILHOUETTE: Near("of no images none", lambda a, b: np.empty(0))},
    ),
    Case(
        "silhouettes-of-two-images",
        "silhouettes",
        lambda: (np.concatenate([leg(), leg()]), np.concatenate([leg(), flat(255)])),
        {SILHOUETTE: Near("each by itself", lambda a, b: [1.0, 0.0])},
    ),
    Case(
        "silhouettes-in-0-to-1",
        "silhouettes",
        lambda: (flat(255) / 255, leg() / 255),
        _refused("images must be uint8"),
    ),
    Case(
        "silhouettes-without-a-stack",
        "silhouettes",
        lambda: twice(leg()[0]),
        _refused("[128, 128, 3]"),
    ),
    Case(
        "silhouettes-of-another-size",
        "silhouettes",
        lambda: (flat(0, side=64), flat(0)),
        _refused("of truths [1, 64, 64, 3]"),
    ),
)


def _refused_images(says: str, thin_says: str) -> dict[str, Stated]:
    stated: dict[str, Stated] = {
        metric: Refused(ValueError, says) for metric in (*SSIM, "ssim-object")
    }
    return stated | {metric: Refused(ValueError, thin_says) for metric in THIN}


def _refused_by_networks(of_grey: str = "pictures must be uint8 [..., 3]") -> dict[str, Stated]:
    whole: Stated = Refused(ValueError, "pictures must be uint8 [N, 128, 128, 3]")
    return {"fd-views": whole, "fd-views-grey": Refused(ValueError, of_grey), JUDGE: whole}


_NOT_UINT8 = (
    _refused_images("images must be uint8", "images must be uint8") | _refused_by_networks()
)

INPUT_CASES = (
    Case(
        "no-images",
        "number of images",
        lambda: twice(flat(0, 0)),
        {metric: Refused(ValueError, "nothing to compare") for metric in (*SSIM, "ssim-object")}
        | {metric: Near("of no images none", lambda a, b: np.empty(0)) for metric in (*THIN, JUDGE)}
        | {metric: Refused(TooFewSamples, "[0, 64]") for metric in FD_VIEWS},
    ),
    Case(
        "one-image",
        "number of images",
        lambda: (flat(0), flat(255)),
        {
            "ssim": Near("one value", lambda a, b: [luminance_of_flat(0, 255)], SUMS),
            "fd-views": Refused(TooFewSamples, "[1, 64]"),
            "fd-views-grey": Refused(TooFewSamples, "[1, 64]"),
            JUDGE: UNIT_CODES,
        },
    ),
    Case(
        "two-images",
        "number of images",
        lambda: (
            np.concatenate([flat(0), leg()]),
            np.concatenate([flat(255), leg()]),
        ),
        {
            "ssim": Near("each by itself", lambda a, b: [luminance_of_flat(0, 255), 1.0], SUMS),
            "ssim-object": Near(
                "each by itself", lambda a, b: [luminance_of_flat(0, 255), 1.0], SUMS
            ),
            "thin-recall": Near("each by itself", lambda a, b: [math.nan, 1.0]),
            "thin-precision": Near("each by itself", lambda a, b: [math.nan, 1.0]),
            JUDGE: UNIT_CODES,
        },
    ),
    Case(
        "nan-pixels",
        "not pictures",
        lambda: (flat(255) / 255, np.full((1, IMAGE_SIZE, IMAGE_SIZE, 3), np.nan)),
        _NOT_UINT8,
    ),
    Case(
        "floats-in-0-to-1",
        "not pictures",
        lambda: (flat(255).astype(np.float32) / 255, leg().astype(np.float32) / 255),
        _NOT_UINT8,
    ),
    Case(
        "whole-numbers-of-64-bits",
        "not pictures",
        lambda: (flat(255).astype(np.int64), leg().astype(np.int64)),
        _NOT_UINT8,
    ),
    Case(
        "only-one-is-uint8",
        "not pictures",
        lambda: (flat(255), leg() / 255),
        _NOT_UINT8,
    ),
    Case(
        "image-without-a-stack",
        "not pictures",
        lambda: twice(flat(0)[0]),
        _refused_images("[128, 128, 3]", "[128, 128, 3]")
        | _refused_by_networks("pictures must be uint8 [N, 128, 128, 3]"),
    ),
    Case(
        "two-dimensions",
        "not pictures",
        lambda: twice(flat(0)[0, :, :, 0]),
        _refused_images("[128, 128]", "[128, 128]") | _refused_by_networks(),
    ),
    Case(
        "another-size",
        "not pictures",
        lambda: (flat(0, side=64), flat(0)),
        _refused_images("must have the same shape", "of truths [1, 64, 64, 3]")
        | {metric: Refused(ValueError, "[1, 64, 64, 3]") for metric in FD_VIEWS},
    ),
    Case(
        "another-number-of-images",
        "not pictures",
        lambda: (flat(0), flat(0, 2)),
        _refused_images("must have the same shape", "of truths [1, 128, 128, 3]"),
    ),
    Case(
        "four-channels",
        "not pictures",
        lambda: twice(np.zeros((2, 128, 128, 4), np.uint8)),
        _refused_by_networks(),
    ),
    Case(
        "no-channels",
        "not pictures",
        lambda: twice(flat(0)[..., :0]),
        {metric: Refused(ValueError, "nothing to compare") for metric in (*SSIM, "ssim-object")},
    ),
)
