"""glTF 2.0 as its specification has it: geometry, scenes and colours."""

from __future__ import annotations

import base64
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from data_prep.failures import BadInput
from data_prep.files.mesh_contents import NotAMesh
from data_prep.files.mesh_gltf import read_gltf
from data_prep.files.mesh_resources import MeshResources
from data_prep.files.meshes import read_contents
from data_prep.scene import NEUTRAL_GREY
from tests.data_prep.dataset_trees import gltf_binary

GREY, RED, BLUE = list(NEUTRAL_GREY), [255, 0, 0], [0, 0, 255]
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
KINDS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Gltf:
    """A glTF that is built up from arrays."""

    def __init__(self, **tree: Any) -> None:
        self.tree = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "bufferViews": [],
            "accessors": [],
        } | tree
        self.blob = b""

    def view(self, data: bytes, **more: Any) -> int:
        self.blob += bytes(-len(self.blob) % 4)
        view = {"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data)} | more
        self.tree["bufferViews"].append(view)
        self.blob += data
        return len(self.tree["bufferViews"]) - 1

    def array(self, values: Any, kind: str = "f4", **more: Any) -> int:
        table = np.array(values, f"<{kind}")
        table = table.reshape(len(table), -1)
        accessor = {
            "bufferView": self.view(table.tobytes()),
            "componentType": KINDS[kind],
            "count": len(table),
            "type": TYPES[table.shape[1]],
        } | more
        self.tree["accessors"].append(accessor)
        return len(self.tree["accessors"]) - 1

    def mesh(self, *primitives: dict[str, Any], **more: Any) -> Gltf:
        self.tree.setdefault("meshes", []).append({"primitives": list(primitives)} | more)
        return self

    def read(self, folder: Path, embedded: bool = False):
        if not embedded:
            tree = {**self.tree, "buffers": [{"byteLength": len(self.blob)}]}
            (folder / "a.glb").write_bytes(gltf_binary(tree, self.blob))
            return read_contents(folder / "a.glb")
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.blob).decode()
        tree = {**self.tree, "buffers": [{"byteLength": len(self.blob), "uri": uri}]}
        (folder / "a.gltf").write_text(json.dumps(tree))
        return read_contents(folder / "a.gltf")


def square(gltf: Gltf, **more: Any) -> dict[str, Any]:
    """A primitive of two triangles."""
    indices = gltf.array([0, 1, 2, 0, 2, 3], "u2")
    return {"attributes": {"POSITION": gltf.array(CORNERS)}, "indices": indices} | more


def one_square(**tree: Any) -> Gltf:
    gltf = Gltf(**tree)
    return gltf.mesh(square(gltf))


@pytest.mark.parametrize("embedded", [False, True])
@pytest.mark.parametrize(
    ("mode", "corners"),
    [
        (None, [[0, 1, 2]]),  # the two corners left are no triangle
        (4, [[0, 1, 2]]),
        (5, [[0, 1, 2], [1, 0, 2], [2, 0, 3]]),  # every second one is turned round
        (6, [[0, 1, 2], [0, 2, 0], [0, 0, 3]]),
    ],
)
def test_modes_of_primitives(tmp_path: Path, mode, corners, embedded: bool) -> None:
    gltf = Gltf()
    for kind in ("u1", "u2", "u4"):
        points, indices = gltf.array(CORNERS), gltf.array([0, 1, 2, 0, 3], kind)
        primitive = {"attributes": {"POSITION": points}, "indices": indices}
        gltf.mesh(primitive | ({} if mode is None else {"mode": mode}))
    gltf.mesh({"attributes": {"POSITION": points}, "mode": 1}, {"attributes": {}})
    gltf.tree |= {"nodes": [{"mesh": i} for i in range(4)], "scenes": [{"nodes": [0, 1, 2, 3]}]}
    contents = gltf.read(tmp_path, embedded)
    expected = np.tile(CORNERS[corners], (3, 1, 1))
    np.testing.assert_array_equal(contents.vertices[contents.faces], expected)


@pytest.mark.parametrize(
    ("values", "kind", "expected"),
    [
        (CORNERS * 255, "u1", CORNERS),
        (CORNERS * 127, "i1", CORNERS),
        (CORNERS * -128, "i1", -CORNERS),  # -128 is -1, as -127 is
        (CORNERS * 65535, "u2", CORNERS),
        (CORNERS * 32767, "i2", CORNERS),
    ],
)
def test_normalised_integers(tmp_path: Path, values, kind: str, expected) -> None:
    for normalized in (True, False):
        gltf = Gltf(extensionsRequired=["KHR_mesh_quantization"])
        gltf.mesh({"attributes": {"POSITION": gltf.array(values, kind, normalized=normalized)}})
        gltf.tree["accessors"][0]["count"] = 3
        read = gltf.read(tmp_path).vertices
        np.testing.assert_array_equal(read, (expected if normalized else values)[:3])


def test_strides_offsets_and_sparse_accessors(tmp_path: Path) -> None:
    gltf = Gltf()
    rows = np.zeros((3, 5), "<f4")
    rows[:, 1:4] = CORNERS[:3]
    gltf.tree["accessors"] = [
        {
            "bufferView": gltf.view(rows.tobytes(), byteStride=20),
            "byteOffset": 4,
            "componentType": 5126,
            "count": 3,
            "type": "VEC3",
            "sparse": {
                "count": 1,
                "indices": {"bufferView": gltf.view(b"\2"), "componentType": 5121},
                "values": {"bufferView": gltf.view(np.array([7, 8, 9], "<f4").tobytes())},
            },
        }
    ]
    contents = gltf.mesh({"attributes": {"POSITION": 0}}).read(tmp_path)
    assert contents.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [7, 8, 9]]
    del gltf.tree["accessors"][0]["bufferView"]  # zeros, but for the sparse ones
    assert gltf.read(tmp_path).vertices.tolist() == [[0, 0, 0], [0, 0, 0], [7, 8, 9]]


TURN = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]  # by 90 degrees around z: x becomes y


def matrix(*shift: float) -> list[float]:
    """A shift, by columns."""
    return [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, *shift, 1]


@pytest.mark.parametrize(
    ("nodes", "places"),
    [
        ([{"mesh": 0, "translation": [1, 2, 3], "scale": [2, 1, 1]}], {(1, 2, 3), (3, 2, 3)}),
        ([{"mesh": 0, "rotation": TURN, "scale": [3, 1, 1]}], {(0, 0, 0), (0, 3, 0)}),
        ([{"mesh": 0, "matrix": matrix(5, 0, 0)}], {(5, 0, 0), (6, 0, 0)}),
        (
            [{"children": [1, 2], "scale": [2, 2, 2]},
             {"mesh": 0, "translation": [1, 0, 0]}, {"mesh": 0, "matrix": matrix(0, 0, 4)}],
            {(2, 0, 0), (4, 0, 0), (0, 0, 8), (2, 0, 8)},
        ),
        ([{"mesh": 0}, {"mesh": 0, "translation": [9, 9, 9]}], {(0, 0, 0), (1, 0, 0)}),
        ([{"mesh": 0, "rotation": [0, 0, 0, 0]}], {(0, 0, 0), (1, 0, 0)}),
        (  # a turn by which x becomes y, y becomes z, and z becomes x
            [{"children": [1], "rotation": [0.5, 0.5, 0.5, 0.5]},
             {"mesh": 0, "translation": [1, 2, 3]}],
            {(3, 1, 2), (3, 2, 2)},
        ),
    ],
)  # fmt: skip
def test_nodes_of_the_default_scene(tmp_path: Path, nodes, places: set) -> None:
    contents = one_square(nodes=nodes).read(tmp_path)
    first_edges = contents.vertices.reshape(-1, 4, 3)[:, :2].reshape(-1, 3)
    assert {tuple(np.round(p, 6).tolist()) for p in first_edges} == places


def test_the_default_scene_need_not_be_the_first(tmp_path: Path) -> None:
    nodes = [{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 7]}]
    contents = one_square(scene=1, scenes=[{"nodes": [0]}, {"nodes": [1]}], nodes=nodes)
    assert contents.read(tmp_path).vertices[:, 2].tolist() == [7] * 4


def test_without_scenes_all_roots_are_drawn(tmp_path: Path) -> None:
    gltf = one_square(nodes=[{"mesh": 0, "children": [1]}, {"mesh": 0}, {"mesh": 0}])
    del gltf.tree["scenes"], gltf.tree["scene"]
    assert len(gltf.read(tmp_path).faces) == 6


def test_a_mirror_keeps_the_outside_outside(tmp_path: Path) -> None:
    contents = one_square(nodes=[{"mesh": 0, "scale": [-1, 1, 1]}]).read(tmp_path)
    a, b, c = (contents.vertices[contents.faces[:, i]] for i in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_instances(tmp_path: Path) -> None:
    gltf = one_square(extensionsRequired=["EXT_mesh_gpu_instancing"])
    attributes = {
        "TRANSLATION": gltf.array([[0, 0, 0], [0, 0, 5]]),
        "ROTATION": gltf.array(np.array([[0, 0, 0, 1], TURN]) * [127], "i1", normalized=True),
        "SCALE": gltf.array([[1, 1, 1], [2, 1, 1]]),
    }
    node = {"mesh": 0, "translation": [1, 0, 0]}
    node["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    gltf.tree["nodes"] = [node]
    ends = gltf.read(tmp_path).vertices.reshape(2, 4, 3)[:, 1]
    np.testing.assert_allclose(ends, [[2, 0, 0], [1, 2, 5]], rtol=0, atol=1e-12)


@pytest.mark.parametrize("corners", [[0, 1, 2] * 4, [0, 1, 3]])  # 4 faces; 4 vertices
def test_a_mesh_has_a_limit_of_faces_and_of_vertices(tmp_path: Path, corners: list) -> None:
    gltf = Gltf()
    points, indices = gltf.array(CORNERS[: max(corners) + 1]), gltf.array(corners, "u1")
    gltf.mesh({"attributes": {"POSITION": points}, "indices": indices})
    attributes = {"TRANSLATION": gltf.array([[0, 0, 0], [0, 0, 5]])}
    extension = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    gltf.tree["nodes"] = [{"mesh": 0, "extensions": extension}]
    expected = gltf.read(tmp_path).faces
    data, resources = (tmp_path / "a.glb").read_bytes(), MeshResources(tmp_path, 0)
    np.testing.assert_array_equal(read_gltf(data, resources, most_faces=8).faces, expected)
    with pytest.raises(NotAMesh, match="more than 7 faces"):
        read_gltf(data, resources, most_faces=7)


def test_default_weights_of_morph_targets(tmp_path: Path) -> None:
    for weights, node_weights, expected in (([0.5, 2], None, 2.5), ([1, 1], [0, 3], 3.0)):
        gltf = Gltf()
        targets = [{"POSITION": gltf.array([[0, 0, 1]] * 4)} for _ in range(2)]
        gltf.mesh(square(gltf, targets=targets), weights=weights)
        gltf.tree["nodes"] = [{"mesh": 0} | ({"weights": node_weights} if node_weights else {})]
        assert set(gltf.read(tmp_path).vertices[:, 2]) == {expected}
    gltf.tree |= {"nodes": [{"mesh": 0}, *gltf.tree["nodes"]], "scenes": [{"nodes": [0, 1]}]}
    assert gltf.read(tmp_path).vertices[:, 2].tolist() == [2.0] * 4 + [3.0] * 4


def test_skins_stand_where_their_joints_do(tmp_path: Path) -> None:
    gltf = Gltf(
        nodes=[
            {"mesh": 0, "skin": 0, "translation": [50, 0, 0]},  # does not count
            {"children": [2], "translation": [0, 10, 0]},
            {"translation": [0, 0, 4]},
        ],
        scenes=[{"nodes": [0, 1]}],
    )
    inverse = np.tile(np.eye(4), (2, 1, 1))
    inverse[1, :3, 3] = 0, 0, -1
    binds = gltf.array(inverse.transpose(0, 2, 1))
    gltf.tree["skins"] = [{"joints": [1, 2], "inverseBindMatrices": binds}]
    joints = gltf.array([[0, 1, 0, 0]] * 4, "u1")
    weights = [[1, 0, 0, 0], [0, 1, 0, 0], [0.5, 0.5, 0, 0], [0.25, 0.25, 0, 0]]
    part = square(gltf)
    part["attributes"] |= {"JOINTS_0": joints, "WEIGHTS_0": gltf.array(weights)}
    more = gltf.array([[0, 0, 0, 0]] * 3 + [[0.25, 0, 0, 0]])
    part["attributes"] |= {"JOINTS_1": gltf.array([[0] * 4] * 4, "u2"), "WEIGHTS_1": more}
    vertices = gltf.mesh(part).read(tmp_path).vertices
    # Joint 0 moves by (0, 10, 0), joint 1 by (0, 10, 4) after its inverse (0, 0, -1).
    shifts = [[0, 10, 0], [0, 10, 3], [0, 10, 1.5], [0, 10, 1]]  # the last one by 2/3 and 1/3
    np.testing.assert_allclose(vertices, CORNERS + shifts, rtol=0, atol=1e-12)
    gltf.tree["skins"][0]["joints"] = [1]
    with pytest.raises(BadInput, match="a vertex has the joint 1, the skin has 1"):
        gltf.read(tmp_path)


def checkers() -> bytes:
    """A texture of red left and blue right; left it is darker below, and its upper edge green."""
    image = Image.new("RGB", (16, 4), tuple(RED))
    image.paste(tuple(BLUE), (8, 0, 16, 4))
    image.paste((128, 0, 0), (0, 2, 8, 4))
    image.paste((0, 255, 0), (0, 0, 1, 2))
    file = io.BytesIO()
    image.save(file, "PNG")
    return file.getvalue()


LINEAR = 0.21586  # ((128 / 255 + .055) / 1.055) ** 2.4
DARK = [128, 0, 0]


@pytest.mark.parametrize(
    ("material", "expected"),
    [
        ({"pbrMetallicRoughness": {"baseColorFactor": [LINEAR, 0, 1, 0.5]}}, [128, 0, 255]),
        ({"pbrMetallicRoughness": {"baseColorFactor": [0.001, 5, -1, 1]}}, [3, 255, 0]),
        ({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}, RED),
        ({"pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}}, RED),  # its WebP
        (
            {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0},
                                      "baseColorFactor": [LINEAR, 1, 1, 1]}},
            DARK,
        ),
        (
            {"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0, 0, 1, 1]}},
             "pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}},
            BLUE,
        ),
        (
            {"extensions": {"KHR_materials_pbrSpecularGlossiness": {
                "diffuseTexture": {"index": 0, "texCoord": 1}}}},
            BLUE,
        ),
        ({"name": "of the default colour", "doubleSided": True}, [255, 255, 255]),
        (None, GREY),
    ],
)  # fmt: skip
def test_materials(tmp_path: Path, material: dict | None, expected: list) -> None:
    webp = {"EXT_texture_webp": {"source": 0}}
    gltf = Gltf(textures=[{"source": 0}, {"source": 1, "extensions": webp}])
    gltf.tree["images"] = [{"bufferView": gltf.view(checkers())}, {"uri": "gone.png"}]
    part = square(gltf, **({} if material is None else {"material": 0}))
    part["attributes"]["TEXCOORD_0"] = gltf.array([[0.2, 0.2]] * 4)
    part["attributes"]["TEXCOORD_1"] = gltf.array([[0.8, 0.2]] * 4)
    gltf.tree["materials"] = [] if material is None else [material]
    contents = gltf.mesh(part).read(tmp_path)
    assert contents.face_colors.tolist() == [expected] * 2
    assert contents.notes == ()


@pytest.mark.parametrize(
    ("place", "transform", "sampler", "expected"),
    [
        ((0.2, 0.8), {}, {}, DARK),  # counted from the top
        ((1.2, -0.2), {}, {}, DARK),  # repeated
        ((1.2, 0.2), {}, {"wrapS": 33071}, BLUE),  # clamped to the right edge
        ((-0.3, 0.2), {}, {"wrapS": 33071}, [0, 255, 0]),
        ((0.2, 1.2), {}, {"wrapT": 33071}, DARK),
        ((np.nan, np.inf), {}, {}, [0, 255, 0]),  # counts as the upper left corner
        ((-0.8, 0.2), {}, {"wrapS": 33648}, BLUE),  # mirrored: .8
        ((0.2, 0.2), {"offset": [0.5, 0]}, {}, BLUE),
        ((0.2, 0.2), {"scale": [4, 1]}, {}, BLUE),
        # Anticlockwise as seen, where v points down: (.2, .1) goes to (.1, -.2), which is .8 of v.
        ((0.2, 0.1), {"rotation": np.pi / 2}, {}, DARK),
        ((0.2, 0.2), {"texCoord": 1}, {}, BLUE),
    ],
)
def test_places_in_textures(tmp_path: Path, place, transform, sampler, expected) -> None:
    gltf = Gltf(samplers=[sampler], textures=[{"source": 0, "sampler": 0}])
    gltf.tree["images"] = [{"bufferView": gltf.view(checkers()), "mimeType": "image/png"}]
    texture = {"index": 0, "texCoord": 0, "extensions": {"KHR_texture_transform": transform}}
    gltf.tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": texture}}]
    part = square(gltf, material=0)
    part["attributes"]["TEXCOORD_0"] = gltf.array([place] * 4)
    part["attributes"]["TEXCOORD_1"] = gltf.array([[0.8, 0.2]] * 4)
    assert gltf.mesh(part).read(tmp_path).face_colors.tolist() == [expected] * 2


@pytest.mark.parametrize(("kind", "full"), [("f4", 1), ("u1", 255), ("u2", 65535)])
def test_colours_of_vertices_are_linear_and_multiply_the_material(
    tmp_path: Path, kind: str, full: int
) -> None:
    for factor, expected in ((None, [156, 156]), ([LINEAR, 1, 1, 1], [76, 76])):
        gltf = Gltf()
        part = square(gltf)
        colors = np.array([[1, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]) * full
        part["attributes"]["COLOR_0"] = gltf.array(colors, kind, normalized=kind != "f4")
        if factor:
            gltf.tree["materials"] = [{"pbrMetallicRoughness": {"baseColorFactor": factor}}]
            part["material"] = 0
        # 1/3 linear is 156 in sRGB, a third of .21586 is 76.
        read = gltf.mesh(part).read(tmp_path).face_colors
        assert read.tolist() == [[red, 0, 0] for red in expected]
    gltf = Gltf()
    part = square(gltf)  # of four vertices
    part["attributes"]["COLOR_0"] = gltf.array([[full, 0, 0]] * 5, kind, normalized=kind != "f4")
    contents = gltf.mesh(part).read(tmp_path)
    assert contents.face_colors.tolist() == [GREY] * 2
    assert contents.notes == ("5 colours for 4 vertices are left out",)


@pytest.mark.parametrize(
    ("images", "note"),
    [
        ([{"uri": "my%20wood.png"}], "the texture 'my wood.png' is not there"),
        ([{"uri": "data:image/png;base64,AAAA"}], "no picture that can be read"),
        ([], "a material cannot be read (it has no images[0]"),
    ],
)
def test_textures_that_are_lost_are_named(tmp_path: Path, images: list, note: str) -> None:
    gltf = Gltf(textures=[{"source": 0}], images=images)
    gltf.tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    part = square(gltf, material=0)
    part["attributes"]["TEXCOORD_0"] = gltf.array([[0.2, 0.2]] * 4)
    contents = gltf.mesh(part).read(tmp_path)
    assert contents.face_colors.tolist() == [[255, 255, 255] if images else GREY] * 2
    (line,) = contents.notes
    assert note in line


@pytest.mark.parametrize(
    ("tree", "problem"),
    [
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "without compression by Draco"),
        ({"extensionsRequired": ["EXT_meshopt_compression"]}, "without compression by meshopt"),
        ({"extensionsRequired": ["ACME_shape"]}, "it requires the extension 'ACME_shape', which"),
        ({"asset": {"version": "1.0"}}, "'glTF 1.0'; convert it to glTF 2.0"),
        ({"asset": {}}, "no glTF, as it has no asset.version"),
        ({"scenes": [{"nodes": [0, 0]}]}, "its node 0 stands in several places of the scene"),
        ({"nodes": [{"mesh": 0, "children": [0]}]}, "its node 0 stands in several places"),
        ({"nodes": [{"mesh": 4}]}, r"it has no meshes[4], which it refers to"),
        ({"nodes": [{"mesh": "0"}]}, r"it has no meshes[0], which it refers to"),
        ({"scenes": [{"nodes": []}]}, "the mesh has no faces"),
        (  # accessors without numbers: 9, and as many that 2**24 are exceeded by one
            {"accessors": [{"componentType": 5126, "count": 3, "type": "VEC3"},
                           {"componentType": 5121, "count": 2**24 - 8, "type": "SCALAR"}],
             "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]},
            "its accessors leave out 16777217 numbers, at most 16777216 are filled in",
        ),
    ],
)  # fmt: skip
def test_what_is_refused(tmp_path: Path, tree: dict, problem: str) -> None:
    with pytest.raises(BadInput) as failure:
        one_square(**tree).read(tmp_path)
    assert str(failure.value).startswith(f"{tmp_path / 'a.glb'}: ")
    assert problem in str(failure.value)


SPARSE = {"bufferView": 0, "byteOffset": 10, "componentType": 5123}  # the last index, which is 3


@pytest.mark.parametrize(
    ("kind", "changes", "problem"),
    [
        ("bufferViews", {"byteLength": 49}, "its bufferViews[1] reaches beyond its buffer"),
        ("bufferViews", {"byteOffset": -4}, "its bufferViews[1] reaches beyond its buffer"),
        ("accessors", {"count": 5}, "5 elements needs 60 bytes, and its view has 48"),
        (
            "accessors",
            {"count": 3, "sparse": {"count": 1, "indices": SPARSE, "values": {"bufferView": 1}}},
            "its accessors[1] is sparse beyond its end",
        ),
    ],
)
def test_places_beyond_the_end(tmp_path: Path, kind: str, changes: dict, problem: str) -> None:
    gltf = one_square()
    gltf.tree[kind][1] |= changes
    with pytest.raises(BadInput) as failure:
        gltf.read(tmp_path)
    assert problem in str(failure.value)


def test_of_several_binary_chunks_the_first_counts(tmp_path: Path) -> None:
    vertices = one_square().read(tmp_path).vertices
    path = tmp_path / "a.glb"
    data = path.read_bytes() + b"\x3c\0\0\0BIN\0" + bytes(60)
    path.write_bytes(data[:8] + len(data).to_bytes(4, "little") + data[12:])
    np.testing.assert_array_equal(read_contents(path).vertices, vertices)


def test_extensions_of_materials_alone_are_no_obstacle(tmp_path: Path) -> None:
    names = ["KHR_materials_clearcoat", "KHR_materials_unlit", "KHR_texture_transform"]
    assert len(one_square(extensionsRequired=names).read(tmp_path).faces) == 2
