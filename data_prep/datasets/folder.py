"""Folders of meshes or of clouds; sub-folders are classes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_prep.clouds.normalise import normalise_points
from data_prep.clouds.orientations import OURS
from data_prep.clouds.sampling import random_subset, random_views
from data_prep.datasets.dataset import Dataset, DatasetListing, first_names
from data_prep.datasets.objects import SceneObject, StoredCloud
from data_prep.datasets.stored_meshes import MATERIALS, MeshFile
from data_prep.failures import BadInput
from data_prep.files.checksums import fingerprint_of
from data_prep.files.clouds import CLOUD_SUFFIXES, MOST_BYTES, clouds_below, load_points
from data_prep.files.meshes import SUFFIXES
from data_prep.files.safe_read import files_below
from data_prep.scene import CLOUD_SIZE, Mesh, PointCloud, View

# The suffixes of files that are taken for clouds. A .ply may hold a mesh or a cloud, and is taken
# for a mesh.
_BARE_SUFFIXES = tuple(suffix for suffix in CLOUD_SUFFIXES if suffix != ".ply")
_RESOURCES = (*MATERIALS, ".bin")  # the suffixes of files that belong to meshes
# Names of sub-folders, in small letters, that are splits and no classes.
_SPLIT_NAMES = {"train", "training", "test", "testing", "val", "valid", "validation"}


@dataclass(frozen=True)
class BareCloud(StoredCloud):
    """A cloud without mesh or images: it can be drawn, but there is nothing to score against."""

    class_name: str
    object_id: str
    path: Path

    @property
    def has_truth(self) -> bool:
        """Return False: a bare cloud has no true images."""
        return False

    def fingerprint(self) -> str:
        """Return the checksum of the file."""
        return fingerprint_of("cloud", self.path, tuple, MOST_BYTES)

    def load(self) -> Mesh:
        """Raise BadInput: a bare cloud has no mesh."""
        raise BadInput(f"{self.path}: a bare cloud has no mesh; give a mesh")

    def cloud(self, rng: np.random.Generator, count: int = CLOUD_SIZE) -> PointCloud:
        """Return the whole cloud in the unit sphere, or a random subset of `count` points.

        The points keep the order of the file.
        """
        points = load_points(self.path)
        try:
            cloud = normalise_points(points)
        except BadInput as error:
            raise BadInput(f"{self.path}: {error}") from error
        return random_subset(cloud, count, rng)

    def views(self, count: int, rng: np.random.Generator) -> tuple[View, ...]:
        """Return views drawn at random."""
        return random_views(count, rng)

    def truth(self, views: Sequence[View]) -> NDArray[np.uint8]:
        """Raise BadInput: a bare cloud has no true images."""
        raise BadInput(f"{self.path}: a bare cloud has no true images; draw it with bench render")


def folder_dataset(spec: str, root: Path) -> Dataset:
    """Return all meshes below a folder; of a folder without meshes, all clouds.

    Texts are clouds where they have rows of numbers. Sub-folders that hold such files are classes
    (and files beside them are left alone); a folder without such sub-folders has no classes. Raises
    BadInput where no mesh and no cloud exists, and where the sub-folders are splits.
    """
    (files, others), kind = files_below(root, SUFFIXES), "meshes"
    make: Callable[[str, str, Path], SceneObject] = MeshFile
    others = tuple(name for name in others if Path(name).suffix.lower() not in _RESOURCES)
    if not files:
        (files, others), kind, make = clouds_below(root, _BARE_SUFFIXES), "bare clouds", BareCloud
    if not files:
        raise BadInput(
            f"{root}: no mesh in this folder; expected {', '.join(SUFFIXES)} "
            f"(or clouds: {', '.join(_BARE_SUFFIXES)})"
            + (f"; it has {first_names(others)}" if others else "")
        )
    nested = tuple(file for file in files if file.parent != root)
    layout = f"a folder of {kind}" + (", sub-folders are classes" if nested else "")
    listing = DatasetListing()
    for file in nested or files:
        parts = file.relative_to(root).parts
        class_name, *rest = parts if nested else (root.resolve().name, *parts)
        listing.objects.append(make(class_name, "/".join(rest), file))
    if nested and (beside := len(files) - len(nested)):
        listing.irregular.append(f"{beside} files beside the sub-folders are left alone")
    listing.irregular += _splits(root, [file.relative_to(root).parts[:-1] for file in nested])
    dataset = listing.dataset(spec, layout, OURS.message)
    return replace(dataset, classes=dataset.classes if nested else (), left_out=first_names(others))


def _splits(root: Path, folders: Sequence[Sequence[str]]) -> list[str]:
    """Return a line about splits in the classes. Raises BadInput where the classes are splits."""
    tops = {folder[0] for folder in folders}
    if len(tops) > 1 and all(map(_is_split, tops)):
        raise BadInput(
            f"{root}: its sub-folders are splits ({', '.join(sorted(tops))}), not classes; give "
            f"one of them, as folder:{root / min(tops)}"
        )
    mixed = sorted({folder[0] for folder in folders if any(map(_is_split, folder[1:]))})
    return [f"{first_names(mixed)}: objects of all splits are taken together"] if mixed else []


def _is_split(name: str) -> bool:
    return name.lower() in _SPLIT_NAMES
