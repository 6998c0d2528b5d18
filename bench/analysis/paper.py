"""The paper's methods, values and orderings, as runs are set against them.

In its Table 5 the paper has PC2PIX ahead in 11 of 13 classes and on average, and SR in rifle and
lamp, by FID.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd

from bench.analysis.compare import NAN, Estimate, Row, compared
from bench.analysis.differences import better_by, lead_of, verdicts_of, who_is_ahead
from bench.analysis.intervals import SIGNIFICANCE
from bench.analysis.run import Run
from bench.catalogue.lookup import family_of
from bench.catalogue.metrics import is_mean

# Published values by (class, metric, condition, method).
Published = Mapping[tuple[str, str, str, str], float]

SURFACE = "surface-apss"  # stands for the paper's SR (surface reconstruction)
NETWORK = "pc2pix"  # the first variant of it in a run stands for the paper's PC2PIX
PAPER_NETWORK = "pc2pix@all"  # the published PC2PIX of Table 5: one network for all classes
PAPER_METRIC = "fid"  # the metric of the paper's Table 5
# The methods of the paper's Tables 3 and 4, by the heads that their columns have in our tables.
PAPER_METHODS = {SURFACE: "SR", NETWORK: "PC2PIX", "pc2pix@acgan": "PC2PIX@acgan"}
AVERAGE = "average"  # the mean over classes, each counting alike


def network_of(methods: Iterable[str]) -> str | None:
    """Return the method that stands for the paper's PC2PIX; None where no variant was measured."""
    return next((method for method in methods if family_of(method) == NETWORK), None)


def published_value(
    published: Published, class_name: str, metric: str, condition: str, method: str
) -> float:
    """Return the paper's value of a method; NaN where it has none.

    A variant of a network that the paper does not have takes the value of the network itself.
    """
    of_method = published.get((class_name, metric, condition, method))
    if of_method is not None:
        return of_method
    return published.get((class_name, metric, condition, family_of(method)), NAN)


def paper_difference(published: Published, class_name: str) -> float:
    """Return by how much the paper's PC2PIX is better than its SR by FID; NaN without the class."""
    criterion = (class_name, PAPER_METRIC, "2048")
    surface = published.get((*criterion, SURFACE), NAN)
    network = published.get((*criterion, PAPER_NETWORK), NAN)
    return surface - network


VERDICTS = ("reproduced", "opposite", "undecided", "no value")
ORDERINGS = [
    "condition",
    "class",
    "metric",
    "method",
    "surface",
    "network",
    "lead",
    "ci_low",
    "ci_high",
    "paper_lead",
    "verdict",
    "objects",
]


def orderings(run: Run, published: Published) -> pd.DataFrame:
    """Return which of SR and pc2pix is better in each class, by the metrics of Table 5.

    Without rows for a run that lacks one of the two. Kernel distances are left out: they say what
    the Fréchet distance on the same features says.

    It has a row for each condition, metric and class, and below the classes one for the mean over
    those in which both have a value: `condition`, `class`, `metric`, `method` (the network that
    stands for the paper's PC2PIX); `surface` and `network` (the values of the two, failed images
    scored as blank ones); `lead` (how much better the network is, paired object by object) with
    `ci_low` and `ci_high`, the interval that decides; `paper_lead` (how much better by FID in the
    paper; NaN where it has no such class); `verdict` (one of VERDICTS) and `objects` (how many the
    class has).
    """
    methods = list(dict.fromkeys(method for method, _, _ in run.image_sets))
    network = network_of(methods)
    if network is None or SURFACE not in methods:
        return pd.DataFrame(columns=ORDERINGS)
    wanted = run.suite.class_metrics
    metrics = [metric for metric in wanted if metric in run.features]
    metrics += [metric for metric in wanted if is_mean(metric) and run.has(metric)]
    both = (SURFACE, network)
    verdicts = verdicts_of(run, metrics, both)
    of_both = compared(run, metrics, both)
    counts, conditions = run.objects_of, of_both["condition"].nunique()
    rows = []
    for (condition, metric), by_class in of_both.groupby(["condition", "metric"], sort=False):
        surface, ours = (by_class[by_class["method"] == m].to_dict("records") for m in both)
        leads = []
        for row in ours:
            at = (row["metric"], row["condition"], row["class"])
            leads.append(lead_of(verdicts.difference(*both, *at)))
        values = [(sr["value"], row["value"]) for sr, row in zip(surface, ours, strict=True)]
        # The mean over classes is one criterion by each metric at each condition. It is corrected
        # for these: the metrics of the headline together, each other metric alone.
        corrected_for = conditions * (len(run.headline) if metric in run.headline else 1)
        mean, mean_lead = _mean_over_classes(surface, ours, leads, SIGNIFICANCE / corrected_for)
        classes = [*(row["class"] for row in ours), AVERAGE]
        objects = [*(counts[row["class"]] for row in ours), sum(counts.values())]
        of_classes = zip(classes, [*values, mean], [*leads, mean_lead], objects, strict=True)
        for class_name, (of_surface, of_network), lead, count in of_classes:
            paper_lead = paper_difference(published, class_name)
            rows.append(
                {
                    "condition": condition,
                    "class": class_name,
                    "metric": metric,
                    "method": network,
                    "surface": of_surface,
                    "network": of_network,
                    "lead": lead.value,
                    "ci_low": lead.low,
                    "ci_high": lead.high,
                    "paper_lead": paper_lead,
                    "verdict": verdict_of(lead, paper_lead),
                    "objects": count,
                }
            )
    return pd.DataFrame(rows, columns=ORDERINGS)


def _mean_over_classes(
    surface: Sequence[Row], ours: Sequence[Row], leads: Sequence[Estimate], alpha: float
) -> tuple[tuple[float, float], Estimate]:
    """Return the means of both values, and of the lead, over the classes that have a lead."""
    known = [number for number, lead in enumerate(leads) if math.isfinite(lead.value)]
    if not known:
        return (NAN, NAN), Estimate(NAN, NAN, NAN)
    of_surface, of_network = [surface[i] for i in known], [ours[i] for i in known]
    values = [(sr["value"], row["value"]) for sr, row in zip(of_surface, of_network, strict=True)]
    mean_surface, mean_network = np.mean(values, axis=0)
    lead = better_by(of_network, of_surface).estimate(alpha)
    return (float(mean_surface), float(mean_network)), lead


def verdict_of(lead: Estimate, paper_lead: float) -> str:
    """Return whether a lead has the sign of the paper's, as one of VERDICTS.

    "undecided" where the interval of the lead holds 0.
    """
    if not (math.isfinite(lead.value) and math.isfinite(paper_lead)):
        return "no value"
    ahead = who_is_ahead(lead)
    if ahead not in ("a", "b"):
        return "undecided"
    return "reproduced" if (ahead == "b") == (paper_lead > 0) else "opposite"
