"""The files that a mesh may refer to: its own materials, textures and buffers, nothing else."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from trimesh.resolvers import Resolver

from data_prep.files.safe_read import is_regular_file, read_file


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
        name = key.strip()
        for candidate in (name, name.lstrip("/"), os.path.split(key)[-1]):
            try:
                path = (self._folder / candidate).resolve()
            except (OSError, ValueError, RuntimeError):  # too long, a NUL, links in a circle
                continue
            if path.is_relative_to(self._within) and is_regular_file(path):
                data = read_file(path, self._left)
                self._left -= len(data)
                return data
        raise FileNotFoundError(key)

    def keys(self) -> Iterable[str]:
        """Return no names: trimesh looks up only the names in the mesh."""
        return ()

    def namespaced(self, namespace: str) -> MeshResources:
        """Return the same folder."""
        return self

    def write(self, name: str, data: str | bytes) -> None:
        """Raise PermissionError: reading a mesh writes nothing."""
        raise PermissionError(name)
