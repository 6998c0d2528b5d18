from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import t

from bench.analysis.compare import Estimate
from bench.analysis.intervals import StandardError, jackknife_interval, mean_interval
from bench.check import rules
from bench.check.claims import claims
from bench.check.rules import (
    ClaimFinding,
    MissingEvidence,
    QualityEvidence,
    Requirement,
    TimingEvidence,
    Training,
    corrected,
    holm,
    weighted_sum,
)

pytestmark = pytest.mark.usefixtures("few_objects")

CLAIMS = {claim.id: claim for claim in claims()}
JITTER = np.array([0.0, 0.01, -0.01, 0.02])


def quality(metric, value, jitter=JITTER):
    samples = value + jitter
    return {"metric": metric, "value": float(samples.mean()), "samples": samples}


def distance(metric, value, *leave_one_out):
    return {"metric": metric, "value": value, "samples": np.array(leave_one_out)}


def comparison(condition="2048", class_name="chair", **metrics):
    """Return rows of these values, by metric and method."""
    return [
        {"condition": condition, "class": class_name, "method": method}
        | (value if isinstance(value, dict) else quality(name.replace("_", "-"), value))
        for name, by_method in metrics.items()
        for method, value in by_method.items()
    ]


def scored(*comparisons, **more):
    return QualityEvidence(pd.DataFrame([row for of in comparisons for row in of]), **more)


def ssim(sr, network, condition="2048"):
    return comparison(condition, ssim={"surface-apss": sr, "pc2pix": network, "blank": 0.7})


def verdicts(findings):
    return [finding.verdict for finding in findings]


NOISY = quality("ssim", 0.52, np.array([0.3, -0.3, 0.2, -0.2]))


def test_means_are_combined_object_by_object():
    a = quality("ssim", 0.5, np.array([0.1, 0.0, -0.1, 0.2]))
    b = quality("ssim", 0.3, np.array([0.0, 0.0, 0.1, 0.1]))
    estimate = weighted_sum("", [(1, a), (-0.5, b)]).estimate
    per_object = np.array([0.6, 0.5, 0.4, 0.7]) - 0.5 * np.array([0.3, 0.3, 0.4, 0.4])
    assert estimate.value == pytest.approx(per_object.mean(), abs=1e-12)
    assert estimate[1:] == pytest.approx(mean_interval(per_object), abs=1e-12)


def test_distances_are_combined_by_the_jackknife():
    a = distance("fid", 10.0, 9.0, 10.0, 12.0)
    b = distance("fid", 4.0, 4.0, 3.0, 5.0)
    estimate = weighted_sum("", [(-1, a), (1, b)]).estimate
    assert estimate.value == -6
    expected = jackknife_interval(-6.0, [np.array([-5.0, -7.0, -7.0])])
    assert estimate[1:] == pytest.approx(expected, abs=1e-12)
    of_one = distance("fid", 10.0, 9.0)
    assert math.isnan(weighted_sum("", [(1, of_one)]).estimate.low)


@pytest.mark.parametrize(
    ("sr", "network", "ahead", "verdict"),
    [
        (0.5, 0.6, "network", "supported"),
        (0.5, 0.6, "surface", "contradicted"),
        (0.6, 0.5, "surface", "supported"),
        (0.6, 0.5, "network", "contradicted"),
        (0.5, 0.505, "equal", "supported"),
        (0.5, 0.495, "equal", "supported"),
        (0.5, 0.52, "equal", "contradicted"),
        (0.52, 0.5, "equal", "contradicted"),
        (0.5, NOISY, "equal", "undecided"),
        (0.5, 0.5, "network", "undecided"),
        (0.5, 0.5, "surface", "undecided"),
        (0.5, NOISY, "network", "undecided"),
        (0.5, 0.6, "undecided", "contradicted"),
        (0.6, 0.5, "undecided", "contradicted"),
        (0.5, NOISY, "undecided", "undecided"),
    ],
)
def test_orderings(sr, network, ahead, verdict):
    (finding,) = rules.ordering(scored(ssim(sr, network)), ahead, "ssim")
    assert (finding.subject, finding.verdict, finding.objects) == ("pc2pix", verdict, 4)


def requirement(value, reach, name="", error=1.0):
    estimate = Estimate(value, value - reach, value + reach)
    return Requirement(name, estimate, StandardError(error, 10.0), 12)


def test_what_is_smaller_than_the_spread_between_trainings_is_a_tie():
    """A lead of 0.1 whose interval leaves out 0 is decided below a spread of 0.1, not above."""
    for network, ahead, decided in (
        (0.6, "network", "supported"),
        (0.6, "surface", "contradicted"),
        (0.4, "network", "contradicted"),
    ):
        run = scored(ssim(0.5, network))
        for spread, verdict in ((0.05, decided), (0.15, "undecided")):
            seeds = {("pc2pix", "ssim", "2048"): spread}
            (finding,) = rules.ordering(replace(run, seeds=seeds), ahead, "ssim")
            assert finding.verdict == verdict
            assert finding.numbers.endswith(f"; trainings differ by {spread:.3f}")
            tied = "smaller than the spread between trainings"
            assert finding.why == (tied if verdict == "undecided" else "")
    # another network's, metric's or condition's is no matter
    seeds = {("pc2pix@acgan", "ssim", "2048"): 9.0, ("pc2pix", "ssim", "512"): 9.0}
    (finding,) = rules.ordering(replace(run, seeds=seeds), "network", "ssim")
    assert finding.verdict == "contradicted"
    assert "trainings" not in finding.numbers


def test_everything_that_is_required_has_to_hold():
    sure, open_, missed = (requirement(v, 0.5, n) for v, n in ((1, "a"), (0.2, "b"), (-1, "c")))
    for required, verdict, why in (
        ((sure, sure), "supported", ""),
        ((sure, open_), "undecided", "not shown: b"),
        ((sure, open_, missed), "contradicted", "not shown: b, c"),
        ((), "not testable here", ""),
        ((sure, requirement(1, math.nan)), "not testable here", "too few objects for an interval"),
    ):
        finding = ClaimFinding("pc2pix", "", required)
        assert (finding.verdict, finding.why) == (verdict, why)


def test_holm_by_hand():
    """Sorted .01 .03 .04: times 3, 2, 1, and never below the one before."""
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    corrected = holm([math.nan, 0.6, 0.5])
    assert math.isnan(corrected[0])
    assert corrected[1:] == [1.0, 1.0]
    assert holm([]) == []


def test_p_values_of_what_requires_several_things():
    """All over 0: the least sure one; one below: that one, times the number of requirements."""
    near, far, below = (requirement(v, 0.1) for v in (2.0, 5.0, -3.0))
    p = {of: 2 * t.sf(abs(of.estimate.value), 10) for of in (near, far, below)}
    assert ClaimFinding("x", "", (near, far)).p == pytest.approx(p[near])
    assert ClaimFinding("x", "", (near, below, far)).p == pytest.approx(3 * p[below])
    assert math.isnan(ClaimFinding("x", "").p)


def test_verdicts_are_corrected_for_their_number():
    """p = .0295 alone holds, with two others of one size it does not: Holm's first is times 3."""
    findings = [ClaimFinding("x", "", (requirement(2.5, 2.0, error=0.99),))] * 3
    assert findings[0].p == pytest.approx(2 * t.sf(2.5 / 0.99, 10))
    assert 0.05 / 3 < findings[0].p < 0.05
    assert corrected(findings[:1]) == ["supported"]
    assert corrected(findings) == ["undecided"] * 3
    assert corrected([findings[0], ClaimFinding("x", "")]) == ["supported", "not testable here"]


def test_every_network_is_judged():
    run = scored(
        comparison(ssim={"surface-apss": 0.6, "pc2pix": 0.7, "pc2pix@acgan": 0.5, "splat": 0.9})
    )
    findings = rules.ordering(run, "network", "ssim")
    assert [f.subject for f in findings] == ["pc2pix", "pc2pix@acgan"]
    assert verdicts(findings) == ["supported", "contradicted"]
    (findings,) = rules.ordering(replace(run, subjects=("splat",)), "network", "ssim")
    assert (findings.subject, findings.verdict) == ("splat", "supported")


@pytest.mark.parametrize(
    ("rule", "arguments", "message"),
    [
        (rules.ordering, ("network", "ssim", "512"), "no chair at 512"),
        (rules.ordering, ("network", "contrast"), "no contrast of pc2pix"),
        (rules.ordering, ("network", "ssim", "2048", "car"), "no car at 2048"),
    ],
)
def test_what_a_run_lacks(rule, arguments, message):
    with pytest.raises(MissingEvidence, match=message):
        rule(scored(ssim(0.5, 0.6)), *arguments)
    with pytest.raises(MissingEvidence, match="the run has no pc2pix"):
        rules.ordering(scored(comparison(ssim={"splat": 0.5})), "network", "ssim")


FLOORS = {"constant": 0.2, "blank": 0.2}


def steady_run(at, lpips=0.3, share=0.9, **more):
    """SSIM of SR and the network by condition; LPIPS of the network, of the floors .6."""
    runs = [
        comparison(
            condition,
            ssim={"surface-apss": sr, "pc2pix": network, **FLOORS},
            lpips={"pc2pix": lpips, "constant": 0.6, "blank": 0.6},
        )
        for condition, (sr, network) in at.items()
    ]
    shares = {("pc2pix", condition): share + JITTER for condition in at}
    return scored(*runs, retrieval=shares, **more)


@pytest.mark.parametrize(
    ("rule", "then", "verdict"),
    [  # of a loss of SR of 0.30 the network may have a tenth
        (rules.steady, {"512": (0.4, 0.58)}, "supported"),
        (rules.steady, {"512": (0.4, 0.65)}, "supported"),
        (rules.steady, {"512": (0.4, 0.56)}, "contradicted"),
        (rules.steady, {"1024": (0.5, 0.6)}, "supported"),
        (rules.steady, {"1024": (0.5, 0.6), "512": (0.4, 0.5)}, "contradicted"),
        (rules.degrades, {"1024": (0.5, 0.6), "512": (0.4, 0.5)}, "supported"),
        (rules.degrades, {"1024": (0.5, 0.6), "512": (0.7, 0.5)}, "undecided"),
        (rules.degrades, {"1024": (0.5, 0.6), "512": (0.8, 0.5)}, "contradicted"),
    ],
)
def test_losses_have_to_be_so_at_each_condition(rule, then, verdict):
    (finding,) = rule(steady_run({"2048": (0.7, 0.6), **then}), "ssim", tuple(then))
    assert finding.verdict == verdict
    if then == {"512": (0.4, 0.56)}:
        assert finding.why == "not shown: loss at 512"
        assert "512: loses +0.040 [+0.040, +0.040], SR +0.300" in finding.numbers


@pytest.mark.parametrize(
    ("change", "verdict", "why"),
    [
        ({}, "supported", ""),
        ({"lpips": 0.7}, "contradicted", "lpips over constant at 512, lpips over blank at 512"),
        ({"share": 0.24}, "undecided", "retrieval over chance at 512"),  # of 4 objects a quarter
        ({"share": 0.1}, "contradicted", "retrieval over chance at 512"),
    ],
)
def test_what_shows_nothing_is_not_robust(change, verdict, why):
    run = steady_run({"2048": (0.7, 0.6), "512": (0.4, 0.6)}, **change)
    (finding,) = rules.steady(run, "ssim", ("512",))
    assert finding.verdict == verdict
    assert finding.why == (f"not shown: {why}" if why else "")
    below = steady_run({"2048": (0.7, 0.1), "512": (0.4, 0.1)})
    (finding,) = rules.steady(below, "ssim", ("512",))
    assert finding.why == "not shown: ssim over constant at 512, ssim over blank at 512"
    with pytest.raises(MissingEvidence, match="no retrieval of pc2pix at 512"):
        rules.steady(replace(run, retrieval={}), "ssim", ("512",))


def test_above_blank():
    fd = {"surface-apss": 20.0, "pc2pix": 5.0, "blank": 50.0}
    for network, verdict in ((0.8, "supported"), (0.6, "contradicted")):
        values = {"surface-apss": 0.5, "pc2pix": network, "blank": 0.7}
        (finding,) = rules.above_blank(scored(comparison(ssim=values, fd_views=fd)))
        assert finding.verdict == verdict
    assert finding.why == "not shown: ssim"


@pytest.mark.parametrize(
    ("class_name", "ahead", "metric", "verdict"),
    [
        ("car", "network", "fid", "supported"),
        ("car", "surface", "fid", "contradicted"),
        ("car", "undecided", "fid", "contradicted"),
        ("rifle", "surface", "fid", "undecided"),
        ("rifle", "undecided", "fid", "undecided"),
        ("average", "network", "class-confidence", "supported"),
        ("average", "network", "fid", "undecided"),  # by the rifles
    ],
)
def test_classes(class_name, ahead, metric, verdict):
    open_ = distance("fd-views", 21.0, 1.0, 41.0, 1.0, 41.0)
    of_networks = {"car": 5.0, "rifle": open_}
    run = scored(
        *(
            comparison(
                class_name=name,
                fd_views={"surface-apss": 20.0, "pc2pix@all": value},
                class_confidence={"surface-apss": 0.3, "pc2pix@all": 0.4},
            )
            for name, value in of_networks.items()
        )
    )
    (finding,) = rules.ordering(run, ahead, metric, class_name=class_name, most=1)
    assert (finding.subject, finding.verdict) == ("pc2pix@all", verdict)
    if class_name == "car":
        assert finding.numbers == "fd-views 5.0, SR 20.0; ahead by +15.0 [+15.0, +15.0]"
    if metric == "fid" and class_name == "average":
        assert finding.numbers.startswith("fd-views 13.0, SR 20.0; ahead by +7.0 [")
        assert finding.objects == 8
    with pytest.raises(MissingEvidence, match="no lamp at 2048"):
        rules.ordering(run, "surface", class_name="lamp")


def test_other_methods_than_the_network_and_surface_reconstruction():
    values = {"true-mesh": 0.9, "surface-apss": quality("class-confidence", 0.3, -JITTER)}
    run = scored(
        comparison(class_name="car", class_confidence=values),
        comparison(class_name="lamp", class_confidence=values),
        comparison("512", "lamp", class_confidence=values | {"surface-apss": 0.0}),
    )
    (finding,) = CLAIMS["often-not-recognizable"].rule(run)
    assert (finding.subject, finding.verdict) == ("surface-apss", "supported")
    lost = 0.6 + 2 * JITTER
    low, high = mean_interval(lost, lost)
    assert finding.numbers == (
        "class-confidence 0.295, true-mesh 0.905; "
        f"ahead by -{lost.mean():.3f} [-{high:.3f}, -{low:.3f}]"
    )


def test_gains_from_others():
    for together, verdict in ((28.8, "supported"), (34.0, "contradicted")):
        values = {"pc2pix": 31.5, "pc2pix@all": together}
        rule = CLAIMS["chairs-gain-from-other-classes"].rule
        (finding,) = rule(scored(comparison(fid=values)))
        assert (finding.subject, finding.verdict) == ("pc2pix@all", verdict)
    assert finding.numbers.startswith("fid 34.0, pc2pix 31.5; ahead by -2.5 [")


def sample(method, cloud, stage, views, wall_s, number=1, threads=1, condition="2048"):
    return {
        "method": method, "condition": condition, "threads": threads, "cloud": cloud,
        "round": number, "stage": stage, "views": views, "wall_s": wall_s, "core_s": wall_s,
    }  # fmt: skip


def times():
    """20 images: SR 1.0 + 1.0 s and 2.0 + 1.0 s, pc2pix 0.05 + 0.15 s for all eight clouds."""
    rows = []
    for cloud, prepare in zip("qrstuvwx", (1.0, 2.0) * 4, strict=True):
        for method, first, then in (("surface-apss", prepare, 1.0), ("pc2pix", 0.05, 0.15)):
            rows += [
                sample(method, cloud, "prepare", 0, first),
                sample(method, cloud, "draw", 20, then),
            ]
            # what does not count: single views, the cold round, other threads and conditions
            rows += [
                sample(method, cloud, "draw", 1, 77.0),
                sample(method, cloud, "prepare", 0, 77.0, number=0),
                sample(method, cloud, "draw", 20, 77.0, threads=2),
                sample(method, cloud, "draw", 20, 77.0, condition="512"),
            ]
    return pd.DataFrame(rows)


PAPER = {"pc2pix": Training(1.0, degraded=False)}


def test_speed():
    run = TimingEvidence(times(), "a machine", PAPER)
    (finding,) = rules.faster(run, 1.0)
    assert (finding.subject, finding.verdict, finding.objects) == ("pc2pix", "supported", 8)
    low, high = np.exp(mean_interval(np.log([10.0, 15.0] * 4)))  # cloud by cloud
    ratio = f"{math.sqrt(150):.1f} times [{low:.1f}, {high:.1f}]"
    assert finding.numbers == f"{ratio} on a machine"
    assert verdicts(rules.faster(run, 9.0)) == ["supported"]
    assert verdicts(rules.faster(run, 12.0)) == ["undecided"]
    assert verdicts(rules.faster(run, 20.0)) == ["contradicted"]
    alone = times().query("method == 'pc2pix'")
    with pytest.raises(MissingEvidence, match="no times of surface-apss"):
        rules.faster(TimingEvidence(alone), 1.0)


@pytest.mark.parametrize(
    "lost",
    [
        "method == 'pc2pix' and cloud == 'q' and round > 0",
        "method == 'pc2pix' and cloud == 'q' and stage == 'draw' and views == 20",
        "method == 'surface-apss' and cloud == 'q' and stage == 'prepare'",
        "(method == 'pc2pix' and cloud == 'q') or (method == 'surface-apss' and cloud == 'r')",
    ],
)
def test_times_are_paired_by_the_names_of_the_clouds(lost):
    """Ratios of 10 and 15 by turns; a pairing by place has others, or none."""
    rows = times().query(f"not ({lost})")
    names = [name for name in "qrstuvwx" if "'r'" not in lost or name != "r"][1:]
    (finding,) = rules.faster(TimingEvidence(rows, "a machine", PAPER), 1.0)
    logs = np.log([10.0 if name in "qsuw" else 15.0 for name in names])
    low, high = np.exp(mean_interval(logs))
    assert finding.numbers.startswith(f"{math.exp(logs.mean()):.1f} times [{low:.1f}, {high:.1f}]")
    assert finding.objects == len(names)


def test_without_a_cloud_in_common_speed_is_not_testable():
    rows = times().query("method == 'pc2pix' or cloud == 'q'").query("not (cloud == 'q' and "
        "method == 'pc2pix')")  # fmt: skip
    (finding,) = rules.faster(TimingEvidence(rows, "a machine", PAPER), 1.0)
    assert (finding.subject, finding.verdict) == ("pc2pix", "not testable here")
    assert finding.reason == "the run has no cloud with times of surface-apss, too"


@pytest.mark.parametrize(
    ("known", "words"), [({}, "an unknown width"), ({"pc2pix": Training(0.25, True)}, "0.25 of")]
)
def test_speed_is_claimed_of_the_papers_width(known, words):
    (finding,) = rules.faster(TimingEvidence(times(), trainings=known), 1.0)
    assert finding.verdict == "not testable here"
    assert words in finding.reason
    assert finding.numbers.endswith(" on an unknown machine")


def test_latent_means():
    rows = [
        ("code", "family-confidence", "all", 0.8, 0.75, 0.85),
        ("cross-fade", "family-confidence", "all", 0.7, 0.68, 0.74),
        ("truth", "family-confidence", "all", 0.8, 0.7, 0.9),
        ("code", "cloud-gain", "all", 0.01, -0.001, 0.02),
        ("code", "cloud-gain", "arms", 0.01, 0.005, 0.02),
    ]
    names = ["what", "metric", "kind", "value", "ci_low", "ci_high"]
    run = pd.DataFrame(rows, columns=names).assign(method="pc2pix", n_ok=50)
    (finding,) = rules.mean_above(run, "family-confidence", "code", "cross-fade")
    assert finding.verdict == "supported"
    assert finding.numbers == (
        "family-confidence of code 0.8 [0.75, 0.85], of cross-fade 0.7 [0.68, 0.74]"
    )
    assert finding.objects == 50
    # independent: .1 - sqrt(.05^2 + .04^2) and .1 + sqrt(.05^2 + .02^2)
    (gap,) = finding.requirements
    expected = (0.1, 0.1 - math.hypot(0.05, 0.04), 0.1 + math.hypot(0.05, 0.02))
    assert gap.estimate == pytest.approx(expected)
    assert verdicts(rules.mean_above(run, "family-confidence", "code", "truth")) == ["undecided"]
    assert verdicts(rules.mean_above(run, "cloud-gain", "code")) == ["undecided"]
    with pytest.raises(MissingEvidence, match="no cloud-gain of nothing"):
        rules.mean_above(run, "cloud-gain", "code", "nothing")
