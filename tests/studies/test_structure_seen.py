"""What the structure of a chair is, and how often a training has seen one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from data_prep.shapes.chair.spec import draw_chair_spec
from studies.structure_seen import seen, structure


def test_lengths_and_colours_are_no_structure():
    chair = draw_chair_spec(np.random.default_rng(0))
    same = replace(chair, rake_deg=chair.rake_deg + 1, frame_color=(1, 2, 3), leg_m=0.01)
    assert structure(same) == structure(chair)
    assert structure(replace(chair, bars=chair.bars + 1)) != structure(chair)
    assert structure(replace(chair, arms=not chair.arms)) != structure(chair)


def test_a_training_has_seen_itself_and_a_larger_one_no_less():
    assert seen("train", 30, 30) == 30
    few, more = (seen("test", 24, train) for train in (30, 300))
    assert 0 < few < more <= 24
