"""How a claim of the paper is tested on a run: evidence, rules, findings. Pure functions.

A claim holds where everything that it requires is over 0. It is `supported` where all 95 %
intervals over objects are above 0, `contradicted` where one is below, and `undecided` where so
many objects cannot tell. What is smaller than the spread between trainings of the network is a tie:
undecided, too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd

from bench.analysis.comparison import Comparison, Estimate, Quality, decimals, lead_over_classes
from bench.analysis.intervals import (
    StandardError,
    interval_of_means,
    jackknife_error,
    mean_error,
    sum_error,
)
from bench.analysis.paired import SIGNIFICANCE, holm
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import FLOORS
from bench.catalogue.metrics import higher_is_better, is_mean
from bench.tables.classes import AVERAGE, NETWORK, SURFACE
from data_prep.arrays import Floats

Verdict = Literal["supported", "contradicted", "undecided", "not testable here"]
VERDICTS: tuple[Verdict, ...] = ("supported", "contradicted", "undecided", "not testable here")
Ahead = Literal["surface", "network", "equal", "undecided"]
FULL = "2048"
CHAIR = "chair"
EQUAL = 0.01  # what two scores that are printed alike, with two decimals, differ by at most
SHARE = 0.1  # of reconstruction's loss: the paper's network loses 0.01 SSIM where SR loses 0.40
DISTANCES = ("fid", "fd-views")  # the first that a run has; the second stands in for the first
CONFIDENCE = "class-confidence"
RETRIEVAL = "retrieval"
RECOGNISABLE = ("ssim", "lpips")  # by which an image has to be better than what sees no cloud
PAPER_WIDTH = 1.0  # of the networks, in widths of the paper's


class Requirement(NamedTuple):
    """Something that has to be over 0 for a claim to hold.

    estimate  with its 95 % interval over objects; NaN where there are too few
    error     of the estimate; None where there are too few
    objects   how many
    spread    from the lowest to the highest of several trainings of the network, which differ in
              their seeds; 0 where that is not known, and where no weights are compared
    """

    name: str
    estimate: Estimate
    error: StandardError | None
    objects: int
    spread: float = 0.0

    @property
    def shown(self) -> bool:
        """Whether it is over 0, by its interval and by more than the spread."""
        return self.estimate.low > 0 and self.estimate.value > self.spread

    @property
    def refuted(self) -> bool:
        """Whether it is below 0, likewise."""
        return self.estimate.high < 0 and self.estimate.value < -self.spread

    @property
    def p(self) -> float:
        """Of a true value of 0, two-sided; NaN without an error."""
        return self.error.p_value(self.estimate.value) if self.error else math.nan


@dataclass(frozen=True)
class Finding:
    """What a run says about a claim.

    subject       the method that the claim is about
    numbers       ours, with intervals
    requirements  of the claim; none where it cannot be tested
    reason        why it cannot be tested, or what has to be known with it; may be empty
    """

    subject: str
    numbers: str
    requirements: tuple[Requirement, ...] = ()
    reason: str = ""

    @property
    def verdict(self) -> Verdict:
        """By the intervals, whatever else is claimed."""
        ends = [(of.estimate.low, of.estimate.high) for of in self.requirements]
        if not ends or not np.isfinite(ends).all():
            return "not testable here"
        if all(of.shown for of in self.requirements):
            return "supported"
        return "contradicted" if any(of.refuted for of in self.requirements) else "undecided"

    @property
    def p(self) -> float:
        """Of the verdict: all that is required has to be over 0, or one of them below.

        The largest p value where all are over 0, else the smallest of those below, times the number
        of requirements. NaN where the claim cannot be tested.
        """
        if self.verdict == "not testable here":
            return math.nan
        below = [of.p for of in self.requirements if of.estimate.value <= 0]
        if not below:
            return max(of.p for of in self.requirements)
        return min(1.0, len(self.requirements) * min(below))

    @property
    def objects(self) -> int:
        """The fewest of a requirement; 0 where the claim cannot be tested."""
        return min((of.objects for of in self.requirements), default=0)

    @property
    def why(self) -> str:
        """What the requirements are that do not hold, and the reason."""
        missed = [of.name for of in self.requirements if of.name and not of.shown]
        tied = any(abs(of.estimate.value) <= of.spread for of in self.requirements)
        parts = [f"not shown: {', '.join(missed)}" if missed else "", self.reason]
        if tied and self.verdict == "undecided":
            parts.append("smaller than the spread between trainings")
        if self.requirements and self.verdict == "not testable here":
            parts[0] = "too few objects for an interval"
        return "; ".join(filter(None, parts))


def corrected(findings: Sequence[Finding]) -> list[Verdict]:
    """The verdicts of a family of claims, corrected for their number by Holm's procedure.

    What is supported or contradicted stays so where its corrected p value is below 0.05, else it
    is undecided.
    """
    p_values = holm([finding.p for finding in findings])
    return [
        finding.verdict
        if finding.verdict in ("not testable here", "undecided") or p < SIGNIFICANCE
        else "undecided"
        for finding, p in zip(findings, p_values, strict=True)
    ]


class MissingEvidence(Exception):
    """A run of the right suite does not have what the claim needs."""


class Training(NamedTuple):
    """What has to be known of a network's weights.

    width     in widths of the paper's
    degraded  whether clouds with fewer points and noise were shown
    """

    width: float
    degraded: bool


@dataclass(frozen=True, eq=False)
class QualityEvidence:
    """A run whose images were scored.

    comparisons  by condition and class
    spreads      by class, how much true objects differ: the value, and without each object
    retrieval    by method and condition, the share of each chair's images that is found, [G]
    trainings    of the networks of which it is known
    subjects     methods in place of the variants of pc2pix
    seeds        by method, metric and condition, the spread between trainings on chairs
    """

    comparisons: Mapping[tuple[str, str], Comparison]
    spreads: Mapping[str, tuple[float, Floats]] = field(default_factory=dict)
    retrieval: Mapping[tuple[str, str], Floats] = field(default_factory=dict)
    trainings: Mapping[str, Training] = field(default_factory=dict)
    subjects: tuple[str, ...] = ()
    seeds: Mapping[tuple[str, str, str], float] = field(default_factory=dict)

    @property
    def networks(self) -> list[str]:
        """The methods that claims are about: the variants of pc2pix in the run, or `subjects`."""
        of_all = next(iter(self.comparisons.values())).images
        found = [m for m in of_all if m in self.subjects or family_of(m) == NETWORK]
        found = [m for m in found if m in self.subjects] if self.subjects else found
        if not found:
            raise MissingEvidence(f"the run has no {' or '.join(self.subjects or (NETWORK,))}")
        return found

    def quality(self, metric: str, method: str, condition: str, class_name: str) -> Quality:
        """A metric of a method in one cell. Raises Lacking where it was not measured."""
        cell = self.comparisons.get((condition, class_name))
        if cell is None:
            raise MissingEvidence(f"the run has no {class_name} at {condition}")
        of_metric = cell.qualities.get(metric, {})
        if method not in of_metric:
            raise MissingEvidence(f"the run has no {metric} of {method}")
        return of_metric[method]

    @property
    def distance(self) -> str:
        """The Fréchet distance that the run has."""
        measured = next(iter(self.comparisons.values())).qualities
        return next((metric for metric in DISTANCES if metric in measured), DISTANCES[0])

    def classes(self) -> list[str]:
        """Of the full clouds."""
        return [name for condition, name in self.comparisons if condition == FULL]


@dataclass(frozen=True, eq=False)
class TimingEvidence:
    """A run of `speed`: its samples, as in `tables/speed_samples.csv`, its machine, and what is
    known of the networks."""

    samples: pd.DataFrame
    machine: str = "an unknown machine"
    trainings: Mapping[str, Training] = field(default_factory=dict)


# Of `latent` the means of both tables.
Evidence = QualityEvidence | TimingEvidence | pd.DataFrame


# --- chairs, condition by condition ---------------------------------------------------------------


def ordering(run: QualityEvidence, metric: str, condition: str, ahead: Ahead) -> list[Finding]:
    """Who is ahead on chairs: SR, the network, or neither, by more than `EQUAL`."""
    metric = _measured(run, metric)
    found = []
    for network in run.networks:
        a, b = (run.quality(metric, m, condition, CHAIR) for m in (network, SURFACE))
        lead = _lead_on_chairs(run, metric, condition, network, SURFACE)
        numbers = _compared(metric, a.estimate.value, "SR", b.estimate.value, "ahead", lead)
        found.append(_judged(network, numbers, lead, ahead, _stand_in(metric)))
    return found


def steady(run: QualityEvidence, metric: str, conditions: Sequence[str]) -> list[Finding]:
    """The network loses less than `SHARE` of what SR loses against the full cloud, at each.

    What loses nothing because it shows nothing is not robust: at each condition its images also
    have to be better than those of the floors by `RECOGNISABLE`, and found more often than by
    chance.
    """
    metric = _measured(run, metric)
    found = []
    for network in run.networks:
        texts, required = [], []
        for condition in conditions:
            own, others = (_loss(run, metric, m, condition) for m in (network, SURFACE))
            spared = [*((-w, q) for w, q in own), *((SHARE * w, q) for w, q in others)]
            required.append(_requirement(f"loss at {condition}", spared))
            required += _shows_something(run, network, condition)
            lost = [_text(metric, combined(of)) for of in (own, others)]
            texts.append(f"{condition}: loses {lost[0]}, SR {lost[1]}")
        reason = "; ".join(filter(None, [_shown(run, network), _stand_in(metric)]))
        found.append(Finding(network, "; ".join([metric, *texts]), tuple(required), reason))
    return found


def _shows_something(run: QualityEvidence, method: str, condition: str) -> list[Requirement]:
    """Better than each floor by image metrics, and recognised more often than by chance."""
    made = []
    for metric in RECOGNISABLE:
        made += [
            _lead_on_chairs(run, metric, condition, method, floor)._replace(
                name=f"{metric} over {floor} at {condition}"
            )
            for floor in FLOORS
            if floor != method
        ]
    shares = run.retrieval.get((method, condition))
    if shares is None:
        raise MissingEvidence(f"the run has no {RETRIEVAL} of {method} at {condition}")
    above = shares - 1 / len(shares)
    return [*made, _of_objects(f"{RETRIEVAL} over chance at {condition}", [above])]


def _shown(run: QualityEvidence, network: str) -> str:
    training = run.trainings.get(network)
    if training is None:
        return ""
    return "was shown such clouds in training" if training.degraded else "was not shown such clouds"


def degrades(run: QualityEvidence, metric: str, conditions: Sequence[str]) -> list[Finding]:
    """SR loses against the full cloud, at each of the conditions."""
    metric = _measured(run, metric)
    losses = [_requirement(c, _loss(run, metric, SURFACE, c)) for c in conditions]
    numbers = "; ".join(f"{of.name}: loses {_text(metric, of.estimate)}" for of in losses)
    return [Finding(SURFACE, f"{metric}; {numbers}", tuple(losses), _stand_in(metric))]


def above_blank(run: QualityEvidence) -> list[Finding]:
    """The network's images are nearer to the truth than white ones, by SSIM and by distance."""
    found = []
    for network in run.networks:
        leads = [
            _lead_on_chairs(run, metric, FULL, network, "blank")._replace(name=metric)
            for metric in ("ssim", run.distance)
        ]
        numbers = "; ".join(f"{of.name}: ahead by {_text(of.name, of.estimate)}" for of in leads)
        found.append(Finding(network, numbers, tuple(leads)))
    return found


# --- classes --------------------------------------------------------------------------------------


def class_ordering(
    run: QualityEvidence, class_name: str, ahead: Ahead, metric: str | None = None
) -> list[Finding]:
    """Who is ahead in one class, or on average; by the run's distance without another metric."""
    metric = metric or run.distance
    names = run.classes() if class_name == AVERAGE else [class_name]
    network = run.networks[0]
    own, other = (
        [run.quality(metric, method, FULL, name) for name in names] for method in (network, SURFACE)
    )
    lead = _lead_over_classes("", own, other)
    values = [float(np.mean([q.estimate.value for q in of])) for of in (own, other)]
    numbers = _compared(metric, values[0], "SR", values[1], "ahead", lead)
    return [_judged(network, numbers, lead, ahead, _stand_in(metric))]


def unrecognisable(run: QualityEvidence) -> list[Finding]:
    """The classifier gives the true class less to SR's images than to true ones."""
    true, drawn = (
        [run.quality(CONFIDENCE, method, FULL, name) for name in run.classes()]
        for method in ("true-mesh", SURFACE)
    )
    lost = _lead_over_classes("", true, drawn)
    of_true, of_drawn = (np.mean([q.estimate.value for q in of]) for of in (true, drawn))
    numbers = (
        f"{CONFIDENCE} {of_drawn:.3f}, true pictures {of_true:.3f}; "
        f"loses {_text(CONFIDENCE, lost.estimate)}"
    )
    return [Finding(SURFACE, numbers, (lost,))]


def gains_from_others(run: QualityEvidence, alone: str, together: str) -> list[Finding]:
    """Chairs: the network of all classes is nearer to the truth than that of chairs alone."""
    metric = run.distance
    a, b = (run.quality(metric, m, FULL, CHAIR) for m in (alone, together))
    gain = _lead("", b, a)
    numbers = _compared(metric, b.estimate.value, "alone", a.estimate.value, "better", gain)
    return [Finding(together, numbers, (gain,), _stand_in(metric))]


def good_where_thin(run: QualityEvidence, thin: Sequence[str]) -> list[Finding]:
    """SR's distance is smaller in these classes than in the mean of the others."""
    metric, names = run.distance, run.classes()
    if lacking := [name for name in thin if name not in names]:
        raise MissingEvidence(f"the run has no {', '.join(lacking)}")
    groups = [[n for n in names if (n in thin) == inside] for inside in (True, False)]
    if not groups[1]:
        raise MissingEvidence("the run has no other class")
    of_groups = [[run.quality(metric, SURFACE, FULL, name) for name in group] for group in groups]
    values = [float(np.mean([q.estimate.value for q in of])) for of in of_groups]
    leave_one_out = [[q.per_object for q in of] for of in of_groups]
    gap = _difference("", values[1] - values[0], *leave_one_out)
    numbers = _compared(metric, values[0], "others", values[1], "nearer", gap)
    return [Finding(SURFACE, numbers, (gap,), _stand_in(metric))]


def varies_more(run: QualityEvidence, more: str, less: str) -> list[Finding]:
    """True objects of one class differ more than those of another, in the features' own units."""
    if lacking := [name for name in (more, less) if name not in run.spreads]:
        raise MissingEvidence(f"the run has no features of {', '.join(lacking)}")
    (a, without_a), (b, without_b) = run.spreads[more], run.spreads[less]
    gap = _difference("", a - b, [without_a], [without_b])
    by_spread = sorted(run.spreads, key=lambda name: -run.spreads[name][0])
    numbers = (
        f"variance between objects {a:.2f}, {less} {b:.2f}; more by "
        f"{_text('fd-views', gap.estimate)}; "
        f"{more} is number {by_spread.index(more) + 1} of {len(by_spread)}"
    )
    return [Finding("true pictures", numbers, (gap,))]


# --- speed ----------------------------------------------------------------------------------------


def faster(run: TimingEvidence, times: float) -> list[Finding]:
    """An image of the network costs less than one over `times` of one of SR, preparing included.

    On one thread, cloud by cloud: the interval is over clouds. The claim is about the paper's
    network: one of another width says nothing about it.
    """
    costs = _costs(run.samples)
    networks = [m for m in costs if family_of(m) == NETWORK]
    if SURFACE not in costs or not networks:
        raise MissingEvidence(
            f"the run has no times of {SURFACE if SURFACE not in costs else NETWORK}"
        )
    found = []
    for network in networks:
        ratio = np.log(costs[SURFACE] / costs[network])
        over = _of_objects("", [ratio - math.log(times)])
        low, high = (math.exp(end + math.log(times)) for end in over.estimate[1:])
        numbers = f"{math.exp(ratio.mean()):.1f} times [{low:.1f}, {high:.1f}] on {run.machine}"
        training = run.trainings.get(network)
        if training is None or training.width != PAPER_WIDTH:
            width = "an unknown width" if training is None else f"{training.width:g} of its width"
            reason = f"the claim is about the paper's network; this one has {width}"
            found.append(Finding(network, numbers, (), reason))
        else:
            found.append(Finding(network, numbers, (over,), "the paper's width"))
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
    """A mean of the suite `latent` is above another one's, or above 0 without another.

    Two means are compared as independent, which they are not: paths and sums are the same. Paired
    by item, the difference would have a shorter interval.
    """
    rows = means[(means["metric"] == metric) & (means["kind"] == "all")]
    found = []
    for method in dict.fromkeys(rows["method"]):
        at = rows[rows["method"] == method].set_index("what")
        if lacking := [w for w in (what, than) if w is not None and w not in at.index]:
            raise MissingEvidence(f"the run has no {metric} of {', '.join(lacking)}")
        own = _estimate(at, what)
        numbers, bar = f"{metric} of {what} {_figures(own)}", Estimate(0.0, 0.0, 0.0)
        if than is not None:
            bar = _estimate(at, than)
            numbers = f"{numbers}, of {than} {_figures(bar)}"
        gap = _independent(own, bar, int(at.loc[what, "n_ok"]))
        found.append(Finding(str(method), numbers, (gap,)))
    return found


def _estimate(rows: pd.DataFrame, what: str) -> Estimate:
    return Estimate(*(float(rows.loc[what, c]) for c in ("value", "ci_low", "ci_high")))  # type: ignore[arg-type]


def _independent(a: Estimate, b: Estimate, objects: int) -> Requirement:
    """a - b of independent estimates; half of an interval is two standard errors."""
    gap = a.value - b.value
    below = math.hypot(a.value - a.low, b.high - b.value)
    above = math.hypot(a.high - a.value, b.value - b.low)
    reach = below if gap > 0 else above
    error = StandardError(reach / 1.96, math.inf) if math.isfinite(reach) else None
    return Requirement("", Estimate(gap, gap - below, gap + above), error, objects)


# --- in common ------------------------------------------------------------------------------------


def combined(terms: Sequence[tuple[float, Quality]]) -> Estimate:
    """A weighted sum of one metric over methods and conditions, paired object by object.

    With the intervals of `bench.analysis.intervals`.
    """
    return _requirement("", terms).estimate


def _requirement(name: str, terms: Sequence[tuple[float, Quality]]) -> Requirement:
    value = float(sum(weight * quality.estimate.value for weight, quality in terms))
    per_object = np.sum([weight * quality.per_object for weight, quality in terms], axis=0)
    if is_mean(terms[0][1].metric):
        made = _of_objects(name, [per_object])
        return made._replace(estimate=made.estimate._replace(value=value))
    return _difference(name, value, [per_object])


def _lead(name: str, a: Quality, b: Quality) -> Requirement:
    """How much better a is than b."""
    sign = 1 if higher_is_better(a.metric) else -1
    return _requirement(name, [(sign, a), (-sign, b)])


def _lead_on_chairs(
    run: QualityEvidence, metric: str, condition: str, network: str, other: str
) -> Requirement:
    """How much better a network is than another method, with the spread between its trainings."""
    a, b = (run.quality(metric, method, condition, CHAIR) for method in (network, other))
    spread = run.seeds.get((network, metric, condition), 0.0)
    return _lead("", a, b)._replace(spread=spread)


def _lead_over_classes(name: str, a: Sequence[Quality], b: Sequence[Quality]) -> Requirement:
    """How much better a is than b, class by class, in the mean over classes."""
    objects = sum(len(of.per_object) for of in a)
    return Requirement(name, *lead_over_classes(a, b), objects)


def _of_objects(name: str, per_object: Sequence[Floats]) -> Requirement:
    """A mean over classes of the means over objects."""
    value = float(np.mean([of.mean() for of in per_object]))
    estimate = Estimate(value, *interval_of_means(per_object))
    return Requirement(name, estimate, mean_error(per_object), sum(map(len, per_object)))


def _difference(name: str, value: float, *leave_one_out: Sequence[Floats]) -> Requirement:
    """A difference of means over classes of distances, given those without each object; or one."""
    count = sum(len(of) for group in leave_one_out for of in group)
    error = sum_error([jackknife_error(of) for of in leave_one_out])
    reach = error.reach if error else math.nan
    return Requirement(name, Estimate(value, value - reach, value + reach), error, count)


def _loss(
    run: QualityEvidence, metric: str, method: str, condition: str
) -> list[tuple[float, Quality]]:
    """The terms of how much worse a method is at a condition than with the full cloud."""
    sign = 1.0 if higher_is_better(metric) else -1.0
    full, less = (run.quality(metric, method, c, CHAIR) for c in (FULL, condition))
    return [(sign, full), (-sign, less)]


def _judged(subject: str, numbers: str, lead: Requirement, ahead: Ahead, remark: str) -> Finding:
    """By how much the network is ahead."""
    match ahead:
        case "network":
            required = (lead,)
        case "surface":
            required = (_moved(lead, 0.0, -1),)
        case "equal":  # two one-sided tests
            required = _moved(lead, EQUAL, 1), _moved(lead, EQUAL, -1)
        case "undecided":  # what is not significant is never shown to be so
            required = (_moved(lead, 0.0, -1 if lead.estimate.value > 0 else 1),)
    return Finding(subject, numbers, required, remark)


def _moved(of: Requirement, by: float, sign: int) -> Requirement:
    """sign times the estimate, and `by` more."""
    ends = sorted(by + sign * end for end in of.estimate[1:])
    return of._replace(estimate=Estimate(by + sign * of.estimate.value, *ends))


def _measured(run: QualityEvidence, metric: str) -> str:
    return run.distance if metric in DISTANCES else metric


def _stand_in(metric: str) -> str:
    return f"{metric} stands in for {DISTANCES[0]}" if metric == DISTANCES[1] else ""


def _compared(
    metric: str, own: float, other: str, value: float, how: str, lead: Requirement
) -> str:
    digits = decimals(metric)
    values = f"{metric} {own:.{digits}f}, {other} {value:.{digits}f}"
    trainings = f"; trainings differ by {lead.spread:.{digits}f}" if lead.spread else ""
    return f"{values}; {how} by {_text(metric, lead.estimate)}{trainings}"


def _text(metric: str, estimate: Estimate) -> str:
    digits = decimals(metric)
    value, low, high = (f"{number:+.{digits}f}" for number in estimate)
    return f"{value} [{low}, {high}]"


def _figures(estimate: Estimate) -> str:
    return f"{estimate.value:.3g} [{estimate.low:.3g}, {estimate.high:.3g}]"
