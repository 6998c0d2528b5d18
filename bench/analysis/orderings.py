"""The paper's orderings in Table 5 on a run: SR or pc2pix, class by class.

The paper has PC2PIX ahead in 11 of 13 classes and on average, SR in rifle and lamp, by FID.
"""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from bench.analysis.comparison import NAN, Estimate
from bench.analysis.intervals import SIGNIFICANCE
from bench.analysis.paired import CELL, LEAD, better_by, verdicts_of, who_is_ahead
from bench.analysis.paper import AVERAGE, SURFACE, Published, network_of, paper_difference
from bench.analysis.scored_run import Run
from bench.catalogue.metrics import is_mean

VERDICTS = ("reproduced", "opposite", "undecided", "no value")
ORDERINGS = [
    *("condition", "class", "metric", "method", "surface", "network"),
    *("lead", "ci_low", "ci_high", "paper_lead", "verdict", "objects"),
]


def orderings(run: Run, published: Published) -> pd.DataFrame:
    """Return the orderings by all metrics of Table 5 that both sides have; none without a side.

    Kernel distances are left out: they say what the Fréchet distance on the same features says.

    It has a row for each class, and last for the mean over those in which both have a value, by
    condition and metric: `method` (the network that stands for the paper's PC2PIX), the values of
    `surface` and `network`, failed images scored as blank ones; `lead` (how much better the network
    is, paired over `objects`) with `ci_low` and `ci_high`, the interval that decides; `paper_lead`
    (the same by FID as the paper printed it; NaN where it has no such class) and `verdict`.
    """
    methods = list(dict.fromkeys(method for method, _, _ in run.cells))
    network = network_of(methods)
    if network is None or SURFACE not in methods:
        return pd.DataFrame(columns=ORDERINGS)
    wanted = run.suite.class_metrics
    metrics = [metric for metric in wanted if metric in run.features]
    metrics += [m for m in wanted if is_mean(m) and run.has(m)]
    both = (SURFACE, network)
    verdicts = verdicts_of(run, metrics, both)
    compared = run.compared(metrics, both)
    counts, conditions = run.objects_of, compared["condition"].nunique()
    rows = []
    for (condition, metric), cells in compared.groupby(["condition", "metric"], sort=False):
        surface, ours = (cells[cells["method"] == method].to_dict("records") for method in both)
        differences = (verdicts.difference(*both, *(row[name] for name in CELL)) for row in ours)
        leads = [Estimate(*(difference[end] for end in LEAD)) for difference in differences]
        values = [(sr["value"], row["value"]) for sr, row in zip(surface, ours, strict=True)]
        known = [i for i, lead in enumerate(leads) if math.isfinite(lead.value)]
        mean, lead = (NAN, NAN), Estimate(NAN, NAN, NAN)
        if known:
            family = conditions * (len(run.headline) if metric in run.headline else 1)
            both_known = better_by([ours[i] for i in known], [surface[i] for i in known])
            mean = tuple(np.mean([values[i] for i in known], axis=0))
            lead = both_known.estimate(SIGNIFICANCE / family)
        classes = [*(row["class"] for row in ours), AVERAGE]
        objects = [*(counts[row["class"]] for row in ours), sum(counts.values())]
        of_classes = zip(classes, [*values, mean], [*leads, lead], objects, strict=True)
        for class_name, of_both, lead, count in of_classes:
            paper = paper_difference(published, class_name)
            verdict = verdict_of(lead, paper)
            rows.append(
                (condition, class_name, metric, network, *of_both, *lead, paper, verdict, count)
            )
    return pd.DataFrame(rows, columns=ORDERINGS)


def verdict_of(lead: Estimate, paper_lead: float) -> str:
    """Return whether the paper's ordering holds; undecided where the interval holds 0."""
    if not (math.isfinite(lead.value) and math.isfinite(paper_lead)):
        return "no value"
    ahead = who_is_ahead(lead)
    if ahead not in ("a", "b"):
        return "undecided"
    return "reproduced" if (ahead == "b") == (paper_lead > 0) else "opposite"
