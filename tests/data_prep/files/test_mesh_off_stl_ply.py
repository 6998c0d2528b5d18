"""OFF, STL and PLY as people and programs write them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from data_prep.failures import BadInput
from data_prep.files.meshes import read_contents
from data_prep.scene import NEUTRAL_GREY

GREY, RED, BLUE = list(NEUTRAL_GREY), [255, 0, 0], [0, 0, 255]
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
ROWS = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
HALVES = [[0, 1, 2], [0, 2, 3]]
FACET = "facet normal 0 0 1\nouter loop\n{}endloop\nendfacet\n"


def read(folder: Path, name: str, content: str | bytes):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_contents(path)


@pytest.mark.parametrize(
    "text",
    [
        f"OFF\n4 1 0\n{ROWS}4 0 1 2 3\n",
        f"OFF 4 1 0\n{ROWS}4 0 1 2 3\n",
        f"OFF4 1 0\n{ROWS}4 0 1 2 3\n",
        f"off\r\n4 1\r\n{ROWS}4 0 1 2 3",
        f"# made by x\nOFF # 4\n\n# c\n4 1 0 # 9\n# 1 1 1\n{ROWS}\n# f\n4 0 1 2 3 # 3\n",
        "OFF\n4 1 0\n0 0 0 1 0 0 1 1 0\n0 1 0\n4 0\n1 2\n3\n",  # a stream of words
        f"OFF 4 2 0 {ROWS} 3 0 1 2 3 0 2 3".replace("\n", " "),
        f"OFF 4 2 0 {ROWS} 3 0 1 2\t3 0 2\n3",
        "NOFF\n4 1 0\n" + ROWS.replace("0\n", "0 0 0 1\n") + "4 0 1 2 3\n",
    ],
)  # fmt: skip
def test_rows_of_an_off(tmp_path: Path, text: str) -> None:
    contents = read(tmp_path, "a.off", text)
    np.testing.assert_array_equal(contents.vertices, SQUARE)
    assert contents.faces.tolist() == HALVES
    assert contents.face_colors.tolist() == [GREY] * 2
    assert contents.notes == ()


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (f"OFF\n4 1 0\n{ROWS}", "not the vertices and faces that its counts '4 1 0' say"),
        (f"OFF\n5 1 0\n{ROWS}4 0 1 2 3\n", "not the vertices and faces that its counts '5 1 0'"),
        (f"OFF\n4 1 0\n{ROWS}4 0 1 2 4\n", "faces have the vertices 0 to 4, of 4"),
        (f"OFF\n4 1 0\n{ROWS.replace('1 1 0', '1 x 0')}3 0 1 2\n", "vertex 2: '1 x 0' are no num"),
        (
            f"COFF 4 1 0 {ROWS} 3 0 1 2\n".replace("\n", " "),
            "its rows are not the vertices and faces",
        ),
        (f"OFF 4 2 0 {ROWS} 3 0 1 2 0".replace("\n", " "), "that its counts '4 2 0' say"),
        (f"4OFF\n4 1 0\n{ROWS}3 0 1 2\n", "an OFF of four coordinates"),
        ("OFF BINARY\n\0\0\0\1", "a binary OFF, which is not read; export it as an OFF of text"),
        ("OFF\n", "its counts '' say"),
        (f"4 1 0\n{ROWS}3 0 1 2\n", "does not begin with OFF"),
        (f"OFF\n4 0 0\n{ROWS}", "the mesh has no faces"),
    ],
)
def test_refused_offs(tmp_path: Path, text: str, problem: str) -> None:
    with pytest.raises(BadInput) as failure:
        read(tmp_path, "a.off", text)
    assert problem in str(failure.value)


def test_rows_behind_the_last_face_of_an_off_are_told(tmp_path: Path) -> None:
    text = f"OFF\n4 1 0\n{ROWS}3 0 1 2\n3 0 2 3\n"
    contents = read(tmp_path, "a.off", text)
    assert contents.faces.tolist() == [[0, 1, 2]]
    assert contents.notes == ("1 rows behind the last face are left out",)
    contents = read(tmp_path, "a.off", text.replace("\n", " "))  # no rows, but words
    assert contents.faces.tolist() == [[0, 1, 2]]
    assert "behind the last face are left out" in contents.notes[0]


BLUE_ROWS = ROWS.replace("0\n", "0 0 0 255 255\n")


@pytest.mark.parametrize(
    ("text", "colors"),
    [
        ("CNOFF\n4 1 0\n" + ROWS.replace("0\n", "0 0 0 1 1. 0 0\n") + "4 0 1 2 3\n", [RED] * 2),
        (f"COFF\n4 1 0\n{BLUE_ROWS}4 0 1 2 3\n", [BLUE] * 2),
        (f"COFF\n4 2 0\n{BLUE_ROWS}3 0 1 2 255 0 0\n3 0 2 3\n", [RED, GREY]),  # that of the face
        (f"COFF\n4 1 0\n{BLUE_ROWS}4 0 1 2 3 7\n", [BLUE] * 2),  # of a map of colours
        (f"OFF\n4 2 0\n{ROWS}3 0 1 2 1 0 0.\n3 0 2 3 0 0 255 9\n", [RED, BLUE]),
        (f"OFF\n4 2 0\n{ROWS}3 0 1 2 1 0 0\n3 0 2 3 0 0 1\n", [RED, BLUE]),
        (f"OFF\n4 2 0\n{ROWS}3 0 1 2 256 -1 0\n3 0 2 3 0. 0. 1.1\n", [RED, BLUE]),
    ],
)
def test_colours_of_an_off(tmp_path: Path, text: str, colors: list) -> None:
    assert read(tmp_path, "a.off", text).face_colors.tolist() == colors


def facets(count: int = 2, attributes: tuple[int, ...] = (0, 0), header: bytes = b"") -> bytes:
    """A binary STL of the halves of a square."""
    body = b"".join(
        struct.pack("<12fH", 0, 0, 1, *SQUARE[half].ravel(), attribute)
        for half, attribute in zip(HALVES, attributes, strict=True)
    )
    return header.ljust(80, b"\0") + struct.pack("<I", count) + body


def loop(*corners: int) -> str:
    return FACET.format("".join("vertex {} {} {}\n".format(*SQUARE[i]) for i in corners))


TEXT_STL = f"solid vertex loop\n{loop(0, 1, 2)}{loop(0, 2, 3)}endsolid vertex loop\n"


@pytest.mark.parametrize(
    "content",
    [
        facets(),
        facets(header=b"ply\n"),
        facets(header=b"glTF"),
        facets(header=b"solid of CAD, facet"),  # begins as a text does
        facets(header=b"OFF\n4 1 0\n"),
        TEXT_STL,
        TEXT_STL.upper().replace("\n", "\r\n   "),
        TEXT_STL.replace("\n", " "),
        TEXT_STL.rpartition("endsolid")[0],
        f"solid a\n{loop(0, 1, 2)}endsolid a\nsolid b\n{loop(0, 2, 3)}endsolid b\n",
        f"solid\n{loop(0, 1, 2, 3)}endsolid\n",  # a loop of four
    ],
)
def test_forms_of_an_stl(tmp_path: Path, content: str | bytes) -> None:
    contents = read(tmp_path, "a.stl", content)
    np.testing.assert_array_equal(contents.vertices[contents.faces], SQUARE[HALVES])
    assert contents.face_colors.tolist() == [GREY] * 2
    assert contents.notes == ()


def test_colours_of_an_stl_by_materialise_magics(tmp_path: Path) -> None:
    # Bits 0 to 4 are red, 10 to 14 blue; the highest bit leaves the colour of the object.
    content = facets(attributes=(31, 0x8000), header=b"COLOR=" + bytes([0, 0, 255, 255]))
    assert read(tmp_path, "a.stl", content).face_colors.tolist() == [RED, BLUE]
    for header in (b"x", b" " * 73 + b"COLOR="):  # else nobody says what the bits are
        contents = read(tmp_path, "a.stl", facets(attributes=(31, 0xFC00), header=header))
        assert contents.face_colors.tolist() == [GREY, GREY]
        assert contents.notes[0].startswith("its triangles may have colours that are not read")


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (facets(3, header=b"solid a"), "3 triangles, 234 bytes, of which 184 are there"),
        (facets(3), "3 triangles, 234 bytes, of which 184 are there"),
        (facets()[:-1], "2 triangles, 184 bytes, of which 183 are there"),
        (TEXT_STL.partition("endloop")[0], "1 loops begin and 0 end"),
        (TEXT_STL.replace("1 1 0", "1 1", 1), "vertex 2: '1 1' is not three numbers"),
        (TEXT_STL.replace("1 1 0", "1,5 1 0", 1), "write numbers with a point, not a comma"),
        ("solid a\nendsolid a\n", "the mesh has no faces"),
    ],
)
def test_refused_stls(tmp_path: Path, content: str | bytes, problem: str) -> None:
    with pytest.raises(BadInput) as failure:
        read(tmp_path, "a.stl", content)
    assert problem in str(failure.value)


def test_bytes_behind_the_last_triangle_of_an_stl_are_told(tmp_path: Path) -> None:
    contents = read(tmp_path, "a.stl", facets(1, header=b"solid a"))
    assert contents.faces.tolist() == [[0, 1, 2]]
    assert contents.notes == ("50 bytes behind the last triangle are left out",)


def ply(faces: str, rows: str, *, vertex: str = "", head: str = "", points: str = ROWS) -> str:
    count, number = rows.count("\n"), points.count("\n")
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    return (
        f"ply\nformat ascii 1.0\n{head}element vertex {number}\n{axes}{vertex}"
        f"element {faces.partition(' ')[0]} {count}\n{faces.partition(' ')[2]}end_header\n"
        f"{points}{rows}"
    )


CORNERS = "face property list uchar int vertex_indices\n"
OF_FACES = CORNERS + "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))


def test_quads_of_a_ply_keep_the_colours_of_their_faces(tmp_path: Path) -> None:
    text = ply(OF_FACES, "4 0 1 2 3 255 0 0\n3 0 2 3 0 0 255\n")
    contents = read(tmp_path, "a.ply", text)
    assert contents.faces.tolist() == [*HALVES, [0, 2, 3]]
    assert contents.face_colors.tolist() == [RED, RED, BLUE]


def test_concave_polygons_of_every_format(tmp_path: Path) -> None:
    arrow = "0 0 0\n2 0 0\n.5 .5 0\n0 2 0\n"  # area 1; a fan around the first corner has 3
    for first in range(4):
        order = [(first + i) % 4 for i in range(4)]
        texts = {
            "a.ply": ply(CORNERS, f"4 {' '.join(map(str, order))}\n", points=arrow),
            "a.off": f"OFF\n4 1 0\n{arrow}4 {' '.join(map(str, order))}\n",
            "a.obj": "".join(f"v {row}\n" for row in arrow.splitlines())
            + f"f {' '.join(str(i + 1) for i in order)}\n",
        }
        for name, text in texts.items():
            contents = read(tmp_path, name, text)
            a, b, c = (contents.vertices[contents.faces[:, i]] for i in range(3))
            assert np.cross(b - a, c - a)[:, 2].sum() / 2 == pytest.approx(1.0), name


def test_strips_of_a_ply(tmp_path: Path) -> None:
    strips = "tristrips property list int int vertex_indices\n"
    contents = read(tmp_path, "a.ply", ply(strips, "9 0 1 3 2 -1 -1 0 1 2\n3 0 2 3\n"))
    assert contents.faces.tolist() == [[0, 1, 3], [1, 2, 3], [0, 1, 2], [0, 2, 3]]
    no_faces = "element face 0\nproperty list uchar int vertex_indices\nelement tristrips"
    text = ply(strips, "3 0 2 3\n").replace("element tristrips", no_faces)
    assert read(tmp_path, "a.ply", text).faces.tolist() == [[0, 2, 3]]


@pytest.mark.parametrize("of_faces", [False, True])
def test_a_texture_of_a_ply(tmp_path: Path, of_faces: bool) -> None:
    image = Image.new("RGB", (2, 2), tuple(RED))
    image.paste(tuple(BLUE), (0, 0, 2, 1))  # the upper half
    image.save(tmp_path / "paint.png")
    head = "comment TextureFile paint.png\n"
    if of_faces:
        faces = CORNERS + "property list uchar float texcoord\n"
        rows = "3 0 1 2 6 .1 .1 .2 .1 .1 .2\n3 0 2 3 6 .1 .9 .2 .9 .1 .8\n"
        text = ply(faces, rows, head=head)
    else:
        points = "0 0 0 .1 .1\n1 0 0 .2 .1\n1 1 0 .1 .2\n0 1 0 .1 3.8\n"  # the last repeats it
        vertex = "property float s\nproperty float t\n"
        text = ply(CORNERS, "3 0 1 2\n3 0 2 3\n", vertex=vertex, head=head, points=points)
    contents = read(tmp_path, "a.ply", text)
    # The middle of the second face lies at 1.37 = .37 of the height without places of faces: red.
    assert contents.face_colors.tolist() == [RED, BLUE if of_faces else RED]
    if of_faces:  # more places than corners say nothing of these
        longer = text.replace("6 .1 .1 ", "8 .1 .1 .1 .1 ")
        assert read(tmp_path, "a.ply", longer).face_colors.tolist() == [GREY, GREY]
    (tmp_path / "paint.png").unlink()
    assert read(tmp_path, "a.ply", text).notes == ("the texture 'paint.png' is not there",)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("lengths", ["B", "i", "H"])
def test_binary_lists_of_several_lengths(tmp_path: Path, order: str, lengths: str) -> None:
    names = {"B": "uchar", "i": "int", "H": "ushort", "<": "little", ">": "big"}
    for rows in ([[0, 1, 2], [0, 2, 3]], [[0, 1, 2, 3], [0, 2, 3], [], [1, 2]]):
        head = f"ply\nformat binary_{names[order]}_endian 1.0\nelement face {len(rows)}\n"
        head += f"property uchar red\nproperty list {names[lengths]} int vertex_index\n"
        head += "property uchar green\nproperty uchar blue\nelement vertex 4\n"
        head += "".join(f"property double {axis}\n" for axis in "xyz") + "end_header\n"
        body = b"".join(
            struct.pack(f"{order}B{lengths}{len(row)}iBB", 10 * i, len(row), *row, i, 255)
            for i, row in enumerate(rows)
        )
        content = head.encode() + body + SQUARE.astype(f"{order}f8").tobytes()
        contents = read(tmp_path, "a.ply", content)
        np.testing.assert_array_equal(contents.vertices, SQUARE)
        assert contents.faces.tolist()[:2] == HALVES
        last = [10, 1, 255]
        assert contents.face_colors.tolist() == [[0, 0, 255]] * (len(rows) // 2) + [last]
        for cut in (1, 8 * 12 + 1):
            with pytest.raises(BadInput, match="cut short"):
                read(tmp_path, "a.ply", content[:-cut])


def test_a_header_of_a_ply_with_a_line_of_prose(tmp_path: Path) -> None:
    text = ply(CORNERS, "3 0 1 2\n", head="Created by Blender3D 247\nobj_info x\n")
    assert read(tmp_path, "a.ply", text).faces.tolist() == [[0, 1, 2]]
