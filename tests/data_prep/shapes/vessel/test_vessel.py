from __future__ import annotations

import numpy as np
import pytest

from data_prep.shapes.vessel.rigs import CLOTH, fore_and_aft_sail, house, square_sail
from tests.data_prep.shapes.samples import Families, of_each_family
from tests.data_prep.shapes.sections import box_of, cut, holds, vertices_of, volume

GREY = (120, 121, 122)
EXACT = 1e-12  # see test_solids


@pytest.fixture(scope="module")
def fleet() -> Families:
    """20 vessels of each family."""
    return of_each_family("vessel", seed=29, count=20)


def test_a_flat_sail_is_a_plate() -> None:
    # A trapezium of height 0.8 between 0.5 and 0.1.
    sail = fore_and_aft_sail([(0.1, 0.0), (0.1, 0.5)], [(0.9, 0.0), (0.9, 0.1)], 0.0, GREY)
    assert volume(sail) == pytest.approx(0.8 * 0.3 * CLOTH, abs=EXACT)
    sail = square_sail(0.3, (0.1, 0.9), (0.25, 0.05), 0.0, GREY)
    assert volume(sail) == pytest.approx(0.8 * 0.3 * CLOTH, abs=EXACT)


def test_a_sail_bellies_out_in_its_middle_only() -> None:
    sail = square_sail(0.3, (0.1, 0.9), (0.25, 0.05), 0.04, GREY)
    assert sail.vertices[:, 2].min() == pytest.approx(0.3 - 0.04 - CLOTH / 2, abs=EXACT)
    edges = sail.vertices[(sail.vertices[:, 1] < 0.11) | (sail.vertices[:, 1] > 0.89)]
    assert np.abs(edges[:, 2] - 0.3).max() == pytest.approx(CLOTH / 2, abs=EXACT)


def test_a_house_is_a_frustum() -> None:
    part = house((0, 1), (2, 4), 0.5, GREY, lean=(0.2, 0.1), narrow=0.5)
    # A prismatoid: (bottom + 4 middle + top) * height / 6.
    assert volume(part) == pytest.approx((1.0 + 4 * 0.85 * 0.75 + 0.7 * 0.5) * 2 / 6, abs=EXACT)


def test_bows_point_to_minus_z(fleet: Families) -> None:
    for family in set(fleet) - {"submarine"}:
        for vessel in fleet[family]:
            bow, stern = (np.ptp(cut(vessel.parts[:1], 2, z)[:, 0]) for z in (-0.47, 0.47))
            assert bow < 0.75 * stern, family
    for vessel in fleet["submarine"]:  # it tapers to its propeller
        bow, stern = (np.ptp(cut(vessel.parts[:1], 2, z)[:, 0]) for z in (-0.44, 0.44))
        assert stern < 0.6 * bow


def test_hulls_float_in_the_water(fleet: Families) -> None:
    for family, vessels in fleet.items():
        for vessel in vessels:
            low, high = box_of(vessel.parts)
            assert low[1] < -0.02, family
            assert high[1] > 0.05, family


def test_beam_and_height_tell_families_apart(fleet: Families) -> None:
    beams = {f: [np.ptp(v.parts[0].vertices[:, 0]) for v in fleet[f]] for f in fleet}
    assert max(beams["warship"]) < 0.14
    assert max(beams["submarine"]) < 0.14
    assert min(beams["open-boat"]) > 0.27
    assert max(max(beams["cargo-ship"]), max(beams["passenger-ship"])) < 0.20
    assert min(beams["sailing-yacht"]) > 0.23
    # Above the water, in lengths of the hull.
    heights = {f: [float(box_of(v.parts)[1][1]) for v in fleet[f]] for f in fleet}
    assert min(heights["sailing-yacht"]) > 0.85
    assert min(heights["tall-ship"]) > 0.70
    for family in ("cargo-ship", "warship", "motor-yacht", "open-boat", "submarine"):
        assert max(heights[family]) < 0.40, family


def test_a_cargo_ships_bridge_is_aft(fleet: Families) -> None:
    for ship in fleet["cargo-ship"]:
        vertices = vertices_of(ship.parts)
        assert vertices[vertices[:, 1].argmax(), 2] > 0.2


def test_cargo_ships_have_two_colours_of_hull(fleet: Families) -> None:
    for ship in fleet["cargo-ship"]:
        side, bottom = ship.parts[:2]
        assert side.color != bottom.color
        # The bottom ends where the side begins, but for an overlap, and stands out of it.
        assert 0 < bottom.vertices[:, 1].max() - side.vertices[:, 1].min() < 0.009
        water = float(bottom.vertices[:, 1].max()) - 0.002
        wide = [np.ptp(cut([part], 1, water)[:, 0]) for part in (bottom, side)]
        assert wide[0] > wide[1]


def test_warships_are_grey_and_some_are_carriers(fleet: Families) -> None:
    flat = 0
    for ship in fleet["warship"]:
        red, green, blue = ship.parts[0].color
        assert max(red, green, blue) - min(red, green, blue) < 35
        flat += max(np.ptp(part.vertices[:, 2]) for part in ship.parts[3:]) > 1.0
    assert 0 < flat < 20


def test_yachts_carry_thin_sails_and_a_keel(fleet: Families) -> None:
    hoisted = 0
    for yacht in fleet["sailing-yacht"]:
        sails = [part for part in yacht.parts if len(part.vertices) == 30]
        hoisted += bool(sails)
        for sail in sails:
            extent = np.ptp(sail.vertices, axis=0)
            assert extent[0] < 0.07
            assert extent[1] > 0.4
        assert box_of(yacht.parts)[0][1] < -0.15
    assert 10 < hoisted < 20


def test_tall_ships_have_two_or_three_masts_and_yards_across(fleet: Families) -> None:
    masts = set()
    for ship in fleet["tall-ship"]:
        beam = np.ptp(ship.parts[0].vertices[:, 0])
        low, high = box_of(ship.parts)
        assert high[0] - low[0] > 1.2 * beam
        assert low[2] < -0.7  # the bowsprit
        # At a third of the rig's height only masts, stays and sails are cut, along the keel.
        upright = [
            p for p in ship.parts if len(p.vertices) == 12 and np.ptp(p.vertices[:, 1]) > 0.5
        ]
        masts.add(sum(np.ptp(p.vertices[:, 2]) < 0.05 for p in upright))
    assert masts == {2, 3}


def test_passenger_ships_have_storeys_of_windows(fleet: Families) -> None:
    counts = set()
    for ship in fleet["passenger-ship"]:
        long = [p for p in ship.parts[3:] if np.ptp(p.vertices[:, 2]) > 0.45]
        white, glass = (p for p in long[:2])
        assert min(white.color) > 180
        assert max(glass.color) < 80
        assert np.ptp(glass.vertices[:, 0]) > np.ptp(white.vertices[:, 0])
        counts.add(sum(p.color == glass.color for p in long))
    assert counts == {2, 3, 4, 5}


def test_motor_yachts_have_glass_or_an_open_cockpit(fleet: Families) -> None:
    open_ones = 0
    for boat in fleet["motor-yacht"]:
        assert any(max(part.color) < 90 and part.color[2] > part.color[0] for part in boat.parts)
        deck = float(boat.parts[0].vertices[:, 1].max())
        open_ones += not holds(boat.parts[:1], (0.0, 0.35 * deck, 0.40))
    assert 0 < open_ones < 20


def test_open_boats_are_open(fleet: Families) -> None:
    for boat in fleet["open-boat"]:
        hull = boat.parts[0]
        top = cut([hull], 2, 0.0)[:, 1].max()
        assert not holds([hull], (0.0, top - 0.03, 0.0))
        assert holds([hull], (0.0, box_of([hull])[0][1] + 0.008, 0.0))


def test_thwarts_end_in_the_hulls_walls(fleet: Families) -> None:
    for boat in fleet["open-boat"]:
        low, high = box_of(boat.parts[1:2])
        x, y, z = (0.0, *(low + high)[1:] / 2)
        assert not holds(boat.parts[:1], (x, y, z))
        assert holds(boat.parts[:1], (high[0] - 0.001, y, z))


def test_submarines_are_round_with_a_sail(fleet: Families) -> None:
    for boat in fleet["submarine"]:
        hull, sail = boat.parts[:2]
        width, tall, _ = np.ptp(hull.vertices, axis=0)
        assert width == pytest.approx(tall, rel=0.05)
        assert sail.vertices[:, 1].max() > hull.vertices[:, 1].max() + 0.04
        assert np.ptp(sail.vertices[:, 2]) < 0.25
