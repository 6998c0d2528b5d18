from __future__ import annotations

import io
import os
import struct
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import plyfile
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from data_prep.failures import BadInput, CannotWrite
from data_prep.files import cloud_text
from data_prep.files import clouds as cloud_files
from data_prep.files.clouds import load_points, read_cloud, save_ply
from data_prep.files.meshes import read_mesh

# Exact in binary and in text; nothing is ever rounded on the way in.
POINTS = np.array([[0.5, -1.25, 3.0], [1e30, -1e-30, 0.0], [7.0, 8.0, 9.0], [0.1, 0.2, 0.3]])


def ply(kind: str, properties: str, body: bytes, count: int = 4, before: str = "") -> bytes:
    head = f"ply\nformat {kind} 1.0\ncomment end_header of a scan\n{before}"
    head += f"element vertex {count}\n"
    head += "".join(f"property {p}\n" for p in properties.split(","))
    return (head + "end_header\n").encode() + body


def rows(points: np.ndarray = POINTS) -> bytes:
    return "".join(" ".join(map(repr, row)) + "\n" for row in points.tolist()).encode()


def npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def load(tmp_path: Path, name: str, content: bytes) -> np.ndarray:
    path = tmp_path / name
    path.write_bytes(content)
    return load_points(path)


XYZ = "double x,double y,double z"
LITTLE = "binary_little_endian"
FACES = "element face 2\nproperty list uchar int vertex_indices\n"
QUAD_AND_TRIANGLE = struct.pack("<B4iB3i", 4, 0, 1, 2, 3, 3, 1, 2, 3)
SEEN = b"".join(struct.pack("<3dB2i", *point, 2, 5, 6) for point in POINTS)
UNEVEN = b"".join(
    point.astype("<f8").tobytes() + struct.pack(f"<B{i}f", i, *range(i)) + bytes([7])
    for i, point in enumerate(POINTS)
)
WHOLE = {
    "ascii.ply": ply("ascii", XYZ, rows()),
    "blank-lines.ply": ply("ascii", XYZ, b"\n" + rows().replace(b"\n", b"\r\n\n")),
    "little.ply": ply("binary_little_endian", XYZ, POINTS.astype("<f8").tobytes()),
    "big.ply": ply("binary_big_endian", XYZ, POINTS.astype(">f8").tobytes()),
    "dos.ply": ply("binary_little_endian", XYZ, b"").replace(b"\n", b"\r\n")
    + POINTS.astype("<f8").tobytes(),
    "end.ply": ply("ascii", XYZ, rows() + b" \n\n"),
    "end-binary.ply": ply(LITTLE, XYZ, POINTS.astype("<f8").tobytes() + b"\r\n"),
    "edges.ply": ply("ascii", XYZ + "\nelement edge 1\nproperty int a", rows() + b"1\n"),
    "cr.ply": ply("ascii", XYZ, rows()).replace(b"\n", b"\r"),
    "cr-binary.ply": ply(LITTLE, XYZ, b"").replace(b"\n", b"\r") + POINTS.astype("<f8").tobytes(),
    "mark.ply": b"\xef\xbb\xbf" + ply("ascii", XYZ, rows()),
    "blanks.ply": ply("ascii", XYZ, rows()).replace(b"ply\n", b"ply \n").replace(b"r\n", b"r \t\n"),
    "capitals.ply": ply("ascii", XYZ.upper().replace("DOUBLE", "double"), rows()),
    "list.ply": ply("ascii", f"{XYZ},list uint float64 d", rows().replace(b"\n", b" 2 .5 .25\n")),
    "lists.ply": ply(
        "ascii",
        f"list uchar int a,list uchar int b,{XYZ}",
        b"".join(
            b"1 9 %d %s" % (i, b"8 " * i) + row for i, row in enumerate(rows().splitlines(True))
        ),
    ),
    "list-binary.ply": ply(LITTLE, f"{XYZ},list uchar int view", SEEN),
    "lists-binary.ply": ply(LITTLE, f"{XYZ},list uchar float d,uchar u", UNEVEN),
    "faces-first.ply": ply("ascii", XYZ, b"4 0 1 2 3\n3 1 2 3\n" + rows(), 4, FACES),
    "faces-first-binary.ply": ply(
        LITTLE, XYZ, QUAD_AND_TRIANGLE + POINTS.astype("<f8").tobytes(), 4, FACES
    ),
    "empty-before.ply": ply(LITTLE, XYZ, POINTS.astype("<f8").tobytes(), 4, "element nothing 5\n"),
    "a.npy": npy(POINTS),
    "big.npy": npy(POINTS.astype(">f8")),
    "columns.npy": npy(np.asfortranarray(POINTS)),
    "a.xyz": rows(),
    "a.TXT": b"# x y z\n\n" + rows().replace(b"\n", b"  # note\n"),
    "tabs.txt": rows().replace(b" ", b"\t"),
    "a.csv": rows().replace(b" ", b", "),
    "mark.csv": b"\xef\xbb\xbf" + rows().replace(b" ", b","),
    "colours.xyz": rows().replace(b"\n", b" 255 0 0\n"),
    "no-end-of-line.xyz": rows()[:-1],
    "header.csv": b"x,y,z\n" + rows().replace(b" ", b","),
    "header.xyz": b"# of a scan\n\n//X Y Z R G B\n" + rows().replace(b"\n", b" 255 0 0\n"),
    "turned.csv": b'"Id","Z","X","Y"\r\n'
    + b"".join(b"7,%r,%r,%r\r\n" % (z, x, y) for x, y, z in POINTS.tolist()),
    "names.csv": rows().replace(b" ", b",").replace(b"\n", b",chair leg\n"),
}
COMMAS = rows().replace(b" ", b",")
DECIMAL_COMMAS = rows().replace(b".", b",")


def columns(before: str = "", after: str = "", separator: str = " ") -> bytes:
    """The rows with other columns around, in which %d is 0, 1, 2 ..."""
    lines = rows().decode().replace(" ", separator).splitlines()
    filled = [(before.replace("%d", str(i)), after) for i in range(len(lines))]
    return "".join(f"{b}{line}{a}\n" for (b, a), line in zip(filled, lines, strict=True)).encode()


# As people have them: every one of these was refused, or read otherwise without a word.
WHOLE |= {
    "semicolons.csv": rows().replace(b" ", b";"),
    "bars.txt": rows().replace(b" ", b" | "),
    "excel.csv": b"sep=;\nx;y;z\n" + rows().replace(b" ", b";"),
    "german.csv": b"x;y;z\r\n" + DECIMAL_COMMAS.replace(b" ", b";"),
    "german.xyz": DECIMAL_COMMAS,
    "german-tabs.txt": DECIMAL_COMMAS.replace(b" ", b"\t"),
    "pandas-german.csv": columns('%d,"', '"', '","').replace(b".", b",").join((b",x,y,z\n", b"")),
    "utf-16.txt": "x\ty\tz\r\n".encode("utf-16") + rows().decode().encode("utf-16")[2:],
    "no-mark.xyz": rows().decode().encode("utf-16-be"),
    "latin-1.csv": "x,y,z,H\xf6he\n".encode("latin-1")
    + columns("", ",\xfc", ",").decode().encode("latin-1"),
    "count.xyz": b"4\n" + rows(),
    "marked-count.pts": b"\xef\xbb\xbf4\r\n" + rows().replace(b"\n", b" -9 1 2 3\r\n"),
    "cr.xyz": rows().replace(b"\n", b"\r"),
    "quoted.csv": b'"x","y","z"\n"'
    + COMMAS[:-1].replace(b",", b'","').replace(b"\n", b'"\n"')
    + b'"\n',
    "quoted-label.csv": b"x,y,z,name\n" + columns("", ',"leg, left #2"', ","),
    "paraview.csv": b'"N:0","N:1","N:2","Points:0","Points:1","Points:2"\n'
    + columns("7,8,9,", "", ","),
    "units.csv": b"id,X (m),Y (m),Z [mm]\n" + columns("%d,", "", ","),
    "map.csv": b"Easting;Northing;Elevation\n" + rows().replace(b" ", b";"),
    "geographic.csv": b"Name,POINT_X,POINT_Y,POINT_Z\n" + columns("a,", "", ","),
    "r.csv": b'"","x","y","z"\n' + columns('"%d",', "", ","),
    "r.txt": b'"x" "y" "z"\n' + columns('"%d" '),
    "german.tsv": "Nr\tHochwert\tH\xf6he\tRechtswert\n".encode()
    + "".join(f"1\t{y}\t{z}\t{x}\n" for x, y, z in POINTS.tolist()).encode(),
    "spanish.csv": b"norte,cota,este\n"
    + "".join(f"{y},{z},{x}\n" for x, y, z in POINTS.tolist()).encode(),
    "italian.csv": b"est,nord,quota\n" + COMMAS,
    "houdini.csv": b"P[x],P[y],P[z],N[x],N[y],N[z]\n" + columns("", ",0,0,1", ","),
    "velo-view.csv": b"t,Points_m_XYZ:0,Points_m_XYZ:1,Points_m_XYZ:2\n" + columns("1.5,", "", ","),
    "utm.csv": b"id,X_UTM,Y_UTM,Z\n" + columns("%d,", "", ","),
    "vectors.csv": b"id,px,py,pz\n" + columns("%d,", "", ","),
    "matlab.csv": b"Var1,Var2,Var3\n" + COMMAS,
    "percent.txt": b"% x y z\n" + rows(),
    "ros.csv": b"%time,field.x,field.y,field.z\n" + columns("1.5,", "", ","),
    "pandas.csv": b",x,y,z\n" + columns("%d,", "", ","),
    "pandas-numbers.csv": b"0,1,2\n" + COMMAS,
    "pandas-index.csv": b",0,1,2\n" + columns("%d,", "", ","),
    "savetxt.txt": b"# id x y z\n" + columns("%d "),
    "colmap.txt": b"# 3D point list, x, y and z:\n#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, "
    b"TRACK[] as (IMAGE_ID, POINT2D_IDX)\n# Number of points: 4\n"
    + columns("%d ", " 9 9 9 0.5 1 2 3 4"),
    "cloud-compare.asc": b"//X Y Z Intensity\n4\n" + columns("", " 7"),
    "prose.txt": b"# the leg of a chair: its x y z\n# id, x, y and z\n" + rows(),
    "empty-ends.csv": b"x,y,z,,\n" + columns("", ",,", ",") + b",,,,\n\n",
    "minus.xyz": rows().replace(b"-", "\u2212".encode()),
    "minus.csv": COMMAS.decode().replace("-", "\u2212").encode("utf-16"),
    "minus.ply": ply("ascii", XYZ, rows().replace(b"-", "\u2212".encode())),
    "minus-zero.xyz": columns("", " -0 0 1"),
    "normals.xyzn": columns("", " 0 0 1"),
    "a.xyzrgb": columns("", " 0.5 0.5 0.5"),
    "table.npy": npy(
        np.array(
            [(9, z, x, y) for x, y, z in POINTS],
            [("id", "i4"), ("Z", ">f8"), ("X", "f8"), ("Y", "f8")],
        )
    ),
}


@pytest.mark.parametrize("name", WHOLE)
def test_the_same_points_from_every_format(tmp_path: Path, name: str) -> None:
    points = load(tmp_path, name, WHOLE[name])
    assert points.dtype == np.float64
    np.testing.assert_array_equal(points, POINTS)


UNNAMED = " (x, y and z are the first 3, as no first line names them)"
NUMBERS_AS_NAMES = "the numbers of line 1, taken for names of columns,"


@pytest.mark.parametrize(
    ("name", "content", "unused", "lines"),
    [
        ("a.ply", WHOLE["ascii.ply"], (), [9, 10, 11, 12]),
        ("b.ply", WHOLE["little.ply"], (), None),
        ("a.npy", WHOLE["a.npy"], (), None),
        ("a.csv", WHOLE["a.csv"], (), [1, 2, 3, 4]),
        ("b.csv", WHOLE["header.csv"], (), [2, 3, 4, 5]),
        ("a.xyz", WHOLE["header.xyz"], ("3 of its 6 columns",), [4, 5, 6, 7]),
        ("b.xyz", WHOLE["colours.xyz"], (f"3 of its 6 columns{UNNAMED}",), [1, 2, 3, 4]),
        ("c.csv", WHOLE["pandas-numbers.csv"], (NUMBERS_AS_NAMES,), [2, 3, 4, 5]),
        ("c.npy", WHOLE["table.npy"], ("1 of its 4 columns",), None),
        (
            "c.ply",
            ply("ascii", f"{XYZ},uchar red,uchar green,uchar blue", b"1 2 3 9 9 9\n", 1),
            ("its colours",),
            [12],
        ),
        (
            "d.ply",
            ply(
                "ascii", f"{XYZ}\nelement face 1\nproperty list uchar int v", rows() + b"3 0 1 2\n"
            ),
            ("its 1 faces",),
            [11, 12, 13, 14],
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_passed_over_and_the_line_of_each_point(
    tmp_path: Path, name: str, content: bytes, unused: tuple[str, ...], lines: list[int] | None
) -> None:
    (tmp_path / name).write_bytes(content)
    contents = read_cloud(tmp_path / name)
    assert contents.unused == unused
    assert (None if contents.lines is None else list(contents.lines)) == lines


RGB = "uchar red,uchar green,uchar blue"
COLOURED = {
    "a.ply": ply("ascii", f"{XYZ},{RGB}", b"1 2 3 255 0 128\n4 5 6 1 1 0\n", 2),
    "order.ply": ply(
        "binary_big_endian",
        "ushort blue,double x,ushort diffuse_red,double y,double z,ushort g",
        np.array(
            [(32896, 1, 65535, 2, 3, 0), (0, 4, 257, 5, 6, 257)],
            [("b", ">u2"), ("x", ">f8"), ("r", ">u2"), ("y", ">f8"), ("z", ">f8"), ("g", ">u2")],
        ).tobytes(),
        2,
    ),
    "share.ply": ply(
        "ascii", f"{XYZ},float red,float green,float blue", b"1 2 3 1 0 .5\n4 5 6 .004 .004 0\n", 2
    ),
    "a.xyz": b"1 2 3 255 0 128\n4 5 6 1 1 0\n",
    "splats.ply": ply(
        LITTLE,
        f"float opacity,{XYZ},float f_dc_0,float f_dc_1,float f_dc_2",
        struct.pack("<f3d3f", 9, 1, 2, 3, 2, -1.77, 0.00695)
        + struct.pack("<f3d3f", 9, 4, 5, 6, -1.7586, -1.7586, -2),
        2,
    ),
    "names.csv": b"g,x,y,z,b,label,R\n0,1,2,3,128,7,255\n1,4,5,6,0,7,1\n",
    "tags.csv": b"x,y,z,tag,r,g,b\n1,2,3,#12,255,0,128\n4,5,6, #a,1,1,0  # a comment\n",
    "alpha.xyz": b"1 2 3 255 0 128 255\n4 5 6 1 1 0 255\n",
    "units.csv": b"g [0-255],X,Y,Z,Blue,Red\n0,1,2,3,128,255\n1,4,5,6,0,1\n",
    "fractions.asc": b"//X Y Z Rf Gf Bf\n1 2 3 1 0 .5\n4 5 6 .004 .004 0\n",
    "a.pts": b"2\n1 2 3 -9 255 0 128\n4 5 6 -9 1 1 0\n",
    "six.pts": b"2\n1 2 3 255 0 128\n4 5 6 1 1 0\n",
    "a.npy": npy(np.array([[1, 2, 3, 255, 0, 128], [4, 5, 6, 1, 1, 0]])),
    "share.npy": npy(np.array([[1, 2, 3, 1, 0, 0.5], [4, 5, 6, 0.004, 0.004, 0]], np.float32)),
}


@pytest.mark.parametrize("name", COLOURED)
def test_colours_of_every_format_are_read_where_they_are_asked_for(
    tmp_path: Path, name: str
) -> None:
    (tmp_path / name).write_bytes(COLOURED[name])
    contents = read_cloud(tmp_path / name, with_colors=True)
    assert contents.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert contents.colors is not None
    assert contents.colors.dtype == np.uint8
    assert contents.colors.tolist() == [[255, 0, 128], [1, 1, 0]]
    without = read_cloud(tmp_path / name)
    assert (without.colors, without.has_colors, len(without.unused)) == (None, True, 1)


@pytest.mark.parametrize(
    ("name", "content", "colour"),
    [
        ("bytes.ply", ply("ascii", f"{XYZ},{RGB}", b"1 2 3 1 0 1\n", 1), [1, 0, 1]),
        ("bytes.npy", npy(np.array([[1, 2, 3, 1, 0, 1]])), [1, 0, 1]),
        ("shares.npy", npy(np.array([[1, 2, 3, 1, 0, 1.0]])), [255, 0, 255]),
    ],
)
def test_a_colour_of_ones_is_dark_where_numbers_are_whole(
    tmp_path: Path, name: str, content: bytes, colour: list[int]
) -> None:
    (tmp_path / name).write_bytes(content)
    colors = read_cloud(tmp_path / name, with_colors=True).colors
    assert colors is not None
    assert colors.tolist() == [colour]


NORMALS = {
    "normals.xyz": columns("", " 0 0 -1"),
    "normals.npy": npy(
        np.concatenate([POINTS, np.tile([0.6, 0.0, -0.8], (len(POINTS), 1))], axis=1)
    ),
}


@pytest.mark.parametrize("name", ["little.ply", "a.npy", "a.xyz", "names.csv", *NORMALS])
def test_a_file_without_colours_has_none(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes((WHOLE | NORMALS)[name])
    contents = read_cloud(tmp_path / name, with_colors=True)
    assert (contents.colors, contents.has_colors) == (None, False)
    np.testing.assert_array_equal(contents.points, POINTS)


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        (
            "below.csv",
            b"x,y,z,r,g,b\n1,2,3,0,0,-1\n",
            "its colours have values below 0 or not finit",
        ),
        ("nan.npy", npy(np.array([[1, 2, 3, 0, 0, np.nan]])), "values below 0 or not finite"),
        ("large.xyz", b"1 2 3 0 0 70000\n", "its colours have the value 70000; give 0 to 255"),
        ("word.xyz", b"1 2 3 4 5 red\n", "line 1: 'red' is not a number"),
        ("short.csv", b"x,y,z,r,g,b\n1,2,3,4\n", "line 2 has 4 columns, expected at least 6; give"),
    ],
)
def test_columns_that_are_no_colours_are_refused_where_colours_are_asked_for(
    tmp_path: Path, name: str, content: bytes, problem: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BadInput, match=rf"{name}: .*{problem}"):
        read_cloud(tmp_path / name, with_colors=True)
    assert read_cloud(tmp_path / name).points.tolist() == [[1, 2, 3]]


def written_ply(points: np.ndarray, text: bool, order: str) -> bytes:
    """Write points as plyfile does, among other properties in another order and other elements."""
    table = np.zeros(len(points), [("a", "u1"), *((name, "f8") for name in ("z", "x", "nx", "y"))])
    table["x"], table["y"], table["z"] = points.T
    camera = np.array([(1.0, 2), (3.0, 4)], [("focal", "f8"), ("id", "u1")])
    faces = np.array([([0, 0, 0],), ([0, 0, 0, 0],)], [("vertex_indices", object)])
    elements = [
        plyfile.PlyElement.describe(camera, "camera"),
        plyfile.PlyElement.describe(table, "vertex"),
        plyfile.PlyElement.describe(faces, "face", {"vertex_indices": "u1"}),
    ]
    file = io.BytesIO()
    plyfile.PlyData(elements, text=text, byte_order=order).write(file)
    return file.getvalue()


WRITERS: dict[str, Callable[[np.ndarray], bytes]] = {
    "text.ply": lambda points: written_ply(points, True, "="),
    "little.ply": lambda points: written_ply(points, False, "<"),
    "big.ply": lambda points: written_ply(points, False, ">"),
    "a.npy": npy,
    "big.npy": lambda points: npy(np.asfortranarray(points.astype(">f8"))),
    "a.xyz": lambda points: b"x y z\n" + rows(points),
    "a.csv": lambda points: b"x,y,z\n" + rows(points).replace(b" ", b","),
    "a.pts": lambda points: b"%d\n" % len(points) + rows(points),
}


@pytest.mark.parametrize("name", WRITERS)
@settings(derandomize=True, max_examples=20, deadline=None, database=None)
@given(points=arrays(np.float64, st.tuples(st.integers(1, 9), st.just(3)), elements=st.floats()))
def test_whatever_is_written_is_read_to_the_bit(name: str, points: np.ndarray) -> None:
    points[np.isnan(points)] = np.nan  # a text has no payloads of NaN
    with TemporaryDirectory() as folder:
        read = load(Path(folder), name, WRITERS[name](points))
    assert read.dtype == np.float64
    np.testing.assert_array_equal(read, points)
    assert (np.signbit(read) == np.signbit(points))[~np.isnan(points)].all()


def test_marks_of_missing_numbers_are_no_numbers(tmp_path: Path) -> None:
    marks = b"1.#QNAN -1.#IND 1.#INF -1.#J nan -nan(ind) NaN NA N/A null None 1.#SNAN".split()
    table = b"x,y,z\n1,2,3\n,2,3\n" + b"".join(b"1,2,%s\n" % mark for mark in marks)
    points = load(tmp_path, "a.csv", table)
    assert len(points) == 2 + len(marks)
    assert np.isfinite(points).all(axis=1).tolist() == [True] + [False] * (1 + len(marks))


def test_nothing_and_what_is_not_finite_are_kept_and_numbers_of_other_types(tmp_path: Path) -> None:
    wild = np.array([[np.nan, np.inf, -np.inf], [1e308, -0.0, 5e-324]])
    for points in (wild, wild[:0]):
        for name, content in (
            ("a.ply", ply("ascii", XYZ, rows(points), len(points))),
            ("a.npy", npy(points)),
            ("a.xyz", b"# nothing\n" + rows(points)),
        ):
            np.testing.assert_array_equal(load(tmp_path, name, content), points)
    values = np.arange(12).reshape(4, 3)
    for kind in ("f2", "u1", "i8"):
        np.testing.assert_array_equal(load(tmp_path, "a.npy", npy(values.astype(kind))), values)


BROKEN = {
    "empty.ply": (b"", "an empty file; fetch or write it again"),
    "header.ply": (b"plyformat", "no PLY header"),
    "endless.ply": (b"ply\n" + b"comment x\n" * 9000 + b"end_header\n", "no PLY header"),
    "no-format.ply": (b"ply\nelement vertex 0\nend_header\n", "no format"),
    "format.ply": (ply("ascii", XYZ, b"", 0).replace(b"1.0", b"2.0"), "'format ascii 2.0'"),
    "no-vertex.ply": (
        b"ply\nformat ascii 1.0\nelement face 0\nend_header\n",
        r"0 elements vertex \('face'\), expected 1; use a PLY of points",
    ),
    "two-vertices.ply": (
        ply("ascii", XYZ, rows(), 3, "element vertex 1\n"),
        r"2 elements vertex \('vertex, vertex'\), expected 1",
    ),
    "more.ply": (ply("ascii", XYZ, rows(), 1), "3 more rows than the header has; write the file"),
    "more-binary.ply": (ply(LITTLE, XYZ, b"a" * 96, 2), "48 more bytes than the header has"),
    "flat.ply": (ply("ascii", "float x,float y", b"1 2\n", 1), "0 properties z"),
    "twice.ply": (ply("ascii", "float x,float y,float z,int x", b"", 0), "2 properties x"),
    "kind.ply": (ply("ascii", "quad x,float y,float z", b"", 0), "'property quad x'"),
    "list.ply": (ply("ascii", "list uchar int x,float y,float z", b"", 0), "0 properties x"),
    "list-of.ply": (ply("ascii", f"{XYZ},list float int n", b"", 0), "'property list float int n'"),
    "list-ends.ply": (
        ply("ascii", f"{XYZ},list uchar int n", b"1 2 3 2 5 6\n1 2 3 1 5 6\n3\n", 2),
        "line 11 has other lists than it says",
    ),
    "endless-list.ply": (ply(LITTLE, XYZ, b"\xff" * 126, 4, FACES), "2 rows of 'face'"),
    "below-0.ply": (
        ply(LITTLE, f"list int int n,{XYZ}", struct.pack("<i", -8) + bytes(96), 4),
        "4 rows of 'vertex'",
    ),
    "nan-list.ply": (ply("ascii", f"{XYZ},list uchar int n", b"1 2 3 nan\n", 1), "1 rows of 'v"),
    "corner.ply": (
        ply(LITTLE, XYZ, POINTS.astype("<f8").tobytes() + QUAD_AND_TRIANGLE, 4)
        .replace(b"end_header\n", FACES.encode() + b"end_header\n")
        .replace(struct.pack("<i", 3), struct.pack("<i", 4)),
        "faces have the vertices 0 to 4, of 4; the file is damaged",
    ),
    "cut.ply": (ply(LITTLE, XYZ, bytes(95), 4), "4 rows of 'vertex' in .* and 95 bytes for them"),
    "cut-ascii.ply": (ply("ascii", XYZ, rows(), 5), "5 rows of 'vertex' in .*, 4 in the file"),
    "huge.ply": (ply(LITTLE, XYZ, bytes(96), 10**12 - 1), "999999999999 rows"),
    "huger.ply": (ply("ascii", XYZ, rows(), 10**19), "'element vertex 1000.*write the file again"),
    "negative.ply": (ply("ascii", XYZ, rows(), -1), "'element vertex -1'"),
    "huge-before.ply": (
        ply(LITTLE, XYZ, bytes(96), 4, "element a 999999999999\nproperty char b\n"),
        "and 96 bytes for them",
    ),
    "huge-before-ascii.ply": (
        ply("ascii", XYZ, rows(), 4, "element a 999999999999\n" + 3 * "property float b\n"),
        "4 in the file",
    ),
    "word.ply": (ply("ascii", XYZ, b"1 2 x\n", 1), "line 9: 'x' is not a number"),
    "short.ply": (ply("ascii", XYZ, b"\n1 2\n", 1), "line 10 has 2 columns, and the header has 3"),
    "long.ply": (ply("ascii", XYZ, b"1 2 3 4\n", 1), "line 9 has 4 columns, and the header has 3"),
    "empty.npy": (b"\n", "not a readable NPY"),
    "magic.npy": (b"\x93NUMPY\x07\x07" + bytes(90), "not a readable NPY"),
    "four.npy": (npy(np.zeros((5, 4))), r"float64' of shape '\(5, 4\)'; save real numbers"),
    "line.npy": (npy(np.zeros(3)), r"of shape '\(3,\)'"),
    "complex.npy": (npy(np.zeros((5, 3), complex)), "'complex128'"),
    "truth.npy": (npy(np.zeros((5, 3), bool)), "'bool'"),
    "objects.npy": (npy(np.array([[{}, 1, 2]], object)), "'object'"),
    "cut.npy": (npy(POINTS)[:-1], "claims 4 points, 96 bytes, and 95 follow"),
    "more.npy": (npy(POINTS) + b"x", "claims 4 points, 96 bytes, and 97 follow"),
    "huge.npy": (npy(POINTS).replace(b"(4, 3), }", b"(9999999999999999999999, 3), }"), "claims"),
    "negative.npy": (npy(POINTS).replace(b"(4, 3), }", b"(-4, 3), }"), r"shape '\(-4, 3\)'"),
    "deep.npy": (npy(POINTS).replace(b"(4, 3), }", b"(" * 60), "not a readable NPY"),
    "words.xyz": (b"id a b\n1 2 3\n", "line 1: 'id a b' is no point, and no names of columns"),
    "degrees.csv": (
        b"lon,lat,height\n1,2,3\n",
        "longitude and latitude are named up to line 1; project them to metres",
    ),
    "degrees.txt": (b"# lat lon h\n1 2 3\n", "longitude and latitude .* up to line 2; project"),
    "dollars.txt": (b"1$2$3\n", "'1.2.3' is no point, .* separated by spaces, tabs, commas, sem"),
    "twice.csv": (b"x,y,z,x\n1,2,3,4\n", "'x,y,z,x' .* x, y and z .each once"),
    "flat.csv": (b"x,y\n1,2\n", "line 1: 'x,y' is no point"),
    "chemistry.xyz": (b"2\nwater\nO 1 2 3\n", "line 2: 'water' is no point"),
    "count.txt": (columns("%d "), "its first column, '0' and so on, seems to count .* first line"),
    "abaqus.txt": (columns("%d, ", "", ", "), "its first column, '0' and so on"),
    "ids.txt": (b"7 .5 2 3 9\n3 .5 2 4 9\n4 .5 2 1 9\n", "its first column, '7' and so on"),
    "scan.xyz": (columns("0 %d "), "its first column, '0' and so on, seems to count or label"),
    "voxels.txt": (b"1 5 6 7\n2 9 8 7\n3 4 4 4\n", "its first column, '1' and so on"),
    "time.txt": (
        b"".join(b"%.2f 0.%d 1 2\n" % (1e5 + i / 4, i) for i in range(20)),
        r"its first column, '100000' and so on, only grows, as times do; name all columns",
    ),
    "decimal.ply": (
        ply("ascii", XYZ, b"0,5 1 2\n", 1),
        "'0,5' is not a number; it has a decimal c",
    ),
    "rubbish.xyz": (b"\x80\x03ctorch\x00\x01\n", "line 1: binary data is no point"),
    "rubbish.csv": (b"x,y,z\n1,2,\xff\xfe\xfd\n", "line 2: binary data is not a number"),
    "rubbish.ply": (ply("ascii", XYZ, b"1 2 \x00\x02\n", 1), "line 9: binary data is not a numb"),
    "umlaut.csv": ("x,y,z\nm,m,Höhe\n".encode("latin-1"), "line 2: 'm' is not a number"),
    "numbered.csv": (b"V1,V2,V3,V4\n" + columns("%d,", "", ","), "its first column, '0' and so on"),
    "three-named.txt": (b"x y z\n7 .5 2 3\n3 .5 2 4\n4 .5 2 1\n", "its first column, '7' and so"),
    "prose.txt": (b"# x y z in m\n7 .5 2 3\n3 .5 2 4\n4 .5 2 1\n", "its first column, '7' and so"),
    "ragged.txt": (
        b"1 057.50 2.5 3.5\n57.50 2.5 3.5\n",
        "line 2 has 3 columns, expected 4; write n",
    ),
    "ptx.pts": (b"4\n1\n0 0 0\n1 0 0 0\n", "line 4 has 4 columns, expected 3"),
    "labels.txt": (columns("leg "), "its first column, 'leg' and so on, seems to count or label"),
    "thousands.csv": (b"4,866.80,3,235.00,5,366.00\n", "parts of numbers; .* thousands separators"),
    "groups.txt": (b"657,700 716,650 312\n658,100 716,900 415\n", "'657,700' seems to have a th"),
    "groups.csv": (b"x;y;z;i\n657,700;71;312;5\n", "'657,700' seems to have a thousands separator"),
    "three.txt": (b"".join(b"%d .5 %d\n" % (i, i * i) for i in range(16)), "first column, '0' and"),
    "thousands.txt": (b"4 866.80 3 235.00 5 366.00\n", "parts of numbers"),
    "in-words.txt": (b"4,866.80 3,235.00 5,366.00\n", "'4,866.80' is not a number; .* thousands"),
    "quoted.csv": (b'x,y,z\n"4,866.80",1,2\n', "line 2: '4,866.80' is not a number; write"),
    "mixed.csv": (b"x,y,z\n1,2,3\n4,866.80,2,3\n", "line 3 has 4 columns, expected 3; write num"),
    "named.csv": (b"x,y,z\n0,5,0,25,1,5\n", "line 2 has 6 columns, expected 3; write numbers"),
    "zeros.csv": (b"1,5,-0,5,2,5\n", "parts of numbers"),
    "german.csv": (b"0,0666,1,5,2,5\n", "parts of numbers; write numbers such as -1234.5"),
    "points.csv": (b"1.500,0;2,5;3,5\n", "'1.500,0' is not a number"),
    "later.csv": (b"1,5;2,5;3,5\n1.500;2,5;3,5\n", "line 1: '1,5' is not a number"),
    "french.csv": (b"1 500,5;2,5;3,5\n", "'1 500,5' is not a number"),
    "fortran.txt": (b"1.5D+00 2 3\n", r"'1.5D\+00' is not a number; write numbers such as .* 1e-3"),
    "hash.xyz": (b"1 2 3#4\n", "line 1: '1 2 3#4' is no point"),
    "quote.csv": (b'x,y,z,a\n1,2,3,4\n1,2,3,"leg\n1,2,3,4\n', "a quote of line 3 is left open"),
    "first-quote.csv": (
        b'x,y,z,a\n1,2,3,"leg\n2"\n',
        "a quote of line 2 is left open; close it on",
    ),
    "footer.csv": (b"x,y,z\n1,2,3\nEnd\n", "line 3 has 1 columns, expected 3; correct or remove"),
    "second-line.csv": (b"x,y,z\nm,m,m\n1,2,3\n", "line 2: 'm' is not a number; correct or remove"),
    "grid.txt": (b"18\n19\n0 0 0\n", "line 2 has 1 columns"),
    "packed.csv": (b"\x1f\x8b\x08\0\0", "packed by GZIP; unpack it"),
    "page.ply": (b"<!DOCTYPE html>", "a web page, which stands for the file; download"),
    "two-headers.csv": (b"x,y,z\nx,y,z\n1,2,3\n", "line 2: 'x' is not a number"),
    "late-header.csv": (b"1,2,3\nx,y,z\n", "line 2: 'x' is not a number"),
    "two.xyz": (b"1 2 3\n1 2\n", "line 2 has 2 columns"),
    "python.xyz": (b"1 2 3\n1_0 2 3\n", "line 2: '1_0' is not a number"),
    "long.xyz": (b"1 2 3\n1 2 " + b"3" * 70000, "line 2 has 70004 characters, more than a row"),
    "text.npy": (npy(np.array([["1", "2", "3"]])), "'<U1'"),
    "fields.npy": (npy(np.zeros(3, [("x", "f4"), ("y", "f4"), ("w", "f4")])), "or a table with x"),
    "names.npy": (npy(np.zeros(3, [("x", "f4"), ("y", "S4"), ("z", "f4")])), "save real numbers"),
    "transposed.npy": (npy(POINTS.T.repeat(2, 1)), r"shape '\(3, 8\)'; save real numbers"),
    "cloud.obj": (
        b"v 1 2 3\n",
        r'\.obj is a mesh, not a point cloud; save points of its surface \(docs/rendering\.md, "F',
    ),
    "cloud.doc": (
        b"1 2 3\n",
        r"\.doc is not supported as a point cloud; use one of \.ply, \.npy, \.xyz, \.txt, \.csv",
    ),
    "cloud": (b"1 2 3\n", "a name without a suffix is not supported as a point cloud; use one of"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_one_line_names_the_file_and_the_problem(tmp_path: Path, name: str) -> None:
    content, problem = BROKEN[name]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(BadInput, match=problem) as failure:
            load(tmp_path, name, content)
    message = str(failure.value)
    assert message.startswith(f"{tmp_path / name}: ")
    assert "\n" not in message
    assert len(message) < len(str(tmp_path)) + 250


@pytest.mark.parametrize("name", ["little.ply", "dos.ply", "a.npy", "ascii.ply", "a.csv"])
def test_a_cut_file_is_refused_but_for_a_text_that_lacks_its_end(tmp_path: Path, name: str) -> None:
    text = name in ("ascii.ply", "a.csv")
    for length in range(0, len(WHOLE[name]), 7):
        with suppress(BadInput):
            points = load(tmp_path, name, WHOLE[name][:length])
            assert text
            assert len(points) == len(POINTS) or name == "a.csv"  # which does not count them
            done = max(0, len(points) - 1)  # the cut may go through the last number
            np.testing.assert_array_equal(points[:done], POINTS[:done])


@pytest.mark.parametrize("name", ["huge.ply", "huge.npy", "huge-before.ply"])
def test_a_header_costs_no_memory(tmp_path: Path, monkeypatch, name: str) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("memory was taken")

    for function in ("empty", "zeros", "frombuffer", "fromfile"):
        monkeypatch.setattr(np, function, refuse)
    with pytest.raises(BadInput):
        load(tmp_path, name, BROKEN[name][0])


def test_large_files_are_refused_unread_and_large_texts_sooner(tmp_path: Path, monkeypatch) -> None:
    with (tmp_path / "a.xyz").open("wb") as file:
        file.truncate(cloud_files.MOST_BYTES + 1)  # sparse
    with pytest.raises(BadInput, match="268435457 bytes, and at most 268435456 are read"):
        load_points(tmp_path / "a.xyz")
    for name in ("a.xyz", "ascii.ply"):
        monkeypatch.setattr(cloud_text, "MOST_TEXT_BYTES", len(WHOLE[name]))
        load(tmp_path, name, WHOLE[name])
        monkeypatch.setattr(cloud_text, "MOST_TEXT_BYTES", len(WHOLE[name]) - 1)
        with pytest.raises(BadInput, match=r"bytes of text, at most \d+ are read; use NPY"):
            load(tmp_path, name, WHOLE[name])


def test_bits_survive_writing_whatever_the_layout_in_memory(tmp_path: Path) -> None:
    # All kinds of float32: zeros, subnormals, infinities, NaNs of every sign and payload.
    bits = [0, 0x80000000, 1, 0x007FFFFF, 0x7F800000, 0xFF800000, 0x7FC00000, 0x7F800001]
    bits += [0xFFC12345, 0x3F800000, 0xBF800000, 0x7F7FFFFF]
    points = np.array(bits, np.uint32).view(np.float32).reshape(-1, 3)
    path = tmp_path / "new" / "a.ply"
    save_ply(points, path)
    assert path.read_bytes().endswith(b"end_header\n" + np.array(bits, "<u4").tobytes())
    there = plyfile.PlyData.read(io.BytesIO(path.read_bytes()))["vertex"]
    for column, axis in enumerate("xyz"):
        assert there[axis].dtype == np.dtype("<f4")
        np.testing.assert_array_equal(
            there[axis].view(np.uint32), points[:, column].copy().view(np.uint32)
        )
    np.testing.assert_array_equal(load_points(path), points)
    assert [p.name for p in path.parent.iterdir()] == ["a.ply"]
    for kind in ("<f4", ">f4"):
        points = np.asfortranarray(POINTS.astype(kind))[::-1]
        save_ply(points, path)
        np.testing.assert_array_equal(load_points(path), points)
    save_ply(points[:0], path)
    assert load_points(path).shape == (0, 3)


@pytest.mark.parametrize("points", [POINTS, POINTS.astype("f4")[:, :2], np.zeros(3, "f4")])
def test_only_float32_of_three_columns(tmp_path: Path, points: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"expected float32 \[N, 3\]"):
        save_ply(points, tmp_path / "a.ply")
    assert not (tmp_path / "a.ply").exists()


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch) -> None:
    """How: test_whole_files. Here: that it is written so, and what the message says."""

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    (tmp_path / "a.ply").write_bytes(b"old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(CannotWrite, match=r"a\.ply: cannot be written \(No space left"):
        save_ply(POINTS.astype("f4"), tmp_path / "a.ply")
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [b"old"]


def test_a_binary_ply_of_triangles_and_quads(tmp_path: Path) -> None:
    """trimesh refuses it; Blender writes such files."""
    head = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 5\nproperty double x\n"
        "property double y\nproperty double z\nelement face 2\n"
        "property list uchar uint vertex_indices\nproperty uchar red\nproperty uchar green\n"
        "property uchar blue\nend_header\n"
    )
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = struct.pack("<B4I3B", 4, 0, 1, 2, 3, 255, 0, 0) + struct.pack(
        "<B3I3B", 3, 0, 1, 4, 0, 9, 0
    )
    path = tmp_path / "a.ply"
    path.write_bytes(head.encode() + points.astype("<f8").tobytes() + faces)
    mesh = read_mesh(path)
    assert mesh.vertices.tolist() == points.tolist()
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 4]]
    assert mesh.face_colors.tolist() == [[255, 0, 0], [255, 0, 0], [0, 9, 0]]
    path.write_bytes(path.read_bytes().replace(b"vertex_indices", b"indices"))
    assert read_mesh(path).faces.tolist() == mesh.faces.tolist()
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(BadInput, match="2 rows of 'face' in the header, and 35 bytes for them"):
        read_mesh(path)
