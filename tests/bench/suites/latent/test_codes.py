from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest
import torch
from scipy.spatial.distance import cdist

from bench.analysis.intervals import mean_interval
from bench.judges import VIEWS_WEIGHTS
from bench.judges.views import load_views_network
from bench.suites.latent.chairs import ALL
from bench.suites.latent.codes import (
    chamfer_distances,
    cosine,
    cross_fade,
    family_confidence,
    image_steps,
    unevenness,
)
from bench.suites.latent.run import VALUES, means

NAN = float("nan")


def flat(*levels):
    return np.stack([np.full((128, 128, 3), level, np.uint8) for level in levels])


def test_unevenness_is_the_largest_step_over_the_mean():
    steps = image_steps(flat(0, 51, 102, 153))
    np.testing.assert_allclose(steps, [0.2, 0.2, 0.2], rtol=1e-15)
    assert unevenness(steps) == pytest.approx(1, rel=1e-15)
    # steps 1, 1, 2: the largest over the mean of 4/3
    assert unevenness(image_steps(flat(10, 20, 30, 50))) == pytest.approx(1.5, rel=1e-12)
    assert unevenness(image_steps(flat(7, 7, 7, 200, 200))) == pytest.approx(4)  # one jump
    assert math.isnan(unevenness(image_steps(flat(9, 9, 9))))


def test_chamfer():
    cloud = np.array([[[0, 0, 0], [1, 0, 0]]], np.float32)
    shifted = cloud + np.float32([0, 0.25, 0])
    assert chamfer_distances(cloud, shifted).tolist() == [0.125]  # 1/16 there and 1/16 back
    assert chamfer_distances(cloud, cloud).tolist() == [0]
    a, b = np.random.default_rng(0).normal(size=(2, 3, 50, 3)).astype(np.float32)
    squared = [cdist(p, q, "sqeuclidean") for p, q in zip(a, b, strict=True)]
    expected = [d.min(0).mean() + d.min(1).mean() for d in squared]
    # sums of 50 float32 numbers
    np.testing.assert_allclose(chamfer_distances(a, b), expected, rtol=1e-5)


def test_cross_fade():
    start, end = np.random.default_rng(1).integers(0, 256, (2, 6, 5, 3), dtype=np.uint8)
    faded = cross_fade(start, end, 5)
    assert np.array_equal(faded[0], start)
    assert np.array_equal(faded[-1], end)
    middle = (start.astype(int) + end + 1) // 2  # rounded half up
    assert np.array_equal(faded[2], middle)
    assert unevenness(image_steps(cross_fade(*flat(10, 80), 8))) == pytest.approx(1, abs=1e-12)


def test_family_confidence():
    network = load_views_network(VIEWS_WEIGHTS)
    images = np.random.default_rng(2).integers(0, 256, (3, 128, 128, 3), dtype=np.uint8)
    with torch.no_grad():
        head = network.heads["family"]
        head.weight.zero_()
        head.bias.zero_()
        families = len(network.labels.families)  # all equally likely
        equal = np.full(3, 1 / families)
        np.testing.assert_allclose(family_confidence(network, images), equal, rtol=1e-12)
        head.bias[2] = math.log(families - 1)  # as likely as all others together
        np.testing.assert_allclose(family_confidence(network, images), [0.5] * 3, rtol=1e-6)


def test_cosine():
    assert cosine(np.array([3.0, 4.0]), np.array([6.0, 8.0])) == pytest.approx(1)
    assert cosine(np.array([1.0, 0.0]), np.array([-1.0, 1.0])) == pytest.approx(-math.sqrt(0.5))
    assert math.isnan(cosine(np.zeros(2), np.ones(2)))


def values_of(numbers, what="code", kind=ALL, metric="step"):
    rows = [("pc2pix", what, kind, f"{kind} {i}", metric, x) for i, x in enumerate(numbers)]
    return pd.DataFrame(rows, columns=VALUES)


@pytest.mark.usefixtures("few_objects")
def test_means_and_intervals():
    """Missing values are counted; a kind has rows of its own after those of all."""
    (row,) = means("latent", values_of([1.0, 2.0, NAN, 6.0])).itertuples()
    assert (row.kind, row.value, row.n_ok, row.n) == (ALL, 3, 3, 4)
    assert (row.ci_low, row.ci_high) == mean_interval(np.array([1.0, 2.0, 6.0]))
    kinds = [values_of([1.0, 3.0], kind="arms"), values_of([8.0], kind="slats")]
    rows = means("latent", pd.concat(kinds)).itertuples()
    expected = [(ALL, 4, 3), ("arms", 2, 2), ("slats", 8, 1)]
    assert [(row.kind, row.value, row.n) for row in rows] == expected
