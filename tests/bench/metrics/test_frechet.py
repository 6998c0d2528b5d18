"""Fréchet distances: values, extremes and intervals; refusals are in `test_extreme_inputs`."""

from __future__ import annotations

import re

import numpy as np
import pytest

from bench.metrics import frechet_distance
from bench.metrics.frechet import (
    EXACT_OBJECTS,
    GROUPS,
    GroupedMoments,
    JackknifeMoments,
    TooFewSamples,
    grouped_distances,
    left_out_distances,
    object_blocks,
)

from .metrics_by_id import rounding_of_frechet
from .reference import reference_cases

# Error budget. A singular value errs by a few eps = 2.2e-16 of the largest, and the sum of d of
# them by d * eps of the trace at worst: 5e-13 for d = 2,048. The distance is a difference of
# traces, so errors are measured against the sum of the traces, not against the distance itself.
ROUNDING = 1e-12


def normal(seed, n, d):
    return np.random.default_rng(seed).standard_normal((n, d))


def traces(x, y):
    return x.var(axis=0, ddof=1).sum() + y.var(axis=0, ddof=1).sum()


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


@pytest.mark.parametrize("case", reference_cases("fid_reference.json"))
def test_conforms_to_reference(case):
    x, y = draw_pair(case["kind"], case["dim"], case["n1"], case["n2"])
    # 1e-8 relative is asked for; the absolute part, from the error budget, is for distances near 0.
    rounding = ROUNDING * (case["exact_trace1"] + case["exact_trace2"])
    assert frechet_distance(x, y) == pytest.approx(case["exact_fid"], rel=1e-8, abs=rounding)


def by_eigenvalues(x, y):
    """The eigenvalues of S1 S2 are real and not negative, their roots those of its square root."""
    s1, s2 = np.cov(x, rowvar=False), np.cov(y, rowvar=False)
    roots = np.sqrt(np.linalg.eigvals(s1 @ s2).real.clip(0))
    shift = x.mean(axis=0) - y.mean(axis=0)
    return float(shift @ shift + np.trace(s1) + np.trace(s2) - 2 * roots.sum())


@pytest.mark.parametrize(
    ("n", "m", "d"),
    [
        *((50, 60, 2), (300, 300, 64), (9000, 9, 3)),
        *((5, 9, 8), (12, 12, 12), (13, 40, 12), (40, 13, 64)),
    ],
)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_agrees_with_eigenvalues(n, m, d, dtype):
    x = (normal(2, n, d) @ normal(1, d, d)).astype(dtype)
    y = (1.4 * normal(3, m, d) + 0.5).astype(dtype)
    x.flags.writeable = y.flags.writeable = False
    # Eigenvalues have condition 1e4 here: 1e-16 * 1e4, relative to the trace. Those that are 0
    # come out as about 1e-15 of the largest, their roots as 3e-8 of it, and there are up to d.
    close = (1e-11 if min(n, m) > d else 1e-6) * traces(x, y)
    exact = x.astype(float), y.astype(float)
    assert frechet_distance(*exact) == pytest.approx(by_eigenvalues(*exact), rel=0, abs=close)
    assert frechet_distance(x, y) == frechet_distance(*exact)
    assert frechet_distance(x, x) <= ROUNDING * traces(x, x)


# --- extremes -------------------------------------------------------------------------------------

X, Y = normal(1, 40, 8), 1.4 * normal(2, 40, 8) + 0.2
PLAIN = frechet_distance(X, Y)
PLAIN_ROUNDING = rounding_of_frechet(X, Y)
IN_3, ALSO_IN_3 = normal(4, 50, 3), 2 * normal(5, 60, 3)
AXES = np.linalg.qr(normal(9, 40, 40))[0]
TURN = np.linalg.qr(normal(9, 8, 8))[0]
CENTRED = normal(0, 20, 256) - normal(0, 20, 256).mean(axis=0)
U = 2.0**-53


def diagonal(deviations, mean=0.0):
    """Rows +-a e_j [2 d, d] about `mean`, with the covariance diag(deviations^2) exactly."""
    d = len(deviations)
    rows = np.diag(deviations * np.sqrt((2 * d - 1) / 2))
    return np.concatenate([rows, -rows]) + mean


def on_a_line(x, y):
    """(m1 - m2)^2 + (s1 - s2)^2 of one feature; in longdouble no square overflows."""
    x, y = x.astype(np.longdouble), y.astype(np.longdouble)
    return float((x.mean() - y.mean()) ** 2 + (x.std(ddof=1) - y.std(ddof=1)) ** 2)


def shift_and_traces(x, y):
    """The distance where the covariances share no direction: the root's trace is 0."""
    shift = x.mean(axis=0) - y.mean(axis=0)
    return shift @ shift + traces(x, y)


def of_two_rows(x, y):
    """Of covariances a a' and b b', a = (x1 - x2) / sqrt(2): the trace of the root is |a'b|."""
    a, b = ((z[0] - z[1]) / np.sqrt(2) for z in (x, y))
    return shift_and_traces(x, y) - 2 * abs(a @ b)


VALUES = {  # two sets, the distance, and the tolerance where it is not that of rounding
    "two rows": (X[:2], Y[:2], of_two_rows(X[:2], Y[:2])),
    "one feature": (X[:, :1], 3 + 5 * Y[:, :1], on_a_line(X[:, :1], 3 + 5 * Y[:, :1])),
    "fewer rows than features": (CENTRED, 3 * CENTRED, 2 * traces(CENTRED, CENTRED)),
    "identical": (CENTRED, CENTRED, 0.0),
    "another order": (X[::-1], Y, PLAIN),
    "swapped": (Y, X, PLAIN),
    # Means of n equal values are off by n U of them, and so are the deviations.
    "tenths": (np.full((7, 3), 0.1), np.full((13, 3), 0.1), 0.0, 12 * (13 * U * 0.1) ** 2),
    "constant, normal": (np.full((9, 8), 2.0), X, shift_and_traces(np.full((9, 8), 2.0), X)),
    "diagonal": (diagonal(np.arange(1.0, 9)), diagonal(np.arange(8.0, 0, -1), 0.5), 2.0 + 168),
    "3 of 40": (  # eigenvalues of a product that is not symmetric err more than singular values
        *(IN_3 @ AXES[:3], ALSO_IN_3 @ AXES[:3], by_eigenvalues(IN_3, ALSO_IN_3)),
        10 * ROUNDING * traces(IN_3, ALSO_IN_3),
    ),
    "subspaces that do not meet": (
        *(IN_3 @ AXES[:3], normal(5, 60, 4) @ AXES[3:7]),
        shift_and_traces(IN_3 @ AXES[:3], normal(5, 60, 4) @ AXES[3:7]),
    ),
    "rotated": (X @ TURN, Y @ TURN, PLAIN),
    **{
        f"times {scale:g}": (X * scale, Y * scale, PLAIN * scale**2, PLAIN_ROUNDING * scale**2)
        for scale in (1e8, 1e-8, 1e149)
    },
    "largest": (np.full((4, 3), 1e150), np.full((5, 3), -1e150), 1.2e301, ROUNDING * 1.2e301),
    "squares underflow": (X * 1e-200, Y * 1e-200, 0.0, 0.0),
    "one of 1e100": (
        *(np.append(X[:9, :1], [[1e100]], axis=0), Y[:10, :1]),
        on_a_line(np.append(X[:9, :1], [[1e100]], axis=0), Y[:10, :1]),
    ),
    "float16": (
        *(X.astype("f2"), Y.astype("f2")),
        frechet_distance(X.astype("f2").astype(float), Y.astype("f2").astype(float)),
        0.0,
    ),
    "float16, squares overflow": (np.array([[-6e4], [6e4]], "f2"), np.zeros((2, 1), "f2"), 7.2e9),
    "ends of int8": (
        *(np.array([[-128], [127]], np.int8), np.array([[127], [127]], np.int8)),
        127.5**2 + 255**2 / 2,
    ),
}


@pytest.mark.parametrize("name", VALUES)
def test_extreme_features(name):
    """A distance is real, finite and not negative."""
    x, y, expected, *tolerance = VALUES[name]
    (within,) = tolerance or [rounding_of_frechet(x, y)]
    actual = frechet_distance(x, y)
    assert isinstance(actual, float)
    assert 0.0 <= actual < np.inf
    np.testing.assert_allclose(actual, expected, rtol=0, atol=within)


def test_features_far_from_0():
    """Of 1e8 they are rounded by half a unit, and their means, sums of 40, by 40.

    The root of a distance moves by at most D = e sqrt(d n / (n - 1)) a set, of features off by e.
    """
    move = 2 * 41 * U * 2.0**27 * np.sqrt(8 * 40 / 39)
    within = 2 * np.sqrt(PLAIN) * move + move**2
    assert frechet_distance(X + 1e8, Y + 1e8) == pytest.approx(PLAIN, rel=0, abs=within)


# --- intervals ------------------------------------------------------------------------------------


def views_of_objects(seed, n_objects, n_views, d, offset=0.0):
    """Features whose views of one object lie close together."""
    rng = np.random.default_rng(seed)
    objects = rng.standard_normal((n_objects, 1, d))
    views = 0.5 * rng.standard_normal((n_objects, n_views, d))
    groups = np.repeat(np.arange(n_objects), n_views)
    return (objects + views + offset).reshape(-1, d), groups


def by_leaving_out(x, y, groups_x, groups_y):
    """Return the distances by their definition: one anew for every object."""
    return [
        frechet_distance(x[groups_x != group], y[groups_y != group])
        for group in np.union1d(groups_x, groups_y)
    ]


def leave_one_out(x, y, groups_x, groups_y):
    return left_out_distances(JackknifeMoments(x, groups_x), JackknifeMoments(y, groups_y))


# objects, views, features: more rows than features, as many, fewer, fewer without an object
@pytest.mark.parametrize("shape", [(8, 5, 12), (8, 5, 40), (8, 5, 64), (8, 5, 38), (8, 1, 400)])
@pytest.mark.parametrize("gone", [None, 5])
def test_distances_share_what_they_may(shape, gone):
    n_objects, n_views, d = shape
    x, groups = views_of_objects(0, n_objects, n_views, d)
    y, _ = views_of_objects(1, n_objects, n_views, d, offset=0.3)
    kept = groups != gone  # the method failed on one object
    order = np.random.default_rng(2).permutation(len(y))  # rows need not stand side by side
    x, groups_x, y, groups_y = x[kept], groups[kept], y[order], groups[order]
    actual = leave_one_out(x, y, groups_x, groups_y)
    expected = by_leaving_out(x, y, groups_x, groups_y)
    assert actual == pytest.approx(expected, rel=0, abs=ROUNDING * traces(x, y))
    assert np.ptp(actual) > 0
    names = [np.array([f"chair-{i}" for i in groups]) for groups in (groups_x, groups_y)]
    assert leave_one_out(x, y, *names).tolist() == actual.tolist()


@pytest.mark.parametrize(
    ("objects", "blocks"), [(0, 0), (1, 1), (60, 60), (61, 21), (90, 30), (91, 23), (1357, 30)]
)
def test_many_objects_are_left_out_in_groups(objects, blocks):
    names = np.array([f"o{i:04d}" for i in range(objects)], dtype="U8")
    actual, block = object_blocks(np.random.default_rng(0).permutation(np.repeat(names, 2)))
    assert actual.tolist() == names.tolist()
    assert sorted(set(block.tolist())) == list(range(blocks))
    if blocks:
        assert np.ptp(np.bincount(block)) <= 1
    if objects <= EXACT_OBJECTS:
        assert block.tolist() == list(range(objects))
    else:
        assert blocks <= GROUPS
        # neighbours by name, which may be alike, are dealt to other groups
        assert (np.diff(block) == 0).mean() < 0.15


def test_groups_of_objects_are_left_out():
    objects = EXACT_OBJECTS + 1
    x, groups = views_of_objects(0, objects, 2, d=6)
    y, _ = views_of_objects(1, objects, 2, d=6, offset=0.3)
    _, block = object_blocks(groups)
    distances = leave_one_out(x, y, groups, groups)
    expected = by_leaving_out(x, y, block[groups], block[groups])
    assert len(expected) == 21
    assert distances == pytest.approx(expected, rel=0, abs=ROUNDING * traces(x, y))


# views of an object, features and rows of a part: rows wait until a group has more than features
@pytest.mark.parametrize(
    ("views", "d", "part", "far"),
    [
        *((2, 6, 50, 0), (3, 64, 7, 0), (2, 300, 1000, 0), (300, 3, 997, 0), (300, 1, 997, 0)),
        (30, 6, 50, 1e6),  # sums of squares would leave 4 of 16 digits
    ],
)
def test_streamed_groups_have_the_distances_of_their_definition(views, d, part, far):
    x, groups = views_of_objects(0, 13, views, d, far)
    y, _ = views_of_objects(1, 13, views, d, far + 0.3)
    block = (5 * groups) % 4
    kept = groups != 2  # a method that failed on an object
    dtype = np.float64 if far else np.float32
    sets = (x[kept].astype(dtype), block[kept]), (y.astype(dtype), block)
    streams = []
    for features, member in sets:
        streams.append(GroupedMoments(4))
        for start in range(0, len(features), part):
            streams[-1].add(features[start : start + part], member[start : start + part])
    value, without = grouped_distances(*streams)
    (drawn, in_drawn), (true, in_true) = sets
    # far away the features themselves have a rounding of 1e6 * 2^-53 = 1e-10
    close = max(ROUNDING, far * 1e-15) * traces(drawn.astype(float), true.astype(float))
    assert value == pytest.approx(frechet_distance(drawn, true), rel=0, abs=close)
    expected = by_leaving_out(drawn, true, in_drawn, in_true)
    assert without == pytest.approx(expected, rel=0, abs=close)


def test_rows_that_come_after_a_distance_are_in_the_next_one():
    x, groups = views_of_objects(0, 6, 20, d=5)
    y, _ = views_of_objects(1, 6, 20, d=5, offset=0.3)
    drawn, true = GroupedMoments(6), GroupedMoments(6)
    true.add(y, groups)
    for start, end in ((0, 90), (90, 120)):
        drawn.add(x[start:end], groups[start:end])
        value, without = grouped_distances(drawn, true)
        close = ROUNDING * traces(x[:end], y)
        assert value == pytest.approx(frechet_distance(x[:end], y), rel=0, abs=close)
        exact = leave_one_out(x[:end], y, groups[:end], groups)
        assert without == pytest.approx(exact, rel=0, abs=close)


@pytest.mark.parametrize("d", [4, 40])
def test_identical_sets_and_objects_that_leave_too_little(d):
    x, groups = views_of_objects(0, 8, 3, d)
    assert leave_one_out(x, x, groups, groups).max() <= ROUNDING * traces(x, x)
    x, others = x[:10], np.repeat(np.arange(5), 2)
    lonely = np.arange(10) // 9  # without object 0 a single row would be left
    assert np.isnan(leave_one_out(x, x, lonely, others)).all()
    streams = GroupedMoments(2), GroupedMoments(2)
    for stream, of_rows in zip(streams, (lonely, others % 2), strict=True):
        stream.add(x, of_rows)
    value, without = grouped_distances(*streams)
    assert value <= ROUNDING * traces(x, x)
    assert (len(without), np.isnan(without).all()) == (2, True)


def test_groups_have_to_fit():
    x, groups = views_of_objects(0, 4, 3, d=4)
    with pytest.raises(ValueError, match=re.escape("12 rows need groups of shape [12], got [11]")):
        JackknifeMoments(x, groups[:-1])
    with pytest.raises(ValueError, match="8 of 8 feature values are not finite"):
        GroupedMoments(2).add(np.full((2, 4), np.inf), np.array([0, 1]))
    with pytest.raises(TooFewSamples):
        GroupedMoments(2).whole()
