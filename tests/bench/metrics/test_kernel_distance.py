from __future__ import annotations

import itertools

import numpy as np
import pytest

from bench.metrics.kernel_distance import kernel_distance

from ..builders import left_out_kernel_distances


def features(seed, n, d):
    return np.random.default_rng(seed).standard_normal((n, d)).astype(np.float32)


@pytest.mark.parametrize(("n", "m", "d"), [(2, 2, 1), (4, 6, 5), (30, 30, 2048)])
def test_the_mean_over_pairs_spelled_out(n, m, d):
    """Sets of one size have what torch-fidelity 0.4 computes (`metric_kid.py`: mmd2 with
    unbiased) for one subset of all samples; degree 3, gamma 1/d, coef0 1."""
    x, y = features(3, n, d).astype(float), 1.2 * features(4, m, d).astype(float) + 0.1

    def k(a, b):
        return float(a @ b / d + 1) ** 3

    within_x = np.mean([k(a, b) for a, b in itertools.permutations(x, 2)])
    within_y = np.mean([k(a, b) for a, b in itertools.permutations(y, 2)])
    across = np.mean([k(a, b) for a in x for b in y])
    # sums of n^2 kernels of size 10, in another order
    expected = pytest.approx(within_x + within_y - 2 * across, rel=1e-9, abs=1e-12)
    assert kernel_distance(x, y) == expected
    assert kernel_distance(y, x) == expected


def test_an_object_that_leaves_too_little():
    x, y = features(9, 3, 2), features(10, 3, 2)
    _, actual = left_out_kernel_distances(
        x, y, np.array(["a", "a", "b"]), np.array(["a", "b", "b"])
    )
    assert np.isnan(actual).all()  # one row of x is left without a, one of y without b


@pytest.mark.parametrize(
    ("x", "said"),
    [
        (np.zeros((1, 3)), r"features must be \[n, d\] with n >= 2, got \[1, 3\]"),
        (np.zeros((3, 0)), r"got \[3, 0\]"),
        (np.zeros(3), r"got \[3\]"),
        (np.full((2, 3), np.nan), "features must be finite"),
        (np.zeros((2, 4)), "sets of 4 and 3 features cannot be compared"),
    ],
)
def test_what_it_refuses(x, said):
    with pytest.raises(ValueError, match=said):
        kernel_distance(x, np.zeros((2, 3)))


def distance_and_rounding(x, y):
    """Return the distance from all pairs in extended precision, and the bound of the rounding of
    `bench.metrics.kernel_distance`, which says where it is from."""
    x, y = x.astype(np.longdouble), y.astype(np.longdouble)
    (n, d), m = x.shape, len(y)
    distance = size = np.longdouble(0)
    for a, b, weight in ((x, x, 1), (y, y, 1), (x, y, -2)):
        within = a is b
        pairs = len(a) * (len(b) - within)
        kernels = np.einsum("id,jd->ij", a, b) / d + 1
        distance += weight * ((kernels**3).sum() - within * (np.diag(kernels) ** 3).sum()) / pairs
        kernels = np.einsum("id,jd->ij", abs(a), abs(b)) / d + 1
        size += abs(weight) * (kernels**3).sum() / pairs
    return float(distance), float((n + m + d**2 + 6 * d + 200) * 2.0**-53 * size)


# Moments where 3 n m > 2 (n + m) (d + 1)^2, pairs else; 256 x 1,024 pairs are taken at a time.
@pytest.mark.parametrize(
    ("n", "m", "d"),
    [(10, 14, 1), (70, 40, 4), (200, 400, 11), (10, 14, 16), (300, 1030, 28)],
)
@pytest.mark.parametrize("objects", ["equal", "of one row and of many", "of one set only"])
def test_moments_and_pairs_are_all_pairs(n, m, d, objects):
    x, y = features(11, n, d), (1.2 * features(12, m, d) + 0.1).astype(np.float32)
    if objects == "equal":
        of_x, of_y = np.arange(n) % 5, np.arange(m) % 5
    elif objects == "of one row and of many":
        of_x, of_y = np.minimum(np.arange(n), 2), np.maximum(np.arange(m) - m + 3, 0)
    else:
        of_x, of_y = np.arange(n) % 3, 1 + np.arange(m) % 4
    value, without = left_out_kernel_distances(x, y, of_x, of_y)
    expected, rounding = distance_and_rounding(x, y)
    assert value == pytest.approx(expected, rel=0, abs=rounding)
    names = sorted({*of_x.tolist(), *of_y.tolist()})
    assert len(without) == len(names)
    for name, actual in zip(names, without, strict=True):
        expected, rounding = distance_and_rounding(x[of_x != name], y[of_y != name])
        assert actual == pytest.approx(expected, rel=0, abs=rounding)


@pytest.mark.parametrize("d", [3, 30])  # by moments, by pairs
def test_a_set_of_rows_that_are_all_alike(d):
    """(1 + c^2)^3 for each pair of a set, so that only the constants are left."""
    x, y = np.full((40, d), 2.0), np.full((50, d), -1.0)
    expected = (1 + 4) ** 3 + (1 + 1) ** 3 - 2 * (1 - 2) ** 3
    assert kernel_distance(x, y) == pytest.approx(expected, rel=1e-13)
    assert kernel_distance(x, np.zeros((2, d))) == pytest.approx(5**3 + 1 - 2, rel=1e-13)
    assert kernel_distance(x, x) == pytest.approx(0, abs=1e-13 * 4 * 5**3)
