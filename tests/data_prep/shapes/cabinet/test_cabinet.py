from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from data_prep.shapes.cabinet.parts import (
    Field,
    Finish,
    darker,
    doors,
    draw_finish,
    drawers,
    glass_doors,
    rack,
)
from data_prep.shapes.shape_class import Drawn
from tests.data_prep.shapes.samples import Families, of_each_family
from tests.data_prep.shapes.sections import box_of, cut, extents, held, holds, volume
from tests.data_prep.shapes.solid_checks import radius

WOOD, WHITE, SEAM, BRASS = (160, 110, 70), (220, 216, 208), (72, 50, 32), (176, 142, 82)
STEP = 0.01
FINISH = Finish(WOOD, WHITE, SEAM, BRASS, leaf="flat", handle="knob", layer=STEP)
FIELD = Field(-0.5, 0.7, 0.1, 0.9, -0.25)


@pytest.fixture(scope="module")
def cabinets() -> Families:
    return of_each_family("cabinet", seed=31, count=30)


def test_split_runs_by_columns_and_upwards() -> None:
    fields = FIELD.split([1, 2], [1, 3])
    corners = [(f.x_low, f.x_high, f.y_low, f.y_high) for f in fields]
    expected = [
        (-0.5, -0.1, 0.1, 0.3),
        (-0.5, -0.1, 0.3, 0.9),
        (-0.1, 0.7, 0.1, 0.3),
        (-0.1, 0.7, 0.3, 0.9),
    ]
    np.testing.assert_allclose(corners, expected, rtol=1e-12)
    assert {f.z for f in fields} == {FIELD.z}


def test_doors_and_drawers_stand_in_a_grid() -> None:
    parts = drawers(FINISH, FIELD, [2, 1, 1], columns=2)
    fronts = [part for part in parts if part.color == WHITE]
    assert len(fronts) == 6
    lowest = min(fronts, key=lambda part: part.vertices[:, 1].mean())
    # Twice as high as the others, less 1.4 layers of seam: 0.8 / 4 x 2.
    assert np.ptp(lowest.vertices[:, 1]) == pytest.approx(0.4 - 1.4 * STEP)
    for one, other in itertools.combinations(fronts, 2):
        low = np.maximum(one.vertices.min(axis=0), other.vertices.min(axis=0))
        high = np.minimum(one.vertices.max(axis=0), other.vertices.max(axis=0))
        assert (high - low)[:2].min() < -0.01  # the seam between them


@pytest.mark.parametrize("leaf", ["flat", "framed", "raised"])
def test_every_front_stands_out_and_is_sunk_in(leaf: str) -> None:
    finish = dataclasses.replace(FINISH, leaf=leaf, handle="none")
    seam, *fronts = doors(finish, FIELD, 2)
    assert seam.vertices[:, 2].min() == pytest.approx(FIELD.z - STEP)
    nearest = min(part.vertices[:, 2].min() for part in fronts)
    assert nearest == pytest.approx(FIELD.z - (2.5 if leaf == "flat" else 3.5) * STEP)
    assert fronts[0].vertices[:, 2].max() > FIELD.z


def test_handles_of_two_doors_are_next_to_each_other() -> None:
    parameters = [part for part in doors(FINISH, FIELD, 2) if part.color == BRASS]
    left, right = (part.vertices[:, 0].mean() for part in parameters)
    # Six layers from either side of the middle, 0.1.
    assert (left, right) == pytest.approx((0.04, 0.16), abs=0.001)  # a knob has seven sides
    low, high = zip(
        *((p.vertices[:, 2].min(), p.vertices[:, 2].max()) for p in parameters), strict=True
    )
    assert max(high) > FIELD.z - 2.5 * STEP  # sunk into the door
    assert min(low) < FIELD.z - 4 * STEP


def test_panes_have_frames_of_the_fronts_colour() -> None:
    glass = (150, 180, 190)
    parts = glass_doors(FINISH, FIELD, 3, glass)
    assert [part.color for part in parts] == [SEAM, *([glass, WHITE] * 3)]


def test_rack_is_hollow_and_has_its_shelves() -> None:
    parts = rack(FIELD, 0.3, 0.02, [1, 1], [3, 2], WOOD, back=None)
    assert len(parts) == 2 + 2 + 1 + 2 + 1  # sides, top and bottom, the upright, shelves
    middle = FIELD.z + 0.15
    # Straight up through the left and the right bay: top, bottom and shelves between them.
    for x, shelves in ((-0.2, 2), (0.4, 1)):
        inside = held(parts, [(x, y, middle) for y in np.linspace(0.1, 0.9, 1601)])
        assert np.diff(inside.astype(int)).clip(0).sum() + inside[0] == shelves + 2
    assert not holds(parts, (-0.2, 0.25, middle))
    closed = rack(FIELD, 0.3, 0.02, [1, 1], [3, 2], WOOD, back=WHITE)
    hit = held(closed, [(-0.2, 0.25, z) for z in np.linspace(FIELD.z, FIELD.z + 0.3, 301)])
    assert not any(hit[:270])
    assert any(hit[270:])


def test_darker_stays_drawable() -> None:
    assert darker((100, 50, 20), 0.5) == (50, 25, 12)


def test_layers_are_visible_at_any_size() -> None:
    for size in ((0.4, 0.5, 0.4), (2.2, 2.3, 0.6)):
        finish = draw_finish(np.random.default_rng(0), WOOD, size)
        # A front stands out by 2.5 layers: more than half a hundredth of the diagonal.
        assert 0.005 < 2.5 * finish.layer / np.linalg.norm(size) < 0.02


def test_fronts_look_towards_minus_z(cabinets: Families) -> None:
    for family in ("chest", "wardrobe", "hutch"):
        for obj in cabinets[family]:
            # The carcass is the largest solid; fronts and handles are before its middle.
            carcass = max(obj.parts, key=lambda part: volume(part))
            low, high = carcass.vertices[:, 2].min(), carcass.vertices[:, 2].max()
            reach_front = low - box_of(obj.parts)[0][2]
            reach_back = box_of(obj.parts)[1][2] - high
            assert reach_front > reach_back, obj.family


def test_proportions(cabinets: Families) -> None:
    for obj in cabinets["sideboard"]:
        width, height, depth = extents(obj.parts)
        assert width > 1.15 * height
        assert depth < 0.6 * width
    for obj in cabinets["wardrobe"]:
        width, height, depth = extents(obj.parts)
        assert height > 1.6
        assert depth < 0.5 * height
    for obj in cabinets["chest"]:
        assert extents(obj.parts)[1] < 1.55


def test_chests_are_full_and_shelves_are_empty(cabinets: Families) -> None:
    def share(obj: Drawn) -> float:
        low, high = box_of(obj.parts)
        points = np.random.default_rng(0).uniform(low, high, (60, 3))
        return float(np.mean(held(obj.parts, points)))

    # Means of 15 objects with 60 points each: standard errors below 0.03.
    assert np.mean([share(obj) for obj in cabinets["chest"][:15]]) > 0.7
    assert np.mean([share(obj) for obj in cabinets["shelves"][:15]]) < 0.35


def test_a_hutch_is_shallower_above(cabinets: Families) -> None:
    for obj in cabinets["hutch"]:
        low, high = box_of(obj.parts)
        section = cut(obj.parts, 1, 0.35 * low[1] + 0.65 * high[1])
        below = cut(obj.parts, 1, 0.8 * low[1] + 0.2 * high[1])
        assert np.ptp(section[:, 2]) < 0.85 * np.ptp(below[:, 2])
        assert section[:, 2].min() > below[:, 2].min() + 0.05


def test_a_kitchen_has_its_worktop_at_the_height_of_a_hand(cabinets: Families) -> None:
    corners = 0
    for obj in cabinets["kitchen"]:
        tops = [
            part
            for part in obj.parts
            if np.ptp(part.vertices[:, 1]) == pytest.approx(0.045) and len(part.vertices) == 16
        ]
        assert 1 <= len(tops) <= 2
        corners += len(tops) == 2
        for top in tops:
            assert 0.85 < top.vertices[:, 1].max() < 0.98
        if len(tops) == 2:  # at right angles
            first, second = (np.ptp(top.vertices, axis=0) for top in tops)
            assert first[0] > first[2]
            assert second[2] > second[0]
    assert 0.1 < corners / len(cabinets["kitchen"]) < 0.5


def test_colours(cabinets: Families) -> None:
    """Most are of wood, warmer than grey; kitchens are painted more often than chests."""

    def wooden(obj: Drawn) -> bool:
        parts = max(obj.parts, key=lambda part: volume(part))
        return parts.color[0] > 1.25 * parts.color[2]

    share = {f: np.mean([wooden(obj) for obj in objs]) for f, objs in cabinets.items()}
    assert 0.5 < np.mean(list(share.values())) < 0.85
    assert share["kitchen"] < share["chest"]
    assert all(radius(obj.parts) > 0.3 for objs in cabinets.values() for obj in objs)
