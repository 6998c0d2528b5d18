"""The draw of jobs: how many, of which methods, and that all are as probable."""

from __future__ import annotations

import math
from collections import Counter

import pytest

from bench.receipts.sample import draw_parts, drawn_places


@pytest.mark.parametrize(
    ("cells", "objects", "count"), [(44, 24, 53), (7, 3, 7), (7, 3, 1), (7, 3, 21), (1, 50, 12)]
)
@pytest.mark.parametrize("seed", range(5))
def test_every_method_and_condition_is_drawn_before_one_is_twice(cells, objects, count, seed):
    drawn = drawn_places(cells, objects, count, seed)
    pairs = [(obj, cell) for obj, of_object in drawn.items() for cell in of_object]
    assert len({*pairs}) == len(pairs) == count
    assert all(0 <= obj < objects and 0 <= cell < cells for obj, cell in pairs)
    times = Counter(dict.fromkeys(range(cells), 0))
    times.update(cell for _, cell in pairs)
    assert {*times.values()} <= {count // cells, -(-count // cells)}


def test_every_job_is_as_probable():
    """5 of 12 jobs in 3,000 draws: each 1,250 times, with a standard deviation of 27."""
    draws, cells, objects, count = 3000, 4, 3, 5
    times = Counter(
        (obj, cell)
        for seed in range(draws)
        for obj, of_object in drawn_places(cells, objects, count, seed).items()
        for cell in of_object
    )
    share = count / (cells * objects)
    allowed = 5 * math.sqrt(draws * share * (1 - share))
    assert len(times) == cells * objects
    assert all(abs(number - draws * share) <= allowed for number in times.values())


def test_the_draw_depends_on_the_seed_alone():
    assert drawn_places(44, 24, 53, 7) == drawn_places(44, 24, 53, 7)
    assert drawn_places(44, 24, 53, 7) != drawn_places(44, 24, 53, 8)
    assert drawn_places(44, 24, 0, 7) == {}


def test_parts():
    assert draw_parts(24, 0, 1) == []
    assert draw_parts(24, 1, 1) == [*range(24)]
    assert {len(draw_parts(24, 0.05, seed)) for seed in range(9)} == {1}  # of 1.2
    assert len(draw_parts(32, 0.1, 1)) == 3
    assert len(draw_parts(3, 1e-6, 1)) == 1
    assert len({draw_parts(24, 0.05, seed)[0] for seed in range(200)}) == 24
