from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.analysis.compare import Estimate
from bench.analysis.differences import Verdicts
from bench.analysis.intervals import mean_interval
from bench.analysis.sweeps import (
    FAMILY_BY_ID,
    NO_VALUE,
    UNDECIDED,
    better_of,
    condition_curves,
    condition_leads,
    crossings,
    sign_changes,
)

from .comparisons import comparison

pytestmark = pytest.mark.usefixtures("few_objects")

NAN = float("nan")
OFFSETS = np.array([-0.03, 0.0, 0.01, 0.02])  # of four objects, with mean 0


def scored(condition, scores, **changes):
    """Return a comparison of methods with these scores of each object."""
    methods = {method: (0, 0, of) for method, of in scores.items()}
    return comparison(methods, condition=condition, **changes)


def along(family, curves, spread=0.0, **changes):
    """Comparisons at all conditions of a family: methods by their curve on its axis.

    Objects differ from the curve, all methods' alike but for `spread` of the first's.
    """
    first = next(iter(curves))
    return pd.concat(
        scored(
            condition,
            {m: f(x) + OFFSETS * (1 + spread * (m == first)) for m, f in curves.items()},
            **changes,
        )
        for x, condition in FAMILY_BY_ID[family].steps
    )


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
    low, high = mean_interval(0.5 * OFFSETS, alpha=0.05 / 5)  # of five steps
    assert low < 0 < high
    for spread, below, above in ((0.0, 0.0, 0.0), (0.5, low, high)):
        steps = along("noise", curves, spread)
        made = condition_leads(condition_curves(steps), Verdicts(steps))
        assert made[["family", "method", "rival"]].drop_duplicates().to_numpy().tolist() == [
            ["noise", "splat-net", "pc2pix"]
        ]
        assert made["at"].tolist() == ["0", "0.05", "0.1", "0.15", "0.2"]
        assert made["value"].tolist() == pytest.approx([0.8, 0.75, 0.7, 0.65, 0.6])
        assert made["rival_value"].tolist() == pytest.approx([0.6, 0.625, 0.65, 0.675, 0.7])
        leads = np.array([0.2, 0.125, 0.05, -0.025, -0.1])
        expected = np.stack([leads, leads + below, leads + above], axis=1)
        np.testing.assert_allclose(made[["lead", "ci_low", "ci_high"]], expected, atol=1e-12)
        crossing = made[["crossing", "crossing_low", "crossing_high"]].to_numpy()
        assert np.isfinite(crossing).all(axis=1).tolist() == [False, False, True, False, False]
        ends = (0.2 + below) / 1.5, (0.2 + above) / 1.5
        assert crossing[2].tolist() == pytest.approx((2 / 15, *ends), abs=1e-9)
        if not spread:
            assert made["ahead"].tolist() == ["splat-net"] * 3 + ["pc2pix"] * 2


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
    """Leads are values, or (value, low, high), at the first steps of a family."""
    leads = [Estimate(*v) if isinstance(v, tuple) else Estimate(v, NAN, NAN) for v in differences]
    assert tuple(better_of(lead, "splat-net", "pc2pix") for lead in leads) == ahead
    at = FAMILY_BY_ID[family].values[: len(leads)]
    columns = crossings(FAMILY_BY_ID[family], at, leads)
    found = [(i, *c) for i, c in enumerate(zip(*columns.values(), strict=True)) if c[0] == c[0]]
    assert len(found) == len(crossovers)
    for one, expected in zip(found, crossovers, strict=True):
        assert one == pytest.approx(expected, rel=1e-12, abs=1e-15, nan_ok=True)


def test_every_family_that_the_conditions_make_up():
    scores = {"pc2pix": [0.5, 0.6], "surface-apss": [0.4, 0.7], "blank": [0.1, 0.2]}
    worth = {"1024": 0.5, "2048": 0.75, "noise-0.05": 0.25, "density-3": 0.125}
    compared = pd.concat(
        scored(condition, scores | {"pc2pix": [value, value]}, class_name=name)
        for name in ("chair", "sofa")
        for condition, value in worth.items()
    )
    families = [
        ("points", ("2048", "1024")),
        ("noise", ("2048", "noise-0.05")),
        ("density", ("1024", "density-3")),
    ]
    steps = [[name, family, c] for name in ("chair", "sofa") for family, of in families for c in of]
    curves = condition_curves(compared)
    made = condition_leads(curves, Verdicts(compared))
    assert made[["class", "family", "condition"]].to_numpy().tolist() == steps
    ours = curves[curves["method"] == "pc2pix"]
    assert ours[["class", "family", "condition"]].to_numpy().tolist() == steps
    assert ours["value"].tolist() == [worth[condition] for _, _, condition in steps]
    methods = curves["method"].tolist()
    assert methods[:6] == ["pc2pix", "pc2pix", "surface-apss", "surface-apss", "blank", "blank"]
    assert condition_curves(scored("512", scores)).empty
