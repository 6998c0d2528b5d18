from __future__ import annotations

import os
import subprocess

import numpy as np
import plugin_methods
import pytest
from PIL import Image

import bench
import bench.draw.cloud
from bench.catalogue.methods import find_method
from bench.catalogue.suites import Limits
from bench.commands.render import with_remedy
from bench.draw.cloud import Drawing, Failed, draw_file, draw_in_process
from bench.draw.cloud_file import CloudFile
from bench.draw.finish import LABEL_HEIGHT, MARGIN, PROBLEM_GROUND
from data_prep.clouds.normalise import normalise_points
from data_prep.failures import BadInput
from data_prep.files.clouds import save_ply
from data_prep.randomness import generator
from data_prep.rendering.dots import draw_dots
from data_prep.rendering.mesh import draw_mesh
from data_prep.scene import PointCloud, View

from ..conftest import BENCH

POINTS = np.array([[0, 0, 0], [4, 0, 0], [0, 2, 0]], np.float32)


@pytest.fixture
def cloud(tmp_path):
    path = tmp_path / "cloud.ply"
    save_ply(POINTS, path)
    return path


def message(path):
    """Return azimuth, elevation, points and ten times the radius, as `Telling` was given them."""
    return read(path)[0, :4, 0].tolist()


def read(path):
    with Image.open(path) as image:
        assert (image.format, image.mode, image.size) == ("PNG", "RGB", (128, 128))
        return np.asarray(image)


def test_an_image_of_a_cloud(command, plugins, cloud, tmp_path):
    out = tmp_path / "out.png"
    assert command("render", cloud, "--method", "fake-healthy", "-o", out) == (0, f"{out}\n", "")
    assert message(out) == [30, 20, 3, 10]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cloud.ply", "out.png"]
    done = command("render", cloud, "--method", "fake-healthy")  # without a name: beside its cloud
    said = "drawn by fake-healthy; 'bench list' has others\n"
    assert done == (0, f"{tmp_path / 'cloud.png'}\n", said)
    assert message(tmp_path / "cloud.png") == [30, 20, 3, 10]


def test_the_image_is_that_of_the_method_and_of_the_clouds_axes(command, tmp_path):
    """A cloud in another convention has the same image."""
    points = generator("test").uniform(-0.5, 0.5, (300, 3)).astype(np.float32)
    theirs = np.stack([-points[:, 2], -points[:, 0], points[:, 1]], axis=1)
    np.save(tmp_path / "theirs.npy", theirs)
    out = tmp_path / "out.png"
    chosen = ("--azimuth=-60", "--elevation=-10", "--as-is", "--up", "z", "--front", "x", "-o", out)
    assert command("render", tmp_path / "theirs.npy", "--method", "splat", *chosen)[0] == 0
    here = draw_in_process(PointCloud(points), Drawing("splat", (View(-60.0, -10.0),)))
    assert not isinstance(here, Failed)
    assert np.array_equal(read(out), here[0])
    assert (here < 255).any()


def test_the_command_and_python_draw_a_cloud_alone_alike_by_a_network_of_all_classes(
    command, tmp_path
):
    points = generator("test").normal(size=(300, 3))
    points = points / np.linalg.norm(points, axis=1, keepdims=True) * (1, 2, 3)  # without noise
    np.save(tmp_path / "cloud.npy", points)
    status, out, err = command("render", tmp_path / "cloud.npy")
    assert (status, out) == (0, f"{tmp_path / 'cloud.png'}\n")
    assert err == "drawn by fused-net@grey; --budget 50ms is faster, 'bench list' has others\n"
    image = read(tmp_path / "cloud.png")
    assert np.array_equal(bench.draw_cloud(points, azimuth_deg=30, elevation_deg=20), image)
    assert np.array_equal(bench.draw_cloud(points, method="fused-net@grey"), image)
    assert (image < 255).any()


def test_a_file_that_nobody_named_is_not_replaced(refused, cloud, tmp_path):
    (tmp_path / "cloud.png").write_bytes(b"mine")
    assert refused("render", cloud) == (
        f"{tmp_path / 'cloud.png'}: exists already; -o {tmp_path / 'cloud.png'} replaces it, "
        "-o NAME keeps both"
    )
    assert (tmp_path / "cloud.png").read_bytes() == b"mine"


def test_what_of_the_file_is_not_drawn_and_what_knows_chairs_only_is_a_line_each(command, tmp_path):
    path, out = tmp_path / "cloud.ply", tmp_path / "out.png"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
        "property float z\nproperty uchar red\nelement face 2\n"
        "property list uchar int vertex_indices\nend_header\n"
        "0 0 0 255\n4 0 0 255\n0 2 0 255\nnan 0 0 255\n3 0 1 1\n3 0 1 1\n"
    )
    drawn = ("render", path, "--drop-invalid", "--method", "blank,splat-net@chair,splat", "-o", out)
    status, printed, err = command(*drawn)
    assert (status, printed) == (0, f"{out}\n")
    assert [line for line in err.splitlines() if not line.startswith("drawing: ")] == [
        f"note: {path}: its colours are not used; only the coordinates of its points are",
        f"note: {path}: its 2 faces are not used; only the coordinates of its points are; "
        "they make no surface of most of these",
        f"note: {path}: 1 of 4 points are left out, they are not finite",
        "note: splat-net@chair was trained on chairs and may draw a chair whatever the cloud is; "
        "for other objects leave out the method",
    ]


def test_colours_of_a_file_are_drawn_as_discs(command, refused, tmp_path):
    """Points left out and chosen take their colours along."""
    path, out = tmp_path / "cloud.xyz", tmp_path / "out.png"
    rng = generator("test")
    points, colors = rng.normal(size=(300, 3)), rng.integers(0, 250, (300, 3))
    points[7, 1] = np.nan
    np.savetxt(path, np.column_stack([points, colors]))
    options = ("--drop-invalid", "--points", "100", "-o", out)
    coloured = ("render", path, "--method", "splat", *options)
    guess = f"note: {path}: 3 of its 6 columns (x, y and z are the first 3, as no first line names "
    guess += "them); its colours are a guess, too, which --colour grey leaves out\n"
    note = f"note: {path}: 1 of 300 points are left out, they are not finite\n"
    assert command(*coloured) == (0, f"{out}\n", guess + note)
    cloud = CloudFile(path, as_is=False, most=100, drop_invalid=True).load()
    assert cloud.colors is not None
    kept = [np.flatnonzero((colors == color).all(axis=1))[0] for color in cloud.colors]
    assert np.array_equal(normalise_points(points[kept]).points, cloud.points)
    shown = {tuple(color) for color in read(out).reshape(-1, 3).tolist()} - {(255, 255, 255)}
    assert 10 < len(shown) <= 100
    assert shown <= {tuple(color) for color in cloud.colors.tolist()}
    assert command(*coloured, "--colour", "grey")[2].startswith(
        f"note: {path}: 3 of its 6 columns (x, y and z are the first 3, as no first line names "
        "them) are not used; only the coordinates of its points are\n"
    )
    assert (read(out) == read(out)[..., :1]).all()
    np.savetxt(path, points[:5])
    problem = f"{path}: no colours of its points; a PLY has red, green "
    assert refused(*coloured, "--colour", "file").startswith(problem)


def test_a_size_and_a_transparent_background(command, plugins, tmp_path):
    """Resample the image of a network; over white nothing changes."""
    cloud, out, large = (tmp_path / name for name in ("cloud.npy", "out.png", "large.png"))
    np.save(cloud, generator("test").normal(size=(300, 3)))
    note = (
        "note: splat-net@grey draws 128 x 128 pixels; resampled to 300 x 300 (Lanczos), which "
        "adds no detail; surfaces and discs are drawn at any size\n"
    )
    splat = ("render", cloud, "--method", "splat-net@grey")
    assert command(*splat, "-o", out) == (0, f"{out}\n", "")
    assert command(*splat, "--size", "300", "-o", large) == (0, f"{large}\n", note)
    enlarged = Image.open(out).resize((300, 300), Image.Resampling.LANCZOS)
    assert np.array_equal(np.asarray(Image.open(large)), np.asarray(enlarged))
    for name in ("clear.png", "clear.webp"):
        clear = (*splat, "--size", "300", "--background", "transparent", "--frames", "2")
        arguments = clear if name != "clear.png" else clear[:-2]
        assert command(*arguments, "-o", tmp_path / name)[0] == 0
        with Image.open(tmp_path / name) as image:
            assert (image.mode, image.size) == ("RGBA", (300, 300))
            page = Image.new("RGBA", image.size, "white")
            page.alpha_composite(image.copy())
            assert np.ptp(np.asarray(image)[..., 3]) == 255
        difference = np.asarray(page.convert("RGB")).astype(int) - np.asarray(enlarged)
        assert np.abs(difference).max() <= 1


def test_surfaces_and_discs_are_drawn_at_the_size_asked_for(command, tmp_path):
    """The object fills as large a share of the image at each size."""
    cloud, shares = tmp_path / "cloud.npy", []
    points = generator("test").normal(size=(600, 3))
    np.save(cloud, points / np.linalg.norm(points, axis=1, keepdims=True) * (1, 2, 1))
    for method in ("splat", "splat-fill", "alpha-wrap", "occupancy-net"):
        for size in (100, 128, 900):
            out = tmp_path / f"{size}.png"
            chosen = ("--method", method, "--size", size, "-o", out)
            assert command("render", cloud, *map(str, chosen)) == (0, f"{out}\n", "")
            with Image.open(out) as image:
                assert image.size == (size, size)
                shares.append((np.asarray(image) < 255).any(axis=2).mean())
        assert shares[-2] == pytest.approx(shares[-1], rel=0.1)
        assert shares[-3] == pytest.approx(shares[-1], rel=0.1)
    views, rng = (View(30.0, 20.0),), generator("test")
    state = find_method("occupancy-net").load("cpu").prepare(CloudFile(cloud, False).load(), rng)
    assert np.array_equal(Image.open(out), draw_mesh(state.mesh, views, 900)[0])


def test_several_angles_formats_and_turntables_of_several_clouds(command, plugins, cloud, tmp_path):
    fake = ("render", cloud, "--method", "fake-healthy")
    angles = ("--azimuth", "0,90", "--elevation", "10,20")
    files = [tmp_path / f"a-az{a}-el{e}.png" for e in (10, 20) for a in (0, 90)]
    printed = "".join(f"{file}\n" for file in files)
    status, out, _ = command(*fake, *angles, "-o", tmp_path / "a.png")
    assert (status, out) == (0, printed)
    assert [message(file)[:2] for file in files] == [[0, 10], [90, 10], [0, 20], [90, 20]]
    for name, options, frames in (
        ("a.jpg", (), 1),
        ("a.webp", ("--frames", "1"), 1),
        ("a.webp", ("--frames", "3"), 3),
    ):
        out = tmp_path / name
        assert command(*fake, *options, "-o", out)[:2] == (0, f"{out}\n")
        with Image.open(out) as image:
            assert (getattr(image, "n_frames", 1), image.size) == (frames, (128, 128))
            assert np.abs(np.asarray(image.convert("RGB"))[40:, 40:] - 255.0).max() < 8
    near = ("--azimuth", "0.1234567,0.1234568", "--frames", "1", "-o", tmp_path / "b.webp")
    assert len({*command(*fake, *near)[1].splitlines()}) == 2
    folder = tmp_path / "turns"
    folders = ("render", cloud, cloud.parent, "--method", "fake-healthy", "--frames", "2")
    assert command(*folders, "--format", "gif", "-o", folder)[0] == 0
    assert [path.name for path in folder.iterdir()] == ["cloud.gif"]
    assert command(*fake, "--format", "jpg")[1] == f"{tmp_path / 'cloud.jpg'}\n"


def test_points_that_are_not_finite_are_refused_or_left_out(tmp_path):
    text, array = tmp_path / "a.xyz", tmp_path / "a.npy"
    text.write_text("# a scan\n0 0 0\n1 nan 2\ninf 0 0\n3 4 5\n")
    np.save(array, [[0.0, 0, 0], [1, np.nan, 2], [np.inf, 0, 0], [3, 4, 5]])
    for path, where in ((text, "in line 3"), (array, "is point 2")):
        with pytest.raises(BadInput) as refusal:
            CloudFile(path, as_is=False).load()
        assert str(refusal.value) == (
            f"{path}: 2 of 4 points are not finite (the first {where}); remove them, or leave "
            "them out with --drop-invalid"
        )
        kept, notes = CloudFile(path, as_is=True, drop_invalid=True).load_with_notes()
        assert kept.points.tolist() == [[0, 0, 0], [3, 4, 5]]
        assert notes == (f"{path}: 2 of 4 points are left out, they are not finite",)
    assert CloudFile(text, as_is=False, drop_invalid=True, most=2).load().points.shape == (2, 3)


def test_random_numbers_are_the_same_each_time(plugins):
    """The method fails with any but those."""
    views = (View(30.0, 20.0),)
    drawing = Drawing("fake-unlucky", views)
    once, twice = (draw_in_process(PointCloud(POINTS), drawing) for _ in range(2))
    assert not isinstance(once, Failed)
    assert not isinstance(twice, Failed)
    assert np.array_equal(once, twice)
    other = Drawing("fake-unlucky", views, rng=generator("other"))
    assert draw_in_process(PointCloud(POINTS), other) == Failed("ValueError: bad luck")


def test_views_can_be_drawn_some_a_call(plugins):
    views = (View(30.0, 20.0), View(40.0, 20.0), View(50.0, 20.0))
    cloud = PointCloud(POINTS)
    together = draw_in_process(cloud, Drawing("fake-several-views", views))
    one_by_one = draw_in_process(cloud, Drawing("fake-several-views", views, batch=1))
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


@pytest.mark.slow
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


def test_some_of_many_points(tmp_path):
    path = tmp_path / "cloud.npy"
    np.save(path, np.arange(3000.0).reshape(-1, 3))
    some = CloudFile(path, as_is=True, most=100).load().points
    assert len(some) == 100
    assert (np.diff(some[:, 0]) >= 3).all()  # in the file's order, none twice
    assert np.ptp(some[:, 0]) > 2400  # from all over it
    assert np.array_equal(CloudFile(path, as_is=True, most=100).load().points, some)
    for most in (None, 1000, 1001):
        assert len(CloudFile(path, as_is=True, most=most).load()) == 1000
    brought = CloudFile(path, as_is=False, most=100).load().points
    assert np.linalg.norm(brought, axis=1).max() == pytest.approx(1, abs=1e-6)


def sheet_tiles(path, frame=0):
    """Images of a sheet of one row, at their own size."""
    with Image.open(path) as image:
        image.seek(frame)
        pixels = np.asarray(image.convert("RGB"))
    side, top = 256, MARGIN + LABEL_HEIGHT
    lefts = range(MARGIN, pixels.shape[1] - side, side + MARGIN)
    return [pixels[top : top + side : 2, left : left + side : 2] for left in lefts]


def test_a_sheet_shows_the_cloud_and_every_method(command, plugins, cloud, tmp_path):
    """Some may fail, like the items of a run: named, shown, and no error of the command."""
    out = tmp_path / "sheet.png"
    methods = "fake-healthy, splat,splat,fake-segfault,fake-exception"
    status, printed, err = command("render", cloud, "--method", methods, "-o", out)
    assert (status, printed) == (0, f"{out}\n")
    *progress, segfault, exception = err.splitlines()
    assert progress[-1].startswith("drawing: 5/5 done, 2 failed")
    assert segfault == "bench: fake-segfault: crash: the worker died (SIGSEGV)"
    assert exception == "bench: fake-exception: ValueError: 12 of 34 parts are missing"
    dots, healthy, splat, *failed = sheet_tiles(out)
    points = CloudFile(cloud, as_is=False).load()
    view = (View(30.0, 20.0),)
    assert np.array_equal(dots, draw_dots(points.points, view)[0])
    assert healthy[0, :4, 0].tolist() == [30, 20, 3, 10]
    alone = draw_in_process(points, Drawing("splat", view))
    assert not isinstance(alone, Failed)
    assert np.array_equal(splat, alone[0])
    assert [tuple(tile[0, 0]) for tile in failed] == [PROBLEM_GROUND] * 2


def test_a_sheet_has_images_of_the_size_asked_for(command, cloud, tmp_path):
    out = tmp_path / "sheet.png"
    command("render", cloud, "--method", "splat,blank", "--size", "200", "-o", out)
    top = MARGIN + LABEL_HEIGHT
    pixels = np.asarray(Image.open(out))
    assert pixels.shape == (top + 200 + MARGIN, 3 * (200 + MARGIN) + MARGIN, 3)
    tile = pixels[top : top + 200, 200 + 2 * MARGIN :][:, :200]
    drawing = Drawing("splat", (View(30.0, 20.0),), size=200)
    assert np.array_equal(tile, draw_in_process(CloudFile(cloud, as_is=False).load(), drawing)[0])


def test_the_remedy_is_named_where_points_may_be_too_many(cloud):
    whole, some = CloudFile(cloud, as_is=True), CloudFile(cloud, as_is=True, most=9)
    late = Failed("timeout: no result within 120 s")
    assert with_remedy(late, whole) == f"{late.reason}; --points 20000 would take less"
    assert with_remedy(late, some) == late.reason
    assert with_remedy(Failed("draw: blank"), whole) == "draw: blank"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "reason"),
    [
        ("fake-hang", "timeout: no result within 8 s"),
        ("fake-memory-hog", "memory: the worker used more than 1 GiB"),
        ("fake-blank", "draw: 1 of 1 images are blank; 3 points are too few"),
        ("surface-apss", "input: 3 points; normals need at least 11"),
    ],
)
def test_a_method_that_fails_has_a_reason(plugins, cloud, method, reason):
    limits = Limits(8.0 if method == "fake-hang" else 120.0, 1.0)
    drawing = Drawing(method, (View(30.0, 20.0),))
    assert draw_file(CloudFile(cloud, as_is=False), drawing, limits) == Failed(reason)


@pytest.mark.parametrize(
    ("methods", "problem"),
    [
        ("fake-no-licence", "no licence; buy one"),
        ("fake-no-weights", "weights: cut short; fetch them again"),
        ("fake-no-library", "no libGL: install libgl1"),
        ("fake-healthy,fake-no-library", "no libGL: install libgl1"),
    ],
)
def test_what_a_method_lacks_is_the_users_to_fix(refused, plugins, cloud, methods, problem):
    assert refused("render", cloud, "--method", methods, "-o", cloud.parent / "a.png") == problem
    assert [path.name for path in cloud.parent.iterdir()] == ["cloud.ply"]
