"""A run's folder: its manifest, its lock and its store.

manifest.json        what was measured, with which versions, on which machine
run.sqlite           finished jobs with scores, images and features (`bench.records.store`)
records.parquet      the records of the last complete run, which scripts read and this project not
tables/              the tables, which are made from the store
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import stat
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bench.records.job import SCHEMA_VERSION
from bench.records.store import MOST_VIEWS, STORE, Store, open_store
from data_prep.datasets.protocol_version import refuse_other_version
from data_prep.failures import BadInput, CannotWrite
from data_prep.files.atomic_write import write_whole
from data_prep.files.safe_read import MIB, is_hidden, read_file

MANIFEST = "manifest.json"
LOCK = "lock"
_ELSEWHERE = "give --out"  # the remedy where a folder cannot be written
MOST_BYTES = 64 * MIB  # the largest manifest that is read; it has a line for each object
# The entries of a manifest that have one value for all that a folder will ever hold.
FIXED = ("suite", "dataset", "views", "seed", "device")
# Further entries of a manifest.
PROTOCOL = "protocol"  # the version of the protocol
TRUTH = "truth"  # the kind of true images, also one value for ever; missing where it is COLOURED
CONDITION_IDENTITIES = "condition_identities"  # only where conditions are of other packages
COLOURED = "coloured"  # the kind of true images without --truth

_OBJECT = re.compile(r"[^/]+/.+", re.DOTALL)  # the class and the name of an object
_FACTS = {str: str}  # a mapping from texts to texts
_MOST_SHOWN = 40  # the most characters that a message quotes of a value
# The types of a manifest's entries. A value has the type that stands here; [A] is a list of values
# A, [A, B] a list of exactly two, {str: A} a mapping to values A. Where a mapping names its
# entries, each of them may be missing. Of the types in a tuple one has to fit.
_SCHEMA: Mapping[str, Any] = {
    **dict.fromkeys(("suite", "dataset", "device", "truth", "started", "code"), str),
    **dict.fromkeys(("schema_version", "protocol", "views", "seed", "workers", "planned"), int),
    **{name: [str] for name in ("methods", "conditions", "pairs", "triples", "cases", "command")},
    **dict.fromkeys(("objectives", "condition_identities", "skipped_metrics"), _FACTS),
    **dict.fromkeys(("feature_identity", "environment", "versions"), _FACTS),
    **{name: {str: (int, float)} for name in ("stage_seconds", "worker_shares")},
    "finished": (None, str),
    "added": [[str]],
    "identities": {str: [int, str, str]},
    "environments": [{"jobs": int, str: str}],
    "entered": {str: {"tree": str, "name": str}},
    "objects": [_OBJECT],
    "threads": [int],
    "weights": {str: _FACTS},
    "machine": {"cpu": str, "platform": str, "instructions": str, "cores": int}
    | {"memory_gib": (int, float)},
    "git": {"commit": str, "clean": bool},
    "cluster": (None, dict.fromkeys(("address", "version"), str)),
    "request": {
        **dict.fromkeys(("suite", "dataset", "device", "truth", "inception_weights"), str),
        **{name: [str] for name in ("methods", "conditions", "metrics")},
        **dict.fromkeys(("limit", "views", "seed"), int),
    },
}
# The entries that the manifest of every run has from its start; all others may be missing.
_NEEDED = (
    "schema_version",
    "protocol",
    "request",
    "suite",
    "dataset",
    "views",
    "seed",
    "device",
    "methods",
    "environment",
    "command",
    "started",
    "finished",
    "versions",
    "machine",
)
# The further entries that the runs of suites of jobs have from their start.
_NEEDED_FOR_JOBS = (
    "identities",
    "objectives",
    "conditions",
    "objects",
    "skipped_metrics",
    "feature_identity",
    "planned",
)
# The further entries of suites with a procedure of their own, which have no jobs.
_NEEDED_FOR_PROCEDURES = {
    "latent": (),
    "stability": ("objects",),
    "speed": ("conditions", "objects"),
}
# What messages call the types of `_SCHEMA`.
_NAMES = {str: "text", int: "whole number", float: "number", bool: "truth value", None: "null"}


@contextmanager
def open_folder(directory: Path) -> Iterator[Store]:
    """Yield the store of a run's folder, which is locked against other processes meanwhile.

    Raises BadInput where another process holds the lock, on a file system without locks, and as
    `bench.records.store.open_store`; CannotWrite where the folder cannot be written.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise not_writable(directory, error) from error
    with _locked(directory), open_store(directory, write=True) as store:
        yield store


@contextmanager
def locked_run(directory: Path, remedy: str = "make it writable") -> Iterator[None]:
    """Let this process alone write into the folder of a run for as long as the block lasts.

    Raises BadInput as `read_manifest` and where another process writes there, and CannotWrite, with
    the remedy, where the folder cannot be written.
    """
    read_manifest(directory)  # first, so that no lock is made in a folder that holds no run
    with _locked(directory, remedy):
        yield


@contextmanager
def _locked(directory: Path, remedy: str = _ELSEWHERE) -> Iterator[None]:
    """Hold the lock of a folder. Raises BadInput at once where another process holds it."""
    with _open_lock(directory, remedy) as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            elsewhere = f", or {_ELSEWHERE}" if remedy == _ELSEWHERE else ""
            raise BadInput(f"{directory}: another run is writing here; wait{elsewhere}") from error
        except OSError as error:
            raise BadInput(
                f"{directory}: its file system has no locks ({error.strerror}); give --out on a "
                "local disk"
            ) from error
        yield


@contextmanager
def _open_lock(directory: Path, remedy: str) -> Iterator[int]:
    """Yield the open file of a folder's lock.

    The file may have been put there by anybody. So a link is not followed, which may lead to a file
    of the user; a pipe is not waited for, whose other end may never be opened; and nothing that is
    in the file is removed.
    """
    path = directory / LOCK
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        lock = os.open(path, flags, 0o666)
    except OSError as error:
        if path.is_symlink() or _is_special(path):
            raise _no_file(path) from error
        raise not_writable(directory, error, remedy) from error
    try:
        if not stat.S_ISREG(os.fstat(lock).st_mode):
            raise _no_file(path)
        yield lock
    finally:
        os.close(lock)


def _no_file(path: Path) -> BadInput:
    """Return the refusal of a path that is something else than a file of its folder."""
    return BadInput(f"{path}: no file of this folder, but a link, pipe or device; remove it")


def not_writable(directory: Path, error: OSError, remedy: str = _ELSEWHERE) -> CannotWrite:
    """Return the refusal of a folder that cannot be written, with the reason."""
    return CannotWrite(f"{directory}: cannot be written ({error.strerror}); {remedy}")


def check_directory(directory: Path, manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the manifest of the run in a folder; {} where there is none.

    Raises BadInput where the folder holds something else than a run, and where one of the entries
    FIXED or TRUTH differs from the given manifest.
    """
    if not _holds_run(directory):
        return {}
    stored = read_manifest(directory)
    for name in (*FIXED, TRUTH):
        present, wanted = entry(stored, name), entry(manifest, name)
        if present != wanted:
            raise BadInput(
                f"{directory}: holds a run of {name} {present!r}, not {wanted!r}; "
                "give another --out, or --fresh to start over"
            )
    return stored


def entry(manifest: Mapping[str, Any], name: str) -> Any:
    """Return an entry of a manifest, None where it is missing; a missing TRUTH is COLOURED."""
    return manifest.get(name, COLOURED if name == TRUTH else None)


def _holds_run(directory: Path) -> bool:
    """Return whether a folder holds a run.

    Raises BadInput where it is a file or holds something else than a run.
    """
    if not directory.exists():
        return False
    if not directory.is_dir():
        raise BadInput(f"{directory}: is a file; give a folder with --out")
    _refuse_special(directory)
    if (directory / MANIFEST).exists():
        return True
    # Files that a run may have left that was killed before it had a manifest.
    left_over = {LOCK, *(f"{STORE}{end}" for end in ("", "-wal", "-shm", "-journal"))}
    names = {path.name for path in directory.iterdir() if not is_hidden(path.name)}
    if names - left_over:
        raise BadInput(f"{directory}: not empty and not a run; give a new --out")
    return False


def read_finished(directory: Path) -> dict[str, Any]:
    """Return the manifest of a finished run.

    Raises BadInput for a run that is not finished, whose records may still be those of a run
    before, and as `read_manifest`.
    """
    manifest = read_manifest(directory)
    if manifest.get("finished") is None:
        raise BadInput(f"{directory}: the run is not finished; start it again with its command")
    return manifest


def read_manifest(directory: Path) -> dict[str, Any]:
    """Return the manifest of a run.

    Raises BadInput where there is no run, for links that lead out of the folder, for pipes and
    devices in it, and as `load_manifest`.
    """
    if not directory.exists():
        raise BadInput(f"{directory}: no such folder; give a run's folder")
    _refuse_special(directory)
    if not (directory / MANIFEST).is_file():
        raise BadInput(f"{directory}: no run here ({MANIFEST} is missing); give a run's folder")
    return load_manifest(directory / MANIFEST, directory)


def _refuse_special(directory: Path) -> None:
    """Raise BadInput for a link that leads out of a folder, for a pipe and for a device in it."""
    for path in directory.iterdir() if directory.is_dir() else ():
        # A command would wait for the other end of a pipe for ever, and it would write its tables
        # where a link leads.
        below = Path(os.path.realpath(path)).is_relative_to(os.path.realpath(directory))
        if path.is_symlink() and not below:
            raise BadInput(f"{path}: a link that leads out of the run's folder; put a copy there")
        if path.name == LOCK and path.is_symlink():
            raise _no_file(path)
        if _is_special(path):
            raise BadInput(f"{path}: no regular file but a pipe or device; remove it")


def _is_special(path: Path) -> bool:
    """Return whether a path is a pipe, a device or a link to one: no file and no folder."""
    return path.exists() and not (path.is_file() or path.is_dir())


def load_manifest(path: Path, where: Path | None = None, remedy: str = "") -> dict[str, Any]:
    """Return the manifest in a file, whose entries have the types of `_SCHEMA`.

    where   what messages about versions name, by default the file
    remedy  the remedy in messages, by default to run again

    Raises BadInput for a manifest that is damaged, of version 1.0.0, of a newer schema, or of
    another version of the protocol.
    """
    where = where or path
    instead = remedy or "move it away and run again"
    try:
        manifest = json.loads(read_file(path, MOST_BYTES))
        # Refuses texts with lone surrogates, which could not be written into another manifest.
        json.dumps(manifest, ensure_ascii=False).encode()
        schema = manifest["schema_version"]
        if type(schema) is not int:
            raise ValueError(f"schema_version is {schema!r:.40}, no whole number")
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        if isinstance(error, BadInput):
            raise
        raise BadInput(f"{path}: not a manifest ({error}); {instead}") from error
    if schema > SCHEMA_VERSION:
        raise BadInput(
            f"{where}: written by a newer version (schema {schema}, this one reads up to "
            f"{SCHEMA_VERSION}); update pc2pix-bench or give another --out"
        )
    if PROTOCOL in manifest:
        again = remedy or "run again with another --out or --fresh"
        refuse_other_version(where, manifest[PROTOCOL], again)
    if schema < SCHEMA_VERSION:
        raise BadInput(
            f"{where}: a run of version 1.0.0 or earlier (schema {schema}, this one reads "
            f"{SCHEMA_VERSION}), which this one does not read; "
            + (remedy or "start it again with another --out or --fresh")
        )
    if problem := _misfit_of(manifest):
        raise BadInput(f"{path}: not a manifest ({problem}); {instead}")
    return manifest


def write_manifest(directory: Path, manifest: Mapping[str, Any]) -> None:
    """Write the manifest, whole or not at all."""
    text = json.dumps(manifest, indent=2, ensure_ascii=False) + "\n"
    write_whole(directory / MANIFEST, text.encode())


def set_aside(directory: Path) -> Path | None:
    """Rename the folder of an old run, as `--fresh` does, and return its new path.

    Returns None where the folder holds no run.
    """
    if not _holds_run(directory):
        return None
    number = 1
    while (target := directory.with_name(f"{directory.name}.old-{number}")).exists():
        number += 1
    with _locked(directory):
        try:
            return directory.rename(target)
        except OSError as error:
            raise not_writable(directory.parent, error) from error


def _misfit_of(manifest: Mapping[str, Any]) -> str:
    """Return what is wrong with a manifest, in words; "" where nothing is.

    An entry may be missing, have another type than in `_SCHEMA`, be out of range, or have a name
    twice.
    """
    suite = str(manifest.get("suite"))
    needed = (*_NEEDED, *_NEEDED_FOR_PROCEDURES.get(suite, _NEEDED_FOR_JOBS))
    if lacking := [name for name in needed if name not in manifest]:
        return f"no {', '.join(lacking)}"
    if problem := _misfit(manifest, _SCHEMA, ""):
        return problem
    if not 1 <= manifest["views"] <= MOST_VIEWS:
        return f"views is {manifest['views']}, not 1 to {MOST_VIEWS}"
    for name in ("methods", "conditions", "objects"):
        counts = Counter(manifest.get(name, ()))
        repeated = [entry_name for entry_name, count in counts.items() if count > 1]
        if repeated:
            return f"{name} has {repeated[0]!r} twice"
    return ""


def _misfit(value: Any, wanted: Any, place: str) -> str:
    """Return the first place where a value has another type than in `_SCHEMA`, in words.

    wanted  the type, as `_SCHEMA` has it
    place   where the value stands in the manifest, as in "request.methods[0]"; "" for the whole

    Returns "" where the value and all values within it have their types.
    """
    if isinstance(wanted, tuple):
        problems = [_misfit(value, kind, place) for kind in wanted]
        return "" if "" in problems else problems[-1]
    if isinstance(wanted, list):
        return _misfit_of_list(value, wanted, place)
    if isinstance(wanted, dict):
        return _misfit_of_mapping(value, wanted, place)
    if _fits(value, wanted):
        return ""
    return _other(place, value, _NAMES.get(wanted, "class/name"))


def _misfit_of_list(value: Any, wanted: list[Any], place: str) -> str:
    """Return `_misfit` of a value that is to be a list: [A] of any length, [A, B] of two."""
    if not isinstance(value, list):
        kind = "list" if len(wanted) == 1 else f"list of {len(wanted)}"
        return _other(place, value, kind)
    if len(wanted) > 1 and len(value) != len(wanted):
        return _other(place, value, f"list of {len(wanted)}")
    for i, inner in enumerate(value):
        kind = wanted[0] if len(wanted) == 1 else wanted[i]
        if problem := _misfit(inner, kind, f"{place}[{i}]"):
            return problem
    return ""


def _misfit_of_mapping(value: Any, wanted: dict[Any, Any], place: str) -> str:
    """Return `_misfit` of a value that is to be a mapping.

    Where `wanted` names the entries, others that it does not name may have any type.
    """
    if not isinstance(value, dict):
        return _other(place, value, "object")
    for name, inner in value.items():
        kind = wanted.get(name, wanted.get(str, object))
        if problem := _misfit(inner, kind, f"{place}.{name}" if place else name):
            return problem
    return ""


def _other(place: str, value: Any, kind: str) -> str:
    """Return a message that a value is not of a kind, as in "views is 'many', no whole number"."""
    text = repr(value)
    text = text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}..."
    return f"{place} is {text}, no {kind}"


def _fits(value: Any, wanted: Any) -> bool:
    """Return whether a value is of a simple type of `_SCHEMA`, as the store and tables need it."""
    if isinstance(wanted, re.Pattern):
        return isinstance(value, str) and wanted.fullmatch(value) is not None
    if wanted is None:
        return value is None
    if wanted is int:
        return type(value) is int and abs(value) < 2**63
    if wanted is object:
        return True
    is_nan = value != value  # NaN is of type float, but no number that could be used
    return type(value) is wanted and not is_nan
