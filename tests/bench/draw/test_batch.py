from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from bench.draw.cloud import Dots, Drawing, draw_each, draw_file
from bench.draw.cloud_file import CloudFile, LoadedCloud
from bench.draw.files import images_of_clouds
from data_prep.failures import BadInput
from data_prep.files.clouds import save_ply
from data_prep.scene import View

POINTS = np.array([[0, 0, 0], [4, 0, 0], [0, 0.2, 0]], np.float32)  # flat: low for a method below


@pytest.fixture
def clouds(tmp_path):
    """A folder of two clouds of 3 and 4 points, one of them in a sub-folder."""
    folder = tmp_path / "clouds"
    save_ply(POINTS, folder / "a.ply")
    (folder / "more").mkdir()
    np.save(folder / "more" / "a.npy", np.eye(4, 3) * [1, 0.1, 1])
    (folder / "notes.md").write_text("not a cloud")
    return folder


LEFT_OUT = "left out, no clouds or meshes by their names or contents"


def points_told(path):
    """Return the number of points, as `fake-healthy` draws it."""
    with Image.open(path) as image:
        return np.asarray(image)[0, 2, 0]


def test_an_image_of_each_cloud_of_a_folder_and_of_further_files(
    command, plugins, clouds, tmp_path
):
    further, out = tmp_path / "b.xyz", tmp_path / "images"
    further.write_text("0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\n")
    done = command(
        "render", clouds, clouds / "more", further, further, "--method", "fake-healthy", "-o", out
    )
    images = [out / "a.png", out / "more" / "a.png", out / "b.png"]
    assert done[:2] == (0, "".join(f"{image}\n" for image in images))
    assert [points_told(image) for image in images] == [3, 4, 5]
    assert sorted(p for p in out.rglob("*") if p.is_file()) == sorted(images)
    *_, progress, left_out = done[2].splitlines()
    assert progress.startswith("drawing: 3/3 done, 0 failed")
    assert left_out == f"note: {clouds}: {LEFT_OUT}: notes.md"
    assert command("render", further, clouds, "--method", "fake-healthy", "-o", out)[0] == 0


def test_clouds_that_fail_are_listed_and_the_others_drawn(command, plugins, clouds, tmp_path):
    whole = (clouds / "a.ply").read_bytes()
    (clouds / "cut.ply").write_bytes(whole[:-1])
    (clouds / "empty.xyz").touch()
    (clouds / "high.xyz").write_text("0 0 0\n1 0 0\n0 1 0\n0 -1 0\n")
    (clouds / "z.npy").symlink_to("nowhere.npy")  # not a file: not among the clouds
    out = tmp_path / "images"
    status, printed, err = command(
        *("render", clouds, "--method", "fake-crash-where-high", "-o", out)
    )
    assert (status, printed) == (1, f"{out}/a.png\n{out}/more/a.png\n")
    *progress, left_out, cut, empty, high, summary = err.splitlines()
    assert left_out == f"note: {clouds}: {LEFT_OUT}: notes.md, z.npy"
    assert progress[-1].startswith("drawing: 5/5 done, 3 failed")
    assert cut.startswith(f"bench: {clouds}/cut.ply: 3 rows of 'vertex' in the header, and 35 ")
    assert empty == f"bench: {clouds}/empty.xyz: an empty file; fetch or write it again"
    assert high == (
        f"bench: {clouds}/high.xyz: fake-crash-where-high: crash: the worker died (SIGSEGV)"
    )
    assert summary == "bench: 3 of 5 clouds have no image"
    assert {p.name for p in out.rglob("*")} == {"a.png", "more"}


def test_a_note_that_files_share_is_one_line(command, plugins, tmp_path):
    for name, columns in (("a.xyz", 6), ("b.xyz", 6), ("c.xyz", 4)):
        np.savetxt(tmp_path / name, np.random.default_rng(0).random((5, columns)))
    _, _, err = command("render", tmp_path, "--method", "fake-healthy", "-o", tmp_path / "out")
    notes = [line for line in err.splitlines() if line.startswith("note: ")]
    guess = "(x, y and z are the first 3, as no first line names them)"
    rest = f"{guess} are not used; only the coordinates of its points are"
    assert notes == [
        f"note: {tmp_path}/a.xyz and 1 more: 3 of its 6 columns {guess}; its colours are a guess, "
        "too, which --colour grey leaves out",
        f"note: {tmp_path}/a.xyz and 1 more: fake-healthy: draws in colours of its own; those of "
        "the points are not used",
        f"note: {tmp_path}/c.xyz: 1 of its 4 columns {rest}",
    ]


def test_a_worker_loads_a_method_once(plugins, clouds):
    files = [CloudFile(path, as_is=False) for path in images_of_clouds([clouds], clouds)[0]]
    drawing = Drawing("fake-counted", (View(0.0, 0.0),))
    results = list(draw_each(files, [drawing], workers=1))
    assert [file for file, *_ in results] == files
    for _, _, images, _ in results:
        assert isinstance(images, np.ndarray)
        assert images[0, 0, 0].tolist() == [1, 1, 1]


class _Told(CloudFile):
    """A file that writes a line beside itself whenever it is read."""

    def load_all(self) -> LoadedCloud:
        with self.path.with_suffix(".read").open("a") as lines:
            lines.write("read\n")
        return super().load_all()


def test_each_file_of_sheets_is_read_once_and_drawn_as_alone(plugins, clouds):
    """A file that is no cloud, one of three, is told for each request."""
    (clouds / "cut.ply").write_bytes((clouds / "a.ply").read_bytes()[:-1])
    paths = [clouds / "a.ply", clouds / "cut.ply", clouds / "more" / "a.npy"]
    views = (View(30.0, 20.0),)
    requests = [Dots(views), Drawing("splat", views), Drawing("fake-healthy", views)]
    files = [_Told(path, as_is=False) for path in paths]
    for workers in (1, 3):
        drawn = {}
        for file, request, images, _ in draw_each(files, requests, workers):
            drawn[file.path, request] = images
        assert len(drawn) == 9
        for path in paths:
            assert path.with_suffix(".read").read_text() == "read\n"
            path.with_suffix(".read").unlink()
        for request in requests:
            assert "3 rows of 'vertex'" in str(drawn[paths[1], request])
    for path in (paths[0], paths[2]):
        for request in requests[1:]:
            assert np.array_equal(drawn[path, request], draw_file(CloudFile(path, False), request))


def test_two_clouds_of_a_folder_with_one_name(clouds, tmp_path):
    save_ply(POINTS, clouds / "more" / "a.ply")
    with pytest.raises(BadInput, match=r"more/a\.npy and .*more/a\.ply would both be drawn as "):
        images_of_clouds([clouds], tmp_path)
