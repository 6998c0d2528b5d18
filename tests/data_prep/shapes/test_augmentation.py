"""Shapes that vary more than their classes: what changes, what stays, and what is rejected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from data_prep.datasets.registry import ProceduralObject, open_dataset
from data_prep.shapes import augmentation
from data_prep.shapes.deformations import Deformation
from data_prep.shapes.solids import box, join, lathe
from tests.data_prep.shapes.solid_checks import EXACT, GREY, unsound, volume

NOTHING = Deformation(np.ones(3), 0.0, 0.0, 0.0, 0.0, np.zeros((4, 4, 4, 3)))
POINTS = np.random.default_rng(0).uniform(-0.9, 0.9, (50, 3))


def test_no_deformation_moves_nothing():
    assert NOTHING(POINTS) == pytest.approx(POINTS, abs=EXACT)
    # differences over 2e-4 of numbers that are rounded to 1e-16: 1e-12 each, some 1e-11 in all
    assert NOTHING.smallest_stretch(POINTS) == pytest.approx(1.0, abs=1e-10)


def test_scale_taper_and_twist_by_their_formulas():
    x, y, z = POINTS.T
    scaled = replace(NOTHING, scale=np.array([2.0, 0.5, 3.0]))(POINTS)
    assert scaled == pytest.approx(POINTS * (2.0, 0.5, 3.0), abs=EXACT)
    tapered = replace(NOTHING, taper=0.3)(POINTS)
    assert tapered == pytest.approx(np.stack([x * (1 + 0.3 * y), y, z * (1 + 0.3 * y)], 1))
    twisted = replace(NOTHING, twist=0.4)(POINTS)
    assert np.hypot(twisted[:, 0], twisted[:, 2]) == pytest.approx(np.hypot(x, z))
    turn = np.arctan2(twisted[:, 2], twisted[:, 0]) - np.arctan2(z, x)
    assert np.angle(np.exp(1j * (turn - 0.4 * y))) == pytest.approx(np.zeros(50), abs=EXACT)


@pytest.mark.parametrize("yaw", [0.0, 1.0])
def test_a_bend_makes_an_arc_of_the_axis(yaw):
    axis = np.stack([np.zeros(201), np.linspace(-1, 1, 201), np.zeros(201)], axis=1)
    bent = replace(NOTHING, bend=0.5, bend_yaw=yaw)(axis)
    across = np.hypot(bent[:, 0], bent[:, 2])
    # on a circle of radius 2 about the point that the axis bends towards
    assert (2 - across) ** 2 + bent[:, 1] ** 2 == pytest.approx(np.full(201, 4.0))
    # chords of 0.01 on that circle are shorter than the arc by (0.01 / 2)^2 / 24 = 1e-6 of it
    length = np.linalg.norm(np.diff(bent, axis=0), axis=1).sum()
    assert length == pytest.approx(2.0, rel=2e-6)


def test_a_free_form_whose_control_points_move_alike_is_a_shift():
    """Bernstein polynomials add up to 1, and reproduce what is linear in the control points."""
    shift = np.array([0.1, -0.2, 0.3])
    moved = replace(NOTHING, offsets=np.broadcast_to(shift, (4, 4, 4, 3)))
    assert moved(POINTS) == pytest.approx(POINTS + shift, abs=EXACT)
    places = np.linspace(-1, 1, 4)
    grid = np.stack(np.meshgrid(places, places, places, indexing="ij"), axis=-1)
    larger = replace(NOTHING, offsets=0.2 * grid)
    assert larger(POINTS) == pytest.approx(1.2 * POINTS, abs=EXACT)


def test_folds_are_seen():
    # x and z change sign where 1 + 2 y does: the determinant (1 + 2 y)^2 has its zero at -1/2
    folded = replace(NOTHING, taper=2.0)
    at = np.array([[0.1, -0.5, 0.1], [0.1, 0.5, 0.1]])
    assert folded.smallest_stretch(at) == pytest.approx(0.0, abs=1e-9)
    mirrored = replace(NOTHING, offsets=_of_x(-2.0))  # x becomes -x
    assert mirrored.smallest_stretch(POINTS) == pytest.approx(-1.0, abs=1e-9)
    for deformation in (folded, mirrored):
        with pytest.raises(augmentation.Degenerate, match="folded"):
            augmentation.deformed([box((0, 0, 0), (2, 2, 2), GREY)], deformation)


def _of_x(share: float) -> np.ndarray:
    offsets = np.zeros((4, 4, 4, 3))
    offsets[..., 0] = share * np.linspace(-1, 1, 4)[:, None, None]
    return offsets


def test_what_becomes_flat_is_rejected():
    cube = [box((0, 0, 0), (2, 2, 2), GREY)]
    with pytest.raises(augmentation.Degenerate, match="flat"):
        augmentation.deformed(cube, replace(NOTHING, scale=np.array([1.0, 0.03, 1.0])))
    made = augmentation.deformed(cube, replace(NOTHING, scale=np.array([1.0, 0.1, 1.0])))
    assert volume(made[0]) == pytest.approx(8 * 0.1)


def test_faces_are_small_enough_to_bend():
    (rod,) = augmentation.deformed(
        [box((0, 0.5, 0), (0.04, 1.0, 0.04), GREY)], replace(NOTHING, bend=0.4)
    )
    edges = rod.vertices[rod.faces] - rod.vertices[np.roll(rod.faces, 1, axis=1)]
    # stretched by a bend of 0.4 by less than 1.1
    assert np.linalg.norm(edges, axis=2).max() < 1.1 * augmentation.EDGE


def test_long_parts_become_thicker_and_not_longer():
    rod = lathe([(0.02, 0.0), (0.02, 1.0)], GREY)
    cube = box((0, 0, 0), (1, 1, 1), GREY)
    thick, same = augmentation.thickened([rod, cube], 1.5)
    assert same is cube
    assert np.ptp(thick.vertices[:, 1]) == pytest.approx(1.0, abs=1e-9)
    assert volume(thick) == pytest.approx(1.5**2 * volume(rod), rel=1e-9)


def test_chairs_of_two_families_are_sound():
    rng = np.random.default_rng(1)
    for _ in range(40):
        parts = augmentation.exchanged_chair(rng)
        assert unsound(parts) == []
        assert np.isfinite(join(parts).vertices).all()


def test_the_dataset_widens_the_train_split_alone():
    dataset = open_dataset("procedural:widened")
    first, second = dataset.objects("chair", 2, 9, "train")
    assert (first.object_id, second.fingerprint()) == (
        "widened-00000",
        "procedural-1/chair/widened-00001",
    )
    assert first.load().vertices.tobytes() != second.load().vertices.tobytes()
    assert dataset.objects("chair", 1, 9, "validation") == (
        ProceduralObject("chair", "validation", 0),
    )
