from __future__ import annotations

import csv
import math
from itertools import combinations

import numpy as np
import pytest

from bench.metrics.frechet import frechet_distance
from benchmarks.frechet_bias import (
    Bias,
    _of_split,
    expected_normal_distance,
    mean_root,
    summary,
    to_markdown,
    write_csv,
)

ROWS = [
    Bias("fd-views", "one view a chair", 10, 12.5, 1.25, 10),
    Bias("normal", "normal, d = 2048", 100, 3390.0, 5.0, 3, 3376.0),
]


def test_the_mean_root_of_a_product_of_square_matrices():
    # y = 1: the Fuss-Catalan law, whose moments are binomial(3k, k) / (2k + 1); k = 1/2 gives 3/4
    assert mean_root(1.0) == pytest.approx(0.75, abs=1e-6)


def test_the_mean_root_where_samples_are_few():
    # y large: rows of a sample are orthogonal, and A B' / m is a square matrix of normal numbers of
    # variance d / m^2: the quarter-circle law, 8 / (3 pi) sqrt(m / d); the next order is 1 / y of 1
    y = 1e4
    assert mean_root(y) == pytest.approx(8 / (3 * math.pi) / math.sqrt(y), rel=1e-3)


def test_expectation_where_samples_are_few():
    n, d = 10, 2048
    limit = 2 * d * (1 + 1 / n) - 16 / (3 * math.pi) * math.sqrt((n - 1) * d)
    # the next order is m / d = 0.4 % of the root's term, 230, times a number below 1
    assert expected_normal_distance(n, d) == pytest.approx(limit, abs=1.0)


@pytest.mark.parametrize("n", [20, 50, 65, 200, 1000])
def test_expectation_against_drawn_vectors(n):
    d, repeats = 64, 20
    rng = np.random.default_rng(n)
    found = [
        frechet_distance(rng.normal(size=(n, d)), rng.normal(size=(n, d))) for _ in range(repeats)
    ]
    # what the limit of large d leaves out (1 / d), and four standard errors of the mean
    tolerance = expected_normal_distance(n, d) / d + 4 * np.std(found, ddof=1) / math.sqrt(repeats)
    assert np.mean(found) == pytest.approx(expected_normal_distance(n, d), abs=tolerance)


def test_a_split_gives_halves_that_share_no_chair():
    chairs = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0]
    pool = np.array([[[c], [c + 0.25]] for c in chairs], np.float32)  # [6 chairs, 2 views, 1]

    def distance(half, other):  # of two Gaussians of one dimension
        x, y = (np.ravel([[c, c + 0.25] for c in part]) for part in (half, other))
        return (x.mean() - y.mean()) ** 2 + (x.std(ddof=1) - y.std(ddof=1)) ** 2

    possible = {
        round(distance(half, set(chairs) - set(half)), 6) for half in combinations(chairs, 3)
    }
    found = {round(_of_split(pool, 3, repeat), 6) for repeat in range(60)}
    assert found <= possible
    # 10 splits: one of them is missing with probability 10 x 0.9^60 = 2 %, but the seeds are fixed
    assert len(found) == len(possible) == 10


def test_summary():
    assert summary("m", "s", 5, [1.0, 2.0, 3.0], 7.0) == Bias("m", "s", 5, 2.0, 1.0, 3, 7.0)


def test_markdown_and_csv(tmp_path):
    lines = to_markdown(ROWS).splitlines()
    assert lines[2] == "| fd-views | one view a chair | 10 | 12.5 | 1.2 | 125 |  |"
    assert lines[3].endswith("| 3390 | 5 | 3.39e+05 | 3376 |")
    write_csv(tmp_path / "b.csv", ROWS)
    with (tmp_path / "b.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [row["expected"] for row in table] == ["", "3376"]
    assert float(table[0]["mean"]) == 12.5
