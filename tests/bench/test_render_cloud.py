from __future__ import annotations

import os
import subprocess

import numpy as np
import plugin_methods
import pytest
from PIL import Image

import bench.render_cloud
from bench.isolation import Limits
from bench.render_cloud import CloudFile, Drawing, Failed, draw_cloud, draw_file
from bench.suites import SUITES
from data_prep.cloud_files import save_ply
from data_prep.randomness import generator
from data_prep.scene import PointCloud, View

from .conftest import BENCH

POINTS = np.array([[0, 0, 0], [4, 0, 0], [0, 2, 0]], np.float32)


@pytest.fixture
def plugins(tmp_path_factory, monkeypatch):
    with plugin_methods.installed(tmp_path_factory.mktemp("plugins"), monkeypatch):
        yield


@pytest.fixture
def cloud(tmp_path):
    path = tmp_path / "cloud.ply"
    save_ply(POINTS, path)
    return path


def told(path):
    """What `plugin_methods.Telling` was given: azimuth, elevation, points, ten times the radius."""
    return read(path)[0, :4, 0].tolist()


def read(path):
    with Image.open(path) as picture:
        assert (picture.format, picture.mode, picture.size) == ("PNG", "RGB", (128, 128))
        return np.asarray(picture)


def refused(command, *arguments):
    status, out, err = command("render", *arguments)
    assert (status, out) == (2, "")
    assert err.startswith("bench: ")
    assert err.count("\n") == 1
    return err.removeprefix("bench: ").rstrip("\n")


# --- pictures -------------------------------------------------------------------------------------


def test_a_picture_of_a_cloud(command, plugins, cloud, tmp_path):
    out = tmp_path / "new" / "out.png"
    assert command("render", cloud, "--method", "fake-healthy", "-o", out) == (0, f"{out}\n", "")
    assert told(out) == [30, 20, 3, 10]
    assert [path.name for path in out.parent.iterdir()] == ["out.png"]


def test_views_and_clouds_as_they_are(command, plugins, cloud, tmp_path):
    """Farthest point at 4 from the origin, or (brought to the unit sphere) at 1."""
    out = tmp_path / "out.png"
    chosen = ("--azimuth", "170", "--elevation", "90", "--as-is", "-o", out)
    assert command("render", cloud, "--method", "fake-healthy", *chosen)[0] == 0
    assert told(out) == [170, 90, 3, 40]


def test_the_picture_is_that_of_the_method(command, cloud, tmp_path):
    out = tmp_path / "out.png"
    points = generator("test").uniform(-0.5, 0.5, (300, 3)).astype(np.float32)
    np.save(tmp_path / "cloud.npy", points)
    chosen = ("--azimuth=-60", "--elevation=-10", "--as-is", "-o", out)
    assert command("render", tmp_path / "cloud.npy", "--method", "splat", *chosen)[0] == 0
    here = draw_cloud(PointCloud(points), Drawing("splat", (View(-60.0, -10.0),)))
    assert not isinstance(here, Failed)
    assert np.array_equal(read(out), here[0])
    assert (here < 255).any()


def test_random_numbers_are_the_same_each_time(plugins):
    """The method fails with any but those."""
    views = (View(30.0, 20.0),)
    drawing = Drawing("fake-unlucky", views)
    once, twice = (draw_cloud(PointCloud(POINTS), drawing) for _ in range(2))
    assert not isinstance(once, Failed)
    assert np.array_equal(once, twice)
    other = Drawing("fake-unlucky", views, rng=generator("other"))
    assert draw_cloud(PointCloud(POINTS), other) == Failed("ValueError: bad luck")


def test_views_can_be_drawn_some_a_call(plugins):
    views = (View(30.0, 20.0), View(40.0, 20.0), View(50.0, 20.0))
    cloud = PointCloud(POINTS)
    together = draw_cloud(cloud, Drawing("fake-several-views", views))
    one_by_one = draw_cloud(cloud, Drawing("fake-several-views", views, batch=1))
    assert together == Failed("ValueError: one at a time")
    assert not isinstance(one_by_one, Failed)
    assert one_by_one[:, 0, 0, 0].tolist() == [30, 40, 50]


def test_as_is_keeps_what_float32_can_hold(tmp_path):
    path = tmp_path / "odd.ply"
    odd = np.array([[np.nan, np.inf, -np.inf], [1e-45, 3.4e38, -0.0]], np.float32)
    save_ply(odd, path)
    assert CloudFile(path, as_is=True).load().points.tobytes() == odd.tobytes()
    np.savetxt(tmp_path / "large.xyz", [[1e300, -1e300, 0.5]])
    assert CloudFile(tmp_path / "large.xyz", as_is=True).load().points.tolist() == [
        [np.inf, -np.inf, 0.5]
    ]


def test_another_package_is_found_by_the_command_itself(cloud, tmp_path):
    """PYTHONPATH as a user has it; the method's crash is one line."""
    plugin_methods.announce(tmp_path, {"fake-segfault": "plugin_methods:fake_segfault"})
    folders = (tmp_path, os.path.dirname(plugin_methods.__file__), os.getcwd())  # noqa: PTH109, PTH120
    done = subprocess.run(
        [*BENCH, "render", cloud, "--method", "fake-segfault", "-o", tmp_path / "out.png"],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, folders))},
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "bench: fake-segfault: crash: the worker died (SIGSEGV)\n"
    assert not (tmp_path / "out.png").exists()


# --- failures -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "reason"),
    [
        ("fake-hang", "timeout: no result within 8 s"),
        ("fake-segfault", "crash: the worker died (SIGSEGV)"),
        ("fake-memory-hog", "memory: the worker used more than 1 GiB"),
        ("fake-exception", "ValueError: 12 of 34 parts are missing"),
        (
            "fake-wrong-shape",
            "draw: pictures of shape (1, 64, 128, 3), expected (1, 128, 128, 3)",
        ),
        ("fake-nan", "draw: 384 pixel values are not finite"),
        ("fake-blank", "draw: 1 of 1 pictures are blank"),
        ("surface-apss", "input: 3 points; normals need at least 11"),
    ],
)
def test_a_method_that_fails_is_one_line(
    command, plugins, cloud, tmp_path, monkeypatch, method, reason
):
    time_s = 8.0 if method == "fake-hang" else 120.0
    monkeypatch.setattr(bench.render_cloud, "LIMITS", Limits(time_s, 1.0))
    out = tmp_path / "out.png"
    out.write_bytes(b"old")
    done = command("render", cloud, "--method", method, "-o", out)
    assert done == (1, "", f"bench: {method}: {reason}\n")
    assert out.read_bytes() == b"old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cloud.ply", "out.png"]


def test_the_limits_are_those_of_the_paper_suite():
    assert SUITES[0].limits == bench.render_cloud.LIMITS


def test_what_cannot_be_used_is_the_users_to_mend(command, plugins, cloud, tmp_path):
    out = ("-o", tmp_path / "out.png")
    for method, problem in [
        ("splta", "unknown method 'splta': did you mean 'splat'? there are "),
        ("true-mesh", "method 'true-mesh' draws the mesh behind a cloud, and bare points have "),
        ("fake-no-licence", "no licence; buy one"),
        ("fake-no-library", "no libGL: install libgl1"),
        ("fake-no-weights", "weights: cut short; fetch them again"),
    ]:
        assert refused(command, cloud, "--method", method, *out).startswith(problem)
    blank = ("--method", "blank")
    for wrong, problem in [
        (("--azimuth", "inf"), "no such view: azimuth_deg must be finite, got inf"),
        (("--elevation", "91"), "no such view: elevation_deg must lie in -90..90, got 91.0"),
        (("--elevation", "nan"), "no such view: elevation_deg must lie in -90..90, got nan"),
        (("--azimuth", "left"), "Invalid value for '--azimuth': "),
    ]:
        assert refused(command, cloud, *blank, *out, *wrong).startswith(problem)
    jpeg = tmp_path / "out.jpg"
    assert refused(command, cloud, *blank, "-o", jpeg) == (
        f"{jpeg}: pictures are written as PNG; give a name that ends in .png"
    )
    assert [path.name for path in tmp_path.iterdir()] == ["cloud.ply"]


def test_files_that_are_no_clouds(command, tmp_path):
    out = ("--method", "blank", "-o", tmp_path / "out.png")
    (tmp_path / "text.xyz").write_text("1 2\n")
    (tmp_path / "nan.csv").write_text("0,0,nan\n0,1,0\n")
    (tmp_path / "equal.xyz").write_text("1 2 3\n1 2 3\n")
    for name, problem in [
        ("gone.ply", f"{tmp_path}/gone.ply: no such file"),
        ("text.xyz", f"{tmp_path}/text.xyz: line 1 has 2 columns, expected at least 3"),
        ("nan.csv", f"{tmp_path}/nan.csv: the cloud has 1 non-finite points of 2 (the first is "),
        ("equal.xyz", f"{tmp_path}/equal.xyz: all 2 points are equal, at [1.0, 2.0, 3.0]; a "),
    ]:
        assert refused(command, tmp_path / name, *out).startswith(problem)
    assert not (tmp_path / "out.png").exists()


def test_pictures_that_cannot_be_written(command, cloud, tmp_path):
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "file").touch()
    for out in (tmp_path / "folder.png", tmp_path / "file" / "out.png"):
        told = refused(command, cloud, "--method", "blank", "-o", out)
        assert told.startswith(f"{out}: cannot be written (")
        assert told.endswith("; make room, or give another -o")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cloud.ply", "file", "folder.png"]


def test_a_method_is_looked_for_before_a_worker_is_started(cloud, monkeypatch):
    monkeypatch.setattr(bench.render_cloud, "run_tasks", None)
    with pytest.raises(ValueError, match="unknown method"):
        draw_file(CloudFile(cloud, as_is=True), Drawing("splta", (View(0.0, 0.0),)))
