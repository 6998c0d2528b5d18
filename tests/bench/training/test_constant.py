from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

import bench.training.constant
from bench.training.constant import fit, mean_ssim, train_constant
from data_prep.rendering.images import blank

RNG = np.random.default_rng(0)


def squares(count):
    """Images of one grey square each, about the middle of the frame."""
    images = blank(count)
    for image in images:
        top, left = RNG.integers(30, 50, 2)
        image[top : top + 40, left : left + 40] = 150
    return images


@pytest.mark.slow
def test_the_fit_beats_where_it_starts():
    truth = squares(40)
    mean = np.round(truth.mean(axis=0)).astype(np.uint8)
    assert mean_ssim(truth, fit(truth, 60, 0)) > mean_ssim(truth, mean) + 0.01


def test_the_image_is_written_whole(tmp_path, monkeypatch):
    truth = squares(6)
    monkeypatch.setattr(bench.training.constant, "_images", lambda *arguments: truth)
    out = tmp_path / "constant.png"
    scores = train_constant(2, 3, 4, 0, out)
    with Image.open(out) as image:
        fitted = np.array(image)
    mean = np.round(truth.mean(axis=0)).astype(np.uint8)
    assert scores.constant == mean_ssim(truth, fitted) > mean_ssim(truth, mean)
    assert scores.blank == mean_ssim(truth, blank(1)[0])
