"""Meshes in glTF 2.0, binary (GLB) or text, by its specification.

No library is used: trimesh leaves out triangle fans and instances, does not scale normalised
integers, and takes linear colours for sRGB.

The mesh is what the scene shows before any animation: nodes with their transforms, instances
(EXT_mesh_gpu_instancing), the default weights of morph targets, and skins in the pose of their
joints.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_prep.files.gltf_file import COMPRESSIONS, GltfFile, matrix_of, transforms
from data_prep.files.gltf_materials import GltfMaterials
from data_prep.files.mesh_contents import FaceColors, MeshContents, NotAMesh
from data_prep.files.mesh_resources import MeshResources
from data_prep.files.polygons import beyond_vertices, triangles_of_strips

_TRIANGLES, _STRIP, _FAN = 4, 5, 6  # the modes of primitives that have faces
_INSTANCES = "EXT_mesh_gpu_instancing"
_VISIBILITY = "KHR_node_visibility"
_MOST_JOINT_SETS = 8  # sets of four joints that a vertex may have, JOINTS_0 and so on


class _Primitive(NamedTuple):
    """A part of a mesh in its own coordinates.

    attributes  the accessors of the primitive by name
    vertices    float64 [V, 3]
    faces       int64 [F, 3]
    colors      uint8 [F, 3]
    """

    attributes: dict[str, int]
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    colors: FaceColors


def read_gltf(data: bytes, resources: MeshResources, most_faces: int) -> MeshContents:
    """Return the faces of the default scene, node by node.

    The colour of a face is that of its material: the base colour times the texture and the colours
    of vertices, which are linear, as sRGB; of a face without any, neutral grey.

    Raises NotAMesh as `GltfFile` does, for more than `most_faces`, where each instance counts, and
    for a node that stands under several others.
    """
    file = GltfFile(data, resources)
    materials = GltfMaterials(file)
    places, elsewhere = _places(file)
    vertices, faces = [np.empty((0, 3))], [np.empty((0, 3), np.int64)]
    colors = [np.empty((0, 3), np.uint8)]
    meshes: dict[tuple[int, tuple[float, ...]], list[_Primitive]] = {}
    count = face_count = corner_count = 0
    for index, place in places.items():
        node = file.element("nodes", index)
        if "mesh" not in node:
            continue
        mesh = file.element("meshes", node["mesh"])
        weights = tuple(node.get("weights") or mesh.get("weights") or ())
        key = node["mesh"], weights
        if key not in meshes:
            meshes[key] = list(_primitives(file, materials, mesh, weights))
        instances = _instances(file, node, place)
        face_count += len(instances) * sum(len(part.faces) for part in meshes[key])
        corner_count += len(instances) * sum(len(part.vertices) for part in meshes[key])
        if face_count > most_faces or corner_count > most_faces:
            raise NotAMesh(f"more than {most_faces} faces or vertices; give a coarser mesh")
        for part in meshes[key]:
            for instance in instances:
                moved, mirrored = _moved(file, node, places | elsewhere, part, instance)
                vertices.append(moved)
                faces.append((part.faces[:, ::-1] if mirrored else part.faces) + count)
                colors.append(part.colors)
                count += len(moved)
    joined = np.concatenate(vertices), np.concatenate(faces), np.concatenate(colors)
    return MeshContents(*joined, tuple(dict.fromkeys(materials.notes)))


_Places = dict[int, NDArray[np.float64]]  # the transform [4, 4] to the scene of each node


def _places(file: GltfFile) -> tuple[_Places, _Places]:
    """Return where the nodes of the default scene stand, parents first, and all others.

    Joints of a skin may be among the others.
    """
    nodes = file.tree.get("nodes", ())
    below = {child for node in nodes for child in node.get("children", ())}
    all_roots = [index for index in range(len(nodes)) if index not in below]
    scenes = file.tree.get("scenes", ())
    if scenes:
        roots = file.element("scenes", file.tree.get("scene", 0)).get("nodes", ())
    else:
        roots = all_roots
    places = _below(file, roots)
    outside = [index for index in all_roots if index not in places]
    return places, {k: v for k, v in _below(file, outside).items() if k not in places}


def _below(file: GltfFile, roots: Sequence[int]) -> _Places:
    """Return where nodes and all nodes below them stand, parents first."""
    places: _Places = {}
    waiting = [(index, np.eye(4)) for index in reversed(roots)]
    while waiting:
        index, above = waiting.pop()
        if index in places:
            raise NotAMesh(
                f"its node {index} stands in several places of the scene, which glTF does not "
                "allow; write the file again"
            )
        node = file.element("nodes", index)
        if not node.get("extensions", {}).get(_VISIBILITY, {}).get("visible", True):
            continue
        places[index] = above @ matrix_of(node)
        waiting += [(child, places[index]) for child in reversed(node.get("children", ()))]
    return places


def _instances(
    file: GltfFile, node: dict[str, Any], place: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the transforms [N, 4, 4] with which the mesh of a node is drawn."""
    extension = node.get("extensions", {}).get(_INSTANCES)
    if extension is None:
        return place[None]
    attributes = extension.get("attributes", {})
    given = {name: file.numbers(index).astype(np.float64) for name, index in attributes.items()}
    count = max((len(values) for values in given.values()), default=0)
    return place @ transforms(
        given.get("TRANSLATION", np.zeros((count, 3))),
        given.get("ROTATION", np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))),
        given.get("SCALE", np.ones((count, 3))),
    )


def _primitives(
    file: GltfFile, materials: GltfMaterials, mesh: dict[str, Any], weights: tuple[float, ...]
) -> Iterator[_Primitive]:
    """Yield the parts of a mesh that have faces."""
    for primitive in mesh.get("primitives", ()):
        mode, attributes = primitive.get("mode", _TRIANGLES), primitive.get("attributes", {})
        if mode not in (_TRIANGLES, _STRIP, _FAN) or "POSITION" not in attributes:
            continue
        accessor = file.element("accessors", attributes["POSITION"])
        compressed = set(primitive.get("extensions", {})) & set(COMPRESSIONS)
        if compressed and "bufferView" not in accessor:
            raise NotAMesh(
                f"its vertices are compressed by {COMPRESSIONS[min(compressed)]} alone; write the "
                "file without compression"
            )
        vertices = file.numbers(attributes["POSITION"]).astype(np.float64)
        for weight, target in zip(weights, primitive.get("targets", ()), strict=False):
            if weight and "POSITION" in target:
                vertices = vertices + weight * file.numbers(target["POSITION"])
        corners = np.arange(len(vertices))
        if "indices" in primitive:
            corners = file.numbers(primitive["indices"])[:, 0].astype(np.int64)
        if problem := beyond_vertices(corners, len(vertices)):
            raise NotAMesh(problem)
        faces = corners[_triangles(mode, len(corners))]
        yield _Primitive(
            attributes, vertices, faces, materials.face_colors(primitive, faces, len(vertices))
        )


def _triangles(mode: int, count: int) -> NDArray[np.int64]:
    """Return the positions [F, 3] of triangles in a list of `count` corners."""
    if mode == _STRIP:
        return triangles_of_strips(np.array([count]))[0]
    if mode == _FAN:
        rows = np.arange(1, max(1, count - 1))
        return np.stack([np.zeros_like(rows), rows, rows + 1], axis=1)
    return np.arange(count - count % 3).reshape(-1, 3)


def _moved(
    file: GltfFile,
    node: dict[str, Any],
    places: _Places,
    part: _Primitive,
    place: NDArray[np.float64],
) -> tuple[NDArray[np.float64], bool]:
    """Return the vertices of a part in the scene, and whether that mirrors them."""
    if "skin" in node and "JOINTS_0" in part.attributes:
        return _skinned(file, file.element("skins", node["skin"]), places, part), False
    moved = part.vertices @ place[:3, :3].T + place[:3, 3]
    return moved, bool(np.linalg.det(place[:3, :3]) < 0)


def _skinned(
    file: GltfFile,
    skin: dict[str, Any],
    places: _Places,
    part: _Primitive,
) -> NDArray[np.float64]:
    """Return the vertices [V, 3] that the joints of a skin hold where they stand.

    The transform of the node itself does not count. Raises NotAMesh for a joint that is no node.
    """
    joints = skin["joints"]
    if any(joint not in places for joint in joints):
        raise NotAMesh("a joint of a skin is no node of the file; write the file again")
    matrices = np.stack([places[joint] for joint in joints])
    if "inverseBindMatrices" in skin:
        inverse = file.numbers(skin["inverseBindMatrices"]).reshape(-1, 4, 4)
        matrices = matrices @ inverse[: len(joints)].transpose(0, 2, 1)  # stored by columns
    blended = np.zeros((len(part.vertices), 4, 4))
    total = np.zeros(len(part.vertices))
    for number in range(_MOST_JOINT_SETS):
        if f"JOINTS_{number}" not in part.attributes:
            break
        rows = file.numbers(part.attributes[f"JOINTS_{number}"]).astype(np.int64)
        weights = file.numbers(part.attributes[f"WEIGHTS_{number}"]).astype(np.float64)
        if rows.size and rows.max() >= len(joints):
            raise NotAMesh(
                f"a vertex has the joint {rows.max()}, the skin has {len(joints)}; write it again"
            )
        for column in range(rows.shape[1]):
            blended += weights[:, column, None, None] * matrices[rows[:, column]]
            total += weights[:, column]
    blended /= np.where(total > 0, total, 1.0)[:, None, None]  # weights are to sum up to 1
    homogeneous = np.concatenate([part.vertices, np.ones((len(part.vertices), 1))], axis=1)
    return np.einsum("vij,vj->vi", blended, homogeneous)[:, :3]
