from __future__ import annotations

import numpy as np
import pytest

from data_prep.shapes.shape_class import Drawn
from data_prep.shapes.solids import Part
from data_prep.shapes.tables import CLASS, FAMILY_WEIGHTS
from tests.data_prep.shapes.sections import box_of, cut, holds, surface_area


@pytest.fixture(scope="module")
def tables() -> list[Drawn]:
    rng = np.random.default_rng(2024)
    return [CLASS.draw(rng) for _ in range(1000)]


@pytest.fixture(scope="module")
def by_family(tables: list[Drawn]) -> dict[str, list[Drawn]]:
    return {f: [t for t in tables if t.family == f][:60] for f in CLASS.families}


def halfway(table: Drawn) -> np.ndarray:
    """|x| and |z| [n, 2] of the cut at half of its height, as shares of the top's half extents."""
    reach = np.abs(table.parts[0].vertices).max(axis=0)
    section = cut(table.parts, 1, 0.5 * float(box_of(table.parts)[1][1]))
    return np.abs(section[:, ::2]) / reach[::2]


def test_families_are_as_frequent_as_the_table_says(tables: list[Drawn]) -> None:
    drawn = [table.family for table in tables]
    for family, weight in FAMILY_WEIGHTS.items():
        p = weight / sum(FAMILY_WEIGHTS.values())
        # Four standard errors: all six pass with probability 0.9996, were the seed not fixed.
        assert abs(drawn.count(family) / len(drawn) - p) < 4 * np.sqrt(p * (1 - p) / len(drawn))


def test_a_third_of_all_tables_is_low(tables: list[Drawn]) -> None:
    # Below 0.55 m are, of those on four legs (0.36), the coffee tables 0.30 and 0.45 of the side
    # tables 0.18; of the low pedestals 0.22 (0.16) 0.81; panels (0.12), but for the tall sheets
    # 0.30 * 0.45; of the frames (0.11) 0.55.
    p = 0.36 * (0.30 + 0.18 * 0.45) + 0.16 * 0.22 * 0.8125 + 0.12 * 0.865 + 0.11 * 0.55
    low = np.mean([box_of(table.parts)[1][1] < 0.55 for table in tables])
    assert abs(low - p) < 4 * np.sqrt(p * (1 - p) / len(tables))


def test_the_first_part_is_the_top_and_nothing_is_above_it(tables: list[Drawn]) -> None:
    for table in tables[:200]:
        high = box_of(table.parts)[1][1]
        assert table.parts[0].vertices[:, 1].max() == pytest.approx(high, abs=1e-12)
        assert box_of(table.parts)[0][1] == pytest.approx(0.0, abs=1e-12)


def test_four_legs_stand_near_the_corners(by_family: dict[str, list[Drawn]]) -> None:
    for table in by_family["four-leg"]:
        standing = [part for part in table.parts if part.vertices[:, 1].min() < 1e-9]
        assert len(standing) == 4
        # Legs are at most 0.06 thick and inside by that and 0.07 of the width, round tops' at 0.68.
        assert halfway(table).min() > 0.3


def test_a_pedestal_stands_in_the_middle(by_family: dict[str, list[Drawn]]) -> None:
    for table in by_family["pedestal"]:
        across = halfway(table)[:, 1]
        assert len(across) > 0
        assert across.max() < 0.4


def test_a_desk_has_a_place_for_the_knees_in_front(by_family: dict[str, list[Drawn]]) -> None:
    blocks = 0
    for desk in by_family["desk"]:
        top = desk.parts[0].vertices
        x, y, z = np.abs(top).max(axis=0)
        assert not holds(desk.parts, (0.0, 0.5 * y, -0.6 * z))
        sides = [holds(desk.parts, (side * 0.85 * x, 0.5 * y, 0.0)) for side in (-1, 1)]
        blocks += any(sides)
        if any(sides):  # drawers look towards the sitter and stand out of the block
            drawers = [
                p for p in desk.parts if len(p.vertices) == 8 and np.ptp(p.vertices[:, 2]) < 0.05
            ]
            proud = [p for p in drawers if p.vertices[:, 2].max() < -0.7 * z]
            assert len(proud) >= 4
    assert blocks > 0.5 * len(by_family["desk"])  # 0.70 of them, by the weights


def test_panels_close_the_sides(by_family: dict[str, list[Drawn]]) -> None:
    for table in by_family["panel"]:
        assert halfway(table)[:, 0].max() > 0.85


def test_a_frame_is_of_thin_grey_bars(by_family: dict[str, list[Drawn]]) -> None:
    for table in by_family["frame"]:
        top = table.parts[0]
        bars = [part for part in table.parts if part.color != top.color]
        for part in bars:
            # 10 % of the 9 by which chrome is bluer than red, and 6 more or less each way.
            assert max(part.color) - min(part.color) <= 22
        section = cut(bars, 1, 0.5 * float(box_of(table.parts)[1][1]))
        assert len(section) > 0
        # Bars are 18 to 34 mm thick, those of a loop 1.6 times that; hairpins lean, up to 0.2 m.
        for side in (-1, 1):
            for end in (-1, 1):
                here = section[(np.sign(section[:, 0]) == side) & (np.sign(section[:, 2]) == end)]
                assert np.ptp(here[:, ::2], axis=0).max() < 0.10


def test_trestles_are_tied_by_one_beam(by_family: dict[str, list[Drawn]]) -> None:
    for table in by_family["trestle"]:
        high = float(box_of(table.parts)[1][1])
        middle = cut(table.parts[1:], 0, 0.0)
        assert len(middle) > 0
        assert np.abs(middle[:, 2]).max() < 0.05
        assert middle[:, 1].max() < 0.75 * high
        assert 0.04 < np.ptp(middle[:, 1]) < 0.11


def test_tops_of_glass_are_for_tables_that_can_carry_them(
    by_family: dict[str, list[Drawn]],
) -> None:
    def bluish(part: Part) -> bool:
        return part.color[2] > part.color[0] + 5 and min(part.color) > 120

    shares = {f: np.mean([bluish(t.parts[0]) for t in ts]) for f, ts in by_family.items()}
    assert shares["trestle"] == 0.0
    assert shares["frame"] > 0.25  # 0.45 by the weights, less what jitter takes away


# Seeds 0 to 7: family, number of faces, their area.
PINNED = [
    ("desk", 196, 9.6992281),
    ("pedestal", 324, 4.9891781),
    ("four-leg", 252, 5.8265784),
    ("four-leg", 172, 4.2680521),
    ("trestle", 208, 3.5147745),
    ("frame", 268, 5.3507331),
    ("desk", 256, 9.3998503),
    ("desk", 256, 9.7268878),
]


def test_drawn_tables_are_pinned() -> None:
    # Trained weights know these tables: a change here is a new data set, not a refactoring.
    seen = []
    for seed in range(8):
        drawn = CLASS.draw(np.random.default_rng(seed))
        faces = sum(len(part.faces) for part in drawn.parts)
        # Coordinates are rounded at 2**-24 and faces measure 0.01 and more: 1e-5 of each at most.
        seen.append((drawn.family, faces, pytest.approx(surface_area(drawn), rel=1e-5)))
    assert seen == PINNED
