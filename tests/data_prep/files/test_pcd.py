from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from data_prep.failures import BadInput
from data_prep.files.clouds import ScanLimits, load_points, read_cloud, read_scan
from tests.data_prep.files.pcd_files import pcd

pytest.importorskip("lzf", reason="the extra 'clouds' is not installed")

POINTS = np.array([[0.5, -1.25, 3.0], [8.0, 0.0, -2.0], [7.0, 8.0, 9.0], [0.25, 4.0, 2.5]])
X, Y, Z = POINTS.astype("<f4").T
XYZ = {"x": X, "y": Y, "z": Z}
WHOLE = np.arange(12, dtype="<i8").reshape(4, 3)
ENCODINGS = ("ascii", "binary", "binary_compressed")
LONG = {name: np.tile(column, 50) for name, column in XYZ.items()}  # enough to be packed


def header(**lines: str) -> bytes:
    """Return a file of ascii whose header has other lines; one without a text is left out."""
    return pcd(XYZ, "ascii", lines)


READ = {
    "as-pcl-writes-it": header(),
    "version-5-of-columns": pcd(XYZ, "ascii", {"VERSION": ".5", "FIELDS": "", "COLUMNS": ""})
    .replace(b"VERSION .5\n", b"VERSION .5\nCOLUMNS x y z\n"),
    "version-6": header(VERSION="0.6", VIEWPOINT=""),
    "version-7": header(VERSION="7"),
    "no-version": header(VERSION=""),
    "no-count": header(COUNT=""),
    "no-points": header(POINTS="", WIDTH="2", HEIGHT="2"),
    "no-width": header(WIDTH="", HEIGHT=""),
    "no-height": header(HEIGHT=""),
    "no-sizes-and-types": header(SIZE="", TYPE="", COUNT=""),
    "width-0": header(WIDTH="0", HEIGHT="0"),
    "tabs": header().replace(b" ", b"\t"),
    "double-spaces": header().replace(b" ", b"  ").replace(b"\n", b" \r\n"),
    "blank-lines": header().replace(b"\n", b"\n\n"),
    "small-letters": header().replace(b"FIELDS", b"fields").replace(b"DATA", b"Data"),
    "small-types": header(TYPE="f f f", DATA="ASCII"),
    "capital-names": header(FIELDS="X Y Z"),
    "named-otherwise": header(FIELDS="easting northing height"),
    "comments-between": header().replace(b"SIZE", b"# of a leg\nSIZE"),
    "unknown-line": header().replace(b"SIZE", b"FRAME_ID map\nSIZE"),
    "no-end-of-line": header()[:-1],
    "a-name-twice": pcd({"i": X, "i'": Y, **XYZ}, "ascii"),
    "padding-in-ascii": pcd({"_": Y, **XYZ, "_'": np.zeros((4, 2), "<u1")}, "ascii"),
    "padding": pcd({"_": np.zeros((4, 3), "<u1"), **XYZ, "_'": np.zeros(4, "<u8")}),
    "padding-behind": pcd(XYZ) + bytes(4096),
    "counts": pcd({"fpfh": np.zeros((4, 33), "<f4"), **XYZ, "n": np.zeros((4, 2), "<i2")}),
    "counts-in-ascii": pcd({"fpfh": np.zeros((4, 3), "<f4"), **XYZ}, "ascii"),
    "stored-raw": pcd(XYZ, "binary_compressed", packed=False),
    "of-an-order": pcd({"z": Z, "i": X, "y": Y, "x": X}),
}  # fmt: skip


@pytest.mark.parametrize("name", READ)
def test_what_pcl_reads_is_read(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.pcd").write_bytes(READ[name])
    contents = read_cloud(tmp_path / "a.pcd", with_colors=True)
    assert contents.points.tolist() == POINTS.tolist()
    assert (contents.has_colors, contents.colors, contents.unused) == (False, None, ())
    assert contents.notes == ()


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("kind", ["<f4", "<f8", "<i1", "<i2", "<i4", "<i8", "<u1", "<u2", "<u4"])
def test_every_type(tmp_path: Path, kind: str, encoding: str) -> None:
    table = np.tile(WHOLE, (50, 1))
    columns = {axis: table[:, i].astype(kind) for i, axis in enumerate("xyz")}
    # A field between the others has another type and three numbers.
    columns = {"x": columns["x"], "n": np.zeros((200, 3), "<i2"), **columns}
    (tmp_path / "a.pcd").write_bytes(pcd(columns, encoding))
    assert load_points(tmp_path / "a.pcd").tolist() == table.tolist()


def test_a_block_without_the_padding_that_its_header_has(tmp_path: Path) -> None:
    with_padding = pcd({"x": X, "_": X, "y": Y, "z": Z}, "binary_compressed", packed=False)
    head = with_padding[: with_padding.index(b"compressed\n") + 11]
    block = np.concatenate([X, Y, Z]).tobytes()
    (tmp_path / "a.pcd").write_bytes(head + struct.pack("<II", 48, 48) + block)
    assert load_points(tmp_path / "a.pcd").tolist() == POINTS.tolist()


def test_places_without_a_return_are_left_out_and_marks_in_words_read(tmp_path: Path) -> None:
    rows = b"1 2 3\nnan nan nan\n4 5 -nan(ind)\n1.#QNAN 1.#QNAN 1.#QNAN\n"
    (tmp_path / "a.pcd").write_bytes(
        header()[: -len(pcd(XYZ, "ascii").split(b"ascii\n")[1])] + rows
    )
    contents = read_cloud(tmp_path / "a.pcd")
    assert contents.points.tolist() == [[1, 2, 3]]
    assert contents.notes == ("1 points without one of their coordinates are left out",)


def test_of_a_coordinate_twice_the_first_is_read_with_a_note(tmp_path: Path) -> None:
    (tmp_path / "a.pcd").write_bytes(pcd({**XYZ, "x'": Y}, "ascii"))
    contents = read_cloud(tmp_path / "a.pcd")
    assert contents.points.tolist() == POINTS.tolist()
    assert contents.notes == ("2 fields x: the first of them is read",)


COLOURS = np.array([[255, 0, 128], [1, 2, 3], [90, 80, 70], [0, 0, 0]], "<u1")
R, G, B = COLOURS.T
PACKED = (R.astype("<u4") << 16) | (G.astype("<u4") << 8) | B
COLOURED = {
    "packed-float": {"rgb": PACKED.view("<f4")},
    "packed": {"rgb": PACKED},
    "packed-signed": {"RGB": PACKED.view("<i4")},
    "opaque": {"rgba": PACKED | np.uint32(255 << 24)},
    "bytes-of-a-field": {"rgb": COLOURS},
    "bytes": {"r": R, "g": G, "b": B},
    "words": {"blue": B.astype("<u2"), "green": G.astype("<u2"), "red": R.astype("<u2")},
    "floats": {"r": R.astype("<f4"), "g": G.astype("<f4"), "b": B.astype("<f4")},
    "16-bits": {
        name: column.astype("<u2") * 257 for name, column in zip("rgb", COLOURS.T, strict=True)
    },
}


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
@pytest.mark.parametrize("name", COLOURED)
def test_colours(tmp_path: Path, name: str, encoding: str) -> None:
    (tmp_path / "a.pcd").write_bytes(pcd(XYZ | COLOURED[name], encoding))
    without = read_cloud(tmp_path / "a.pcd")
    assert (without.has_colors, without.colors, without.unused) == (True, None, ("its colours",))
    contents = read_cloud(tmp_path / "a.pcd", with_colors=True)
    assert contents.points.tolist() == POINTS.tolist()
    assert contents.colors is not None
    assert contents.colors.tolist() == COLOURS.tolist()


def test_colours_in_a_text(tmp_path: Path) -> None:
    """PCL's own example has the packed number where the type says that its bits are a float."""
    columns = {"x": X[:2], "y": Y[:2], "z": Z[:2], "rgb": np.array([4210752, 8421504], "<f4")}
    (tmp_path / "a.pcd").write_bytes(pcd(columns, "ascii"))
    contents = read_cloud(tmp_path / "a.pcd", with_colors=True)
    assert contents.colors is not None
    assert contents.colors.tolist() == [[64, 64, 64], [128, 128, 128]]
    columns["rgb"] = np.array([1e-38, np.nan], "<f4")
    (tmp_path / "a.pcd").write_bytes(pcd(columns, "ascii"))
    assert read_cloud(tmp_path / "a.pcd").has_colors
    with pytest.raises(BadInput, match="its colours have values below 0 or not finite"):
        read_cloud(tmp_path / "a.pcd", with_colors=True)


def cut(data: bytes, most: int) -> bytes:
    return data[:-most]


def packed_as(packed: int, block: int) -> bytes:
    """Return a compressed file that says other sizes of its block."""
    data = pcd(LONG, "binary_compressed")
    at = data.index(b"compressed\n") + 11
    sizes = struct.unpack_from("<II", data, at)
    return data[:at] + struct.pack("<II", packed or sizes[0], block or sizes[1]) + data[at + 8 :]


BROKEN = {
    "nothing-of-it": (b"nonsense", r"no PCD header \(FIELDS ... DATA\); use a PCD file"),
    "no-fields": (header(FIELDS=""), "no PCD header"),
    "no-data": (header(DATA=""), "no PCD header"),
    "encoding": (header(DATA="zipped"), "DATA 'zipped', and PCD has ascii, binary, binary_compr"),
    "axes": (header(FIELDS="x y w"), "no fields x, y and z among 'x y w'; name those of the coord"),
    "sizes": (header(SIZE="4 4"), "FIELDS has 3 names, SIZE 2 values; correct the header"),
    "types": (header(TYPE="F F F F"), "FIELDS has 3 names, TYPE 4 values; correct the header"),
    "counts": (header(COUNT="1"), "FIELDS has 3 names, COUNT 1 values; correct the header"),
    "type": (header(TYPE="F D F"), "TYPE 'D' and SIZE '4' of the field 'y': there are F of 4 and"),
    "size": (header(SIZE="4 4 3"), "TYPE 'F' and SIZE '3' of the field 'z'"),
    "count-0": (header(COUNT="1 0 1"), "COUNT 0 of the field 'y'; remove the field, or correct it"),
    "count": (header(COUNT="1 -1 1"), "COUNT '-1' is no whole number of at least 0; correct it"),
    "negative": (header(POINTS="-4"), "POINTS '-4' is no whole number of at least 0; correct it"),
    "no-number": (header(WIDTH="four"), "WIDTH 'four' is no whole number"),
    "no-size": (header(POINTS="", WIDTH=""), "neither POINTS nor WIDTH in the header; add the num"),
    "grid": (header(WIDTH="3"), "WIDTH 3 x HEIGHT 1 are 3 points, and POINTS says 4; correct the"),
    "huge": (header(POINTS="9" * 18, WIDTH=""), f"{'9' * 18} points, at most 67108864 are read"),
    "huger": (header(POINTS="9" * 19), f"POINTS '{'9' * 19}' is no whole number"),
    "wide": (pcd(XYZ, header={"COUNT": f"1 1 {'9' * 17}"}), "4 points .* need 16.* bytes, and 48"),
    "claimed": (pcd(XYZ, header={"POINTS": "9999999", "WIDTH": ""}), ".* 119999988 bytes, and 48"),
    "cut-ascii": (cut(header(), 14), "4 points in the header need 4 rows, and 3 follow; "),
    "more-ascii": (header() + b"1 2 3\n", "5 rows behind the header, which has 4 points"),
    "column": (header() + b"\n1 2\n", "line 17 has 2 columns, and the header has 3; write"),
    "word": (header().replace(b"7.0 8.0", b"7.0 x"), "line 14: 'x' is not a number; correct"),
    "cut": (cut(pcd(XYZ), 1), "4 points in the header need 48 bytes, and 47 follow; .* cut"),
    "cut-block": (cut(pcd(LONG, "binary_compressed"), 1), r".* packed bytes, and \d+ follow"),
    "cut-sizes": (pcd(XYZ, "binary_compressed", packed=False)[:-50], ".* 8 bytes, and 6 follow; "),
    "other-block": (packed_as(0, 2404), "a block of 2404 bytes, and 200 points need 2400, at most"),
    "too-small": (packed_as(20, 0), "the 20 packed bytes do not become the 2400 that they stand"),
    "too-large": (
        pcd(LONG, "binary_compressed", {"POINTS": "100", "WIDTH": "100"}).replace(
            struct.pack("<I", 2400), struct.pack("<I", 1200), 1
        ),
        r"the \d+ packed bytes do not become the 1200 that they stand for; the file is damaged",
    ),
    "bomb": (
        pcd(XYZ, "binary_compressed", {"POINTS": "60000000", "WIDTH": ""}, packed=False)[:-56]
        + struct.pack("<II", 10, 720_000_000) + bytes(10),
        "the 10 packed bytes do not become the 720000000 that they stand for",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_one_line_names_the_cause_and_a_remedy(tmp_path: Path, name: str) -> None:
    data, problem = BROKEN[name]
    (tmp_path / "a.pcd").write_bytes(data)
    with pytest.raises(BadInput, match=rf"a\.pcd: {problem}") as failure:
        load_points(tmp_path / "a.pcd")
    assert "\n" not in str(failure.value)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_file_that_is_cut_anywhere_is_refused(tmp_path: Path, encoding: str) -> None:
    whole = pcd(LONG, encoding)
    for length in range(1, len(whole) - 4, 37):  # the last number of a text may be shorter
        (tmp_path / "a.pcd").write_bytes(whole[:length])
        with pytest.raises(BadInput):
            load_points(tmp_path / "a.pcd")


def test_no_points(tmp_path: Path) -> None:
    nothing = {name: column[:0] for name, column in XYZ.items()}
    for encoding in ("ascii", "binary"):
        (tmp_path / "a.pcd").write_bytes(pcd(nothing, encoding))
        assert read_scan(tmp_path / "a.pcd", ScanLimits()).points.shape == (0, 3)
