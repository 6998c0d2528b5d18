"""Kernel distances by all pairs; refusals are in `test_extreme_inputs`."""

from __future__ import annotations

import numpy as np
import pytest

from bench.metrics.kernel_distance import kernel_distance

from ..builders import left_out_kernel_distances


def features(seed, n, d):
    return np.random.default_rng(seed).standard_normal((n, d)).astype(np.float32)


def distance_and_rounding(x, y):
    """Return the distance from all pairs in extended precision, and the bound of the rounding of
    `bench.metrics.kernel_distance`, which says where it is from.

    Sets of one size have what torch-fidelity 0.4 computes (`metric_kid.py`: mmd2 with unbiased)
    for one subset of all samples; degree 3, gamma 1/d, coef0 1."""
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
    return float(distance), float((n + m + 7 * d + 200) * 2.0**-53 * size)


# 256 x 1,024 pairs are taken at a time.
@pytest.mark.parametrize(("n", "m", "d"), [(10, 14, 1), (30, 30, 2048), (300, 1030, 28)])
@pytest.mark.parametrize("objects", ["equal", "of one row and of many", "of one set only"])
def test_sums_are_of_all_pairs(n, m, d, objects):
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
    assert kernel_distance(y, x) == pytest.approx(expected, rel=0, abs=rounding)
    names = sorted({*of_x.tolist(), *of_y.tolist()})
    for name, actual in zip(names[:3], without[:3], strict=True):
        expected, rounding = distance_and_rounding(x[of_x != name], y[of_y != name])
        assert actual == pytest.approx(expected, rel=0, abs=rounding)
    assert len(without) == len(names)


def test_an_object_that_leaves_too_little():
    """One row of x is left without a, one of y without b."""
    objects = np.array(["a", "a", "b"]), np.array(["a", "b", "b"])
    _, actual = left_out_kernel_distances(features(9, 3, 2), features(10, 3, 2), *objects)
    assert np.isnan(actual).all()


def test_a_set_of_rows_that_are_all_alike():
    """(1 + c^2)^3 for each pair of a set, so that only the constants are left."""
    x, y = np.full((40, 30), 2.0), np.full((50, 30), -1.0)
    expected = (1 + 4) ** 3 + (1 + 1) ** 3 - 2 * (1 - 2) ** 3
    assert kernel_distance(x, y) == pytest.approx(expected, rel=1e-13)
    assert kernel_distance(x, x) == pytest.approx(0, abs=1e-13 * 4 * 5**3)
