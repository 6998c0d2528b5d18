from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from benchmarks.unseen_classes import (
    RIVAL,
    TESTED,
    ahead,
    differences,
    main,
    measure,
    to_markdown,
    without_class,
)
from data_prep.datasets import ProceduralObject
from data_prep.failures import StageFailure
from data_prep.render import render
from data_prep.training_set import SurfaceSet, TrainingSet


def table(offsets: dict[str, float]) -> pd.DataFrame:
    base = np.linspace(0.5, 0.7, 5)
    return pd.DataFrame(
        {"class": name, "object": str(i), "condition": c, "ssim": base[i] + offset}
        for name, offset in offsets.items()
        for c in TESTED
        for i in range(len(base))
    )


def test_the_objects_of_one_class_are_left_out() -> None:
    number = np.arange(4)
    pictures = np.zeros((4, 2, 8, 8, 3), np.uint8) + number[:, None, None, None, None].astype("u1")
    data = SurfaceSet(
        TrainingSet(
            pictures,
            number[:, None] * np.ones(2),
            -number[:, None] * np.ones(2),
            number[:, None, None] * np.ones((1, 5, 3), np.float32),
        ),
        pictures[..., 0],
        pictures[..., 1],
    )
    left = without_class(data, ["a", "b", "a", "c"], "a")
    for array in (left.seen.images, left.coverage, left.grey, left.seen.clouds):
        assert array.reshape(2, -1)[:, 0].tolist() == [1, 3]
    assert left.seen.azimuth_deg[:, 0].tolist() == [1, 3]
    assert left.seen.elevation_deg[:, 0].tolist() == [-1, -3]


def test_differences_to_the_rival() -> None:
    found = differences({RIVAL: table({"a": 0.0, "b": 0.0}), "net": table({"a": 0.1, "b": -0.05})})
    assert RIVAL not in set(found["network"])
    for name, gain in (("a", 0.1), ("b", -0.05)):
        rows = found[found["class"] == name]
        assert len(rows) == len(TESTED)
        for column in ("gain", "ci_low", "ci_high"):
            assert rows[column].to_numpy() == pytest.approx(gain, abs=1e-12)
        assert rows["ssim"].to_numpy() == pytest.approx(0.6 + gain, abs=1e-12)
        assert rows[RIVAL].to_numpy() == pytest.approx(0.6, abs=1e-12)
    assert ahead(found, TESTED) == {"net": ["a"]}
    text = to_markdown(found)
    assert "| net | a | 5 | 0.700 (+0.100 [+0.100, +0.100])" in text
    assert "in 1 classes (a)" in text


def test_ahead_means_in_all_conditions() -> None:
    net = table({"a": 0.1})
    net.loc[net["condition"] == "noise-0.10", "ssim"] -= 0.2
    found = differences({RIVAL: table({"a": 0.0}), "net": net})
    assert ahead(found, TESTED) == {"net": []}
    assert ahead(found, ("512", "noise-0.05")) == {"net": ["a"]}


class Mesh:
    """Draws the mesh, but for clouds of 512 points."""

    def __init__(self, obj):
        self.mesh = obj.load()

    def prepare(self, cloud, rng=None):
        if len(cloud) == 512:
            raise StageFailure("here", "too few")
        return self.mesh

    def draw(self, state, views, rng=None):
        return render(state, views) / np.float32(255)


def test_a_failure_is_scored_as_a_blank_picture() -> None:
    obj = ProceduralObject("lamp", "test", 0)
    found = measure(Mesh(obj), [obj]).set_index("condition")["ssim"]
    assert list(found.index) == list(TESTED)
    assert found.drop("512").to_numpy() == pytest.approx(1.0)
    assert 0 < found["512"] < 1


def test_a_class_that_does_not_exist_is_named(capsys) -> None:
    with pytest.raises(SystemExit):
        main(["--out", "unused", "--classes", "chair,stool"])
    assert "unknown stool; choose of airplane" in capsys.readouterr().err
