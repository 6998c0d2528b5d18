from __future__ import annotations

import numpy as np
import pytest

from bench.metrics.frechet import frechet_distance
from studies.memory import BLOCK, WIDTH, Peak, blocks, growth, measure_merging, own_peak


@pytest.mark.slow
@pytest.mark.memory
def test_memory_that_was_taken_is_in_the_peak() -> None:
    before = own_peak()
    taken = np.ones(int((before + 64) * 2**20) // 8)  # 8 bytes each: more than ever was
    assert own_peak() - before > 64
    assert taken[0] == 1


def test_growth_is_from_the_fewest_images_to_the_most() -> None:
    measured = ((20_000, 330.0), (1000, 300.0), (5000, 900.0))
    peaks = [Peak("drawn", images // 40, images, 12.5, 200.0, end) for images, end in measured]
    assert growth(peaks) == pytest.approx(0.1)


def test_blocks_are_rows_whatever_their_number() -> None:
    found = np.concatenate(list(blocks(1, BLOCK + 7, 1.0)))
    assert found.shape == (BLOCK + 7, WIDTH)
    assert found.dtype == np.float32
    assert np.array_equal(found, np.concatenate(list(blocks(1, 2 * BLOCK, 1.0)))[: BLOCK + 7])


def test_merged_rows_give_the_distance_of_all_at_once() -> None:
    found = measure_merging(2500)
    x, y = (np.concatenate(list(blocks(s, 2500, f))) for s, f in ((1, 1.0), (2, 1.2)))
    assert found.distance == pytest.approx(frechet_distance(x, y), rel=1e-9)
    assert found.difference < 1e-9
