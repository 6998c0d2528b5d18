"""Where objects come from: the procedural set, or a folder of meshes.

An object is a small value that crosses process boundaries; its mesh is made or read where it is
needed.
"""

from __future__ import annotations

import glob
import hashlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

from data_prep.failures import BadInput
from data_prep.mesh_files import LOADER_VERSION, MOST_BYTES, SUFFIXES, load_mesh
from data_prep.randomness import generator
from data_prep.scene import Mesh
from data_prep.shapes.catalogue import CLASSES
from data_prep.untrusted import MIB, is_regular_file, open_file, shown

Split = Literal["train", "validation", "test"]
PROCEDURAL_VERSION = 1  # raise when a shape changes: finished work is then done again


class SceneObject(Protocol):
    """One object of a dataset."""

    @property
    def class_name(self) -> str:
        """The class it belongs to."""
        ...

    @property
    def object_id(self) -> str:
        """Unique within its class."""
        ...

    def fingerprint(self) -> str:
        """Changes whenever the mesh does."""
        ...

    def load(self) -> Mesh:
        """The normalised mesh. Raises BadInput where there is none to be had."""
        ...


@dataclass(frozen=True)
class ProceduralObject:
    """Number `index` of a split. The splits share no random numbers, hence no object."""

    class_name: str
    split: Split
    index: int

    @property
    def object_id(self) -> str:
        """For example "test-0007"."""
        return f"{self.split}-{self.index:04d}"

    def fingerprint(self) -> str:
        """Class, number and version of the procedure."""
        return f"procedural-{PROCEDURAL_VERSION}/{self.class_name}/{self.object_id}"

    def load(self) -> Mesh:
        """Draw the object."""
        rng = generator("procedural", self.class_name, self.split, self.index)
        return CLASSES[self.class_name].draw(rng).mesh()


@dataclass(frozen=True)
class MeshFile:
    """A mesh in a file; its id is the path below the folder of its class."""

    class_name: str
    object_id: str
    path: Path

    def fingerprint(self) -> str:
        """Checksum of the file, of its companions (same name, other suffix: .mtl, .bin, textures)
        and of the version of the loader; an unreadable file has a fingerprint that says so."""
        digest = hashlib.sha256(f"loader {LOADER_VERSION}".encode())
        path = self.path
        try:
            _update(digest, path)
            for path in sorted(self.path.parent.glob(f"{glob.escape(self.path.stem)}.*")):
                if path.suffix.lower() not in SUFFIXES and is_regular_file(path):
                    digest.update(os.fsencode(path.name))
                    _update(digest, path)
        except (BadInput, OSError) as error:
            return "unreadable: " + str(error).removeprefix(f"{path}: ")
        return digest.hexdigest()

    def load(self) -> Mesh:
        """Read and normalise the file."""
        return load_mesh(self.path)


@dataclass(frozen=True)
class Dataset:
    """Objects by class. `classes` is empty where the source does not tell classes apart.

    `measured` is the split that is taken where none is asked for; a folder has no splits.
    """

    id: str
    classes: tuple[str, ...]
    finite: tuple[SceneObject, ...] | None  # None: as many as one asks for
    measured: Split = "test"

    def objects(
        self,
        class_name: str,
        limit: int | None,
        endless_limit: int,
        split: Split | None = None,
    ) -> tuple[SceneObject, ...]:
        """The first `limit` objects of a class, in a fixed order.

        Without a limit: all there are, or `endless_limit` where the source has no end. A folder has
        no splits; one without classes gives all its objects for any class. Raises BadInput for a
        class that the source does not have.
        """
        if self.finite is None:
            if class_name not in self.classes:
                raise _unknown_class(self, class_name)
            count = endless_limit if limit is None else limit
            split = split or self.measured
            return tuple(ProceduralObject(class_name, split, i) for i in range(count))
        if not self.classes:
            return self.finite[:limit]
        found = tuple(o for o in self.finite if o.class_name == class_name)
        if not found:
            raise _unknown_class(self, class_name)
        return found[:limit]


def open_dataset(spec: str) -> Dataset:
    """The dataset named on the command line: `procedural` or `folder:PATH`.

    `procedural:validation` measures the split on which choices are made, so that the test split
    stays unseen until the end.
    In a folder, sub-folders that hold meshes are classes (and meshes beside them are left alone); a
    folder without such has no classes.
    Raises BadInput for an unknown kind, a missing folder, or one without a mesh file.
    """
    if spec == "procedural":
        return Dataset("procedural", tuple(CLASSES), None)
    if spec == "procedural:validation":
        return Dataset(spec, tuple(CLASSES), None, measured="validation")
    kind, colon, location = spec.partition(":")
    if kind != "folder" or not colon or not location:
        raise BadInput(
            f"unknown dataset '{spec}': use procedural, procedural:validation or folder:PATH"
        )
    try:
        location.encode()
        root = Path(location).expanduser()
        there = root.is_dir()
    except (OSError, RuntimeError, UnicodeEncodeError) as error:  # RuntimeError: no such user
        raise BadInput(f"{shown(location)}: not the name of a folder ({error})") from None
    if not there:
        raise BadInput(f"{root}: no such folder; give the folder that holds your meshes")
    files = _mesh_files(root)
    if not files:
        raise BadInput(f"{root}: no mesh in this folder; expected {', '.join(SUFFIXES)}")
    nested = tuple(f for f in files if f.parent != root)
    if not nested:
        return Dataset(spec, (), tuple(MeshFile(root.resolve().name, f.name, f) for f in files))
    objects = []
    for file in nested:
        class_name, *rest = file.relative_to(root).parts
        objects.append(MeshFile(class_name, "/".join(rest), file))
    return Dataset(spec, tuple(sorted({o.class_name for o in objects})), tuple(objects))


def _mesh_files(root: Path) -> tuple[Path, ...]:
    """All below `root`, sorted; links to folders are not followed, so that no circle matters.

    Raises BadInput for a folder that cannot be read, and for a name that is no text: records are.
    """
    found, waiting = [], [root]
    while waiting:
        path = folder = waiting.pop()
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    path = folder / entry.name
                    if entry.is_dir(follow_symlinks=False):
                        waiting.append(path)
                    elif path.suffix.lower() in SUFFIXES and is_regular_file(path):
                        str(path.relative_to(root)).encode()
                        found.append(path)
        except OSError as error:
            raise BadInput(
                f"{folder}: cannot be read ({error.strerror}); mend it, or give another folder"
            ) from error
        except UnicodeEncodeError:
            raise BadInput(
                f"{root}: the name {shown(os.fsencode(path.relative_to(root)))} is not UTF-8; "
                "rename it"
            ) from None
    return tuple(sorted(found))


def _update(digest: Any, path: Path) -> None:
    """Feed a file to a hash, piece by piece."""
    with open_file(path, MOST_BYTES) as file:
        while piece := file.read(MIB):
            digest.update(piece)


def _unknown_class(dataset: Dataset, class_name: str) -> BadInput:
    return BadInput(
        f"{dataset.id}: no class '{class_name}' (a sub-folder of that name); "
        f"found {', '.join(dataset.classes)}"
    )
