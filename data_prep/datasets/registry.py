"""The datasets that the command line knows, by their names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from data_prep.datasets.dataset import MOST_NAMED, Dataset, DatasetReader, first_names
from data_prep.datasets.exported import exported_dataset, is_exported
from data_prep.datasets.folder import BareCloud, folder_dataset
from data_prep.datasets.modelnet import SPLITS, is_class, is_modelnet, modelnet_dataset
from data_prep.datasets.objects import MeshObject, SceneObject, Split
from data_prep.datasets.paper import PaperObject, is_paper, paper_dataset
from data_prep.datasets.procedural import (
    PROCEDURAL_VERSION,
    ProceduralObject,
    ReliefObject,
    WidenedObject,
    procedural_dataset,
    training_dataset,
)
from data_prep.datasets.shapenet import is_shapenet, is_synset, shapenet_dataset
from data_prep.datasets.stored_meshes import MeshFile
from data_prep.failures import BadInput, unknown
from data_prep.files.safe_read import folders_in, is_disk, shown
from data_prep.plugins import OUR_KINDS, announced, load_entry_point

__all__ = [
    "PROCEDURAL_VERSION",
    "BareCloud",
    "Dataset",
    "DatasetReader",
    "MeshFile",
    "MeshObject",
    "PaperObject",
    "ProceduralObject",
    "SceneObject",
    "Split",
    "open_dataset",
    "recognised",
]

_EMBEDDED: Mapping[str, Callable[[str], Dataset]] = {
    "procedural": partial(procedural_dataset, measured="test"),
    "procedural:validation": partial(procedural_dataset, measured="validation"),
    "procedural:sealed": partial(procedural_dataset, measured="sealed"),
    "procedural:novel-families": partial(procedural_dataset, measured="novel-families"),
    "procedural:widened": partial(training_dataset, of_train=WidenedObject),
    "procedural:relief": partial(training_dataset, of_train=ReliefObject),
}
_STORED: Mapping[str, Callable[[str, Path], Dataset]] = {
    "folder": folder_dataset,
    "shapenet": shapenet_dataset,
    "modelnet": modelnet_dataset,
    "exported": exported_dataset,
    "paper": paper_dataset,
}
_LAYOUTS: Mapping[str, Callable[[Path], bool]] = {
    "exported": is_exported,
    "paper": is_paper,
    "shapenet": is_shapenet,
    "modelnet": is_modelnet,
}
# The most folders that are looked into on each level below a folder in which a dataset is searched
# for, so that the search ends soon.
_MOST_LOOKED_INTO = 500


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
        root = folder_of(location)
        _refuse_other_layout(kind, root)
        return _STORED[kind](spec, root)
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
        return recognised(location)
    except BadInput:  # no such folder, or none that can be read
        return f"folder:{location}" if "/" in location else ""


def is_dataset(text: str) -> bool:
    """Return whether a text is the name of a dataset, and not of a folder."""
    kind, colon, _ = text.partition(":")
    kinds = (*OUR_KINDS, *reader_ids())
    return text == "procedural" or bool(colon and kind in kinds)


def reader_ids() -> tuple[str, ...]:
    """Return the kinds of datasets that installed packages register, sorted; load none."""
    return announced("dataset")


def find_reader(kind: str) -> DatasetReader:
    """Return the reader of a kind that another package registers.

    Raises BadInput, naming the package, where it cannot be loaded.
    """
    named = "data_prep.datasets.dataset.DatasetReader"
    return load_entry_point("dataset", kind, DatasetReader, named, OUR_KINDS)


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


def recognised(location: str) -> str:
    """Return the dataset in a folder, or up to two levels below it, such as "shapenet:PATH".

    Raises BadInput where there is no such folder, and where it has several datasets.
    """
    root = folder_of(location)
    datasets = _datasets_at(root, location)
    if len(datasets) > 1:
        raise BadInput(f"{root}: has several datasets; give one of them: {first_names(datasets)}")
    return datasets[0] if datasets else f"folder:{location}"


def _kind_of(root: Path) -> str | None:
    return next((kind for kind, looks_so in _LAYOUTS.items() if looks_so(root)), None)


def _datasets_at(root: Path, location: str) -> list[str]:
    """Return the dataset that a folder is, or is a part of; else those up to two levels below."""
    if kind := _kind_of(root):
        return [f"{kind}:{location}"]
    part = root.resolve()
    if part.name.lower() in SPLITS:  # of a class of ModelNet
        part = part.parent
    for kind, is_part in (("modelnet", is_class), ("shapenet", is_synset)):
        if is_part(part):
            return [f"{kind}:{part.parent}"]
    level = [root]
    for _ in range(2):
        inner = [folder for outer in level for folder in folders_in(outer)]
        level = inner[:_MOST_LOOKED_INTO]
        kinds = [(_kind_of(folder), folder) for folder in level]
        if any(kind is not None for kind, _ in kinds):
            return [f"{kind}:{folder}" for kind, folder in kinds if kind is not None]
    return []


def _refuse_other_layout(kind: str, root: Path) -> None:
    """Raise BadInput where a folder has, by its layout, a dataset that `kind` would not read."""
    if kind in _LAYOUTS and _LAYOUTS[kind](root):
        return
    if others := _datasets_at(root, str(root)):
        kinds = " and ".join(sorted({other.partition(":")[0] for other in others}))
        problem = f"no {kind} in this folder itself"
        if kind == "folder":
            problem = f"has the layout of {kinds}, with axes and splits of its own"
        raise BadInput(
            f"{kind}:{root}: {problem}; give --dataset {' or '.join(others[:MOST_NAMED])}"
        )


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
    if is_disk(root):
        raise BadInput(f"{root}: a whole disk; give the folder on it that holds your meshes")
    return root
