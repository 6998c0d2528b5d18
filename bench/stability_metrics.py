"""Metrics at the edges of their domain: cases x metrics, and the value or refusal of each.

A metric is a function of two arrays: true pictures and pictures, two sets of features, the judge's
answers and the angles asked for. What a case states is a closed form, an independent computation,
an invariant or a named refusal; what nobody states is not asked.

Tolerances, with u = 2^-53:

* `SUMS`. The mean over the 118 x 118 windows of three channels is taken tile by tile: sums of at
  most 576 x 3 values of at most 1, and of 25 tiles. Off by 1,753 u at most: 2e-13.
* `ONE_WINDOW`. A moment of one window of noise is a sum of 11 sums of 11 products of at most 255^2,
  off by 22 u of that. Four moments, over the least of the divisors, C3: 2e-11.
* `ROUNDING`. A singular value errs by a few u of the largest one, the sum of d of them by d u of
  the traces: 5e-13 of the traces for d = 2,048. The distance is the difference of traces.
* Features that are off by at most e move the root of the distance by at most
  D = e sqrt(d n / (n - 1)) a set: it is a metric, and pairing each row with itself is one way to
  carry one Gaussian to the other (Gelbrich 1990). The distance itself moves by 2 D times its root
  and D^2.
"""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.control import azimuth_error_deg, elevation_error_deg
from bench.foreground import object_boxes
from bench.frechet import TooFewSamples, frechet_distance
from bench.metric_table import JUDGE, UNDEFINED, Extractor, find_extractor
from bench.outcomes import Kind, Outcome
from bench.ssim import ssim_per_image, ssim_per_image_and_box
from bench.thin_parts import thin_scores
from data_prep.scene import IMAGE_SIZE

Array = NDArray[Any]
Floats = NDArray[np.float64]
Pictures = NDArray[np.uint8]
Pair = tuple[Array, Array]
Number = float | Callable[[Any, Any], Any]  # or how to have it from the two arrays

# By the protocol of the head of `bench.ssim`, and not its own constants: they are under test.
WINDOW, SIGMA = 11, 1.5
C1, C2, C3 = 2.55**2, 7.65**2, 7.65**2 / 2
U = 2.0**-53
SUMS = (576 * 3 + 25) * U
ONE_WINDOW = 4 * 22 * U * 255**2 / C3
ROUNDING = 1e-12
FLOAT32_FEATURES = 1e-4  # sums of up to 864 float32 products a layer, of features up to some 10
CODE_LENGTH = 18 * 2.0**-24  # float32: half of the 32 roundings of a sum of squares, root, quotient
ANGLE_DEG = math.degrees(2.0**-23)  # sine and cosine in float32
FRECHET = "frechet-distance"
DISTANCES = (FRECHET, "fd-views", "fd-views-grey")


@dataclass(frozen=True)
class Near:
    """A stated value: a number, an array, or how to compute it; NaN stands for no value.

    words   where it comes from
    within  largest absolute difference; 0 is exact
    """

    words: str
    value: Number
    within: Number = 0.0


@dataclass(frozen=True)
class Refused:
    """A stated failure: the very type, and a part of the message."""

    error: type[Exception]
    says: str


Stated = Near | Refused


@dataclass(frozen=True)
class Case:
    """Two arrays, and what each metric makes of them."""

    id: str
    group: str
    given: Callable[[], Pair]
    stated: Mapping[str, Stated]


def metric_outcomes() -> list[Outcome]:
    """All cases on the metrics that they state something about. Never raises; some seconds."""
    with _one_thread():
        return [
            _outcome(case, metric, stated)
            for case in CASES
            for metric, stated in case.stated.items()
        ]


def _outcome(case: Case, metric: str, stated: Stated) -> Outcome:
    expected = "?"
    try:
        with warnings.catch_warnings():
            # Arithmetic that NumPy warns of is an outcome of its own: nobody stated it.
            warnings.simplefilter("error", RuntimeWarning)
            given = case.given()
            if isinstance(stated, Refused):
                expected = f"{stated.error.__name__}: ...{stated.says}..."
                observed, kind = _refusal(metric, given, stated)
            else:
                value = np.asarray(_number(stated.value, given), np.float64)
                within = float(_number(stated.within, given))
                expected = f"{_shown(value)} {f'+-{within:.1g}' if within else 'exactly'}: "
                expected += stated.words
                observed, kind = _value(metric, given, value, within)
    except Exception as error:
        observed, kind = f"{type(error).__name__}: {error}", "unexpected"
    return Outcome(case.id, case.group, metric, expected, observed, kind)


def _refusal(metric: str, given: Pair, stated: Refused) -> tuple[str, Kind]:
    try:
        found = METRICS[metric](*given)
    except Exception as error:
        as_stated = type(error) is stated.error and stated.says in str(error)
        return f"{type(error).__name__}: {error}", "refused" if as_stated else "unexpected"
    return _shown(np.asarray(found)), "unexpected"


def _value(metric: str, given: Pair, value: Floats, within: float) -> tuple[str, Kind]:
    found = METRICS[metric](*given)
    if metric in DISTANCES and not (isinstance(found, float) and 0.0 <= found < math.inf):
        return f"{found!r}, which is no distance", "unexpected"
    found = np.asarray(found)
    if found.shape != value.shape and (value.ndim or not found.size):
        return f"{_shown(found)} of shape {list(found.shape)}", "unexpected"
    if not np.array_equal(np.isnan(found), np.isnan(np.broadcast_to(value, found.shape))):
        return _shown(found), "unexpected"
    off = float(np.nanmax(np.abs(found - value), initial=0.0))
    text = _shown(found) + (f", off by {off:.1g}" if off else "")
    return text, "holds" if off <= within else "unexpected"


def _number(number: Number, given: Pair) -> Any:
    return number(*given) if callable(number) else number


def _shown(values: Array) -> str:
    texts = ["no value" if np.isnan(value) else f"{value:.15g}" for value in values.ravel()]
    if not texts:
        return "no values"
    if len(set(texts)) == 1:
        return texts[0]
    return ", ".join(texts) if len(texts) < 4 else f"{texts[0]} ... {texts[-1]} ({len(texts)})"


@contextmanager
def _one_thread() -> Iterator[None]:
    import torch
    from threadpoolctl import threadpool_limits

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        torch.set_num_threads(before)


# --- the metrics ----------------------------------------------------------------------------------


@functools.cache
def _extractor(name: str) -> Extractor:
    source = find_extractor(name)
    return source.load(str(source.weights(None)))


def _ssim_object(truth: Pictures, pictures: Pictures) -> Floats:
    return ssim_per_image_and_box(truth, pictures, object_boxes(truth))[1]


def _between(name: str, truth: Pictures, pictures: Pictures) -> float:
    features = _extractor(name)
    return frechet_distance(features(truth), features(pictures))


def _code_lengths(truth: Pictures, pictures: Pictures) -> Floats:
    """Length of the judge's shape code of each picture; NaN where an answer is not finite."""
    del truth
    answers = _extractor(JUDGE)(pictures).astype(np.float64)
    return np.linalg.norm(answers[:, 3:], axis=1) + 0.0 * answers[:, :3].sum(axis=1)


METRICS: Mapping[str, Callable[[Any, Any], Any]] = {
    "ssim": lambda a, b: ssim_per_image(a, b).ssim,
    "luminance": lambda a, b: ssim_per_image(a, b).luminance,
    "contrast": lambda a, b: ssim_per_image(a, b).contrast,
    "structure": lambda a, b: ssim_per_image(a, b).structure,
    "ssim-object": _ssim_object,
    "thin-recall": lambda a, b: thin_scores(a, b).recall,
    "thin-precision": lambda a, b: thin_scores(a, b).precision,
    FRECHET: frechet_distance,
    "fd-views": functools.partial(_between, "fd-views"),
    "fd-views-grey": functools.partial(_between, "fd-views-grey"),
    JUDGE: _code_lengths,
    "azimuth-error-deg": azimuth_error_deg,
    "elevation-error-deg": elevation_error_deg,
}
SSIM = ("ssim", "luminance", "contrast", "structure")
THIN = ("thin-recall", "thin-precision")
IMAGES = (*SSIM, "ssim-object", *THIN)


# --- pictures -------------------------------------------------------------------------------------


def _flat(level: int, count: int = 1, side: int = IMAGE_SIZE) -> Pictures:
    return np.full((count, side, side, 3), level, np.uint8)


def _twice(values: Array) -> Pair:
    return values, values.copy()


def _noise(seed: int, side: int = IMAGE_SIZE, count: int = 1) -> Pictures:
    rng = np.random.default_rng(seed)
    return rng.integers(0, 256, (count, side, side, 3), dtype=np.uint8)


def _painted(image: Pictures, rows: slice, columns: slice, level: int) -> Pictures:
    image = image.copy()
    image[:, rows, columns] = level
    return image


def _speck(background: int, level: int, at: int) -> Pictures:
    """One pixel of another level: (64, 64) is in 121 windows, the corner (0, 0) in one."""
    return _painted(_flat(background), slice(at, at + 1), slice(at, at + 1), level)


def _leg(level: int = 80, rows: slice = slice(40, 80), columns: slice = slice(60, 63)) -> Pictures:
    """A bar of 40 x 3 px on white, all of it thin."""
    return _painted(_flat(255), rows, columns, level)


def _boxes(count: int = 6) -> Pictures:
    """Coloured boxes of different sizes on white: something for the networks to look at."""
    rng = np.random.default_rng(0)
    images = _flat(255, count)
    for image in images:
        top, left, height, width = rng.integers(10, 60, 4)
        image[top : top + height, left : left + width] = rng.integers(0, 255, 3)
    return images


def _grey(images: Pictures) -> Pictures:
    """Luma (Rec. 601), rounded half up, in three channels."""
    luma = np.floor((images @ np.array([299.0, 587.0, 114.0]) + 500) / 1000)
    return np.repeat(luma.astype(np.uint8)[..., None], 3, axis=-1)


def _weights(size: int) -> Floats:
    """The Gaussian window [size, size], from its definition."""
    offsets = np.arange(size) - (size - 1) / 2
    sigma = SIGMA * size / WINDOW
    weights = np.exp(-(offsets[:, None] ** 2 + offsets**2) / (2 * sigma**2))
    return weights / weights.sum()


# --- what image metrics have to be ----------------------------------------------------------------


def _of_flat(p: int, q: int) -> float:
    """Luminance of two flat images."""
    return (2 * p * q + C1) / (p * p + q * q + C1)


def _ones(words: str, *metrics: str) -> dict[str, Stated]:
    return {metric: Near(words, 1.0) for metric in metrics}


def _none(*metrics: str) -> dict[str, Stated]:
    return {metric: Near(UNDEFINED[metric], math.nan) for metric in metrics}


def _flat_pair(p: int, q: int, words: str, in_box: bool = True) -> dict[str, Stated]:
    """Two flat images: nothing varies, hence contrast C2 / C2 and structure C3 / C3."""
    of_box = {"ssim-object": Near(words, _of_flat(p, q), SUMS)} if in_box else _none("ssim-object")
    return {
        "ssim": Near(words, _of_flat(p, q), SUMS),
        "luminance": Near(words, _of_flat(p, q), SUMS),
        "contrast": Near("C2 / C2", 1.0),
        "structure": Near("C3 / C3", 1.0),
        **of_box,
        **_none(*THIN),
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
    """`_speck`, in the second image only: all other windows score 1."""
    weights = _weights(WINDOW)
    weights = weights[:1, :1] if at == 0 else weights
    n_windows = (IMAGE_SIZE - WINDOW + 1) ** 2
    words = f"closed form over the {weights.size} windows with the pixel"
    stated: dict[str, Stated] = {
        name: Near(words, 1.0 + float((values - 1.0).sum()) / n_windows, SUMS)
        for name, values in _speck_components(p, q, weights).items()
    }
    return stated | _none(*THIN)


def _one_window(name: str, a: Pictures, b: Pictures) -> float:
    """A component of images [1, s, s, C] with a single window: two passes in longdouble."""
    size = a.shape[1]
    weights = _weights(size).astype(np.longdouble)[..., None]
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
        lambda: (_noise(side, side), _noise(side + 100, side)),
        stated | {"ssim-object": stated["ssim"]} | _none(*THIN),
    )


def _strip(a: Pictures, b: Pictures) -> float:
    """Mean luminance of single pixels."""
    p, q = a.astype(np.float64), b.astype(np.float64)
    return float(((2 * p * q + C1) / (p * p + q * q + C1)).mean())


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
_LEG_IS_GONE = {"thin-recall": Near("nothing of it is drawn", 0.0), **_none("thin-precision")}
_WHOLE_LEG = _ones("all of it, and nothing else, is drawn", *THIN)
# Within 4 px of 40 x 3 px: 4 px at its sides and ends, 8 px with x^2 + y^2 <= 16 at each corner.
_NEAR_LEG = 120 + 2 * 4 * 40 + 2 * 4 * 3 + 4 * 8
_STRIP: Mapping[str, Stated] = {
    "ssim": Near("windows of one pixel: luminance", _strip, SUMS),
    "luminance": Near("mean of (2 p q + C1) / (p^2 + q^2 + C1)", _strip, SUMS),
    **_ones("windows of one pixel vary in nothing", "contrast", "structure"),
}
_CODES = Near("a code of length 1, and finite angles", 1.0, CODE_LENGTH)

IMAGE_CASES = (
    Case(
        "identical-noise",
        "identical",
        lambda: _twice(_noise(1)),
        _ones("identical", *SSIM, "ssim-object") | _none(*THIN),
    ),
    Case(
        "identical-leg",
        "identical",
        lambda: _twice(_leg()),
        _ones("identical", *SSIM, "ssim-object") | _WHOLE_LEG,
    ),
    Case(
        "identical-white",
        "identical",
        lambda: _twice(_flat(255)),
        _ones("identical", *SSIM) | _none("ssim-object", *THIN),
    ),
    Case(
        "identical-black",
        "identical",
        lambda: _twice(_flat(0)),
        _ones("identical", *SSIM, "ssim-object") | _none(*THIN),
    ),
    Case(
        "black-against-white",
        "flat images",
        lambda: (_flat(0), _flat(255)),
        _flat_pair(0, 255, "C1 / (255^2 + C1)"),
    ),
    Case(
        "white-against-black",
        "flat images",
        lambda: (_flat(255), _flat(0)),
        _flat_pair(255, 0, "C1 / (255^2 + C1)", in_box=False),
    ),
    Case(
        "black-against-one-level",
        "flat images",
        lambda: (_flat(0), _flat(1)),
        _flat_pair(0, 1, "C1 / (1 + C1)"),
    ),
    Case(
        "grey-against-one-level-less",
        "flat images",
        lambda: (_flat(128), _flat(127)),
        _flat_pair(128, 127, "(2 p q + C1) / (p^2 + q^2 + C1)"),
    ),
    Case(
        "light-against-dark",
        "flat images",
        lambda: (_flat(200), _flat(7)),
        _flat_pair(200, 7, "(2 p q + C1) / (p^2 + q^2 + C1)"),
    ),
    Case(
        "noise-against-its-negative",
        "flat images",
        lambda: (_noise(2, WINDOW), 255 - _noise(2, WINDOW)),
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
            functools.partial(lambda p, q, at: (_flat(p), _speck(p, q, at)), p, q, at),
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
        lambda: (_speck(255, 0, 64), _flat(255)),
        {
            "ssim-object": Near(
                "closed form of the window that is centred on the pixel",
                float(_speck_components(255, 0, _weights(WINDOW)[5:6, 5:6])["ssim"].item()),
                ONE_WINDOW,
            ),
            **_none(*THIN),
        },
    ),
    Case(
        "true-object-in-the-corner",
        "one pixel",
        lambda: (_speck(255, 0, 0), _flat(255)),
        _none("ssim-object", *THIN),
    ),
    *(_small(side) for side in (1, 7, 8, 11)),
    Case(
        "strip-of-1x30",
        "small images",
        lambda: (_noise(3, 30)[:, :1], _noise(4, 30)[:, :1]),
        _STRIP,
    ),
    Case(
        "strip-of-30x1",
        "small images",
        lambda: (_noise(3, 30)[:, :, :1], _noise(4, 30)[:, :, :1]),
        _STRIP,
    ),
    Case(
        "leg-not-drawn",
        "thin parts",
        lambda: (_leg(), _flat(255)),
        _LEG_IS_GONE,
    ),
    Case(
        "leg-half-drawn",
        "thin parts",
        lambda: (_leg(), _leg(rows=slice(40, 60))),
        {
            "thin-recall": Near("20 of 40 rows", 0.5),
            "thin-precision": Near("nothing beside it", 1.0),
        },
    ),
    Case(
        "leg-one-pixel-off",
        "thin parts",
        lambda: (_leg(), _leg(columns=slice(61, 64))),
        {metric: Near("2 of 3 columns", 2 / 3, U) for metric in THIN},
    ),
    Case(
        "leg-on-black",
        "thin parts",
        lambda: (_leg(), _flat(0)),
        {
            "thin-recall": Near("all is painted", 1.0),
            "thin-precision": Near("120 px of all within 4 px", 120 / _NEAR_LEG, U),
        },
    ),
    Case(
        "faintest-leg",
        "thin parts",
        lambda: (_leg(254), _leg(254)),
        _WHOLE_LEG,
    ),
    Case(
        "faintest-leg-not-drawn",
        "thin parts",
        lambda: (_leg(254), _flat(255)),
        _LEG_IS_GONE,
    ),
    Case(
        "light-leg-half-as-dark",
        "thin parts",
        lambda: (_leg(235), _leg(245)),
        _WHOLE_LEG,
    ),
    Case(
        "light-leg-less-than-half-as-dark",
        "thin parts",
        lambda: (_leg(235), _leg(246)),
        _LEG_IS_GONE,
    ),
    Case(
        "stub-of-8-px",
        "thin parts",
        lambda: _twice(_leg(rows=slice(40, 44), columns=slice(60, 62))),
        _WHOLE_LEG,
    ),
    Case(
        "stub-of-7-px",
        "thin parts",
        lambda: _twice(_leg(rows=slice(40, 47), columns=slice(60, 61))),
        _none(*THIN),
    ),
    Case(
        "leg-along-the-frame",
        "thin parts",
        lambda: _twice(_leg(columns=slice(0, 3))),
        _WHOLE_LEG,
    ),
    Case(
        "no-images",
        "number of images",
        lambda: _twice(_flat(0, 0)),
        {metric: Refused(ValueError, "nothing to compare") for metric in (*SSIM, "ssim-object")}
        | {metric: Near("of no images none", lambda a, b: np.empty(0)) for metric in (*THIN, JUDGE)}
        | {metric: Refused(TooFewSamples, "[0, 64]") for metric in ("fd-views", "fd-views-grey")},
    ),
    Case(
        "one-image",
        "number of images",
        lambda: (_flat(0), _flat(255)),
        {
            "ssim": Near("one value", lambda a, b: [_of_flat(0, 255)], SUMS),
            "fd-views": Refused(TooFewSamples, "[1, 64]"),
            "fd-views-grey": Refused(TooFewSamples, "[1, 64]"),
            JUDGE: _CODES,
        },
    ),
    Case(
        "two-images",
        "number of images",
        lambda: (
            np.concatenate([_flat(0), _leg()]),
            np.concatenate([_flat(255), _leg()]),
        ),
        {
            "ssim": Near("each by itself", lambda a, b: [_of_flat(0, 255), 1.0], SUMS),
            "ssim-object": Near("each by itself", lambda a, b: [_of_flat(0, 255), 1.0], SUMS),
            "thin-recall": Near("each by itself", lambda a, b: [math.nan, 1.0]),
            "thin-precision": Near("each by itself", lambda a, b: [math.nan, 1.0]),
            JUDGE: _CODES,
        },
    ),
    Case(
        "nan-pixels",
        "not pictures",
        lambda: (_flat(255) / 255, np.full((1, IMAGE_SIZE, IMAGE_SIZE, 3), np.nan)),
        _NOT_UINT8,
    ),
    Case(
        "floats-in-0-to-1",
        "not pictures",
        lambda: (_flat(255).astype(np.float32) / 255, _leg().astype(np.float32) / 255),
        _NOT_UINT8,
    ),
    Case(
        "whole-numbers-of-64-bits",
        "not pictures",
        lambda: (_flat(255).astype(np.int64), _leg().astype(np.int64)),
        _NOT_UINT8,
    ),
    Case(
        "only-one-is-uint8",
        "not pictures",
        lambda: (_flat(255), _leg() / 255),
        _NOT_UINT8,
    ),
    Case(
        "image-without-a-stack",
        "not pictures",
        lambda: _twice(_flat(0)[0]),
        _refused_images("[128, 128, 3]", "[128, 128, 3]")
        | _refused_by_networks("pictures must be uint8 [N, 128, 128, 3]"),
    ),
    Case(
        "two-dimensions",
        "not pictures",
        lambda: _twice(_flat(0)[0, :, :, 0]),
        _refused_images("[128, 128]", "[128, 128]") | _refused_by_networks(),
    ),
    Case(
        "another-size",
        "not pictures",
        lambda: (_flat(0, side=64), _flat(0)),
        _refused_images("must have the same shape", "of truths [1, 64, 64, 3]")
        | {
            metric: Refused(ValueError, "[1, 64, 64, 3]")
            for metric in ("fd-views", "fd-views-grey")
        },
    ),
    Case(
        "another-number-of-images",
        "not pictures",
        lambda: (_flat(0), _flat(0, 2)),
        _refused_images("must have the same shape", "of truths [1, 128, 128, 3]"),
    ),
    Case(
        "four-channels",
        "not pictures",
        lambda: _twice(np.zeros((2, 128, 128, 4), np.uint8)),
        _refused_by_networks(),
    ),
    Case(
        "no-channels",
        "not pictures",
        lambda: _twice(_flat(0)[..., :0]),
        {metric: Refused(ValueError, "nothing to compare") for metric in (*SSIM, "ssim-object")},
    ),
)


# --- features of the networks ---------------------------------------------------------------------


def _moved(root: Any, features: int, rows: int, by: float) -> float:
    """How far a distance may move where both sets of features are off by `by`; see the head."""
    move = 2 * by * math.sqrt(features * rows / (rows - 1))
    return float(2 * root * move + move**2)


def _of_constants(name: str, a: Pictures, b: Pictures) -> float:
    """Squared distance of the features of two pictures."""
    features = _extractor(name)
    return float(((features(a[:1])[0].astype(float) - features(b[:1])[0].astype(float)) ** 2).sum())


def _rounding_of(name: str, a: Pictures, b: Pictures) -> float:
    features = _extractor(name)
    return _rounding(features(a), features(b))


def _rounding(x: Array, y: Array) -> float:
    """ROUNDING of the traces and of the squared shift of two sets of features."""
    x, y = x.astype(np.float64), y.astype(np.float64)
    shift = x.mean(axis=0) - y.mean(axis=0)
    return ROUNDING * float(_trace(x) + _trace(y) + shift @ shift)


def _trace(x: Floats) -> Any:
    """Of the covariance; two passes."""
    return ((x - x.mean(axis=0)) ** 2).sum() / (len(x) - 1)


def _on_networks(stated: Callable[[str], Near]) -> dict[str, Stated]:
    return {name: stated(name) for name in ("fd-views", "fd-views-grey")}


_SAME = "0, not less, of 6 pictures and 64 features"

NETWORK_CASES = (
    Case(
        "identical-pictures",
        "features of pictures",
        lambda: _twice(_boxes()),
        _on_networks(lambda name: Near(_SAME, 0.0, functools.partial(_rounding_of, name)))
        | {JUDGE: _CODES},
    ),
    Case(
        "pictures-in-reverse",
        "features of pictures",
        lambda: (_boxes(), _boxes()[::-1]),
        _on_networks(lambda name: Near(_SAME, 0.0, _moved(0.0, 64, 6, FLOAT32_FEATURES)))
        | {JUDGE: _CODES},
    ),
    Case(
        "white-pictures",
        "features of pictures",
        lambda: _twice(_flat(255, 3)),
        _on_networks(lambda name: Near(_SAME, 0.0, _moved(0.0, 64, 3, FLOAT32_FEATURES)))
        | {JUDGE: _CODES},
    ),
    Case(
        "white-pictures-against-black",
        "features of pictures",
        lambda: (_flat(255, 3), _flat(0, 3)),
        _on_networks(
            lambda name: Near(
                "nothing varies: the squared distance of two feature vectors",
                functools.partial(_of_constants, name),
                lambda a, b: _moved(math.sqrt(_of_constants(name, a, b)), 64, 3, FLOAT32_FEATURES),
            )
        )
        | {JUDGE: _CODES},
    ),
    Case(
        "colour-against-its-grey",
        "features of pictures",
        lambda: (_boxes(), _grey(_boxes())),
        {
            "fd-views-grey": Near(
                "0: colour does not count", 0.0, functools.partial(_rounding_of, "fd-views-grey")
            )
        },
    ),
    Case(
        "noise-and-one-pixel",
        "features of pictures",
        lambda: (_flat(255, 2), np.concatenate([_noise(5), _speck(255, 0, 0)])),
        {JUDGE: _CODES},
    ),
)


# --- features -------------------------------------------------------------------------------------


def _normal(seed: int, n: int, d: int) -> Floats:
    return np.random.default_rng(seed).standard_normal((n, d))


def _pair(scale: float = 1.0, shift: float = 0.0) -> tuple[Floats, Floats]:
    """Two ordinary sets of 40 rows and 8 features, multiplied and moved."""
    return _normal(1, 40, 8) * scale + shift, (1.4 * _normal(2, 40, 8) + 0.2) * scale + shift


def _whole(shift: float = 0.0) -> tuple[Floats, Floats]:
    """Whole numbers, 32 rows: sums and means of them are exact, also far from 0."""
    rng = np.random.default_rng(3)
    x, y = rng.integers(-50, 50, (2, 32, 8)).astype(np.float64)
    return x + shift, y + shift


def _diagonal(deviations: Array, mean: float) -> Floats:
    """Rows +-a e_j [2 d, d] about `mean`, with the covariance diag(deviations^2) exactly."""
    d = len(deviations)
    rows = np.diag(deviations * math.sqrt((2 * d - 1) / 2))
    return np.concatenate([rows, -rows]) + mean


def _rotation(d: int) -> Floats:
    return np.linalg.qr(_normal(9, d, d))[0]


def _on_a_line(x: Array, y: Array) -> float:
    """(m1 - m2)^2 + (s1 - s2)^2 of one feature; in longdouble, where every square has room."""
    x, y = x.astype(np.longdouble), y.astype(np.longdouble)
    deviations = [np.sqrt(((z - z.mean()) ** 2).sum() / (len(z) - 1)) for z in (x, y)]
    return float((x.mean() - y.mean()) ** 2 + (deviations[0] - deviations[1]) ** 2)


def _shift_and_traces(x: Floats, y: Floats) -> float:
    """Where the covariances have no direction in common, the root of their product is 0."""
    shift = x.mean(axis=0) - y.mean(axis=0)
    return float(shift @ shift + _trace(x) + _trace(y))


def _by_eigenvalues(x: Floats, y: Floats) -> float:
    """The textbook's way, sound where the covariances have full rank."""
    values, vectors = np.linalg.eigh(np.cov(x, rowvar=False))
    root = (vectors * np.sqrt(values)) @ vectors.T
    inner = np.linalg.eigvalsh(root @ np.cov(y, rowvar=False) @ root)
    return _shift_and_traces(x, y) - 2 * float(np.sqrt(inner).sum())


def _of_two_rows(x: Floats, y: Floats) -> float:
    """Covariances a a' and b b' with a = (x1 - x2) / sqrt(2): the root's trace is |a'b|."""
    a, b = ((z[0] - z[1]) / math.sqrt(2) for z in (x, y))
    return _shift_and_traces(x, y) - 2 * abs(float(a @ b))


def _repeated(x: Floats, y: Floats) -> float:
    """y has every row of x twice: S2 = c S1, c = 2 (n - 1) / (2 n - 1), tr S1 (1 - sqrt(c))^2."""
    del y
    n = len(x)
    return float(_trace(x) * (1 - math.sqrt(2 * (n - 1) / (2 * n - 1))) ** 2)


def _with(x: Array, value: float) -> Array:
    x = x.copy()
    x[3, 2] = value
    return x


def _features(case_id: str, group: str, given: Callable[[], Pair], stated: Stated) -> Case:
    return Case(case_id, group, given, {FRECHET: stated})


def _scaled(scale: float) -> Near:
    """Multiplying all features by a number multiplies the distance by its square."""
    return Near(
        f"{scale:g}^2 times that of the plain features",
        lambda x, y: frechet_distance(*_pair()) * scale * scale,
        lambda x, y: _rounding(*_pair()) * scale * scale,
    )


_PLAIN_TIMES = "4^30 times that of the plain features: powers of two round nothing"
_FAR = 2.0**-53 * 2.0**27  # half a unit in the last place of 1e8, which is below 2^27
_BAD = "1 of 320 feature values are not finite"
_SPREAD = 10.0 ** np.arange(-8, 9)  # deviations

FEATURE_CASES = (
    _features("no-rows", "few rows", lambda: (_normal(0, 0, 8), _normal(1, 9, 8)),
              Refused(TooFewSamples, "[0, 8]")),
    _features("one-row", "few rows", lambda: (_normal(0, 9, 8), _normal(1, 1, 8)),
              Refused(TooFewSamples, "[1, 8]")),
    _features("two-rows", "few rows", lambda: (_normal(0, 2, 8), _normal(1, 2, 8)),
              Near("|shift|^2 + |a|^2 + |b|^2 - 2 |a'b|", _of_two_rows, _rounding)),
    _features("two-rows-of-one-feature", "few rows",
              lambda: (_normal(0, 2, 1), 3 + 5 * _normal(1, 2, 1)),
              Near("(m1 - m2)^2 + (s1 - s2)^2", _on_a_line, _rounding)),
    _features("one-feature", "few rows", lambda: (_normal(0, 50, 1), 3 + 5 * _normal(1, 70, 1)),
              Near("(m1 - m2)^2 + (s1 - s2)^2", _on_a_line, _rounding)),
    _features("fewer-rows-than-features", "few rows",
              lambda: ((x := _normal(0, 20, 256)) - x.mean(axis=0), 3 * (x - x.mean(axis=0))),
              Near("y = 3 x: 4 tr S", lambda x, y: 4 * _trace(x), _rounding)),
    _features("identical", "identical sets", lambda: _twice(_normal(0, 40, 8)),
              Near("0, not less", 0.0, _rounding)),
    _features("identical-fewer-rows-than-features", "identical sets",
              lambda: _twice(_normal(0, 20, 256)),
              Near("0, not less", 0.0, _rounding)),
    _features("identical-in-another-order", "identical sets",
              lambda: ((x := _normal(0, 40, 8)), np.random.default_rng(1).permutation(x)),
              Near("0, not less", 0.0, _rounding)),
    _features("another-order", "identical sets", lambda: (_pair()[0][::-1], _pair()[1]),
              Near("that of the first order", lambda x, y: frechet_distance(*_pair()), _rounding)),
    _features("swapped", "identical sets", lambda: (_pair()[1], _pair()[0]),
              Near("symmetric", lambda x, y: frechet_distance(*_pair()), _rounding)),
    _features("every-row-twice", "identical sets",
              lambda: ((x := _normal(0, 40, 8)), np.repeat(x, 2, axis=0)),
              Near("tr S (1 - sqrt(c))^2, c = 2 (n - 1) / (2 n - 1)", _repeated, _rounding)),
    _features("constant", "rank", lambda: (np.full((10, 3), 2.0), np.full((4, 3), 5.0)),
              Near("3 (2 - 5)^2", 27.0)),
    _features("constant-tenth", "rank", lambda: (np.full((7, 3), 0.1), np.full((13, 3), 0.1)),
              # Means of n equal values are off by n u of them, and so are the deviations.
              Near("0, not less", 0.0, 4 * 3 * (13 * U * 0.1) ** 2)),
    _features("constant-against-normal", "rank",
              lambda: (np.full((9, 8), 2.0), _normal(0, 40, 8)),
              Near("|shift|^2 + tr S2", _shift_and_traces, _rounding)),
    _features("diagonal", "rank",
              lambda: (_diagonal(np.arange(1.0, 9), 0.0), _diagonal(np.arange(8.0, 0, -1), 0.5)),
              Near("8 / 4 + sum of (s1 - s2)^2 = 2 + 168", 170.0, _rounding)),
    _features("diagonal-of-all-magnitudes", "rank",
              lambda: (_diagonal(_SPREAD, 0.0), _diagonal(2 * _SPREAD, 0.0)),
              Near("sum of s^2, s = 1e-8 ... 1e8", float((_SPREAD**2).sum()), _rounding)),
    _features("full-rank", "rank", lambda: (_normal(4, 200, 8), 1.5 * _normal(5, 90, 8) + 1),
              Near("by eigenvalues of the covariances", _by_eigenvalues, _rounding)),
    _features("subspace-of-3-in-40", "rank",
              lambda: (_normal(4, 50, 3) @ _rotation(40)[:3], 2 * _normal(5, 60, 3)
                       @ _rotation(40)[:3]),
              Near("by eigenvalues, in the 3 coordinates",
                   lambda x, y: _by_eigenvalues(_normal(4, 50, 3), 2 * _normal(5, 60, 3)),
                   _rounding)),
    _features("subspaces-that-do-not-meet", "rank",
              lambda: (_normal(4, 50, 3) @ _rotation(40)[:3], _normal(5, 60, 4)
                       @ _rotation(40)[3:7]),
              Near("|shift|^2 + tr S1 + tr S2", _shift_and_traces, _rounding)),
    _features("rotated", "rank",
              lambda: (_pair()[0] @ _rotation(8), _pair()[1] @ _rotation(8)),
              Near("that of the plain features", lambda x, y: frechet_distance(*_pair()),
                   _rounding)),
    _features("scaled-by-1e8", "magnitude", lambda: _pair(1e8), _scaled(1e8)),
    _features("scaled-by-1e-8", "magnitude", lambda: _pair(1e-8), _scaled(1e-8)),
    _features("scaled-by-a-power-of-two", "magnitude", lambda: _pair(2.0**30),
              Near(_PLAIN_TIMES, lambda x, y: frechet_distance(*_pair()) * 2.0**60)),
    _features("divided-by-a-power-of-two", "magnitude", lambda: _pair(2.0**-30),
              Near(_PLAIN_TIMES, lambda x, y: frechet_distance(*_pair()) * 2.0**-60)),
    _features("scaled-by-1e149", "magnitude", lambda: _pair(1e149), _scaled(1e149)),
    _features("largest-constants", "magnitude",
              lambda: (np.full((4, 3), 1e150), np.full((5, 3), -1e150)),
              Near("3 (2e150)^2", 1.2e301, ROUNDING * 1.2e301)),
    _features("overflow-when-squared", "magnitude", lambda: _pair(1e200),
              Refused(ValueError, "no finite covariance; scale them down")),
    _features("underflow-when-squared", "magnitude", lambda: _pair(1e-200),
              Near("1e-400 is no float64", 0.0)),
    _features("subnormal-features", "magnitude", lambda: _pair(1e-310),
              Near("1e-620 is no float64", 0.0)),
    _features("one-value-of-1e100", "magnitude",
              lambda: (np.concatenate([_normal(0, 9, 1), [[1e100]]]), _normal(1, 10, 1)),
              Near("(m1 - m2)^2 + (s1 - s2)^2", _on_a_line, _rounding)),
    _features("whole-numbers-shifted-by-1e8", "magnitude", lambda: _whole(1e8),
              Near("that of the plain features: nothing is rounded",
                   lambda x, y: frechet_distance(*_whole()))),
    _features("shifted-by-1e8", "magnitude", lambda: _pair(shift=1e8),
              Near("that of the plain features",
                   lambda x, y: frechet_distance(*_pair()),
                   # Features are rounded by half a unit, and their means, sums of 40, by 40.
                   lambda x, y: _moved(math.sqrt(frechet_distance(*_pair())), 8, 40, 41 * _FAR))),
    _features("float16", "types",
              lambda: (_pair()[0].astype(np.float16), _pair()[1].astype(np.float16)),
              Near("that of the same values in float64",
                   lambda x, y: frechet_distance(x.astype(float), y.astype(float)))),
    _features("float16-squares-overflow", "types",
              lambda: (np.array([[-6e4], [6e4]], np.float16), np.zeros((2, 1), np.float16)),
              Near("2 (6e4)^2", 7.2e9, ROUNDING * 7.2e9)),
    _features("int8-ends", "types",
              lambda: (np.array([[-128], [127]], np.int8), np.array([[127], [127]], np.int8)),
              Near("127.5^2 + 255^2 / 2", 127.5**2 + 255**2 / 2, ROUNDING * 48768.75)),
    _features("complex", "types", lambda: (_pair()[0].astype(complex), _pair()[1]),
              Refused(ValueError, "features must be real numbers, got complex128")),
    _features("truth-values", "types", lambda: (_pair()[0] > 0, _pair()[1] > 0),
              Refused(ValueError, "features must be real numbers, got bool")),
    _features("texts", "types", lambda: (_pair()[0].astype(str), _pair()[1]),
              Refused(ValueError, "features must be real numbers, got <U")),
    _features("one-dimension", "types", lambda: (_pair()[0][:, 0], _pair()[1]),
              Refused(ValueError, "features must be [n, d], got float64 [40]")),
    _features("no-features", "types", lambda: (_normal(0, 9, 0), _normal(1, 9, 0)),
              Refused(ValueError, "features must be [n, d], got float64 [9, 0]")),
    _features("another-number-of-features", "types",
              lambda: (_normal(0, 9, 4), _normal(1, 9, 5)),
              Refused(ValueError, "sets of 4 and 5 features")),
    _features("nan", "not finite", lambda: (_with(_pair()[0], math.nan), _pair()[1]),
              Refused(ValueError, _BAD)),
    _features("infinite", "not finite", lambda: (_pair()[0], _with(_pair()[1], math.inf)),
              Refused(ValueError, _BAD)),
    _features("float16-overflowed", "not finite",
              lambda: (_pair()[0], _with(_pair()[1].astype(np.float16), -math.inf)),
              Refused(ValueError, _BAD)),
    _features("longdouble-beyond-float64", "not finite",
              lambda: (_pair()[0], _pair()[1].astype(np.longdouble) * np.longdouble("1e400")),
              Refused(ValueError, "320 of 320 feature values are not finite")),
)  # fmt: skip


# --- angles ---------------------------------------------------------------------------------------


def _answers(azimuth_deg: list[float], elevation_deg: float = 0.0) -> NDArray[np.float32]:
    """What a judge that is never wrong would say, float32 [n, 3]."""
    radians = np.radians(np.array(azimuth_deg, np.float64))
    elevation = np.full(len(radians), elevation_deg / 40)
    return np.stack([np.sin(radians), np.cos(radians), elevation], axis=1).astype(np.float32)


def _angles(case_id: str, answers: Callable[[], Array], asked: list[float], **stated: Near) -> Case:
    metrics = {f"{name}-error-deg": near for name, near in stated.items()}
    return Case(case_id, "angles", lambda: (answers(), np.array(asked, np.float64)), metrics)


ANGLE_CASES = (
    _angles("right", lambda: _answers([-170.0, 0.0, 90.0]), [-170.0, 0.0, 90.0],
            azimuth=Near("0", 0.0, ANGLE_DEG)),
    _angles("opposite", lambda: _answers([-90.0, 0.0]), [90.0, 180.0],
            azimuth=Near("the largest", 180.0, ANGLE_DEG)),
    _angles("both-sides-of-180", lambda: _answers([179.5, -180.0]), [-179.5, 180.0],
            azimuth=Near("wrapped", lambda a, b: [1.0, 0.0], ANGLE_DEG)),
    _angles("turned-ten-million-times", lambda: _answers([90.0]), [90.0 + 3.6e9],
            azimuth=Near("wrapped", 0.0, ANGLE_DEG)),
    _angles("undecided", lambda: np.zeros((2, 3), np.float32), [30.0, -120.0],
            azimuth=Near("0 / 0 is the azimuth 0", lambda a, b: np.abs(b), ANGLE_DEG),
            elevation=Near("0 is level", lambda a, b: np.abs(b))),
    _angles("answers-of-1e-40", lambda: np.float32(1e-40) * _answers([90.0]), [90.0],
            azimuth=Near("the length does not count", 0.0, ANGLE_DEG)),
    _angles("answers-of-1e38", lambda: np.float32(1e38) * _answers([45.0]), [45.0],
            azimuth=Near("the length does not count", 0.0, ANGLE_DEG)),
    _angles("answers-in-float16", lambda: _answers([30.0], 20.0).astype(np.float16), [20.0],
            # Sine and cosine are off by 2^-11 of themselves.
            azimuth=Near("30 - 20", 10.0, math.degrees(2.0**-11)),
            elevation=Near("20 - 20", 0.0)),
    _angles("ends-of-elevation", lambda: _answers([0.0, 0.0], 40.0), [40.0, -40.0],
            elevation=Near("0 and 80", lambda a, b: [0.0, 80.0])),
    _angles("answers-of-nan", lambda: np.full((2, 3), np.nan, np.float32), [0.0, 30.0],
            azimuth=Near("NaN stays NaN", math.nan), elevation=Near("NaN stays NaN", math.nan)),
    _angles("no-answers", lambda: np.empty((0, 3), np.float32), [],
            azimuth=Near("of no pictures none", lambda a, b: np.empty(0)),
            elevation=Near("of no pictures none", lambda a, b: np.empty(0))),
)  # fmt: skip

CASES = IMAGE_CASES + NETWORK_CASES + FEATURE_CASES + ANGLE_CASES
