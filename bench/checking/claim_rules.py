"""How a claim of the paper is tested on a run: evidence, rules, findings. Pure functions.

A finding is `supported` only where a 95 % interval over objects lies wholly on the claimed side;
where it holds 0, so many objects cannot tell, which is no support, and the reason says so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analysis.comparison import Comparison, Estimate, Quality, decimals
from bench.analysis.intervals import interval_of_means, jackknife_interval, mean_interval
from bench.catalogue.metrics import higher_is_better, is_mean
from bench.tables.classes import NETWORK, SURFACE
from bench.tables.orderings import Ordering
from bench.tables.table import Table

Floats = NDArray[np.float64]
Verdict = Literal["supported", "not supported", "not testable here"]
Ahead = Literal["surface", "network", "equal", "undecided"]
FULL = "2048"
CHAIR = "chair"
EQUAL = 0.01  # what two scores that are printed alike, with two decimals, differ by at most
SHARE = 0.1  # of reconstruction's loss: the paper's network loses 0.01 SSIM where SR loses 0.40
DISTANCES = ("fid", "fd-views")  # the first that a run has; the second stands in for the first
CONFIDENCE = "class-confidence"


@dataclass(frozen=True)
class Finding:
    """What a run says about a claim.

    subject  the method that the claim is about
    numbers  ours, with intervals
    reason   why not, or what has to be known with it; may be empty
    """

    subject: str
    verdict: Verdict
    numbers: str
    reason: str = ""


class Lacking(Exception):
    """A run of the right suite does not have what the claim needs."""


@dataclass(frozen=True, eq=False)
class Scored:
    """A run whose images were scored.

    comparisons  by condition and class
    orderings    of Table 5; None for runs without
    spreads      by class, how much true objects differ: the value, and without each object
    """

    comparisons: Mapping[tuple[str, str], Comparison]
    orderings: Table[Ordering] | None
    spreads: Mapping[str, tuple[float, Floats]]

    @property
    def networks(self) -> list[str]:
        """The variants of pc2pix in the run."""
        of_all = next(iter(self.comparisons.values())).images
        found = [m for m in of_all if m.partition("@")[0] == NETWORK]
        if not found:
            raise Lacking(f"the run has no {NETWORK}")
        return found

    def quality(self, metric: str, method: str, condition: str, class_name: str) -> Quality:
        """A metric of a method in one cell. Raises Lacking where it was not measured."""
        cell = self.comparisons.get((condition, class_name))
        if cell is None:
            raise Lacking(f"the run has no {class_name} at {condition}")
        of_metric = cell.qualities.get(metric, {})
        if method not in of_metric:
            raise Lacking(f"the run has no {metric} of {method}")
        return of_metric[method]

    @property
    def distance(self) -> str:
        """The Fréchet distance that the run has."""
        measured = next(iter(self.comparisons.values())).qualities
        return next((metric for metric in DISTANCES if metric in measured), DISTANCES[0])


# Of `speed` the samples, as in `tables/speed_samples.csv`; of `latent` the means of both tables.
Evidence = Scored | pd.DataFrame


# --- chairs, condition by condition ---------------------------------------------------------------


def ordering(run: Scored, metric: str, condition: str, ahead: Ahead) -> list[Finding]:
    """Who is ahead on chairs: SR, the network, or neither, by more than `EQUAL`."""
    metric = _measured(run, metric)
    found = []
    for network in run.networks:
        a, b = (run.quality(metric, m, condition, CHAIR) for m in (network, SURFACE))
        lead = _lead(a, b)
        numbers = _compared(metric, a.estimate.value, "SR", b.estimate.value, "ahead", lead)
        found.append(_judged(network, numbers, lead, ahead, _stand_in(metric)))
    return found


def steady(run: Scored, metric: str, conditions: Sequence[str]) -> list[Finding]:
    """The network loses less than `SHARE` of what SR loses against the full cloud, at each."""
    metric = _measured(run, metric)
    found = []
    for network in run.networks:
        texts, excesses = [], []
        for condition in conditions:
            own, others = (_loss(run, metric, m, condition) for m in (network, SURFACE))
            excesses.append(combined([*own, *((-SHARE * w, q) for w, q in others)]))
            texts.append(
                f"{condition}: loses {_text(metric, combined(own))}, "
                f"SR {_text(metric, combined(others))}"
            )
        holds = all(excess.high < 0 for excess in excesses)
        why = f"not surely less than {SHARE:.0%} of SR's loss at each"
        numbers = "; ".join([metric, *texts])
        found.append(_finding(network, numbers, excesses, holds, why, _stand_in(metric)))
    return found


def degrades(run: Scored, metric: str, conditions: Sequence[str]) -> list[Finding]:
    """SR loses against the full cloud, at each of the conditions."""
    metric = _measured(run, metric)
    losses = {c: combined(_loss(run, metric, SURFACE, c)) for c in conditions}
    numbers = "; ".join(f"{c}: loses {_text(metric, loss)}" for c, loss in losses.items())
    holds = all(loss.low > 0 for loss in losses.values())
    intervals, why = [*losses.values()], "not surely at each"
    return [_finding(SURFACE, f"{metric}; {numbers}", intervals, holds, why, _stand_in(metric))]


def above_blank(run: Scored) -> list[Finding]:
    """The network's images are nearer to the truth than white ones, by SSIM and by distance."""
    found = []
    for network in run.networks:
        leads = {
            metric: _lead(*(run.quality(metric, m, FULL, CHAIR) for m in (network, "blank")))
            for metric in ("ssim", run.distance)
        }
        numbers = "; ".join(f"{m}: ahead by {_text(m, lead)}" for m, lead in leads.items())
        lacking = [m for m, lead in leads.items() if not lead.low > 0]
        why = f"not surely ahead of a blank picture by {', '.join(lacking)}"
        found.append(_finding(network, numbers, [*leads.values()], not lacking, why))
    return found


# --- classes --------------------------------------------------------------------------------------


def class_ordering(
    run: Scored, class_name: str, ahead: Ahead, metric: str | None = None
) -> list[Finding]:
    """Who is ahead in one class, or on average; by the run's distance without another metric."""
    row = _ordering(run, metric or run.distance, class_name)
    numbers = _compared(row.metric, row.network, "SR", row.surface, "ahead", row.lead)
    return [_judged(row.method, numbers, row.lead, ahead, _stand_in(row.metric))]


def unrecognisable(run: Scored) -> list[Finding]:
    """The classifier gives the true class less to SR's images than to true ones."""
    pairs = [
        [run.quality(CONFIDENCE, m, FULL, name) for m in ("true-mesh", SURFACE)]
        for condition, name in run.comparisons
        if condition == FULL
    ]
    lost = [true.per_object - drawn.per_object for true, drawn in pairs]
    estimate = Estimate(float(np.mean([x.mean() for x in lost])), *interval_of_means(lost))
    true, drawn = (np.mean([pair[i].estimate.value for pair in pairs]) for i in (0, 1))
    numbers = (
        f"{CONFIDENCE} {drawn:.3f}, true pictures {true:.3f}; loses {_text(CONFIDENCE, estimate)}"
    )
    return [_judged(SURFACE, numbers, estimate, "network", "")]


def gains_from_others(run: Scored, alone: str, together: str) -> list[Finding]:
    """Chairs: the network of all classes is nearer to the truth than that of chairs alone."""
    metric = run.distance
    a, b = (run.quality(metric, m, FULL, CHAIR) for m in (alone, together))
    gain = _lead(b, a)
    numbers = _compared(metric, b.estimate.value, "alone", a.estimate.value, "better", gain)
    return [_judged(together, numbers, gain, "network", _stand_in(metric))]


def good_where_thin(run: Scored, thin: Sequence[str]) -> list[Finding]:
    """SR's distance is smaller in these classes than in the mean of the others."""
    metric = run.distance
    names = [name for condition, name in run.comparisons if condition == FULL]
    if lacking := [name for name in thin if name not in names]:
        raise Lacking(f"the run has no {', '.join(lacking)}")
    groups = [[n for n in names if (n in thin) == inside] for inside in (True, False)]
    if not groups[1]:
        raise Lacking("the run has no other class")
    values, variance = [], 0.0
    for group in groups:
        of = [run.quality(metric, SURFACE, FULL, name) for name in group]
        value = float(np.mean([q.estimate.value for q in of]))
        _, high = jackknife_interval(value, [q.per_object for q in of])
        values.append(value)
        variance += (high - value) ** 2
    gap, reach = values[1] - values[0], math.sqrt(variance)
    estimate = Estimate(gap, gap - reach, gap + reach)
    numbers = _compared(metric, values[0], "others", values[1], "nearer", estimate)
    return [_judged(SURFACE, numbers, estimate, "network", _stand_in(metric))]


def varies_more(run: Scored, more: str, less: str) -> list[Finding]:
    """True objects of one class differ more than those of another, in the features' own units."""
    if lacking := [name for name in (more, less) if name not in run.spreads]:
        raise Lacking(f"the run has no features of {', '.join(lacking)}")
    (a, without_a), (b, without_b) = run.spreads[more], run.spreads[less]
    reach = math.hypot(
        *(jackknife_interval(v, [w])[1] - v for v, w in ((a, without_a), (b, without_b)))
    )
    estimate = Estimate(a - b, a - b - reach, a - b + reach)
    by_spread = sorted(run.spreads, key=lambda name: -run.spreads[name][0])
    numbers = (
        f"variance between objects {a:.2f}, {less} {b:.2f}; more by {_text('fd-views', estimate)}; "
        f"{more} is number {by_spread.index(more) + 1} of {len(by_spread)}"
    )
    return [_judged("true pictures", numbers, estimate, "network", "")]


# --- speed ----------------------------------------------------------------------------------------


def faster(samples: pd.DataFrame, times: float) -> list[Finding]:
    """An image of the network costs less than one over `times` of one of SR, preparing included.

    On one thread, cloud by cloud: the interval is over clouds.
    """
    costs = _costs(samples)
    networks = [m for m in costs if m.partition("@")[0] == NETWORK]
    if SURFACE not in costs or not networks:
        raise Lacking(f"the run has no times of {SURFACE if SURFACE not in costs else NETWORK}")
    found = []
    for network in networks:
        ratio = np.log(costs[SURFACE] / costs[network])
        middle, (low, high) = ratio.mean(), mean_interval(ratio)
        estimate = Estimate(*map(float, np.exp([middle, low, high])))
        numbers = f"{estimate.value:.1f} times [{estimate.low:.1f}, {estimate.high:.1f}]"
        holds = estimate.low > times
        why = f"not surely more than {times:g} times"
        found.append(_finding(network, numbers, [estimate], holds, why))
    return found


def _costs(samples: pd.DataFrame) -> dict[str, Floats]:
    """Seconds an image [clouds] by method: medians of preparing a cloud and of its views."""
    warm = samples[(samples["round"] > 0) & (samples["threads"] == 1)]
    warm = warm[warm["condition"].astype(str) == FULL]
    made = {}
    for method, of in warm.groupby("method", sort=False):
        views = of["views"].max()
        parts = [of[of["stage"] == "prepare"], of[(of["stage"] == "draw") & (of["views"] == views)]]
        prepare, draw = (part.groupby("cloud")["wall_s"].median() for part in parts)
        made[str(method)] = ((prepare + draw) / views).to_numpy(np.float64)
    return made


# --- latent ---------------------------------------------------------------------------------------


def mean_above(
    means: pd.DataFrame, metric: str, what: str, than: str | None = None
) -> list[Finding]:
    """A mean of the suite `latent` is surely above another one's, or above 0 without another.

    Two means are compared by their intervals, which must not touch: they are not paired.
    """
    rows = means[(means["metric"] == metric) & (means["kind"] == "all")]
    found = []
    for method in dict.fromkeys(rows["method"]):
        at = rows[rows["method"] == method].set_index("what")
        if lacking := [w for w in (what, than) if w is not None and w not in at.index]:
            raise Lacking(f"the run has no {metric} of {', '.join(lacking)}")
        own = _estimate(at, what)
        numbers, bar = f"{metric} of {what} {_figures(own)}", 0.0
        if than is not None:
            other = _estimate(at, than)
            numbers, bar = f"{numbers}, of {than} {_figures(other)}", other.high
        holds = own.low > bar
        why = "not surely above it" if than else "not surely above 0"
        found.append(_finding(str(method), numbers, [own], holds, why))
    return found


def _estimate(rows: pd.DataFrame, what: str) -> Estimate:
    return Estimate(*(float(rows.loc[what, c]) for c in ("value", "ci_low", "ci_high")))  # type: ignore[arg-type]


# --- in common ------------------------------------------------------------------------------------


def combined(terms: Sequence[tuple[float, Quality]]) -> Estimate:
    """A weighted sum of one metric over methods and conditions, paired object by object.

    With the intervals of `bench.analysis.intervals`.
    """
    value = float(sum(weight * quality.estimate.value for weight, quality in terms))
    per_object = np.sum([weight * quality.per_object for weight, quality in terms], axis=0)
    if is_mean(terms[0][1].metric):
        return Estimate(value, *mean_interval(per_object))
    return Estimate(value, *jackknife_interval(value, [per_object]))


def _lead(a: Quality, b: Quality) -> Estimate:
    """How much better a is than b."""
    sign = 1 if higher_is_better(a.metric) else -1
    return combined([(sign, a), (-sign, b)])


def _loss(run: Scored, metric: str, method: str, condition: str) -> list[tuple[float, Quality]]:
    """The terms of how much worse a method is at a condition than with the full cloud."""
    sign = 1.0 if higher_is_better(metric) else -1.0
    full, less = (run.quality(metric, method, c, CHAIR) for c in (FULL, condition))
    return [(sign, full), (-sign, less)]


def _ordering(run: Scored, metric: str, class_name: str) -> Ordering:
    if run.orderings is None:
        raise Lacking("the run has not both SR and pc2pix")
    for row in run.orderings.rows:
        if (row.condition, row.class_name, row.metric) == (FULL, class_name, metric):
            return row
    raise Lacking(f"the run has no {metric} of class {class_name} at {FULL}")


def _judged(subject: str, numbers: str, lead: Estimate, ahead: Ahead, remark: str) -> Finding:
    """By the interval of how much the network is ahead."""
    before, behind = lead.low > 0, lead.high < 0
    between = "the interval holds 0"
    match ahead:
        case "network":
            holds, why = before, "the other way round" if behind else between
        case "surface":
            holds, why = behind, "the other way round" if before else between
        case "equal":
            holds = lead.low >= -EQUAL and lead.high <= EQUAL
            why = f"not surely within {EQUAL} of each other"
        case "undecided":
            holds, why = not before and not behind, "the interval does not hold 0"
    return _finding(subject, numbers, [lead], holds, why, remark)


def _finding(
    subject: str,
    numbers: str,
    intervals: Sequence[Estimate],
    holds: bool,
    why: str,
    remark: str = "",
) -> Finding:
    """The verdict, with the reason `why` where it does not hold; none without an interval."""
    if not all(math.isfinite(estimate.low) for estimate in intervals):
        return Finding(subject, "not testable here", numbers, "too few objects for an interval")
    verdict: Verdict = "supported" if holds else "not supported"
    reasons = ("" if holds else why, remark)
    return Finding(subject, verdict, numbers, "; ".join(filter(None, reasons)))


def _measured(run: Scored, metric: str) -> str:
    return run.distance if metric in DISTANCES else metric


def _stand_in(metric: str) -> str:
    return f"{metric} stands in for {DISTANCES[0]}" if metric == DISTANCES[1] else ""


def _compared(metric: str, own: float, other: str, value: float, how: str, lead: Estimate) -> str:
    digits = decimals(metric)
    values = f"{metric} {own:.{digits}f}, {other} {value:.{digits}f}"
    return f"{values}; {how} by {_text(metric, lead)}"


def _text(metric: str, estimate: Estimate) -> str:
    digits = decimals(metric)
    value, low, high = (f"{number:+.{digits}f}" for number in estimate)
    return f"{value} [{low}, {high}]"


def _figures(estimate: Estimate) -> str:
    return f"{estimate.value:.3g} [{estimate.low:.3g}, {estimate.high:.3g}]"
