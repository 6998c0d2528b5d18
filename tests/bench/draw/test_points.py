"""`bench.draw_cloud` and `bench.turntable`; their default is in `test_cloud`."""

from __future__ import annotations

import math
import re
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
import torch

import bench
from bench.draw.cloud import Drawing, Failed, draw_in_process
from bench.draw.cloud_file import CloudFile
from data_prep.clouds.normalise import normalise_points
from data_prep.failures import BadInput, StageFailure
from data_prep.randomness import generator
from data_prep.scene import View

NAN = [[0, 0, 0], [np.nan, 1, 2]]
TABLE = pd.DataFrame(np.eye(3), columns=["nx", "ny", "nz"])


@pytest.fixture(scope="module")
def points():
    return generator("test").normal(size=(300, 3)) * (1, 2, 3)


def warnings_of(draw):
    """Return what a call returns, and the texts of its warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        drawn = draw()
    return drawn, [str(warning.message) for warning in caught]


def test_any_method_from_all_around_and_in_other_axes(points):
    views = tuple(View(90.0 * i, 10.0) for i in range(4))
    expected = draw_in_process(normalise_points(points), Drawing("splat", views))
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


WRONG = {  # what is raised, for which arguments, and what is said
    BadInput: [
        ({"points": np.zeros((0, 3))}, "the cloud has no points"),
        ({"points": "shape.obj"}, "shape.obj: "),
        (
            {"points": "a.ply", "columns": "xyz"},
            "a.ply: columns= is for arrays; leave",
        ),
        ({"columns": (0, 1, 9)}, r"columns \(0, 1, 9\): not in points of shape \[300, 3"),
        ({"points": "."}, r"\.: is a folder; give a file of points"),
        (
            {"points": NAN},
            r"1 of 2 points are not finite \(the first is row 1, ",
        ),
        ({"size": 10**9}, "size 1000000000: must be a whole number, 16 to 2048"),
        ({"size": "big"}, "size 'big': must be a whole number, 16 to 2048"),
        ({"background": "red"}, "background 'red': must be white or transparent"),
        ({"device": "gpu"}, "device 'gpu': must be auto, cpu or cuda"),
        ({"method": ["splat"]}, r"method \['splat'\]: must be the id of one method"),
        *(
            ({"budget_ms": budget, "method": None}, f"budget_ms {budget!r}: must be a number")
            for budget in ("50ms", True, math.nan)
        ),
        ({"frames": 3600, "size": 2048}, "size 2048: at most 273 with 3600 images; give a smaller"),
        ({"points": TABLE}, "points: columns 'nx, ny, nz'; name three of them x, y and z"),
        ({"up": "w"}, "up 'w': no axis"),
        ({"up": None}, "up 'None': no axis"),
        ({"method": "splta"}, "unknown method 'splta': did you mean 'splat'"),
        ({"method": "true-mesh"}, "method 'true-mesh' draws the mesh behind a cloud"),
    ],
    ValueError: [
        ({"points": np.zeros((5, 2))}, r"points: expected real numbers \[N, 3\]"),
        ({"points": np.array(["a", "b"])}, r"expected real numbers \[N, 3\], got <U1"),
        ({"elevation_deg": 91}, "elevation_deg must lie in"),
        *(
            ({"frames": frames}, f"frames must be a whole number from 1 to 3600, got {frames}")
            for frames in (0, 10**9, True, 2.0)
        ),
        ({"elevation_deg": "30"}, "elevation_deg must be a number of degrees, got '30'"),
    ],
    TypeError: [({"elevation": 9}, "turntable: no option elevation; there are frames, ")],
    StageFailure: [({"points": [[0, 0, 0], [1, 0, 0]], "method": "surface-apss"}, "2 points")],
}


@pytest.mark.parametrize("kind", WRONG)
def test_what_cannot_be_drawn(points, kind):
    for wrong, message in WRONG[kind]:
        with pytest.raises(kind, match=message) as refusal:
            bench.turntable(**({"points": points, "method": "splat"} | wrong))
        assert refusal.type is kind


@pytest.mark.parametrize("angle", [True, "30", None])
def test_an_angle_is_a_number(points, angle):
    with pytest.raises(ValueError, match=f"azimuth_deg must be a number of degrees, got {angle!r}"):
        bench.draw_cloud(points, azimuth_deg=angle, method="splat")


FRONT = (View(0, 0),)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Drawing("splat", ()), "views: there are none; give at least one View"),
        (lambda: Drawing("splat", (True,)), "views: True is no View"),
        *(
            (lambda batch=batch: Drawing("splat", FRONT, batch=batch), f"batch {batch!r}: must be")
            for batch in (True, 0, -3, 2.0)
        ),
        *(
            (lambda most=most: CloudFile(Path("a.npy"), True, most=most), f"most {most!r}: must be")
            for most in (True, 0, -1, 1e3)
        ),
    ],
)
def test_numbers_of_a_request_are_checked_when_it_is_made(make, says):
    with pytest.raises(BadInput, match=re.escape(says)):
        make()


def test_further_columns_files_sizes_and_points_that_are_not_finite(points, tmp_path):
    plain = {"method": "splat", "size": 200}
    expected = bench.draw_cloud(points, **plain)
    assert expected.shape == (200, 200, 3)
    six, broken = np.hstack([points, points]), np.vstack([points, [[np.nan, 0, 0]]])
    swapped = six[:, [5, 1, 0, 0, 1, 2]]
    np.save(tmp_path / "cloud.npy", np.hstack([broken, np.ones((301, 3))]))
    file, lost = tmp_path / "cloud.npy", "1 of 301 points are left out, they are not finite"
    further = "points: columns 3 to 5 of [N, 6] are not used; give colours as colors=points[:, 3:]"
    unused = f"{file}: 3 of its 6 columns are not used; only the coordinates of its points are"
    plain["colour"] = "grey"
    for given, options, said in (
        (six, {}, [further]),
        (swapped, {"columns": (2, 1, 5)}, []),
        (pd.DataFrame(swapped, columns=[*"abcdef"]), {"columns": "dbf"}, []),
        (pd.DataFrame(six), {}, [further]),
        (broken, {"drop_invalid": True}, [lost]),
        (file, {"drop_invalid": True}, [unused, f"{file}: {lost}"]),
    ):
        drawn, warned = warnings_of(lambda g=given, o=options: bench.draw_cloud(g, **o, **plain))
        assert np.array_equal(drawn, expected)
        assert warned == said
    with pytest.raises(BadInput, match=r"the first is point 301\); remove them, or leave them out"):
        bench.draw_cloud(tmp_path / "cloud.npy", method="splat")
    assert bench.draw_cloud(points, method="splat", background="transparent").shape[2] == 4


def test_maps_of_a_sphere():
    """The camera stands 4 radii away, and half its field of view has the tangent 16 / 58."""
    points = generator("test").normal(size=(4000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    image, maps = bench.draw_cloud(points, method="poisson", size=64, return_maps=True)
    assert image.shape == (64, 64, 3)
    assert np.array_equal(np.isinf(maps.depth), maps.mask == 0)
    assert maps.depth[32, 32] == pytest.approx(3, abs=0.02)
    assert maps.normals[32, 32] == pytest.approx([0, 0, 1], abs=0.1)
    assert maps.normals[32, 54] == pytest.approx([0.65, 0, 0.75], abs=0.1)
    assert maps.mask.mean() == pytest.approx(np.pi / 4 * (58 / 16) ** 2 / 15, rel=0.02)
    with pytest.raises(BadInput, match="method 'splat' makes no surface, so that there are no "):
        bench.draw_cloud(points, method="splat", return_maps=True)


def test_what_the_package_has_is_seen():
    assert {"draw_cloud", "turntable"} <= {*dir(bench)}
    assert {"ssim", "psnr", "lpips"} <= {*dir(bench.metrics)}


def test_far_points_and_steps_are_named_and_far_points_left_out_if_asked_for(points):
    far = np.vstack([points, np.full((9, 3), -9999.0)])
    expected = bench.turntable(points, 2, method="splat")
    with pytest.warns(UserWarning, match="^9 of 309 points are left out, they lie far from the r"):
        assert np.array_equal(bench.turntable(far, 2, method="splat", drop_far=True), expected)
    with pytest.warns(UserWarning, match="^9 of 309 points lie up to .*; drop_far=True leaves the"):
        bench.draw_cloud(far, method="splat")
    with pytest.warns(UserWarning, match="^coordinates are in steps of 0.5 where the object is "):
        bench.draw_cloud((points + np.array([5e6, 0, 0])).astype(np.float32), method="splat")


MANY = generator("many").normal(size=(9000, 3))  # a ball of fog: noise, and smoothed
NOTES = {  # what a method does to these points, and to a hundred of them
    ("splat-fill", 9000): ["splat-fill: input: 8192 of 9000 points used"],
    ("fused-net@grey", 9000): [
        "fused-net@grey: input: 8192 of 9000 points used",
        "fused-net@grey: upsampled-wrap: input: 8192 of 9000 points used",
    ],
    ("alpha-wrap", 9000): [],
    ("splat", 9000): [],
    ("alpha-wrap", 100): [],
}


@pytest.mark.parametrize(("method", "count"), NOTES)
def test_what_a_method_does_to_the_points_is_a_warning_where_it_is_called(method, count):
    points, said = MANY[:count], NOTES[method, count]
    points = points / np.linalg.norm(points, axis=1)[:, None]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        bench.draw_cloud(points, method=method)
        bench.turntable(points, 2, method=method)
        draw_in_process(normalise_points(points), Drawing(method, (View(0, 0),)))
    assert [str(warning.message) for warning in caught] == 3 * said
    assert {warning.filename for warning in caught} <= {__file__}


@pytest.mark.slow
def test_an_up_sampled_cloud_has_a_cap_of_its_points_before():
    points = MANY / np.linalg.norm(MANY, axis=1)[:, None]
    _, warned = warnings_of(lambda: bench.draw_cloud(points, method="upsampled-wrap"))
    assert warned == ["upsampled-wrap: input: 8192 of 9000 points used"]


def test_a_smoothed_cloud_and_a_mesh_that_was_not_made_are_warned_of():
    _, warned = warnings_of(lambda: bench.draw_cloud(MANY[:2000], method="denoised-wrap"))
    assert [line.split(": ")[:2] for line in warned] == [
        ["denoised-wrap", "noise"],
        ["denoised-wrap", "smoothed"],
    ]
    _, warned = warnings_of(lambda: bench.draw_cloud(MANY[:9], method="fused-net@grey"))
    assert any(
        line.startswith("fused-net@grey: upsampled-wrap: no mesh, input: 9 ") for line in warned
    )


def test_a_note_is_told_even_where_the_method_fails():
    with pytest.raises(StageFailure), pytest.warns(UserWarning, match="^points: columns 3 to 5 of"):
        bench.draw_cloud(np.eye(2, 6), method="surface-apss")


def colours_of(points):
    """Return colours that differ in each channel, uint8 [N, 3], by the places of points."""
    share = (points - points.min(axis=0)) / np.ptp(points, axis=0)
    return (share * (200, 100, 50)).astype(np.uint8)


GIVEN = {  # other forms of the same colours
    "a frame with its columns in another order": lambda inks: pd.DataFrame(
        inks[:, ::-1], columns=["blue", "green", "red"]
    ),
    "a tensor of a training": lambda inks: torch.tensor(inks / 255, requires_grad=True),
    "columns that may lack values": lambda inks: pd.DataFrame(
        inks, columns=[*"rgb"], dtype="Int64"
    ),
    "columns of Arrow": lambda inks: pd.DataFrame(inks).convert_dtypes(dtype_backend="pyarrow"),
}


@pytest.mark.parametrize("most", [200, 1])  # of whole numbers 1 is nearly black
@pytest.mark.parametrize("form", GIVEN)
def test_colours_in_any_form(points, form, most):
    inks = np.minimum(colours_of(points), most)
    if form == "a tensor of a training":  # fractions
        inks = colours_of(points)
    expected = bench.draw_cloud(points, method="splat", colors=inks)
    drawn = bench.draw_cloud(points, method="splat", colors=GIVEN[form](inks))
    assert np.array_equal(drawn, expected)


def test_tables_of_arrow_and_frames_that_may_lack_values(points):
    expected = bench.draw_cloud(points, method="splat")
    frame = pd.DataFrame(points[:, ::-1], columns=[*"zyx"])
    for given in (pa.Table.from_pandas(frame), frame.convert_dtypes()):
        assert np.array_equal(bench.draw_cloud(given, method="splat"), expected)
    frame = frame.astype("Float64")
    frame.loc[7, "y"] = pd.NA
    with pytest.raises(BadInput, match=r"1 of 300 points are not finite \(the first is row 7,"):
        bench.draw_cloud(frame, method="splat")


@pytest.mark.parametrize("of_each", [colours_of, lambda points: points[:, 1]])
def test_masked_points_leave_out_their_colours(points, of_each):
    masked = np.ma.masked_array(points, mask=points > 4)
    kept = ~masked.mask.any(axis=1)
    inks = of_each(points)
    expected, _ = warnings_of(
        lambda: bench.draw_cloud(points[kept], method="splat", colors=inks[kept])
    )
    drawn, warned = warnings_of(lambda: bench.draw_cloud(masked, method="splat", colors=inks))
    assert np.array_equal(drawn, expected)
    assert f"{300 - kept.sum()} of 300 points are masked, and left out" in warned
    hidden = np.ma.masked_array(inks, mask=np.arange(inks.size).reshape(inks.shape) == 5)
    with pytest.raises(BadInput, match=r"^colors: some are masked; give a colour"):
        bench.draw_cloud(points, method="splat", colors=hidden)
