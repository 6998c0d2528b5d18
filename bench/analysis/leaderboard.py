"""The numbers of a leaderboard: methods over all conditions of a run, and their mean places."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from bench.analysis.comparison import Comparison, Estimate, Quality
from bench.analysis.digits import prints_better
from bench.analysis.intervals import clipped, mean_interval
from bench.catalogue.metrics import value_range

OVERALL = "all conditions"


def over_conditions(compared: Sequence[Comparison]) -> Comparison:
    """Return the comparison by each object's mean over conditions, on objects that all have.

    Costs are those of the first condition. Image metrics only.
    """
    shared = sorted(set.intersection(*(set(c.objects) for c in compared)))
    places = [[c.objects.index(name) for name in shared] for c in compared]
    first = compared[0]
    methods = [m for m in first.images if all(m in c.images for c in compared)]

    def quality(metric: str, method: str) -> Quality:
        stacked = np.array(
            [
                c.qualities[metric][method].per_object[at]
                for c, at in zip(compared, places, strict=True)
            ]
        )
        per_object = stacked.mean(axis=0)  # NaN where any condition has no value
        known = per_object[~np.isnan(per_object)]
        value = float(known.mean()) if len(known) else math.nan
        interval = clipped(mean_interval(known), value_range(metric))
        return Quality(metric, Estimate(value, *interval), per_object, method)

    return replace(
        first,
        condition=OVERALL,
        objects=tuple(shared),
        prepare_s={m: first.prepare_s[m][places[0]] for m in methods},
        draw_s={m: first.draw_s[m][places[0]] for m in methods},
        images={
            m: (sum(c.images[m][0] for c in compared), sum(c.images[m][1] for c in compared))
            for m in methods
        },
        qualities={
            metric: {method: quality(metric, method) for method in methods}
            for metric in first.qualities
        },
    )


def mean_places(
    columns: Sequence[tuple[str, Mapping[str, float]]], ids: Mapping[str, str]
) -> dict[str, float]:
    """Return the mean place of each method that has one, 1 for one that is always the best.

    A column is a metric with its values by name, which are compared in the digits that both are
    printed with; `ids` has the methods of the names that compete. A place among fewer methods is
    stretched to all that have one.
    """
    places: dict[str, list[float]] = {}
    for metric, of_column in columns:
        known = {name: of_column[name] for name in ids if name in of_column}
        for name, value in known.items():
            balance = [
                prints_better(metric, other, value, ids[name], ids[rival])
                - prints_better(metric, value, other, ids[name], ids[rival])
                for rival, other in known.items()
            ]
            # Those that print equal share their places.
            others = len(known) - 1
            places.setdefault(name, []).append((others + sum(balance)) / 2 / max(others, 1))
    return {m: 1 + (len(places) - 1) * float(np.mean(p)) for m, p in places.items()}
