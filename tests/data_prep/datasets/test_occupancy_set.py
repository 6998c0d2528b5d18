from __future__ import annotations

import sys

import numpy as np
import pytest

from data_prep.datasets.occupancy_set import (
    BALL,
    draw_queries,
    labels,
    occupancy_set,
    winding_numbers,
)
from data_prep.datasets.procedural import WidenedObject
from data_prep.failures import BadInput, MissingDependency
from data_prep.randomness import generator
from data_prep.scene import CLOUD_SIZE, Mesh
from data_prep.shapes.solids import box, join, lathe, loft

GREY = (120, 120, 120)
BOX = join([box((0.1, 0.2, 0.3), (0.4, 0.6, 0.8), GREY)])
APART = 0.05  # of numbers that are approximations
PLACES = np.random.default_rng(0).uniform(-1, 1, (4000, 3)).astype(np.float32)


def winding(points, mesh):
    """Winding number of a closed mesh about points (Van Oosterom & Strackee 1983): 1 inside."""
    a, b, c = (mesh.vertices[None, mesh.faces[:, i]] - points[:, None] for i in range(3))
    la, lb, lc = (np.linalg.norm(side, axis=2) for side in (a, b, c))
    triple = (a * np.cross(b, c)).sum(2)
    rest = la * lb * lc + (a * b).sum(2) * lc + (b * c).sum(2) * la + (a * c).sum(2) * lb
    return (2 * np.arctan2(triple, rest)).sum(1) / (4 * np.pi)


def test_the_inside_of_a_sphere():
    """Places between the balls inside and outside the facets of 64 x 64 are left out."""
    turn = np.linspace(0.001, np.pi - 0.001, 64)
    ball = lathe(0.8 * np.stack([np.sin(turn), np.cos(turn)], axis=1), GREY, sides=64)
    radius = np.linalg.norm(PLACES, axis=1)
    clear = np.abs(radius - 0.8) > 0.8 * (1 - np.cos(np.pi / 32))
    found = winding_numbers(join([ball]), PLACES)
    np.testing.assert_allclose(found[clear], (radius < 0.8)[clear], rtol=0, atol=APART)


def test_solids_that_overlap_are_counted_and_a_hole_is_outside():
    """Two boxes, one sunk into the other, beside a ring."""
    other = box((0.3, 0.2, 0.3), (0.4, 0.4, 0.4), GREY)
    angle = np.arange(12) * (np.pi / 6)
    around = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    square = ((0.2, -0.1), (0.4, -0.1), (0.4, 0.1), (0.2, 0.1))
    rings = np.stack([r * around + (-0.5, h - 0.5, 0) for r, h in square], axis=1)
    ring = loft(rings, GREY, closed=True)
    mesh = join([box((0.1, 0.2, 0.3), (0.4, 0.6, 0.8), GREY), other, ring])
    first, second = (
        (np.abs(PLACES - c) < s).all(axis=1)
        for c, s in (((0.1, 0.2, 0.3), (0.2, 0.3, 0.4)), ((0.3, 0.2, 0.3), (0.2, 0.2, 0.2)))
    )
    found = winding_numbers(mesh, PLACES)
    apart = np.abs(PLACES - (-0.5, -0.5, 0)).max(axis=1) > 0.45
    np.testing.assert_allclose(found[apart], (first * 1 + second)[apart], rtol=0, atol=APART)
    assert found.max() > 2 - APART
    middle = np.array([[-0.5, -0.5, 0.0], [-0.2, -0.5, 0.01]], np.float32)
    np.testing.assert_allclose(winding_numbers(mesh, middle), [0, 1], rtol=0, atol=APART)


def test_half_of_the_places_lie_near_the_surface_and_the_others_in_a_ball():
    mesh = join([box((0, 0, 0), (1.0, 1.0, 1.0), GREY)])
    places = draw_queries(mesh, 4000, np.random.default_rng(0))
    assert (places.shape, places.dtype) == ((4000, 3), np.float32)
    near = np.abs(np.abs(places).max(axis=1) - 0.5) < 0.05
    # near are all offsets of the first scale, 0.683 of the second, and 0.6 of 4.85 of the ball
    share = (1 + 0.683) / 4 + 0.6 / 4.85 / 2
    assert abs(near.mean() - share) < 4 * np.sqrt(share * (1 - share) / 4000)
    assert abs(near[:2000].mean() - near[2000:].mean()) < 0.06  # in random order
    # of the ball, 1 - (1.016 / 1.05)^3 lie in its outermost shell: 0.094 of half the places
    radius = np.linalg.norm(places, axis=1)
    assert abs((radius > 0.5 * np.sqrt(3) + 0.15).mean() - 0.047) < 4 * np.sqrt(0.047 / 4000)
    assert radius.max() < BALL


def test_a_set_has_the_clouds_of_other_trainings_and_labels_of_its_places():
    objects = [WidenedObject("lamp", i) for i in range(2)]
    made = occupancy_set(objects, 50, quiet=True)
    assert made.clouds.shape == (2, CLOUD_SIZE, 3)
    for i, obj in enumerate(objects):
        cloud = obj.cloud(generator(0, "training cloud", "lamp", f"widened-0000{i}"))
        other = obj.cloud(generator("training cloud", 0, "lamp", f"widened-0000{i}"))
        assert made.clouds[i].tobytes() == other.points.tobytes()
        assert made.clouds[i].tobytes() != cloud.points.tobytes()
        exact = winding(made.queries[i].astype(np.float64), obj.load())
        np.testing.assert_array_equal(made.inside[i], exact > 0.5)
    alone = occupancy_set(objects[1:], 50, quiet=True)
    for field in ("clouds", "queries", "inside"):
        assert getattr(alone, field)[0].tobytes() == getattr(made, field)[1].tobytes()


def test_a_mesh_without_an_inside_is_refused():
    sheet = Mesh(BOX.vertices, BOX.faces[2:], BOX.face_colors[2:])  # a box without a side's half
    inwards = Mesh(BOX.vertices, BOX.faces[:, ::-1], BOX.face_colors)
    for mesh in (sheet, inwards):
        with pytest.raises(BadInput, match=r"chair/7: inside and outside .* [0-9]+% of the points"):
            labels(mesh, PLACES, "chair/7")
    inside = (np.abs(PLACES - (0.1, 0.2, 0.3)) < (0.2, 0.3, 0.4)).all(axis=1)
    np.testing.assert_array_equal(labels(BOX, PLACES, ""), inside)


def test_a_missing_library_is_named_with_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "igl", None)
    with pytest.raises(MissingDependency, match=r"libigl; install it .*pc2pix-bench\[train\]"):
        labels(BOX, PLACES, "chair/7")
