from __future__ import annotations

import builtins
from pathlib import Path

import numpy as np
import pytest

from data_prep.clouds.sampling import random_rows
from data_prep.failures import BadInput, MissingDependency
from data_prep.files.cloud_contents import COLOURS
from data_prep.files.clouds import ScanLimits, load_points, read_cloud, read_scan
from data_prep.scene import NEUTRAL_GREY
from tests.data_prep.files.pcd_files import pcd

laspy = pytest.importorskip("laspy", reason="the extra 'clouds' is not installed")
pye57 = pytest.importorskip("pye57", reason="the extra 'clouds' is not installed")
pytest.importorskip("lzf", reason="the extra 'clouds' is not installed")

POINTS = np.random.default_rng(0).integers(-4000, 4000, (1000, 3)) / 8.0  # exact in every format


def write_las(path: Path, points: np.ndarray = POINTS) -> None:
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales = np.array([0.125] * 3)
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.write(str(path))


def write_e57(path: Path, *scans: np.ndarray, **pose) -> None:
    file = pye57.E57(str(path), mode="w")
    for points in scans:
        axes = zip(("cartesianX", "cartesianY", "cartesianZ"), points.T, strict=True)
        file.write_scan_raw({name: np.ascontiguousarray(v) for name, v in axes}, **pose)
    file.close()


CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")


def add_scan(
    file: pye57.E57,
    points: np.ndarray,
    colours: np.ndarray,
    most: float,
    limit: float | None,
    axes: tuple[str, ...] = CARTESIAN,
) -> None:
    """Add a scan with colours, or coordinates, of another type than pye57 writes.

    most   the largest value that is stored; a fraction for floats
    limit  the largest value that the scan states; None for none
    """
    lib, image = pye57.libe57, file.image_file
    scan, prototype = lib.StructureNode(image), lib.StructureNode(image)
    scan.set("guid", lib.StringNode(image, "{1}"))
    columns = dict(zip(axes, points.T, strict=True))
    for name in axes:
        prototype.set(name, lib.FloatNode(image, 0.0))
    limits = lib.StructureNode(image)
    for name, column in zip(("colorRed", "colorGreen", "colorBlue"), colours.T, strict=True):
        columns[name] = column
        is_whole = colours.dtype.kind in "iu"
        node = lib.IntegerNode(image, 0, 0, most) if is_whole else lib.FloatNode(image, 0.0)
        prototype.set(name, node)
        if limit is not None:
            limits.set(f"{name}Minimum", lib.FloatNode(image, 0.0))
            limits.set(f"{name}Maximum", lib.FloatNode(image, limit))
    if limit is not None:
        scan.set("colorLimits", limits)
    vector = lib.CompressedVectorNode(image, prototype, lib.VectorNode(image, True))
    scan.set("points", vector)
    file.data3d.append(scan)
    buffers, arrays = lib.VectorSourceDestBuffer(), []
    for name, column in columns.items():
        arrays.append(np.array(column, np.float64))
        buffers.append(lib.SourceDestBuffer(image, name, arrays[-1], len(column), True, True))
    writer = vector.writer(buffers)
    writer.write(len(points))
    writer.close()


def write_pcd(path: Path, points: np.ndarray = POINTS, encoding: str = "binary") -> None:
    x, y, z = points.astype("<f4").T
    path.write_bytes(pcd({"x": x, "y": y, "z": z}, encoding))


def test_las_and_large_ones_thinned_out(tmp_path: Path) -> None:
    for name in ("a.las", "a.laz", "a.LAS"):
        write_las(tmp_path / name)
        found = load_points(tmp_path / name)
        assert found.dtype == np.float64
        assert np.array_equal(found, POINTS)
    for most, piece in ((1, 64), (333, 63), (999, 64), (100, 1000)):
        thinned = read_scan(tmp_path / "a.las", ScanLimits(kept=most, piece=piece)).points
        assert np.array_equal(thinned, POINTS[random_rows(1000, most)])


def test_e57(tmp_path: Path) -> None:
    write_e57(tmp_path / "a.e57", POINTS[:600], POINTS[600:])
    assert np.array_equal(load_points(tmp_path / "a.e57"), POINTS)


@pytest.mark.parametrize("name", ["a.las", "a.e57", "a.pcd"])
def test_of_a_large_scan_exactly_so_many_points_are_read_and_a_note_says_so(
    tmp_path: Path, name: str
) -> None:
    """Its 64 lasers, each with a height of its own, come by turns: a step of 2 would lose 32."""
    lasers = np.arange(64_000) % 64
    points = np.stack([np.arange(64_000) // 64, lasers * 0, lasers], axis=1) / 8.0
    {"a.las": write_las, "a.e57": write_e57, "a.pcd": write_pcd}[name](tmp_path / name, points)
    assert read_scan(tmp_path / name, ScanLimits(kept=64_000)).notes == ()
    contents = read_scan(tmp_path / name, ScanLimits(kept=63_999))
    assert len(contents.points) == 63_999
    thinned = read_scan(tmp_path / name, ScanLimits(kept=32_000))
    assert thinned.notes == ("a scan of 64000 points: 32000 of them, chosen at random, are read",)
    assert np.array_equal(
        thinned.points, read_scan(tmp_path / name, ScanLimits(kept=32_000)).points
    )
    of_lasers = np.unique(thinned.points[:, 2], return_counts=True)[1]
    # Of a laser's 1,000 points 500 are expected, with a deviation below sqrt(1000 / 4) = 15.8; one
    # of 64 is 4.8 deviations off once in ten thousand times.
    assert len(of_lasers) == 64
    assert np.abs(of_lasers - 500).max() < 4.8 * 15.8


def test_scans_of_an_e57_stand_where_their_pose_puts_them(tmp_path: Path) -> None:
    quarter = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])  # about z: x becomes y
    write_e57(tmp_path / "a.e57", POINTS, rotation=quarter, translation=np.array([10.0, 0, 0]))
    x, y, z = POINTS.T
    expected = np.stack([10 - y, x, z], axis=1)
    # The quaternion's sine and cosine are off by a rounding error each, of coordinates below 500.
    np.testing.assert_allclose(load_points(tmp_path / "a.e57"), expected, atol=500 * 2.0**-50)


def test_pcd_and_places_without_a_return(tmp_path: Path) -> None:
    for encoding in ("ascii", "binary", "binary_compressed"):
        write_pcd(tmp_path / "a.pcd", encoding=encoding)
        assert np.array_equal(load_points(tmp_path / "a.pcd"), POINTS)
    points = POINTS.copy()
    points[::2] = np.nan
    points[1, 0] = np.nan
    write_pcd(tmp_path / "a.pcd", points)
    valid = load_points(tmp_path / "a.pcd")
    assert np.array_equal(valid, points[3::2])
    thinned = read_scan(tmp_path / "a.pcd", ScanLimits(kept=250)).points
    assert np.array_equal(thinned, valid[random_rows(499, 250)])


@pytest.mark.parametrize("suffix", [".las", ".laz", ".e57", ".pcd"])
@pytest.mark.parametrize(
    "content", [b"nonsense", b"LASF" + b"\xff" * 400], ids=["nonsense", "of-a-las"]
)
def test_files_that_cannot_be_read(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    is_las = content.startswith(b"LASF") and suffix not in (".las", ".laz")
    problem = f"not a readable {suffix[1:].upper()} file"
    if is_las:
        problem = "a LAS by its contents"
    elif suffix == ".pcd":
        problem = "no PCD header"
    with pytest.raises(BadInput, match=rf"a\{suffix}: {problem}"):
        load_points(path)
    with pytest.raises(BadInput, match="no such file"):
        load_points(tmp_path / f"gone{suffix}")


def test_files_cut_short_and_claims_are_not_believed(tmp_path: Path) -> None:
    write_las(tmp_path / "a.las")
    write_pcd(tmp_path / "a.pcd")
    write_e57(tmp_path / "a.e57", POINTS)
    for name in ("a.pcd", "a.e57"):
        with pytest.raises(BadInput, match="1000 points, at most 999 are read; thin it out"):
            read_scan(tmp_path / name, ScanLimits(claimed=999))
    with pytest.raises(BadInput, match="1000 points, at most 999 are read; thin it out"):
        read_scan(tmp_path / "a.las", ScanLimits(claimed_in_pieces=999))
    for path in tmp_path.iterdir():
        path.write_bytes(path.read_bytes()[:-3000])
        with pytest.raises(BadInput, match=path.name.replace(".", r"\.")):
            load_points(path)


@pytest.mark.parametrize(
    ("suffix", "package"), [(".laz", "laspy"), (".e57", "pye57"), (".pcd", "lzf")]
)
def test_a_missing_extra_is_named(tmp_path: Path, monkeypatch, suffix: str, package: str) -> None:
    write_pcd(tmp_path / "a.pcd", encoding="binary_compressed")
    if suffix != ".pcd":
        (tmp_path / f"a{suffix}").write_bytes(b"nonsense")
    real = builtins.__import__

    def without(name: str, *args, **kwargs):
        if name.split(".")[0] == package:
            raise ModuleNotFoundError(f"No module named '{package}'", name=package)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(
        MissingDependency, match=rf"needs {package}; .*pip install 'pc2pix-bench\[clouds\]'"
    ):
        load_points(tmp_path / f"a{suffix}")


def test_pts(tmp_path: Path) -> None:
    path = tmp_path / "a.pts"
    path.write_text("2\n1 2 3 -700 10 20 30\n4 5 6 0 1 2 3\r\n1\r\n7.5 8 9 0 0 0 0\n")
    assert load_points(path).tolist() == [[1, 2, 3], [4, 5, 6], [7.5, 8, 9]]
    path.write_text("0.1 0.2 0.3\n0.4 0.5 0.6\n")  # without a count, as others write it
    assert load_points(path).tolist() == [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]
    path.write_text("2\n1 2\n")
    with pytest.raises(BadInput, match="line 2 has 2 columns"):
        load_points(path)


def test_colours(tmp_path: Path) -> None:
    """Read colours of 16 bits in LAS, of 8 in the others, thinned as their points are."""
    colours = np.random.default_rng(1).integers(0, 256, (len(POINTS), 3))
    colours[0] = 255
    write_las(tmp_path / "a.las")
    las = laspy.read(tmp_path / "a.las")
    las.red, las.green, las.blue = 257 * colours.T
    las.write(str(tmp_path / "a.las"))
    packed = colours.astype("<u4") @ np.array([1 << 16, 1 << 8, 1], "<u4")
    x, y, z = POINTS.astype("<f4").T
    (tmp_path / "a.pcd").write_bytes(pcd({"x": x, "y": y, "z": z, "rgb": packed.view("<f4")}))
    file = pye57.E57(str(tmp_path / "a.e57"), mode="w")
    names = ("cartesianX", "cartesianY", "cartesianZ", "colorRed", "colorGreen", "colorBlue")
    columns = (*POINTS.T, *colours.T.astype(np.uint8))
    file.write_scan_raw({n: np.ascontiguousarray(c) for n, c in zip(names, columns, strict=True)})
    file.close()
    for name in ("a.las", "a.pcd", "a.e57"):
        without = read_cloud(tmp_path / name)
        assert (without.unused, without.has_colors, without.colors) == ((COLOURS,), True, None)
        assert np.array_equal(without.points, POINTS)
        thinned = read_scan(tmp_path / name, ScanLimits(kept=250), with_colors=True)
        rows = random_rows(len(POINTS), 250)
        assert np.array_equal(thinned.points, POINTS[rows])
        assert np.array_equal(thinned.colors, colours[rows])


BYTES = np.array([[255, 0, 128], [1, 1, 0], [7, 8, 9]])
RAMP = np.array([[0, 0.5, 1], [0.2, 0, 0], [0.4, 0.6, 0.8]])


@pytest.mark.parametrize(
    ("colours", "most", "limit", "expected"),
    [
        (BYTES, 255, 255.0, BYTES),
        (BYTES, 255, None, BYTES),
        (257 * BYTES, 65535, 65535.0, BYTES),
        (257 * BYTES, 65535, None, BYTES),
        (257 * BYTES, 65535, 1023.0, BYTES),
        (BYTES, 65535, 65535.0, np.array([[1, 0, 0], [0, 0, 0], [0, 0, 0]])),
        (BYTES, 65535, 255.0, BYTES),
        (BYTES, 255, 65535.0, BYTES),
        (np.array([[1023, 0, 512]] * 3), 1023, 1023.0, np.array([[255, 0, 128]] * 3)),
        (RAMP, 1.0, 1.0, np.array([[0, 128, 255], [51, 0, 0], [102, 153, 204]])),
        (RAMP, 1.0, None, np.array([[0, 128, 255], [51, 0, 0], [102, 153, 204]])),
    ],
    ids=[
        "bytes", "bytes-unstated", "16-bits", "16-bits-unstated", "16-bits-misstated", "dark",
        "bytes-in-words", "words-misstated", "10-bits", "fractions", "fractions-unstated",
    ],
)  # fmt: skip
def test_colours_of_an_e57_of_any_range(
    tmp_path: Path, colours: np.ndarray, most: float, limit: float | None, expected: np.ndarray
) -> None:
    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        add_scan(file, POINTS[:3], colours, most, limit)
    contents = read_cloud(tmp_path / "a.e57", with_colors=True)
    assert np.array_equal(contents.points, POINTS[:3])
    assert np.array_equal(contents.colors, expected)
    assert contents.notes == ()


def test_scans_of_an_e57_whose_colours_differ(tmp_path: Path) -> None:
    """Each is read by its own range; one without colours is grey, and a note says so."""
    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        add_scan(file, POINTS[:3], 257 * BYTES, 65535, None)
        x, y, z = np.ascontiguousarray(POINTS[3:5].T)
        file.write_scan_raw({"cartesianX": x, "cartesianY": y, "cartesianZ": z})
        add_scan(file, POINTS[5:8], BYTES, 255, 255.0)
    contents = read_cloud(tmp_path / "a.e57", with_colors=True)
    assert np.array_equal(contents.points, POINTS[:8])
    assert np.array_equal(contents.colors, [*BYTES, *[NEUTRAL_GREY] * 2, *BYTES])
    assert contents.notes == ("1 of 3 scans have no colours, and are grey",)
    assert read_cloud(tmp_path / "a.e57").notes == ()


def test_spherical_coordinates_of_an_e57(tmp_path: Path) -> None:
    """A range, an azimuth from +X and an elevation above the plane of x and y."""
    spherical = np.array([[2.0, 0.0, 0.0], [2.0, np.pi / 2, 0.0], [2.0, 1.0, np.pi / 2]])
    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        add_scan(file, spherical, BYTES, 255, 255.0, SPHERICAL)
    contents = read_cloud(tmp_path / "a.e57", with_colors=True)
    # Sine and cosine of pi / 2 are off by less than 2^-53 each, and lengths are 2.
    np.testing.assert_allclose(contents.points, 2 * np.eye(3), atol=2**-51)
    assert np.array_equal(contents.colors, BYTES)


def test_points_of_an_e57_that_are_marked_as_invalid(tmp_path: Path) -> None:
    x, y, z = np.ascontiguousarray(POINTS[:4].T)
    columns = {"cartesianX": x, "cartesianY": y, "cartesianZ": z}
    columns["cartesianInvalidState"] = np.array([0, 2, 0, 1], np.int8)
    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        file.write_scan_raw(columns)
    assert np.array_equal(load_points(tmp_path / "a.e57"), POINTS[[0, 2]])


def test_a_scan_without_colours(tmp_path: Path) -> None:
    for write, name in ((write_e57, "a.e57"), (write_pcd, "a.pcd")):
        write(tmp_path / name, POINTS)
        contents = read_cloud(tmp_path / name, with_colors=True)
        assert (contents.unused, contents.has_colors, contents.colors) == ((), False, None)
