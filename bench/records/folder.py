"""A run's folder: its manifest, its lock, and its store.

manifest.json        what was measured, with which versions, on which machine
run.sqlite           finished jobs with scores, images and features (`bench.records.store`)
records.parquet      the records of the last complete run, written for scripts, not read here
tables/              made from the store
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import stat
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
_ELSEWHERE = "give --out"  # remedy where a folder cannot be written
MOST_BYTES = 64 * MIB  # of a manifest: one line an object
FIXED = ("suite", "dataset", "views", "seed", "device")  # a folder has one value of each for ever
PROTOCOL = "protocol"  # its version
TRUTH = "truth"  # one value, too; there only where it is not COLOURED
CONDITION_IDENTITIES = "condition_identities"  # there only for conditions of other packages
COLOURED = "coloured"  # the truth without --truth

_OBJECT = re.compile(r"[^/]+/.+", re.DOTALL)  # class and name
_FACTS = {str: str}
_MOST_SHOWN = 40  # characters of a value in a message
# A type is that of a value, [A] a list of A, [A, B] a list of two, {str: A} a mapping to A; a
# mapping of names has entries of which each may be missing; of several in a tuple one has to fit.
_SCHEMA: Mapping[str, Any] = {
    **dict.fromkeys(("suite", "dataset", "device", "truth", "started", "code"), str),
    **dict.fromkeys(("schema_version", "protocol", "views", "seed", "workers", "planned"), int),
    **{name: [str] for name in ("methods", "conditions", "pairs", "triples", "cases", "command")},
    **dict.fromkeys(("objectives", "condition_identities", "skipped_metrics"), _FACTS),
    **dict.fromkeys(("feature_identity", "environment", "versions"), _FACTS),
    **{name: {str: (int, float)} for name in ("stage_seconds", "worker_shares")},
    "finished": (None, str),
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
# Entries that every run has from its start; all others of `_SCHEMA` may be missing.
_NEEDED = (
    *("schema_version", "protocol", "request", "suite", "dataset", "views", "seed", "device"),
    *("methods", "environment", "command", "started", "finished", "versions", "machine"),
)
_OF_JOBS = (
    *("identities", "objectives", "conditions", "objects", "skipped_metrics"),
    *("feature_identity", "planned"),
)
# Suites with a procedure of their own measure other things.
_OF_PROCEDURES = {"latent": (), "stability": ("objects",), "speed": ("conditions", "objects")}
_NAMES = {str: "text", int: "whole number", float: "number", bool: "truth value", None: "null"}


@contextmanager
def open_folder(directory: Path) -> Iterator[Store]:
    """Yield the store of a run's folder, to one process at a time.

    Raises BadInput where another run holds the folder, on a file system without locks, and as
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
    read_manifest(directory)  # no lock is left in a folder that holds no run
    with _locked(directory, remedy):
        yield


@contextmanager
def _locked(directory: Path, remedy: str = _ELSEWHERE) -> Iterator[None]:
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
    """Yield the open file of a lock, which may have been put there by anybody.

    Nothing is followed, waited for or emptied: a link leads to a file of the user, and a pipe waits
    for its other end.
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
    return BadInput(f"{path}: no file of this folder, but a link, pipe or device; remove it")


def not_writable(directory: Path, error: OSError, remedy: str = _ELSEWHERE) -> CannotWrite:
    """Return the refusal of a folder that cannot be written, with the reason."""
    return CannotWrite(f"{directory}: cannot be written ({error.strerror}); {remedy}")


def check_directory(directory: Path, manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the manifest of the run in a folder, {} for none; refuse one of something else."""
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
    """Return an entry of a manifest, None where it has none; the truth has a default."""
    return manifest.get(name, COLOURED if name == TRUTH else None)


def _holds_run(directory: Path) -> bool:
    """Return whether there is a run. Raises BadInput where the directory holds something else."""
    if not directory.exists():
        return False
    if not directory.is_dir():
        raise BadInput(f"{directory}: is a file; give a folder with --out")
    _refuse_special(directory)
    if (directory / MANIFEST).exists():
        return True
    # A run that was killed before it had a manifest may have left these.
    left_over = {LOCK, *(f"{STORE}{end}" for end in ("", "-wal", "-shm", "-journal"))}
    names = {path.name for path in directory.iterdir() if not is_hidden(path.name)}
    if names - left_over:
        raise BadInput(f"{directory}: not empty and not a run; give a new --out")
    return False


def read_finished(directory: Path) -> dict[str, Any]:
    """Return the manifest of a finished run: the records of others may be those of another run."""
    manifest = read_manifest(directory)
    if manifest.get("finished") is None:
        raise BadInput(f"{directory}: the run is not finished; start it again with its command")
    return manifest


def read_manifest(directory: Path) -> dict[str, Any]:
    """Return the manifest of a run.

    Raises BadInput where there is no run, for links that lead out of it, pipes and devices, and as
    `load_manifest`.
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
        # A command would wait for a pipe for ever, and write tables where a link leads.
        below = Path(os.path.realpath(path)).is_relative_to(os.path.realpath(directory))
        if path.is_symlink() and not below:
            raise BadInput(f"{path}: a link that leads out of the run's folder; put a copy there")
        if path.name == LOCK and path.is_symlink():
            raise _no_file(path)
        if _is_special(path):
            raise BadInput(f"{path}: no regular file but a pipe or device; remove it")


def _is_special(path: Path) -> bool:
    """Return whether a path is there, and neither a file nor a folder nor a link to one."""
    return path.exists() and not (path.is_file() or path.is_dir())


def load_manifest(path: Path, where: Path | None = None, remedy: str = "") -> dict[str, Any]:
    """Return the manifest in a file, whose entries have the types of `_SCHEMA`.

    Raises BadInput for one that is damaged, of version 1.0.0, of a newer schema or of another
    version of the protocol. Messages about versions name
    `where`, by default the file; `remedy` is another one than to run again.
    """
    where = where or path
    instead = remedy or "move it away and run again"
    try:
        manifest = json.loads(read_file(path, MOST_BYTES))
        json.dumps(manifest, ensure_ascii=False).encode()  # lone surrogates cannot be written
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
    if schema < SCHEMA_VERSION or PROTOCOL not in manifest:
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
    """Rename an old run out of the way (`--fresh`); return its new place, or None without a run."""
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
    """Return what a manifest lacks, or the first entry of another type; "" where it fits."""
    needed = (*_NEEDED, *_OF_PROCEDURES.get(str(manifest.get("suite")), _OF_JOBS))
    if lacking := [name for name in needed if name not in manifest]:
        return f"no {', '.join(lacking)}"
    if problem := _misfit(manifest, _SCHEMA, ""):
        return problem
    if not 1 <= manifest["views"] <= MOST_VIEWS:
        return f"views is {manifest['views']}, not 1 to {MOST_VIEWS}"
    for name in ("methods", "conditions", "objects"):
        names = manifest.get(name, [])
        if len(names) > len({*names}):
            return f"{name} has {next(n for n in names if names.count(n) > 1)!r} twice"
    return ""


def _misfit(value: Any, wanted: Any, place: str) -> str:
    """Return the first place where a value has another type; "" where there is none."""
    if isinstance(wanted, tuple):
        problems = [_misfit(value, kind, place) for kind in wanted]
        return "" if "" in problems else problems[-1]
    if isinstance(wanted, list):
        if not isinstance(value, list) or len(wanted) not in (1, len(value)):
            return _other(place, value, "list" + f" of {len(wanted)}" * (len(wanted) > 1))
        inner = [(f"[{i}]", v, wanted[i % len(wanted)]) for i, v in enumerate(value)]
    elif isinstance(wanted, dict):
        if not isinstance(value, dict):
            return _other(place, value, "object")
        inner = [
            (f".{name}", v, wanted.get(name, wanted.get(str, object))) for name, v in value.items()
        ]
    else:
        return (
            "" if _fits(value, wanted) else _other(place, value, _NAMES.get(wanted, "class/name"))
        )
    problems = (_misfit(v, kind, f"{place}{at}".removeprefix(".")) for at, v, kind in inner)
    return next(filter(None, problems), "")


def _other(place: str, value: Any, kind: str) -> str:
    text = repr(value)
    text = text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}..."
    return f"{place} is {text}, no {kind}"


def _fits(value: Any, wanted: Any) -> bool:
    if isinstance(wanted, re.Pattern):
        return isinstance(value, str) and wanted.fullmatch(value) is not None
    if wanted is None:
        return value is None
    if wanted is int:
        return type(value) is int and abs(value) < 2**63
    return wanted is object or (type(value) is wanted and value == value)  # NaN is no number
