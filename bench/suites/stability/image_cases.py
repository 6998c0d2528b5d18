"""Cases on metrics of images: SSIM, thin parts, silhouettes, and arrays that are not images."""

from __future__ import annotations

import functools
import math

import numpy as np

from bench.catalogue.metrics import JUDGE
from bench.metrics.frechet import TooFewSamples
from bench.suites.stability.metric_cases import (
    C1,
    C2,
    C3,
    DECIBELS,
    FD_VIEWS,
    ONE_WINDOW,
    SIGMA,
    SSIM,
    SUMS,
    THIN,
    UNIT_CODES,
    WINDOW,
    Given,
    MetricExpectation,
    Near,
    Refused,
    U,
    cases,
    cases_of,
    decibels,
    flat,
    leg,
    luminance_of_flat,
    near,
    noise,
    refused,
    speck,
    twice,
    undefined,
)
from data_prep.arrays import Floats
from data_prep.scene import IMAGE_SIZE, UInt8Images

Row = tuple[str, Given, dict[str, MetricExpectation]]  # an argument of `cases`

PSNR = "psnr"
SAME_PSNR = near("one level of one channel: the most", decibels(0), PSNR, within=DECIBELS)
WHOLE_LEG = near("all of it, and nothing else, is drawn", 1.0, *THIN)
NOTHING_THIN = undefined(*THIN)
NO_VALUES = Near("of no images none", lambda a, b: np.empty(0))


def gaussian_window(size: int) -> Floats:
    """Return the Gaussian window [size, size], from its definition."""
    offsets = np.arange(size) - (size - 1) / 2
    sigma = SIGMA * size / WINDOW
    weights = np.exp(-(offsets[:, None] ** 2 + offsets**2) / (2 * sigma**2))
    return weights / weights.sum()


def _flat_pair(case_id: str, p: int, q: int, words: str) -> Row:
    """Return two flat images, which have contrast C2 / C2 and structure C3 / C3."""
    luminance = luminance_of_flat(p, q)
    stated = {
        **near(words, luminance, "ssim", "luminance", "ssim-object", within=SUMS),
        "contrast": Near("C2 / C2", 1.0),
        "structure": Near("C3 / C3", 1.0),
        PSNR: Near("20 log10(255 / |p - q|)", 20 * math.log10(255 / abs(p - q)), DECIBELS),
    }
    return case_id, lambda: (flat(p), flat(q)), stated | NOTHING_THIN


def _speck_components(p: int, q: int, weights: Floats) -> dict[str, Floats]:
    """Return components of a flat image of p against windows with one pixel q of these weights.

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


def _weights_of_speck(at: int) -> Floats:
    """Return a speck's weights in its windows: 11 x 11 of them in the middle, one in a corner."""
    weights = gaussian_window(WINDOW)
    return weights[:1, :1] if at == 0 else weights


def _of_speck(ssim: Floats) -> dict[str, MetricExpectation]:
    words = f"mean of the {ssim.size} windows with the pixel"
    return near(words, float(ssim.mean()), "ssim-object", within=ONE_WINDOW)


def _speck_pair(case_id: str, p: int, q: int, at: int) -> Row:
    """Return a pair with `speck` in the second image only; all other windows score 1.

    On a white true image, only the windows with a drawn pixel count as the object's; any other
    ground is an object that fills the frame.
    """
    weights = _weights_of_speck(at)
    n_windows = (IMAGE_SIZE - WINDOW + 1) ** 2
    words = f"closed form over the {weights.size} windows with the pixel"
    components = _speck_components(p, q, weights)
    stated: dict[str, MetricExpectation] = {
        name: Near(words, 1.0 + float((values - 1.0).sum()) / n_windows, SUMS)
        for name, values in components.items()
    }
    stated[PSNR] = Near("three squares (p - q)^2", decibels(3 * (p - q) ** 2), DECIBELS)
    if p < 255:
        stated["ssim-object"] = stated["ssim"]
    elif 255 - q >= 37.5:
        stated |= _of_speck(components["ssim"])
    else:
        stated |= undefined("ssim-object")
    return case_id, lambda: (flat(p), speck(p, q, at)), stated | NOTHING_THIN


def one_window(name: str, a: UInt8Images, b: UInt8Images) -> float:
    """Return a component of images [1, s, s, C] with a single window, by two longdouble passes."""
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
    components = {
        "ssim": luminance * contrast * structure,
        "luminance": luminance,
        "contrast": contrast,
        "structure": structure,
    }
    return float(components[name].mean())


def _of_one_window(name: str) -> Near:
    value = functools.partial(one_window, name)
    return Near("its one window, computed from the definition", value, ONE_WINDOW)


def _small(side: int) -> Row:
    stated: dict[str, MetricExpectation] = {name: _of_one_window(name) for name in SSIM}
    return (
        f"noise-of-{side}x{side}",
        lambda: (noise(side, side), noise(side + 100, side)),
        stated | {"ssim-object": stated["ssim"]} | NOTHING_THIN,
    )


def _strip(a: UInt8Images, b: UInt8Images) -> float:
    """Return the mean luminance of single pixels."""
    p, q = a.astype(np.float64), b.astype(np.float64)
    return float(((2 * p * q + C1) / (p * p + q * q + C1)).mean())


SSIMS = (*SSIM, "ssim-object")
_IDENTICAL = near("identical", 1.0, *SSIMS)
_STRIP: dict[str, MetricExpectation] = {
    "ssim": Near("windows of one pixel: luminance", _strip, SUMS),
    "luminance": Near("mean of (2 p q + C1) / (p^2 + q^2 + C1)", _strip, SUMS),
    **near("windows of one pixel vary in nothing", 1.0, "contrast", "structure"),
}


def _true_speck(case_id: str, at: int) -> Row:
    """Return a pair with `speck` in the true image only, on white."""
    ssim = _speck_components(255, 0, _weights_of_speck(at))["ssim"]
    return case_id, lambda: (speck(255, 0, at), flat(255)), _of_speck(ssim) | NOTHING_THIN


SSIM_CASES = (
    *cases(
        "identical",
        ("identical-noise", lambda: twice(noise(1)), _IDENTICAL | SAME_PSNR | NOTHING_THIN),
        ("identical-leg", lambda: twice(leg()), _IDENTICAL | SAME_PSNR | WHOLE_LEG),
        ("identical-white", lambda: twice(flat(255)),
         near("identical", 1.0, *SSIM) | SAME_PSNR | undefined("ssim-object", *THIN)),
        ("identical-black", lambda: twice(flat(0)), _IDENTICAL | SAME_PSNR | NOTHING_THIN),
    ),
    *cases(
        "flat images",
        _flat_pair("black-against-white", 0, 255, "C1 / (255^2 + C1)"),
        _flat_pair("white-against-black", 255, 0, "C1 / (255^2 + C1)"),
        _flat_pair("black-against-one-level", 0, 1, "C1 / (1 + C1)"),
        _flat_pair("grey-against-one-level-less", 128, 127, "(2 p q + C1) / (p^2 + q^2 + C1)"),
        _flat_pair("light-against-dark", 200, 7, "(2 p q + C1) / (p^2 + q^2 + C1)"),
        ("white-against-haze", lambda: (flat(255), flat(218)),
         near("(2 p q + C1) / (p^2 + q^2 + C1)", luminance_of_flat(255, 218), "ssim", within=SUMS)
         | undefined("ssim-object")),
        ("noise-against-its-negative", lambda: (noise(2, WINDOW), 255 - noise(2, WINDOW)),
         {"contrast": Near("equal variances", 1.0, ONE_WINDOW),
          "structure": _of_one_window("structure")}),
    ),
    *cases(
        "one pixel",
        *(
            _speck_pair(f"{size}-{where}-on-{ground}", p, q, at)
            for ground, p, size, q in (
                ("white", 255, "one-level", 254),
                ("white", 255, "full-range", 0),
                ("black", 0, "one-level", 1),
                ("black", 0, "full-range", 255),
                ("grey", 128, "one-level", 127),
            )
            for where, at in (("middle", 64), ("corner", 0))
        ),
        _true_speck("true-object-of-one-pixel", 64),
        _true_speck("true-object-in-the-corner", 0),
    ),
    *cases(
        "small images",
        *(_small(side) for side in (1, 7, 8, 11)),
        ("strip-of-1x30", lambda: (noise(3, 30)[:, :1], noise(4, 30)[:, :1]), _STRIP),
        ("strip-of-30x1", lambda: (noise(3, 30)[:, :, :1], noise(4, 30)[:, :, :1]), _STRIP),
    ),
)  # fmt: skip


_LEG_IS_GONE = near("nothing of it is drawn", 0.0, "thin-recall") | undefined("thin-precision")
_HALF_A_LEG = leg(rows=slice(40, 60))
_LEG_MOVED = leg(columns=slice(61, 64))
# Within 4 px of 40 x 3 px: 4 px at its sides and ends, 8 px with x^2 + y^2 <= 16 at each corner.
_NEAR_LEG = 120 + 2 * 4 * 40 + 2 * 4 * 3 + 4 * 8

THIN_CASES = cases(
    "thin parts",
    ("leg-not-drawn", lambda: (leg(), flat(255)), _LEG_IS_GONE),
    ("leg-half-drawn", lambda: (leg(), _HALF_A_LEG),
     near("20 of 40 rows", 0.5, "thin-recall") | near("nothing beside it", 1.0, "thin-precision")),
    ("leg-one-pixel-off", lambda: (leg(), _LEG_MOVED),
     near("2 of 3 columns", 2 / 3, *THIN, within=U)),
    ("leg-on-black", lambda: (leg(), flat(0)),
     near("all is painted", 1.0, "thin-recall")
     | near("120 px of all within 4 px", 120 / _NEAR_LEG, "thin-precision", within=U)),
    ("faintest-leg", lambda: (leg(254), leg(254)), WHOLE_LEG),
    ("faintest-leg-not-drawn", lambda: (leg(254), flat(255)), _LEG_IS_GONE),
    ("light-leg-half-as-dark", lambda: (leg(235), leg(245)), WHOLE_LEG),
    ("light-leg-less-than-half-as-dark", lambda: (leg(235), leg(246)), _LEG_IS_GONE),
    ("stub-of-8-px", lambda: twice(leg(80, slice(40, 44), slice(60, 62))), WHOLE_LEG),
    ("stub-of-7-px", lambda: twice(leg(80, slice(40, 47), slice(60, 61))), NOTHING_THIN),
    ("leg-along-the-frame", lambda: twice(leg(columns=slice(0, 3))), WHOLE_LEG),
)  # fmt: skip


SILHOUETTE = "silhouette-iou"
_SAME_PIXELS = Near("the same pixels", 1.0)
_OF_ALL = 120 / 128**2  # of a leg

SILHOUETTE_CASES = cases_of(
    SILHOUETTE,
    "silhouettes",
    ("same-leg", lambda: twice(leg()), _SAME_PIXELS),
    ("same-noise", lambda: twice(noise(3)), _SAME_PIXELS),
    ("nothing-on-nothing", lambda: twice(flat(255)),
     Near("neither shows anything: they agree", 1.0)),
    ("nothing-of-a-leg", lambda: (leg(), flat(255)), Near("nothing of 120 px", 0.0)),
    ("a-leg-on-nothing", lambda: (flat(255), leg()), Near("120 px where nothing is", 0.0)),
    ("half-a-leg", lambda: (leg(), _HALF_A_LEG), Near("20 of 40 rows", 0.5)),
    ("shifted-leg", lambda: (leg(), _LEG_MOVED),
     Near("2 of 3 columns drawn, 1 beside them: 2 / 4", 0.5)),
    ("a-leg-painted-over", lambda: (leg(), flat(0)), Near("120 px of 128 x 128", _OF_ALL, U)),
    ("a-leg-in-another-colour", lambda: (leg(0), leg(217)),
     Near("contrast 38 of the 37.5 asked for: what is in it does not count", 1.0)),
    ("a-leg-too-faint", lambda: (leg(0), leg(218)), Near("contrast 37 of the 37.5 asked for", 0.0)),
    ("haze-around-a-leg", lambda: (leg(), np.minimum(leg(), flat(218))),
     Near("contrast 37 all over the background is no object", 1.0)),
    ("a-light-leg-in-haze", lambda: (leg(235), np.minimum(leg(235), flat(245))),
     Near("contrast 10, half of the leg's, all over: 120 px of 128 x 128", _OF_ALL, U)),
    ("faintest-haze-on-nothing", lambda: (flat(255), flat(218)),
     Near("contrast 37 of the 37.5 asked for where nothing is", 1.0)),
    ("silhouettes-of-no-images", lambda: twice(flat(0, 0)), NO_VALUES),
    ("silhouettes-of-two-images",
     lambda: (np.concatenate([leg(), leg()]), np.concatenate([leg(), flat(255)])),
     Near("each by itself", lambda a, b: [1.0, 0.0])),
    ("silhouettes-in-0-to-1", lambda: (flat(255) / 255, leg() / 255),
     Refused(ValueError, "images must be uint8")),
    ("silhouettes-without-a-stack", lambda: twice(leg()[0]), Refused(ValueError, "[128, 128, 3]")),
    ("silhouettes-of-another-size", lambda: (flat(0, side=64), flat(0)),
     Refused(ValueError, "of truths [1, 64, 64, 3]")),
)  # fmt: skip


_WHOLE = "pictures must be uint8 [N, 128, 128, 3]"


def _refused_by_networks(
    of_grey: str = "pictures must be uint8 [..., 3]",
) -> dict[str, MetricExpectation]:
    whole = refused(_WHOLE, "fd-views", "fd-views-grey", JUDGE)
    return whole | refused(of_grey, "fd-views-grey")


_NOT_UINT8 = refused("images must be uint8", *SSIMS, PSNR, *THIN) | _refused_by_networks()
_BLACK_ON_WHITE = luminance_of_flat(0, 255)

INPUT_CASES = (
    *cases(
        "number of images",
        ("no-images", lambda: twice(flat(0, 0)),
         refused("nothing to compare", *SSIMS, PSNR)
         | dict.fromkeys((*THIN, JUDGE), NO_VALUES)
         | refused("[0, 64]", *FD_VIEWS, error=TooFewSamples)),
        ("one-image", lambda: (flat(0), flat(255)),
         near("one value", lambda a, b: [_BLACK_ON_WHITE], "ssim", within=SUMS)
         | near("20 log10(255 / 255)", lambda a, b: [0.0], PSNR, within=DECIBELS)
         | refused("[1, 64]", *FD_VIEWS, error=TooFewSamples)
         | {JUDGE: UNIT_CODES}),
        ("two-images",
         lambda: (np.concatenate([flat(0), leg()]), np.concatenate([flat(255), leg()])),
         near("each by itself", lambda a, b: [_BLACK_ON_WHITE, 1.0], "ssim", "ssim-object",
              within=SUMS)
         | near("each by itself", lambda a, b: [0.0, decibels(0)], PSNR, within=DECIBELS)
         | near("each by itself", lambda a, b: [math.nan, 1.0], *THIN)
         | {JUDGE: UNIT_CODES}),
    ),
    *cases(
        "not pictures",
        ("nan-pixels", lambda: (flat(255) / 255, np.full((1, IMAGE_SIZE, IMAGE_SIZE, 3), np.nan)),
         _NOT_UINT8),
        ("floats-in-0-to-1",
         lambda: (flat(255).astype(np.float32) / 255, leg().astype(np.float32) / 255), _NOT_UINT8),
        ("whole-numbers-of-64-bits", lambda: (flat(255).astype(np.int64), leg().astype(np.int64)),
         _NOT_UINT8),
        ("only-one-is-uint8", lambda: (flat(255), leg() / 255), _NOT_UINT8),
        ("image-without-a-stack", lambda: twice(flat(0)[0]),
         refused("[128, 128, 3]", *SSIMS, PSNR, *THIN) | _refused_by_networks(_WHOLE)),
        ("two-dimensions", lambda: twice(flat(0)[0, :, :, 0]),
         refused("[128, 128]", *SSIMS, PSNR, *THIN) | _refused_by_networks()),
        ("another-size", lambda: (flat(0, side=64), flat(0)),
         refused("the same shape", *SSIM, PSNR)
         | refused("of truths [1, 64, 64, 3]", "ssim-object", *THIN)
         | refused("[1, 64, 64, 3]", *FD_VIEWS)),
        ("another-number-of-images", lambda: (flat(0), flat(0, 2)),
         refused("the same shape", *SSIM, PSNR)
         | refused("of truths [1, 128, 128, 3]", "ssim-object", *THIN)),
        ("four-channels", lambda: twice(np.zeros((2, 128, 128, 4), np.uint8)),
         _refused_by_networks()),
        ("no-channels", lambda: twice(flat(0)[..., :0]),
         refused("nothing to compare", *SSIMS, PSNR, *THIN)),
    ),
)  # fmt: skip
