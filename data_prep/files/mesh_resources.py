"""The files that a mesh may refer to: its own materials, textures and buffers, nothing else."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from trimesh.resolvers import Resolver

from data_prep.files.safe_read import is_regular_file, read_file

# Names in the text of a file, wherever trimesh looks for one; a name too many does no harm.
_NAMES = {
    ".obj": re.compile(rb"mtllib([^\r\n]+)"),
    ".mtl": re.compile(rb"map_kd([^\r\n]+)", re.IGNORECASE),
    ".ply": re.compile(rb"texturefile([^\r\n]+)", re.IGNORECASE),
    ".gltf": re.compile(rb'"uri"\s*:\s*("(?:[^"\\]|\\["\\/bfnrt]|\\u[0-9a-fA-F]{4}){1,1000}")'),
}


def files_behind(mesh: Path, most_bytes: int, within: Path | None = None) -> Iterator[Path]:
    """Yield the files that a mesh refers to, and the textures of its materials.

    They are found by the names in it, as `MeshResources` finds them, without parsing the mesh.
    """
    resources = MeshResources(mesh.parent, most_bytes, within)
    kind = mesh.suffix.lower().replace(".glb", ".gltf")
    for path in _named(mesh, kind, most_bytes, resources):
        yield path
        if kind == ".obj":
            yield from _named(path, ".mtl", most_bytes, resources)


def _named(file: Path, kind: str, most_bytes: int, resources: MeshResources) -> Iterator[Path]:
    if kind not in _NAMES:
        return
    text = read_file(file, most_bytes)
    if kind == ".obj":  # lines may go on after a backslash
        text = text.replace(b"\\\r\n", b"").replace(b"\\\n", b"")
    for name in _NAMES[kind].findall(text):
        name = name.decode(errors="replace")
        if path := resources.find(json.loads(name, strict=False) if kind == ".gltf" else name):
            yield path


# trimesh before 5.0 reads any path that a mesh gives, and no version checks the kind of the file.
class MeshResources(Resolver):
    """The regular files in `folder` and below, of `most_bytes` together; links may not lead out.

    Names are understood as in trimesh 5: a path that leads out of the folder stands for the file
    of that name in it. URLs are such paths, so that nothing is downloaded. Where the files of one
    mesh lie in several folders (ShapeNetCore.v2: models/ and images/), `within` is their common
    folder, and paths may lead anywhere in it.
    """

    def __init__(self, folder: Path, most_bytes: int, within: Path | None = None) -> None:
        self._folder = folder.resolve()
        self._within = (within or folder).resolve()
        self._left = most_bytes

    def get(self, key: str) -> bytes:
        """Return the bytes of a file. Raises FileNotFoundError, and BadInput for a large file."""
        path = self.find(key)
        if path is None:
            raise FileNotFoundError(key)
        data = read_file(path, self._left)
        self._left -= len(data)
        return data

    def find(self, key: str) -> Path | None:
        """Return the path of a file, None where there is none."""
        name = key.strip()
        for candidate in (name, name.lstrip("/"), os.path.split(key)[-1]):
            try:
                path = (self._folder / candidate).resolve()
            except (OSError, ValueError, RuntimeError):  # too long, a NUL, links in a circle
                continue
            if path.is_relative_to(self._within) and is_regular_file(path):
                return path
        return None

    def keys(self) -> Iterable[str]:
        """Return no names: trimesh looks up only the names in the mesh."""
        return ()

    def namespaced(self, namespace: str) -> MeshResources:
        """Return the same folder."""
        return self

    def write(self, name: str, data: str | bytes) -> None:
        """Raise PermissionError: reading a mesh writes nothing."""
        raise PermissionError(name)
