from __future__ import annotations

import pytest

from data_prep.shapes.vessel.lines import STATIONS, Lines
from tests.data_prep.shapes.sections import box_of, holds

GREY = (120, 121, 122)
# A few hundred float64 operations on numbers of order 1: see test_solids.
EXACT = 1e-12
SHIP = Lines(half_beam=0.1, draft=0.05, freeboard=0.08, sheer=(0.03, 0.01), entry=0.3, stern=0.8)


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
