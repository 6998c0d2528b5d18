"""The paper's orderings in Table 5 on a run: SR or pc2pix, class by class.

The paper has PC2PIX ahead in 11 of 13 classes and on average, SR in rifle and lamp, by FID.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from bench.analysis.comparison import NAN, Estimate, Row
from bench.analysis.intervals import SIGNIFICANCE
from bench.analysis.paired import CELL, LEAD, better_by, verdicts_of
from bench.analysis.paper import AVERAGE, SURFACE, Published, network_of, paper_difference
from bench.analysis.scored_run import Run
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
    compared = run.compared(metrics, both)
    counts, conditions = run.objects_of, compared["condition"].nunique()

    def of_class(surface: Row, ours: Row) -> Ordering:
        cell = (ours[name] for name in CELL)
        lead = verdicts.difference(SURFACE, network, *cell)
        return Ordering(
            ours["condition"],
            ours["class"],
            ours["metric"],
            surface["value"],
            ours["value"],
            Estimate(*(lead[end] for end in LEAD)),
            paper_difference(published, ours["class"]),
            counts[ours["class"]],
            network,
        )

    rows = []
    for (condition, metric), cells in compared.groupby(["condition", "metric"], sort=False):
        surface, ours = (cells[cells["method"] == method].to_dict("records") for method in both)
        of_classes = list(map(of_class, surface, ours))
        # Of the classes in which both have a value.
        known = [i for i, row in enumerate(of_classes) if math.isfinite(row.difference.value)]
        family = conditions * (len(run.headline) if metric in run.headline else 1)
        lead = Estimate(NAN, NAN, NAN)
        if known:
            both_known = better_by([ours[i] for i in known], [surface[i] for i in known])
            lead = both_known.estimate(SIGNIFICANCE / family)
        average = Ordering(
            str(condition),
            AVERAGE,
            str(metric),
            _mean([of_classes[i].surface for i in known]),
            _mean([of_classes[i].network for i in known]),
            lead,
            paper_difference(published, AVERAGE),
            sum(counts.values()),
            network,
        )
        rows += [*of_classes, average]
    return rows


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else NAN
