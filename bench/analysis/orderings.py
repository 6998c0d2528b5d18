"""The paper's orderings in Table 5 on a run: SR or pc2pix, class by class.

The paper has PC2PIX ahead in 11 of 13 classes and on average, SR in rifle and lamp, by FID.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from bench.analysis.comparison import (
    NAN,
    Comparison,
    Estimate,
    better_by,
    class_mean_difference,
)
from bench.analysis.paper import AVERAGE, SURFACE, Published, network_of, paper_difference
from bench.analysis.scored import ScoredRun
from bench.catalogue.metrics import is_mean

Verdict = Literal["reproduced", "opposite", "undecided", "no value"]
VERDICTS: tuple[Verdict, ...] = ("reproduced", "opposite", "undecided", "no value")


@dataclass(frozen=True)
class Ordering:
    """SR against the network in one class by one metric.

    surface, network  their values, failed images scored as blank ones
    difference        how much better the network is, paired over objects: over 0 if it is
    paper_difference  the same by FID as the paper printed it; NaN where it has no such class
    objects           number of objects of the class
    method            the network that stands for the paper's PC2PIX
    """

    condition: str
    class_name: str
    metric: str
    surface: float
    network: float
    difference: Estimate
    paper_difference: float
    objects: int
    method: str

    @property
    def verdict(self) -> Verdict:
        """Return whether the paper's ordering holds; undecided where the interval holds 0."""
        value, low, high = self.difference
        if not (math.isfinite(value) and math.isfinite(self.paper_difference)):
            return "no value"
        if low > 0 or high < 0:
            return "reproduced" if (low > 0) == (self.paper_difference > 0) else "opposite"
        return "undecided"


def orderings(run: ScoredRun, published: Published) -> list[Ordering]:
    """Return the orderings by all metrics of Table 5 that both sides have; none without a side.

    Kernel distances are left out: they say what the Fréchet distance on the same features says.
    """
    methods = list(dict.fromkeys(method for method, _, _ in run.sums.cells))
    network = network_of(methods)
    if network is None or SURFACE not in methods:
        return []
    wanted = run.suite.class_metrics
    metrics = [metric for metric in wanted if metric in run.features]
    metrics += [m for m in wanted if is_mean(m) and m in run.sums.metrics]
    counts = run.sums.objects_of
    by_condition: dict[str, list[Comparison]] = {}
    for comparison in run.compared(metrics, (SURFACE, network)):
        by_condition.setdefault(comparison.condition, []).append(comparison)
    return [
        row
        for classes in by_condition.values()
        for metric in metrics
        for row in _of_classes(classes, metric, network, counts, published)
    ]


def _of_classes(
    classes: Sequence[Comparison],
    metric: str,
    network: str,
    counts: dict[str, int],
    published: Published,
) -> list[Ordering]:
    """Return the orderings of each class and of the average over them."""
    qualities = [(c.qualities[metric][network], c.qualities[metric][SURFACE]) for c in classes]
    condition = classes[0].condition
    rows = [
        Ordering(
            condition,
            c.class_name,
            metric,
            b.estimate.value,
            a.estimate.value,
            better_by(a, b),
            paper_difference(published, c.class_name),
            counts[c.class_name],
            network,
        )
        for c, (a, b) in zip(classes, qualities, strict=True)
    ]
    difference, _ = class_mean_difference(*map(list, zip(*qualities, strict=True)))
    average = Ordering(
        condition,
        AVERAGE,
        metric,
        _mean([row.surface for row in rows]),
        _mean([row.network for row in rows]),
        # Of the classes that have a value, as the table of classes has it.
        difference._replace(value=_mean([row.difference.value for row in rows])),
        paper_difference(published, AVERAGE),
        sum(counts.values()),
        network,
    )
    return [*rows, average]


def _mean(values: Sequence[float]) -> float:
    finite = [value for value in values if math.isfinite(value)]
    return sum(finite) / len(finite) if finite else NAN
