from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest
from scipy.stats import t

from bench.analysis.comparison import Comparison, Estimate, Quality
from bench.analysis.intervals import interval_of_means, jackknife_interval, mean_interval
from bench.checking import claim_rules as rules
from bench.checking.claim_rules import Lacking, Scored, combined
from bench.tables.orderings import Ordering, orderings_table

pytestmark = pytest.mark.usefixtures("few_objects")

OBJECTS = ("a", "b", "c", "d")
JITTER = np.array([0.0, 0.01, -0.01, 0.02])


def quality(metric, value, jitter=JITTER):
    per_object = value + jitter
    return Quality(metric, Estimate(float(per_object.mean()), math.nan, math.nan), per_object)


def comparison(condition="2048", class_name="chair", **metrics):
    """By metric, values by method."""
    qualities = {}
    for name, by_method in metrics.items():
        metric = name.replace("_", "-")
        qualities[metric] = {
            method: found if isinstance(found, Quality) else quality(metric, found)
            for method, found in by_method.items()
        }
    methods = list(next(iter(qualities.values())))
    nothing = dict.fromkeys(methods, np.zeros(4))
    return Comparison(
        condition, class_name, OBJECTS, nothing, nothing, dict.fromkeys(methods, (4, 4)), qualities
    )


def scored(*comparisons, orderings=None, spreads=None):
    return Scored({(c.condition, c.class_name): c for c in comparisons}, orderings, spreads or {})


def ssim(sr, network, condition="2048"):
    return comparison(condition, ssim={"surface-apss": sr, "pc2pix": network, "blank": 0.7})


def verdicts(found):
    return [finding.verdict for finding in found]


NOISY = quality("ssim", 0.52, np.array([0.3, -0.3, 0.2, -0.2]))


def test_means_are_combined_object_by_object():
    a = quality("ssim", 0.5, np.array([0.1, 0.0, -0.1, 0.2]))
    b = quality("ssim", 0.3, np.array([0.0, 0.0, 0.1, 0.1]))
    found = combined([(1, a), (-0.5, b)])
    per_object = np.array([0.6, 0.5, 0.4, 0.7]) - 0.5 * np.array([0.3, 0.3, 0.4, 0.4])
    assert found.value == pytest.approx(per_object.mean(), abs=1e-12)
    assert found[1:] == pytest.approx(mean_interval(per_object), abs=1e-12)


def test_distances_are_combined_by_the_jackknife():
    a = Quality("fid", Estimate(10.0, 0, 0), np.array([9.0, 10.0, 12.0]))
    b = Quality("fid", Estimate(4.0, 0, 0), np.array([4.0, 3.0, 5.0]))
    found = combined([(-1, a), (1, b)])
    assert found.value == -6
    expected = jackknife_interval(-6.0, [np.array([-5.0, -7.0, -7.0])])
    assert found[1:] == pytest.approx(expected, abs=1e-12)
    of_one = Quality("fid", Estimate(10.0, 0, 0), np.array([9.0]))
    assert math.isnan(combined([(1, of_one)]).low)


@pytest.mark.parametrize(
    ("sr", "network", "ahead", "verdict", "reason"),
    [
        (0.5, 0.6, "network", "supported", ""),
        (0.5, 0.6, "surface", "not supported", "the other way round"),
        (0.6, 0.5, "surface", "supported", ""),
        (0.6, 0.5, "network", "not supported", "the other way round"),
        (0.5, 0.505, "equal", "supported", ""),
        (0.5, 0.495, "equal", "supported", ""),
        (0.5, 0.52, "equal", "not supported", "not surely within 0.01 of each other"),
        (0.52, 0.5, "equal", "not supported", "not surely within 0.01 of each other"),
        (0.5, 0.5, "network", "not supported", "the interval holds 0"),
        (0.5, 0.5, "surface", "not supported", "the interval holds 0"),
        (0.5, NOISY, "network", "not supported", "the interval holds 0"),
    ],
)
def test_orderings(sr, network, ahead, verdict, reason):
    (found,) = rules.ordering(scored(ssim(sr, network)), "ssim", "2048", ahead)
    assert (found.subject, found.verdict, found.reason) == ("pc2pix", verdict, reason)


def test_smaller_distances_are_ahead_and_the_stand_in_is_named():
    distances = {"surface-apss": 20.0, "pc2pix": 5.0}
    (found,) = rules.ordering(scored(comparison(fd_views=distances)), "fid", "2048", "network")
    assert found.verdict == "supported"
    assert found.numbers.startswith("fd-views 5.0, SR 20.0; ahead by +15.0 [")
    assert found.reason == "fd-views stands in for fid"
    run = scored(comparison(fd_views=distances, fid={"surface-apss": 5.0, "pc2pix": 20.0}))
    (found,) = rules.ordering(run, "fid", "2048", "network")
    assert (found.verdict, found.reason) == ("not supported", "the other way round")


def test_every_network_is_judged():
    run = scored(
        comparison(ssim={"surface-apss": 0.6, "pc2pix": 0.7, "pc2pix@acgan": 0.5, "splat": 0.9})
    )
    found = rules.ordering(run, "ssim", "2048", "network")
    assert [f.subject for f in found] == ["pc2pix", "pc2pix@acgan"]
    assert verdicts(found) == ["supported", "not supported"]


@pytest.mark.parametrize(
    ("rule", "arguments", "message"),
    [
        (rules.ordering, ("ssim", "512", "network"), "no chair at 512"),
        (rules.ordering, ("contrast", "2048", "network"), "no contrast of pc2pix"),
        (rules.class_ordering, ("car", "network"), "has not both SR and pc2pix"),
        (rules.varies_more, ("lamp", "car"), "no features of lamp, car"),
    ],
)
def test_what_a_run_lacks(rule, arguments, message):
    with pytest.raises(Lacking, match=message):
        rule(scored(ssim(0.5, 0.6)), *arguments)
    with pytest.raises(Lacking, match="the run has no pc2pix"):
        rules.ordering(scored(comparison(ssim={"splat": 0.5})), "ssim", "2048", "network")


@pytest.mark.parametrize(
    ("rule", "then", "verdict"),
    [  # of a loss of SR of 0.30 the network may have a tenth
        (rules.steady, {"512": (0.4, 0.58)}, "supported"),
        (rules.steady, {"512": (0.4, 0.65)}, "supported"),
        (rules.steady, {"512": (0.4, 0.56)}, "not supported"),
        (rules.steady, {"1024": (0.5, 0.6)}, "supported"),
        (rules.steady, {"1024": (0.5, 0.6), "512": (0.4, 0.5)}, "not supported"),
        (rules.degrades, {"1024": (0.5, 0.6), "512": (0.4, 0.5)}, "supported"),
        (rules.degrades, {"1024": (0.5, 0.6), "512": (0.7, 0.5)}, "not supported"),
    ],
)
def test_losses_have_to_be_so_at_each_condition(rule, then, verdict):
    run = scored(ssim(0.7, 0.6), *(ssim(*values, name) for name, values in then.items()))
    (found,) = rule(run, "ssim", tuple(then))
    assert found.verdict == verdict
    if then == {"512": (0.4, 0.56)}:
        assert found.reason == "not surely less than 10% of SR's loss at each"
        assert "512: loses +0.040 [+0.040, +0.040], SR +0.300" in found.numbers


def test_distances_lose_by_growing():
    run = scored(
        comparison(fid={"surface-apss": 90.0, "pc2pix": 30.0}),
        comparison("512", fid={"surface-apss": 180.0, "pc2pix": 37.0}),
    )
    (found,) = rules.steady(run, "fid", ("512",))
    assert (found.verdict, found.reason) == ("supported", "")
    assert "512: loses +7.0 [+7.0, +7.0], SR +90.0" in found.numbers
    assert verdicts(rules.degrades(run, "fid", ("512",))) == ["supported"]


def test_above_blank():
    fd = {"surface-apss": 20.0, "pc2pix": 5.0, "blank": 50.0}
    for network, verdict in ((0.8, "supported"), (0.6, "not supported")):
        of = {"surface-apss": 0.5, "pc2pix": network, "blank": 0.7}
        (found,) = rules.above_blank(scored(comparison(ssim=of, fd_views=fd)))
        assert found.verdict == verdict
    assert found.reason == "not surely ahead of a blank picture by ssim"


def with_orderings(*rows):
    return scored(
        comparison(class_name="car", fd_views={"surface-apss": 20.0, "pc2pix@all": 5.0}),
        orderings=orderings_table("thirteen-classes", "pc2pix@all", rows),
    )


def ordered(metric, class_name, lead):
    return Ordering("2048", class_name, metric, 20.0, 5.0, Estimate(*lead), 1.0, 30, "pc2pix@all")


@pytest.mark.parametrize(
    ("class_name", "ahead", "metric", "verdict"),
    [
        ("car", "network", None, "supported"),
        ("car", "surface", None, "not supported"),
        ("car", "undecided", None, "not supported"),
        ("rifle", "surface", None, "not supported"),
        ("rifle", "undecided", None, "supported"),
        ("sofa", "undecided", None, "not supported"),
        ("average", "network", "class-confidence", "supported"),
    ],
)
def test_classes(class_name, ahead, metric, verdict):
    run = with_orderings(
        ordered("fd-views", "car", (15, 10, 20)),
        ordered("fd-views", "rifle", (-1, -3, 1)),
        ordered("fd-views", "sofa", (-5, -8, -2)),
        ordered("class-confidence", "average", (0.1, 0.05, 0.15)),
    )
    (found,) = rules.class_ordering(run, class_name, ahead, metric)
    assert (found.subject, found.verdict) == ("pc2pix@all", verdict)
    if class_name == "car":
        assert found.numbers == "fd-views 5.0, SR 20.0; ahead by +15.0 [+10.0, +20.0]"
    with pytest.raises(Lacking, match="no fd-views of class lamp"):
        rules.class_ordering(run, "lamp", "surface")


def test_no_interval_is_no_verdict():
    run = with_orderings(ordered("fd-views", "car", (15, math.nan, math.nan)))
    (found,) = rules.class_ordering(run, "car", "network")
    assert found.verdict == "not testable here"
    assert found.reason.startswith("too few objects for an interval")
    assert verdicts(rules.class_ordering(run, "car", "undecided")) == ["not testable here"]


def test_unrecognisable():
    of = {"true-mesh": 0.9, "surface-apss": quality("class-confidence", 0.3, -JITTER)}
    run = scored(
        comparison(class_name="car", class_confidence=of),
        comparison(class_name="lamp", class_confidence=of),
        comparison("512", "lamp", class_confidence=of | {"surface-apss": 0.0}),
    )
    (found,) = rules.unrecognisable(run)
    assert (found.subject, found.verdict) == ("surface-apss", "supported")
    lost = 0.6 + 2 * JITTER
    low, high = interval_of_means([lost, lost])
    assert found.numbers == (
        "class-confidence 0.295, true pictures 0.905; "
        f"loses +{lost.mean():.3f} [+{low:.3f}, +{high:.3f}]"
    )


def test_gains_from_others():
    for together, verdict in ((28.8, "supported"), (34.0, "not supported")):
        of = {"pc2pix": 31.5, "pc2pix@all": together}
        (found,) = rules.gains_from_others(scored(comparison(fid=of)), "pc2pix", "pc2pix@all")
        assert (found.subject, found.verdict) == ("pc2pix@all", verdict)
    assert found.numbers.startswith("fid 34.0, alone 31.5; better by -2.5 [")


def test_good_where_thin():
    left_out = np.array([9.0, 11.0, 10.0, 10.0])
    values = {"lamp": 10.0, "rifle": 12.0, "car": 30.0, "sofa": 40.0}
    distances = {k: Quality("fid", Estimate(v, 0, 0), left_out) for k, v in values.items()}
    run = scored(*(comparison(class_name=k, fid={"surface-apss": v}) for k, v in distances.items()))
    (found,) = rules.good_where_thin(run, ("lamp", "rifle"))
    # each class: 3/4 (1 + 1) = 1.5; the mean of two 3/4; a difference of two such 1.5
    # each mean has a reach by Student's t, of 3/2 = (3/4 + 3/4)^2 / (3/4^2 + 3/4^2) x 3 = 6 degrees
    reach = t.ppf(0.975, 6) * math.sqrt(1.5)
    assert found.verdict == "supported"
    assert found.numbers == (
        f"fid 11.0, others 35.0; nearer by +24.0 [+{24 - reach:.1f}, +{24 + reach:.1f}]"
    )
    assert verdicts(rules.good_where_thin(run, ("car", "sofa"))) == ["not supported"]
    with pytest.raises(Lacking, match="no airplane"):
        rules.good_where_thin(run, ("airplane",))
    with pytest.raises(Lacking, match="no other class"):
        rules.good_where_thin(run, tuple(values))


def test_varies_more():
    spreads = {
        "lamp": (9.0, np.array([8.0, 10.0, 9.0])),  # 2/3 (1 + 1) = 4/3
        "car": (2.0, np.array([2.0, 2.0])),
        "sofa": (20.0, np.array([20.0, 20.0])),
    }
    run = scored(ssim(0.5, 0.5), spreads=spreads)
    (found,) = rules.varies_more(run, "lamp", "car")
    assert found.verdict == "supported"
    reach = t.ppf(0.975, 2) * math.sqrt(4 / 3)
    assert found.numbers == (
        f"variance between objects 9.00, car 2.00; more by +7.0 [+{7 - reach:.1f}, "
        f"+{7 + reach:.1f}]; lamp is number 2 of 3"
    )
    assert verdicts(rules.varies_more(run, "car", "lamp")) == ["not supported"]


def sample(method, cloud, stage, views, wall_s, number=1, threads=1, condition="2048"):
    return {
        "method": method, "condition": condition, "threads": threads, "cloud": cloud,
        "round": number, "stage": stage, "views": views, "wall_s": wall_s, "core_s": wall_s,
    }  # fmt: skip


def times():
    """20 pictures: SR 1.0 + 1.0 s and 2.0 + 1.0 s, pc2pix 0.05 + 0.15 s for all eight clouds."""
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


def test_speed():
    (found,) = rules.faster(times(), 1.0)
    assert (found.subject, found.verdict) == ("pc2pix", "supported")
    low, high = np.exp(mean_interval(np.log([10.0, 15.0] * 4)))  # cloud by cloud
    assert found.numbers == f"{math.sqrt(150):.1f} times [{low:.1f}, {high:.1f}]"
    assert verdicts(rules.faster(times(), 9.0)) == ["supported"]
    (found,) = rules.faster(times(), 11.0)
    assert (found.verdict, found.reason) == ("not supported", "not surely more than 11 times")
    alone = times().query("method == 'pc2pix'")
    with pytest.raises(Lacking, match="no times of surface-apss"):
        rules.faster(alone, 1.0)


def test_latent_means():
    rows = [
        ("code", "family-confidence", "all", 0.8, 0.75, 0.85),
        ("cross-fade", "family-confidence", "all", 0.7, 0.68, 0.74),
        ("truth", "family-confidence", "all", 0.8, 0.7, 0.9),
        ("code", "cloud-gain", "all", 0.01, -0.001, 0.02),
        ("code", "cloud-gain", "arms", 0.01, 0.005, 0.02),
    ]
    names = ["what", "metric", "kind", "value", "ci_low", "ci_high"]
    run = pd.DataFrame(rows, columns=names).assign(method="pc2pix")
    (found,) = rules.mean_above(run, "family-confidence", "code", "cross-fade")
    assert found.verdict == "supported"
    assert found.numbers == (
        "family-confidence of code 0.8 [0.75, 0.85], of cross-fade 0.7 [0.68, 0.74]"
    )
    (found,) = rules.mean_above(run, "family-confidence", "code", "truth")
    assert (found.verdict, found.reason) == ("not supported", "not surely above it")
    (found,) = rules.mean_above(run, "cloud-gain", "code")
    assert (found.verdict, found.reason) == ("not supported", "not surely above 0")
    with pytest.raises(Lacking, match="no cloud-gain of nothing"):
        rules.mean_above(run, "cloud-gain", "code", "nothing")
