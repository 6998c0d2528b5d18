"""The files that a mesh may refer to: its own materials, textures and buffers, nothing else.

trimesh before 5.0 read whatever path a mesh gave, and no version asks what kind of file stands
there.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from trimesh.resolvers import Resolver

from data_prep.files.safe_read import is_regular_file, read_file


class MeshResources(Resolver):
    """Regular files in `folder` and below, of `most_bytes` together; links may not lead out.

    Names are taken as trimesh 5 takes them: a path that leads out of the folder stands for the file
    of that name in it. URLs are such paths, so that the net is never asked. Where the files of one
    mesh lie in several folders (ShapeNetCore.v2: models/ and images/), `within` is what they have
    in common, and paths may lead anywhere in it.
    """

    def __init__(self, folder: Path, most_bytes: int, within: Path | None = None) -> None:
        self._folder = folder.resolve()
        self._within = (within or folder).resolve()
        self._left = most_bytes

    def get(self, key: str) -> bytes:
        """The bytes of a file. Raises FileNotFoundError, and BadInput where it is too large."""
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
        """No names: nobody needs to look around."""
        return ()

    def namespaced(self, namespace: str) -> MeshResources:
        """The same folder."""
        return self

    def write(self, name: str, data: str | bytes) -> None:
        """Raises PermissionError: reading a mesh writes nothing."""
        raise PermissionError(name)
