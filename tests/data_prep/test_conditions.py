from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from data_prep.conditions import (
    CONDITIONS,
    Condition,
    GaussianNoise,
    RandomSubset,
    Stride,
    Unchanged,
)
from data_prep.scene import Mesh, PointCloud

BY_ID = {condition.id: condition for condition in CONDITIONS}
MESH = Mesh(np.eye(3), [[0, 1, 2]], [[1, 2, 3]])
# All seeds are fixed. Were they not, each statistical test would fail once in ten thousand runs.
RARE = 1e-4
SIGMAS = stats.norm.isf(RARE / 2)  # 3.9


def cloud_of(count: int = 2048) -> PointCloud:
    """Row i is (i, -i, i / 2): every row tells where it comes from."""
    return PointCloud(np.arange(count)[:, None] * np.float32([1, -1, 0.5]), source=MESH)


def rows(cloud: PointCloud) -> list[int]:
    index = cloud.points[:, 0].astype(int)
    np.testing.assert_array_equal(cloud.points, cloud_of(3000).points[index])
    return index.tolist()


def apply(condition_id: str, cloud: PointCloud, seed: int = 0) -> PointCloud:
    return BY_ID[condition_id].perturbation.apply(cloud, np.random.default_rng(seed))


def test_the_papers_five_come_first() -> None:
    paper = [c.id for c in CONDITIONS if c.source.startswith("paper")]
    assert paper == ["2048", "1024", "512", "noise-0.05", "noise-0.10"]
    assert [c.id for c in CONDITIONS[:5]] == paper


def test_the_table_literally() -> None:
    assert {c.id: c.perturbation for c in CONDITIONS} == {
        "2048": Unchanged(),
        "1024": Stride(2),
        "512": Stride(4),
        "noise-0.05": GaussianNoise(0.05),
        "noise-0.10": GaussianNoise(0.10),
        "1024-random": RandomSubset(1024),
        "512-random": RandomSubset(512),
        "noise-0.05-code": GaussianNoise(0.10),
        "noise-0.10-code": GaussianNoise(0.20),
    }
    assert len(BY_ID) == len(CONDITIONS)


@pytest.mark.parametrize("condition", CONDITIONS, ids=lambda c: c.id)
def test_every_condition(condition: Condition) -> None:
    """What holds for all: the cloud itself stays, the source too, and the seed decides."""
    cloud = PointCloud(np.random.default_rng(1).normal(size=(2048, 3)), source=MESH)
    before = cloud.points.copy()
    one, same, other = (
        condition.perturbation.apply(cloud, np.random.default_rng(s)) for s in (5, 5, 6)
    )
    np.testing.assert_array_equal(cloud.points, before)
    assert one.source is MESH
    assert one.points.dtype == np.float32
    assert one.points.tobytes() == same.points.tobytes()
    draws = isinstance(condition.perturbation, RandomSubset | GaussianNoise)
    assert (one.points.tobytes() != other.points.tobytes()) == draws
    number = condition.id.partition("-")[0]
    assert len(one) == (int(number) if number.isdigit() else 2048)


def test_unchanged() -> None:
    cloud = cloud_of()
    assert apply("2048", cloud) is cloud


# --- fewer points ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("condition", "step"), [("1024", 2), ("512", 4)])
def test_stride_takes_exactly_these_rows(condition: str, step: int) -> None:
    assert rows(apply(condition, cloud_of())) == list(range(0, 2048, step))


@pytest.mark.parametrize("count", [0, 1, 3, 4, 5, 2047])
def test_stride_rounds_up(count: int) -> None:
    kept = Stride(4).apply(cloud_of(count), np.random.default_rng(0))
    assert len(kept) == math.ceil(count / 4)


def test_stride_uses_no_chance() -> None:
    rng = np.random.default_rng(0)
    before = rng.bit_generator.state
    Stride(2).apply(cloud_of(), rng)
    Unchanged().apply(cloud_of(), rng)
    assert rng.bit_generator.state == before


@pytest.mark.parametrize(("condition", "count"), [("1024-random", 1024), ("512-random", 512)])
def test_subset_without_replacement_in_order(condition: str, count: int) -> None:
    kept = rows(apply(condition, cloud_of()))
    assert len(kept) == count
    assert (np.diff(kept) > 0).all()
    assert kept[0] >= 0
    assert kept[-1] < 2048
    assert kept != list(range(0, 2048, 2048 // count))


def test_smaller_clouds_stay_whole() -> None:
    for count in (0, 3, 1024):
        cloud = cloud_of(count)
        assert apply("1024-random", cloud) is cloud
    assert len(apply("1024-random", cloud_of(1025))) == 1024


def test_every_row_is_kept_as_often_as_any_other() -> None:
    total, kept, draws = 16, 4, 4000
    rng = np.random.default_rng(3)
    counts = np.zeros(total)
    for _ in range(draws):
        counts[rows(RandomSubset(kept).apply(cloud_of(total), rng))] += 1
    # Drawing without replacement: each indicator has variance p (1 - p), and their sum is fixed,
    # which leaves N - 1 directions of variance p (1 - p) N / (N - 1).
    p = kept / total
    variance = draws * p * (1 - p) * total / (total - 1)
    statistic = ((counts - draws * p) ** 2).sum() / variance
    assert stats.chi2.ppf(RARE, total - 1) < statistic < stats.chi2.isf(RARE, total - 1)


# --- noise ----------------------------------------------------------------------------------------

NOISE = [
    (c.id, c.perturbation.sigma) for c in CONDITIONS if isinstance(c.perturbation, GaussianNoise)
]


@pytest.mark.parametrize(("condition", "sigma"), NOISE)
def test_noise_is_normal_with_the_stated_deviation(condition: str, sigma: float) -> None:
    cloud = PointCloud(np.zeros((20_000, 3)), source=MESH)
    noise = apply(condition, cloud).points.astype(np.float64)
    count = noise.size
    # Standard errors: of a mean sigma / sqrt(n), of a standard deviation sigma / sqrt(2 n), of a
    # correlation 1 / sqrt(rows).
    assert abs(noise.mean()) < SIGMAS * sigma / math.sqrt(count)
    assert abs(noise.std() - sigma) < SIGMAS * sigma / math.sqrt(2 * count)
    assert stats.kstest(noise.ravel() / sigma, stats.norm.cdf).pvalue > RARE
    correlation = np.corrcoef(noise.T)[np.triu_indices(3, 1)]
    assert np.abs(correlation).max() < SIGMAS / math.sqrt(20_000)
    # Nothing is clipped: of 60,000 values some lie beyond 3.5 sigma (28 expected).
    assert np.abs(noise).max() > 3.5 * sigma


def test_noise_is_added_to_each_point() -> None:
    points = np.random.default_rng(2).uniform(-1, 1, (2048, 3)).astype(np.float32)
    zero, moved = (apply("noise-0.05", PointCloud(p)).points for p in (0 * points, points))
    # One float32 addition: half an ulp of at most 2 (1 + noise), which is 2**-24.
    np.testing.assert_allclose(moved, points.astype(np.float64) + zero, rtol=0, atol=2.0**-24)


@pytest.mark.parametrize("level", ["0.05", "0.10"])
def test_the_codes_noise_is_twice_the_papers(level: str) -> None:
    cloud = PointCloud(np.zeros((2048, 3)))
    paper, code = (apply(f"noise-{level}{end}", cloud).points for end in ("", "-code"))
    np.testing.assert_array_equal(code, 2 * paper)  # the same draws; doubling is exact


def test_noise_on_nothing_and_on_nonsense() -> None:
    assert apply("noise-0.10", PointCloud(np.zeros((0, 3)))).points.shape == (0, 3)
    noisy = apply("noise-0.10", PointCloud([[np.nan, np.inf, 0.0]])).points[0]
    assert np.isnan(noisy[0])
    assert noisy[1] == np.inf
    assert np.isfinite(noisy[2])
