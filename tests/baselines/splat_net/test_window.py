from __future__ import annotations

import numpy as np
import pytest
import torch

from baselines.splat_net.window import RING, STEP, Box, Windows, in_groups, whole_images

SIZE = 64


def random_boxes(count):
    rng = np.random.default_rng(0)
    starts = rng.integers(0, SIZE, (count, 2))
    ends = rng.integers(starts, SIZE) + 1
    order = rng.permutation(count).tolist()
    ends_of_all = np.stack([starts, ends], axis=2).reshape(count, 4).tolist()
    return {i: Box(*ends_of_one) for i, ends_of_one in zip(order, ends_of_all, strict=True)}


@pytest.mark.parametrize("most", [1, 4, 100])
def test_groups_hold_every_box_once_and_what_it_needs_around_it(most):
    boxes = random_boxes(25)
    groups = list(in_groups(boxes, SIZE, most))
    assert sorted(i for group in groups for i in group.numbers) == sorted(boxes)
    assert len(groups) == -(-25 // most)
    for group in groups:
        assert len(group.numbers) <= most
        assert group.height % STEP == group.width % STEP == 0
        for i, (top, left) in zip(group.numbers, group.corners, strict=True):
            assert top % 2 == left % 2 == 0
            assert 0 <= top <= max(0, boxes[i].top - RING)
            assert 0 <= left <= max(0, boxes[i].left - RING)
            assert SIZE >= top + group.height >= min(SIZE, boxes[i].bottom + RING)
            assert SIZE >= left + group.width >= min(SIZE, boxes[i].right + RING)
    # and no more: the first row is even, their number a multiple of STEP
    (alone,) = in_groups({7: Box(20, 31, 0, SIZE)}, SIZE, most)
    assert alone == Windows([7], [(18, 0)], 16, SIZE, SIZE)


def test_nothing_has_no_groups():
    assert list(in_groups({}, SIZE, 5)) == []


def test_cut_and_paste():
    images = torch.arange(3 * 16 * 16 * 2).view(3, 16, 16, 2).float()
    windows = Windows([2, 0], [(0, 4), (8, 6)], 8, 8, 16)
    parts = windows.cut(images)
    assert torch.equal(parts[0], images[2, :8, 4:12])
    assert torch.equal(parts[1], images[0, 8:, 6:14])
    empty = -torch.ones(1, 16, 16, 2)
    pasted = windows.paste(parts, empty)
    expected = empty.repeat(2, 1, 1, 1)
    expected[0, :8, 5:12] = images[2, :8, 5:12]  # the first column misses its neighbour
    expected[1, 9:, 7:14] = images[0, 9:, 7:14]
    assert torch.equal(pasted, expected)
    assert windows.below() == Windows(range(2), [(0, 2), (4, 3)], 4, 4, 8)


def test_whole_images_are_themselves_in_their_order():
    images = torch.rand(3, 16, 16)
    assert whole_images(range(3), 16).cut(images) is images
    assert torch.equal(whole_images([2, 0, 1], 16).cut(images), images[[2, 0, 1]])
    assert torch.equal(whole_images([1], 16).paste(images[:1], -images[1:2]), images[:1])


def test_a_box_grows_up_to_the_edge():
    assert Box(3, 10, 0, 12).grown(5, 16) == Box(0, 15, 0, 16)
    image = np.arange(64.0, dtype=np.float32).reshape(8, 8)
    assert Box(2, 4, 1, 3).of(image).tolist() == [[17, 18], [25, 26]]
    assert Box(2, 4, 1, 3).moved(1, -1) == Box(3, 5, 0, 2)
