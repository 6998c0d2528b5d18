from __future__ import annotations

import numpy as np
import pytest
import torch

from bench.catalogue.metrics import (
    CONTROL_METRICS,
    FURTHER_METRICS,
    IMAGE_METRICS,
    JUDGE,
    SET_METRICS,
)
from bench.metrics import structural_similarity
from bench.metrics.inception_weights import WeightsUnavailable
from bench.metrics.structural_similarity import SsimPerImage, ssim_per_image
from bench.suites.stability import metric_cases
from bench.suites.stability.metric_cases import (
    FRECHET,
    ONE_WINDOW,
    ROUNDING,
    SUMS,
    MetricCase,
    Near,
    Refused,
)
from bench.suites.stability.metrics import CASES, METRICS, metric_outcomes, ssim_metrics


@pytest.fixture(scope="module")
def outcomes():
    return metric_outcomes()


def unexpected(outcomes):
    return {(outcome.case, outcome.subject) for outcome in outcomes if outcome.kind == "unexpected"}


def outcome_of(stated, given=lambda: (np.zeros(1), np.zeros(1)), **metrics):
    """Return the outcome of an invented case on an invented metric."""
    (name,) = metrics
    case = MetricCase("made-up", "tests", given, {name: stated})
    (outcome,) = metric_outcomes([case], metrics)
    return outcome


def test_every_case_is_as_stated(outcomes):
    assert unexpected(outcomes) == set()
    cells = [(o.case, o.subject) for o in outcomes]
    assert len(cells) == len(set(cells)) == sum(len(case.stated) for case in CASES)
    assert len({case.id for case in CASES}) == len(CASES)
    groups = [case.group for case in CASES]
    starts = [a for a, b in zip(groups, ["", *groups], strict=False) if a != b]
    assert len(starts) == len(set(starts)), "cases of a group stand together"


def test_every_metric_is_there(outcomes):
    bundled = {source.id for source in SET_METRICS} - {"fid"} | {JUDGE, FRECHET}
    angles = set(CONTROL_METRICS) - {"retrieval"}
    of_images = {*IMAGE_METRICS, *FURTHER_METRICS}
    assert set(METRICS) == of_images | bundled | angles
    for kind in ("holds", "refused"):
        shown = {outcome.subject for outcome in outcomes if outcome.kind == kind}
        assert shown == set(METRICS) - (angles if kind == "refused" else set())


def test_values_are_stated(outcomes):
    message = {(o.case, o.subject): (o.expected, o.observed) for o in outcomes}
    expected, observed = message["black-against-white", "ssim"]
    assert expected == "9.99900009999e-05 +-2e-13: C1 / (255^2 + C1)"  # 6.5025 / 65031.5025
    assert observed.startswith("9.9990000999")
    outcome = message["two-images", "thin-recall"]
    assert outcome == ("no value, 1 exactly: each by itself", "no value, 1")
    expected, observed = message["no-rows", FRECHET]
    assert expected == "TooFewSamples: ...[0, 8]..."
    assert observed == "TooFewSamples: a covariance needs at least 2 samples, got float64 [0, 8]"


def in_float32(a, b):
    return SsimPerImage(*(np.float64(np.float32(z)) for z in ssim_per_image(a, b)))


def without_first_row(a, b):
    """One row of windows less, and none with the corner pixel."""
    return ssim_per_image(a[:, 1:], b[:, 1:])


@pytest.mark.parametrize("wrong", [in_float32, without_first_row])
def test_a_wrong_ssim_is_found_out(wrong):
    cases = [c for c in CASES if c.id.endswith(("-on-white", "-of-11x11"))]
    specks = {(f"one-level-{place}-on-white", "ssim") for place in ("corner", "middle")}
    outcomes = metric_outcomes(cases, {**METRICS, **ssim_metrics(wrong)})
    assert unexpected(outcomes) >= specks | {("noise-of-11x11", "structure")}


@pytest.mark.parametrize(
    ("value", "found"),
    [
        *((-1e-17, "-1e-17"), (float("nan"), "nan"), (float("inf"), "inf")),
        (1e-20 + 0j, "(1e-20+0j)"),
    ],
)
def test_a_distance_is_real_and_never_negative(value, found):
    outcome = outcome_of(Near("0", 0.0, 1.0), **{FRECHET: lambda a, b: value})
    assert (outcome.kind, outcome.observed) == ("unexpected", f"{found}, which is no distance")


ONE = Near("1", 1.0, 1.0001e-9)  # the rounding of 1 + 1e-9 is 1e-16
NOTHING = Near("none", lambda a, b: np.empty(0))
MISSING = Near("none", float("nan"))


@pytest.mark.parametrize(
    ("stated", "found", "kind"),
    [
        (ONE, [1.0], "holds"),
        (ONE, [1.0 + 1e-9, 1.0 - 1e-9], "holds"),
        (ONE, [1.0 + 1e-9, 1.0 - 2e-9], "unexpected"),
        (ONE, [np.nan], "unexpected"),
        (ONE, [1.0, np.nan], "unexpected"),
        (ONE, [], "unexpected"),
        (ONE, [np.inf], "unexpected"),
        (NOTHING, [], "holds"),
        (NOTHING, [1.0], "unexpected"),
        (MISSING, [np.nan], "holds"),
        (MISSING, [0.0], "unexpected"),
    ],
)
def test_values_within_a_tolerance(stated, found, kind):
    assert outcome_of(stated, judge=lambda a, b: np.array(found)).kind == kind


def test_an_optional_package_that_is_absent_is_no_fault():
    outcome = outcome_of(Near("1", 1.0), judge=raising(WeightsUnavailable("not installed; run x")))
    assert (outcome.kind, outcome.observed) == ("refused", "skipped: not installed; run x")


def raising(error):
    def metric(a, b):
        raise error

    return metric


@pytest.mark.parametrize(
    ("metric", "kind"),
    [
        (raising(ValueError("pixels are float64")), "refused"),
        (raising(ValueError("pixels are strange")), "unexpected"),
        (raising(UnicodeError("pixels are float64")), "unexpected"),  # a ValueError of another kind
        (raising(KeyError("float64")), "unexpected"),
        (lambda a, b: 0.5, "unexpected"),
    ],
)
def test_a_refusal_has_a_name(metric, kind):
    assert outcome_of(Refused(ValueError, "float64"), judge=metric).kind == kind


@pytest.mark.parametrize(
    ("judge", "given", "observed"),
    [
        (raising(OSError("no weights")), 1, "OSError: no weights"),
        (lambda a, b: a / 0, 1, "RuntimeWarning: divide by zero encountered in divide"),
        (lambda a, b: 1.0, 0, "ZeroDivisionError"),
    ],
)
@pytest.mark.filterwarnings("ignore")  # the filter is its own
def test_whatever_goes_wrong_is_an_outcome(judge, given, observed):
    outcome = outcome_of(
        Near("1", 1.0),
        given=lambda: (np.ones(1), np.ones(1) * (1 // given)),
        judge=judge,
    )
    assert outcome.kind == "unexpected"
    assert outcome.observed.startswith(observed)


def test_one_thread_while_it_runs():
    torch.set_num_threads(2)
    threads = lambda a, b: np.array(float(torch.get_num_threads()))  # noqa: E731
    assert outcome_of(Near("one", 1.0), judge=threads).kind == "holds"
    assert torch.get_num_threads() == 2


def test_constants_and_tolerances_are_those_of_their_derivation():
    for name in ("C1", "C2", "C3", "WINDOW", "SIGMA"):
        ours, theirs = (getattr(m, name) for m in (metric_cases, structural_similarity))
        assert ours == pytest.approx(theirs, rel=1e-15)  # a square's rounding, twice
    assert pytest.approx(1753 * 2**-53, rel=1e-12) == SUMS
    # The corner pixel, one level off, moves the mean of 118^2 windows by 1.3e-12: it is resolved.
    assert SUMS < 1.3e-12 / 5
    assert 2e-11 < ONE_WINDOW < 2.5e-11
    assert ROUNDING >= 2048 * 2**-52
