"""The container of glTF 2.0: its tree, and the numbers of its buffers."""

from __future__ import annotations

import base64
import binascii
import json
import math
from functools import cache
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from data_prep.files.mesh_contents import NotAMesh
from data_prep.files.mesh_resources import MeshResources
from data_prep.files.safe_read import shown

_MAGIC = b"glTF"
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942  # the kinds of chunks of a GLB
# The extensions that a file may require: they are read, or change neither shape nor base colour. So
# do all whose names begin with KHR_materials_.
_KNOWN = {
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_lights_punctual",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_transform",
    "KHR_xmp_json_ld",
}
_OF_MATERIALS = "KHR_materials_"
# Extensions that compress, by the names of what they compress with.
COMPRESSIONS = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
    "KHR_texture_basisu": "Basis Universal",
}
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
# Numbers of an element of an accessor, by its type.
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_MOST_ZEROS = 2**24  # the most numbers that a file may leave out, in whose place are zeros


class GltfFile:
    """A glTF of text or binary, and the files beside it that it names.

    tree  the JSON of the file

    Raises NotAMesh for a file that is no glTF 2.0, that requires an extension that is not read, or
    that is cut short; its methods raise it, too, for buffers that are not there or too small.
    """

    def __init__(self, data: bytes, resources: MeshResources) -> None:
        self._resources = resources
        self._binary: bytes | None = None
        if data[:4] == _MAGIC:
            data = self._chunks(data)
        try:
            self.tree: dict[str, Any] = json.loads(
                data.rstrip(b"\0")
            )  # some pad with zeros, not blanks
        except (ValueError, RecursionError) as error:
            raise NotAMesh(f"no JSON ({type(error).__name__}); fetch it again") from error
        if not isinstance(self.tree, dict):
            raise NotAMesh("no JSON of a glTF, but of something else; write the file again")
        self._check_version()
        # Each is read once for a file, and kept as long as the file is.
        self.buffer_view = cache(self._buffer_view)
        self._buffer = cache(self._read_buffer)
        self._zeros = 0

    def _chunks(self, data: bytes) -> bytes:
        """Return the JSON of a GLB, and keep its binary chunk."""
        version = int.from_bytes(data[4:8], "little")
        if version != 2:
            raise NotAMesh(f"a GLB of version {version}, expected 2; convert it to glTF 2.0")
        text, at = b"", 12
        data = data[
            : max(12, int.from_bytes(data[8:12], "little"))
        ]  # more behind it does not count
        while at + 8 <= len(data):
            length = int.from_bytes(data[at : at + 4], "little")
            kind = int.from_bytes(data[at + 4 : at + 8], "little")
            if at + 8 + length > len(data):
                raise NotAMesh(
                    f"a chunk of {length} bytes reaches beyond the end; the file is cut short, "
                    "fetch it again"
                )
            chunk = data[at + 8 : at + 8 + length]
            if kind == _JSON_CHUNK and not text:
                text = chunk
            if kind == _BINARY_CHUNK and self._binary is None:
                self._binary = chunk
            at += 8 + length
        return text

    def _check_version(self) -> None:
        version = str(self.tree.get("asset", {}).get("version", ""))
        if not version.startswith("2"):
            what = f"glTF {version}" if version else "no glTF, as it has no asset.version"
            raise NotAMesh(f"{shown(what)}; convert it to glTF 2.0")
        for name in self.tree.get("extensionsRequired", ()):
            if name in _KNOWN or str(name).startswith(_OF_MATERIALS):
                continue
            remedy = "write the file without it"
            if name in COMPRESSIONS:
                remedy = f"write it without compression by {COMPRESSIONS[name]}"
            raise NotAMesh(
                f"it requires the extension {shown(str(name))}, which is not read; {remedy} (as "
                "with gltf-transform, or by exporting it from Blender)"
            )

    def element(self, kind: str, index: int) -> dict[str, Any]:
        """Return an element of one of the tree's lists ("meshes", "nodes")."""
        elements = self.tree.get(kind, ())
        if not isinstance(index, int) or not 0 <= index < len(elements):
            raise NotAMesh(f"it has no {kind}[{index}], which it refers to; write the file again")
        return elements[index]

    def resource(self, name: str) -> bytes | None:
        """Return the bytes that a data URI has, or a file beside; None where there are none."""
        if not name.startswith("data:"):
            return self._resources.read(name)
        try:
            return base64.b64decode(name.partition(",")[2])
        except (binascii.Error, ValueError):
            return None

    def _read_buffer(self, index: int) -> bytes:
        buffer = self.element("buffers", index)
        name = resource_name(buffer.get("uri"))
        data = self._binary if index == 0 else None  # the GLB's own part is the first buffer
        if name is not None:
            data = self.resource(name)
        if data is None and name is None:
            raise NotAMesh(f"its buffer {index} is in no file; write the file again")
        if data is None:
            raise NotAMesh(
                f"its buffer {index}, the file {shown(str(name))}, is not there; put it "
                "beside this one"
            )
        if len(data) < buffer["byteLength"]:
            raise NotAMesh(
                f"its buffer {index} has {len(data)} bytes, expected {buffer['byteLength']}; it is "
                "cut short, fetch it again"
            )
        return data

    def _buffer_view(self, index: int) -> bytes:
        """Return the bytes of a view of a buffer."""
        view = self.element("bufferViews", index)
        start, length = view.get("byteOffset", 0), view["byteLength"]
        data = self._buffer(view["buffer"])
        if start < 0 or length < 0 or start + length > len(data):
            raise NotAMesh(
                f"its bufferViews[{index}] reaches beyond its buffer; write the file again"
            )
        return data[start : start + length]

    def numbers(self, index: int) -> NDArray[Any]:
        """Return the elements [count, columns] of an accessor.

        Normalised integers are float64 of -1 to 1; other integers stay what they are.
        """
        accessor = self.element("accessors", index)
        if accessor.get("componentType") not in _TYPES or accessor.get("type") not in _COLUMNS:
            raise NotAMesh(
                f"its accessors[{index}] has numbers of no known type; write the file again"
            )
        kind = np.dtype(_TYPES[accessor["componentType"]])
        count, columns = accessor["count"], _COLUMNS[accessor["type"]]
        values = self._dense(index, accessor, kind, count, columns)
        if sparse := accessor.get("sparse"):
            rows = self._packed(sparse["indices"], "SCALAR", sparse["count"])[:, 0]
            of_values = sparse["values"] | {"componentType": accessor["componentType"]}
            new = self._packed(of_values, accessor["type"], sparse["count"])
            if len(rows) and rows.max() >= count:
                raise NotAMesh(f"its accessors[{index}] is sparse beyond its end; write it again")
            values = values.copy()
            values[rows] = new
        if accessor.get("normalized") and kind.kind in "iu":
            return np.maximum(values / float(np.iinfo(kind).max), -1.0)
        return values

    def _dense(
        self, index: int, accessor: dict[str, Any], kind: np.dtype[Any], count: int, columns: int
    ) -> NDArray[Any]:
        if "bufferView" in accessor:
            view = self.element("bufferViews", accessor["bufferView"])
            stride = view.get("byteStride") or kind.itemsize * columns
            data = self.buffer_view(accessor["bufferView"])
            return _strided(data, kind, (count, columns), accessor.get("byteOffset", 0), stride)
        self._zeros += count * columns
        if count < 0 or self._zeros > _MOST_ZEROS:
            raise NotAMesh(
                f"its accessors leave out {self._zeros} numbers, at most {_MOST_ZEROS} are filled "
                "in; write the file again"
            )
        return np.zeros((count, columns), kind)

    def _packed(self, part: dict[str, Any], type_name: str, count: int) -> NDArray[Any]:
        """Return the indices or the values of a sparse accessor."""
        kind, columns = np.dtype(_TYPES[part["componentType"]]), _COLUMNS[type_name]
        data = self.buffer_view(part["bufferView"])
        stride = kind.itemsize * columns
        return _strided(data, kind, (count, columns), part.get("byteOffset", 0), stride)


def resource_name(uri: str | None) -> str | None:
    """Return the name of a file that a URI has; a data URI as it is; None for None."""
    return uri if uri is None or uri.startswith("data:") else unquote(uri)


def _strided(
    data: bytes, kind: np.dtype[Any], shape: tuple[int, int], offset: int, stride: int
) -> NDArray[Any]:
    """Return numbers that stand in rows `stride` bytes apart."""
    count, columns = shape
    need = offset + (count - 1) * stride + columns * kind.itemsize if count else 0
    if min(count, offset) < 0 or stride < columns * kind.itemsize or need > len(data):
        raise NotAMesh(
            f"an accessor of {count} elements needs {need} bytes, and its view has {len(data)}; "
            "the file is damaged, fetch it again"
        )
    return np.ndarray(shape, kind, data, offset, (stride, kind.itemsize))


def matrix_of(node: dict[str, Any]) -> NDArray[np.float64]:
    """Return the transform [4, 4] of a node: its matrix, or translation, rotation and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T  # it is stored by columns
    (place,) = transforms(
        np.array([node.get("translation", (0, 0, 0))], np.float64),
        np.array([node.get("rotation", (0, 0, 0, 1))], np.float64),
        np.array([node.get("scale", (1, 1, 1))], np.float64),
    )
    return place


def transforms(
    translations: NDArray[np.float64],
    rotations: NDArray[np.float64],
    scales: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return matrices [N, 4, 4] that scale, then turn, then shift.

    rotations  float64 [N, 4]: quaternions, the real part last; those of length 0 do not turn
    """
    lengths = np.linalg.norm(rotations, axis=1, keepdims=True)
    x, y, z, w = (rotations / np.where(lengths > 0, lengths, math.inf)).T
    places = np.zeros((len(rotations), 4, 4))
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    places[:, :3, :3] = np.array(rows).transpose(2, 0, 1)
    places[:, :3, :3] *= scales[:, None, :]
    places[:, :3, 3] = translations
    places[:, 3, 3] = 1.0
    return places
