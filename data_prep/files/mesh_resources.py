"""The files that a mesh may refer to: materials, textures and buffers in its own folder only."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from trimesh.resolvers import Resolver

from data_prep.files.safe_read import is_regular_file, read_file

# Patterns of the places in a file, by its suffix, where trimesh looks for the name of another file.
# They may find too many names: one without a file is passed over.
_NAMES = {
    ".obj": re.compile(rb"mtllib([^\r\n]+)"),
    ".mtl": re.compile(rb"map_kd([^\r\n]+)", re.IGNORECASE),
    ".ply": re.compile(rb"texturefile([^\r\n]+)", re.IGNORECASE),
    ".gltf": re.compile(rb'"uri"\s*:\s*("(?:[^"\\]|\\["\\/bfnrt]|\\u[0-9a-fA-F]{4}){1,1000}")'),
}


def files_behind(mesh: Path, most_bytes: int, within: Path | None = None) -> Iterator[Path]:
    """Yield the files that a mesh refers to, and the textures of its materials.

    Their names are searched for in the text of the mesh, which is not parsed, and the files are
    found as `MeshResources` finds them.
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
    if kind == ".obj":  # a backslash at the end of a line continues it
        text = text.replace(b"\\\r\n", b"").replace(b"\\\n", b"")
    for name in _NAMES[kind].findall(text):
        name = name.decode(errors="replace")
        if path := resources.find(json.loads(name, strict=False) if kind == ".gltf" else name):
            yield path


# This class is needed, as trimesh before 5.0 reads any path that a mesh names, and no version
# checks whether that is a regular file.
class MeshResources(Resolver):
    """The regular files in a folder and below it, which trimesh may read for a mesh.

    folder      the folder of the mesh
    most_bytes  the largest size of all files that are read together
    within      the folder that paths may not lead out of, by default `folder`. It is given where
                the files of one mesh lie in several folders (ShapeNetCore.v2 has models/ and
                images/)

    Links may not lead out of the folder either. As in trimesh 5, a path that does stands for the
    file of the same name in the folder. URLs count as such paths, so that nothing is downloaded.
    """

    def __init__(self, folder: Path, most_bytes: int, within: Path | None = None) -> None:
        self._folder = folder.resolve()
        self._within = (within or folder).resolve()
        self._left = most_bytes

    def get(self, key: str) -> bytes:
        """Return the bytes of a file.

        Raises FileNotFoundError where there is none, and BadInput where it is too large.
        """
        path = self.find(key)
        if path is None:
            raise FileNotFoundError(key)
        data = read_file(path, self._left)
        self._left -= len(data)
        return data

    def find(self, key: str) -> Path | None:
        """Return the path of the file that a mesh names `key`; None where there is no such file."""
        name = key.strip()
        for candidate in (name, name.lstrip("/"), os.path.split(key)[-1]):
            try:
                path = (self._folder / candidate).resolve()
            except (
                OSError,
                ValueError,
                RuntimeError,
            ):  # a name too long, a NUL in it, a circle of links
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
