from __future__ import annotations

import re
import subprocess
import sys
import warnings

import numpy as np
import pytest
import scipy.linalg
import torch
from numpy.lib.stride_tricks import sliding_window_view

from bench.catalogue.metrics import CONTROL_METRICS, IMAGE_METRICS, JUDGE, SET_METRICS
from bench.metrics.structural_similarity import C1, C2, C3, SIGMA, WINDOW, SsimPerImage
from bench.suites.stability import metric_cases as metric_tolerances
from bench.suites.stability import metrics as stability_metrics
from bench.suites.stability.image_cases import gaussian_window
from bench.suites.stability.metric_cases import (
    FRECHET,
    ONE_WINDOW,
    ROUNDING,
    SUMS,
    Case,
    Near,
    Refused,
)
from bench.suites.stability.metrics import CASES, METRICS, metric_outcomes


@pytest.fixture(scope="module")
def outcomes():
    return metric_outcomes()


def unexpected(found):
    return {(outcome.case, outcome.subject) for outcome in found if outcome.kind == "unexpected"}


def outcome_of(monkeypatch, stated, given=lambda: (np.zeros(1), np.zeros(1)), **metrics):
    """The one outcome of a made-up case on a made-up metric."""
    for name, metric in metrics.items():
        monkeypatch.setitem(METRICS, name, metric)
    (name,) = metrics
    case = Case("made-up", "tests", given, {name: stated})
    monkeypatch.setattr(stability_metrics, "CASES", (case,))
    (outcome,) = metric_outcomes()
    return outcome


def test_every_case_is_as_stated(outcomes):
    assert [o for o in outcomes if o.kind == "unexpected"] == []
    assert {o.kind for o in outcomes} == {"holds", "refused"}


def test_one_outcome_a_cell(outcomes):
    cells = [(o.case, o.subject) for o in outcomes]
    assert len(cells) == len(set(cells)) == sum(len(case.stated) for case in CASES)
    ids = [case.id for case in CASES]
    assert len(ids) == len(set(ids))
    assert all(re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", case_id) for case_id in ids)
    groups = [case.group for case in CASES]
    starts = [a for a, b in zip(groups, ["", *groups], strict=False) if a != b]
    assert len(starts) == len(set(starts)), "cases of a group stand together"


def test_every_metric_is_there(outcomes):
    bundled = {source.id for source in SET_METRICS} - {"fid"} | {JUDGE, FRECHET}
    angles = set(CONTROL_METRICS) - {"retrieval"}
    assert set(METRICS) == set(IMAGE_METRICS) | bundled | angles
    for kind in ("holds", "refused"):
        shown = {outcome.subject for outcome in outcomes if outcome.kind == kind}
        assert shown == set(METRICS) - (angles if kind == "refused" else set())


def test_values_are_stated(outcomes):
    message = {(o.case, o.subject): (o.expected, o.observed) for o in outcomes}
    expected, observed = message["black-against-white", "ssim"]
    assert expected == "9.99900009999e-05 +-2e-13: C1 / (255^2 + C1)"  # 6.5025 / 65031.5025
    assert observed.startswith("9.9990000999")
    assert message["constant", FRECHET] == ("27 exactly: 3 (2 - 5)^2", "27")
    assert message["two-images", "thin-recall"] == (
        "no value, 1 exactly: each by itself",
        "no value, 1",
    )
    assert message["no-rows", FRECHET] == (
        "TooFewSamples: ...[0, 8]...",
        "TooFewSamples: a covariance needs at least 2 samples, got float64 [0, 8]",
    )


# --- metrics that are wrong are found out ---------------------------------------------------------


def by_sqrtm(x, y):
    """The usual way: as it is, complex or negative values included."""
    s1, s2 = (np.atleast_2d(np.cov(z, rowvar=False)) for z in (x, y))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        root = scipy.linalg.sqrtm(s1 @ s2)
    shift = x.mean(axis=0) - y.mean(axis=0)
    distance = shift @ shift + np.trace(s1) + np.trace(s2) - 2 * np.trace(root)
    return complex(distance) if np.iscomplexobj(distance) else float(distance)


def test_the_usual_frechet_distance_is_found_out(monkeypatch):
    monkeypatch.setitem(METRICS, FRECHET, by_sqrtm)
    found = metric_outcomes()
    assert {metric for _, metric in unexpected(found)} == {FRECHET}
    wrong = {case for case, _ in unexpected(found)}
    # fewer rows than features, rank, magnitude, and whatever has no name
    assert wrong >= {
        "identical-fewer-rows-than-features",
        "fewer-rows-than-features",
        "subspace-of-3-in-40",
        "overflow-when-squared",
        "one-row",
        "nan",
    }
    # and where that way is sound it agrees; of identical sets it gives 0 but for a rounding error,
    # whose sign, and so whether it is negative, depends on BLAS and the processor
    assert not wrong & {"full-rank", "another-order", "diagonal"}


def float32_moments(a, b):
    """SSIM [N] with moments in float32, E[x^2] - E[x]^2."""
    weights = gaussian_window(11).astype(np.float32)
    x, y = (
        sliding_window_view(z.astype(np.float32), (11, 11), axis=(1, 2)) for z in (a, b)
    )  # [N, rows, columns, C, 11, 11]
    mean_x, mean_y, xx, yy, xy = (np.tensordot(z, weights, 2) for z in (x, y, x * x, y * y, x * y))
    var_x, var_y = np.maximum(xx - mean_x**2, 0), np.maximum(yy - mean_y**2, 0)
    root = np.sqrt(var_x * var_y)
    luminance = (2 * mean_x * mean_y + C1) / (mean_x**2 + mean_y**2 + C1)
    contrast = (2 * root + C2) / (var_x + var_y + C2)
    structure = (xy - mean_x * mean_y + C3) / (root + C3)
    maps = (luminance * contrast * structure, luminance, contrast, structure)
    return SsimPerImage(*(z.mean(axis=(1, 2, 3), dtype=np.float64) for z in maps))


def test_moments_in_float32_are_found_out(monkeypatch):
    cases = tuple(c for c in CASES if c.id.endswith(("-on-white", "-of-11x11")))
    assert len(cases) == 5
    monkeypatch.setattr(stability_metrics, "CASES", cases)
    assert unexpected(metric_outcomes()) == set()
    monkeypatch.setattr(stability_metrics, "ssim_per_image", float32_moments)
    wrong = unexpected(metric_outcomes())
    # On white the moments are 65025, whose last bit in float32 is 0.004; the corner pixel is 1e-6.
    assert wrong >= {(c.id, name) for c in cases for name in ("ssim", "contrast")}


def test_a_shifted_window_is_found_out(monkeypatch):
    original = stability_metrics.ssim_per_image

    def late(a, b):
        return original(a[:, 1:], b[:, 1:])

    monkeypatch.setattr(stability_metrics, "ssim_per_image", late)
    wrong = unexpected(metric_outcomes())
    # without its first row an image has one row of windows less, and none with the corner pixel
    assert wrong >= {
        ("one-level-corner-on-white", "ssim"),
        ("one-level-middle-on-white", "ssim"),
        ("noise-of-11x11", "structure"),
    }


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (-1e-17, "-1e-17, which is no distance"),
        (float("nan"), "nan, which is no distance"),
        (float("inf"), "inf, which is no distance"),
        (1e-20 + 0j, "(1e-20+0j), which is no distance"),
    ],
)
def test_a_distance_is_real_and_never_negative(monkeypatch, value, message):
    outcome = outcome_of(monkeypatch, Near("0", 0.0, 1.0), **{FRECHET: lambda a, b: value})
    assert (outcome.kind, outcome.observed) == ("unexpected", message)


@pytest.mark.parametrize(
    ("found", "kind"),
    [
        ([1.0], "holds"),
        ([1.0 + 1e-9, 1.0 - 1e-9], "holds"),
        ([1.0 + 1e-9, 1.0 - 2e-9], "unexpected"),
        ([np.nan], "unexpected"),
        ([1.0, np.nan], "unexpected"),
        ([], "unexpected"),
        ([np.inf], "unexpected"),
    ],
)
def test_values_within_a_tolerance(monkeypatch, found, kind):
    stated = Near("1", 1.0, 1.0001e-9)  # the rounding of 1 + 1e-9 is 1e-16
    assert outcome_of(monkeypatch, stated, judge=lambda a, b: np.array(found)).kind == kind


def test_no_value_and_no_values_are_values_too(monkeypatch):
    nothing = Near("none", lambda a, b: np.empty(0))
    missing = Near("none", float("nan"))
    assert outcome_of(monkeypatch, nothing, judge=lambda a, b: np.empty(0)).kind == "holds"
    assert outcome_of(monkeypatch, nothing, judge=lambda a, b: np.ones(1)).kind == "unexpected"
    assert outcome_of(monkeypatch, missing, judge=lambda a, b: np.array([np.nan])).kind == "holds"
    assert outcome_of(monkeypatch, missing, judge=lambda a, b: np.zeros(1)).kind == "unexpected"


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
def test_a_refusal_has_a_name(monkeypatch, metric, kind):
    assert outcome_of(monkeypatch, Refused(ValueError, "float64"), judge=metric).kind == kind


def test_whatever_goes_wrong_is_an_outcome(monkeypatch):
    broken = outcome_of(monkeypatch, Near("1", 1.0), judge=raising(OSError("no weights")))
    assert (broken.kind, broken.observed) == ("unexpected", "OSError: no weights")
    warned = outcome_of(monkeypatch, Near("1", 1.0), judge=lambda a, b: np.ones(1) / np.zeros(1))
    assert (warned.kind, warned.observed) == (
        "unexpected",
        "RuntimeWarning: divide by zero encountered in divide",
    )
    no_input = outcome_of(
        monkeypatch, Near("1", 1.0), given=lambda: (np.zeros(1), 1 // 0), judge=lambda a, b: 1.0
    )
    assert no_input.kind == "unexpected"
    assert no_input.observed.startswith("ZeroDivisionError")


# --- the process it runs in -----------------------------------------------------------------------


def test_torch_is_loaded_only_when_it_runs():
    code = "import sys, bench.suites.stability.metrics; print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_one_thread_while_it_runs(monkeypatch):
    before = torch.get_num_threads()
    seen = outcome_of(
        monkeypatch, Near("one", 1.0), judge=lambda a, b: np.array(float(torch.get_num_threads()))
    )
    assert seen.kind == "holds"
    assert torch.get_num_threads() == before


def test_constants_are_those_of_the_protocol():
    ours = (metric_tolerances.C1, metric_tolerances.C2, metric_tolerances.C3)
    assert ours == pytest.approx((C1, C2, C3), rel=1e-15)  # a square's rounding, twice
    assert (metric_tolerances.WINDOW, metric_tolerances.SIGMA) == (WINDOW, SIGMA)


def test_tolerances_are_those_of_their_derivation():
    assert pytest.approx(1753 * 2**-53, rel=1e-12) == SUMS
    # The corner pixel, one level off, moves the mean of 118^2 windows by 1.3e-12: it is resolved.
    assert SUMS < 1.3e-12 / 5
    assert 2e-11 < ONE_WINDOW < 2.5e-11
    assert ROUNDING >= 2048 * 2**-52
