from __future__ import annotations

import math

import numpy as np
import pytest

from data_prep.shapes.hulls import AEROFOIL, blade, disc, mirrored, pair, spindle
from data_prep.shapes.solids import box
from data_prep.shapes.vessel.lines import STATIONS, Lines
from tests.data_prep.shapes.sections import box_of, holds, volume

GREY = (120, 121, 122)
# A few hundred float64 operations on numbers of order 1: see test_solids.
EXACT = 1e-12
SHIP = Lines(half_beam=0.1, draft=0.05, freeboard=0.08, sheer=(0.03, 0.01), entry=0.3, stern=0.8)


def polygon_area(sides: int) -> float:
    """Of the regular polygon in the unit circle."""
    return sides / 2 * math.sin(2 * math.pi / sides)


def test_a_spindle_of_one_section_is_an_elliptical_prism() -> None:
    part = spindle([(-1, 0.3, 0.2, 0.5), (2, 0.3, 0.2, 0.5)], GREY, x=4.0, sides=10)
    assert volume(part) == pytest.approx(polygon_area(10) * 0.2 * 0.5 * 3, abs=EXACT)
    assert part.vertices.mean(axis=0) == pytest.approx((4.0, 0.3, 0.5), abs=EXACT)


def test_a_blade_of_one_chord_is_an_aerofoil_times_its_span() -> None:
    x, y = AEROFOIL.T
    area = abs(float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())) / 2
    wing = blade([(-1, 0, 0.2, 0.5, 0.1), (2, 0, 0.3, 0.5, 0.1)], GREY)
    assert volume(wing) == pytest.approx(area * 0.5 * 0.1 * 3, abs=EXACT)
    fin = blade([(0, -1, 0.2, 0.5, 0.1), (0, 2, 0.3, 0.5, 0.1)], GREY, upright=True)
    assert volume(fin) == pytest.approx(volume(wing), abs=EXACT)
    assert np.ptp(fin.vertices, axis=0) == pytest.approx((0.1, 3.0, 0.6), abs=EXACT)
    assert np.ptp(wing.vertices, axis=0) == pytest.approx((3.0, 0.1, 0.6), abs=EXACT)


def test_a_disc_turns_about_x() -> None:
    wheel = disc((1, 2, 3), 0.5, 0.2, GREY, sides=14)
    assert volume(wheel) == pytest.approx(polygon_area(14) * 0.5**2 * 0.2, abs=EXACT)
    assert wheel.vertices.mean(axis=0) == pytest.approx((1, 2, 3), abs=EXACT)
    # A bevel turns the ends into frustums between radius 0.4 and 0.5.
    bevelled = disc((1, 2, 3), 0.5, 0.2, GREY, bevel=0.05, sides=14)
    frustum = 0.05 / 3 * (0.45**2 + 0.45 * 0.5 + 0.5**2)
    expected = polygon_area(14) * (0.5**2 * 0.1 + 2 * frustum)
    assert volume(bevelled) == pytest.approx(expected, abs=EXACT)


def test_a_mirror_image_faces_outwards() -> None:
    part = box((1, 2, 3), (0.2, 0.4, 0.6), GREY)
    image = mirrored(part)
    assert volume(image) == pytest.approx(volume(part), abs=EXACT)
    assert image.vertices.mean(axis=0) == pytest.approx((-1, 2, 3), abs=EXACT)
    assert [p.vertices[0, 0] for p in pair(part)] == [part.vertices[0, 0], -part.vertices[0, 0]]


def test_a_hull_reaches_from_keel_to_deck_and_from_bow_to_stern() -> None:
    low, high = box_of([SHIP.between(SHIP.keel, SHIP.deck, GREY)])
    assert low == pytest.approx((-high[0], -0.05, -0.5), abs=EXACT)
    assert high[1:] == pytest.approx((0.08 + 0.03, 0.5), abs=EXACT)
    # A stem has some width (0.002 at most on each side); nothing else is added to the beam.
    assert 0.1 <= high[0] <= 0.1 + 0.002 + EXACT


def test_a_hull_is_widest_amidships_and_narrow_below() -> None:
    assert SHIP.half_width_at(0.0) == pytest.approx(0.1, rel=0.01)
    assert SHIP.half_width_at(0.5) == pytest.approx(0.08, abs=EXACT)
    assert SHIP.half_width_at(-0.5) == pytest.approx(0.003, abs=EXACT)
    below = [SHIP.half_width_at(0.1, depth) for depth in (0.0, 0.05, 0.10, 0.125)]
    assert below == sorted(below, reverse=True)
    assert len(set(below)) == 4


def test_the_deck_climbs_to_both_ends() -> None:
    assert SHIP.deck_at(-0.5) == pytest.approx(0.11, abs=EXACT)
    assert SHIP.deck_at(0.5) == pytest.approx(0.09, abs=EXACT)
    assert SHIP.deck.min() == pytest.approx(0.08, rel=0.02)


def test_the_stem_leans_forward() -> None:
    bow = SHIP.between(SHIP.keel, SHIP.deck, GREY).vertices
    stem = bow[: len(bow) // len(STATIONS)]
    lowest, highest = stem[stem[:, 1].argmin()], stem[stem[:, 1].argmax()]
    assert lowest[2] - highest[2] == pytest.approx(SHIP.rake, abs=EXACT)


def test_rocker_lifts_the_keel_at_the_ends() -> None:
    curved = Lines(0.1, 0.05, 0.08, rocker=0.6)
    assert curved.keel[0] == pytest.approx(-0.05 * 0.4, abs=EXACT)
    assert curved.keel[-1] == pytest.approx(-0.05 * 0.4, abs=EXACT)
    assert curved.keel.min() == pytest.approx(-0.05, rel=0.05)


@pytest.mark.parametrize("fullness", [0.2, 0.5])
def test_a_well_has_a_floor_and_walls(fullness: float) -> None:
    lines = Lines(0.18, 0.06, 0.09, entry=0.5, fullness=fullness, rake=0.0)
    boat = lines.open_boat(0.09, 0.022, GREY)
    half = lines.half_width_at(0.1)
    assert not holds([boat], (0.0, 0.08, 0.1))
    assert not holds([boat], (half - 0.03, 0.088, 0.1))
    assert holds([boat], (0.0, -0.02, 0.1))
    assert holds([boat], (half - 0.008, 0.085, 0.1))
    assert holds([boat], (0.0, lines.deck_at(0.49) - 0.02, 0.49))  # decked at the stern
    for depth in (0.02, 0.05, 0.08):  # the wall leans with the hull's side
        outside, y = lines.half_width_at(0.1, depth), lines.deck_at(0.1) - depth
        assert holds([boat], (outside - 0.012, y, 0.1))
        assert not holds([boat], (outside - 0.040, y, 0.1))
        assert not holds([boat], (outside + 0.005, y, 0.1))
