from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.analysis.comparison import Estimate
from bench.analysis.condition_sweep import (
    NO_VALUE,
    UNDECIDED,
    PairedComparison,
    condition_curves,
    paired_comparisons,
    pairs_among,
    sign_changes,
)
from bench.analysis.intervals import mean_interval
from bench.analysis.paired import Verdicts
from bench.catalogue.conditions import FAMILIES, families_of

from .comparisons import comparison

pytestmark = pytest.mark.usefixtures("few_objects")

NAN = float("nan")
BY_ID = {family.id: family for family in FAMILIES}
OFFSETS = np.array([-0.03, 0.0, 0.01, 0.02])  # of four objects, with mean 0


def paired(differences, family="noise"):
    """Leads as values, or as (value, low, high), at the first steps of a family."""
    message = [Estimate(*v) if isinstance(v, tuple) else Estimate(v, NAN, NAN) for v in differences]
    conditions = BY_ID[family].conditions[: len(message)]
    (reduced,) = (f for f in families_of(conditions) if f.id == family)
    values, others = (0.5,) * len(message), (0.25,) * len(message)
    return PairedComparison(
        "chair", reduced, "ssim", "splat-net", "pc2pix", values, others, tuple(message)
    )


def scored(condition, scores, **changes):
    """Return a comparison of methods with these scores of each object."""
    methods = {method: (0, 0, of) for method, of in scores.items()}
    return comparison(methods, condition=condition, **changes)


def along(family, curves, spread=0.0, **changes):
    """Comparisons at all conditions of a family: methods by their curve on its axis.

    Objects differ from the curve, all methods' alike but for `spread` of the first's.
    """
    first = next(iter(curves))
    return [
        scored(
            condition,
            {m: f(x) + OFFSETS * (1 + spread * (m == first)) for m, f in curves.items()},
            **changes,
        )
        for x, condition in BY_ID[family].steps
    ]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([3, -1, -1], [(0, 0.75)]),
        ([1, 0, 0, -1], [(0, 1.0)]),  # of a stretch at 0 its beginning
        ([1, 0, 1], []),  # touched
        ([0, -1, -1], []),  # begins at 0: nobody was ahead
        ([1, NAN, -1], []),  # nothing is known of what lies between
        ([NAN, 1, -1], [(1, 1.5)]),
        ([], []),
    ],
)
def test_sign_changes_by_hand(values, expected):
    assert sign_changes(range(len(values)), values) == expected


@settings(deadline=None, derandomize=True)
@given(st.lists(st.sampled_from([-3.0, -1.0, 0.0, 1.0, 2.0]), min_size=2, max_size=7))
def test_sign_changes_by_going_along(values):
    """In steps of 1/60, which hit all zeros of such lines: 1/2, 1/3, 1/4, 2/5, 3/5, 2/3, 3/4."""
    fine = np.arange(60 * (len(values) - 1) + 1) / 60
    lines = np.interp(fine, range(len(values)), values)
    lines[np.abs(lines) < 1e-12] = 0
    sided = np.flatnonzero(lines)
    turns = [
        fine[i + 1]  # of a stretch at 0 its beginning
        for i, j in pairwise(sided)
        if lines[i] * lines[j] < 0
    ]
    found = [at for _, at in sign_changes(range(len(values)), values)]
    assert found == pytest.approx(turns, abs=1e-12)
    for after, at in sign_changes(range(len(values)), values):
        assert after < at <= after + 1


def test_straight_curves_cross_where_they_do():
    """0.8 - x and 0.6 + x/2 meet at 2/15, whatever the steps; the crossing reaches as far as the
    same interval around each lead holds 0: for [low, high] / 1.5."""
    curves = {"splat-net": lambda x: 0.8 - x, "pc2pix": lambda x: 0.6 + x / 2}
    low, high = mean_interval(0.5 * OFFSETS, 0.05 / 5)  # of five steps
    assert low < 0 < high
    for spread, below, above in ((0.0, 0.0, 0.0), (0.5, low, high)):
        steps = along("noise", curves, spread)
        (made,) = paired_comparisons(steps, ["ssim"], Verdicts([], steps))
        assert (made.method, made.baseline, made.family.id) == ("splat-net", "pc2pix", "noise")
        assert made.values == pytest.approx([0.8, 0.75, 0.7, 0.65, 0.6])
        assert made.baseline_values == pytest.approx([0.6, 0.625, 0.65, 0.675, 0.7])
        for of, value in zip(made.differences, [0.2, 0.125, 0.05, -0.025, -0.1], strict=True):
            assert tuple(of) == pytest.approx((value, value + below, value + above), abs=1e-12)
        (crossover,) = made.crossovers
        assert crossover.after == 2
        ends = (0.2 + below) / 1.5, (0.2 + above) / 1.5
        assert (crossover.at, crossover.low, crossover.high) == pytest.approx(
            (2 / 15, *ends), abs=1e-9
        )
        if not spread:
            assert made.ahead == ("splat-net",) * 3 + ("pc2pix",) * 2


@pytest.mark.parametrize(
    ("family", "differences", "ahead", "crossovers"),
    [
        # 2048, 1024, 512, 256, on a logarithmic axis: the lower end passes through 0 halfway
        # between the first two, the lead between the next, the upper end between the last two
        (
            "points",
            [(0.3, 0.1, 0.5), (0.1, -0.1, 0.3), (-0.1, -0.3, 0.1), (-0.3, -0.5, -0.1)],
            ("splat-net", UNDECIDED, UNDECIDED, "pc2pix"),
            [(1, 2**9.5, 2**8.5, 2**10.5)],
        ),
        # an interval that holds 0 to the end
        (
            "noise",
            [(0.2, 0.1, 0.3), (0.05, -0.05, 0.15), (-0.05, -0.15, 0.05)],
            ("splat-net", UNDECIDED, UNDECIDED),
            [(1, 0.075, 0.05 * 2 / 3, 0.10)],
        ),
        # the interval is 0.1 wide and the lead falls by 0.2 in 0.05
        (
            "noise",
            [(0.1, 0.05, 0.15), (-0.1, -0.15, -0.05), (0.1, 0.05, 0.15)],
            ("splat-net", "pc2pix", "splat-net"),
            [(0, 0.025, 0.0125, 0.0375), (1, 0.075, 0.0625, 0.0875)],
        ),
        # without intervals nobody is ahead but curves cross
        ("noise", [0.1, -0.3], (UNDECIDED, UNDECIDED), [(0, 0.0125, NAN, NAN)]),
        ("noise", [NAN, -0.3], (NO_VALUE, UNDECIDED), []),
        # nor is anybody where an interval ends at 0
        (
            "noise",
            [(0.1, 0.0, 0.2), (-0.1, -0.2, 0.0)],
            (UNDECIDED, UNDECIDED),
            [(0, 0.025, 0.0, 0.05)],
        ),
    ],
)
def test_who_is_ahead_and_where_that_changes(family, differences, ahead, crossovers):
    made = paired(differences, family)
    assert made.ahead == ahead
    found = [(c.after, c.at, c.low, c.high) for c in made.crossovers]
    assert len(found) == len(crossovers)
    for one, expected in zip(found, crossovers, strict=True):
        assert one == pytest.approx(expected, rel=1e-12, abs=1e-15, nan_ok=True)


def test_pairs():
    assert pairs_among(["surface-apss", "pc2pix", "splat-net", "splat", "blank"]) == [
        ("splat-net", "surface-apss"),
        ("pc2pix", "surface-apss"),
        ("splat-net", "pc2pix"),
    ]
    assert pairs_among(["pc2pix@a.safetensors", "surface-apss@resolution=25", "pc2pix"]) == [
        ("pc2pix@a.safetensors", "surface-apss@resolution=25"),
        ("pc2pix", "surface-apss@resolution=25"),
    ]
    assert pairs_among(["splat", "surface-fit", "pc2pix"]) == []


def test_every_family_that_the_conditions_make_up():
    scores = {"pc2pix": [0.5, 0.6], "surface-apss": [0.4, 0.7], "blank": [0.1, 0.2]}
    worth = {"1024": 0.5, "2048": 0.75, "noise-0.05": 0.25, "density-3": 0.125}
    compared = [
        scored(condition, scores | {"pc2pix": [value, value]}, class_name=name)
        for name in ("chair", "sofa")
        for condition, value in worth.items()
    ]
    families = [
        ("points", ("2048", "1024")),
        ("noise", ("2048", "noise-0.05")),
        ("density", ("1024", "density-3")),
    ]
    made = paired_comparisons(compared, ["ssim"], Verdicts([], compared))
    assert [(c.class_name, c.family.id, c.family.conditions) for c in made] == [
        (name, *family) for name in ("chair", "sofa") for family in families
    ]
    every = condition_curves(compared, ["ssim"])
    assert [c.method for c in every] == ["pc2pix", "surface-apss", "blank"] * 6
    assert [[e.value for e in c.estimates] for c in every[:9:3]] == [
        [worth[condition] for condition in conditions] for _, conditions in families
    ]
    assert condition_curves([scored("512", scores)], ["ssim"]) == ()
