from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.data_prep.shapes.samples import Families, of_each_family
from tests.data_prep.shapes.sections import box_of, cut, holds, vertices_of


@pytest.fixture(scope="module")
def benches() -> Families:
    return of_each_family("bench", seed=2024, count=30)


def test_benches_are_longer_than_deep_and_stand_on_the_floor(benches: Families) -> None:
    for bench in itertools.chain(*benches.values()):
        low, high = box_of(bench.parts)
        assert low[1] == pytest.approx(0.0, abs=1e-12)
        if bench.family not in ("picnic", "row"):
            assert high[0] - low[0] > 1.1 * (high[2] - low[2])


@pytest.mark.parametrize("family", ["park", "settle", "pew", "row"])
def test_backs_are_behind(benches: Families, family: str) -> None:
    for bench in benches[family]:
        vertices = vertices_of(bench.parts)
        low, high = box_of(bench.parts)
        highest = vertices[vertices[:, 1] > 0.9 * high[1]]
        assert highest[:, 2].mean() > (low[2] + high[2]) / 2
        assert high[1] > 0.7  # metres


def test_seats_are_at_the_height_of_seats(benches: Families) -> None:
    for family in ("park", "settle"):
        for bench in benches[family]:
            seat = bench.parts[0].vertices[:, 1].max()
            assert 0.40 <= seat <= 0.48


def test_parks_have_slats_with_gaps(benches: Families) -> None:
    for bench in benches["park"]:
        wood = bench.parts[0].color
        length = np.ptp(bench.parts[0].vertices[:, 0])
        bars = [p for p in bench.parts if p.color == wood and np.ptp(p.vertices[:, 0]) == length]
        level = [bar for bar in bars if np.ptp(bar.vertices[:, 1]) < 0.046]
        seat = [bar for bar in level if bar.vertices[:, 1].max() < 0.48]
        assert 3 <= len(seat) <= 7
        assert len(bars) - len(seat) in range(2, 6)
        places = sorted((bar.vertices[:, 2].min(), bar.vertices[:, 2].max()) for bar in seat)
        widths = [high - low for low, high in places]
        gaps = [after[0] - before[1] for before, after in itertools.pairwise(places)]
        assert np.array(gaps) / np.mean(widths) == pytest.approx(0.16 / 0.84, abs=1e-9)


def test_settles_stand_on_four_legs(benches: Families) -> None:
    for bench in benches["settle"]:
        standing = [part for part in bench.parts if part.vertices[:, 1].min() < 1e-9]
        assert len(standing) == 4
        assert len({tuple(np.sign(p.vertices.mean(axis=0)[::2])) for p in standing}) == 4


def test_planks_have_no_back(benches: Families) -> None:
    for bench in benches["plank"]:
        assert 0.40 <= box_of(bench.parts)[1][1] <= 0.48


def test_pews_have_boards_for_ends(benches: Families) -> None:
    for bench in benches["pew"]:
        for end in bench.parts[:2]:
            low, high = box_of([end])
            assert 0.03 <= high[0] - low[0] <= 0.06
            assert low[1] == 0.0
            assert holds([end], ((low[0] + high[0]) / 2, 0.3, 0.0))
        assert bench.parts[0].vertices[:, 0].mean() < 0 < bench.parts[1].vertices[:, 0].mean()


def test_picnic_tables_have_a_bench_on_either_side(benches: Families) -> None:
    for bench in benches["picnic"]:
        low, high = box_of(bench.parts)
        assert low[2] == pytest.approx(-high[2], abs=1e-9)
        middle = cut(bench.parts, 0, 0.0)
        tops = middle[np.abs(middle[:, 2]) > 0.05]  # without the beam
        seats = tops[tops[:, 1] < 0.55]
        table = tops[tops[:, 1] > 0.55]
        assert seats[:, 1].max() <= 0.48
        assert 0.70 <= table[:, 1].max() <= 0.78
        assert np.abs(table[:, 2]).max() < np.abs(seats[:, 2]).min()
        assert len(seats[seats[:, 2] < 0]) == len(seats[seats[:, 2] > 0]) > 0


def test_rows_repeat_one_shell(benches: Families) -> None:
    for bench in benches["row"]:
        first = bench.parts[0]
        shells = [
            p for p in bench.parts if p.color == first.color and len(p.faces) == len(first.faces)
        ]
        assert 2 <= len(shells) <= 5
        pitches = np.diff([shell.vertices[:, 0].mean() for shell in shells])
        assert pitches == pytest.approx(pitches[0], abs=1e-9)
        assert 0.50 <= pitches[0] <= 0.60
        # The shells do not touch.
        assert np.ptp(first.vertices[:, 0]) <= pitches[0] - 0.02 + 1e-9


def test_iron_carries_wood_in_parks_and_not_in_halls(benches: Families) -> None:
    def colours(family: str) -> float:
        return float(np.mean([len({p.color for p in b.parts}) >= 2 for b in benches[family]]))

    assert colours("park") == 1.0
    assert colours("settle") < 0.6  # only its pad has another colour, 0.35 by the weights
    assert colours("row") == 1.0
