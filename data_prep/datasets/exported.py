"""A benchmark's inputs as files: `bench data export` writes them, `exported:PATH` reads them.

    objects.csv     a row for each object and its mesh: class, object, protocol, seed, dataset,
                    file, sha256
    clouds.csv      a row for each cloud, as methods see it: class, object, condition, points, file,
                    sha256
    views.csv       a row for each true image: class, object, view, azimuth_deg, elevation_deg,
                    camera_to_world (4 x 4, row by row), file, sha256
    clouds/         the clouds as PLY
    images/         the true images as PNG, 128 x 128 RGB
    meshes/         the meshes as PLY with colours of faces
    croissant.json  a description of all of this in the format Croissant (mlcommons.org/croissant)

A run on these files gives the tables of the run that they were exported from: clouds are float32
bit for bit, angles have all their digits, and images are stored without loss.
"""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from data_prep.clouds.orientations import OURS
from data_prep.clouds.sampling import random_subset
from data_prep.datasets.dataset import Dataset, DatasetListing
from data_prep.datasets.objects import StoredCloud, is_grey
from data_prep.datasets.protocol_version import refuse_other_version
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from data_prep.files.clouds import load_points
from data_prep.files.meshes import read_mesh
from data_prep.files.safe_read import MIB, is_regular_file, plain_text, read_file, read_text, shown
from data_prep.rendering.images import read_image
from data_prep.scene import CLOUD_SIZE, Mesh, PointCloud, View

METADATA = "croissant.json"
OBJECTS, CLOUDS, VIEWS = "objects.csv", "clouds.csv", "views.csv"
COLUMNS = {
    OBJECTS: ("class", "object", "protocol", "seed", "dataset", "file", "sha256"),
    CLOUDS: ("class", "object", "condition", "points", "file", "sha256"),
    VIEWS: (
        "class",
        "object",
        "view",
        "azimuth_deg",
        "elevation_deg",
        "camera_to_world",
        "file",
        "sha256",
    ),
}
UNPERTURBED = "2048"  # the condition that leaves the cloud of an object as it is
MOST_BYTES = 256 * MIB  # the largest list that is read


@dataclass(frozen=True)
class StoredFile:
    """A file and its checksum."""

    path: Path
    sha256: str

    def checked(self) -> Path:
        """Return the path. Raises BadInput for a missing file and another checksum."""
        if file_sha256(self.path) != self.sha256:
            raise BadInput(
                f"{self.path}: does not have the checksum of the list; fetch the dataset again"
            )
        return self.path


@dataclass(frozen=True)
class ExportedObject(StoredCloud):
    """An object of an export.

    mesh    the file of its mesh; None where it was exported without one
    clouds  the conditions and the files of its clouds
    images  the views and the files of its true images
    """

    class_name: str
    object_id: str
    mesh: StoredFile | None
    clouds: tuple[tuple[str, StoredFile], ...]
    images: tuple[tuple[View, StoredFile], ...]

    @property
    def exported_views(self) -> tuple[View, ...]:
        """Return all views that the object has images from, in their order."""
        return tuple(view for view, _ in self.images)

    def fingerprint(self) -> str:
        """Return a checksum of the listed checksums and angles, without reading the files."""
        mesh = None if self.mesh is None else self.mesh.sha256
        clouds = [(condition, file.sha256) for condition, file in self.clouds]
        images = [(view, file.sha256) for view, file in self.images]
        return hashlib.sha256(repr((mesh, clouds, images)).encode()).hexdigest()

    def load(self) -> Mesh:
        """Return the mesh as it was rendered. Raises BadInput where none was exported."""
        if self.mesh is None:
            raise BadInput(
                f"{self.class_name}/{self.object_id}: exported without a mesh; take another dataset"
            )
        return read_mesh(self.mesh.checked())

    @property
    def in_grey(self) -> bool:
        """Return whether the object was exported in neutral grey: its mesh, and so its images."""
        return self.mesh is not None and is_grey(self.load())

    def samples(self, condition: str) -> bool:
        """Return whether a cloud of the condition was exported, or can be sampled of the mesh."""
        return self.mesh is not None or condition in dict(self.clouds)

    def perturbed(self, condition: str) -> PointCloud | None:
        """Return the cloud that was exported for a condition, or None."""
        file = dict(self.clouds).get(condition)
        if file is None:
            return None
        points = load_points(file.checked()).astype(np.float32)
        return PointCloud(points, self.load() if self.mesh else None)

    def cloud(self, rng: np.random.Generator, count: int = CLOUD_SIZE) -> PointCloud:
        """Return the unperturbed cloud, or a random subset of `count` of its points.

        Raises BadInput where it was not exported.
        """
        cloud = self.perturbed(UNPERTURBED)
        if cloud is None:
            raise BadInput(
                f"{self.class_name}/{self.object_id}: no cloud of the condition {UNPERTURBED} in "
                f"{CLOUDS}; export it again"
            )
        return random_subset(cloud, count, rng)

    def views(self, count: int, rng: np.random.Generator) -> tuple[View, ...]:
        """Return the first `count` exported views. Raises BadInput where fewer were exported."""
        del rng
        if count > len(self.images):
            raise BadInput(
                f"--views {count}: {self.class_name}/{self.object_id} has {len(self.images)} true "
                f"images; give at most --views {len(self.images)}"
            )
        return tuple(view for view, _ in self.images[:count])

    def truth(self, views: Sequence[View]) -> NDArray[np.uint8]:
        """Return the images of these views. Raises BadInput where one cannot be read."""
        files = dict(self.images)
        return np.stack([read_image(files[view].checked())[0] for view in views])


def is_exported(root: Path) -> bool:
    """Return whether a folder has the lists of an export."""
    return all(is_regular_file(root / name) for name in COLUMNS)


def exported_dataset(spec: str, root: Path) -> Dataset:
    """Return all objects of an export, in their order, with the seed of the run exported.

    Raises BadInput, naming file and line, for a list that is missing or malformed, for a file
    outside the folder, for an object without clouds or images, for another protocol, and for
    objects of several seeds.
    """
    # First, because the other lists of an export of another protocol may have other columns.
    objects = [*_rows(root, OBJECTS)]
    clouds: dict[tuple[str, str], list[tuple[str, StoredFile]]] = {}
    images: dict[tuple[str, str], list[tuple[View, StoredFile]]] = {}
    for where, name, row in _rows(root, CLOUDS):
        object_clouds = clouds.setdefault(name, [])
        if row["condition"] in (condition for condition, _ in object_clouds):
            raise BadInput(f"{where}: {shown(row['condition'])} is there twice; export it again")
        object_clouds.append((row["condition"], _file(root, row, where)))
    for where, name, row in _rows(root, VIEWS):
        try:
            view = View(float(row["azimuth_deg"]), float(row["elevation_deg"]))
        except ValueError as error:
            raise BadInput(f"{where}: {error}; export it again") from None
        object_images = images.setdefault(name, [])
        if row["view"] != str(len(object_images)):
            raise BadInput(
                f"{where}: view {shown(row['view'])} where {len(object_images)} comes next; "
                "export it again"
            )
        object_images.append((view, _file(root, row, where)))
    listing = DatasetListing()
    seed = None
    for where, name, row in objects:
        seed = row["seed"] if seed is None else seed
        if row["seed"] != seed or not seed.isdecimal():
            raise BadInput(
                f"{where}: seed {shown(row['seed'])} in an export with --seed {shown(seed)}; "
                "export it again"
            )
        for file, rows in ((CLOUDS, clouds), (VIEWS, images)):
            if name not in rows:
                text = shown("/".join(name))
                raise BadInput(f"{where}: {text} is not in {file}; fetch it again")
        mesh = _file(root, row, where) if row["file"] else None
        listing.objects.append(
            ExportedObject(*name, mesh, tuple(clouds[name]), tuple(images[name]))
        )
    if not listing.objects:
        raise BadInput(f"{root / OBJECTS}: no object in this list; export it again")
    dataset = listing.dataset(spec, "clouds, views and true images of an export", OURS.message)
    return replace(dataset, seed=int(seed or 0), checksum=checksum_of(root))


def checksum_of(root: Path) -> str:
    """Return the checksum of all that a method sees of an export.

    It is the SHA-256 of `clouds.csv` followed by `views.csv`, as `cat clouds.csv views.csv |
    sha256sum` prints it.
    """
    lists = (read_file(root / name, MOST_BYTES) for name in (CLOUDS, VIEWS))
    return hashlib.sha256(b"".join(lists)).hexdigest()


def listed_files(root: Path) -> dict[str, str]:
    """Return the files of an export with their checksums, its lists included.

    Raises BadInput as `exported_dataset` does, also for another protocol, and for metadata without
    the checksums of the lists.
    """
    path = root / METADATA
    try:
        described = json.loads(read_text(path, MOST_BYTES))["distribution"]
        rows = [
            {"file": str(file["contentUrl"]), "sha256": str(file["sha256"])} for file in described
        ]
    except (ValueError, KeyError, TypeError) as error:
        if isinstance(error, BadInput):
            raise
        raise BadInput(f"{path}: no checksums of the lists ({error}); export it again") from None
    return {row["file"]: _file(root, row, str(path)).sha256 for row in rows} | {
        row["file"]: _file(root, row, where).sha256
        for name in COLUMNS
        for where, _, row in _rows(root, name)
        if row["file"]
    }


def _rows(root: Path, name: str) -> Iterator[tuple[str, tuple[str, str], dict[str, str]]]:
    """Yield file and line, class and object, and fields of each row of a list."""
    path, columns = root / name, COLUMNS[name]
    try:
        for number, fields in enumerate(csv.reader(read_text(path, MOST_BYTES).splitlines()), 1):
            if len(fields) != len(columns) or (number == 1 and tuple(fields) != columns):
                raise BadInput(f"{path}:{number}: expected {','.join(columns)}; export it again")
            if number > 1:
                row, where = dict(zip(columns, fields, strict=True)), f"{path}:{number}"
                if name == OBJECTS:
                    version = row["protocol"]
                    number_or_text = int(version) if version.isdecimal() else version
                    refuse_other_version(where, number_or_text, "export it again")
                yield where, (plain_text(row["class"]), plain_text(row["object"])), row
    except (csv.Error, ValueError) as error:
        if isinstance(error, BadInput):
            raise
        raise BadInput(f"{path}: {error}; export it again") from None


def _file(root: Path, row: dict[str, str], where: str) -> StoredFile:
    name = PurePosixPath(row["file"])
    if name.is_absolute() or ".." in name.parts or "\0" in row["file"]:
        raise BadInput(f"{where}: {shown(row['file'])} is outside of the folder; export it again")
    return StoredFile(root / name, row["sha256"])
