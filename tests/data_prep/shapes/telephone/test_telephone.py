from __future__ import annotations

import math

import numpy as np
import pytest

from data_prep.shapes.telephone.parts import (
    CUP_PLACE,
    dial,
    handset,
    hood,
    key_color,
    keypad,
    leaned,
    plate,
    wedge,
)
from tests.data_prep.shapes.samples import Families, of_each_family
from tests.data_prep.shapes.sections import extents, vertices_of, volume

GREY, BLACK = (120, 121, 122), (20, 21, 22)
# A few hundred float64 operations on numbers of order 10: see test_solids.
EXACT = 1e-11


@pytest.fixture(scope="module")
def telephones() -> Families:
    return of_each_family("telephone", seed=31, count=20)


def test_a_plate_stands_upright() -> None:
    part = plate((1.0, 2.0, 3.0), (4.0, 8.0, 0.5), 1.0, GREY)
    assert np.allclose(extents([part]), (4.0, 8.0, 0.5))
    assert np.allclose((part.vertices.min(axis=0) + part.vertices.max(axis=0)) / 2, (1, 2, 3))
    # Each corner loses what lies outside three chords of its parabola. That one takes a sixth of
    # the unit square; between it and chords at thirds lies a ninth of what is between it and one.
    corner = 1 / 6 + (1 / 2 - 1 / 6) / 9
    assert abs(volume(part) - (32 - 4 * corner) * 0.5) < EXACT


def test_keys_fill_their_grid_and_stand_out() -> None:
    keys = keypad((-3.0, 3.0), (0.0, 8.0), (3, 4), -1.0, GREY)
    centres = np.array([(part.vertices.min(0) + part.vertices.max(0)) / 2 for part in keys])
    assert sorted(set(centres[:, 0].round(9))) == [-2.0, 0.0, 2.0]
    assert sorted(set(centres[:, 1].round(9))) == [1.0, 3.0, 5.0, 7.0]
    for key in keys:
        assert np.allclose(extents([key])[:2], (0.74 * 2, 0.62 * 2))
        assert np.allclose([key.vertices[:, 2].min(), key.vertices[:, 2].max()], (-1.22, -0.6))


def test_a_dial_looks_towards_minus_z() -> None:
    face, *holes, hub = dial(4.0, GREY, BLACK)
    assert len(holes) == 10
    assert abs(face.vertices[:, 2].min() + 0.6) < EXACT
    for boss in (*holes, hub):
        assert boss.vertices[:, 2].min() < face.vertices[:, 2].min() - 0.1
    centres = np.array([(hole.vertices.max(0) + hole.vertices.min(0))[:2] / 2 for hole in holes])
    assert np.allclose(np.linalg.norm(centres, axis=1), 0.72 * 4.0)
    gaps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    assert np.allclose(gaps, 2 * 0.72 * 4.0 * math.sin(math.radians(15)))


def test_a_handset_reaches_out_with_both_ends() -> None:
    grip, *cups = handset(20.0, 4.0, 2.5, GREY)
    assert abs(extents([grip])[1] - 20.0) < EXACT
    for cup, y in zip(cups, (-CUP_PLACE * 20, CUP_PLACE * 20), strict=True):
        centre = (cup.vertices.min(axis=0) + cup.vertices.max(axis=0)) / 2
        assert np.allclose(centre[:2], (0.0, y))
        assert abs(cup.vertices[:, 2].max() - 0.72 * 2.5) < EXACT
    assert grip.vertices[:, 2].max() < 0.6 * 2.5


def test_bodies_rise_from_the_floor() -> None:
    part = wedge(15.0, (-8.0, 9.0), (2.0, 6.0), GREY)
    assert np.allclose(part.vertices.min(axis=0), (-7.5, 0.0, -8.0))
    assert np.allclose(part.vertices.max(axis=0)[::2], (7.5, 9.0))
    rear = part.vertices[part.vertices[:, 2] > 0, 1].max()
    front = part.vertices[part.vertices[:, 2] < -7.0, 1].max()
    assert 5.0 < rear < 6.0
    assert 1.5 < front < 3.0
    body = hood((10.0, -4.0, 6.0), (5.0, 0.0, 4.0), (0.5, 1.0, 7.0), GREY)
    assert np.allclose(body.vertices.min(axis=0), (-5.0, 0.5, -4.0))
    assert np.allclose(body.vertices.max(axis=0), (5.0, 7.0, 6.0))
    head = body.vertices[body.vertices[:, 1] == 7.0]
    assert np.allclose(
        np.concatenate([head.min(axis=0), head.max(axis=0)])[[0, 2, 3, 5]], (-2.5, 0, 2.5, 4)
    )


def test_laid_down_along_x() -> None:
    part = leaned(plate((0.0, 5.0, 0.0), (1.0, 4.0, 0.5), 0.1, GREY), (10.0, 0.0, 2.0))
    assert np.allclose(part.vertices.min(axis=0), (13.0, -0.5, 1.75))
    assert np.allclose(part.vertices.max(axis=0), (17.0, 0.5, 2.25))
    assert volume(part) > 0


def test_keys_can_be_told_from_the_body() -> None:
    rng = np.random.default_rng(1)
    for grey in range(12, 231, 6):
        body = (grey, grey, grey)
        key = key_color(rng, body)
        # Dark: at most 51 * 1.1 + 6; light: at least 152 * 0.9 - 6, about 110.
        assert abs(sum(key) / 3 - grey) > 18


def test_screens_and_keys_are_at_the_front(telephones: Families) -> None:
    for family in ("smartphone", "keypad"):
        for telephone in telephones[family]:
            body, *details = telephone.parts
            rear = body.vertices[:, 2].min()
            front = [part for part in details if part.vertices[:, 2].min() < rear - EXACT]
            assert len(front) >= (1 if family == "smartphone" else 15)
            # 0.5 % of the height and more: what is nearer to the body would flicker.
            out = rear - np.array([part.vertices[:, 2].min() for part in front])
            assert out.min() > 0.004 * extents([body])[1]


def test_proportions(telephones: Families) -> None:
    """Width over height and depth over height of what is a slab, a tower or a table set."""
    between = {
        "smartphone": ((0.44, 0.80), (0.06, 0.16)),
        "keypad": ((0.28, 0.65), (0.09, 0.27)),
        "flip": ((0.24, 0.34), (0.09, 0.36)),
        "cordless": ((0.28, 0.65), (0.30, 0.62)),
        "desk": ((1.2, 3.0), (1.4, 3.1)),
        "classic": ((0.95, 1.7), (0.85, 1.5)),
    }
    for family, (wide, deep) in between.items():
        for telephone in telephones[family]:
            x, y, z = extents(telephone.parts)
            assert wide[0] < x / y < wide[1], family
            assert deep[0] < z / y < deep[1], family


def test_a_flip_opens_to_the_front(telephones: Families) -> None:
    for telephone in telephones["flip"]:
        points = vertices_of(telephone.parts)
        height = points[:, 1]
        top, foot = points[height > 0.9 * height.max()], points[height < 0.9 * height.min()]
        middle = points[np.abs(height) < 0.5]
        assert top[:, 2].mean() < middle[:, 2].mean()
        assert foot[:, 2].mean() < middle[:, 2].mean()


def test_a_cordless_leans_back_in_its_charger(telephones: Families) -> None:
    for telephone in telephones["cordless"]:
        charger, phone = telephone.parts[:2]
        head = phone.vertices[phone.vertices[:, 1] > 0.9 * phone.vertices[:, 1].max()]
        assert head[:, 2].mean() > phone.vertices[:, 2].mean()
        assert 0.0 < phone.vertices[:, 1].min() < charger.vertices[:, 1].max()


def test_the_handset_of_a_desk_set_is_at_the_left(telephones: Families) -> None:
    """Who looks at the front has +x at the left, keys and screen at the right."""
    for telephone in telephones["desk"]:
        highest = max(telephone.parts, key=lambda part: part.vertices[:, 1].max())
        assert highest.vertices[:, 0].min() > 0


def test_the_handset_of_a_classic_lies_across_its_top(telephones: Families) -> None:
    for telephone in telephones["classic"]:
        grip = telephone.parts[-3]
        assert grip.vertices[:, 1].max() == vertices_of(telephone.parts)[:, 1].max()
        x, _, z = extents([grip])
        assert x > 2.5 * z
        assert x > extents(telephone.parts[:1])[0]
