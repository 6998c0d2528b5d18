"""Recall and precision of thin parts: a leg that is drawn, moved, too faint or not there."""

from __future__ import annotations

from bench.suites.stability.metric_cases import THIN, WHOLE_LEG, Case, Near, twice, undefined
from bench.suites.stability.metric_pictures import flat, leg
from bench.suites.stability.metric_tolerances import U

_LEG_IS_GONE = {"thin-recall": Near("nothing of it is drawn", 0.0), **undefined("thin-precision")}
# Within 4 px of 40 x 3 px: 4 px at its sides and ends, 8 px with x^2 + y^2 <= 16 at each corner.
_NEAR_LEG = 120 + 2 * 4 * 40 + 2 * 4 * 3 + 4 * 8

THIN_CASES = (
    Case(
        "leg-not-drawn",
        "thin parts",
        lambda: (leg(), flat(255)),
        _LEG_IS_GONE,
    ),
    Case(
        "leg-half-drawn",
        "thin parts",
        lambda: (leg(), leg(rows=slice(40, 60))),
        {
            "thin-recall": Near("20 of 40 rows", 0.5),
            "thin-precision": Near("nothing beside it", 1.0),
        },
    ),
    Case(
        "leg-one-pixel-off",
        "thin parts",
        lambda: (leg(), leg(columns=slice(61, 64))),
        {metric: Near("2 of 3 columns", 2 / 3, U) for metric in THIN},
    ),
    Case(
        "leg-on-black",
        "thin parts",
        lambda: (leg(), flat(0)),
        {
            "thin-recall": Near("all is painted", 1.0),
            "thin-precision": Near("120 px of all within 4 px", 120 / _NEAR_LEG, U),
        },
    ),
    Case(
        "faintest-leg",
        "thin parts",
        lambda: (leg(254), leg(254)),
        WHOLE_LEG,
    ),
    Case(
        "faintest-leg-not-drawn",
        "thin parts",
        lambda: (leg(254), flat(255)),
        _LEG_IS_GONE,
    ),
    Case(
        "light-leg-half-as-dark",
        "thin parts",
        lambda: (leg(235), leg(245)),
        WHOLE_LEG,
    ),
    Case(
        "light-leg-less-than-half-as-dark",
        "thin parts",
        lambda: (leg(235), leg(246)),
        _LEG_IS_GONE,
    ),
    Case(
        "stub-of-8-px",
        "thin parts",
        lambda: twice(leg(rows=slice(40, 44), columns=slice(60, 62))),
        WHOLE_LEG,
    ),
    Case(
        "stub-of-7-px",
        "thin parts",
        lambda: twice(leg(rows=slice(40, 47), columns=slice(60, 61))),
        undefined(*THIN),
    ),
    Case(
        "leg-along-the-frame",
        "thin parts",
        lambda: twice(leg(columns=slice(0, 3))),
        WHOLE_LEG,
    ),
)
