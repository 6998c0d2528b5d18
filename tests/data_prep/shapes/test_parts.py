"""Parts that the builders of a class make their objects of, against closed forms."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from data_prep.shapes.airplane.parts import Wing
from data_prep.shapes.cabinet.parts import Field, rack
from data_prep.shapes.display.parts import Head, Look, curved_head
from data_prep.shapes.lamp.parts import bar_height, bowl, open_shade
from data_prep.shapes.loudspeaker.drivers import draw_drivers, woofer
from data_prep.shapes.loudspeaker.living_room import baffle
from data_prep.shapes.solids import Part
from data_prep.shapes.telephone.parts import dial, key_color
from data_prep.shapes.vessel.rigs import CLOTH, fore_and_aft_sail, house, square_sail
from tests.data_prep.shapes.sections import box_of, held, holds, volume

GREY = (120, 121, 122)
# A few hundred float64 operations on numbers of order 1: see test_solids. Telephones are built of
# numbers of order 10.
EXACT = 1e-12


# --- airplane -------------------------------------------------------------------------------------


def test_a_wing_has_its_chords_where_it_says() -> None:
    wing = Wing(0.5, root=0.3, tip=0.1, y=-0.1, z=-0.2, sweep=0.5, dihedral=0.1, kink=0.4)
    assert [wing.chord(x) for x in (0.0, 0.2, 0.35, 0.5)] == pytest.approx([0.3, 0.2, 0.15, 0.1])
    assert wing.at(-0.2, 0.5) == pytest.approx((-0.2, -0.08, 0.0))
    # The trailing edge runs straight across up to the kink.
    trailing = [wing.at(x, 1.0)[2] for x in (0.0, 0.1, 0.2)]
    assert trailing == pytest.approx([0.1, 0.1, 0.1])
    low, high = box_of([wing.part(GREY)])
    assert (low[0], high[0]) == (-0.5, 0.5)
    assert (low[2], high[2]) == pytest.approx((-0.2, 0.15))


# --- cabinet --------------------------------------------------------------------------------------


WOOD, WHITE = (160, 110, 70), (220, 216, 208)
FIELD = Field(-0.5, 0.7, 0.1, 0.9, -0.25)


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


def test_rack_is_hollow_and_has_its_shelves() -> None:
    parts = rack(FIELD, 0.3, 0.02, [1, 1], [3, 2], WOOD, back=None)
    assert len(parts) == 2 + 2 + 1 + 2 + 1  # sides, top and bottom, the upright, shelves
    middle = FIELD.z + 0.15
    # Straight up through the left and the right bay: top, bottom and shelves between them.
    for x, shelves in ((-0.2, 2), (0.4, 1)):
        inside = held(parts, [(x, y, middle) for y in np.linspace(0.1, 0.9, 201)])
        assert np.diff(inside.astype(int)).clip(0).sum() + inside[0] == shelves + 2
    assert not holds(parts, (-0.2, 0.25, middle))
    closed = rack(FIELD, 0.3, 0.02, [1, 1], [3, 2], WOOD, back=WHITE)
    hit = held(closed, [(-0.2, 0.25, z) for z in np.linspace(FIELD.z, FIELD.z + 0.3, 61)])
    assert not any(hit[:54])
    assert any(hit[54:])


# --- display --------------------------------------------------------------------------------------


CASE, BORDER, SCREEN, STAND = (180, 182, 184), (30, 31, 32), (60, 110, 170), (90, 92, 94)


LOOK = Look(CASE, BORDER, SCREEN, STAND)


HEAD = Head(
    width=0.6,
    height=0.4,
    thickness=0.03,
    border=0.02,
    chin=0.05,
    corner=0.01,
    bulge=0.04,
    bulge_share=0.5,
)


def of(parts: list[Part], color: tuple[int, int, int]) -> np.ndarray:
    return np.concatenate([part.vertices for part in parts if part.color == color])


def test_a_curved_screen_is_concentric_with_its_case() -> None:
    angle = 0.4
    case, screen, _ = curved_head(HEAD, LOOK, angle)
    centre = -0.3 / math.sin(angle)  # on the z axis, in front
    radius = {
        color: np.unique(np.hypot(part.vertices[:, 0], part.vertices[:, 2] - centre).round(9))
        for color, part in ((CASE, case), (SCREEN, screen))
    }
    assert len(radius[CASE]) == len(radius[SCREEN]) == 2
    np.testing.assert_allclose(np.diff(radius[CASE]), HEAD.thickness, atol=1e-8)
    # Its face is 1.4 layers nearer to the viewer than the case's, its back within the case.
    assert radius[CASE][0] - radius[SCREEN][0] == pytest.approx(1.4 * HEAD.step, abs=1e-8)
    assert radius[CASE][0] < radius[SCREEN][1] < radius[CASE][1]
    # A border's width of the arc is left free at either end, as above and below.
    ends = np.abs(np.arctan2(screen.vertices[:, 0], screen.vertices[:, 2] - centre)).max()
    assert (angle - ends) * 0.3 / math.sin(angle) == pytest.approx(HEAD.border)
    assert screen.vertices[:, 1].max() == pytest.approx(0.2 - HEAD.border)


# --- lamp -----------------------------------------------------------------------------------------


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


# --- loudspeaker ----------------------------------------------------------------------------------


BLACK = (30, 31, 32)


DRIVERS = draw_drivers(np.random.default_rng(3), BLACK, 2)


def test_woofer_is_a_ring_around_a_cone_that_deepens() -> None:
    ring, cone, cap = woofer(DRIVERS, (0.1, 0.5, -0.2), 0.08, 0.004)
    for part in (ring, cone, cap):
        middle = (part.vertices.min(axis=0) + part.vertices.max(axis=0)) / 2
        np.testing.assert_allclose(middle[:2], (0.1, 0.5), atol=1e-12)
        assert part.vertices[:, 2].max() > -0.2 > part.vertices[:, 2].min()

    def reach(part_vertices: np.ndarray) -> np.ndarray:
        return np.linalg.norm(part_vertices[:, :2] - (0.1, 0.5), axis=1)

    assert reach(ring.vertices).max() == pytest.approx(0.08)
    assert ring.vertices[:, 2].min() == pytest.approx(-0.2 - 3 * 0.004)
    edge, throat = reach(cone.vertices) > 0.06, reach(cone.vertices) < 0.03
    near = cone.vertices[edge & (cone.vertices[:, 2] < -0.2), 2]
    np.testing.assert_allclose(near, -0.2 - 2.6 * 0.004)
    np.testing.assert_allclose(cone.vertices[throat, 2], -0.2 - 1.8 * 0.004)
    assert max(ring.color) < 60 or min(ring.color) > 120  # rubber, or polished metal


@pytest.mark.parametrize("height", [0.22, 0.40, 1.10])
@pytest.mark.parametrize("woofers", [1, 2, 4])
def test_drivers_fit_the_baffle_and_not_each_other(height: float, woofers: int) -> None:
    for seed in range(5):
        drivers = draw_drivers(np.random.default_rng(seed), BLACK, woofers)
        plate, *parts = baffle(drivers, (0.2, height, 0.25), 0.05, grille=False)
        outer = []  # the first part of each driver is its ring or plate
        for part in parts:
            low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
            y, reach = (low[1] + high[1]) / 2, (high[1] - low[1]) / 2
            if not any(abs(y - other) < 1e-9 for other, _ in outer):
                outer.append((y, reach))
        assert len(outer) == 1 + woofers + drivers.port
        for (upper, above), (lower, below) in itertools.pairwise(outer):
            assert upper - above > lower + below
        assert outer[0][0] + outer[0][1] < plate.vertices[:, 1].max() + 1e-9
        assert outer[-1][0] - outer[-1][1] > plate.vertices[:, 1].min() - 1e-9


# --- telephone ------------------------------------------------------------------------------------


def test_a_dial_looks_towards_minus_z() -> None:
    face, *holes, hub = dial(4.0, GREY, BLACK)
    assert len(holes) == 10
    assert abs(face.vertices[:, 2].min() + 0.6) < 10 * EXACT
    for boss in (*holes, hub):
        assert boss.vertices[:, 2].min() < face.vertices[:, 2].min() - 0.1
    centres = np.array([(hole.vertices.max(0) + hole.vertices.min(0))[:2] / 2 for hole in holes])
    assert np.allclose(np.linalg.norm(centres, axis=1), 0.72 * 4.0)
    gaps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    assert np.allclose(gaps, 2 * 0.72 * 4.0 * math.sin(math.radians(15)))


def test_keys_differ_in_colour_from_the_body() -> None:
    rng = np.random.default_rng(1)
    for grey in range(12, 231, 6):
        body = (grey, grey, grey)
        key = key_color(rng, body)
        # Dark: at most 51 * 1.1 + 6; light: at least 152 * 0.9 - 6, about 110.
        assert abs(sum(key) / 3 - grey) > 18


# --- vessel ---------------------------------------------------------------------------------------


def test_a_flat_sail_is_a_plate() -> None:
    # A trapezium of height 0.8 between 0.5 and 0.1.
    sail = fore_and_aft_sail([(0.1, 0.0), (0.1, 0.5)], [(0.9, 0.0), (0.9, 0.1)], 0.0, GREY)
    assert volume(sail) == pytest.approx(0.8 * 0.3 * CLOTH, abs=EXACT)
    sail = square_sail(0.3, (0.1, 0.9), (0.25, 0.05), 0.0, GREY)
    assert volume(sail) == pytest.approx(0.8 * 0.3 * CLOTH, abs=EXACT)


def test_a_house_is_a_frustum() -> None:
    part = house((0, 1), (2, 4), 0.5, GREY, lean=(0.2, 0.1), narrow=0.5)
    # A prismatoid: (bottom + 4 middle + top) * height / 6.
    assert volume(part) == pytest.approx((1.0 + 4 * 0.85 * 0.75 + 0.7 * 0.5) * 2 / 6, abs=EXACT)
