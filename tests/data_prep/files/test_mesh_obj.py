"""OBJ files as people and programs write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from data_prep.failures import BadInput
from data_prep.files.meshes import read_contents
from data_prep.scene import NEUTRAL_GREY

GREY, RED, BLUE, GREEN = list(NEUTRAL_GREY), [255, 0, 0], [0, 0, 255], [0, 255, 0]
V = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
VT = "vt .2 .2\nvt .2 .3\nvt .3 .2\nvt .8 .2\nvt .8 .3\nvt .9 .2\n"
TWO = "usemtl red\nf 1 2 3\nusemtl blue\nf 1 3 4\n"
KD = "newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n"


def read(folder: Path, text: str | bytes, **files: str | bytes):
    """The contents of an OBJ; underscores in names of files stand for a point."""
    for name, content in {"a.obj": text, **files}.items():
        path = folder / name.replace("_", ".")
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_contents(folder / "a.obj")


@pytest.mark.parametrize(
    ("text", "faces"),
    [
        (V + "f 1 2 3\nf 1/9 3/9 4/9\n", [[0, 1, 2], [0, 2, 3]]),
        (V + "f 1//2 2//2 3//2\n", [[0, 1, 2]]),
        (V + VT + "f 1/1/1 2/2/1 3/3/1 4/4/1\n", [[0, 1, 2], [0, 2, 3]]),
        (V + "f -4 -3 -2\nv 9 9 9\nf -5/1 -4/1 -1/1\n", [[0, 1, 2], [0, 1, 4]]),
        (V + "f 1 2 3\nf -4 -2 -1\n", [[0, 1, 2], [0, 2, 3]]),
        ("\ufeff#x\r\n" + V.replace("\n", "\r\n") + "f 1 2 \\\r\n3\r\n", [[0, 1, 2]]),
        (V.replace(" ", "\t  ").replace("\n", " # 1\n") + "\n  f\t1 2\t3 #\n", [[0, 1, 2]]),
        (V.replace("\n", "\r") + "f 1 2 3\rf 1 2\rl 1 2\rp 1\rfo 1 3 4\r", [[0, 1, 2], [0, 2, 3]]),
        (V + "vn -1.#IND 0 0\nvn x\ng a b\ns off\no\nf 1//1 2//1 3//1\n", [[0, 1, 2]]),
        (V + "f 1/2/3 2//3 3/1 4\n", [[0, 1, 2], [0, 2, 3]]),
        (V + "# C:\\models\\\nf 1 2 3 # \\\nf 1 3 4", [[0, 1, 2], [0, 2, 3]]),
        (V + "f 1 2\\\n3\nf 1 3 \\ \n4\\", [[0, 1, 2], [0, 2, 3]]),
        ("v 0 0 0 1\nv 1 0 0 1.0\nv 0 1 0 0.5\nf 1 2 3\n", [[0, 1, 2]]),
        # Rows that have the same number of slashes, and not at the same places.
        (V + "f 1/2/3 2 4/5/6\nf 1 2/1/1 4 3//3\n", [[0, 1, 3], [0, 1, 3], [0, 3, 2]]),
    ],
)
def test_faces(tmp_path: Path, text: str, faces: list) -> None:
    contents = read(tmp_path, text)
    assert contents.faces.tolist() == faces
    assert contents.vertices[:2].tolist() == [[0, 0, 0], [1, 0, 0]]
    assert contents.notes == ()


@pytest.mark.parametrize(
    ("library", "name"),
    [
        ("mtllib a.mtl", "a_mtl"),
        ("mtllib b.mtl a.mtl", "a_mtl"),
        ("mtllib gone.mtl\nmtllib a.mtl", "a_mtl"),
        ('mtllib "a.mtl"', "a_mtl"),
        ('mtllib "my own.mtl" "a.mtl"', "a_mtl"),
        ("mtllib my own.mtl", "my own_mtl"),
        ("mtllib A.MTL", "a_mtl"),
        ("mtllib a.mtl", "A_Mtl"),
        (r"mtllib C:\Users\me\a.mtl", "a_mtl"),
        (r"mtllib .\a.mtl", "a_mtl"),
        ("mtllib ./sub/../a.mtl", "a_mtl"),
        ("mtllib /home/me/a.mtl", "a_mtl"),
    ],
)
def test_materials_are_found_as_people_name_them(tmp_path: Path, library: str, name: str) -> None:
    contents = read(tmp_path, f"{library}\n{V}{TWO}", **{name: KD})
    assert contents.face_colors.tolist() == [RED, BLUE]


def test_several_libraries(tmp_path: Path) -> None:
    files = {"a_mtl": KD.partition("newmtl blue")[0], "b_mtl": "newmtl blue\nKd 0 0 1\n"}
    libraries = "mtllib a.mtl\nmtllib b.mtl\nmtllib my own.mtl\n"
    contents = read(tmp_path, f"{libraries}{V}{TWO}", **files)
    assert contents.face_colors.tolist() == [RED, BLUE]
    assert contents.notes == ("the materials 'my own.mtl' are not there",)


@pytest.mark.parametrize("name", ["../a.mtl", "{}/a.mtl", "link.mtl"])
def test_materials_outside_the_folder_are_not_read(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.mtl").write_text(KD)
    folder = tmp_path / "mesh"
    folder.mkdir()
    (folder / "link.mtl").symlink_to(tmp_path / "a.mtl")
    contents = read(folder, f"mtllib {name.format(tmp_path)}\n{V}{TWO}")
    assert contents.face_colors.tolist() == [GREY, GREY]
    assert "are not there" in contents.notes[0]


@pytest.mark.parametrize(
    ("obj", "mtl", "colors", "note"),
    [
        (TWO, None, [GREY, GREY], "the materials 'a.mtl' are not there"),
        (TWO, "newmtl red\nKd 1 0 0\n", [RED, GREY], "the material 'blue' is in none of its"),
        (TWO, KD.upper().replace("NEWMTL", "newmtl"), [RED, BLUE], None),
        (
            TWO,
            "newmtl red\nKd 1\nnewmtl blue\nKd xyz 1 1 1\n",
            [[255] * 3, GREY],
            "'blue' has a colo",
        ),
        (
            TWO,
            "newmtl red\nKd 1 0 0 # of wood\nnewmtl blue\nKd 0,0 0 1\n",
            [RED, GREY],
            "'blue' has",
        ),
        (TWO, "newmtl red\nKd 1.0001 0 0\nnewmtl blue\nKd 0 0 255\n", [RED, BLUE], "beyond 0 to 1"),
        ("usemtl M #25\nf 1 2 3\n", "newmtl M #24\nKd 0 1 0\nnewmtl M #25\nKd 1 0 0", [RED], None),
        (
            "usemtl r\xf6t\nf 1 2 3\n",
            "newmtl r\xf6t\nKd 1 0 0\nnewmtl r\xfct\nKd 0 0 1",
            [RED],
            None,
        ),
        ("USEMTL red\nF 1 2 3\n", KD, [RED], None),
        (TWO, "newmtl red\nKd 1 \\\n0 0\nnewmtl blue\nKd 0 0 \\\r\n1\n", [RED, BLUE], None),
        # A second part of a material, or a colour of a kind that is not read, takes nothing away.
        (TWO, KD + "newmtl red\nKs 1 1 1\n", [RED, BLUE], None),
        (TWO, KD + "Kd spectral blue.rfl 1\n", [RED, BLUE], "'blue' has a colo"),
        ("usemtl gone\n" + TWO, KD, [RED, BLUE], None),  # it has no faces
        ("f 1 2 3\n" + TWO, KD, [GREY, RED, BLUE], None),
        ("usemtl red\nusemtl blue\nf 1 2 3 4\n", KD, [BLUE, BLUE], None),
        ("usemtl my red\nf 1 2 3\n", "newmtl my red\nKd 1 0 .5\n", [[255, 0, 128]], None),
        ("cstype bezier\nsurf 0 1 0 1 1 2 3 4\nf 1 2 3\n", KD, [GREY], "no polygons are left out"),
    ],
)
def test_diffuse_colours(tmp_path: Path, obj: str, mtl: str | None, colors, note) -> None:
    contents = read(tmp_path, f"mtllib a.mtl\n{V}{obj}", **({} if mtl is None else {"a_mtl": mtl}))
    assert contents.face_colors.tolist() == colors
    assert len(contents.notes) == (note is not None)
    assert note is None or note in contents.notes[0]


def textured(folder: Path, faces: str, texture: str):
    """An OBJ of a green material with a high texture: red left, blue right, black above."""
    image = Image.new("RGB", (4, 16), tuple(RED))
    image.paste(tuple(BLUE), (2, 0, 4, 16))
    image.paste((0, 0, 0), (0, 0, 4, 8))
    image.save(folder / "paint.png")
    materials = f"newmtl m\nKd 0 1 0\n{texture}"
    return read(folder, f"mtllib a.mtl\n{V}{VT}usemtl m\n{faces}", a_mtl=materials)


@pytest.mark.parametrize(
    ("texture", "colors"),
    [
        ("map_Kd paint.png", [RED, BLUE]),
        ("map_Kd -clamp on -mm 0 1 -bm 2.5 paint.png", [RED, BLUE]),
        ("map_Kd -s -1 1 1 paint.png", [BLUE, RED]),  # .23 mirrored is .77 of the next repetition
        ("map_Kd -s 2.5 paint.png", [BLUE, RED]),  # .58 and 2.08; upwards the scale stays 1
        ("map_Kd -o .5 0 0 paint.png", [BLUE, RED]),
        ("map_Kd -o .5 paint.png", [BLUE, RED]),  # upwards the shift stays 0
        ("map_Kd -o .5 -s 2 paint.png", [BLUE, RED]),  # 2 times .23 and .83, and then the shift
        ("map_Kd -t 0 0 0 paint.png", [RED, BLUE]),
        ("map_kd C:\\textures\\PAINT.PNG", [RED, BLUE]),
        ('map_Kd "paint.png"', [RED, BLUE]),
        ("map_Kd gone.png", [GREEN, GREEN]),
    ],
)
def test_textures(tmp_path: Path, texture: str, colors: list) -> None:
    contents = textured(tmp_path, "f 1/1 2/2 3/3\nf 1/4 3/5 4/6\n", texture)
    assert contents.face_colors.tolist() == colors
    assert contents.notes == (
        () if colors[0] != GREEN else ("the texture 'gone.png' is not there",)
    )


def test_names_that_are_no_utf_8_stay_apart(tmp_path: Path) -> None:
    obj = f"mtllib a.mtl\n{V}usemtl r\xf6t\nf 1 2 3\nusemtl r\xfct\nf 1 3 4\n".encode("latin-1")
    mtl = "newmtl r\xf6t\nKd 1 0 0\nnewmtl r\xfct\nKd 0 0 1\n".encode("latin-1")
    assert read(tmp_path, obj, a_mtl=mtl).face_colors.tolist() == [RED, BLUE]


def test_the_first_material_of_a_name_counts(tmp_path: Path) -> None:
    text = f"mtllib a.mtl b.mtl\n{V}usemtl red\nf 1 2 3\n"
    contents = read(tmp_path, text, a_mtl=KD, b_mtl="newmtl red\nKd 0 1 0\n")
    assert contents.face_colors.tolist() == [RED]


@pytest.mark.parametrize(
    ("text", "note"),
    [
        (V.replace("0 0 0", "0 0 0 1 0 0", 1) + "f 1 2 3\n", "only some vertices have colours"),
        (V.replace("\n", " -1 0 0\n") + "f 1 2 3\n", "drawn without colours of vertices: its col"),
        (V + "usemtl m\nf 1/7 2/7 3/7\n", "3 corners have places in a texture that are not there"),
    ],
)
def test_colours_that_are_left_out_are_told(tmp_path: Path, text: str, note: str) -> None:
    contents = read(tmp_path, f"mtllib a.mtl\n{text}", a_mtl="newmtl m\n")
    assert contents.face_colors.tolist() == [GREY]
    (line,) = contents.notes
    assert note in line


@pytest.mark.parametrize(
    ("faces", "colors", "beyond"),
    [
        ("f 1/-6 2/-5 3/-4\nf 1/-3 3/-2 4/-1\n" + "vt .5 .2\n" * 3, [RED, BLUE], 0),
        ("f 1/1 2/2 3/7\nf 1/4 3/5 4/6\n", [GREEN, BLUE], 1),  # of 6 places
        ("f 1/1 2/9 3/-9\nf 1/4 3/5 4/6\n", [GREEN, BLUE], 2),
        ("f 1/1 2/2 3\nf 1/4 3/5 4/6\n", [GREEN, BLUE], 0),
        ("f 1//1 2//2 3//3\nf 1//4 3//5 4//6\n", [GREEN, GREEN], 0),  # these are normals
    ],
)
def test_places_of_corners(tmp_path: Path, faces: str, colors: list, beyond: int) -> None:
    contents = textured(tmp_path, faces, "map_Kd paint.png")
    assert contents.face_colors.tolist() == colors
    told = (f"{beyond} corners have places in a texture that are not there",)
    assert contents.notes == (told if beyond else ())


def test_a_texture_of_too_many_pixels_is_refused(tmp_path: Path) -> None:
    (tmp_path / "big.ppm").write_bytes(b"P6 8193 8193 255\n")  # the head is enough to refuse it
    with pytest.raises(BadInput, match="8193 x 8193 pixels, at most 67108864 are read"):
        textured(tmp_path, "f 1/1 2/2 3/3\n", "map_Kd big.ppm")


@pytest.mark.parametrize(
    ("color", "colors"),
    [("65536 0 0", [RED, BLUE]), ("-1 0 0", [RED, BLUE]), ("0 1 0", [GREEN, GREEN])],
)
def test_colours_beside_numbers_that_are_none(tmp_path: Path, color: str, colors: list) -> None:
    rows = V.replace("0\n", f"0 {color}\n") + f"v 9 9 9 {color} 1\n"  # of six and seven numbers
    contents = read(tmp_path, f"mtllib a.mtl\n{rows}{TWO}", a_mtl=KD)
    assert contents.face_colors.tolist() == colors


@pytest.mark.parametrize("full", [1, 1.0001, 255])
def test_colours_of_vertices_come_before_diffuse_ones(tmp_path: Path, full: float) -> None:
    rows = [(full, 0, 0), (full, 0, 0), (full, 0, 0), (0, 0, full)]
    text = "".join(
        f"v {x} {y} 0 {r} {g} {b}\n"
        for (x, y), (r, g, b) in zip([(0, 0), (1, 0), (1, 1), (0, 1)], rows, strict=True)
    )
    contents = read(tmp_path, f"mtllib a.mtl\n{text}{TWO}", a_mtl=KD.replace("1", ".5"))
    assert contents.face_colors.tolist() == [RED, [170, 0, 85]]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (V + "f 0 1 2\n", "line 5: a face has index 0, and OBJ counts vertices from 1; add 1"),
        (V + "f 1 2 3\nf 0/1 1/1 2/1\n", "line 6: a face has index 0"),
        (V + "f 1 2 5\n", "line 5: a face has vertex 5, and there are 4"),
        (V + "f -5 -1 -2\n", "line 5: a face has vertex -5, and there are 4"),
        (V + "f 1 2 x\n", "line 5: 'x' is no corner of a face"),
        (V + "f 1/1/1/1 2/2/2/2 3/3/3/3\n", "line 5: '1/1/1/1' is no corner of a face"),
        (V + "f 1.5 2 3\n", "line 5: '1.5' is no corner of a face"),
        ("v 0 0\nf 1 1 1\n", "line 1: a vertex of 2 numbers, expected x, y and z"),
        ("v 0 0 0\nv 1,5 2,5 0\n", "line 2: '1,5' has a decimal comma; write numbers with a point"),
        ("v 0 0 0\nv one 0 0\n", "line 2: 'one' is no number"),
        ("v 0 \\\n0 0\nv 1 x 0\n", "line 3: 'x' is no number"),
        (V, "the mesh has no faces"),
        ("<svg width='9'>no mesh</svg>", "XML; export it as .obj"),
        (
            "404: Not Found\n",
            "no line of it is a vertex (v x y z); it is no OBJ, or has no vertices",
        ),
        ("v 0 0 0\nv 1_0 0 0\n", "line 2: '1_0' is no number"),
        ("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n", "git lfs pull"),
    ],
)
def test_refusals_name_the_line_and_the_remedy(tmp_path: Path, text: str, problem: str) -> None:
    with pytest.raises(BadInput) as failure:
        read(tmp_path, text)
    assert str(failure.value).startswith(f"{tmp_path / 'a.obj'}: ")
    assert problem in str(failure.value)


def test_a_large_file_is_read_as_a_small_one(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(300, 3))
    faces = rng.integers(0, 300, (500, 3))
    rows = "".join("v {} {} {}\n".format(*map(repr, row)) for row in points.tolist())
    for form in ("{0}", "{0}/{0}", "{0}//{0}", "{0}/{0}/{0}", "{1}"):
        text = rows
        for face in faces:
            corners = (form.format(index + 1, index - 300) for index in face.tolist())
            text += f"f {' '.join(corners)}\n"
        contents = read(tmp_path, text)
        np.testing.assert_array_equal(contents.vertices, points)
        np.testing.assert_array_equal(contents.faces, faces)
