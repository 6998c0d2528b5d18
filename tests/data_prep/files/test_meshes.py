from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from data_prep.clouds.sampling import face_areas
from data_prep.failures import BadInput
from data_prep.files.mesh_resources import MeshResources
from data_prep.files.meshes import SUFFIXES, load_mesh
from data_prep.scene import NEUTRAL_GREY, Mesh
from tests.data_prep.dataset_trees import gltf_binary

GREY = list(NEUTRAL_GREY)
# Coordinates are rounded to float32 in the file and once more at the end: 2**-24 of each.
ROUNDING = 2.0**-23

# A tetrahedron: centred at (0.5, 0.5, 0.5), its three far corners at sqrt(3) / 2.
VERTICES = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
FACES = [(0, 2, 1), (0, 3, 2), (0, 1, 3), (1, 2, 3)]


BOX = trimesh.creation.box((0.4, 0.6, 1.2))


def ply(
    vertices: object = VERTICES, faces: object = FACES, vertex_extra: str = "", face_extra: str = ""
) -> str:
    """ASCII PLY; the extra properties' values follow in the rows of `vertices` and `faces`."""
    head = f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\n"
    head += "property float x\nproperty float y\nproperty float z\n" + vertex_extra
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\n" + face_extra
    rows = [" ".join(map(str, row)) for row in vertices]
    count = 3 if face_extra else None
    rows += [" ".join(map(str, (count or len(row), *row))) for row in faces]
    return head + "\n".join(["end_header", *rows]) + "\n"


def channels(kind: str) -> str:
    return "".join(f"property {kind} {name}\n" for name in ("red", "green", "blue"))


def glb(positions: object = VERTICES, faces: object = FACES, **changes: object) -> bytes:
    """A binary glTF of one mesh, written out by hand; `changes` replace parts of its tree."""
    points, indices = np.array(positions, "<f4"), np.array(faces, "<u2")
    blob = points.tobytes() + indices.tobytes()
    return gltf_binary(json.loads(glb_tree(points, indices, **changes)), blob)


def glb_tree(points: np.ndarray, indices: np.ndarray, **changes: object) -> str:
    """The JSON of such a file."""
    count, size = len(points), points.nbytes
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": indices.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": size},
            {"buffer": 0, "byteOffset": size, "byteLength": indices.nbytes},
        ],
        "buffers": [{"byteLength": size + indices.nbytes}],
    } | changes
    return json.dumps(tree)


def load(tmp_path: Path, name: str, content: str | bytes) -> Mesh:
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return load_mesh(path)


def triangles(mesh: Mesh) -> np.ndarray:
    """Corners [F, 3, 3] of each face, whatever the vertices' order."""
    return mesh.vertices.astype(np.float64)[mesh.faces]


def export(mesh: trimesh.Trimesh, folder: Path, suffix: str) -> Path:
    exported = mesh.export(file_type=suffix.removeprefix("."))
    if isinstance(exported, dict):  # glTF: the tree and its buffers
        for name, content in exported.items():
            (folder / name).write_bytes(content)
        return folder / "model.gltf"
    path = folder / f"box{suffix}"
    path.write_bytes(exported if isinstance(exported, bytes) else exported.encode())
    return path


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_box_in_every_format(tmp_path: Path, suffix: str) -> None:
    source = BOX.copy()
    source.visual.vertex_colors = np.tile([200, 100, 50, 255], (8, 1))
    mesh = load_mesh(export(source, tmp_path, suffix))
    # Half edges 0.2, 0.3 and 0.6 reach a radius of exactly 0.7. Text formats keep 8 decimals.
    expected = source.triangles / 0.7
    np.testing.assert_allclose(triangles(mesh), expected, rtol=0, atol=ROUNDING + 2e-8)
    expected_color = [200, 100, 50]
    if suffix in (".off", ".stl"):  # as trimesh writes them, these two have no colours
        expected_color = GREY
    if suffix in (".glb", ".gltf"):  # whose colours of vertices are linear
        expected_color = [229, 168, 122]  # 255 (1.055 (c / 255)^(1 / 2.4) - 0.055), rounded
    assert mesh.face_colors.tolist() == [expected_color] * 12


def test_vertices_are_not_merged_and_faces_are_kept(tmp_path: Path) -> None:
    # Two triangles that touch along an edge, each with corners of its own.
    vertices = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (9, 9, 9)]
    faces = [(0, 1, 2), (3, 4, 5), (0, 1, 2), (1, 1, 2)]  # one twice, one without area
    mesh = load(tmp_path, "SPLIT.PLY", ply(vertices, faces))
    assert len(mesh.vertices) == 7  # the unused one stays too
    assert mesh.faces.tolist() == [list(face) for face in faces]


def test_quads_become_triangles(tmp_path: Path) -> None:
    square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    for name, text in (
        ("a.ply", ply(square, [(0, 1, 2, 3)])),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"),
        ("a.off", "OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n"),
    ):
        # Two triangles of equal area: a square of side 1 over a radius of sqrt(0.5) has area 2.
        areas = face_areas(load(tmp_path, name, text))
        assert areas.tolist() == pytest.approx([1.0, 1.0], abs=1e-6), name


def test_several_parts_become_one(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    for shift, color in ((-1.0, [255, 0, 0, 255]), (1.0, [0, 0, 255, 128])):
        part = trimesh.creation.box((1, 1, 1))
        part.visual.vertex_colors = np.tile(color, (8, 1))
        place = trimesh.transformations.translation_matrix([shift, 0, 0])
        scene.add_geometry(part, transform=place)
    scene.add_geometry(trimesh.PointCloud([[50, 0, 0], [0, 50, 0]]))  # counts for nothing
    mesh = load(tmp_path, "parts.glb", scene.export(file_type="glb"))
    assert mesh.faces.shape == (24, 3)
    middle = triangles(mesh).mean(axis=(1))[:, 0]
    red = (mesh.face_colors == (255, 0, 0)).all(axis=1)
    blue = (mesh.face_colors == (0, 0, 255)).all(axis=1)  # transparency is dropped
    assert red.sum() == blue.sum() == 12
    np.testing.assert_array_equal(middle < 0, red)
    # Half extents 1.5, 0.5 and 0.5.
    expected = np.array([1.5, 0.5, 0.5]) / np.sqrt(2.75)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), expected, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize(("kind", "full"), [("uchar", 255), ("float", 1.0)])
def test_face_colours(tmp_path: Path, kind: str, full: float) -> None:
    faces = [(*f, full * (k % 2), 0, full) for k, f in enumerate(FACES)]
    mesh = load(tmp_path, "a.ply", ply(faces=faces, face_extra=channels(kind)))
    assert mesh.face_colors.tolist() == [[0, 0, 255], [255, 0, 255]] * 2


def test_vertex_colours_are_averaged_over_a_face(tmp_path: Path) -> None:
    shades = [(255, 0, 0), (0, 255, 0), (0, 0, 90), (60, 0, 0)]
    vertices = [(*v, *c) for v, c in zip(VERTICES, shades, strict=True)]
    mesh = load(tmp_path, "a.ply", ply(vertices, vertex_extra=channels("uchar")))
    expected = [np.mean([shades[i] for i in face], axis=0) for face in FACES]
    assert np.abs(mesh.face_colors - expected).max() < 1  # a mean is cut or rounded


def textured_obj(folder: Path, material: str | None) -> str:
    """Two triangles whose middles lie in the left and in the right half of the texture.

    One corner of each lies in the other half, and their vertices are shared.
    """
    if material is not None:
        (folder / "a.mtl").write_text(f"newmtl paint\n{material}\n")
    image = Image.new("RGB", (8, 8), (10, 200, 30))
    image.paste((240, 20, 60), (4, 0, 8, 8))
    image.save(folder / "paint.png")
    return (
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
        "vt 0.1 0.1\nvt 0.9 0.1\nvt 0.1 0.9\nvt 0.1 0.1\nvt 0.9 0.1\nvt 0.9 0.9\n"
        "usemtl paint\nf 1/1 2/2 3/3\nf 1/4 2/5 4/6\n"
    )


@pytest.mark.parametrize(
    ("material", "expected"),
    [
        ("Kd 1 1 1\nmap_Kd paint.png", [[10, 200, 30], [240, 20, 60]]),
        ("Kd 1 0 0.2", [[255, 0, 51]] * 2),
        ("Kd 1 0 0.2\nmap_Kd gone.png", [[255, 0, 51]] * 2),
        ("Kd 0 1 0\nmap_Kd broken.png", [[0, 255, 0]] * 2),
        ("map_Kd gone.png", [GREY] * 2),
        ("Ns 5", [GREY] * 2),
        (None, [GREY] * 2),
    ],
)
def test_textures_become_face_colours(tmp_path: Path, material: str, expected: list) -> None:
    (tmp_path / "broken.png").write_bytes(b"not an image")
    mesh = load(tmp_path, "a.obj", textured_obj(tmp_path, material))
    assert mesh.face_colors.tolist() == expected
    assert np.ptp(mesh.vertices, axis=0).min() > 0.5  # the shape is unharmed


def test_material_of_a_glb_and_neutral_grey_without(tmp_path: Path) -> None:
    for name, content in (("a.ply", ply()), ("a.glb", glb())):
        assert load(tmp_path, name, content).face_colors.tolist() == [GREY] * 4
    materials = [{"pbrMetallicRoughness": {"baseColorFactor": [0, 1, 0, 0.5]}}]
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, "material": 0}
    content = glb(materials=materials, meshes=[{"primitives": [primitive]}])
    assert load(tmp_path, "a.glb", content).face_colors.tolist() == [[0, 255, 0]] * 4


def truncated(suffix: str, share: float) -> bytes:
    content = BOX.export(file_type=suffix.removeprefix("."))
    content = content if isinstance(content, bytes) else content.encode()
    return content[: int(share * len(content))]


NAN, INF, HUGE = ((value, 0, 0) for value in ("nan", "inf", "1e300"))
STL = "solid a\nfacet normal 0 0 1\nouter loop\n{}endloop\nendfacet\nendsolid a\n"
BROKEN = {
    "text.ply": ("hello world\n" * 5, "no PLY header"),
    "text.stl": ("hello world\n" * 5, "no STL of text, and as a binary one"),
    "empty.ply": ("", "an empty file; fetch or write it again"),
    "bytes.stl": (bytes(range(256)) * 9, "no STL of text, and as a binary one it would have"),
    "cut-0.99.ply": (truncated(".ply", 0.99), "12 rows of 'face' .* cut short"),
    "cut-0.5.stl": (truncated(".stl", 0.5), "12 triangles, 684 bytes, of which 342 are there"),
    "cut-0.99.glb": (truncated(".glb", 0.99), "a chunk of .* bytes reaches beyond the end"),
    "cut-0.5.off": (truncated(".off", 0.5), "not the vertices and faces that its counts"),
    "points.ply": (trimesh.PointCloud(np.eye(3)).export(file_type="ply"), "no faces"),
    "lines.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2\nl 2 3\n", "no faces"),
    "zero-faces.ply": (ply(faces=[]), "no faces; a bare point cloud cannot be scored"),
    "nan.ply": (ply([NAN, *VERTICES[1:]]), "1 non-finite vertices of 4"),
    "nan.glb": (glb([(np.nan, 0, 0), *VERTICES[1:]]), "1 non-finite"),
    "huge.ply": (ply([HUGE, *VERTICES[1:]]), "1 non-finite"),
    "huge.stl": (STL.format("vertex 1e300 0 0\nvertex 1 0 0\nvertex 0 1 0\n"), "1 non-finite"),
    "range.ply": (ply(faces=[*FACES, (0, 1, 9)]), "the vertices 0 to 9, of 4"),
    "negative.ply": (ply(faces=[*FACES, (0, 1, -1)]), "the vertices -1 to 3, of 4"),
    "range.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 9\n", "line 5: .* vertex 9, .* 3"),
    "range.off": ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "the vertices 0 to 7, of 3"),
    "range.glb": (glb(faces=[*FACES, (0, 1, 77)]), "the vertices 0 to 77, of 4"),
    "flat.obj": ("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "line 1: a vertex of 2 numbers"),
    "line.ply": (ply([(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)]), "faces have no area"),
    "one-place.ply": (ply([(1, 1, 1)] * 4), "all 4 vertices"),
    "squashed.glb": (glb(nodes=[{"mesh": 0, "scale": [0, 0, 0]}]), "all 4 vertices"),
    "no-buffer.gltf": (
        glb_tree(
            np.zeros((4, 3), "<f4"),
            np.zeros(12, "<u2"),
            buffers=[{"byteLength": 9, "uri": "x.bin"}],
        ),
        "its buffer 0, the file 'x.bin', is not there; put it beside this one",
    ),
    "mesh.txt": ("0 0 0\n1 0 0\n", "no mesh by its name"),
    "mesh": ("", r"no mesh by its name; use one of \.ply, \.obj, \.off, \.stl, \.glb, \.gltf"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_one_line_names_the_file_and_the_problem(tmp_path: Path, name: str) -> None:
    content, problem = BROKEN[name]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with pytest.raises(BadInput, match=problem) as failure:
            load(tmp_path, name, content)
    assert [str(warning.message) for warning in caught] == []
    message = str(failure.value)
    assert message.startswith(f"{tmp_path / name}: ")
    assert "\n" not in message
    assert len(message) < len(str(tmp_path)) + 300


def test_files_of_a_mesh_are_read_up_to_a_size_of_all_together(tmp_path: Path) -> None:
    for name in ("a.bin", "b.bin", "c.bin"):
        (tmp_path / name).write_bytes(bytes(5))
    resources = MeshResources(tmp_path, most_bytes=10)
    assert resources.read("a.bin") == resources.read("b.bin") == bytes(5)
    with pytest.raises(BadInput, match=r"c\.bin"):
        resources.read("c.bin")


def test_the_largest_float32_are_no_problem(tmp_path: Path) -> None:
    big = 3e38  # the sum of two overflows in float32
    mesh = load(tmp_path, "a.ply", ply([(-big, 0, 0), (big, 0, 0), (0, big, 0)], [(0, 1, 2)]))
    # Box 2 x 1 in units of 3e38: radius sqrt(1.25).
    expected = np.array([[-1, -0.5, 0], [1, -0.5, 0], [0, 0.5, 0]]) / np.sqrt(1.25)
    np.testing.assert_allclose(mesh.vertices, expected, rtol=0, atol=ROUNDING)
