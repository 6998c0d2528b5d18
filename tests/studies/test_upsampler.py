from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest

from data_prep.datasets.objects import GreyObject
from data_prep.datasets.registry import open_dataset
from studies.upsampler import COLUMNS, CONDITIONS, last_losses, measured, with_line


def test_a_line_takes_the_place_of_the_one_of_its_name() -> None:
    text = with_line("", {"name": "1", "steps": 10, "ssim 2048": 0.912345})
    text = with_line(text, {"name": "2", "distance": 0.25})
    text = with_line(text, {"name": "1", "steps": 20})
    first, second = csv.DictReader(io.StringIO(text))
    assert tuple(first) == COLUMNS
    assert (first["name"], first["steps"], first["ssim 2048"]) == ("1", "20", "")
    assert (second["name"], second["distance"]) == ("2", "0.25")


def test_the_losses_of_a_training_are_means_of_its_last_lines(tmp_path: Path) -> None:
    lines = ["step,distance,normals,validation", *(f"{i},{i},{2 * i},0.5" for i in range(100))]
    path = tmp_path / "losses.csv"
    path.write_text("\n".join(lines))
    mean = np.mean(range(50, 100))
    expected = {"steps": 99, "distance": mean, "normals": 2 * mean, "validation": 0.5}
    assert last_losses(path) == expected


def test_the_true_mesh_has_the_images_that_it_is_compared_with() -> None:
    objects = open_dataset("procedural:validation").objects("table", 1, 1, "validation")
    found = measured("true-mesh@grey", map(GreyObject, objects))
    assert set(found) == {f"{m} {c}" for c in CONDITIONS for m in ("ssim", "lpips")}
    assert found["ssim 512"] == pytest.approx(1)
    assert found["lpips noise-0.10"] == pytest.approx(0, abs=1e-6)
