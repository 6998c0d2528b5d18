"""Objects that are one mesh in a file."""

from __future__ import annotations

import glob
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from data_prep.clouds.orientations import Orientation
from data_prep.datasets.objects import MeshObject
from data_prep.files.checksums import fingerprint_of
from data_prep.files.meshes import LOADER_VERSION, MOST_BYTES, SUFFIXES, load_mesh
from data_prep.files.safe_read import is_hidden, is_regular_file
from data_prep.scene import Mesh

MATERIALS = (".mtl", ".png", ".jpg", ".jpeg", ".bmp", ".tga", ".tif", ".tiff", ".gif")


@dataclass(frozen=True)
class MeshFile(MeshObject):
    """A mesh of a `folder:PATH`; its id is the path below the folder of its class."""

    class_name: str
    object_id: str
    path: Path

    def fingerprint(self) -> str:
        """Return a checksum of the file, its resources and the version of the loader.

        Resources are what the file refers to, and what has its name and another suffix: materials,
        buffers, textures. The fingerprint of an unreadable file says so.
        """
        version = f"loader {LOADER_VERSION}"
        return fingerprint_of(version, self.path, self._resources, MOST_BYTES)

    def load(self) -> Mesh:
        """Read and normalise the file."""
        return load_mesh(self.path)

    def _resources(self) -> Iterator[Path]:
        beside = sorted(self.path.parent.glob(f"{glob.escape(self.path.stem)}.*"))
        named = (path for path in beside if path.suffix.lower() not in SUFFIXES)
        return _resources(self.path, filter(is_regular_file, named))


@dataclass(frozen=True)
class PlacedMesh(MeshObject):
    """A mesh of a dataset whose axes have to be turned, with an id that is unique within its class.

    folder       of the object: materials and textures are read from nowhere else
    orientation  the axes of the file that point up and to the front
    """

    class_name: str
    object_id: str
    path: Path
    folder: Path
    orientation: Orientation

    def fingerprint(self) -> str:
        """Return a checksum of the file, its resources, its orientation and the loader's version.

        Resources are what the file refers to, and the materials and images beside it and in the
        folder `images`.
        """
        turn = self.orientation.columns, self.orientation.signs
        version = f"loader {LOADER_VERSION} {turn}"
        return fingerprint_of(version, self.path, self._resources, MOST_BYTES)

    def load(self) -> Mesh:
        """Read, turn and normalise the file."""
        return load_mesh(self.path, self.orientation, self.folder)

    def _resources(self) -> Iterator[Path]:
        folders = dict.fromkeys((self.path.parent, self.folder / "images"))
        near = (path for folder in folders for path in sorted(folder.glob("*")))
        visible = (path for path in near if not is_hidden(path.name))
        images = (path for path in visible if path.suffix.lower() in MATERIALS)
        return _resources(self.path, filter(is_regular_file, images), self.folder)


def _resources(mesh: Path, near: Iterable[Path], within: Path | None = None) -> Iterator[Path]:
    """Yield files near a mesh, and then what it refers to besides."""
    from data_prep.files.mesh_resources import files_behind  # loads trimesh

    known = set()
    for path in near:
        known.add(path.resolve())
        yield path
    yield from (p for p in files_behind(mesh, MOST_BYTES, within) if p.resolve() not in known)
