"""Objects that are one mesh in a file."""

from __future__ import annotations

import glob
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from data_prep.clouds.orientations import OURS, Orientation
from data_prep.datasets.objects import MeshObject
from data_prep.failures import BadInput
from data_prep.files.checksums import fingerprint_of
from data_prep.files.mesh_resources import files_behind, missing_files
from data_prep.files.meshes import (
    LOADER_VERSION,
    MOST_BYTES,
    SUFFIXES,
    load_mesh,
    read_contents,
)
from data_prep.files.safe_read import is_hidden, is_regular_file
from data_prep.scene import Mesh

# Suffixes of the files that a mesh may refer to for its colours: a material library, and textures.
MATERIALS = (".mtl", ".png", ".jpg", ".jpeg", ".bmp", ".tga", ".tif", ".tiff", ".gif")


@dataclass(frozen=True)
class MeshFile(MeshObject):
    """An object whose mesh is in a file.

    class_name   the class of the object
    object_id    its id, unique within the class
    path         the file of the mesh
    folder       the folder of this object alone, with its materials and textures: they are read
                 from nowhere else. None for a file that lies among those of other objects.
    orientation  the axes of the file that point up and to the front
    """

    class_name: str
    object_id: str
    path: Path
    folder: Path | None = None
    orientation: Orientation = OURS

    def fingerprint(self) -> str:
        """Return a checksum of all that decides the mesh; for an unreadable file a text on that.

        That is the file, its resources, its orientation and the version of the loader. Resources
        are the files that the mesh refers to, and those that seem to belong to it: for an object
        with a folder of its own the materials and images there, and for any other object the files
        with the name of its mesh and another suffix (materials, buffers, textures).
        """
        version = f"loader {LOADER_VERSION}"
        turn = self.orientation.columns, self.orientation.signs
        if turn != (OURS.columns, OURS.signs):
            version = f"{version} {turn}"
        return fingerprint_of(version, self.path, self._resources, MOST_BYTES)

    def load(self) -> Mesh:
        """Read, turn and normalise the file."""
        return load_mesh(self.path, self.orientation, self.folder)

    def missing_files(self) -> tuple[str, ...]:
        """Return the names that the mesh and its materials have for files that are not there.

        They are searched for in the text of the file, which is not parsed. Of a mesh that cannot be
        read there are none.
        """
        try:
            return missing_files(self.path, MOST_BYTES, self.folder)
        except BadInput:
            return ()

    def notes(self) -> tuple[str, ...]:
        """Return lines on what the mesh names but could not be found or read.

        Raises BadInput as `load` does.
        """
        return read_contents(self.path, self.folder).notes

    def _resources(self) -> Iterator[Path]:
        """Yield the files that seem to be the object's, and then those that the mesh refers to."""
        known = set()
        for path in filter(is_regular_file, self._files_near()):
            known.add(path.resolve())
            yield path
        for path in files_behind(self.path, MOST_BYTES, self.folder):
            if path.resolve() not in known:
                yield path

    def _files_near(self) -> Iterator[Path]:
        """Yield the files that seem to belong to the object, whether or not the mesh names them."""
        if self.folder is None:
            for path in sorted(self.path.parent.glob(f"{glob.escape(self.path.stem)}.*")):
                if path.suffix.lower() not in SUFFIXES:
                    yield path
            return
        # Without repetition, as a mesh may itself be in the folder "images".
        for folder in dict.fromkeys((self.path.parent, self.folder / "images")):
            for path in sorted(folder.glob("*")):
                if path.suffix.lower() in MATERIALS and not is_hidden(path.name):
                    yield path
