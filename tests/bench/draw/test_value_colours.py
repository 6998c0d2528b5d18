"""Points in colours by their height, or by a column of their file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import trimesh
from matplotlib import colormaps
from PIL import Image

import bench
from bench.draw.cloud_file import CloudFile
from data_prep.failures import BadInput
from data_prep.scene import NEUTRAL_GREY

# A square of side 2 that faces the camera, in 41 rows of points; column x, row by row.
X, Y = np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-1, 1, 41))
SQUARE = np.stack([X, Y, 0 * X], axis=-1).reshape(-1, 3)
FRONT = ("--azimuth", "0", "--elevation", "0")


def map_of(shares: np.ndarray) -> np.ndarray:
    return np.asarray(colormaps["viridis"](shares, bytes=True))[..., :3]


def levels(image: np.ndarray) -> np.ndarray:
    """Return the colours of the middle of an image from its lower rows to its upper ones."""
    return image[::-1, 64].astype(int)


@pytest.mark.parametrize("kind", ["cloud", "mesh"])
def test_a_square_has_the_colours_of_the_map_by_its_height(command, tmp_path, kind: str) -> None:
    """Discs have the colour of their points, facets seen head on that of their corners' mean."""
    path, out = tmp_path / ("a.xyz" if kind == "cloud" else "a.obj"), tmp_path / "out.png"
    method = ("--method", "splat") if kind == "cloud" else ()
    if kind == "cloud":
        np.savetxt(path, SQUARE * 50)
    else:
        rows = [f"v {x * 50} {y * 50} {z}" for x, y, z in SQUARE]
        cells = (np.arange(1, 41 * 40)[:, None] + [0, 1, 42, 41])[np.arange(1, 41 * 40) % 41 > 0]
        rows += ["f " + " ".join(map(str, cell)) for cell in cells]
        path.write_text("\n".join(rows))
    status, _, err = command("render", path, *method, *FRONT, "--colour", "height", "-o", out)
    assert status == 0
    assert f"note: {path}: height: -50 to 50, from dark to bright (viridis)\n" in err
    column = levels(np.asarray(Image.open(out)))
    shown = column[(column != 255).any(axis=1)]
    assert len(shown) > 70
    if kind == "cloud":
        rows = map_of(np.arange(41) / 40).tolist()
        order = [rows.index(color) for color in shown.tolist()]
        assert order == sorted(order)
        assert set(order) == set(range(41))
    else:
        expected = map_of(np.linspace(0, 1, len(shown))).astype(int)
        assert np.abs(shown - expected)[1:-1].max() <= 10  # of a row, which changes it by 19


@pytest.mark.filterwarnings("ignore:coordinates are in steps", "ignore:height. -1 to 1")
@pytest.mark.filterwarnings("ignore:label. 0 to 1")
def test_the_same_in_python_with_other_axes_and_one_number_a_point(tmp_path) -> None:
    upright = bench.draw_cloud(SQUARE, 0, 0, method="splat", colour="height")
    lying = np.stack([-SQUARE[:, 0], SQUARE[:, 2], SQUARE[:, 1]], axis=1)
    turned = bench.draw_cloud(lying, 0, 0, method="splat", colour="height", up="z")
    assert np.array_equal(turned, upright)
    with pytest.warns(UserWarning, match="^colors: .* to .*, from dark to bright"):
        numbers = bench.draw_cloud(SQUARE, 0, 0, method="splat", colors=np.arange(len(SQUARE)))
    assert (levels(numbers)[40] != levels(numbers)[80]).any()
    table = pd.DataFrame(SQUARE, columns=list("xyz")).assign(label=SQUARE[:, 1] > 0.01)
    with pytest.raises(BadInput, match="column 'label' holds no real numbers"):
        bench.draw_cloud(table, method="splat", colour="label")
    halves = bench.draw_cloud(table.astype({"label": int}), 0, 0, method="splat", colour="label")
    assert levels(halves)[30].tolist() == map_of(np.array(0.0)).tolist()
    assert levels(halves)[100].tolist() == map_of(np.array(1.0)).tolist()


VALUES = SQUARE[:, 1] * 10  # what each format below holds of the points
FORMATS = ("csv", "npy", "ply", "mesh.ply", "pcd", "las", "e57")


def write(path: Path, kind: str) -> None:
    """Write the square with a column of intensities, in float32 or better."""
    table = np.column_stack([SQUARE, VALUES])
    if kind == "csv":
        np.savetxt(path, table, delimiter=",", header="x,y,z,Scan intensity", comments="")
    elif kind == "npy":
        names = [(name, "<f8") for name in ("x", "y", "z", "scan_intensity")]
        np.save(path, np.array([tuple(row) for row in table], names))
    elif kind in ("ply", "mesh.ply"):
        faces = "3 0 1 41\n" if kind == "ply" else ""
        for i in range(40 * 41 if kind == "mesh.ply" else 0):
            faces += f"4 {i} {i + 1} {i + 42} {i + 41}\n" if i % 41 < 40 else ""
        rows = "".join(" ".join(f"{v:.9g}" for v in row) + "\n" for row in table)
        properties = "".join(f"property double {name}\n" for name in ("x", "y", "z"))
        path.write_text(
            f"ply\nformat ascii 1.0\nelement vertex {len(table)}\n{properties}property double "
            f"scalar_scan_intensity\nelement face {faces.count(chr(10))}\nproperty list uchar int "
            f"vertex_indices\nend_header\n{rows}{faces}"
        )
    elif kind == "pcd":
        rows = "\n".join(" ".join(f"{v:.9g}" for v in row) for row in table)
        path.write_text(
            f"FIELDS x y z scan_intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH "
            f"{len(table)}\nHEIGHT 1\nPOINTS {len(table)}\nDATA ascii\n{rows}\n"
        )
    elif kind == "las":
        laspy = pytest.importorskip("laspy")
        header = laspy.LasHeader(point_format=3, version="1.4")
        header.scales = [1e-6] * 3
        header.add_extra_dim(laspy.ExtraBytesParams("scan_intensity", type=np.float64))
        las = laspy.LasData(header)
        las.x, las.y, las.z = SQUARE.T
        las.scan_intensity = VALUES
        las.write(path)
    else:
        pye57 = pytest.importorskip("pye57")
        fields = dict(zip(("cartesianX", "cartesianY", "cartesianZ"), SQUARE.T, strict=True))
        with pye57.E57(str(path), mode="w") as e57:
            e57.write_scan_raw(fields | {"intensity": VALUES})


@pytest.mark.parametrize("kind", FORMATS)
def test_a_column_is_read_from_every_format(tmp_path, kind: str) -> None:
    path = tmp_path / f"a.{kind.rpartition('.')[2]}"
    write(path, kind)
    name = "Intensity" if kind == "e57" else "scan-INTENSITY"
    loaded = CloudFile(path, as_is=False, colours=name).load_all()
    height = loaded.cloud.points[:, 1].astype(float) * 2**0.5 * 10
    low, high = np.quantile(height, (0.01, 0.99))
    expected = map_of(np.clip((height - low) / (high - low), 0, 1)).astype(int)
    assert loaded.cloud.colors is not None
    assert np.abs(loaded.cloud.colors.astype(int) - expected).max() <= 9
    assert any(f"{name}: " in note and "(viridis)" in note for note in loaded.notes)
    assert not any("not used; only" in note and "faces" not in note for note in loaded.notes)


def test_stray_values_are_cut_labels_are_not_and_missing_ones_are_grey(tmp_path) -> None:
    path, rows = tmp_path / "a.csv", np.arange(1000.0)
    values = np.where(rows == 999, 1e9, rows)
    labels = np.where(rows < 995, rows % 3, 9)
    path.write_text("x,y,z,intensity,class,part\n")
    with path.open("a") as file:
        for row, value, label in zip(rows, values, labels, strict=True):
            part = "" if row < 10 else f"{row:g}"
            file.write(f"{np.cos(row)},{np.sin(row)},{row % 7},{value:g},{label:g},{part}\n")

    def drawn(column: str) -> tuple[np.ndarray, str]:
        loaded = CloudFile(path, as_is=False, colours=column).load_all()
        (note,) = (note for note in loaded.notes if note.startswith(f"{path}: {column}: "))
        return np.asarray(loaded.cloud.colors), note.removeprefix(f"{path}: ")

    colors, note = drawn("intensity")
    assert note == (
        "intensity: 9.99 to 989.01, from dark to bright (viridis); 20 of 1000 values beyond have "
        "the colours of the ends"
    )
    assert (colors[[0, 9, 990, 999]] == map_of(np.array([0.0, 0, 1, 1]))).all()
    colors, note = drawn("class")
    assert note == "class: 0 to 9, from dark to bright (viridis)"
    assert (colors[[0, 1, 999]] == map_of(np.array([0, 1 / 9, 1]))).all()
    colors, note = drawn("part")
    assert (colors[:10] == NEUTRAL_GREY).all()
    assert (colors[10:20] != NEUTRAL_GREY).any(axis=1).all()


REFUSED = {  # the colour, and what is said of it
    "gray": "no column 'gray'; give one of 'height, x, y, z, grey, same, none, word', or auto, "
    "file, grey or invented",
    "same": "all values of 'same' are 5; give one of 'height, x, y, z, grey, same, none, word', or "
    "auto, file, grey or invented",
    "none": "no value of 'none' is a number; give one of 'height, x, y, z, grey, same, none, word'"
    ", or auto, file, grey or invented",
    "word": "line 2: 'oak' is not a number; correct or remove the line",
}


@pytest.mark.parametrize("colour", REFUSED)
def test_columns_that_cannot_be_drawn(refused, tmp_path, colour: str) -> None:
    path, out = tmp_path / "a.csv", tmp_path / "out.png"
    path.write_text("x,y,z,grey,same,none,word\n0,0,0,1,5,nan,oak\n1,2,3,2,5,nan,elm\n")
    said = refused("render", path, "--method", "splat", "--colour", colour, "-o", out)
    assert said == f"{path}: {REFUSED[colour]}"
    assert not out.exists()


def test_a_column_with_the_name_of_a_word_is_named_in_capitals(command, refused, tmp_path) -> None:
    path, out = tmp_path / "a.csv", tmp_path / "out.png"
    path.write_text("x,y,z,grey\n0,0,0,1\n1,2,3,2\n4,1,2,7\n")
    status, _, err = command("render", path, "--method", "splat", "--colour", "GREY", "-o", out)
    assert status == 0
    assert f"note: {path}: GREY: 1 to 7, from dark to bright (viridis)\n" in err
    trimesh.creation.box().export(tmp_path / "a.glb")
    said = refused("render", tmp_path / "a.glb", "--colour", "quality", "-o", out)
    problem = "no column 'quality'; give one of 'height', or auto, file, grey or invented"
    assert said == f"{tmp_path / 'a.glb'}: {problem}"
