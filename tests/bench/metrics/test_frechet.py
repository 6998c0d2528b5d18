from __future__ import annotations

import hashlib
import json
import math
import os
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from bench.metrics import frechet, frechet_distance
from bench.metrics.frechet import (
    LeftOut,
    TooFewSamples,
    centred,
    centred_to_frechet,
    frechet_interval,
    merged,
    merged_to_centred,
    moments,
    object_blocks,
)

REFERENCE = Path(
    os.environ.get("PC2PIX_REFERENCE", Path(__file__).parents[4] / "shared" / "reference")
)

# Error budget. A singular value errs by a few eps = 2.2e-16 of the largest, and the sum of d of
# them by d * eps of the trace at worst: 5e-13 for d = 2,048. The distance is a difference of
# traces, so errors are measured against the sum of the traces, not against the distance itself.
ROUNDING = 1e-12


def normal(seed, n, d):
    return np.random.default_rng(seed).standard_normal((n, d))


def traces(x, y):
    return x.var(axis=0, ddof=1).sum() + y.var(axis=0, ddof=1).sum()


# --- conformance ----------------------------------------------------------------------------------


def draw_pair(kind, dim, n1, n2):
    seed = 1000 * dim + n1
    a, b, j = normal(seed, n1, dim), normal(seed + 500, n2, dim), np.arange(dim)
    if kind == "iid":
        return a, b
    if kind == "shift":
        return a, 0.25 + 1.5 * b
    if kind == "corr":
        return a / (1 + j), b / (1 + (7 * j) % dim)
    if kind == "relu":
        return 0.4 * np.maximum(a, 0), 0.5 * np.maximum(b, 0)
    if kind == "identical":
        return a, a
    if kind in ("const_both", "const_one"):
        a[:, 3] = 1.0
        if kind == "const_both":
            b[:, 3] = 1.0
        return a, b
    assert kind == "halfzero", f"unknown kind of case: {kind}"
    a[:, ::2] = b[:, ::2] = 0.0
    return a, b


def reference_cases():
    path = REFERENCE / "fid_reference.json"
    if not path.is_file():
        skip = pytest.mark.skip(reason=f"no conformance vectors at {path}; set PC2PIX_REFERENCE")
        return [pytest.param(None, marks=skip)]
    cases = json.loads(path.read_text())["cases"]
    return [
        pytest.param(case, id=name, marks=pytest.mark.slow if case["dim"] > 1000 else [])
        for name, case in cases.items()
    ]


@pytest.mark.parametrize("case", reference_cases())
def test_conforms_to_reference(case):
    x, y = draw_pair(case["kind"], case["dim"], case["n1"], case["n2"])
    assert hashlib.sha256(x.tobytes()).hexdigest() == case["sha256_x1"]
    assert hashlib.sha256(y.tobytes()).hexdigest() == case["sha256_x2"]
    # 1e-8 relative is asked for; the absolute part, from the error budget, is for distances near 0.
    rounding = ROUNDING * (case["exact_trace1"] + case["exact_trace2"])
    assert frechet_distance(x, y) == pytest.approx(case["exact_fid"], rel=1e-8, abs=rounding)


# --- independent implementations, and routes that go wrong ----------------------------------------


def by_sqrtm(x, y):
    s1, s2 = np.cov(x, rowvar=False), np.cov(y, rowvar=False)
    root = scipy.linalg.sqrtm(s1 @ s2)
    shift = x.mean(axis=0) - y.mean(axis=0)
    return float(shift @ shift + np.trace(s1) + np.trace(s2) - 2 * np.trace(root).real)


def by_eigh(x, y):
    s1, s2 = np.cov(x, rowvar=False), np.cov(y, rowvar=False)
    values, vectors = np.linalg.eigh(s1)
    root1 = (vectors * np.sqrt(np.maximum(values, 0))) @ vectors.T
    inner = np.linalg.eigvalsh(root1 @ s2 @ root1)
    shift = x.mean(axis=0) - y.mean(axis=0)
    trace_root = np.sqrt(np.maximum(inner, 0)).sum()
    return float(shift @ shift + np.trace(s1) + np.trace(s2) - 2 * trace_root)


@pytest.mark.parametrize(("n", "m", "d"), [(50, 60, 1), (50, 60, 2), (200, 90, 16), (300, 300, 64)])
def test_agrees_with_sqrtm_where_that_is_sound(n, m, d):
    mix = normal(1, d, d)
    x, y = normal(2, n, d) @ mix, normal(3, m, d) + 0.5
    expected = by_sqrtm(x, y) if d > 1 else (x.std(ddof=1) - y.std(ddof=1)) ** 2
    expected += (x.mean() - y.mean()) ** 2 if d == 1 else 0.0
    # eigenvalues under the square root have condition 1e4 here: 1e-16 * 1e4, relative to the trace
    assert frechet_distance(x, y) == pytest.approx(expected, abs=1e-11 * traces(x, y))


def test_matrix_roots_go_wrong_on_identical_small_sets():
    # The case identical_d2048_n100 of the reference (-3.3e-4 by eigh, -3.7e-4 by sqrtm) in small.
    # Rounding leaves eigenvalues of 1e-16 * 20 where 0 belongs; 237 of them under a root: 1e-6.
    x = normal(0, 20, 256)
    assert abs(by_eigh(x, x)) > 1e-7
    assert frechet_distance(x, x) <= ROUNDING * traces(x, x)


def test_float32_moments_would_be_caught():
    x = 100 + normal(0, 500, 16).astype(np.float32)
    y = 100 + normal(1, 500, 16).astype(np.float32)
    exact = frechet_distance(x.astype(np.float64), y.astype(np.float64))
    assert frechet_distance(x, y) == exact
    moments = [(z.mean(0), (z.T @ z / 500 - np.outer(z.mean(0), z.mean(0)))) for z in (x, y)]
    (m1, s1), (m2, s2) = moments
    wrong = ((m1 - m2) ** 2).sum() + np.trace(s1) + np.trace(s2)
    wrong -= 2 * np.sqrt(np.maximum(np.linalg.eigvals((s1 @ s2).astype(np.float64)).real, 0)).sum()
    assert abs(wrong - exact) > 1e-4 * exact


# --- closed form ----------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 10, 1000])
def test_two_gaussians_on_a_line(n):
    # A sample with any wanted mean and standard deviation, exactly up to rounding.
    z = np.linspace(-1, 1, n)[:, None]
    z /= z.std(ddof=1)
    # (m1 - m2)^2 + (s1 - s2)^2 = (3 + 1)^2 + (2 - 0.5)^2
    assert frechet_distance(3 + 2 * z, -1 + 0.5 * z) == pytest.approx(18.25, rel=1e-12)


@pytest.mark.parametrize(("n", "d"), [(2, 7), (7, 7), (8, 7), (400, 7), (40, 300)])
def test_shift_of_every_feature(n, d):
    x = normal(n, n, d)
    # c^2 d; the equal traces cancel up to their rounding
    assert frechet_distance(x, x - 0.3) == pytest.approx(
        0.09 * d, abs=ROUNDING * (traces(x, x) + d)
    )


@pytest.mark.parametrize("n", [65, 200, 1000])
def test_two_samples_of_one_distribution_are_apart_by_the_expected_bias(n):
    # Standard normal vectors of d numbers, m = n - 1 >= d: 2 d / n for the means, d (d + 1) / 2m
    # for the covariances (two Wishart matrices, their product in the limit of large d).
    d, repeats = 64, 20
    rng = np.random.default_rng(n)
    found = [
        frechet_distance(rng.normal(size=(n, d)), rng.normal(size=(n, d))) for _ in range(repeats)
    ]
    expected = 2 * d / n + d * (d + 1) / (2 * (n - 1))
    # what the limit leaves out (1 / d), and four standard errors of the mean
    tolerance = expected / d + 4 * np.std(found, ddof=1) / math.sqrt(repeats)
    assert np.mean(found) == pytest.approx(expected, abs=tolerance)


def test_the_bias_where_samples_are_few():
    # n far below d: rows of a sample are orthogonal, their product follows the quarter-circle law:
    # 2 d (1 + 1/n) - 16 / (3 pi) sqrt(m d); the next order is m / d of the root's term, 230.
    n, d, repeats = 10, 2048, 5
    rng = np.random.default_rng(0)
    found = [
        frechet_distance(rng.normal(size=(n, d)), rng.normal(size=(n, d))) for _ in range(repeats)
    ]
    expected = 2 * d * (1 + 1 / n) - 16 / (3 * math.pi) * math.sqrt((n - 1) * d)
    tolerance = 230 * (n - 1) / d + 4 * np.std(found, ddof=1) / math.sqrt(repeats)
    assert np.mean(found) == pytest.approx(expected, abs=tolerance)


def test_sets_that_vary_in_different_features():
    x, y = normal(0, 30, 40), normal(1, 20, 40)
    x[:, 20:] = 0.0
    y[:, :20] = 0.0
    # the covariances have orthogonal ranges: nothing is subtracted
    expected = ((x.mean(0) - y.mean(0)) ** 2).sum() + traces(x, y)
    assert frechet_distance(x, y) == pytest.approx(expected, rel=1e-13)


def test_scaling_a_set_by_a_factor():
    x = normal(0, 15, 64)
    x -= x.mean(axis=0)
    # tr S (1 + 9 - 2 * 3), rank 14 of 64
    expected = 4 * x.var(axis=0, ddof=1).sum()
    assert frechet_distance(x, 3 * x) == pytest.approx(expected, rel=1e-12)


# --- invariants -----------------------------------------------------------------------------------

SHAPES = [(5, 9, 8), (12, 12, 12), (13, 40, 12), (40, 13, 64), (300, 200, 32)]


@pytest.mark.parametrize(("n", "m", "d"), SHAPES)
def test_invariants(n, m, d):
    x, y = normal(1, n, d), 1.4 * normal(2, m, d) + 0.2
    distance = frechet_distance(x, y)
    rng = np.random.default_rng(3)
    rotation = scipy.linalg.qr(normal(4, d, d))[0]
    close = pytest.approx(distance, abs=ROUNDING * (traces(x, y) + distance))

    assert isinstance(distance, float)
    assert distance >= 0
    assert frechet_distance(y, x) == close
    assert frechet_distance(rng.permutation(x), rng.permutation(y)) == close
    assert frechet_distance(x @ rotation, y @ rotation) == close
    assert frechet_distance(x + 5, y + 5) == close
    assert frechet_distance(x, x) <= ROUNDING * traces(x, x)


@pytest.mark.parametrize("scale", [1e-100, 1e-8, 1e-3, 1e8, 1e100])
@pytest.mark.parametrize(("n", "m", "d"), SHAPES)
def test_goes_with_the_square_of_the_scale(n, m, d, scale):
    x, y = normal(1, n, d), normal(2, m, d)
    # No absolute epsilon anywhere: only rounding, that of the trace included.
    expected = frechet_distance(x, y) * scale * scale
    assert frechet_distance(x * scale, y * scale) == pytest.approx(
        expected, rel=0, abs=ROUNDING * traces(x, y) * scale * scale
    )


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.int64])
def test_any_real_dtype_is_promoted(dtype):
    x, y = ((10 * normal(seed, 30, 8)).astype(dtype) for seed in (1, 2))
    assert frechet_distance(x, y) == frechet_distance(x.astype(float), y.astype(float))


@pytest.mark.parametrize(("n", "d"), [(2, 5), (5, 5), (6, 5), (500, 5)])
def test_factor_squares_to_the_covariance(n, d):
    x = normal(0, n, d) @ normal(1, d, d) + 3
    moments = centred(x)
    assert moments.factor.shape == (min(n, d), d)
    np.testing.assert_allclose(moments.mean, x.mean(axis=0), rtol=1e-13)
    np.testing.assert_allclose(
        moments.factor.T @ moments.factor, np.cov(x, rowvar=False), rtol=0, atol=1e-12
    )
    assert centred_to_frechet(moments, centred(2 * x)) == frechet_distance(x, 2 * x)


def test_leaves_its_input_alone():
    x = normal(0, 10, 4)
    x.flags.writeable = False
    before = x.copy()
    frechet_distance(x, x)
    np.testing.assert_array_equal(x, before)


def test_constant_sets_lie_apart_by_their_means_only():
    assert frechet_distance(np.full((10, 3), 2.0), np.full((4, 3), 5.0)) == 27.0


@pytest.mark.parametrize("n", [0, 1])
def test_refuses_a_set_without_covariance(n):
    with pytest.raises(TooFewSamples, match=re.escape(f"[{n}, 4]")):
        frechet_distance(normal(0, 10, 4), normal(0, n, 4))


def test_names_what_it_refuses():
    x = normal(0, 10, 4)
    bad = x.copy()
    bad[1, 2], bad[3, :2] = np.nan, np.inf
    with pytest.raises(ValueError, match="3 of 40"):
        frechet_distance(x, bad)
    with pytest.raises(ValueError, match="4 and 5 features"):
        frechet_distance(x, normal(0, 10, 5))
    with pytest.raises(ValueError, match=re.escape("[10]")):
        frechet_distance(x, x[:, 0])
    with pytest.raises(ValueError, match="complex128"):
        frechet_distance(x, x.astype(complex))
    with pytest.raises(ValueError, match="scale them down"):
        frechet_distance(x, x * 1e200)
    with pytest.raises(ValueError, match="40 of 40 feature values are not finite"):
        frechet_distance(x, x.astype(np.longdouble) * np.longdouble("1e400"))  # and no warning


# --- the interval ---------------------------------------------------------------------------------


def views_of_objects(seed, n_objects, n_views, d, offset=0.0):
    """Features whose views of one object lie close together."""
    rng = np.random.default_rng(seed)
    objects = rng.standard_normal((n_objects, 1, d))
    views = 0.5 * rng.standard_normal((n_objects, n_views, d))
    groups = np.repeat(np.arange(n_objects), n_views)
    return (objects + views + offset).reshape(-1, d), groups


def test_interval_is_the_jackknife_of_its_definition():
    x, groups = views_of_objects(0, 6, 4, d=1)
    y = 1.3 * x + 0.4 + 0.1 * normal(1, len(x), 1)
    theta = by_formula = None
    thetas = []
    for left_out in (None, *range(6)):
        kept = groups != left_out if left_out is not None else np.ones(len(x), bool)
        means, stds = zip(*((z[kept].mean(), z[kept].std(ddof=1)) for z in (x, y)), strict=True)
        by_formula = (means[0] - means[1]) ** 2 + (stds[0] - stds[1]) ** 2
        if left_out is None:
            theta = by_formula
        else:
            thetas.append(by_formula)
    # sqrt((g - 1) / g * sum of squares), g = 6; np.var divides by g: sqrt(5 * var)
    error = 1.96 * np.sqrt(5 * np.var(thetas))
    low, high = frechet_interval(x, y, groups, groups)
    assert (low, high) == pytest.approx((max(theta - error, 0.0), theta + error), rel=1e-10)


def by_leaving_out(x, y, groups_x, groups_y):
    """The interval from its definition: a distance of its own for every object."""
    thetas = [
        frechet_distance(x[groups_x != group], y[groups_y != group])
        for group in np.union1d(groups_x, groups_y)
    ]
    error = 1.96 * np.sqrt((len(thetas) - 1) * np.var(thetas))
    theta = frechet_distance(x, y)
    return max(theta - error, 0.0), theta + error


# objects, views, features: more rows than features, as many, fewer, fewer without an object
@pytest.mark.parametrize("shape", [(8, 5, 12), (8, 5, 40), (8, 5, 64), (8, 5, 38), (8, 1, 400)])
@pytest.mark.parametrize("gone", [None, 5])
def test_interval_shares_what_it_may(shape, gone):
    n_objects, n_views, d = shape
    x, groups = views_of_objects(0, n_objects, n_views, d)
    y, _ = views_of_objects(1, n_objects, n_views, d, offset=0.3)
    kept = groups != gone  # the method failed on one object
    order = np.random.default_rng(2).permutation(len(y))  # rows need not stand side by side
    x, groups_x, y, groups_y = x[kept], groups[kept], y[order], groups[order]
    low, high = frechet_interval(x, y, groups_x, groups_y)
    expected = by_leaving_out(x, y, groups_x, groups_y)
    # The error of a distance, for g of them: under the root g ROUNDING of the traces.
    close = 1.96 * n_objects * ROUNDING * traces(x, y)
    assert (low, high) == pytest.approx(expected, rel=0, abs=close)
    assert low < high


@pytest.mark.parametrize("count", [1, 2, 3, 8, 13])
def test_what_is_left_without_each_block(count):
    """However many halves there are, and whatever the order of the rows."""
    x, groups = views_of_objects(0, 13, 4, d=5)
    member = np.random.default_rng(1).permutation(groups % count)
    found = list(LeftOut(x, groups).without_each(member, count)) if count > 1 else []
    for block, left in enumerate(found):
        expected = centred(x[member != block])
        assert left.mean == pytest.approx(expected.mean, rel=1e-13, abs=1e-13)
        assert left.factor.T @ left.factor == pytest.approx(np.cov(x[member != block].T), rel=1e-12)
    if count == 1:
        with pytest.raises(TooFewSamples):
            list(LeftOut(x, groups).without_each(member, count))


def test_no_row_is_decomposed_more_often_than_halves_need(monkeypatch):
    """log2(64) = 6 times, where leaving out each of 64 objects anew would be 63 times."""
    x, groups = views_of_objects(0, 64, 20, d=5)
    left_out, rows = LeftOut(x, groups), []
    original = frechet._moments

    def counted(features, chosen):
        rows.append(len(chosen))
        return original(features, chosen)

    monkeypatch.setattr("bench.metrics.frechet._moments", counted)
    assert len(list(left_out.without_each(groups, 64))) == 64
    assert sum(rows) == 6 * len(x)


@pytest.mark.parametrize(
    ("objects", "blocks"), [(0, 0), (1, 1), (400, 400), (401, 201), (1000, 334)]
)
def test_many_objects_are_left_out_in_blocks(objects, blocks):
    names = np.array([f"o{i:04d}" for i in range(objects)], dtype="U8")
    found, block = object_blocks(np.random.default_rng(0).permutation(np.repeat(names, 2)))
    assert found.tolist() == names.tolist()
    assert sorted(set(block.tolist())) == list(range(blocks))
    assert (np.diff(block) >= 0).all()  # neighbours by name
    if blocks:
        assert np.ptp(np.bincount(block)) <= 1


def test_the_interval_by_blocks_is_that_of_its_definition(monkeypatch):
    monkeypatch.setattr("bench.metrics.frechet.MOST_BLOCKS", 4)
    x, groups = views_of_objects(0, 10, 4, d=6)
    y, _ = views_of_objects(1, 10, 4, d=6, offset=0.3)
    # k = ceil(10 / 4) = 3, so ceil(10 / 3) = 4 blocks: objects 0 1 2, 3 4 5, 6 7 and 8 9
    block = np.array([0, 0, 0, 1, 1, 1, 2, 2, 3, 3])[groups]
    close = 1.96 * 4 * ROUNDING * traces(x, y)
    found = frechet_interval(x, y, groups, groups)
    assert found == pytest.approx(by_leaving_out(x, y, block, block), rel=0, abs=close)
    assert found != pytest.approx(by_leaving_out(x, y, groups, groups), rel=1e-3)


def test_blocks_tell_the_same_spread_as_objects(monkeypatch):
    """The standard errors of 300 objects and of 60 blocks of 5; that of 60 errs by sqrt(2 / 60),
    18 %, so they agree within 3 times that."""
    x, groups = views_of_objects(0, 300, 2, d=4)
    y, _ = views_of_objects(1, 300, 2, d=4, offset=0.5)
    of_objects = np.subtract(*frechet_interval(x, y, groups, groups)[::-1])
    monkeypatch.setattr("bench.metrics.frechet.MOST_BLOCKS", 60)
    of_blocks = np.subtract(*frechet_interval(x, y, groups, groups)[::-1])
    assert of_blocks == pytest.approx(of_objects, rel=0.55)
    assert of_blocks != of_objects


# --- merged moments -------------------------------------------------------------------------------


def spread(seed, n, d):
    """Correlated features of unequal scale, their mean far from 0."""
    mix = normal(99, d, d) / np.arange(1, d + 1)
    return normal(seed, n, d) @ mix + 3.0


def in_parts(x, sizes, order=None):
    cuts = np.split(x, np.cumsum(sizes))
    parts = [moments(part) for part in cuts]
    return parts if order is None else [parts[i] for i in order]


def by_tree(parts):
    while len(parts) > 1:
        paired = [merged(*parts[i : i + 2]) for i in range(0, len(parts) - 1, 2)]
        parts = paired + parts[len(parts) // 2 * 2 :]
    return parts[0]


SIZES = {
    "halves": [100],
    "single rows": [1] * 200,
    "unequal": [1, 2, 150, 3, 0, 7, 40],
    "fewer than features": [5] * 40,
    "one": [],
}


@pytest.mark.parametrize("sizes", SIZES.values(), ids=SIZES.keys())
@pytest.mark.parametrize("d", [1, 8, 64, 300])
def test_merged_moments_give_the_distance_of_one_pass(sizes, d):
    x, y = spread(0, 211, d), 1.2 * spread(1, 211, d) + 0.1
    truth = centred(y)
    expected = centred_to_frechet(centred(x), truth)
    order = np.random.default_rng(2).permutation(len(sizes) + 1)
    for parts in (in_parts(x, sizes), in_parts(x, sizes, order)):
        by_chain = merged_to_centred(iter(parts))
        assert centred_to_frechet(by_chain, truth) == pytest.approx(expected, rel=1e-9)
        whole = by_tree(parts)
        assert whole.n == len(x)
        assert len(whole.root) <= d or len(whole.root) == 211
        both = merged_to_centred([whole])
        assert centred_to_frechet(both, truth) == pytest.approx(expected, rel=1e-9)
        # both sets in parts
        other = merged_to_centred(in_parts(y, [50, 1, 60]))
        assert centred_to_frechet(both, other) == pytest.approx(expected, rel=1e-9)


def test_merged_moments_against_covariances_and_eigenvalues():
    """The usual route, well-conditioned here: 20 features, 2,000 rows."""
    x, y = spread(3, 2000, 20), 1.3 * spread(4, 1500, 20)
    s1, s2 = np.cov(x.T), np.cov(y.T)
    # tr sqrt(S1 S2) from the eigenvalues of the product, which are those of a symmetric matrix
    roots = np.sqrt(np.linalg.eigvals(s1 @ s2).real).sum()
    shift = x.mean(axis=0) - y.mean(axis=0)
    expected = shift @ shift + np.trace(s1) + np.trace(s2) - 2 * roots
    parts = [in_parts(z, [300, 1, 17, 900]) for z in (x, y)]
    found = centred_to_frechet(*(merged_to_centred(of) for of in parts))
    assert found == pytest.approx(expected, rel=1e-9)
    whole = by_tree(parts[0])
    np.testing.assert_allclose(whole.mean, x.mean(axis=0), rtol=1e-13)
    np.testing.assert_allclose(whole.root.T @ whole.root / 1999, s1, rtol=1e-11, atol=1e-13)


def test_merging_far_from_the_origin_does_not_cancel():
    """A mean of 1e6 with a spread of 1: sums of squares would leave 4 of 16 digits."""
    x, y = normal(5, 400, 6) + 1e6, 1.5 * normal(6, 400, 6) + 1e6
    expected = frechet_distance(x - 1e6, y - 1e6)
    of = [merged_to_centred(in_parts(z, [7] * 50)) for z in (x, y)]
    # the features themselves have a rounding of 1e6 * 2^-53 = 1e-10
    assert centred_to_frechet(*of) == pytest.approx(expected, rel=1e-8)


def test_float32_is_taken_to_float64_before_anything_is_added():
    x = spread(7, 500, 8).astype(np.float32)
    found, expected = moments(x), moments(x.astype(np.float64))
    np.testing.assert_array_equal(found.mean, expected.mean)
    np.testing.assert_array_equal(found.root, expected.root)


@pytest.mark.parametrize("rows", [3, 50])
def test_a_set_larger_than_a_part(rows, monkeypatch):
    """Rows are taken to float64 in parts: the same as in one."""
    x, y = spread(8, 1000, 4), spread(9, 1000, 4) + 1
    expected = frechet_distance(x, y)
    monkeypatch.setattr("bench.metrics.frechet._ROWS", rows)
    assert frechet_distance(x, y) == pytest.approx(expected, rel=1e-9)


def test_no_rows_and_one_row():
    x = spread(10, 40, 3)
    nothing, one = moments(x[:0]), moments(x[:1])
    assert (nothing.n, nothing.mean.tolist(), nothing.root.shape) == (0, [0, 0, 0], (0, 3))
    assert (one.n, one.mean.tolist()) == (1, x[0].tolist())
    assert not one.root.any()
    assert merged(nothing, one) is one
    assert merged(one, nothing) is one
    for too_few in ([], [nothing], [one], [nothing, one, nothing]):
        with pytest.raises(TooFewSamples, match="at least 2 samples"):
            merged_to_centred(too_few)
    two = merged_to_centred([one, nothing, moments(x[1:2])])
    np.testing.assert_allclose(two.factor.T @ two.factor, np.cov(x[:2].T), rtol=1e-12)


def test_moments_name_what_they_refuse():
    x = spread(11, 10, 4)
    with pytest.raises(ValueError, match="rows of 4 and 3 features cannot be merged"):
        merged(moments(x), moments(x[:, :3]))
    with pytest.raises(ValueError, match=re.escape("features must be [n, d]")):
        moments(x[0])
    with pytest.raises(ValueError, match="4 of 40 feature values are not finite"):
        moments(np.where(np.arange(10)[:, None] == 3, np.inf, x))


def test_interval_covers_the_distance_of_the_populations():
    # d = 1: both populations have variance 1.25, their means differ by 1, the distance is 1. 24
    # objects in both sets as in a paired comparison, 200 experiments. The jackknife is asymptotic;
    # with a true coverage of 0.90 or more, fewer than 170 hits are 2.4 sigma off.
    hits = 0
    for seed in range(200):
        x, groups = views_of_objects(2 * seed, 24, 5, d=1)
        y, _ = views_of_objects(2 * seed + 1, 24, 5, d=1, offset=1.0)
        low, high = frechet_interval(x, y, groups, groups)
        hits += low <= 1.0 <= high
    assert 170 <= hits <= 200


def test_percentile_bootstrap_would_exclude_its_own_estimate():
    # Why the interval is not a bootstrap: every resample of objects lies above the estimate.
    x, groups = views_of_objects(0, 30, 3, d=64)
    y, _ = views_of_objects(1, 30, 3, d=64)
    estimate = frechet_distance(x, y)
    rng = np.random.default_rng(2)
    replicates = []
    for _ in range(40):
        rows = np.concatenate([np.flatnonzero(groups == g) for g in rng.integers(0, 30, 30)])
        replicates.append(frechet_distance(x[rows], y[rows]))
    assert min(replicates) > estimate
    low, high = frechet_interval(x, y, groups, groups)
    assert low < estimate < high


def test_interval_of_identical_sets_is_a_point():
    x, groups = views_of_objects(0, 8, 3, d=4)
    low, high = frechet_interval(x, x, groups, groups)
    assert low == 0.0
    assert high <= 8 * ROUNDING * traces(x, x)


def test_interval_takes_labels_and_objects_missing_from_one_set():
    x, groups = views_of_objects(0, 8, 3, d=4)
    y, _ = views_of_objects(1, 8, 3, d=4)
    names = np.array([f"chair-{i}" for i in groups])
    assert frechet_interval(x, y, names, names) == frechet_interval(x, y, groups, groups)
    some = groups != 5  # the method failed on object 5
    low, high = frechet_interval(x[some], y, groups[some], groups)
    assert 0 <= low < frechet_distance(x[some], y) < high


def test_interval_without_enough_objects_is_not_a_number():
    x, groups = views_of_objects(0, 2, 5, d=3)
    assert np.isnan(frechet_interval(x, x, groups, groups)).all()
    # without object 0 a single row would be left
    lonely = np.array([0, 0, 0, 0, 0, 0, 0, 0, 0, 1])
    others = np.repeat(np.arange(5), 2)
    assert np.isnan(frechet_interval(x, x, lonely, others)).all()


def test_interval_names_what_it_refuses():
    x, groups = views_of_objects(0, 4, 3, d=4)
    with pytest.raises(ValueError, match=re.escape("[12]")):
        frechet_interval(x, x, groups, groups[:-1])
    with pytest.raises(TooFewSamples):
        frechet_interval(x, x[:1], groups, groups[:1])
