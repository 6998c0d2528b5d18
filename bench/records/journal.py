"""A run's directory and its journal of finished jobs: a kill at any moment loses nothing.

    manifest.json        what was measured, with which versions, on which machine
    journal/NNNN.jsonl   one checksummed line per finished job, only ever appended to
    artifacts/           images and features of each job, named by the job's key
    records.parquet      the records of the last complete run, made from the journal
    features/*.parquet   the features behind the Fréchet distances, made from the artifacts
    jobs.parquet         what each artifact is of: all jobs of that run, in the order of its plan
    tables/              made from records and features

A line counts if its checksum fits and its artifact is intact; a job whose line does not count is
done again. A file with a line that does not count is archived in journal/set-aside/, and its good
lines are written into a new one.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from bench.records.artifacts import artifact_sha256
from bench.records.job import Job, Result
from bench.records.journal_line import counts, to_line, to_result
from bench.records.record import SCHEMA_VERSION
from data_prep.datasets.protocol_version import refuse_other_version
from data_prep.failures import BadInput, CannotWrite
from data_prep.files.atomic_write import atomic_write, sync_folder, write_whole
from data_prep.files.safe_read import MIB, read_file

MANIFEST = "manifest.json"
JOURNAL = "journal"
SET_ASIDE = "set-aside"
MOST_BYTES = 64 * MIB  # of a manifest: one line an object
FIXED = ("suite", "dataset", "views", "seed", "device")  # one directory, one value of each
PROTOCOL = "protocol"  # its version
SHARD = "shard"  # one value, too; manifests from before there were shards have none
TRUTH = "truth"  # likewise; there only where --truth has replaced the truth of the suite
COLOURED = "coloured"  # truth of the suites for which it can be replaced


class LinePosition(NamedTuple):
    """The place of a line in a journal file, in bytes, and its result without the records."""

    path: Path
    offset: int
    length: int
    result: Result


class JournalIndex:
    """The positions of the lines of a journal that count, by the keys of their jobs.

    The records, which are most of a line, are read back when they are asked for.
    """

    def __init__(self) -> None:
        self._positions: dict[str, LinePosition] = {}

    def __contains__(self, key: str) -> bool:
        return key in self._positions

    def find(self, key: str) -> Result | None:
        """Return the result of a job without its records; None for a job without a line."""
        position = self._positions.get(key)
        return None if position is None else position.result

    def read(self, key: str) -> Result:
        """Return the result of a job with all its records, read back from its line.

        Raises KeyError for a job without a line, and BadInput where the line has changed since the
        journal was opened.
        """
        path, offset, length, _ = self._positions[key]
        try:
            with path.open("rb") as shard:
                shard.seek(offset)
                line = shard.read(length)
        except OSError as error:
            raise BadInput(f"{path}: cannot be read ({error.strerror}); run again") from error
        result = to_result(line) if counts(line) else None
        if result is None or result.key != key:
            raise BadInput(f"{path}: the line at byte {offset} has changed; run again")
        return result

    def add_file(self, shard: Path) -> list[str]:
        """Add the lines of a journal file. Return what is wrong with the lines that do not count.

        A later line replaces an earlier one of the same job.
        """
        damage: list[str] = []
        for number, offset, line in _lines(shard):
            if not counts(line):
                torn = not line.endswith(b"\n")
                problem = "was cut short by the end of its run" if torn else "is damaged"
                damage.append(f"{shard}: line {number} {problem}; its job is done again")
            elif (result := to_result(line)) is not None:
                self.add(result, shard, offset, len(line))
        return damage

    def update(self, later: JournalIndex) -> None:
        """Add all lines of `later`; they replace earlier lines of the same jobs."""
        self._positions |= later._positions

    def add(self, result: Result, shard: Path, offset: int, length: int) -> None:
        """Add the line of a result; it replaces an earlier line of the same job."""
        self._positions[result.key] = LinePosition(shard, offset, length, result.without_records())


@dataclass
class Journal:
    """The finished jobs of a directory.

    Attributes
    ----------
    directory : Path
    index : JournalIndex
    damage : list of str
        What had to be archived or is done again, a line each.
    added : set of str
        The keys of the results that this start has appended.
    """

    directory: Path
    index: JournalIndex = field(default_factory=JournalIndex)
    damage: list[str] = field(default_factory=list)
    added: set[str] = field(default_factory=set)
    _file: BinaryIO | None = None

    def append(self, result: Result) -> None:
        """Write a result down; when this returns, a power cut cannot take it back."""
        if self._file is None:
            # A file for each start: a line torn by a power cut is never glued to the next one.
            path = _next_file(self.directory)
            path.parent.mkdir(exist_ok=True)
            self._file = path.open("xb")
            sync_folder(path.parent)
        line, offset = to_line(result), self._file.tell()
        self._file.write(line)
        self._file.flush()
        os.fsync(self._file.fileno())
        self.index.add(result, Path(self._file.name), offset, len(line))
        self.added.add(result.key)

    def usable(self, job: Job) -> Result | None:
        """Return the result of a job, without its records, if it need not be done again.

        It need not be where the journal has it and its artifact is intact.
        """
        result = self.index.find(job.key)
        if result is None or not result.has_images:
            return result
        if artifact_sha256(job.artifact) != result.artifact_sha256:
            self.damage.append(f"{job.artifact}: missing or altered; its job is done again")
            return None
        return result

    def all_usable(self, jobs: Iterable[Job]) -> dict[str, Result]:
        """Return the results, by key, of the jobs that need not be done again."""
        unique = {job.key: job for job in jobs}
        return {key: result for key, job in unique.items() if (result := self.usable(job))}

    def close(self) -> None:
        """Close the journal file of this start."""
        if self._file is not None:
            self._file.close()


@contextmanager
def open_journal(directory: Path) -> Iterator[Journal]:
    """Yield the directory's journal, to one process at a time.

    Raises BadInput where another run holds the directory.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _not_writable(directory, error) from error
    with _locked(directory):
        journal = Journal(directory)
        for file in _files(directory / JOURNAL):
            _add_or_replace(file, journal)
        try:
            yield journal
        finally:
            journal.close()


@contextmanager
def _locked(directory: Path) -> Iterator[None]:
    try:
        lock_file = (directory / "lock").open("w")
    except OSError as error:
        raise _not_writable(directory, error) from error
    with lock_file as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise BadInput(
                f"{directory}: another run is writing here; wait, or give --out"
            ) from error
        yield


def _not_writable(directory: Path, error: OSError) -> CannotWrite:
    return CannotWrite(f"{directory}: cannot be written ({error.strerror}); give --out")


def check_directory(directory: Path, manifest: Mapping[str, Any]) -> None:
    """Raise BadInput where a run described by `manifest` must not be written into `directory`."""
    if not _holds_run(directory):
        return
    stored = read_manifest(directory)
    for name in (*FIXED, SHARD, TRUTH):
        default = COLOURED if name == TRUTH else None
        present, wanted = stored.get(name, default), manifest.get(name, default)
        if present != wanted:
            raise BadInput(
                f"{directory}: holds a run of {name} {present!r}, not {wanted!r}; "
                "give another --out, or --fresh to start over"
            )


def _holds_run(directory: Path) -> bool:
    """Return whether there is a run. Raises BadInput where the directory holds something else."""
    if not directory.exists():
        return False
    if not directory.is_dir():
        raise BadInput(f"{directory}: is a file; give a folder with --out")
    if (directory / MANIFEST).exists():
        return True
    # A run that was killed before it had a manifest may have left these.
    names = [path.name for path in directory.iterdir() if path.name != "lock"]
    if any(not name.startswith(f".{MANIFEST}.") for name in names):
        raise BadInput(f"{directory}: not empty and not a run; give a new --out")
    return False


def read_finished(directory: Path, older: bool = False) -> dict[str, Any]:
    """Return the manifest of a finished run.

    Raises BadInput as `read_manifest`, and where the run is not finished: its records may then be
    those of another run.
    """
    manifest = read_manifest(directory, older)
    if manifest.get("finished") is None:
        raise BadInput(f"{directory}: the run is not finished; start it again with its command")
    return manifest


def read_manifest(directory: Path, older: bool = False) -> dict[str, Any]:
    """Return the manifest of a run.

    Raises BadInput where there is no run, and for one that is damaged, of a newer schema or of
    another version of the protocol, but for an earlier one with `older`.
    """
    path = directory / MANIFEST
    if not directory.exists():
        raise BadInput(f"{directory}: no such folder; give a run's folder")
    if not path.is_file():
        raise BadInput(f"{directory}: no run here ({MANIFEST} is missing); give a run's folder")
    try:
        manifest = json.loads(read_file(path, MOST_BYTES))
        schema = int(manifest["schema_version"])
        lacking = [name for name in FIXED if name not in manifest]
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        if isinstance(error, BadInput):
            raise
        raise BadInput(f"{path}: not a manifest ({error}); move it away and run again") from error
    if schema > SCHEMA_VERSION:
        raise BadInput(
            f"{directory}: written by a newer version (schema {schema}, this one reads up to "
            f"{SCHEMA_VERSION}); update pc2pix-bench or give another --out"
        )
    if lacking:
        raise BadInput(
            f"{path}: not a manifest (no {', '.join(lacking)}); move it away and run again"
        )
    manifest = {PROTOCOL: 1} | manifest  # the first version was not written down at first
    refuse_other_version(directory, manifest[PROTOCOL], older=older)
    return manifest


def write_manifest(directory: Path, manifest: Mapping[str, Any]) -> None:
    """Write the manifest, whole or not at all."""
    text = json.dumps(manifest, indent=2, ensure_ascii=False) + "\n"
    write_whole(directory / MANIFEST, text.encode())


def set_aside(directory: Path) -> Path | None:
    """Rename an old run out of the way (`--fresh`) and return its new place; None without a run.

    Raises BadInput where the directory is no run, and where another process is writing the run.
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
            raise _not_writable(directory.parent, error) from error


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("*.jsonl") if path.stem.isdecimal())


def _next_file(directory: Path) -> Path:
    """Return a name that no journal file of the directory has or had."""
    folder = directory / JOURNAL
    taken = [int(path.stem) for path in (*_files(folder), *_files(folder / SET_ASIDE))]
    return folder / f"{1 + max(taken, default=0):04d}.jsonl"


def read_index(directory: Path) -> JournalIndex:
    """Return the lines of a directory's journal that count; nothing is repaired."""
    index = JournalIndex()
    for file in _files(directory / JOURNAL):
        index.add_file(file)
    return index


def _add_or_replace(file: Path, journal: Journal) -> None:
    """Add a file to the journal; where a line is damaged, a new file with the others."""
    index = JournalIndex()
    damage = index.add_file(file)
    if damage:
        archived, repaired = _replace_file(file, journal.directory)
        journal.damage += [*damage, f"{file}: kept for you to look at as {archived}"]
        if repaired is not None:
            index.add_file(repaired)  # the same lines, in other places
    journal.index.update(index)


def _lines(file: Path) -> Iterator[tuple[int, int, bytes]]:
    """Yield number (from 1), first byte and bytes of each line that is not empty."""
    offset = 0
    with file.open("rb") as lines:
        for number, line in enumerate(lines, 1):
            if line != b"\n":
                yield number, offset, line
            offset += len(line)


def _replace_file(file: Path, directory: Path) -> tuple[Path, Path | None]:
    """Write the good lines into a new journal file, then archive the damaged one.

    Return the places of both; without good lines there is no new file.
    """
    archived, repaired = file.parent / SET_ASIDE / file.name, _next_file(directory)
    try:
        if any(counts(line) for _, _, line in _lines(file)):
            with atomic_write(repaired) as new, new.open("wb") as output:
                for _, _, line in _lines(file):
                    if counts(line):
                        output.write(line.removesuffix(b"\n") + b"\n")
        else:
            repaired = None
        archived.parent.mkdir(exist_ok=True)
        file.replace(archived)
        sync_folder(file.parent)
    except OSError as error:
        raise _not_writable(directory, error) from error
    return archived, repaired
