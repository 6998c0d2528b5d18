"""Plug-ins by the names that `bench test` takes, and the check of their import."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import TypeAlias, get_args

from bench.catalogue.conditions import CONDITIONS, load_condition
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import Method, as_method, check_module, find_method, load_object
from bench.catalogue.plugins import ImageMetric, SetMetric, find_metric, plugin_problem
from bench.check.contract.findings import ContractViolation
from bench.check.contract.session import Passed
from data_prep.clouds.conditions import Condition
from data_prep.datasets.dataset import Dataset, DatasetReader
from data_prep.datasets.registry import (
    find_reader,
    folder_of,
    is_dataset,
    open_dataset,
    read_dataset,
    reader_ids,
)
from data_prep.failures import BadInput
from data_prep.plugins import announced

# Packages whose import takes so long that a plug-in's module may not import them at its top.
HEAVY = (
    "torch",
    "scipy",
    "pandas",
    "skimage",
    "matplotlib",
    "trimesh",
    "pymeshlab",
    "open3d",
    "sklearn",
    "tensorflow",
    "jax",
    "numba",
    "cv2",
)
_SLOW_IMPORT_S = 2.0  # seconds; the import of a plug-in that takes longer is reported
# The conditions of this project, by id.
_OURS = {condition.id: condition for condition in CONDITIONS}


@dataclass(frozen=True)
class DatasetSource:
    """A dataset that can be opened any number of times; its id is the value of --dataset."""

    id: str
    open: Callable[[], Dataset]


_Target: TypeAlias = Method | ImageMetric | SetMetric | DatasetSource | Condition


def kind_of(target: _Target) -> type:
    """Return the type of a plug-in, one of the types of `_Target`."""
    return next(kind for kind in get_args(_Target) if isinstance(target, kind))


def check_name(name: str) -> None:
    """Raise BadInput for an unknown or refused name, without loading any plug-in."""
    module, colon, rest = name.partition(":")
    kinds = ("method", name), ("metric", name), ("condition", name), ("dataset", module)
    for kind, plugin_id in kinds:
        if problem := plugin_problem(kind, plugin_id):
            raise BadInput(problem)
    if is_dataset(name):
        if rest and module != "procedural":
            folder_of(rest)
    elif name in (*announced("method"), *announced("metric"), *announced("condition"), *_OURS):
        return
    elif colon and "@" not in module:
        check_module(name)
    else:
        find_method(name)


@cache
def find_target(name: str) -> _Target:
    """Return the plug-in of this name, which is loaded once in a process.

    Raises whatever its module raises while it is imported.
    """
    if is_dataset(name):
        if (kind := name.partition(":")[0]) in reader_ids():
            find_reader(kind)  # its module is loaded here
        return DatasetSource(name, partial(open_dataset, name))
    if name in announced("metric"):
        return find_metric(name)
    if name in _OURS:
        return _OURS[name]
    if name in announced("condition"):
        return load_condition(name)
    if name not in announced("method") and ":" in family_of(name):
        return _of_module(name)
    return find_method(name)


def _of_module(name: str) -> _Target:
    """Return the plug-in "MODULE:NAME[:FOLDER]" of a module in the current folder or path."""
    module, _, rest = name.partition(":")
    path, _, folder = rest.partition(":")
    target = load_object(module, path)
    if isinstance(target, (ImageMetric, SetMetric, Condition)):
        return target
    if isinstance(target, DatasetReader):
        if not folder:
            raise ContractViolation(f"a dataset is read from a folder; give {name}:FOLDER")
        spec = f"{target.id}:{folder}"
        return DatasetSource(spec, lambda: read_dataset(target, spec, folder_of(folder)))
    if (method := as_method(target, name)) is not None:
        return method
    raise ContractViolation(
        f"{path} is a {type(target).__name__}; expected a Method, ImageMetric, SetMetric, "
        "DatasetReader or Condition, or a class with the functions prepare and draw"
    )


def check_import(name: str) -> Passed:
    """Import the plug-in's module, which may neither be slow nor import a heavy package.

    The evidence for later steps is the type of the plug-in.
    """
    loaded, start = set(sys.modules), time.perf_counter()
    kind = kind_of(find_target(name))
    seconds = time.perf_counter() - start
    heavy = {module.partition(".")[0] for module in set(sys.modules) - loaded} & set(HEAVY)
    if heavy:
        raise ContractViolation(
            f"loads {', '.join(sorted(heavy))}; import them in the functions that need them",
            blocks=False,
            evidence=kind,
        )
    if seconds > _SLOW_IMPORT_S:
        raise ContractViolation(
            f"takes {seconds:.1f} s; do what takes long in the functions that need it",
            blocks=False,
            evidence=kind,
        )
    return Passed(f"{seconds:.1f} s, loads no heavy package", kind)
