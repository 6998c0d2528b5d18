"""The files beside a mesh that it may refer to: materials, textures and buffers."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from urllib.parse import unquote

from data_prep.files.mesh_materials import library_names, read_materials
from data_prep.files.safe_read import is_regular_file, read_file

# Patterns of the places in a file, by its suffix, where it names another one.
_NAMES = {
    ".obj": re.compile(rb"^[ \t]*mtllib[ \t]([^\r\n]+)", re.MULTILINE | re.IGNORECASE),
    ".ply": re.compile(rb"^comment texturefile[ \t]+([^\r\n]+)", re.MULTILINE | re.IGNORECASE),
    ".gltf": re.compile(
        rb'"uri"\s*:\s*("(?!data:)(?:[^"\\]|\\["\\/bfnrt]|\\u[0-9a-fA-F]{4}){1,1000}")'
    ),
}
_PLY_HEADER_BYTES = 2**16  # the header of a PLY, in whose comments textures are named


class MeshResources:
    """The regular files in a folder and below it, which a reader may read for a mesh.

    folder      the folder of the mesh
    most_bytes  the largest size of all files that are read together
    within      the folder that paths may not lead out of, by default `folder`. It is given where
                the files of one mesh lie in several folders (ShapeNetCore.v2 has models/ and
                images/)

    Links may not lead out of the folder either. A path that does, as one of another computer, and a
    URL stand for the file of the same name in the folder: nothing is downloaded.
    """

    def __init__(self, folder: Path, most_bytes: int, within: Path | None = None) -> None:
        self._folder = folder.resolve()
        self._within = (within or folder).resolve()
        self._left = most_bytes

    def read(self, name: str) -> bytes | None:
        """Return the bytes of a file that a mesh names; None where there is no such file.

        Raises BadInput where it is too large.
        """
        path = self.find(name)
        if path is None:
            return None
        data = read_file(path, self._left)
        self._left -= len(data)
        return data

    def find(self, name: str) -> Path | None:
        """Return the path of the file that a mesh names so; None where there is no such file.

        Quotes around the name do not count, backslashes separate folders as slashes do, and where
        nothing has the name itself, one that differs in capital letters alone is taken.
        """
        plain = name.strip().strip("\"'").replace("\\", "/")
        names = (name, plain, plain.lstrip("/"), plain.rpartition("/")[2])
        for candidate in dict.fromkeys(names):
            for look in (self._exact, self._in_any_case):
                if path := look(candidate):
                    return path
        return None

    def _exact(self, name: str) -> Path | None:
        try:
            path = (self._folder / name).resolve()
        except (OSError, ValueError, RuntimeError):  # too long, with a NUL, a circle of links
            return None
        return path if path.is_relative_to(self._within) and is_regular_file(path) else None

    def _in_any_case(self, name: str) -> Path | None:
        """Return the file whose path in the folder differs from a name in capital letters alone."""
        folder = self._folder
        parts = [part for part in name.split("/") if part not in ("", ".")]
        if ".." in parts:
            return None
        for part in parts:
            try:
                entry = _by_casefold(folder, folder.stat().st_mtime_ns).get(part.casefold())
            except OSError:
                return None
            if entry is None:
                return None
            folder = folder / entry
        return self._exact(str(folder.relative_to(self._folder))) if parts else None


@lru_cache(maxsize=64)  # a folder of 10,000 meshes would be listed for each of them
def _by_casefold(folder: Path, changed_ns: int) -> dict[str, str]:
    """Return the names in a folder that was last changed then, by their casefolded form."""
    names = sorted(os.listdir(folder), reverse=True)  # noqa: PTH208
    return {name.casefold(): name for name in names}  # of two that agree the first one stays


def files_behind(mesh: Path, most_bytes: int, within: Path | None = None) -> Iterator[Path]:
    """Yield the files that a mesh refers to, and the textures of its materials.

    Their names are searched for in the text of the mesh, which is not parsed, and the files are
    found as `MeshResources` finds them.
    """
    for _, path in _named_files(mesh, most_bytes, within):
        if path is not None:
            yield path


def missing_files(mesh: Path, most_bytes: int, within: Path | None = None) -> tuple[str, ...]:
    """Return the names that a mesh and its materials have for files that are not there."""
    named = _named_files(mesh, most_bytes, within)
    return tuple(dict.fromkeys(name for name, path in named if path is None))


def _named_files(
    mesh: Path, most_bytes: int, within: Path | None
) -> Iterator[tuple[str, Path | None]]:
    """Yield the names of files that a mesh refers to, each with the file, or None for none."""
    kind = mesh.suffix.lower().replace(".glb", ".gltf")
    if kind not in _NAMES:
        return
    resources = MeshResources(mesh.parent, most_bytes, within)
    text = read_file(mesh, most_bytes)
    if kind == ".ply":
        text = text[:_PLY_HEADER_BYTES]
    if kind == ".obj":
        text = text.replace(b"\\\r\n", b"").replace(b"\\\n", b"")  # a line goes on in the next one
    for match in _NAMES[kind].finditer(text):
        name = match[1].decode("utf-8", "replace").strip()
        if kind == ".gltf":
            name = unquote(json.loads(name, strict=False))
            yield name, resources.find(name)
        elif kind == ".ply":
            yield name, resources.find(name)
        else:
            for library in library_names(name, resources.find):
                path = resources.find(library)
                yield library, path
                if path is not None:
                    yield from _textures_of(path, most_bytes, resources.find)


def _textures_of(
    library: Path, most_bytes: int, find: Callable[[str], Path | None]
) -> Iterator[tuple[str, Path | None]]:
    """Yield the names of the textures in a library of materials, each with its file."""
    materials = read_materials(read_file(library, most_bytes))
    for name in dict.fromkeys(m.texture for m in materials.values() if m.texture):
        yield name, find(name)
