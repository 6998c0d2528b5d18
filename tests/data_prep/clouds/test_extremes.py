from __future__ import annotations

import numpy as np
import pytest

from data_prep.clouds.extremes import extreme
from data_prep.clouds.sampling import face_areas
from data_prep.rendering.camera import project
from data_prep.scene import Mesh, PointCloud, View

SOURCE = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], [[1, 2, 3]])


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture
def cloud(rng):
    points = rng.uniform(-0.5, 0.5, (2048, 3)).astype(np.float32)
    return PointCloud(points, source=SOURCE)


def first(points, value):
    points[0, 0] = value
    return points


EXACT = {  # perturbations, and the points that they make of those of a cloud
    ("Count", 0): lambda points: points[:0],
    ("Count", 16): lambda points: points[:16],
    ("Count", 2048): lambda points: points,
    ("Equal",): lambda points: points[:1].repeat(2048, axis=0),
    ("Flattened", 1): lambda points: points * np.float32([1, 0, 0]),
    ("Flattened", 2): lambda points: points * np.float32([1, 1, 0]),
    ("FirstPoint", 1e30): lambda points: first(points, 1e30),
    ("FirstPoint", np.nan): lambda points: first(points, np.nan),
    ("Cast", "float64"): lambda points: points,
    ("Cast", "int64"): lambda points: 0 * points,  # all within +-0.5
    ("Strided",): lambda points: points,
    ("Repeated", 4): lambda points: points[::4].repeat(4, axis=0),
    ("Half",): lambda points: points[points[:, 0] < 0],
}
OTHERS = (("Count", 5000), ("TwoClusters",), ("Scaled", 1e-30), ("Shifted", 1e6), ("LastBit",))
OTHERS = (*OTHERS, ("Shuffled",), ("Kept", 0.01), ("Normalised", 1.0, 0.0, False))


@pytest.mark.parametrize("case", [*EXACT, *OTHERS], ids=str)
def test_every_perturbation_gives_a_cloud_of_the_same_source(case, cloud):
    before = cloud.points.copy()
    one, same = (extreme(*case).apply(cloud, np.random.default_rng(0)) for _ in range(2))
    assert one.points.dtype == np.float32
    assert one.source is SOURCE
    np.testing.assert_array_equal(cloud.points, before)
    expected = EXACT[case](before) if case in EXACT else same.points
    np.testing.assert_array_equal(one.points, expected)


def test_more_points_than_the_cloud_has_and_two_clusters(cloud, rng):
    more = extreme("Count", 5000).apply(cloud, rng).points
    assert more.shape == (5000, 3)
    assert (more[:, 2] == 0).all()  # on the source
    with pytest.raises(ValueError, match="not known"):
        extreme("Count", 5000).apply(PointCloud(cloud.points), rng)
    apart = extreme("TwoClusters").apply(cloud, rng).points
    # coordinates of +-0.5, shrunk to a tenth
    assert np.abs(apart[:1024] - (-0.9, 0, 0)).max() <= 0.05 + 1e-6
    assert np.abs(apart[1024:] - (0.9, 0, 0)).max() <= 0.05 + 1e-6


def test_scale_shift_and_types(cloud, rng):
    scaled = extreme("Scaled", 1e30).apply(cloud, rng).points.astype(float)
    np.testing.assert_allclose(scaled, cloud.points * 1e30, rtol=2**-23)
    shifted = extreme("Shifted", 1e6).apply(cloud, rng).points
    # float32 has 24 bits: its grid at 1e6 is 1/16
    assert np.abs(shifted[:, 0] - 1e6 - cloud.points[:, 0]).max() <= 1 / 32
    assert np.array_equal(shifted[:, 1:], cloud.points[:, 1:])
    half = extreme("Cast", "float16").apply(cloud, rng).points
    # 11 bits, hence half of 2^-11 in the octave below 0.5
    assert 0 < np.abs(half - cloud.points).max() <= 2**-13


def test_last_bits(rng):
    points = np.array([[0.0, 1.0, -1.0], [np.float32(1e-45), 0.3, -2.5]] * 1000, np.float32)
    moved = extreme("LastBit").apply(PointCloud(points), rng).points
    up, down = (np.nextafter(points, np.float32(goal)) for goal in (np.inf, -np.inf))
    shares = [(moved == kind).mean() for kind in (down, points, up)]
    assert ((moved == down) | (moved == points) | (moved == up)).all()
    # 6,000 coordinates, a third each: the standard deviation of a share is 0.0061
    assert np.abs(np.array(shares) - 1 / 3).max() < 4 * 0.0061


def test_subsets(cloud, rng):
    shuffled = extreme("Shuffled").apply(cloud, rng).points
    assert not np.array_equal(shuffled, cloud.points)
    assert np.array_equal(*(np.sort(p, axis=0) for p in (shuffled, cloud.points)))
    kept = extreme("Kept", 0.01).apply(cloud, rng).points
    rows = [np.flatnonzero((cloud.points == point).all(axis=1))[0] for point in kept]
    assert len(rows) == 20
    assert rows == sorted(rows)
    assert len(extreme("Kept", 1e-9).apply(cloud, rng)) == 1


def test_the_box_is_a_cube_in_the_unit_sphere(cloud, rng):
    made = extreme("UnitBox").apply(cloud, rng)
    half_side = 1 / np.sqrt(3)
    assert len(made) == 2048
    np.testing.assert_allclose(np.abs(made.points).max(axis=1), half_side, atol=1e-6)
    assert made.source is not None
    assert face_areas(made.source).sum() == pytest.approx(6 * (2 * half_side) ** 2, rel=1e-6)


def test_a_turned_cloud_is_seen_the_same_by_a_turned_camera(cloud, rng):
    turned, before, after = (
        extreme("Turned", 75.0).apply(cloud, rng),
        View(30.0, 20.0),
        View(105.0, 20.0),
    )
    for here, there in ((cloud.points, turned.points), (SOURCE.vertices, turned.source.vertices)):
        (pixels, depth), (seen, seen_depth) = project(here, before), project(there, after)
        # float32 coordinates up to 1, 58 px a unit at distance 3 and more
        np.testing.assert_allclose(seen, pixels, atol=2e-5)
        np.testing.assert_allclose(seen_depth, depth, atol=1e-6)


def test_place_and_size_are_nothing_once_normalised(cloud, rng):
    plain = extreme("Normalised", 1.0, 0.0, False).apply(cloud, rng).points
    for factor, distance in ((1e-30, 0), (1e30, 0), (1.0, 1e6), (1e3, 5.0)):
        far = extreme("Normalised", factor, distance, False).apply(cloud, rng).points
        # float64 at 1e6 has a grid of 1e-10; float32 rounds by 6e-8
        np.testing.assert_allclose(far, plain, atol=1.2e-7)
    assert np.linalg.norm(plain, axis=1).max() == pytest.approx(1.0, abs=1e-6)
    rounded = extreme("Normalised", 1000.0, 0.0, True).apply(cloud, rng).points
    # half a millimetre, of the point and of the centre, in a cloud of radius above 0.5; and as
    # much again by the radius
    assert 1e-5 < np.abs(rounded - plain).max() < 4 * 0.0005 / 0.5
