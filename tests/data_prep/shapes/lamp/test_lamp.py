from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

from data_prep.shapes.lamp.parts import ball, bar_height, bowl, open_shade, to_a_side
from tests.data_prep.shapes.samples import Families, of_each_family
from tests.data_prep.shapes.sections import extents, filled, vertices_of, volume

GREY = (120, 121, 122)
# A few hundred float64 operations on numbers of order 1: see test_solids.
EXACT = 1e-12


@pytest.fixture(scope="module")
def lamps() -> Families:
    return of_each_family("lamp", seed=31, count=30)


@pytest.mark.parametrize("sides", [4, 6, 16])
def test_an_open_shade_is_a_prism_less_its_inside(sides: int) -> None:
    walls, bar = open_shade((0.2, 0.2), (1.0, 1.5), GREY, sides=sides, waist=1.0)
    polygon = sides / 2 * math.sin(2 * math.pi / sides)
    inside = 0.2 - 0.045 * 0.2
    expected = polygon * (0.2**2 - inside**2) * 0.5
    assert abs(volume(walls) - expected) < EXACT
    # The bar ends half-way through the wall, at the height that it is said to have.
    reach = np.linalg.norm(bar.vertices[:, ::2], axis=1).max()
    assert inside < reach < 0.2
    middle = (bar.vertices[:, 1].min() + bar.vertices[:, 1].max()) / 2
    assert abs(middle - bar_height((1.0, 1.5))) < EXACT
    assert abs(bar_height((1.0, 1.5)) - 1.44) < EXACT


def test_a_square_shade_looks_along_the_axes() -> None:
    walls, _ = open_shade((0.2, 0.1), (0.0, 0.3), GREY, sides=4, waist=1.0)
    assert np.allclose(
        np.ptp(walls.vertices, axis=0), (0.2 * math.sqrt(2), 0.3, 0.2 * math.sqrt(2))
    )


def test_a_bowl_hangs_from_the_origin_and_opens_downwards() -> None:
    part = bowl(0.3, 0.2, GREY, apex=0.5)
    radius = np.linalg.norm(part.vertices[:, ::2], axis=1)
    assert abs(part.vertices[:, 1].max()) < EXACT
    assert abs(part.vertices[:, 1].min() + 0.2) < EXACT
    assert abs(radius[part.vertices[:, 1] > -EXACT].max() - 0.15) < EXACT
    assert abs(radius[part.vertices[:, 1] < EXACT - 0.2].max() - 0.3) < EXACT
    # A frustum of 14 sides less the one inside it, narrower by the wall and as much lower on top.
    wall, top = 0.05 * 0.3, 0.15
    low, high = 0.3, top
    polygon = 7 * math.sin(2 * math.pi / 14)

    def frustum(a: float, b: float, h: float) -> float:
        return polygon * h / 3 * (a * a + a * b + b * b)

    expected = frustum(low, high, 0.2) - frustum(low - wall, high - wall, 0.2 - wall)
    assert abs(volume(part) - expected) < EXACT


def test_a_ball_has_its_radius_in_reach() -> None:
    part = ball((1.0, 2.0, 3.0), 0.5, GREY)
    assert np.allclose((part.vertices.min(axis=0) + part.vertices.max(axis=0)) / 2, (1, 2, 3))
    assert np.allclose(np.linalg.norm(part.vertices - (1, 2, 3), axis=1), 0.5)
    assert abs(np.ptp(part.vertices[:, 1]) - math.sin(math.radians(80))) < EXACT


def test_arms_point_to_all_four_sides() -> None:
    rng = np.random.default_rng(0)
    pointer = ball((0.0, 0.0, -1.0), 0.1, GREY)
    centres = [to_a_side(rng, [pointer])[0].vertices.mean(axis=0).round(9) for _ in range(400)]
    counts = Counter((int(x), int(z)) for x, _, z in centres)
    # 100 of each expected; four standard errors are 35.
    assert set(counts) == {(0, -1), (0, 1), (1, 0), (-1, 0)}
    assert min(counts.values()) > 65


def test_most_of_a_lamp_is_air(lamps: Families) -> None:
    for family, most in {"chandelier": 0.05, "post": 0.15, "floor": 0.15, "desk": 0.15}.items():
        assert max(filled(lamp.parts) for lamp in lamps[family]) < most, family
    assert np.median([filled(lamp.parts) for lamp in lamps["chandelier"]]) < 0.015


def test_what_stands_and_what_hangs(lamps: Families) -> None:
    for family, members in lamps.items():
        for lamp in members:
            low, first = vertices_of(lamp.parts)[:, 1].min(), lamp.parts[0].vertices[:, 1]
            if family in ("bedside", "desk", "post"):
                assert abs(low) < EXACT
            elif family == "floor":  # the legs of a tripod are cut off square
                assert -0.01 < low < EXACT
            elif family in ("pendant", "chandelier"):  # the first part is what hangs it
                assert first.max() == vertices_of(lamp.parts)[:, 1].max()


def test_shades_of_bedside_lamps_are_wider_than_their_bodies(lamps: Families) -> None:
    for lamp in lamps["bedside"]:
        points = vertices_of(lamp.parts)
        height = points[:, 1] / points[:, 1].max()
        reach = np.linalg.norm(points[:, ::2], axis=1)
        assert reach[height > 0.4].max() > reach[height < 0.2].max()


def test_sconces_keep_to_their_side_of_the_wall(lamps: Families) -> None:
    for lamp in lamps["sconce"]:
        assert vertices_of(lamp.parts)[:, 2].max() == lamp.parts[0].vertices[:, 2].max()


def test_lamp_posts_are_tall(lamps: Families) -> None:
    for lamp in lamps["post"]:
        x, y, z = extents(lamp.parts)
        assert 3.0 < y < 7.0
        assert y > math.hypot(x, z)  # at the least 4.9 over two arms of 2.25


def test_metal_is_metal(lamps: Families) -> None:
    """What chandeliers hang from is brass, dark or chrome: never red, green or blue."""
    for lamp in lamps["chandelier"]:
        red, _, blue = lamp.parts[0].color
        assert red - blue > -25
