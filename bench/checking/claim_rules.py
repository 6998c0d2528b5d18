"""Rules that test a claim of the paper on a run: from evidence to findings. Pure functions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import pandas as pd

from bench.analysis.comparison import Estimate, Quality, class_mean_difference
from bench.analysis.digits import decimals
from bench.analysis.intervals import (
    StandardError,
    interval_of_means,
    jackknife_error,
    mean_error,
    sum_error,
)
from bench.analysis.paper import AVERAGE, NETWORK, SURFACE
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import FLOORS
from bench.catalogue.metrics import higher_is_better, is_mean
from bench.checking.claim_findings import ClaimFinding, Requirement
from bench.checking.evidence import (
    DISTANCES,
    FULL,
    MissingEvidence,
    QualityEvidence,
    TimingEvidence,
)
from data_prep.arrays import Floats

Ahead = Literal["surface", "network", "equal", "undecided"]
CHAIR = "chair"
EQUAL = 0.01  # largest difference of two scores that two decimals print alike
SHARE = 0.1  # of reconstruction's loss: the paper's network loses 0.01 SSIM where SR loses 0.40
CONFIDENCE = "class-confidence"
RETRIEVAL = "retrieval"
RECOGNISABLE = ("ssim", "lpips")  # metrics by which an image has to beat the reference methods
PAPER_WIDTH = 1.0  # of the networks, in widths of the paper's


# --- chairs, condition by condition ---------------------------------------------------------------


def ordering(run: QualityEvidence, metric: str, condition: str, ahead: Ahead) -> list[ClaimFinding]:
    """Test which of SR and the network is ahead on chairs, or neither by more than `EQUAL`."""
    metric = _measured(run, metric)
    findings = []
    for network in run.networks:
        a, b = (run.quality(metric, m, condition, CHAIR) for m in (network, SURFACE))
        lead = _lead_on_chairs(run, metric, condition, network, SURFACE)
        numbers = _compared(metric, a.estimate.value, "SR", b.estimate.value, "ahead", lead)
        findings.append(_ordered(network, numbers, lead, ahead, _stand_in(metric)))
    return findings


def steady(run: QualityEvidence, metric: str, conditions: Sequence[str]) -> list[ClaimFinding]:
    """Test that the network loses less than `SHARE` of what SR loses, at each condition.

    Losses are against the full cloud. A method that always draws the same image loses nothing, so
    that its images also have to be better than those of the reference methods by `RECOGNISABLE`,
    and found more often than by chance.
    """
    metric = _measured(run, metric)
    findings = []
    for network in run.networks:
        texts, required = [], []
        for condition in conditions:
            of_network, of_surface = (_loss(run, metric, m, condition) for m in (network, SURFACE))
            spared = [*((-w, q) for w, q in of_network), *((SHARE * w, q) for w, q in of_surface)]
            required.append(weighted_sum(f"loss at {condition}", spared))
            required += _shows_something(run, network, condition)
            lost = [
                _text(metric, weighted_sum("", terms).estimate)
                for terms in (of_network, of_surface)
            ]
            texts.append(f"{condition}: loses {lost[0]}, SR {lost[1]}")
        training = run.trainings.get(network)
        shown = ""
        if training is not None:
            shown = "was not shown such clouds"
            if training.degraded:
                shown = "was shown such clouds in training"
        reason = "; ".join(filter(None, [shown, _stand_in(metric)]))
        findings.append(ClaimFinding(network, "; ".join([metric, *texts]), tuple(required), reason))
    return findings


def _shows_something(run: QualityEvidence, method: str, condition: str) -> list[Requirement]:
    """Require better images than each reference method's, and a recognition beyond chance."""
    required = [
        _lead_on_chairs(run, metric, condition, method, floor)._replace(
            name=f"{metric} over {floor} at {condition}"
        )
        for metric in RECOGNISABLE
        for floor in FLOORS
        if floor != method
    ]
    shares = run.retrieval.get((method, condition))
    if shares is None:
        raise MissingEvidence(f"the run has no {RETRIEVAL} of {method} at {condition}")
    above = shares - 1 / len(shares)
    return [*required, _mean_over_objects(f"{RETRIEVAL} over chance at {condition}", above)]


def degrades(run: QualityEvidence, metric: str, conditions: Sequence[str]) -> list[ClaimFinding]:
    """Test that SR loses against the full cloud, at each of the conditions."""
    metric = _measured(run, metric)
    losses = [weighted_sum(c, _loss(run, metric, SURFACE, c)) for c in conditions]
    numbers = "; ".join(f"{loss.name}: loses {_text(metric, loss.estimate)}" for loss in losses)
    return [ClaimFinding(SURFACE, f"{metric}; {numbers}", tuple(losses), _stand_in(metric))]


def above_blank(run: QualityEvidence) -> list[ClaimFinding]:
    """Test that the network's images are nearer to the truth than white ones, by SSIM and FD."""
    findings = []
    for network in run.networks:
        leads = [
            _lead_on_chairs(run, metric, FULL, network, "blank")._replace(name=metric)
            for metric in ("ssim", run.distance)
        ]
        numbers = "; ".join(f"{r.name}: ahead by {_text(r.name, r.estimate)}" for r in leads)
        findings.append(ClaimFinding(network, numbers, tuple(leads)))
    return findings


# --- classes --------------------------------------------------------------------------------------


def class_ordering(
    run: QualityEvidence, class_name: str, ahead: Ahead, metric: str | None = None
) -> list[ClaimFinding]:
    """Test which of SR and the network is ahead in one class, or on average.

    Without a metric the run's Fréchet distance decides.
    """
    metric = metric or run.distance
    names = run.classes() if class_name == AVERAGE else [class_name]
    network = run.networks[0]
    of_network, of_surface = (
        [run.quality(metric, method, FULL, name) for name in names] for method in (network, SURFACE)
    )
    lead = _lead(of_network, of_surface)
    numbers = _compared(
        metric, _mean_value(of_network), "SR", _mean_value(of_surface), "ahead", lead
    )
    return [_ordered(network, numbers, lead, ahead, _stand_in(metric))]


def unrecognisable(run: QualityEvidence) -> list[ClaimFinding]:
    """Test that the classifier recognises SR's images less surely than true ones."""
    true, drawn = (
        [run.quality(CONFIDENCE, method, FULL, name) for name in run.classes()]
        for method in ("true-mesh", SURFACE)
    )
    lost = _lead(true, drawn)
    numbers = (
        f"{CONFIDENCE} {_mean_value(drawn):.3f}, true images {_mean_value(true):.3f}; "
        f"loses {_text(CONFIDENCE, lost.estimate)}"
    )
    return [ClaimFinding(SURFACE, numbers, (lost,))]


def gains_from_others(run: QualityEvidence, alone: str, together: str) -> list[ClaimFinding]:
    """Test that the network of all classes is nearer to true chairs than that of chairs alone."""
    metric = run.distance
    a, b = (run.quality(metric, m, FULL, CHAIR) for m in (alone, together))
    gain = _lead([b], [a])
    numbers = _compared(metric, b.estimate.value, "alone", a.estimate.value, "better", gain)
    return [ClaimFinding(together, numbers, (gain,), _stand_in(metric))]


def good_where_thin(run: QualityEvidence, thin: Sequence[str]) -> list[ClaimFinding]:
    """Test that SR's distance is smaller in these classes than in the mean of the others."""
    metric, names = run.distance, run.classes()
    if missing := [name for name in thin if name not in names]:
        raise MissingEvidence(f"the run has no {', '.join(missing)}")
    groups = [[n for n in names if (n in thin) == inside] for inside in (True, False)]
    if not groups[1]:
        raise MissingEvidence("the run has no other class")
    near, far = ([run.quality(metric, SURFACE, FULL, n) for n in group] for group in groups)
    values = _mean_value(near), _mean_value(far)
    leave_one_out = [[quality.per_object for quality in group] for group in (near, far)]
    gap = _distance_between("", values[1] - values[0], *leave_one_out)
    numbers = _compared(metric, values[0], "others", values[1], "nearer", gap)
    return [ClaimFinding(SURFACE, numbers, (gap,), _stand_in(metric))]


def varies_more(run: QualityEvidence, more: str, less: str) -> list[ClaimFinding]:
    """Test that true objects of one class differ more than those of another.

    The variances are in the units of the features.
    """
    if missing := [name for name in (more, less) if name not in run.spreads]:
        raise MissingEvidence(f"the run has no features of {', '.join(missing)}")
    (a, without_a), (b, without_b) = run.spreads[more], run.spreads[less]
    gap = _distance_between("", a - b, [without_a], [without_b])
    by_spread = sorted(run.spreads, key=lambda name: -run.spreads[name][0])
    numbers = (
        f"variance between objects {a:.2f}, {less} {b:.2f}; more by "
        f"{_text('fd-views', gap.estimate)}; "
        f"{more} is number {by_spread.index(more) + 1} of {len(by_spread)}"
    )
    return [ClaimFinding("true images", numbers, (gap,))]


# --- speed ----------------------------------------------------------------------------------------


def faster(run: TimingEvidence, times: float) -> list[ClaimFinding]:
    """Test that SR's image costs over `times` as much as the network's, preparing included.

    On one thread, cloud by cloud: the interval is over the clouds that both have times of.
    """
    costs = _costs(run.samples)
    networks = [m for m in costs if family_of(m) == NETWORK]
    if SURFACE not in costs or not networks:
        raise MissingEvidence(
            f"the run has no times of {SURFACE if SURFACE not in costs else NETWORK}"
        )
    findings = []
    for network in networks:
        # Paired by the names of the clouds; one that failed on the way may have no times.
        ratio = np.log((costs[SURFACE] / costs[network]).dropna().to_numpy(np.float64))
        if not len(ratio):
            reason = f"the run has no cloud with times of {SURFACE}, too"
            findings.append(ClaimFinding(network, "", (), reason))
            continue
        over = _mean_over_objects("", ratio - math.log(times))
        low, high = (math.exp(end + math.log(times)) for end in over.estimate[1:])
        numbers = f"{math.exp(ratio.mean()):.1f} times [{low:.1f}, {high:.1f}] on {run.machine}"
        training = run.trainings.get(network)
        if training is not None and training.width == PAPER_WIDTH:
            findings.append(ClaimFinding(network, numbers, (over,), "the paper's width"))
            continue
        width = "an unknown width" if training is None else f"{training.width:g} of its width"
        reason = f"the claim is about the paper's network; this one has {width}"
        findings.append(ClaimFinding(network, numbers, (), reason))
    return findings


def _costs(samples: pd.DataFrame) -> dict[str, pd.Series]:
    """Return seconds an image of each cloud by method: medians of preparing it and of its views."""
    warm = samples[(samples["round"] > 0) & (samples["threads"] == 1)]
    warm = warm[warm["condition"].astype(str) == FULL]
    costs, views = {}, warm["views"].max()
    for method, calls in warm.groupby("method", sort=False):
        batches = calls[(calls["stage"] == "draw") & (calls["views"] == views)]
        parts = [calls[calls["stage"] == "prepare"], batches]
        prepare, draw = (part.groupby("cloud")["wall_s"].median() for part in parts)
        costs[str(method)] = (prepare + draw) / views  # NaN where one of the two is missing
    return costs


# --- latent ---------------------------------------------------------------------------------------


def mean_above(
    means: pd.DataFrame, metric: str, what: str, than: str | None = None
) -> list[ClaimFinding]:
    """Test that a mean of the suite `latent` is above another one, or above 0."""
    rows = means[(means["metric"] == metric) & (means["kind"] == "all")]
    findings = []
    for method in dict.fromkeys(rows["method"]):
        at = rows[rows["method"] == method].set_index("what")
        if missing := [w for w in (what, than) if w is not None and w not in at.index]:
            raise MissingEvidence(f"the run has no {metric} of {', '.join(missing)}")
        mean = _estimate(at, what)
        numbers, bar = f"{metric} of {what} {_figures(mean)}", Estimate(0.0, 0.0, 0.0)
        if than is not None:
            bar = _estimate(at, than)
            numbers = f"{numbers}, of {than} {_figures(bar)}"
        # The two are not independent: paths and sums are the same. Paired, the interval of their
        # difference would be shorter.
        gap = _independent(mean, bar, int(at.loc[what, "n_ok"]))
        findings.append(ClaimFinding(str(method), numbers, (gap,)))
    return findings


def _estimate(rows: pd.DataFrame, what: str) -> Estimate:
    return Estimate(*(float(rows.loc[what, c]) for c in ("value", "ci_low", "ci_high")))  # type: ignore[arg-type]


def _independent(a: Estimate, b: Estimate, objects: int) -> Requirement:
    """Require that a - b of independent estimates is over 0."""
    gap = a.value - b.value
    below = math.hypot(a.value - a.low, b.high - b.value)
    above = math.hypot(a.high - a.value, b.value - b.low)
    reach = below if gap > 0 else above
    # Half of an interval is 1.96 standard errors.
    error = StandardError(reach / 1.96, math.inf) if math.isfinite(reach) else None
    return Requirement("", Estimate(gap, gap - below, gap + above), error, objects)


# --- in common ------------------------------------------------------------------------------------


def weighted_sum(name: str, terms: Sequence[tuple[float, Quality]]) -> Requirement:
    """Require that a weighted sum of one metric over methods and conditions is over 0.

    The terms are paired object by object.
    """
    value = float(sum(weight * quality.estimate.value for weight, quality in terms))
    per_object = np.sum([weight * quality.per_object for weight, quality in terms], axis=0)
    if not is_mean(terms[0][1].metric):
        return _distance_between(name, value, [per_object])
    required = _mean_over_objects(name, per_object)
    return required._replace(estimate=required.estimate._replace(value=value))


def _lead(a: Sequence[Quality], b: Sequence[Quality]) -> Requirement:
    """Require that `a` is better than `b`, class by class, in the mean over classes."""
    objects = sum(len(quality.per_object) for quality in a)
    return Requirement("", *class_mean_difference(a, b), objects)


def _lead_on_chairs(
    run: QualityEvidence, metric: str, condition: str, network: str, other: str
) -> Requirement:
    """Require that a network is better than another method by more than its trainings differ."""
    a, b = (run.quality(metric, method, condition, CHAIR) for method in (network, other))
    spread = run.seeds.get((network, metric, condition), 0.0)
    return _lead([a], [b])._replace(spread=spread)


def _mean_over_objects(name: str, per_object: Floats) -> Requirement:
    """Require that the mean over objects is over 0."""
    estimate = Estimate(float(per_object.mean()), *interval_of_means([per_object]))
    return Requirement(name, estimate, mean_error([per_object]), len(per_object))


def _distance_between(name: str, value: float, *leave_one_out: Sequence[Floats]) -> Requirement:
    """Require that a difference of two means over classes, or one such mean, is over 0.

    `leave_one_out` has, of each of the independent means, the values [g] without each object of
    each class.
    """
    count = sum(len(values) for group in leave_one_out for values in group)
    error = sum_error([jackknife_error(group) for group in leave_one_out])
    reach = error.reach if error else math.nan
    return Requirement(name, Estimate(value, value - reach, value + reach), error, count)


def _loss(
    run: QualityEvidence, metric: str, method: str, condition: str
) -> list[tuple[float, Quality]]:
    """Return the terms of how much worse a method is at a condition than with the full cloud."""
    sign = 1.0 if higher_is_better(metric) else -1.0
    full, less = (run.quality(metric, method, c, CHAIR) for c in (FULL, condition))
    return [(sign, full), (-sign, less)]


def _ordered(
    subject: str, numbers: str, lead: Requirement, ahead: Ahead, remark: str
) -> ClaimFinding:
    """Return the finding on who is ahead, given the network's lead."""
    match ahead:
        case "network":
            required = (lead,)
        case "surface":
            required = (lead.shifted(0.0, -1),)
        case "equal":  # two one-sided tests
            required = lead.shifted(EQUAL, 1), lead.shifted(EQUAL, -1)
        case "undecided":  # an effect that is not significant is never shown to be so
            required = (lead.shifted(0.0, -1 if lead.estimate.value > 0 else 1),)
    return ClaimFinding(subject, numbers, required, remark)


def _mean_value(qualities: Sequence[Quality]) -> float:
    return float(np.mean([quality.estimate.value for quality in qualities]))


def _measured(run: QualityEvidence, metric: str) -> str:
    return run.distance if metric in DISTANCES else metric


def _stand_in(metric: str) -> str:
    return f"{metric} stands in for {DISTANCES[0]}" if metric == DISTANCES[1] else ""


def _compared(
    metric: str, value: float, other: str, other_value: float, how: str, lead: Requirement
) -> str:
    digits = decimals(metric)
    values = f"{metric} {value:.{digits}f}, {other} {other_value:.{digits}f}"
    trainings = f"; trainings differ by {lead.spread:.{digits}f}" if lead.spread else ""
    return f"{values}; {how} by {_text(metric, lead.estimate)}{trainings}"


def _text(metric: str, estimate: Estimate) -> str:
    digits = decimals(metric)
    value, low, high = (f"{number:+.{digits}f}" for number in estimate)
    return f"{value} [{low}, {high}]"


def _figures(estimate: Estimate) -> str:
    return f"{estimate.value:.3g} [{estimate.low:.3g}, {estimate.high:.3g}]"
