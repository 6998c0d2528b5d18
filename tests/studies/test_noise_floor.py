"""The study on two chairs: what must not move does not, what moves moves by what it should."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from studies.cells import METRICS, cells
from studies.noise_floor import BATCHES, CEILING, METHODS, THREADS, TURN, Study


@pytest.fixture(scope="module")
def study():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield Study(chairs=2, views=3)
    torch.set_num_threads(before)


def test_cells_are_those_of_a_hand_made_case(study):
    # Images of the other chair, under the same views: what is found is the other chair.
    swapped, outputs = study.truth[::-1], study.truth_outputs
    other = type(outputs)(*(values[::-1] for values in outputs))
    actual = cells(study.truth, outputs, swapped, other, study.scene.views)
    assert actual["fd-views"] < 1e-9  # the same set of images
    # each image is compared with the other chair's views but its own: with 3 views of 2 chairs
    # that differ enough, none is outputs for the chair that was asked for
    assert actual["retrieval"] == 0.0
    assert actual["ssim"] < 0.9


def test_batch_and_threads_move_nothing_that_is_kept(study):
    floors = [*study.by_batch(), *study.by_threads()]
    assert {f.source for f in floors} == {BATCHES, THREADS}
    # float32 sums in another order change an image by some 1e-6, now and then a grey level at a
    # half; one level in one pixel of 6 x 49,152 moves a mean by 1e-8 or so
    image = [f for f in floors if f.metric in METRICS[:5] and np.isfinite(f.moved)]
    assert max(f.moved for f in image) < 1e-6
    assert torch.get_num_threads() == 1


def test_a_turn_moves_the_truth_as_well(study):
    floors = study.by_turn()
    moves = {(f.method, f.metric): f for f in floors}
    assert set(moves) == {(method, metric) for method in (*METHODS, CEILING) for metric in METRICS}
    assert moves[CEILING, "ssim"].moved == 0.0
    assert moves[CEILING, "elevation-error-deg"].moved > 0  # other images are judged
    assert 0 < moves["splat", "ssim"].moved < 0.01
    assert {f.source for f in floors} == {TURN}
