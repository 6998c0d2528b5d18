"""Meshes of datasets: far from the origin, and the files behind them."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from data_prep.clouds.orientations import PAPER
from data_prep.datasets.registry import open_dataset
from data_prep.datasets.stored_meshes import MeshFile
from data_prep.files.meshes import LOADER_VERSION
from data_prep.randomness import generator
from data_prep.scene import NEUTRAL_GREY, View

BALL = trimesh.creation.icosphere(subdivisions=2)
FACES = "".join("3 {} {} {}\n".format(*face) for face in BALL.faces)
OBJ_FACES = "".join("f {} {} {}\n".format(*face + 1) for face in BALL.faces)
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"


def rows(vertices, before: str = "") -> str:
    return "".join(f"{before}{x!r} {y!r} {z!r}\n" for x, y, z in vertices.tolist())


def text_ply(kind: str):
    axes = "".join(f"property {kind} {axis}\n" for axis in "xyz")
    head = f"ply\nformat ascii 1.0\nelement vertex {len(BALL.vertices)}\n{axes}"
    head += f"element face {len(BALL.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    return lambda vertices: head + rows(vertices) + FACES


def text_stl(vertices) -> str:
    facets = (rows(vertices[face], "vertex ") for face in BALL.faces)
    text = "".join(f"facet normal 0 0 0\nouter loop\n{f}endloop\nendfacet\n" for f in facets)
    return f"solid a\n{text}endsolid a\n"


def placed_glb(vertices):
    """The ball in float32 near the origin, and its place in a node."""
    scene = trimesh.Scene()
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    scene.add_geometry(BALL, transform=trimesh.transformations.translation_matrix(middle))
    return scene.export(file_type="glb")


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("a.obj", lambda v: rows(v, "v ") + OBJ_FACES),
        ("a.off", lambda v: f"OFF\n{len(v)} {len(BALL.faces)} 0\n{rows(v)}{FACES}"),
        ("a.stl", text_stl),
        ("double.ply", text_ply("double")),
        ("float.ply", text_ply("float")),
        ("a.glb", placed_glb),
    ],
)  # fmt: skip
@pytest.mark.parametrize("offset", [100.0, 5e5, 1e7])
def test_a_mesh_far_from_the_origin_is_the_mesh_at_the_origin(tmp_path, name, write, offset):
    clouds, images = [], []
    for place in (0.0, offset):
        content = write(BALL.vertices + place)
        folder = tmp_path / str(place)
        folder.mkdir()
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
        obj = open_dataset(f"folder:{folder}").objects("any", 1, 1)[0]
        lengths = np.linalg.norm(obj.load().vertices.astype(np.float64), axis=1)
        # float64 keeps 1e-9 at 1e7; float32, in which vertices are, 6e-8 of 1
        np.testing.assert_allclose(lengths, 1.0, rtol=0, atol=2e-7)
        cloud, truth = obj.cloud_and_truth(generator("far"), (View(20.0, 10.0),))
        clouds.append(cloud.points)
        images.append(truth.astype(int))
    np.testing.assert_allclose(clouds[0], clouds[1], rtol=0, atol=1e-6)
    assert np.mean(images[0] != images[1]) < 0.001  # pixels on an edge


def png(grey: int) -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (2, 2), (grey, 0, 0)).save(file, "PNG")
    return file.getvalue()


def gltf(buffer: dict, **changes) -> bytes:
    views = [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}]
    accessors = [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
                 {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"}]  # fmt: skip
    primitive = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}
    tree = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": 60, **buffer}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        **changes,
    }
    return json.dumps(tree).replace("tex/a.png", "tex\\/a.png").encode()  # as PHP writes it


def corners(x: float) -> bytes:
    return np.array([0, 0, 0, x, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1], "<f4").tobytes()


INLINE = {"uri": "data:application/octet-stream;base64," + base64.b64encode(corners(1)).decode()}
FACE = "usemtl m\nf 1/1 2/2 3/3\n"
TEXTURED_PLY = (
    "ply\nformat ascii 1.0\ncomment TextureFile tex/a.png\nelement vertex 3\nproperty float x\n"
    "property float y\nproperty float z\nproperty float s\nproperty float t\nelement face 1\n"
    "property list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
)
BEHIND = {
    "a material of another name": (
        "a.obj", f"mtllib shared.mtl\n{OBJ}{FACE}", {}, "shared.mtl", "newmtl m\nKd {} 0 0\n"),
    "a material in a folder": (
        "a.obj", f"{OBJ}mtllib m/of all.mtl \r\n{FACE}", {}, "m/of all.mtl",
        "newmtl m\nKd {} 0 0"),
    "a material after a backslash": (
        "a.obj", f"mtllib sha\\\nred.mtl\n{OBJ}{FACE}", {}, "shared.mtl", "newmtl m\nKd {} 0 0\n"),
    "a texture of a material": (
        "a.obj", f"mtllib a.mtl\n{OBJ}{FACE}", {"a.mtl": "newmtl m\n  MAP_Kd tex/a.png\n"},
        "tex/a.png", png),
    "a texture that is elsewhere by its path": (
        "a.obj", f"mtllib C:/x/b.mtl\n{OBJ}{FACE}", {"b.mtl": "newmtl m\nmap_Kd /other/a.png\n"},
        "a.png", png),
    "a texture of a PLY": ("a.ply", TEXTURED_PLY, {}, "tex/a.png", png),
    "a buffer of a glTF": (
        "a.gltf", gltf({"uri": "b/g.bin"}), {}, "b/g.bin", lambda level: corners(1 + level)),
    "an image of a glTF": (
        "a.gltf", gltf(INLINE, images=[{"uri": "tex/a.png"}]), {}, "tex/a.png", png),
}  # fmt: skip


@pytest.mark.parametrize("own_folder", [False, True])
@pytest.mark.parametrize("case", BEHIND)
def test_a_file_behind_a_mesh_changes_its_fingerprint(tmp_path, case, own_folder):
    name, mesh, files, changing, write = BEHIND[case]

    def put(file, content):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_bytes(content if isinstance(content, bytes) else content.encode())

    for file, content in {name: mesh, **files}.items():
        put(file, content)
    path = tmp_path / name
    obj = MeshFile("c", name, path, tmp_path if own_folder else None)
    meshes, fingerprints = [], []
    for level in (0, 1):
        put(changing, write(200 * level) if callable(write) else write.format(level))
        meshes.append(obj.load())
        fingerprints.append(obj.fingerprint())
    other = meshes[0].face_colors.tolist() != meshes[1].face_colors.tolist()
    assert other or meshes[0].vertices.tolist() != meshes[1].vertices.tolist()
    assert fingerprints[0] != fingerprints[1]
    assert obj.fingerprint() == fingerprints[1]


def test_the_fingerprint_is_that_of_the_contents_and_of_companions(tmp_path: Path) -> None:
    def digest(*contents: bytes) -> str:
        return hashlib.sha256(
            b"".join((f"loader {LOADER_VERSION}".encode(), *contents))
        ).hexdigest()

    obj = MeshFile("c", "a.obj", tmp_path / "a.obj")
    assert obj.fingerprint() == "unreadable: no such file"
    text = f"mtllib gone.mtl\n{OBJ}f 1 2 3\n"
    obj.path.write_text(text)
    assert obj.fingerprint() == digest(text.encode())
    assert replace(obj, orientation=PAPER).fingerprint() != obj.fingerprint()
    # Nor do other objects' files count, nor companions that are no files.
    (tmp_path / "ab.mtl").write_text("newmtl m\nKd 1 0 0\n")
    (tmp_path / "b.png").write_bytes(png(1))
    (tmp_path / "a.textures").mkdir()
    os.mkfifo(tmp_path / "a.pipe")  # whose reader would wait for ever
    (tmp_path / "a.zero").symlink_to("/dev/zero")
    (tmp_path / "a.loop").symlink_to("a.loop")
    assert obj.fingerprint() == digest(text.encode())
    twin = MeshFile("d", "b.obj", tmp_path / "b.obj")
    twin.path.write_text(text)
    (tmp_path / "b.png").unlink()
    assert twin.fingerprint() == obj.fingerprint()
    Path(os.fsdecode(os.fsencode(tmp_path) + b"/a.\xff")).write_bytes(b"x")
    assert obj.fingerprint() == digest(text.encode(), b"a.\xff", b"x")
    for name in ("a.mtl", "a.obj"):
        with (tmp_path / name).open("wb") as file:
            file.truncate(2**40)  # sparse: what is too large takes no time
        assert obj.fingerprint().startswith("unreadable: 1099511627776 bytes, and at most")
        (tmp_path / name).write_bytes(b"v")


PLACES = ["0 0 0", "1 0 0", "1 1 0", "0 1 0", "0 0 1"]
RED, GREEN, BLUE = [255, 0, 0], [0, 255, 0], [0, 0, 255]
GREY = list(NEUTRAL_GREY)


@pytest.mark.parametrize(
    ("kind", "of_vertices", "faces", "expected"),
    [
        ("OFF", "", ["3 0 1 2 255 0 0", "3 0 1 3 0 255 0 128"], [RED, GREEN]),
        ("OFF", "", ["3 0 1 2 1.0 0.0 0.0", "3 0 1 3 0. 0. 1. 0.5"], [RED, BLUE]),
        ("OFF", "", ["4 0 1 2 3 255 0 0", "3 0 1 4 0 255 0", "4 1 2 3 4 0 0 255"],
         [RED, RED, GREEN, BLUE, BLUE]),
        ("OFF", "", ["3 0 1 2", "3 0 1 3 0 0 255", "3 0 1 4 7"], [GREY, BLUE, GREY]),
        ("OFF", "", ["3 0 1 2", "3 0 1 3"], [GREY, GREY]),
        ("OFF", "", ["3 0 1 2 red as wine", "3 0 1 3 0 255 0"], [GREY, GREY]),
        ("COFF", " 0 0 255 255", ["3 0 1 2", "3 0 1 3"], [BLUE, BLUE]),
        ("COFF", " 0.0 1.0 0.0", ["3 0 1 2"], [GREEN]),
        ("COFF", " 0 1 0 1", ["3 0 1 2"], [GREEN]),  # none is above 1, so that they are fractions
        ("OFF", "", ["3 0 1 2 1 0 0", "3 0 1 3 0. 0. 1. 0.5"], [RED, BLUE]),
        ("CNOFF", " 0 0 1 255 0 0 255", ["3 0 1 2"], [RED]),
        ("NOFF", " 0 0 1", ["3 0 1 2"], [GREY]),
    ],
)  # fmt: skip
def test_colours_of_an_off_are_drawn(tmp_path: Path, kind, of_vertices, faces, expected) -> None:
    rows = [f"{place}{of_vertices}" for place in PLACES] + faces
    (tmp_path / "a.off").write_text("\n".join([kind, f"5 {len(faces)} 0", *rows]) + "\n")
    obj = open_dataset(f"folder:{tmp_path}").objects("any", 1, 1)[0]
    assert obj.load().face_colors.tolist() == expected
