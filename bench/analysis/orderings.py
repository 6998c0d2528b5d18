"""The paper's orderings in Table 5 on a run: SR or pc2pix, class by class.

The paper has PC2PIX ahead in 11 of 13 classes and on average, SR in rifle and lamp, by FID.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from bench.analysis.comparison import NAN, Comparison, Estimate, class_mean_difference
from bench.analysis.frame import Run
from bench.analysis.intervals import SIGNIFICANCE
from bench.analysis.paired import verdicts_of
from bench.analysis.paper import AVERAGE, SURFACE, Published, network_of, paper_difference
from bench.catalogue.metrics import is_mean

Verdict = Literal["reproduced", "opposite", "undecided", "no value"]
VERDICTS: tuple[Verdict, ...] = ("reproduced", "opposite", "undecided", "no value")


@dataclass(frozen=True)
class Ordering:
    """SR against the network in one class by one metric.

    surface, network  their values, failed images scored as blank ones
    difference        how much better the network is, paired over objects: over 0 if it is; with the
                      interval that decides
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


def orderings(run: Run, published: Published) -> list[Ordering]:
    """Return the orderings by all metrics of Table 5 that both sides have; none without a side.

    Kernel distances are left out: they say what the Fréchet distance on the same features says.
    """
    methods = list(dict.fromkeys(method for method, _, _ in run.cells))
    network = network_of(methods)
    if network is None or SURFACE not in methods:
        return []
    wanted = run.suite.class_metrics
    metrics = [metric for metric in wanted if metric in run.features]
    metrics += [m for m in wanted if is_mean(m) and run.has(m)]
    both = (SURFACE, network)
    verdicts = verdicts_of(run, metrics, both)
    by_condition: dict[str, list[Comparison]] = {}
    for comparison in run.compared(metrics, both):
        by_condition.setdefault(comparison.condition, []).append(comparison)
    counts = run.objects_of

    def of_class(metric: str, c: Comparison) -> Ordering:
        surface, ours = (c.qualities[metric][method].estimate.value for method in both)
        cell = metric, c.condition, c.class_name
        return Ordering(
            c.condition,
            c.class_name,
            metric,
            surface,
            ours,
            verdicts.difference(SURFACE, network, *cell).lead,
            paper_difference(published, c.class_name),
            counts[c.class_name],
            network,
        )

    rows = []
    for condition, classes in by_condition.items():
        for metric in metrics:
            of_classes = [of_class(metric, c) for c in classes]
            # Of the classes in which both have a value.
            known = [row for row in of_classes if math.isfinite(row.difference.value)]
            names = {row.class_name for row in known}
            at = [c.qualities[metric] for c in classes if c.class_name in names]
            sides = ([by_method[method] for by_method in at] for method in (network, SURFACE))
            cells = len(by_condition) * (len(run.headline) if metric in run.headline else 1)
            lead = Estimate(NAN, NAN, NAN)
            if known:
                lead, _ = class_mean_difference(*sides, alpha=SIGNIFICANCE / cells)
            average = Ordering(
                condition,
                AVERAGE,
                metric,
                _mean([row.surface for row in known]),
                _mean([row.network for row in known]),
                lead,
                paper_difference(published, AVERAGE),
                sum(counts.values()),
                network,
            )
            rows += [*of_classes, average]
    return rows


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else NAN
