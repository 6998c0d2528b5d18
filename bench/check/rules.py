"""Rules that test a claim of the paper on a run: from evidence to findings. Pure functions.

A claim holds where everything that it requires is over 0. It is `supported` where all 95 %
intervals over objects are above 0, `contradicted` where one is below, and else `undecided`. A
difference smaller than the spread between trainings of the network is a tie: undecided, too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import pandas as pd

from bench.analysis.compare import Estimate, Row
from bench.analysis.differences import QualityChange, better_by, by_method
from bench.analysis.digits import decimals
from bench.analysis.intervals import SIGNIFICANCE, StandardError, jackknife_error, mean_error
from bench.analysis.paper import AVERAGE, NETWORK, SURFACE
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import FLOORS
from bench.catalogue.metrics import higher_is_better, is_mean
from data_prep.arrays import Floats

Verdict = Literal["supported", "contradicted", "undecided", "not testable here"]
VERDICTS: tuple[Verdict, ...] = ("supported", "contradicted", "undecided", "not testable here")
Ahead = Literal["surface", "network", "equal", "undecided"]
CHAIR = "chair"
FULL = "2048"
DISTANCES = ("fid", "fd-views")  # the first that a run has; the second stands in for the first
EQUAL = 0.01  # largest difference of two scores that two decimals print alike
SHARE = 0.1  # of reconstruction's loss: the paper's network loses 0.01 SSIM where SR loses 0.40
CONFIDENCE = "class-confidence"
_RETRIEVAL = "retrieval"
RECOGNISABLE = ("ssim", "lpips")  # metrics by which an image has to beat the reference methods
_PAPER_WIDTH = 1.0  # of the networks, in widths of the paper's


# --- findings -------------------------------------------------------------------------------------


class Requirement(NamedTuple):
    """A value that has to be over 0 for a claim to hold."""

    name: str
    estimate: Estimate  # with its 95 % interval over objects; NaN where the objects are too few
    error: StandardError | None  # of the estimate; None where the objects are too few
    objects: int  # their number
    # From the lowest to the highest of several trainings of the network, which differ in their
    # seeds; 0 where that is not known, and where no weights are compared.
    spread: float = 0.0

    @property
    def shown(self) -> bool:
        """Return whether it is over 0, by its interval and by more than the spread."""
        return self.estimate.low > 0 and self.estimate.value > self.spread

    @property
    def refuted(self) -> bool:
        """Return whether it is below 0, by its interval and by more than the spread."""
        return self.estimate.high < 0 and self.estimate.value < -self.spread

    @property
    def p(self) -> float:
        """Return the two-sided p value of a true value of 0; NaN without an error."""
        return self.error.p_value(self.estimate.value) if self.error else math.nan

    def shifted(self, by: float, sign: int) -> Requirement:
        """Return the requirement that sign times this value, and `by` more, is over 0."""
        low, high = sorted(by + sign * end for end in self.estimate[1:])
        return self._replace(estimate=Estimate(by + sign * self.estimate.value, low, high))


@dataclass(frozen=True)
class ClaimFinding:
    """The finding of a run about a claim."""

    subject: str  # the method that the claim is about
    numbers: str  # of the run, with intervals
    requirements: tuple[Requirement, ...] = ()  # of the claim; none where it cannot be tested
    reason: str = ""  # why it cannot be tested, or a remark that belongs to it

    @property
    def verdict(self) -> Verdict:
        """Return the verdict by the intervals, not corrected for other claims."""
        ends = [(r.estimate.low, r.estimate.high) for r in self.requirements]
        if not ends or not np.isfinite(ends).all():
            return "not testable here"
        if all(requirement.shown for requirement in self.requirements):
            return "supported"
        refuted = any(requirement.refuted for requirement in self.requirements)
        return "contradicted" if refuted else "undecided"

    @property
    def p(self) -> float:
        """Return the p value of the verdict.

        All requirements have to be over 0, or one of them below: the largest p value where all are
        over 0, else the smallest of those below, times the number of requirements. NaN where the
        claim cannot be tested.
        """
        if self.verdict == "not testable here":
            return math.nan
        below = [r.p for r in self.requirements if r.estimate.value <= 0]
        if not below:
            return max(requirement.p for requirement in self.requirements)
        return min(1.0, len(self.requirements) * min(below))

    @property
    def objects(self) -> int:
        """Return the fewest objects of a requirement; 0 where the claim cannot be tested."""
        return min((requirement.objects for requirement in self.requirements), default=0)

    @property
    def why(self) -> str:
        """Return the requirements that do not hold, and the reason."""
        missed = [r.name for r in self.requirements if r.name and not r.shown]
        tied = any(abs(r.estimate.value) <= r.spread for r in self.requirements)
        parts = [f"not shown: {', '.join(missed)}" if missed else "", self.reason]
        if tied and self.verdict == "undecided":
            parts.append("smaller than the spread between trainings")
        if self.requirements and self.verdict == "not testable here":
            parts[0] = "too few objects for an interval"
        return "; ".join(filter(None, parts))


def corrected(findings: Sequence[ClaimFinding]) -> list[Verdict]:
    """Return the verdicts of a family of claims, corrected for their number by Holm's procedure.

    A claim stays supported or contradicted where its corrected p value is below 0.05, else it
    becomes undecided.
    """
    p_values = holm([finding.p for finding in findings])
    return [
        finding.verdict
        if finding.verdict in ("not testable here", "undecided") or p < SIGNIFICANCE
        else "undecided"
        for finding, p in zip(findings, p_values, strict=True)
    ]


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p values corrected for their number, in their order; NaN stays and does not count."""
    known = sorted((p, i) for i, p in enumerate(p_values) if not math.isnan(p))
    corrected = [math.nan] * len(p_values)
    largest = 0.0
    for rank, (p, i) in enumerate(known):
        largest = max(largest, min(1.0, (len(known) - rank) * p))
        corrected[i] = largest
    return corrected


# --- evidence -------------------------------------------------------------------------------------


class MissingEvidence(Exception):
    """A run of the right suite that lacks a value which the claim needs."""


class Training(NamedTuple):
    """The facts about a network's weights that claims depend on."""

    width: float  # in widths of the paper's network
    degraded: bool  # whether the training showed clouds with fewer points and noise


@dataclass(frozen=True, eq=False)
class QualityEvidence:
    """A run with scored images."""

    compared: pd.DataFrame  # as `bench.analysis.compare.compare` returns it
    # By method and condition, the share of each chair's images that is found, [G].
    retrieval: Mapping[tuple[str, str], Floats] = field(default_factory=dict)
    trainings: Mapping[str, Training] = field(default_factory=dict)  # of known weights
    subjects: tuple[str, ...] = ()  # methods in place of the variants of pc2pix
    # By method, metric and condition, the spread between trainings on chairs.
    seeds: Mapping[tuple[str, str, str], float] = field(default_factory=dict)

    @property
    def networks(self) -> list[str]:
        """Return the methods that claims are about: `subjects`, or the variants of pc2pix."""
        methods = self.compared["method"].unique()
        ours = self.subjects or [m for m in methods if family_of(m) == NETWORK]
        networks = [method for method in methods if method in ours]
        if not networks:
            raise MissingEvidence(f"the run has no {' or '.join(self.subjects or (NETWORK,))}")
        return networks

    @cached_property
    def _rows(self) -> dict[str, dict[tuple[str, ...], Row]]:
        return by_method(self.compared)

    def quality(self, metric: str, method: str, condition: str, class_name: str) -> Row:
        """Return a metric of a method in one cell. Raises MissingEvidence without a value."""
        row = self._rows.get(method, {}).get((metric, condition, class_name))
        if row is None:
            known = class_name in self.classes(condition)
            lacks = f"{metric} of {method}" if known else f"{class_name} at {condition}"
            raise MissingEvidence(f"the run has no {lacks}")
        return row

    @property
    def distance(self) -> str:
        """Return the Fréchet distance that the run has."""
        measured = set(self.compared["metric"])
        return next((metric for metric in DISTANCES if metric in measured), DISTANCES[0])

    def classes(self, condition: str = FULL) -> list[str]:
        """Return the classes at a condition."""
        return self.compared.loc[self.compared["condition"] == condition, "class"].unique().tolist()


@dataclass(frozen=True, eq=False)
class TimingEvidence:
    """A run of the suite `speed`."""

    samples: pd.DataFrame  # as in `tables/speed_samples.csv`
    machine: str = "an unknown machine"  # its processor
    trainings: Mapping[str, Training] = field(default_factory=dict)  # of known weights


# A run of `latent` is given by the means of both its tables.
Evidence: TypeAlias = QualityEvidence | TimingEvidence | pd.DataFrame


# --- images ---------------------------------------------------------------------------------------


def ordering(
    run: QualityEvidence,
    ahead: Ahead,
    metric: str = DISTANCES[0],
    condition: str = FULL,
    class_name: str = CHAIR,
    subject: str | None = None,
    *,
    other: str = SURFACE,
    most: int | None = None,
) -> list[ClaimFinding]:
    """Test which of SR and the network is ahead in a class, or neither by more than `EQUAL`.

    class_name      or AVERAGE, the mean over classes
    subject, other  in place of the networks of the run, of which `most` are tested, and of SR
    """
    metric = _measured(run, metric)
    names = run.classes() if class_name == AVERAGE else [class_name]
    digits, findings = decimals(metric), []
    for method in [subject] if subject else run.networks[:most]:
        lead = _lead(run, metric, method, other, condition, names)
        match ahead:
            case "network":
                required = (lead,)
            case "surface":
                required = (lead.shifted(0.0, -1),)
            case "equal":  # two one-sided tests
                required = lead.shifted(EQUAL, 1), lead.shifted(EQUAL, -1)
            case "undecided":  # an effect that is not significant is never shown to be so
                required = (lead.shifted(0.0, -1 if lead.estimate.value > 0 else 1),)
        value, other_value = (
            np.mean([run.quality(metric, m, condition, name)["value"] for name in names])
            for m in (method, other)
        )
        numbers = (
            f"{metric} {value:.{digits}f}, {'SR' if other == SURFACE else other} "
            f"{other_value:.{digits}f}; ahead by {_text(metric, lead.estimate)}"
        )
        if lead.spread:
            numbers += f"; trainings differ by {lead.spread:.{digits}f}"
        findings.append(ClaimFinding(method, numbers, required, _stand_in(metric)))
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
        _lead(run, metric, method, floor, condition)._replace(
            name=f"{metric} over {floor} at {condition}"
        )
        for metric in RECOGNISABLE
        for floor in FLOORS
        if floor != method
    ]
    shares = run.retrieval.get((method, condition))
    if shares is None:
        raise MissingEvidence(f"the run has no {_RETRIEVAL} of {method} at {condition}")
    above = shares - 1 / len(shares)
    return [*required, _mean_over_objects(f"{_RETRIEVAL} over chance at {condition}", above)]


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
            _lead(run, metric, network, "blank", FULL)._replace(name=metric)
            for metric in ("ssim", run.distance)
        ]
        numbers = "; ".join(f"{r.name}: ahead by {_text(r.name, r.estimate)}" for r in leads)
        findings.append(ClaimFinding(network, numbers, tuple(leads)))
    return findings


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
        if training is not None and training.width == _PAPER_WIDTH:
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
    of_metric = means[(means["metric"] == metric) & (means["kind"] == "all")]
    wanted = [what] if than is None else [what, than]
    findings = []
    for method, rows in of_metric.groupby("method", sort=False):
        at: dict[str, Any] = {str(row.what): row for row in rows.itertuples()}
        if missing := [name for name in wanted if name not in at]:
            raise MissingEvidence(f"the run has no {metric} of {', '.join(missing)}")
        known = [Estimate(at[w].value, at[w].ci_low, at[w].ci_high) for w in wanted]
        texts = (
            f"of {name} {e.value:.3g} [{e.low:.3g}, {e.high:.3g}]"
            for name, e in zip(wanted, known, strict=True)
        )
        # The two are not independent: paths and sums are the same. Paired, the interval of their
        # difference would be shorter.
        a, b = (*known, Estimate(0.0, 0.0, 0.0))[:2]
        gap = a.value - b.value
        below = math.hypot(a.value - a.low, b.high - b.value)
        above = math.hypot(a.high - a.value, b.value - b.low)
        reach = below if gap > 0 else above
        # Half of an interval is 1.96 standard errors.
        error = StandardError(reach / 1.96, math.inf) if math.isfinite(reach) else None
        estimate = Estimate(gap, gap - below, gap + above)
        required = Requirement("", estimate, error, at[what].n_ok)
        findings.append(ClaimFinding(str(method), f"{metric} {', '.join(texts)}", (required,)))
    return findings


# --- in common ------------------------------------------------------------------------------------


def weighted_sum(name: str, terms: Sequence[tuple[float, Row]]) -> Requirement:
    """Require that a weighted sum of one metric over methods and conditions is over 0.

    The terms are paired object by object.
    """
    value = float(sum(weight * quality["value"] for weight, quality in terms))
    per_object = np.sum([weight * quality["samples"] for weight, quality in terms], axis=0)
    error = (mean_error if is_mean(terms[0][1]["metric"]) else jackknife_error)([per_object])
    return Requirement(name, QualityChange(value, error).estimate(), error, len(per_object))


def _lead(
    run: QualityEvidence,
    metric: str,
    method: str,
    other: str,
    condition: str,
    classes: Sequence[str] = (CHAIR,),
) -> Requirement:
    """Require that a method is better than another, in the mean over classes.

    On chairs, by more than trainings of it differ.
    """
    ours, others = (
        [run.quality(metric, m, condition, name) for name in classes] for m in (method, other)
    )
    objects = sum(len(quality["samples"]) for quality in ours)
    key = method, metric, condition
    spread = run.seeds.get(key, 0.0) if [*classes] == [CHAIR] else 0.0
    lead = better_by(ours, others)
    return Requirement("", lead.estimate(), lead.error, objects, spread)


def _mean_over_objects(name: str, per_object: Floats) -> Requirement:
    """Require that the mean over objects is over 0."""
    mean = QualityChange(float(per_object.mean()), mean_error([per_object]))
    return Requirement(name, mean.estimate(), mean.error, len(per_object))


def _loss(
    run: QualityEvidence, metric: str, method: str, condition: str
) -> list[tuple[float, Row]]:
    """Return the terms of how much worse a method is at a condition than with the full cloud."""
    sign = 1.0 if higher_is_better(metric) else -1.0
    full, less = (run.quality(metric, method, c, CHAIR) for c in (FULL, condition))
    return [(sign, full), (-sign, less)]


def _measured(run: QualityEvidence, metric: str) -> str:
    return run.distance if metric in DISTANCES else metric


def _stand_in(metric: str) -> str:
    return f"{metric} stands in for {DISTANCES[0]}" if metric == DISTANCES[1] else ""


def _text(metric: str, estimate: Estimate) -> str:
    digits = decimals(metric)
    value, low, high = (f"{number:+.{digits}f}" for number in estimate)
    return f"{value} [{low}, {high}]"
