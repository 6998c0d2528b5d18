"""What other installed packages add: methods, metrics, extractors and datasets, by entry points."""

from __future__ import annotations

import re
from typing import Protocol, TypeVar

from data_prep.failures import BadInput

# Groups of entry points.
METHODS = "pc2pix_bench.methods"
METRICS = "pc2pix_bench.metrics"
EXTRACTORS = "pc2pix_bench.extractors"
DATASETS = "pc2pix_bench.datasets"

_KEBAB_CASE = re.compile("[a-z0-9]+(-[a-z0-9]+)*")


class _HasId(Protocol):
    @property
    def id(self) -> str: ...


Entry = TypeVar("Entry", bound=_HasId)


def announced_ids(group: str) -> tuple[str, ...]:
    """Ids that installed packages announce by entry points of a group, sorted; none is loaded."""
    from importlib.metadata import entry_points

    return tuple(sorted(entry_points(group=group).names))


def load_announced(
    group: str, wanted: str, kind: str, type_: type[Entry], named: str, names_files: bool = False
) -> Entry:
    """What a package announces under an id that is among `announced_ids`.

    `named` is the type as packages import it; with `names_files` the id has to be kebab-case.
    Raises BadInput, naming the package, where it cannot be loaded or is something else.
    """
    from importlib.metadata import entry_points

    (entry, *_) = entry_points(group=group, name=wanted)
    where = f"{kind} '{wanted}' of {entry.dist.name if entry.dist else entry.value}"
    try:
        found = entry.load()
    except (Exception, SystemExit) as error:  # whatever a stranger's module raises
        raise BadInput(
            f"{where}: {entry.value} cannot be loaded ({type(error).__name__}: {error}); fix or "
            "remove that package"
        ) from error
    if not isinstance(found, type_) or found.id != wanted:
        raise BadInput(
            f"{where}: {entry.value} is not a {named} with that id; fix or remove that package"
        )
    if names_files and not _KEBAB_CASE.fullmatch(wanted):
        raise BadInput(f"{where}: an id is kebab-case, it names files; rename it")
    return found
