from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

import bench.catalogue.metrics
from bench.catalogue.metrics import (
    EXTRACTORS,
    FURTHER_METRICS,
    IMAGE_METRICS,
    JUDGE,
    METRICS,
    FeatureSource,
    WeightsUnavailable,
    column,
    extractor_of,
    find_extractor,
    higher_is_better,
    is_mean,
    lpips_network,
    value_range,
)
from bench.catalogue.suites import SUITES
from bench.judges import VIEWS_WEIGHTS
from bench.judges.judge import CODE, JudgeNetwork, judge
from bench.metrics.dists import dists
from bench.metrics.image_scores import FURTHER_SCORES, further_score
from bench.metrics.inception import FidInception, inception_features
from bench.metrics.packaged_weights import find_lpips_weights
from bench.records.job import COLUMNS
from data_prep.failures import BadInput, MissingDependency

FID = "fid"
RNG = np.random.default_rng(0)
IMAGES = RNG.integers(0, 256, (3, 128, 128, 3), np.uint8)


def test_the_suites_ask_for_what_there_is():
    assert {column(metric) for metric in IMAGE_METRICS} <= set(COLUMNS)
    assert {m.id for m in METRICS.values() if m.undefined} < {*IMAGE_METRICS}
    for suite in SUITES:
        assert {*suite.image_metrics, *suite.detail_metrics} <= {*IMAGE_METRICS}
        for metric in suite.class_metrics:
            if not is_mean(metric):
                assert extractor_of(metric) in suite.extractors
        for metric in (*suite.detail_metrics, *suite.headline):
            assert METRICS[metric].extractor in ("", *suite.extractors)
        assert [find_extractor(name).id for name in suite.extractors] == list(suite.extractors)
    assert SUITES[0].extractors == ("fid", "fd-views", "fd-views-grey", "fd-alexnet", JUDGE)
    with pytest.raises(BadInput, match="unknown metric 'fd-view': did you mean 'fd-views'"):
        find_extractor("fd-view")


def test_metrics_on_request_are_means_of_no_suite():
    """And not of the records: columns and golden values of runs stay."""
    assert list(FURTHER_METRICS) == list(FURTHER_SCORES)
    for metric in FURTHER_METRICS:
        assert column(metric) not in COLUMNS
        assert is_mean(metric)
    assert value_range("dists") == value_range("fd-alexnet") == (0, math.inf)
    assert value_range("flip") == (0, 1)
    assert not higher_is_better("dists")
    assert not higher_is_better("kd-alexnet")


def test_grey_features_do_not_see_colour():
    colour, grey = (
        find_extractor(name).load(str(VIEWS_WEIGHTS), "cpu")
        for name in ("fd-views", "fd-views-grey")
    )
    luma = ((IMAGES @ np.array([299, 587, 114]) + 500) // 1000).astype(np.uint8)  # Rec. 601
    expected = colour(np.stack([luma] * 3, axis=-1))
    np.testing.assert_array_equal(grey(IMAGES), expected)
    assert not np.allclose(colour(IMAGES), expected, atol=1e-3)
    np.testing.assert_array_equal(grey(np.stack([luma] * 3, axis=-1)), expected)


def test_the_judge_is_an_extractor_and_skipped_where_it_is_not_there(tmp_path, monkeypatch):
    path = tmp_path / "judge.safetensors"
    monkeypatch.setattr(bench.catalogue.metrics, "JUDGE_WEIGHTS", path)
    with pytest.raises(WeightsUnavailable) as error:
        find_extractor(JUDGE).weights(None)
    assert str(error.value) == f"{path} is missing; install pc2pix-bench again"
    torch.manual_seed(0)
    network = JudgeNetwork().eval()
    save_file({name: t.contiguous() for name, t in network.state_dict().items()}, path)
    source = find_extractor(JUDGE)
    assert source.weights(None) == path
    answers = source.load(str(path), "cpu")(IMAGES)
    assert answers.shape == (3, 3 + CODE)
    # sums of up to 1,536 float32 products a layer, of kernels that are rounded once more
    np.testing.assert_allclose(answers, judge(network, IMAGES), rtol=1e-4, atol=1e-4)


def of_every_extractor() -> list[tuple[FeatureSource, str]]:
    """Return the extractors whose weights need no download, with these."""
    return [(source, str(source.weights(None))) for source in EXTRACTORS if source.id != FID]


def test_nothing_of_a_network_stays_behind_on_the_cpu():
    """On PyTorch's device "meta", which computes shapes alone and refuses tensors of another.

    Each network gets through to the end, where its values would be brought back.
    """
    back = pytest.raises(NotImplementedError, match="Cannot copy out of meta tensor")
    for source, weights in of_every_extractor():
        with back:
            source.load(weights, "meta")(IMAGES)
    with back:
        inception_features(FidInception().to("meta"), IMAGES)
    network = lpips_network(str(find_lpips_weights()), "meta")
    seen = network.encode(IMAGES)
    assert {tensor.device.type for tensor in (*seen.layers, seen.features)} == {"meta"}
    with back:
        network.distance(seen, seen)
    with back:
        dists(IMAGES, IMAGES, single=True, device="meta")


@pytest.mark.skipif(torch.cuda.is_available(), reason="needs a machine without a GPU")
def test_a_gpu_that_is_not_there_is_refused():
    refused = pytest.raises(MissingDependency, match=r"^--device cuda: PyTorch .* --device cpu, or")
    for source, weights in of_every_extractor():
        with refused:
            source.load(weights, "cuda")
    with refused:
        lpips_network(str(find_lpips_weights()), "cuda")
    for metric in ("dists", "st-lpips"):
        with refused:
            further_score(metric, "cuda")(IMAGES, IMAGES)
    assert further_score("flip", "cuda") is FURTHER_SCORES["flip"]  # has no network
    assert further_score("dists", "auto")(IMAGES[:1], IMAGES[:1]) == [0]


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_a_gpu_gives_the_values_of_the_cpu():
    """To the rounding of float32: sums of up to 9,216 products, through at most 50 layers."""
    for source, weights in of_every_extractor():
        on_cpu, on_gpu = (source.load(weights, device)(IMAGES) for device in ("cpu", "cuda"))
        np.testing.assert_allclose(on_gpu, on_cpu, rtol=1e-4, atol=1e-4 * np.abs(on_cpu).max())
