"""ShapeNetCore as it is unpacked, version 1 or 2.

    v1    <synset>/<id>/model.obj                       up +Y, front +X
    v2    <synset>/<id>/models/model_normalized.obj     up +Y, front -Z

The path of an object tells its version, which decides how it is turned. Both are normalised again,
so that their different scales do not matter. Some models of v1 are mirrored (README.txt of v2;
shapenet.org/annotations): the files do not show it, and it is not undone.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from data_prep.clouds.orientations import SHAPENET_V1, SHAPENET_V2, Orientation
from data_prep.datasets.dataset import Dataset, DatasetListing, first_names
from data_prep.datasets.objects import Split
from data_prep.datasets.stored_meshes import MeshFile
from data_prep.datasets.synsets import class_names
from data_prep.failures import BadInput
from data_prep.files.safe_read import (
    MIB,
    folders_in,
    is_regular_file,
    plain_name,
    plain_text,
    read_file,
    read_text,
    shown,
)

_SYNSET = re.compile("[0-9]{8}")
_SPLIT_FILE = "all.csv"  # its columns are id,synsetId,subSynsetId,modelId,split
_TAXONOMY = "taxonomy.json"
MOST_LIST_BYTES = 64 * MIB  # the largest list; the published all.csv, of 51,300 objects, has 4 MiB
_SPLITS: Mapping[str, Split] = {"train": "train", "val": "validation", "test": "test"}


@dataclass(frozen=True)
class _Version:
    name: str
    path: tuple[str, ...]  # the path of the mesh within the folder of the object
    orientation: Orientation

    def place(self, class_name: str, folder: Path) -> MeshFile:
        file = folder.joinpath(*self.path)
        return MeshFile(class_name, folder.name, file, folder, self.orientation)


V1 = _Version("v1", ("model.obj",), SHAPENET_V1)
V2 = _Version("v2", ("models", "model_normalized.obj"), SHAPENET_V2)


def is_shapenet(root: Path) -> bool:
    """Return whether a folder looks like ShapeNetCore: a synset with a model in it."""
    return any(map(is_synset, folders_in(root)))


def is_synset(folder: Path) -> bool:
    """Return whether a folder is called like a synset and has a model among its first objects."""
    if not _SYNSET.fullmatch(folder.resolve().name):
        return False
    return any(_version_of(obj) for obj in folders_in(folder)[:100])


def shapenet_dataset(spec: str, root: Path) -> Dataset:
    """Return the objects of all synsets in a folder.

    The 13 classes of the paper have the paper's names; other synsets have their first name in
    taxonomy.json, or else their number. Splits are those of all.csv, which may be in the folder or
    beside it; without that file all objects are in one split. An object that all.csv names, but
    that is not on the disk, fails, unless its whole synset is missing.

    Raises BadInput where no synset holds a model, and for lists that cannot be read.
    """
    folders = {s.name: folders_in(s) for s in folders_in(root) if _SYNSET.fullmatch(s.name)}
    synsets = {  # the version of each object, None without a model
        synset: {folder.name: _version_of(folder) for folder in inner}
        for synset, inner in folders.items()
    }
    synsets = {synset: objects for synset, objects in synsets.items() if any(objects.values())}
    if not synsets:
        raise BadInput(
            f"{root}: no ShapeNetCore here; expected <synset>/<id>/{'/'.join(V1.path)} (v1) or "
            f"<synset>/<id>/{'/'.join(V2.path)} (v2)"
        )
    listing = DatasetListing()
    versions = sorted({v.name for s in synsets.values() for v in s.values() if v})
    if len(versions) > 1:
        listing.irregular.append(
            "objects of v1 and v2 side by side; each is turned as its own path says"
        )
    usual = V1 if versions == ["v1"] else V2
    names = class_names(_taxonomy(root, tuple(synsets)))
    lists = _split_lists(root, listing.irregular)
    for synset, contents in sorted(synsets.items(), key=lambda item: names[item[0]]):
        name, folder = names[synset], root / synset
        if empty := [object_id for object_id, version in contents.items() if version is None]:
            listing.irregular.append(
                f"{name}: {len(empty)} folders without a model: {first_names(empty)}"
            )
        objects = {i: v.place(name, folder / i) for i, v in sorted(contents.items()) if v}
        if lists is None:
            listing.objects += objects.values()
        else:
            absent = partial(_absent, usual, name, folder)
            listing.add_listed(name, objects, lists.get(synset, {}), absent)
    listing.irregular += _shared_ids(synsets, names)
    listing.splits = {s: listing.splits[s] for s in _SPLITS.values() if s in listing.splits}
    layout = f"ShapeNetCore {' and '.join(versions)}"
    orientations = (f"{v.name}: {v.orientation.message}" for v in (V1, V2) if v.name in versions)
    return listing.dataset(
        spec,
        layout if lists is not None else f"{layout}, without {_SPLIT_FILE}: one split",
        "; ".join(orientations),
    )


def _absent(version: _Version, class_name: str, folder: Path, object_id: str) -> MeshFile:
    return version.place(class_name, folder / object_id)


def _version_of(folder: Path) -> _Version | None:
    return next((v for v in (V2, V1) if is_regular_file(folder.joinpath(*v.path))), None)


def _shared_ids(
    synsets: Mapping[str, Mapping[str, _Version | None]], names: Mapping[str, str]
) -> list[str]:
    """Return a line about ids in several classes: ShapeNet has some models under two synsets."""
    classes: dict[str, list[str]] = {}
    for synset, contents in synsets.items():
        for object_id in (object_id for object_id, version in contents.items() if version):
            classes.setdefault(object_id, []).append(names[synset])
    twice = [f"{i} ({', '.join(sorted(c))})" for i, c in sorted(classes.items()) if len(c) > 1]
    return [f"{len(twice)} ids are in several classes: {first_names(twice)}"] if twice else []


def _taxonomy(root: Path, synsets: Sequence[str]) -> dict[str, str]:
    """Return ShapeNet's names of synsets; "" where taxonomy.json or an entry is missing."""
    names = dict.fromkeys(synsets, "")
    path = root / _TAXONOMY
    if not is_regular_file(path):
        return names
    data = read_file(path, MOST_LIST_BYTES)
    try:
        tree: Any = json.loads(data)
        for entry in tree:
            if entry["synsetId"] in names:
                names[entry["synsetId"]] = plain_text(entry["name"])
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise BadInput(
            f"{path}: not the taxonomy of ShapeNet ({error}); fetch it again, or remove it"
        ) from None
    return names


def _split_lists(root: Path, irregular: list[str]) -> dict[str, dict[Split, list[str]]] | None:
    """Return the ids by synset and split, in the order of all.csv; None without that file.

    The first line of a model counts; later ones are appended to `irregular`.
    """
    path = next(
        (p for p in (root / _SPLIT_FILE, root.parent / _SPLIT_FILE) if is_regular_file(p)), None
    )
    if path is None:
        return None
    lists: dict[str, dict[Split, list[str]]] = {}
    seen: dict[tuple[str, str], str] = {}
    again = []
    lines = read_text(path, MOST_LIST_BYTES).splitlines()
    try:
        for row in csv.DictReader(lines, strict=True):
            synset, model, split = (row[name] for name in ("synsetId", "modelId", "split"))
            key = plain_name(synset.zfill(8)), plain_name(model)
            if split not in _SPLITS:
                raise ValueError(f"{shown(split)} is no split")
            if key in seen:
                again.append(f"{model} ({seen[key]}, {split})")
                continue
            seen[key] = split
            lists.setdefault(key[0], {}).setdefault(_SPLITS[split], []).append(model)
    except (ValueError, KeyError, AttributeError, TypeError, csv.Error) as error:
        raise BadInput(
            f"{path}: not the split list of ShapeNet ({error}); expected the columns "
            "id,synsetId,subSynsetId,modelId,split with train, val or test"
        ) from None
    if again:
        irregular.append(
            f"{_SPLIT_FILE}: {len(again)} models are listed twice, "
            f"the first counts: {first_names(again)}"
        )
    return lists
