"""`bench.draw_cloud` and `bench.turntable`; their default is in `test_cloud`."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import torch

import bench
from bench.rendering.cloud import Drawing, Failed, draw_cloud
from data_prep.clouds.normalise import normalise_points
from data_prep.failures import BadInput, StageFailure
from data_prep.randomness import generator
from data_prep.scene import View

TABLE = pd.DataFrame(np.eye(3), columns=["nx", "ny", "nz"])


@pytest.fixture(scope="module")
def points():
    return generator("test").normal(size=(300, 3)) * (1, 2, 3)


def test_any_method_from_all_around_and_in_other_axes(points):
    views = tuple(View(90.0 * i, 10.0) for i in range(4))
    expected = draw_cloud(normalise_points(points), Drawing("splat", views))
    assert not isinstance(expected, Failed)
    assert np.array_equal(bench.turntable(points, 4, 10, method="splat"), expected)
    x, y, z = points.T
    theirs = np.stack([-z, -x, y], axis=1).tolist()
    turned = bench.draw_cloud(theirs, 90, 10, up="z", front="x", method="splat")
    assert np.array_equal(turned, expected[1])


@pytest.mark.parametrize("names", ["xyz", ("Easting", "Northing", "Height")])
def test_columns_of_a_table_are_found_by_their_names(points, names):
    x, y, z = points.T
    table = pd.DataFrame(dict(zip(names, (x, y, z), strict=True)) | {"id": "a"})
    drawn = bench.draw_cloud(table[["id", *reversed(names)]], method="splat")
    assert np.array_equal(drawn, bench.draw_cloud(points, method="splat"))


@pytest.mark.parametrize("kind", [torch.float64, torch.bfloat16])
def test_tensors_of_networks_are_points(points, kind):
    tensor = torch.tensor(points, dtype=kind, requires_grad=True)
    expected = bench.draw_cloud(tensor.detach().double().numpy(), method="splat")
    assert np.array_equal(bench.draw_cloud(tensor, method="splat"), expected)


@pytest.mark.parametrize(
    ("wrong", "kind", "message"),
    [
        ({"points": np.zeros((0, 3))}, BadInput, "the cloud has no points"),
        ({"points": np.zeros((5, 2))}, ValueError, r"points: expected real numbers \[N, 3\]"),
        (
            {"points": TABLE},
            BadInput,
            "points: columns 'nx, ny, nz'; name three of them x, y and z",
        ),
        (
            {"elevation": 9},
            TypeError,
            "turntable: no option elevation; there are frames, ele.*, up, f",
        ),
        ({"up": "w"}, BadInput, "up 'w': no axis"),
        ({"up": None}, BadInput, "up 'None': no axis"),
        ({"method": "splta"}, BadInput, "unknown method 'splta': did you mean 'splat'"),
        ({"method": "true-mesh"}, BadInput, "method 'true-mesh' draws the mesh behind a cloud"),
        ({"elevation_deg": 91}, ValueError, "elevation_deg must lie in"),
        ({"frames": 0}, ValueError, "frames must be at least 1, got 0"),
        ({"points": [[0, 0, 0], [1, 0, 0]], "method": "surface-apss"}, StageFailure, "2 points"),
    ],
)
def test_what_cannot_be_drawn(points, wrong, kind, message):
    with pytest.raises(kind, match=message):
        bench.turntable(**({"points": points, "method": "splat"} | wrong))


def test_far_points_and_steps_are_named_and_far_points_left_out_if_asked_for(points, capsys):
    far = np.vstack([points, np.full((9, 3), -9999.0)])
    expected = bench.turntable(points, 2, method="splat")
    assert np.array_equal(bench.turntable(far, 2, method="splat", drop_far=True), expected)
    assert capsys.readouterr().err == (
        "note: 9 of 309 points are left out, they lie far from the rest\n"
    )
    bench.draw_cloud(far, method="splat")
    bench.draw_cloud((points + np.array([5e6, 0, 0])).astype(np.float32), method="splat")
    named, steps = capsys.readouterr().err.splitlines()
    assert named.startswith("note: 9 of 309 points lie up to ")
    assert named.endswith(" % of the image's width; drop_far=True leaves them out")
    assert steps.startswith("note: coordinates are in steps of 0.5 where the object is ")
