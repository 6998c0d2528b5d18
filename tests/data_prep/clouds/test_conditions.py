from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from bench.catalogue.conditions import CONDITIONS, needs_mesh
from data_prep.clouds.conditions import (
    Condition,
    GaussianNoise,
    Missing,
    MorePoints,
    Outliers,
    Stride,
    Unchanged,
    UnevenDensity,
)
from data_prep.clouds.sampling import sample_surface
from data_prep.failures import BadInput
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
    assert len(BY_ID) == len(CONDITIONS) == 20


OF_CLOUDS = [c for c in CONDITIONS if not needs_mesh(c.perturbation)]
OF_MESHES = [c for c in CONDITIONS if needs_mesh(c.perturbation)]


@pytest.mark.parametrize("condition", OF_CLOUDS, ids=lambda c: c.id)
def test_every_condition(condition: Condition) -> None:
    """The parameter is that of the name, the cloud itself stays, the source too, and the seed
    decides; of nothing, a point and one point many times comes no error and no value out of
    nowhere."""
    kind, _, number = condition.id.partition("-")
    classes = {"outliers": Outliers, "missing": Missing, "density": UnevenDensity}
    classes |= {"noise": GaussianNoise}
    expected = classes[kind](float(number)) if number else Stride(2048 // int(kind))
    made = condition.perturbation
    assert made == (Unchanged() if kind == "2048" else expected)
    cloud = PointCloud(np.random.default_rng(1).normal(size=(2048, 3)), source=MESH)
    before = cloud.points.copy()
    one, same, other = (made.apply(cloud, np.random.default_rng(s)) for s in (5, 5, 6))
    np.testing.assert_array_equal(cloud.points, before)
    assert one.source is MESH
    assert one.points.dtype == np.float32
    assert one.points.tobytes() == same.points.tobytes()
    draws = not isinstance(made, Unchanged | Stride)
    assert (one.points.tobytes() != other.points.tobytes()) == draws
    assert (one is cloud) == isinstance(made, Unchanged)
    counts = {"missing-0.25": 1536, "missing-0.50": 1024, "density-3": 1024, "density-10": 1024}
    assert len(one) == (int(kind) if kind.isdigit() else counts.get(condition.id, 2048))
    for count in (0, 1, 50):
        points = made.apply(PointCloud(np.full((count, 3), 0.1)), np.random.default_rng(0)).points
        assert np.isfinite(points).all()
        assert len(points) <= count
        if kind not in ("noise", "outliers"):
            assert (points == np.float32(0.1)).all()


@pytest.mark.parametrize("condition", OF_MESHES, ids=lambda c: c.id)
def test_conditions_that_sample_a_mesh_anew(condition: Condition) -> None:
    """The count is that of the name, the seed decides, and a cloud without a mesh is refused."""
    cloud = sample_surface(MESH, np.random.default_rng(1))
    one, same, other = (apply(condition.id, cloud, seed) for seed in (5, 5, 6))
    assert len(one) == {"8192": 8192, "32768": 32768}.get(condition.id, 2048)
    assert one.source is MESH
    assert one.colors is None
    assert one.points.tobytes() == same.points.tobytes() != other.points.tobytes()
    # On the plane x + y + z = 1 of the only face, within it.
    np.testing.assert_allclose(one.points.sum(axis=1), 1, rtol=0, atol=1e-6)
    assert one.points.min() > -1e-6
    with pytest.raises(BadInput, match="has no mesh, which this condition samples anew"):
        apply(condition.id, PointCloud(cloud.points))


def test_more_points_begin_with_those_of_fewer() -> None:
    cloud = sample_surface(MESH, np.random.default_rng(1))
    few, more, most = (
        MorePoints(count).apply(cloud, np.random.default_rng(2)).points
        for count in (1000, 8192, 10_000)
    )
    np.testing.assert_array_equal(few, cloud.points[:1000])
    np.testing.assert_array_equal(more[:2048], cloud.points)
    np.testing.assert_array_equal(most[:8192], more)
    assert len(np.unique(most, axis=0)) == len(most) == 10_000


@pytest.mark.parametrize("condition", CONDITIONS, ids=lambda c: c.id)
def test_points_keep_their_colours(condition: Condition) -> None:
    """Points in the planes z = 0 and z = 1 stay red and blue; colours do not change which stay."""
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]]
    mesh = Mesh(corners, [[0, 1, 2], [3, 4, 5]], [[200, 0, 0], [0, 0, 100]])
    cloud = sample_surface(mesh, np.random.default_rng(1), coloured=True)
    made = apply(condition.id, cloud, seed=2)
    plain = apply(condition.id, PointCloud(cloud.points, source=mesh), seed=2)
    np.testing.assert_array_equal(made.points, plain.points)
    assert made.colors is not None
    assert made.colors.shape == (len(made), 3)
    assert {tuple(color) for color in made.colors.tolist()} == {(200, 0, 0), (0, 0, 100)}
    moved = (made.points[:, 2] != 0) & (made.points[:, 2] != 1)
    blue = made.colors[:, 2] == 100
    np.testing.assert_array_equal(blue[~moved], made.points[~moved, 2] == 1)
    if isinstance(condition.perturbation, GaussianNoise | Outliers):  # in their rows, all of them
        np.testing.assert_array_equal(made.colors, cloud.colors)
    else:
        assert not moved.any()


def test_stride_takes_exactly_these_rows_and_uses_no_chance() -> None:
    rng = np.random.default_rng(0)
    before = rng.bit_generator.state
    assert rows(Stride(16).apply(cloud_of(), rng)) == list(range(0, 2048, 16))
    for count, kept in ((0, 0), (1, 1), (4, 1), (5, 2)):
        assert len(Stride(4).apply(Unchanged().apply(cloud_of(count), rng), rng)) == kept
    assert rng.bit_generator.state == before


def test_noise_is_normal_with_the_stated_deviation() -> None:
    sigma = 0.05
    noise = apply("noise-0.05", PointCloud(np.zeros((20_000, 3)))).points.astype(np.float64)
    count = noise.size
    # Standard errors: of a mean sigma / sqrt(n), of a standard deviation sigma / sqrt(2 n), of a
    # correlation 1 / sqrt(rows).
    assert abs(noise.mean()) < SIGMAS * sigma / math.sqrt(count)
    assert abs(noise.std() - sigma) < SIGMAS * sigma / math.sqrt(2 * count)
    assert stats.kstest(noise.ravel() / sigma, stats.norm.cdf).pvalue > RARE
    correlation = np.corrcoef(noise.T)[np.triu_indices(3, 1)]
    assert np.abs(correlation).max() < SIGMAS / math.sqrt(20_000)
    points = np.random.default_rng(2).uniform(-1, 1, (20_000, 3)).astype(np.float32)
    moved = apply("noise-0.05", PointCloud(points)).points
    # One float32 addition: half an ulp of at most 2 (1 + noise), which is 2**-24.
    np.testing.assert_allclose(moved, points.astype(np.float64) + noise, rtol=0, atol=2.0**-24)
    # Nothing is clipped: of 60,000 values some lie beyond 3.5 sigma (28 expected).
    assert np.abs(noise).max() > 3.5 * sigma


@pytest.mark.parametrize(
    ("condition", "count"), [("outliers-0.01", 20), ("outliers-0.05", 102), ("outliers-0.10", 205)]
)
def test_outliers_take_the_place_of_so_many_points(condition: str, count: int) -> None:
    """2,048 shares of 0.01, 0.05 and 0.1 are 20.48, 102.4 and 204.8."""
    cloud = cloud_of()
    before, after = cloud.points, apply(condition, cloud).points
    strayed = (before != after).any(axis=1)
    assert strayed.sum() == count
    assert strayed[:1024].any()
    assert strayed[1024:].any()
    assert np.linalg.norm(after[strayed], axis=1).max() <= 1
    assert rows(PointCloud(after[~strayed])) == np.flatnonzero(~strayed).tolist()


def test_outliers_are_uniform_in_the_ball() -> None:
    made = Outliers(1.0).apply(PointCloud(np.zeros((20_000, 3))), np.random.default_rng(4)).points
    radius = np.linalg.norm(made.astype(np.float64), axis=1)
    # The volume within a radius, and the area of a sphere below a height (Archimedes), are uniform.
    # 0.1 * sqrt(20,000) = 14: any other power of the radius would be seen.
    assert stats.kstest(radius**3, stats.uniform.cdf).pvalue > RARE
    for axis in range(3):
        height = made[:, axis] / radius
        assert stats.kstest(height, stats.uniform(-1, 2).cdf).pvalue > RARE
        assert abs(np.corrcoef(radius, height)[0, 1]) < SIGMAS / math.sqrt(20_000)


def ball(count: int, seed: int = 6) -> PointCloud:
    """Points in a ball: of any direction, no two of the same place."""
    return Outliers(1.0).apply(PointCloud(np.zeros((count, 3))), np.random.default_rng(seed))


@pytest.mark.parametrize(("condition", "count"), [("missing-0.25", 1536), ("missing-0.50", 1024)])
def test_a_plane_cuts_off_the_points_beyond_it(condition: str, count: int) -> None:
    cloud = ball(2048)
    normal = np.random.default_rng(7).normal(size=3)  # what the perturbation draws first
    x, y, z = cloud.points.astype(np.float64).T
    heights = x * normal[0] + y * normal[1] + z * normal[2]
    level = sorted(heights)[count]
    left = apply(condition, cloud, seed=7).points
    assert len(left) == count
    np.testing.assert_array_equal(left, cloud.points[heights < level])  # in their order


def test_missing_of_what_has_no_sides() -> None:
    same = PointCloud(np.zeros((10, 3)))
    assert len(Missing(0.25).apply(same, np.random.default_rng(0))) == 8  # round(2.5), to the even
    tied = PointCloud([[1.0, 0, 0]] * 4 + [[np.nan, 0, 0], [np.inf, -np.inf, 0]])
    left = Missing(0.5).apply(tied, np.random.default_rng(0)).points
    np.testing.assert_array_equal(left, tied.points[:3])


class Upright:
    """Random numbers that give a vertical axis and starts at equal steps through 0..1."""

    def __init__(self, starts: int) -> None:
        self.starts = iter((np.arange(starts) + 0.5) / starts)

    def normal(self, size: int) -> np.ndarray:
        return np.array([0.0, 3.0, 0.0])[:size]

    def random(self) -> float:
        return next(self.starts)


@pytest.mark.parametrize(("ratio", "power"), [(3.0, 0.3), (10.0, 1.0), (10.0, 3.0)])
def test_every_row_stays_with_exactly_its_chance(ratio: float, power: float) -> None:
    """Heights u^power: more points at one end, at none, at the other; more is where it is dense."""
    y = np.random.default_rng(9).random(400) ** power
    y[:2] = 0, 1
    cloud = PointCloud(np.c_[np.arange(400), y, np.zeros(400)])
    y = cloud.points[:, 1].astype(np.float64)
    t = y if y.mean() >= 0.5 else 1 - y
    weight = 1 + (ratio - 1) * t
    chance = 200 * weight / weight.sum()
    assert chance.max() <= 1
    assert chance[t == 1] / chance[t == 0] == pytest.approx(ratio, rel=1e-12)
    starts = 500
    counts, rng = np.zeros(400), Upright(starts)
    for _ in range(starts):
        made = UnevenDensity(ratio).apply(cloud, rng).points  # type: ignore[arg-type]
        kept = made[:, 0].astype(int)
        assert len(kept) == 200
        assert (np.diff(kept) > 0).all()  # none twice, in order
        counts[kept] += 1
    # A row stays for the starts of an arc of the circle 0..1 that is as long as its chance, and so
    # many equal steps hold one more or one less of them.
    assert np.abs(counts - starts * chance).max() <= 1


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_without_extent_every_second_row_stays(bad: float) -> None:
    for cloud in (
        PointCloud(np.full((11, 3), 0.5)),
        PointCloud(np.r_[[[bad, -bad, 0.0]], ball(10).points]),
    ):
        made = UnevenDensity(10).apply(cloud, np.random.default_rng(0)).points
        assert len(made) == 5
    steps = np.diff(rows(UnevenDensity(1).apply(cloud_of(64), np.random.default_rng(0))))
    assert (steps == 2).all()
