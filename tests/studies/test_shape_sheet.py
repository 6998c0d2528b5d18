"""Sheets of shapes: one image each, in rows, and how many draws were rejected."""

from __future__ import annotations

import numpy as np

from data_prep.datasets.registry import ProceduralObject, open_dataset
from studies import shape_sheet
from studies.shape_sheet import COLUMNS, rejected, sheet


def test_images_stand_in_rows():
    objects = [ProceduralObject("lamp", "validation", i) for i in range(COLUMNS + 1)]
    made = sheet(objects)
    assert made.shape == (2 * 128, COLUMNS * 128, 3)
    assert (made[128:, 128:] == 255).all()
    first = made[:128, :128]
    assert (first < 255).any()
    assert np.array_equal(first, sheet(objects[:1])[:128, :128])


def test_rejected_draws_are_counted(monkeypatch):
    objects = list(open_dataset("procedural:widened").objects("chair", 3, 3, "train"))
    monkeypatch.setattr(shape_sheet, "draw_widened", lambda shapes, rng: (None, 2))
    assert rejected([*objects, ProceduralObject("chair", "train", 0)]) == 6
