"""ModelNet10 and ModelNet40: OFF files, up +Z.

    <class>/train/<class>_0001.off, <class>/test/...    as published, and as aligned by hand
    <class>/<class>_0001.off, with modelnet40_train.txt, modelnet40_test.txt    an id in each line

Capitals in the names of splits and lists do not matter. The front is taken to be -Y
(`orientations.MODELNET` says why). ModelNet10 and the ModelNet40 of lmb-freiburg/orion are aligned;
in the original ModelNet40 objects face any direction.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from data_prep.clouds.orientations import MODELNET
from data_prep.datasets.dataset import Dataset, DatasetListing
from data_prep.datasets.objects import Split
from data_prep.datasets.stored_meshes import MeshFile
from data_prep.failures import BadInput
from data_prep.files.safe_read import (
    MIB,
    files_in,
    folders_in,
    plain_name,
    read_text,
)

MOST_LIST_BYTES = 4 * MIB  # the largest list; that of all 12,311 ids has 0.2 MiB
SPLITS: Sequence[Split] = ("train", "test")
OFF = (".off",)
CLASSES = {"monitor": "display"}  # classes that ShapeNet and the suites call by another name
_LIST = re.compile(r"(modelnet[0-9]+)_(train|test)\.txt", re.IGNORECASE)


def is_modelnet(root: Path) -> bool:
    """Return whether a folder has classes of ModelNet, or, without any sub-folder, split lists."""
    folders = folders_in(root)
    return any(map(is_class, folders)) or bool(not folders and _list_files(root))


def is_class(folder: Path) -> bool:
    """Return whether a folder has OFF files in train or test, or files such as chair_0001.off."""
    if any(files_in(split, OFF) for _, split in _split_folders(folder)):
        return True
    number = re.compile(re.escape(folder.resolve().name) + "_[0-9]{4}", re.IGNORECASE)
    return any(number.fullmatch(path.stem) for path in files_in(folder, OFF))


def modelnet_dataset(spec: str, root: Path) -> Dataset:
    """Return the objects of all classes in a folder; their ids are the names of their files.

    Splits are the folders train and test, or else those of the lists; without either, all objects
    are in one split. An object that a list names, but that is not on the disk, fails.

    Raises BadInput where there is no OFF file in a class, and for lists that cannot be read.
    """
    classes = {CLASSES.get(folder.name, folder.name): folder for folder in folders_in(root)}
    listing = DatasetListing()
    if any(_split_folders(folder) for folder in classes.values()):
        for class_name, folder in classes.items():
            _add_folders(listing, class_name, folder)
        layout = "ModelNet, with folders train and test"
    else:
        lists = _read_lists(root, listing.irregular)
        for class_name, folder in classes.items():
            on_disk = {path.stem: _object(class_name, path) for path in files_in(folder, OFF)}
            if lists:
                named: dict[Split, Sequence[str]] = {}
                for split, ids in lists.items():
                    named[split] = _ids_of(folder.name, ids)
                absent = partial(_absent, class_name, folder)
                listing.add_listed(class_name, on_disk, named, absent)
            else:
                listing.objects += on_disk.values()
        layout = "ModelNet, with split lists" if lists else "ModelNet, without splits"
    if not listing.objects:
        raise BadInput(
            f"{root}: no ModelNet here; expected <class>/train/<class>_0001.off or "
            "<class>/<class>_0001.off"
        )
    for its, ours in CLASSES.items():
        if ours in classes:
            layout += f"; {ours} is its {its}"
    return listing.dataset(spec, layout, MODELNET.message)


def _ids_of(class_name: str, ids: Sequence[str]) -> list[str]:
    """Return the ids of a class, such as "night_stand_0001" of the class night_stand."""
    return [object_id for object_id in ids if object_id.rpartition("_")[0] == class_name]


def _add_folders(listing: DatasetListing, class_name: str, folder: Path) -> None:
    """Add the objects in the folders train and test of a class."""
    ids: dict[Split, set[str]] = {split: set() for split in SPLITS}
    for split, inner in _split_folders(folder):
        objects = [_object(class_name, path) for path in files_in(inner, OFF)]
        listing.objects += objects
        listing.splits.setdefault(split, []).extend(objects)
        ids[split] |= {obj.object_id for obj in objects}
    if both := ids["train"] & ids["test"]:
        listing.irregular.append(f"{class_name}: {len(both)} ids are in train and in test")
    if beside := len(files_in(folder, OFF)):
        listing.irregular.append(f"{class_name}: {beside} files beside train and test are left out")


def _split_folders(folder: Path) -> list[tuple[Split, Path]]:
    """Return the folders of a class that are splits, train before test, and which each is."""
    inner = folders_in(folder)
    return [(split, path) for split in SPLITS for path in inner if path.name.lower() == split]


def _object(class_name: str, path: Path) -> MeshFile:
    return MeshFile(class_name, path.stem, path, path.parent, MODELNET)


def _absent(class_name: str, folder: Path, object_id: str) -> MeshFile:
    return _object(class_name, folder / f"{object_id}.off")


def _list_files(root: Path) -> dict[str, dict[Split, Path]]:
    """Return the files of split lists by name ("modelnet40") and split."""
    lists: dict[str, dict[Split, Path]] = {}
    for path in files_in(root, (".txt",)):
        if match := _LIST.fullmatch(path.name):
            split: Split = "train" if match[2].lower() == "train" else "test"
            lists.setdefault(match[1].lower(), {})[split] = path
    return lists


def _read_lists(root: Path, irregular: list[str]) -> dict[Split, list[str]]:
    """Return the ids by split, {} without lists.

    A line is appended to `irregular` for each id that is listed twice.
    """
    files = _list_files(root)
    if not files:
        return {}
    # modelnet10 is a part of modelnet40: where both lists are there, the larger one counts.
    name = max(files, key=lambda set_name: int(set_name.removeprefix("modelnet")))
    lists: dict[Split, list[str]] = {}
    seen: set[str] = set()
    for split, path in sorted(files[name].items(), reverse=True):  # train before test
        lines = read_text(path, MOST_LIST_BYTES).splitlines()
        try:
            ids = [plain_name(line.strip()) for line in lines if line.strip()]
        except ValueError as error:
            raise BadInput(f"{path}: {error}; expected an id in each line") from None
        lists[split] = []
        for object_id in ids:
            if object_id in seen:
                irregular.append(f"{path.name}: {object_id} is listed again and left out")
                continue
            seen.add(object_id)
            lists[split].append(object_id)
    return lists
