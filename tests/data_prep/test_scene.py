from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from data_prep.scene import CLOUD_SIZE, IMAGE_SIZE, Mesh, PointCloud, View

VERTICES = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
FACES = [[0, 1, 2], [0, 2, 3]]
COLORS = [[255, 0, 7], [1, 2, 3]]


def test_sizes_of_the_paper_and_float64_rounded_to_nearest() -> None:
    assert (IMAGE_SIZE, CLOUD_SIZE) == (128, 2048)
    # One third of an ulp (2**-23 above 1) goes down, two thirds go up.
    ulp = 2.0**-23
    cloud = PointCloud(np.array([[1 + ulp / 3, 1 + 2 * ulp / 3, -1 - ulp / 3]]))
    assert cloud.points.tolist() == [[1.0, 1 + ulp, -1.0]]


def test_arrays_are_contiguous_copies_that_cannot_be_written() -> None:
    source = np.asfortranarray(VERTICES, dtype=np.float32)
    faces, colors = np.array(FACES, np.int32), np.array(COLORS, np.uint8)
    mesh, cloud = Mesh(source, faces, colors), PointCloud(source)
    source[:], faces[:], colors[:] = 9, 0, 9
    for array, values, dtype in (
        (mesh.vertices, VERTICES, np.float32),
        (cloud.points, VERTICES, np.float32),
        (mesh.faces, FACES, np.int32),
        (mesh.face_colors, COLORS, np.uint8),
    ):
        assert (array.tolist(), array.dtype) == (values, dtype)
        assert array.flags.c_contiguous
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1


def test_fields_cannot_be_replaced() -> None:
    for value, field in (
        (Mesh(VERTICES, FACES, COLORS), "faces"),
        (PointCloud(VERTICES), "points"),
        (View(0, 0), "azimuth_deg"),
    ):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(value, field, None)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"vertices": [0, 0, 0]}, r"vertices: expected shape \[N, 3\], got \[3\]"),
        ({"vertices": np.zeros((4, 2))}, r"vertices: .* got \[4, 2\]"),
        ({"vertices": np.zeros((1, 4, 3))}, r"vertices: .* got \[1, 4, 3\]"),
        ({"faces": [[0, 1, 2, 3]]}, r"faces: .* got \[1, 4\]"),
        ({"face_colors": [[1, 2, 3, 255]] * 2}, r"face_colors: .* got \[2, 4\]"),
        ({"face_colors": COLORS[:1]}, "1 rows for 2 faces"),
        ({"face_colors": np.zeros((3, 3))}, "3 rows for 2 faces"),
        ({"faces": [[0, 1, 2], [0, 1, 4]]}, r"outside 0\.\.3"),
        ({"faces": [[0, 1, 2], [0, 1, -1]]}, r"outside 0\.\.3"),
        ({"vertices": np.zeros((0, 3))}, "outside"),
        ({"face_colors": np.full((2, 3), 300)}, r"whole numbers in 0\.\.255"),
        ({"face_colors": np.full((2, 3), 0.5)}, "face_colors: expected whole numbers"),
        ({"faces": np.array([[0, 1, 2**32 + 2]] * 2)}, "faces: expected whole numbers"),
    ],
)
def test_impossible_meshes(change: dict[str, object], problem: str) -> None:
    parts = {"vertices": VERTICES, "faces": FACES, "face_colors": COLORS} | change
    with pytest.raises(ValueError, match=problem):
        Mesh(**parts)


def test_mesh_without_faces_and_clouds_of_any_points() -> None:
    for vertices in (VERTICES, np.zeros((0, 3))):
        mesh = Mesh(vertices, np.zeros((0, 3)), np.zeros((0, 3)))
        assert mesh.faces.shape == mesh.face_colors.shape == (0, 3)
        assert (mesh.faces.dtype, mesh.face_colors.dtype) == (np.int32, np.uint8)
    mesh = Mesh(VERTICES, [[3, 3, 3]], COLORS[:1])  # the last vertex may be used, others need not
    assert len(PointCloud(VERTICES, source=mesh)) == 4
    assert PointCloud(VERTICES, source=mesh).source is mesh
    assert PointCloud(VERTICES).source is None
    # Judging a cloud is up to the method.
    assert len(PointCloud(np.zeros((0, 3)))) == 0
    points = [[np.nan, np.inf, -np.inf], [0, 0, 0]]
    np.testing.assert_array_equal(PointCloud(points).points, points)


@pytest.mark.parametrize("shape", [(3,), (4, 2), (4, 4), (2, 4, 3)])
def test_impossible_clouds(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="points: expected shape"):
        PointCloud(np.zeros(shape))


def test_views_are_equal_by_their_angles_which_have_limits() -> None:
    for azimuth, elevation in ((-180, -90), (540.5, 40), (-1e6, 90)):
        view = View(azimuth, elevation)
        assert (view.azimuth_deg, view.elevation_deg) == (azimuth, elevation)
        assert view == View(azimuth, elevation)
        assert hash(view) == hash(View(azimuth, elevation))
    for azimuth in (math.nan, -math.inf, 10**400, True, "0", None):
        with pytest.raises(ValueError, match="azimuth_deg"):
            View(azimuth, 0)
    for elevation in (math.nan, math.nextafter(90, 91), math.nextafter(-90, -91), False, "0"):
        with pytest.raises(ValueError, match="elevation_deg"):
            View(0, elevation)
