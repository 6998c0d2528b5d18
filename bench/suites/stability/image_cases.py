"""SSIM and its components where they have closed forms, or a single window."""

from __future__ import annotations

import functools
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bench.suites.stability.metric_cases import (
    SSIM,
    THIN,
    WHOLE_LEG,
    Case,
    Near,
    Stated,
    luminance_of_flat,
    ones,
    twice,
    undefined,
)
from bench.suites.stability.metric_pictures import Pictures, flat, leg, noise, speck
from bench.suites.stability.metric_tolerances import C1, C2, C3, ONE_WINDOW, SIGMA, SUMS, WINDOW
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
