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
# The Fréchet distances that claims can be tested by. The first that a run has is taken: fd-views
# stands in for fid in runs without Inception weights.
DISTANCES = ("fid", "fd-views")
EQUAL = 0.01  # the largest difference between two scores that print alike with two decimals
# A network counts as steady where it loses less than this share of what surface reconstruction
# (SR) loses. In the paper the network loses 0.01 of SSIM where SR loses 0.40.
SHARE = 0.1
CONFIDENCE = "class-confidence"
_RETRIEVAL = "retrieval"
RECOGNISABLE = ("ssim", "lpips")  # metrics by which an image has to beat the reference methods
_PAPER_WIDTH = 1.0  # the width of the paper's network, which is the unit of all widths


# --- findings -------------------------------------------------------------------------------------


class Requirement(NamedTuple):
    """A value that has to be over 0 for a claim to hold.

    name      what the value is; empty where a claim requires nothing else
    estimate  the value with its 95 % interval over objects; NaN where the objects are too few
    error     the standard error of the value; None where the objects are too few
    objects   the number of objects that the value is computed from
    spread    the difference between the best and the worst of several trainings of the network
              that differ in their seeds only; 0 where that is not known, and where the value does
              not depend on the weights of a network
    """

    name: str
    estimate: Estimate
    error: StandardError | None
    objects: int
    spread: float = 0.0

    @property
    def shown(self) -> bool:
        """Return whether the value is over 0: its whole interval, and by more than the spread."""
        return self.estimate.low > 0 and self.estimate.value > self.spread

    @property
    def refuted(self) -> bool:
        """Return whether the value is below 0: its whole interval, and by more than the spread."""
        return self.estimate.high < 0 and self.estimate.value < -self.spread

    @property
    def p(self) -> float:
        """Return the two-sided p value under the hypothesis that the true value is 0.

        NaN without a standard error.
        """
        return self.error.p_value(self.estimate.value) if self.error else math.nan

    def shifted(self, by: float, sign: int) -> Requirement:
        """Return the requirement that `by + sign * value` is over 0; `sign` is 1 or -1."""
        low, high = sorted(by + sign * end for end in (self.estimate.low, self.estimate.high))
        return self._replace(estimate=Estimate(by + sign * self.estimate.value, low, high))


@dataclass(frozen=True)
class ClaimFinding:
    """The finding of a run about a claim."""

    subject: str  # the method that the claim is about
    numbers: str  # the run's values, with their intervals, as text
    requirements: tuple[Requirement, ...] = ()  # what the claim requires; empty if not testable
    reason: str = ""  # why the claim cannot be tested, or a remark on the values

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

        To be supported, all requirements have to be over 0: where all values are over 0, it is the
        largest of their p values. To be contradicted, one below 0 is enough: else it is the
        smallest p value of those below, times the number of requirements (Bonferroni's correction),
        at most 1. NaN where the claim cannot be tested.
        """
        if self.verdict == "not testable here":
            return math.nan
        p_below = [each.p for each in self.requirements if each.estimate.value <= 0]
        if not p_below:
            return max(each.p for each in self.requirements)
        return min(1.0, len(self.requirements) * min(p_below))

    @property
    def objects(self) -> int:
        """Return the smallest number of objects of a requirement; 0 where there is none."""
        return min((requirement.objects for requirement in self.requirements), default=0)

    @property
    def why(self) -> str:
        """Return the requirements that do not hold, and the reason."""
        missed = [each.name for each in self.requirements if each.name and not each.shown]
        tied = any(abs(each.estimate.value) <= each.spread for each in self.requirements)
        parts = []
        if self.requirements and self.verdict == "not testable here":
            parts.append("too few objects for an interval")
        elif missed:
            parts.append(f"not shown: {', '.join(missed)}")
        if self.reason:
            parts.append(self.reason)
        if tied and self.verdict == "undecided":
            parts.append("smaller than the spread between trainings")
        return "; ".join(parts)


def corrected(findings: Sequence[ClaimFinding]) -> list[Verdict]:
    """Return the verdicts of a family of claims, corrected for their number by Holm's procedure.

    A claim stays supported or contradicted where its corrected p value is below 0.05, else it
    becomes undecided.
    """
    verdicts: list[Verdict] = []
    p_values = holm([finding.p for finding in findings])
    for finding, p_value in zip(findings, p_values, strict=True):
        verdict = finding.verdict
        if verdict in ("supported", "contradicted") and not p_value < SIGNIFICANCE:
            verdict = "undecided"
        verdicts.append(verdict)
    return verdicts


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p values corrected for their number by Holm's procedure, in the order given.

    NaN stays NaN, and does not count as a test.
    """
    known = sorted((p, i) for i, p in enumerate(p_values) if not math.isnan(p))
    corrected = [math.nan] * len(p_values)
    largest = 0.0
    for rank, (p, i) in enumerate(known):
        largest = max(largest, min(1.0, (len(known) - rank) * p))
        corrected[i] = largest
    return corrected


# --- evidence -------------------------------------------------------------------------------------


class MissingEvidence(Exception):
    """Raised where a run of the right suite lacks a value that the claim needs."""


class Training(NamedTuple):
    """The facts about a network's weights that claims depend on."""

    width: float  # channels a layer, as a multiple of those of the paper's network
    degraded: bool  # whether it was trained on clouds with fewer points and with noise, too


@dataclass(frozen=True, eq=False)
class QualityEvidence:
    """The evidence of a run with scored images.

    compared   the scores, as `bench.analysis.compare.compare` returns them
    retrieval  for each method and condition, in which share of each chair's images the judge finds
               that chair, float64 [chairs]
    trainings  the facts about the weights of each method whose file of weights tells them
    subjects   the methods that claims about pc2pix are tested for; empty for all its variants
    seeds      for each method, metric and condition, the difference between the best and the worst
               of several trainings that differ in their seeds only, on chairs
    """

    compared: pd.DataFrame
    retrieval: Mapping[tuple[str, str], Floats] = field(default_factory=dict)
    trainings: Mapping[str, Training] = field(default_factory=dict)
    subjects: tuple[str, ...] = ()
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
        """Return the scores of a method by a metric, at a condition, on a class.

        Raises MissingEvidence where the run has none.
        """
        row = self._rows.get(method, {}).get((metric, condition, class_name))
        if row is None:
            known = class_name in self.classes(condition)
            lacks = f"{metric} of {method}" if known else f"{class_name} at {condition}"
            raise MissingEvidence(f"the run has no {lacks}")
        return row

    @property
    def distance(self) -> str:
        """Return the id of the Fréchet distance that the run has, or "fid" where it has none."""
        measured = set(self.compared["metric"])
        return next((metric for metric in DISTANCES if metric in measured), DISTANCES[0])

    def classes(self, condition: str = FULL) -> list[str]:
        """Return the classes that have scores at a condition."""
        return self.compared.loc[self.compared["condition"] == condition, "class"].unique().tolist()


@dataclass(frozen=True, eq=False)
class TimingEvidence:
    """The evidence of a run of the suite `speed`.

    samples    the measured times, as in `tables/speed_samples.csv`
    machine    the processor that they were measured on
    trainings  the facts about the weights of each method whose file of weights tells them
    """

    samples: pd.DataFrame
    machine: str = "an unknown machine"
    trainings: Mapping[str, Training] = field(default_factory=dict)


# The evidence of a run of the suite `latent` is a frame with the rows of both its tables.
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

    ahead       who the claim says is ahead: "surface" (SR), "network", "equal" or "undecided"
    class_name  the class, or AVERAGE for the mean over all classes
    subject     the method that is tested; by default the networks of the run
    other       the method that it is compared with, by default SR
    most        the largest number of networks that are tested; None for all
    """
    metric = _available(run, metric)
    names = run.classes() if class_name == AVERAGE else [class_name]
    digits, findings = decimals(metric), []
    for method in [subject] if subject else run.networks[:most]:
        lead = _lead(run, metric, method, other, condition, names)
        match ahead:
            case "network":
                required = (lead,)
            case "surface":
                required = (lead.shifted(0.0, -1),)
            case "equal":  # two one-sided tests: the lead is over -EQUAL and below EQUAL
                required = lead.shifted(EQUAL, 1), lead.shifted(EQUAL, -1)
            case "undecided":
                # That there is no difference cannot be shown, only contradicted. The requirement is
                # that the lead has the other sign than it has in this run: it never holds, and is
                # refuted by a significant lead.
                required = (lead.shifted(0.0, -1 if lead.estimate.value > 0 else 1),)
        value = _mean_quality(run, metric, method, condition, names)
        other_value = _mean_quality(run, metric, other, condition, names)
        label = "SR" if other == SURFACE else other
        numbers = (
            f"{metric} {value:.{digits}f}, {label} {other_value:.{digits}f}; "
            f"ahead by {_text(metric, lead.estimate)}"
        )
        if lead.spread:
            numbers += f"; trainings differ by {lead.spread:.{digits}f}"
        findings.append(ClaimFinding(method, numbers, required, _stand_in(metric)))
    return findings


def steady(run: QualityEvidence, metric: str, conditions: Sequence[str]) -> list[ClaimFinding]:
    """Test that the network loses less than `SHARE` of what SR loses, at each condition.

    A loss is how much worse the score is than with the full cloud. A method that always draws the
    same image loses nothing. So the network's images also have to be better than those of the
    reference methods by each metric of `RECOGNISABLE`, and the judge has to find their object more
    often than by chance.
    """
    metric = _available(run, metric)
    findings = []
    for network in run.networks:
        texts, required = [], []
        for condition in conditions:
            network_loss = _loss(run, metric, network, condition)
            surface_loss = _loss(run, metric, SURFACE, condition)
            # SHARE * (loss of SR) - (loss of the network) has to be over 0.
            terms = [(-weight, quality) for weight, quality in network_loss]
            terms += [(SHARE * weight, quality) for weight, quality in surface_loss]
            required.append(weighted_sum(f"loss at {condition}", terms))
            required += _shows_something(run, network, condition)
            lost = _text(metric, weighted_sum("", network_loss).estimate)
            surface_lost = _text(metric, weighted_sum("", surface_loss).estimate)
            texts.append(f"{condition}: loses {lost}, SR {surface_lost}")
        training = run.trainings.get(network)
        remarks = []
        if training is not None and training.degraded:
            remarks.append("was shown such clouds in training")
        elif training is not None:
            remarks.append("was not shown such clouds")
        if stand_in := _stand_in(metric):
            remarks.append(stand_in)
        reason = "; ".join(remarks)
        findings.append(ClaimFinding(network, "; ".join([metric, *texts]), tuple(required), reason))
    return findings


def _shows_something(run: QualityEvidence, method: str, condition: str) -> list[Requirement]:
    """Require better images than each reference method's, which the judge knows beyond chance."""
    required = []
    for metric in RECOGNISABLE:
        for floor in FLOORS:
            if floor != method:
                lead = _lead(run, metric, method, floor, condition)
                required.append(lead._replace(name=f"{metric} over {floor} at {condition}"))
    shares = run.retrieval.get((method, condition))
    if shares is None:
        raise MissingEvidence(f"the run has no {_RETRIEVAL} of {method} at {condition}")
    above = shares - 1 / len(shares)
    return [*required, _mean_over_objects(f"{_RETRIEVAL} over chance at {condition}", above)]


def degrades(run: QualityEvidence, metric: str, conditions: Sequence[str]) -> list[ClaimFinding]:
    """Test that SR scores worse at each of the conditions than with the full cloud."""
    metric = _available(run, metric)
    losses = [weighted_sum(c, _loss(run, metric, SURFACE, c)) for c in conditions]
    numbers = "; ".join(f"{loss.name}: loses {_text(metric, loss.estimate)}" for loss in losses)
    return [ClaimFinding(SURFACE, f"{metric}; {numbers}", tuple(losses), _stand_in(metric))]


def above_blank(run: QualityEvidence) -> list[ClaimFinding]:
    """Test that the network's images are better than white ones, by SSIM and a Fréchet distance."""
    findings = []
    for network in run.networks:
        leads = [
            _lead(run, metric, network, "blank", FULL)._replace(name=metric)
            for metric in ("ssim", run.distance)
        ]
        numbers = "; ".join(
            f"{lead.name}: ahead by {_text(lead.name, lead.estimate)}" for lead in leads
        )
        findings.append(ClaimFinding(network, numbers, tuple(leads)))
    return findings


# --- speed ----------------------------------------------------------------------------------------


def faster(run: TimingEvidence, times: float) -> list[ClaimFinding]:
    """Test that an image by SR takes more than `times` as long as one by the network.

    The time includes that for preparing the cloud, on one thread. Times are compared cloud by
    cloud, and the interval is over the clouds for which both methods have times.
    """
    costs = _costs(run.samples)
    networks = [method for method in costs if family_of(method) == NETWORK]
    if SURFACE not in costs:
        raise MissingEvidence(f"the run has no times of {SURFACE}")
    if not networks:
        raise MissingEvidence(f"the run has no times of {NETWORK}")
    findings = []
    for network in networks:
        # The two are paired by the names of clouds. A cloud at which a method failed has no time.
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
    """Return, for each method, the seconds that an image of each cloud takes.

    They are the median time for preparing the cloud plus the median time for all its views, divided
    by the number of views.
    """
    warm = samples[(samples["round"] > 0) & (samples["threads"] == 1)]
    warm = warm[warm["condition"].astype(str) == FULL]
    costs, views = {}, warm["views"].max()
    for method, calls in warm.groupby("method", sort=False):
        batches = calls[(calls["stage"] == "draw") & (calls["views"] == views)]
        preparations = calls[calls["stage"] == "prepare"]
        prepare = preparations.groupby("cloud")["wall_s"].median()
        draw = batches.groupby("cloud")["wall_s"].median()
        costs[str(method)] = (prepare + draw) / views  # NaN where one of the two is missing
    return costs


# --- latent ---------------------------------------------------------------------------------------


def mean_above(
    means: pd.DataFrame, metric: str, what: str, than: str | None = None
) -> list[ClaimFinding]:
    """Test that a mean of the suite `latent` is above another one, or above 0.

    metric  the metric whose mean it is
    what    the row of the table that is tested, such as "a-b+c"
    than    the row that it has to be above; None for 0
    """
    of_metric = means[(means["metric"] == metric) & (means["kind"] == "all")]
    wanted = [what] if than is None else [what, than]
    findings = []
    for method, rows in of_metric.groupby("method", sort=False):
        at: dict[str, Any] = {str(row.what): row for row in rows.itertuples()}
        if missing := [name for name in wanted if name not in at]:
            raise MissingEvidence(f"the run has no {metric} of {', '.join(missing)}")
        estimates = [Estimate(at[name].value, at[name].ci_low, at[name].ci_high) for name in wanted]
        texts = (
            f"of {name} {mean.value:.3g} [{mean.low:.3g}, {mean.high:.3g}]"
            for name, mean in zip(wanted, estimates, strict=True)
        )
        first = estimates[0]
        second = estimates[1] if than is not None else Estimate(0.0, 0.0, 0.0)
        # The two means are taken as independent, though they are over the same paths or sums: the
        # interval of the difference is therefore longer than one from paired values would be.
        gap = first.value - second.value
        below = math.hypot(first.value - first.low, second.high - second.value)
        above = math.hypot(first.high - first.value, second.value - second.low)
        # The half of the interval that lies towards 0 decides. It is 1.96 standard errors long.
        reach = below if gap > 0 else above
        error = StandardError(reach / 1.96, math.inf) if math.isfinite(reach) else None
        estimate = Estimate(gap, gap - below, gap + above)
        required = Requirement("", estimate, error, at[what].n_ok)
        findings.append(ClaimFinding(str(method), f"{metric} {', '.join(texts)}", (required,)))
    return findings


# --- in common ------------------------------------------------------------------------------------


def weighted_sum(name: str, terms: Sequence[tuple[float, Row]]) -> Requirement:
    """Require that a weighted sum of scores by one metric is over 0.

    terms  the weights and the scores, of methods and conditions; the interval of the sum is over
           objects, whose scores are added up object by object
    """
    value = float(sum(weight * quality["value"] for weight, quality in terms))
    per_object = np.sum([weight * quality["samples"] for weight, quality in terms], axis=0)
    metric = terms[0][1]["metric"]
    error = mean_error([per_object]) if is_mean(metric) else jackknife_error([per_object])
    return Requirement(name, QualityChange(value, error).estimate(), error, len(per_object))


def _lead(
    run: QualityEvidence,
    metric: str,
    method: str,
    other: str,
    condition: str,
    classes: Sequence[str] = (CHAIR,),
) -> Requirement:
    """Require that a method scores better than another, in the mean over classes.

    On chairs it has to be better by more than its scores differ between trainings of it.
    """
    ours = [run.quality(metric, method, condition, name) for name in classes]
    others = [run.quality(metric, other, condition, name) for name in classes]
    objects = sum(len(quality["samples"]) for quality in ours)
    key = method, metric, condition
    spread = run.seeds.get(key, 0.0) if [*classes] == [CHAIR] else 0.0
    lead = better_by(ours, others)
    return Requirement("", lead.estimate(), lead.error, objects, spread)


def _mean_quality(
    run: QualityEvidence, metric: str, method: str, condition: str, classes: Sequence[str]
) -> float:
    """Return the mean over classes of the scores of a method."""
    values = [run.quality(metric, method, condition, name)["value"] for name in classes]
    return float(np.mean(values))


def _mean_over_objects(name: str, per_object: Floats) -> Requirement:
    """Require that the mean of one value for each object is over 0."""
    mean = QualityChange(float(per_object.mean()), mean_error([per_object]))
    return Requirement(name, mean.estimate(), mean.error, len(per_object))


def _loss(
    run: QualityEvidence, metric: str, method: str, condition: str
) -> list[tuple[float, Row]]:
    """Return weights and scores that add up to a method's loss against the full cloud, on chairs.

    The loss is positive where the method scores worse at the condition than with the full cloud.
    """
    sign = 1.0 if higher_is_better(metric) else -1.0
    full = run.quality(metric, method, FULL, CHAIR)
    at_condition = run.quality(metric, method, condition, CHAIR)
    return [(sign, full), (-sign, at_condition)]


def _available(run: QualityEvidence, metric: str) -> str:
    """Return the metric that stands for `metric` in a run: of Fréchet distances the one it has."""
    return run.distance if metric in DISTANCES else metric


def _stand_in(metric: str) -> str:
    """Return a remark where the metric stands in for FID, else an empty text."""
    return f"{metric} stands in for {DISTANCES[0]}" if metric == DISTANCES[1] else ""


def _text(metric: str, estimate: Estimate) -> str:
    """Return a value with its interval, with as many digits as the metric has in tables."""
    digits = decimals(metric)
    value, low, high = (f"{number:+.{digits}f}" for number in estimate)
    return f"{value} [{low}, {high}]"
