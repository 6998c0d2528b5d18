from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

import bench.catalogue.metrics
from bench.analysis.distances import SHARES
from bench.catalogue.metrics import (
    FURTHER_METRICS,
    FURTHER_SETS,
    IMAGE_METRICS,
    JUDGE,
    LEARNED_METRICS,
    NEIGHBOUR_METRICS,
    UNDEFINED,
    WeightsUnavailable,
    column,
    extractor_of,
    find_extractor,
    higher_is_better,
    is_mean,
    value_range,
)
from bench.catalogue.suites import SUITES
from bench.judges import VIEWS_WEIGHTS
from bench.judges.judge import CODE, JudgeNetwork, judge
from bench.metrics.image_scores import FURTHER_SCORES
from bench.records.record import Record
from data_prep.failures import BadInput

RNG = np.random.default_rng(0)
IMAGES = RNG.integers(0, 256, (3, 128, 128, 3), np.uint8)


def test_the_suites_ask_for_what_there_is():
    assert {column(metric) for metric in IMAGE_METRICS} <= set(Record.__dataclass_fields__)
    assert UNDEFINED.keys() < IMAGE_METRICS.keys()
    for suite in SUITES:
        assert {*suite.image_metrics, *suite.detail_metrics} <= IMAGE_METRICS.keys()
        for metric in suite.class_metrics:
            if not is_mean(metric):
                assert extractor_of(metric) in suite.extractors
        for metric in {*suite.detail_metrics, *suite.headline} & LEARNED_METRICS.keys():
            assert extractor_of(metric) in suite.extractors
        assert [find_extractor(name).id for name in suite.extractors] == list(suite.extractors)
    assert SUITES[0].extractors == ("fid", "fd-views", "fd-views-grey", "fd-alexnet", JUDGE)
    with pytest.raises(BadInput, match="unknown metric 'fd-view': did you mean 'fd-views'"):
        find_extractor("fd-view")


def test_metrics_on_request_are_means_of_no_suite():
    """And not of the records: columns and golden values of runs stay."""
    assert list(FURTHER_METRICS) == list(FURTHER_SCORES)
    for metric in FURTHER_METRICS:
        assert column(metric) not in Record.__dataclass_fields__
        assert is_mean(metric)
    assert value_range("silhouette-distance") == (0, pytest.approx(181.0193, abs=1e-4))
    assert value_range("dists") == value_range("fd-effnet") == (0, math.inf)
    assert value_range("flip") == value_range("ms-ssim") == (0, 1)


def test_shares_are_of_no_suite_and_more_is_better():
    assert list(SHARES) == list(NEIGHBOUR_METRICS)
    for metric in NEIGHBOUR_METRICS:
        assert (extractor_of(metric), value_range(metric)) == ("fd-alexnet", (0, 1))
        assert higher_is_better(metric)
        assert not is_mean(metric)
    asked = {m for suite in SUITES for m in (*suite.set_metrics, *suite.class_metrics)}
    assert not asked & set(FURTHER_SETS)
    assert not higher_is_better("dists")
    assert not higher_is_better("kd-effnet")


def test_grey_features_do_not_see_colour():
    colour, grey = (
        find_extractor(name).load(str(VIEWS_WEIGHTS)) for name in ("fd-views", "fd-views-grey")
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
    assert str(error.value) == "judge.safetensors is not bundled; 'bench train judge' makes it"
    torch.manual_seed(0)
    network = JudgeNetwork().eval()
    save_file({name: t.contiguous() for name, t in network.state_dict().items()}, path)
    source = find_extractor(JUDGE)
    assert source.weights(None) == path
    answers = source.load(str(path))(IMAGES)
    assert answers.shape == (3, 3 + CODE)
    # sums of up to 1,536 float32 products a layer, of kernels that are rounded once more
    np.testing.assert_allclose(answers, judge(network, IMAGES), rtol=1e-4, atol=1e-4)
