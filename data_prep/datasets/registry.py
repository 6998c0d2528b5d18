"""The datasets that the command line knows, by their names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path

from data_prep.datasets.dataset import Dataset, DatasetReader
from data_prep.datasets.exported import exported_dataset
from data_prep.datasets.folder import BareCloud, folder_dataset
from data_prep.datasets.modelnet import is_modelnet, modelnet_dataset
from data_prep.datasets.objects import MeshObject, SceneObject, Split
from data_prep.datasets.paper import PaperObject, is_paper, paper_dataset
from data_prep.datasets.procedural import (
    PROCEDURAL_VERSION,
    ProceduralObject,
    procedural_dataset,
    relief_dataset,
    widened_dataset,
)
from data_prep.datasets.shapenet import is_shapenet, shapenet_dataset
from data_prep.datasets.stored_meshes import MeshFile, PlacedMesh
from data_prep.failures import BadInput, unknown
from data_prep.files.safe_read import shown
from data_prep.plugins import DATASETS, OUR_KINDS, entry_point_names, load_entry_point

__all__ = [
    "PROCEDURAL_VERSION",
    "BareCloud",
    "Dataset",
    "DatasetReader",
    "MeshFile",
    "MeshObject",
    "PaperObject",
    "PlacedMesh",
    "ProceduralObject",
    "SceneObject",
    "Split",
    "layout_of",
    "open_dataset",
]

_EMBEDDED: Mapping[str, Callable[[str], Dataset]] = {
    "procedural": partial(procedural_dataset, measured="test"),
    "procedural:validation": partial(procedural_dataset, measured="validation"),
    "procedural:sealed": partial(procedural_dataset, measured="sealed"),
    "procedural:novel-families": partial(procedural_dataset, measured="novel-families"),
    "procedural:widened": widened_dataset,
    "procedural:relief": relief_dataset,
}
_STORED: Mapping[str, Callable[[str, Path], Dataset]] = {
    "folder": folder_dataset,
    "shapenet": shapenet_dataset,
    "modelnet": modelnet_dataset,
    "exported": exported_dataset,
    "paper": paper_dataset,
}


def open_dataset(spec: str) -> Dataset:
    """Return the dataset of a name: `procedural`, or a kind and a folder (`folder:PATH`).

    Choices are made on `procedural:validation`. `procedural:sealed` is for final numbers alone,
    measured once per version of the protocol: no training, study or default uses it.
    `procedural:novel-families` has chairs of structures that no other split draws,
    `procedural:widened` a train split that varies more than the classes do, `procedural:relief`
    one with bevels, panels and free closed forms besides. Raises BadInput for an unknown kind, a
    missing folder, and what the kind cannot use.
    """
    if spec in _EMBEDDED:
        return _EMBEDDED[spec](spec)
    kind, _, location = spec.partition(":")
    if location and kind in _STORED:
        return _STORED[kind](spec, folder_of(location))
    if location and kind in reader_ids():
        return read_dataset(find_reader(kind), spec, folder_of(location))
    first, *others = _EMBEDDED
    forms = [first, *(f"{known}:PATH" for known in (*_STORED, *reader_ids())), *others]
    raise unknown(spec, forms, "dataset", near=_as_folder(spec))


def _as_folder(location: str) -> str:
    """Return the likely dataset of a user who gives a folder alone; "" for other words."""
    if ":" in location:
        return ""
    try:
        return f"{layout_of(location)}:{location}"
    except BadInput:  # no such folder, or none that can be read
        return f"folder:{location}" if "/" in location else ""


def is_dataset(text: str) -> bool:
    """Return whether a text is the name of a dataset, and not of a folder."""
    kind, colon, _ = text.partition(":")
    kinds = (*OUR_KINDS, *reader_ids())
    return text == "procedural" or bool(colon and kind in kinds)


@cache
def reader_ids() -> tuple[str, ...]:
    """Return the kinds of datasets that installed packages register, sorted; load none."""
    return entry_point_names(DATASETS)


def find_reader(kind: str) -> DatasetReader:
    """Return the reader of a kind that another package registers.

    Raises BadInput, naming the package, where it cannot be loaded.
    """
    named = "data_prep.datasets.dataset.DatasetReader"
    return load_entry_point((DATASETS,), kind, "dataset", DatasetReader, named, OUR_KINDS)


def read_dataset(reader: DatasetReader, spec: str, folder: Path) -> Dataset:
    """Return the dataset that another package's reader makes of a folder.

    Raises BadInput, naming the reader, for any exception of it.
    """
    try:
        dataset = reader.read(spec, folder)
    except BadInput:
        raise
    except (Exception, SystemExit) as error:  # another package's function may raise anything
        raise BadInput(
            f"dataset '{spec}': {type(error).__name__}: {error}; fix or remove the package that "
            f"adds '{reader.id}'"
        ) from error
    if not isinstance(dataset, Dataset):
        raise BadInput(f"dataset '{spec}': its package gives no Dataset; fix or remove it")
    return dataset


def layout_of(location: str) -> str:
    """Return the kind of dataset that a folder looks like, such as "shapenet".

    Raises BadInput where there is no such folder.
    """
    root = folder_of(location)
    if is_paper(root):
        return "paper"
    if is_shapenet(root):
        return "shapenet"
    return "modelnet" if is_modelnet(root) else "folder"


def folder_of(location: str) -> Path:
    """Return the folder that a name holds. Raises BadInput where it does not exist."""
    try:
        location.encode()
        root = Path(location).expanduser()
        exists = root.is_dir()
    except (OSError, RuntimeError, UnicodeEncodeError) as error:  # RuntimeError: no such user
        raise BadInput(
            f"{shown(location)}: not the name of a folder ({error}); give its path"
        ) from None
    if not exists:
        raise BadInput(f"{root}: no such folder; give the folder that holds your meshes")
    return root
