"""Cases on metrics of features: Fréchet distances, the networks that take them, angles."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.metrics import JUDGE, Extractor, find_extractor
from bench.metrics.frechet import TooFewSamples, frechet_distance
from bench.suites.stability.metric_cases import (
    ANGLE_DEG,
    FD_VIEWS,
    FLOAT32_FEATURES,
    FRECHET,
    ROUNDING,
    UNIT_CODES,
    Array,
    MetricCase,
    MetricExpectation,
    Near,
    Number,
    Refused,
    U,
    boxes,
    cases,
    cases_of,
    flat,
    grey,
    largest_move,
    near,
    noise,
    rounding,
    speck,
    trace,
    twice,
)
from data_prep.arrays import Floats
from data_prep.scene import UInt8Images


def _normal(seed: int, n: int, d: int) -> Floats:
    return np.random.default_rng(seed).standard_normal((n, d))


def _pair(scale: float = 1.0, shift: float = 0.0) -> tuple[Floats, Floats]:
    """Return two ordinary sets of 40 rows and 8 features, multiplied and moved."""
    return _normal(1, 40, 8) * scale + shift, (1.4 * _normal(2, 40, 8) + 0.2) * scale + shift


def _whole(shift: float = 0.0) -> tuple[Floats, Floats]:
    """Return two sets of 32 rows of whole numbers, with exact sums and means, even far from 0."""
    rng = np.random.default_rng(3)
    x, y = rng.integers(-50, 50, (2, 32, 8)).astype(np.float64)
    return x + shift, y + shift


def _diagonal(deviations: Array, mean: float) -> Floats:
    """Return rows +-a e_j [2 d, d] about `mean`, with the covariance diag(deviations^2) exactly."""
    d = len(deviations)
    rows = np.diag(deviations * math.sqrt((2 * d - 1) / 2))
    return np.concatenate([rows, -rows]) + mean


def _rotation(d: int) -> Floats:
    return np.linalg.qr(_normal(9, d, d))[0]


def _on_a_line(x: Array, y: Array) -> float:
    """Return (m1 - m2)^2 + (s1 - s2)^2 of one feature."""
    # In longdouble no square overflows.
    x, y = x.astype(np.longdouble), y.astype(np.longdouble)
    deviations = [np.sqrt(((z - z.mean()) ** 2).sum() / (len(z) - 1)) for z in (x, y)]
    return float((x.mean() - y.mean()) ** 2 + (deviations[0] - deviations[1]) ** 2)


def _shift_and_traces(x: Floats, y: Floats) -> float:
    """Return the distance where the covariances share no direction: the root's trace is 0."""
    shift = x.mean(axis=0) - y.mean(axis=0)
    return float(shift @ shift + trace(x) + trace(y))


def _by_eigenvalues(x: Floats, y: Floats) -> float:
    """Return the distance by the textbook, sound where the covariances have full rank."""
    values, vectors = np.linalg.eigh(np.cov(x, rowvar=False))
    root = (vectors * np.sqrt(values)) @ vectors.T
    inner = np.linalg.eigvalsh(root @ np.cov(y, rowvar=False) @ root)
    return _shift_and_traces(x, y) - 2 * float(np.sqrt(inner).sum())


def _of_two_rows(x: Floats, y: Floats) -> float:
    """Return the distance of covariances a a' and b b', a = (x1 - x2) / sqrt(2).

    The trace of the root is |a'b|.
    """
    a, b = ((z[0] - z[1]) / math.sqrt(2) for z in (x, y))
    return _shift_and_traces(x, y) - 2 * abs(float(a @ b))


def _repeated(x: Floats, y: Floats) -> float:
    """Return the distance of x to y, which has every row of x twice.

    S2 = c S1, c = 2 (n - 1) / (2 n - 1), tr S1 (1 - sqrt(c))^2.
    """
    del y
    n = len(x)
    return float(trace(x) * (1 - math.sqrt(2 * (n - 1) / (2 * n - 1))) ** 2)


def _with(x: Array, value: float) -> Array:
    x = x.copy()
    x[3, 2] = value
    return x


def _plain(x: Array, y: Array) -> float:
    """Return the distance of the plain features, whatever the arguments."""
    del x, y
    return frechet_distance(*_pair())


def _as_plain(words: str = "that of the plain features") -> Near:
    return Near(words, _plain, rounding)


def _times_4_to_the_30(factor: float) -> Near:
    words = "4^30 times that of the plain features: powers of two round nothing"
    return Near(words, lambda x, y: _plain(x, y) * factor)


def _not_real(dtype: str) -> Refused:
    return Refused(ValueError, f"features must be real numbers, got {dtype}")


def _not_finite(count: int) -> Refused:
    return Refused(ValueError, f"{count} of 320 feature values are not finite")


def _scaled(scale: float) -> Near:
    """Return the distance times the square of the factor of all features."""
    return Near(
        f"{scale:g}^2 times that of the plain features",
        lambda x, y: _plain(x, y) * scale * scale,
        lambda x, y: rounding(*_pair()) * scale * scale,
    )


_FAR = 2.0**-53 * 2.0**27  # half a unit in the last place of 1e8, which is below 2^27
_SPREAD = 10.0 ** np.arange(-8, 9)  # deviations
_X, _Y = _pair()
_ROWS = _normal(0, 40, 8)
_IN_3, _ALSO_IN_3 = _normal(4, 50, 3), 2 * _normal(5, 60, 3)
_AXES = _rotation(40)
_ZERO = Near("0, not less", 0.0, rounding)
_LINE = Near("(m1 - m2)^2 + (s1 - s2)^2", _on_a_line, rounding)


FRECHET_CASES = (
    *cases_of(FRECHET, "few rows",
        ("no-rows", lambda: (_normal(0, 0, 8), _normal(1, 9, 8)), Refused(TooFewSamples, "[0, 8]")),
        ("one-row", lambda: (_normal(0, 9, 8), _normal(1, 1, 8)), Refused(TooFewSamples, "[1, 8]")),
        ("two-rows", lambda: (_normal(0, 2, 8), _normal(1, 2, 8)),
         Near("|shift|^2 + |a|^2 + |b|^2 - 2 |a'b|", _of_two_rows, rounding)),
        ("two-rows-of-one-feature", lambda: (_normal(0, 2, 1), 3 + 5 * _normal(1, 2, 1)), _LINE),
        ("one-feature", lambda: (_normal(0, 50, 1), 3 + 5 * _normal(1, 70, 1)), _LINE),
        ("fewer-rows-than-features",
         lambda: ((x := _normal(0, 20, 256)) - x.mean(axis=0), 3 * (x - x.mean(axis=0))),
         Near("y = 3 x: 4 tr S", lambda x, y: 4 * trace(x), rounding)),
    ),
    *cases_of(FRECHET, "identical sets",
        ("identical", lambda: twice(_ROWS), _ZERO),
        ("identical-fewer-rows-than-features", lambda: twice(_normal(0, 20, 256)), _ZERO),
        ("identical-in-another-order", lambda: (_ROWS, np.random.default_rng(1).permutation(_ROWS)),
         _ZERO),
        ("another-order", lambda: (_X[::-1], _Y), _as_plain("that of the first order")),
        ("swapped", lambda: (_Y, _X), _as_plain("symmetric")),
        ("every-row-twice", lambda: (_ROWS, np.repeat(_ROWS, 2, axis=0)),
         Near("tr S (1 - sqrt(c))^2, c = 2 (n - 1) / (2 n - 1)", _repeated, rounding)),
    ),
    *cases_of(FRECHET, "rank",
        ("constant", lambda: (np.full((10, 3), 2.0), np.full((4, 3), 5.0)),
         Near("3 (2 - 5)^2", 27.0)),
        # Means of n equal values are off by n u of them, and so are the deviations.
        ("constant-tenth", lambda: (np.full((7, 3), 0.1), np.full((13, 3), 0.1)),
         Near("0, not less", 0.0, 4 * 3 * (13 * U * 0.1) ** 2)),
        ("constant-against-normal", lambda: (np.full((9, 8), 2.0), _ROWS),
         Near("|shift|^2 + tr S2", _shift_and_traces, rounding)),
        ("diagonal",
         lambda: (_diagonal(np.arange(1.0, 9), 0.0), _diagonal(np.arange(8.0, 0, -1), 0.5)),
         Near("8 / 4 + sum of (s1 - s2)^2 = 2 + 168", 170.0, rounding)),
        ("diagonal-of-all-magnitudes",
         lambda: (_diagonal(_SPREAD, 0.0), _diagonal(2 * _SPREAD, 0.0)),
         Near("sum of s^2, s = 1e-8 ... 1e8", float((_SPREAD**2).sum()), rounding)),
        ("full-rank", lambda: (_normal(4, 200, 8), 1.5 * _normal(5, 90, 8) + 1),
         Near("by eigenvalues of the covariances", _by_eigenvalues, rounding)),
        ("subspace-of-3-in-40", lambda: (_IN_3 @ _AXES[:3], _ALSO_IN_3 @ _AXES[:3]),
         Near("by eigenvalues, in the 3 coordinates",
              lambda x, y: _by_eigenvalues(_IN_3, _ALSO_IN_3), rounding)),
        ("subspaces-that-do-not-meet", lambda: (_IN_3 @ _AXES[:3], _normal(5, 60, 4) @ _AXES[3:7]),
         Near("|shift|^2 + tr S1 + tr S2", _shift_and_traces, rounding)),
        ("rotated", lambda: (_X @ _rotation(8), _Y @ _rotation(8)), _as_plain()),
    ),
    *cases_of(FRECHET, "magnitude",
        ("scaled-by-1e8", lambda: _pair(1e8), _scaled(1e8)),
        ("scaled-by-1e-8", lambda: _pair(1e-8), _scaled(1e-8)),
        ("scaled-by-a-power-of-two", lambda: _pair(2.0**30), _times_4_to_the_30(2.0**60)),
        ("divided-by-a-power-of-two", lambda: _pair(2.0**-30), _times_4_to_the_30(2.0**-60)),
        ("scaled-by-1e149", lambda: _pair(1e149), _scaled(1e149)),
        ("largest-constants", lambda: (np.full((4, 3), 1e150), np.full((5, 3), -1e150)),
         Near("3 (2e150)^2", 1.2e301, ROUNDING * 1.2e301)),
        ("overflow-when-squared", lambda: _pair(1e200),
         Refused(ValueError, "no finite covariance; scale them down")),
        ("underflow-when-squared", lambda: _pair(1e-200), Near("1e-400 is no float64", 0.0)),
        ("subnormal-features", lambda: _pair(1e-310), Near("1e-620 is no float64", 0.0)),
        ("one-value-of-1e100",
         lambda: (np.concatenate([_normal(0, 9, 1), [[1e100]]]), _normal(1, 10, 1)), _LINE),
        ("whole-numbers-shifted-by-1e8", lambda: _whole(1e8),
         Near("that of the plain features: nothing is rounded",
              lambda x, y: frechet_distance(*_whole()))),
        # Features are rounded by half a unit, and their means, sums of 40, by 40.
        ("shifted-by-1e8", lambda: _pair(shift=1e8),
         Near("that of the plain features", _plain,
              lambda x, y: largest_move(math.sqrt(_plain(x, y)), 8, 40, 41 * _FAR))),
    ),
    *cases_of(FRECHET, "types",
        ("float16", lambda: (_X.astype(np.float16), _Y.astype(np.float16)),
         Near("that of the same values in float64",
              lambda x, y: frechet_distance(x.astype(float), y.astype(float)))),
        ("float16-squares-overflow",
         lambda: (np.array([[-6e4], [6e4]], np.float16), np.zeros((2, 1), np.float16)),
         Near("2 (6e4)^2", 7.2e9, ROUNDING * 7.2e9)),
        ("int8-ends",
         lambda: (np.array([[-128], [127]], np.int8), np.array([[127], [127]], np.int8)),
         Near("127.5^2 + 255^2 / 2", 127.5**2 + 255**2 / 2, ROUNDING * 48768.75)),
        ("complex", lambda: (_X.astype(complex), _Y), _not_real("complex128")),
        ("truth-values", lambda: (_X > 0, _Y > 0), _not_real("bool")),
        ("texts", lambda: (_X.astype(str), _Y), _not_real("<U")),
        ("one-dimension", lambda: (_X[:, 0], _Y),
         Refused(ValueError, "features must be [n, d], got float64 [40]")),
        ("no-features", lambda: (_normal(0, 9, 0), _normal(1, 9, 0)),
         Refused(ValueError, "features must be [n, d], got float64 [9, 0]")),
        ("another-number-of-features", lambda: (_normal(0, 9, 4), _normal(1, 9, 5)),
         Refused(ValueError, "sets of 4 and 5 features")),
    ),
    *cases_of(FRECHET, "not finite",
        ("nan", lambda: (_with(_X, math.nan), _Y), _not_finite(1)),
        ("infinite", lambda: (_X, _with(_Y, math.inf)), _not_finite(1)),
        ("float16-overflowed", lambda: (_X, _with(_Y.astype(np.float16), -math.inf)),
         _not_finite(1)),
        ("longdouble-beyond-float64",
         lambda: (_X, _Y.astype(np.longdouble) * np.longdouble("1e400")), _not_finite(320)),
    ),
)  # fmt: skip


@functools.cache
def extractor(name: str) -> Extractor:
    """Return a network of ours by its id, loaded once."""
    source = find_extractor(name)
    return source.load(str(source.weights(None)), "cpu")


def of_constants(name: str, a: UInt8Images, b: UInt8Images) -> float:
    """Return the squared distance of the features of two images."""
    features = extractor(name)
    return float(((features(a[:1])[0].astype(float) - features(b[:1])[0].astype(float)) ** 2).sum())


def rounding_of(name: str, a: UInt8Images, b: UInt8Images) -> float:
    """Return the rounding of a distance of the features of two stacks of images."""
    features = extractor(name)
    return rounding(features(a), features(b))


OfNetwork = float | Callable[[str, Any, Any], float]  # or computed from its name and both stacks


def _on_networks(words: str, value: OfNetwork, within: OfNetwork) -> dict[str, MetricExpectation]:
    """Return the expectations of both networks' distances, and of the judge's codes."""

    def number(source: OfNetwork, name: str) -> Number:
        return functools.partial(source, name) if callable(source) else source

    stated: dict[str, MetricExpectation] = {
        name: Near(words, number(value, name), number(within, name)) for name in FD_VIEWS
    }
    return stated | {JUDGE: UNIT_CODES}


SAME = "0, not less, of 6 images"

NETWORK_CASES = cases(
    "features of images",
    ("identical-pictures", lambda: twice(boxes()), _on_networks(SAME, 0.0, rounding_of)),
    ("pictures-in-reverse", lambda: (boxes(), boxes()[::-1]),
     _on_networks(SAME, 0.0, largest_move(0.0, 64, 6, FLOAT32_FEATURES))),
    ("white-pictures", lambda: twice(flat(255, 3)),
     _on_networks(SAME, 0.0, largest_move(0.0, 64, 3, FLOAT32_FEATURES))),
    ("white-pictures-against-black", lambda: (flat(255, 3), flat(0, 3)),
     _on_networks("nothing varies: the squared distance of two feature vectors",
                  of_constants,
                  lambda name, a, b: largest_move(
                      math.sqrt(of_constants(name, a, b)), 64, 3, FLOAT32_FEATURES))),
    ("colour-against-its-grey", lambda: (boxes(), grey(boxes())),
     near("0: of colour only the luma counts", 0.0, "fd-views-grey",
          within=functools.partial(rounding_of, "fd-views-grey"))),
    ("noise-and-one-pixel", lambda: (flat(255, 2), np.concatenate([noise(5), speck(255, 0, 0)])),
     {JUDGE: UNIT_CODES}),
)  # fmt: skip


def _answers(azimuth_deg: list[float], elevation_deg: float = 0.0) -> NDArray[np.float32]:
    """Return the answers of a judge that is never wrong, float32 [n, 3]."""
    radians = np.radians(np.array(azimuth_deg, np.float64))
    elevation = np.full(len(radians), elevation_deg / 40)
    return np.stack([np.sin(radians), np.cos(radians), elevation], axis=1).astype(np.float32)


def _angles(
    case_id: str, answers: Callable[[], Array], asked: list[float], **stated: Near
) -> MetricCase:
    metrics = {f"{name}-error-deg": near for name, near in stated.items()}
    return MetricCase(case_id, "angles", lambda: (answers(), np.array(asked, np.float64)), metrics)


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
            azimuth=Near("of no images none", lambda a, b: np.empty(0)),
            elevation=Near("of no images none", lambda a, b: np.empty(0))),
)  # fmt: skip
