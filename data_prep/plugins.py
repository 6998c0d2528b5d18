"""Plug-ins: methods, metrics, extractors, datasets, conditions of other installed packages."""

from __future__ import annotations

import re
import sys
from collections.abc import Collection
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeVar

from data_prep.failures import BadInput
from data_prep.files.safe_read import shown

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

# Groups of entry points.
METHODS = "pc2pix_bench.methods"
METRICS = "pc2pix_bench.metrics"
EXTRACTORS = "pc2pix_bench.extractors"
_DATASETS = "pc2pix_bench.datasets"
CONDITIONS = "pc2pix_bench.conditions"
GROUPS = {
    "method": (METHODS,),
    "metric": (METRICS, EXTRACTORS),
    "dataset": (_DATASETS,),
    "condition": (CONDITIONS,),
}

# Kinds of datasets of this project. Not in `data_prep.datasets.registry`, which loads NumPy.
OUR_KINDS = ("procedural", "folder", "shapenet", "modelnet", "exported", "paper")

# Ids name files and stand in lists and in commands. The part after "@" is a variant of a method.
_ID = re.compile("[a-z0-9]+(-[a-z0-9]+)*")
_METHOD_ID = re.compile(f"{_ID.pattern}(@[a-z0-9]+([-.][a-z0-9]+)*)?")
_CONDITION_ID = re.compile(r"[a-z0-9]+(\.[0-9]+)?(-[a-z0-9]+(\.[0-9]+)?)*")  # "outliers-0.05"


def is_id(text: str) -> bool:
    """Return whether a text can be the id of a plug-in, without a variant."""
    return _ID.fullmatch(text) is not None


class _Plugin(Protocol):
    @property
    def id(self) -> str: ...


Entry = TypeVar("Entry", bound=_Plugin)


def entry_point_names(*groups: str) -> tuple[str, ...]:
    """Return the ids that installed packages register as entry points, sorted; load none."""
    from importlib.metadata import entry_points

    return tuple(sorted({name for group in groups for name in entry_points(group=group).names}))


@cache
def announced(kind: str) -> tuple[str, ...]:
    """Return the ids that installed packages announce for a kind, one of `GROUPS`; load none."""
    return entry_point_names(*GROUPS[kind])


def refusal(kind: str, wanted: str, ours: Collection[str]) -> str:
    """Return why the id of a plug-in cannot be used, with package and remedy, or "".

    `ours` are the ids of this project; the id of a method stands for its variants, too.
    """
    entries = _entries(kind, wanted)
    packages = sorted({_package(entry) for entry in entries})
    where = f"{kind} {shown(wanted)} of {' and of '.join(packages)}"
    pattern = {"method": _METHOD_ID, "condition": _CONDITION_ID}.get(kind, _ID)
    if not pattern.fullmatch(wanted):
        numbers = ", numbers like 0.05" if pattern is _CONDITION_ID else ""
        return (
            f"{where}: an id is kebab-case (a-z, 0-9 and single hyphens{numbers}), it names files; "
            "rename it in that package"
        )
    if wanted.partition("@")[0] in ours:
        return f"{where}: pc2pix-bench uses that id itself; rename it in that package"
    if len(entries) > 1:
        return f"{where}: there can be one of that id; rename or remove the others"
    return ""


def load_entry_point(
    kind: str,
    wanted: str,
    type_: type[Entry] | tuple[type[Entry], ...],
    named: str,
    ours: Collection[str],
) -> Entry:
    """Return the plug-in with an id that is `announced`.

    `named` is the type as packages import it, `ours` as in `refusal`. Raises BadInput, naming the
    package, where the id is refused, and where the entry cannot be loaded or has another type.
    """
    if problem := refusal(kind, wanted, ours):
        raise BadInput(problem)
    (entry,) = _entries(kind, wanted)
    where = f"{kind} '{wanted}' of {_package(entry)}"
    import numpy as np

    try:
        with np.errstate():  # a module may call np.seterr, which is of this process, not of it
            loaded = entry.load()
    except (Exception, SystemExit) as error:  # another package's module may raise anything
        raise BadInput(
            f"{where}: {entry.value} cannot be loaded ({type(error).__name__}: {error}); fix or "
            "remove that package"
        ) from error
    if not isinstance(loaded, type_) or loaded.id != wanted:
        raise BadInput(
            f"{where}: {entry.value} is not a {named} with that id; fix or remove that package"
        )
    return loaded


def entry_point_folder(kind: str, wanted: str) -> Path:
    """Return the folder of the module that a loaded plug-in is of."""
    (entry,) = _entries(kind, wanted)
    return Path(str(sys.modules[entry.module].__file__)).parent


def _entries(kind: str, wanted: str) -> list[EntryPoint]:
    from importlib.metadata import entry_points

    return [entry for group in GROUPS[kind] for entry in entry_points(group=group, name=wanted)]


def _package(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist else entry.value
