from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

from data_prep.shapes.shape_class import Drawn
from data_prep.shapes.solids import Part, signed_volume
from data_prep.shapes.telephone_parts import (
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
from data_prep.shapes.telephones import CLASS, FAMILY_WEIGHTS

GREY, BLACK = (120, 121, 122), (20, 21, 22)
# A few hundred float64 operations on numbers of order 10: see test_solids.
EXACT = 1e-11

# The first seed that draws each family: seed, family, number of faces, their area.
PINNED = [
    (0, "flip", 868, 7.0178179),
    (1, "keypad", 564, 4.7201569),
    (2, "smartphone", 316, 6.8669440),
    (4, "classic", 700, 11.0857051),
    (5, "desk", 940, 7.0409327),
    (15, "cordless", 572, 4.6297882),
]


@pytest.fixture(scope="module")
def telephones() -> dict[str, list[Drawn]]:
    rng = np.random.default_rng(31)
    drawn = [CLASS.draw(rng) for _ in range(600)]
    return {family: [one for one in drawn if one.family == family] for family in CLASS.families}


def vertices(telephone: Drawn) -> np.ndarray:
    return np.concatenate([part.vertices for part in telephone.parts])


def size(part: Part) -> np.ndarray:
    return np.ptp(part.vertices, axis=0)


def test_drawn_telephones_are_pinned() -> None:
    # Trained weights know these telephones: a change here is a new data set, not a refactoring.
    seen = []
    for seed, *_ in PINNED:
        telephone = CLASS.draw(np.random.default_rng(seed))
        mesh = telephone.mesh()
        corners = mesh.vertices[mesh.faces].astype(np.float64)
        sides = corners[:, 1:] - corners[:, :1]
        area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() / 2
        # Coordinates are rounded at 2**-24; the smallest faces are 0.01 across: 2e-5 of their area.
        seen.append((seed, telephone.family, len(mesh.faces), pytest.approx(area, rel=2e-5)))
    assert seen == PINNED


def test_families_are_as_frequent_as_the_table_says() -> None:
    rng = np.random.default_rng(3)
    count = 2000
    drawn = Counter(CLASS.draw(rng).family for _ in range(count))
    for family, weight in FAMILY_WEIGHTS.items():
        p = weight / sum(FAMILY_WEIGHTS.values())
        # Four standard errors: all six pass with probability 0.9996, were the seed not fixed.
        assert abs(drawn[family] / count - p) < 4 * math.sqrt(p * (1 - p) / count)


def test_a_plate_stands_upright() -> None:
    part = plate((1.0, 2.0, 3.0), (4.0, 8.0, 0.5), 1.0, GREY)
    assert np.allclose(size(part), (4.0, 8.0, 0.5))
    assert np.allclose((part.vertices.min(axis=0) + part.vertices.max(axis=0)) / 2, (1, 2, 3))
    # Each corner loses what lies outside three chords of its parabola. That one takes a sixth of
    # the unit square; between it and chords at thirds lies a ninth of what is between it and one.
    corner = 1 / 6 + (1 / 2 - 1 / 6) / 9
    volume = signed_volume(part.vertices, part.faces)
    assert abs(volume - (32 - 4 * corner) * 0.5) < EXACT


def test_keys_fill_their_grid_and_stand_out() -> None:
    keys = keypad((-3.0, 3.0), (0.0, 8.0), (3, 4), -1.0, GREY)
    centres = np.array([(part.vertices.min(0) + part.vertices.max(0)) / 2 for part in keys])
    assert sorted(set(centres[:, 0].round(9))) == [-2.0, 0.0, 2.0]
    assert sorted(set(centres[:, 1].round(9))) == [1.0, 3.0, 5.0, 7.0]
    for key in keys:
        assert np.allclose(size(key)[:2], (0.74 * 2, 0.62 * 2))
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
    assert abs(size(grip)[1] - 20.0) < EXACT
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
    assert signed_volume(part.vertices, part.faces) > 0


def test_keys_can_be_told_from_the_body() -> None:
    rng = np.random.default_rng(1)
    for grey in range(12, 231, 6):
        body = (grey, grey, grey)
        key = key_color(rng, body)
        # Dark: at most 51 * 1.1 + 6; light: at least 152 * 0.9 - 6, about 110.
        assert abs(sum(key) / 3 - grey) > 18


def test_screens_and_keys_are_at_the_front(telephones: dict[str, list[Drawn]]) -> None:
    for family in ("smartphone", "keypad"):
        for telephone in telephones[family]:
            body, *details = telephone.parts
            rear = body.vertices[:, 2].min()
            front = [part for part in details if part.vertices[:, 2].min() < rear - EXACT]
            assert len(front) >= (1 if family == "smartphone" else 15)
            # 0.5 % of the height and more: what is nearer to the body would flicker.
            out = rear - np.array([part.vertices[:, 2].min() for part in front])
            assert out.min() > 0.004 * size(body)[1]


def test_proportions(telephones: dict[str, list[Drawn]]) -> None:
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
            x, y, z = np.ptp(vertices(telephone), axis=0)
            assert wide[0] < x / y < wide[1], family
            assert deep[0] < z / y < deep[1], family


def test_a_flip_opens_to_the_front(telephones: dict[str, list[Drawn]]) -> None:
    for telephone in telephones["flip"]:
        points = vertices(telephone)
        height = points[:, 1]
        top, foot = points[height > 0.9 * height.max()], points[height < 0.9 * height.min()]
        middle = points[np.abs(height) < 0.5]
        assert top[:, 2].mean() < middle[:, 2].mean()
        assert foot[:, 2].mean() < middle[:, 2].mean()


def test_a_cordless_leans_back_in_its_charger(telephones: dict[str, list[Drawn]]) -> None:
    for telephone in telephones["cordless"]:
        charger, phone = telephone.parts[:2]
        head = phone.vertices[phone.vertices[:, 1] > 0.9 * phone.vertices[:, 1].max()]
        assert head[:, 2].mean() > phone.vertices[:, 2].mean()
        assert 0.0 < phone.vertices[:, 1].min() < charger.vertices[:, 1].max()


def test_the_handset_of_a_desk_set_is_at_the_left(telephones: dict[str, list[Drawn]]) -> None:
    """Who looks at the front has +x at the left, keys and screen at the right."""
    for telephone in telephones["desk"]:
        highest = max(telephone.parts, key=lambda part: part.vertices[:, 1].max())
        assert highest.vertices[:, 0].min() > 0


def test_the_handset_of_a_classic_lies_across_its_top(telephones: dict[str, list[Drawn]]) -> None:
    for telephone in telephones["classic"]:
        grip = telephone.parts[-3]
        assert grip.vertices[:, 1].max() == vertices(telephone)[:, 1].max()
        x, _, z = size(grip)
        assert x > 2.5 * z
        assert x > size(telephone.parts[0])[0]
