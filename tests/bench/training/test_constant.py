from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

import bench.training.constant
from bench.training.constant import fit, mean_ssim, train_constant
from data_prep.failures import BadInput
from data_prep.rendering.images import blank

RNG = np.random.default_rng(0)


def squares(count):
    """Images of one grey square each, about the middle of the frame."""
    images = blank(count)
    for image in images:
        top, left = RNG.integers(30, 50, 2)
        image[top : top + 40, left : left + 40] = 150
    return images


def test_one_image_is_best_drawn_as_it_is():
    truth = squares(1)
    assert mean_ssim(truth, fit(truth, 2, 0)) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.slow
def test_the_fit_beats_where_it_starts():
    truth = squares(40)
    found = fit(truth, 60, 0)
    assert found.shape == (128, 128, 3)
    assert found.dtype == np.uint8
    mean = np.round(truth.mean(axis=0)).astype(np.uint8)
    assert mean_ssim(truth, found) > mean_ssim(truth, mean) + 0.01


def test_the_image_is_written_whole(tmp_path, monkeypatch):
    truth = squares(6)
    monkeypatch.setattr(bench.training.constant, "_images", lambda *arguments: truth)
    out = tmp_path / "constant.png"
    scores = train_constant(2, 3, 4, 0, out)
    with Image.open(out) as image:
        assert np.array_equal(np.array(image), fit(truth, 4, 0))
    assert scores.blank == mean_ssim(truth, blank(1)[0])
    assert scores.constant == mean_ssim(truth, fit(truth, 4, 0))


@pytest.mark.parametrize("name", ["objects", "views", "steps"])
def test_nothing_to_fit_to(tmp_path, name):
    numbers = {"objects": 1, "views": 1, "steps": 1} | {name: 0}
    with pytest.raises(BadInput, match=f"--{name} 0: must be at least 1"):
        train_constant(**numbers, seed=0, out=tmp_path / "constant.png")
    assert not list(tmp_path.iterdir())
