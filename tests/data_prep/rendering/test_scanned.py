"""Clouds of which cameras see every point."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from data_prep.clouds.conditions import Unchanged
from data_prep.clouds.sampling import sample_surface
from data_prep.datasets.procedural import ProceduralObject
from data_prep.failures import BadInput
from data_prep.rendering.camera import camera_to_world
from data_prep.rendering.opengl import render
from data_prep.rendering.raycast import sees
from data_prep.rendering.scanned import Scanned
from data_prep.scene import Mesh, PointCloud, View

GREY = (180, 180, 180)


def boxes(*extents_and_centres: tuple[list[float], list[float]]) -> Mesh:
    parts = []
    for extents, centre in extents_and_centres:
        part = trimesh.creation.box(extents)
        part.apply_translation(centre)
        parts.append(part)
    whole = trimesh.util.concatenate(parts)
    return Mesh(whole.vertices, whole.faces, np.tile(GREY, (len(whole.faces), 1)))


def scan(mesh: Mesh, cameras: int, seed: int = 0, count: int = 2048) -> PointCloud:
    cloud = sample_surface(mesh, np.random.default_rng(9), count)
    return Scanned(cameras).apply(cloud, np.random.default_rng(seed))


def nearest_hits(mesh: Mesh, view: View, points: np.ndarray) -> np.ndarray:
    """Return how far before each point its ray first meets the mesh (Moller and Trumbore 1997)."""
    eye = camera_to_world(view)[:3, 3]
    ray = (points - eye)[:, None]
    corner, other, third = mesh.vertices.astype(float)[mesh.faces].transpose(1, 0, 2)
    first, second, start = other - corner, third - corner, eye - corner
    across = np.cross(ray, second)
    scale = (first * across).sum(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (start * across).sum(-1) / scale
        v = (ray * np.cross(start, first)).sum(-1) / scale
        at = (second * np.cross(start, first)).sum(-1) / scale
    meets = (u >= 0) & (v >= 0) & (u + v <= 1) & (at > 0)
    nearest = np.where(meets, at, 1.0).min(axis=1)
    return (1 - nearest) * np.linalg.norm(points - eye, axis=1)


@pytest.mark.parametrize("cameras", [1, 3])
def test_each_point_is_seen_and_other_points_are_not(cameras):
    mesh = ProceduralObject("chair", "test", 0).load()
    made = scan(mesh, cameras, count=300)
    views = Scanned(cameras).views(np.random.default_rng(0))
    assert len(views) == cameras
    # Points are float32, which moves them by up to 6e-8 off their face.
    hidden_by = np.min([nearest_hits(mesh, v, made.points.astype(float)) for v in views], axis=0)
    assert hidden_by.max() < 1e-4
    every = sample_surface(mesh, np.random.default_rng(3), 300).points.astype(float)
    hidden = np.min([nearest_hits(mesh, view, every) for view in views], axis=0) > 1e-3
    assert 0.2 < hidden.mean() < 0.9  # so that the test above says something


def test_cameras_stand_around_the_object_at_the_elevations_of_all_views():
    one = Scanned(1).views(np.random.default_rng(4))
    three = Scanned(3).views(np.random.default_rng(4))
    assert one == three[:1]
    azimuths = np.array([view.azimuth_deg for view in three])
    np.testing.assert_allclose(np.diff(azimuths), 120)
    elevations = [Scanned(3).views(np.random.default_rng(seed)) for seed in range(50)]
    values = np.array([[view.elevation_deg for view in views] for views in elevations])
    assert np.abs(values).max() <= 40
    assert (np.ptp(values, axis=1) > 0).all()


def test_what_is_seen_of_a_box_is_seen_evenly():
    """One camera sees two or three faces of a cube, each of area 1, and nothing of the others."""
    mesh = boxes(([1, 1, 1], [0, 0, 0]))
    made = scan(mesh, 1)
    face = np.abs(made.points).argmax(axis=1) + 3 * (made.points.max(axis=1) < 0.4999)
    counts = np.bincount(face, minlength=6)
    shown = counts[counts > 0]
    assert len(shown) in (2, 3)
    # Binomial counts: 4 standard deviations.
    share = 1 / len(shown)
    assert np.abs(shown - 2048 * share).max() < 4 * np.sqrt(2048 * share * (1 - share))
    assert len(np.bincount(np.abs(scan(mesh, 3).points).argmax(axis=1))) == 3


def test_faces_are_seen_from_either_side_as_the_true_image_shows_them():
    """A single face, whichever way it is turned, and two faces that coincide."""
    corners = [[-0.5, -0.5, 0], [0.5, -0.5, 0], [0, 0.7, 0]]
    for faces in ([[0, 1, 2]], [[0, 2, 1]], [[0, 1, 2], [0, 2, 1]]):
        mesh = Mesh(corners, faces, [GREY] * len(faces))
        points = sample_surface(mesh, np.random.default_rng(1)).points.astype(float)
        for view in (View(0, 0), View(180, 0), View(60, 30)):
            assert (render(mesh, [view])[0] < 255).any()
            for face in range(len(faces)):
                assert sees(mesh, view, points, np.full(len(points), face)).all()


def test_a_thin_wall_hides_its_other_side():
    """The sides are .001 radii apart."""
    mesh = boxes(([1, 1, 0.001], [0, 0, 0]))
    points = np.array([[0.1, 0.2, -0.0005], [0.1, 0.2, 0.0005]])  # front is -Z
    normals = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).face_normals
    cloud = sample_surface(mesh, np.random.default_rng(0), 20_000).points
    assert set(np.sign(normals[:, 2]).tolist()) == {-1.0, 0.0, 1.0}
    made = scan(mesh, 1)
    assert len({*np.sign(made.points[np.abs(made.points[:, 2]) > 0.00049, 2]).tolist()}) == 1
    assert len({*np.sign(cloud[:, 2]).tolist()}) == 2
    seen_of_none = sees(mesh, View(0, 0), points, np.array([-1, -1]))
    assert seen_of_none.tolist() == [True, False]


def test_an_object_that_is_hardly_seen_is_refused_after_a_bounded_search():
    """A large surface within a closed box: the box has less than 1e-5 of all area."""
    shell, inner = boxes(([1.4, 0.01, 0.01], [0, 0, 0])), 40_000
    corners = [[-0.6, -0.004, -0.004], [0.6, -0.004, -0.004], [0.6, 0.004, 0.004]]
    faces = np.r_[shell.faces, np.tile([[8, 9, 10]], (inner, 1))]
    mesh = Mesh(np.r_[shell.vertices, corners], faces, np.tile(GREY, (len(faces), 1)))
    with pytest.raises(BadInput) as error:
        scan(mesh, 3)
    assert str(error.value).startswith(
        "of 1,048,576 points on the mesh the 3 cameras of a scan see"
    )
    assert "\n" not in str(error.value)


def test_the_same_numbers_give_the_same_scan():
    mesh = ProceduralObject("chair", "test", 1).load()
    one, same, other = (scan(mesh, 1, seed).points for seed in (0, 0, 1))
    assert one.tobytes() == same.tobytes() != other.tobytes()
    assert Unchanged().apply(scan(mesh, 1), np.random.default_rng(0)).source is mesh
