"""A run's directory and its journal of finished jobs: a kill at any moment loses nothing.

    manifest.json        what was measured, with which versions, on which machine
    journal/NNNN.jsonl   one checksummed line per finished job, only ever appended to
    artifacts/           images and features of each job, named by the job's key
    records.parquet      the records of the last complete run, made from the journal
    features/*.parquet   the features behind the Fréchet distances, made from the artifacts
    jobs.parquet         what each artifact is of: all jobs of that run, in the order of its plan
    tables/              made from records and features

A line counts if its checksum fits and its artifact is there with the right bytes; a job whose line
does not count is done again. Every start writes a journal file of its own, so that a line torn by
a power cut is never glued to the next one. A file with a line that does not count is archived
(journal/set-aside/), its good lines are written into a new one.

In memory are the places of the lines and what a run decides by; the records, which are most of a
line, are read back when they are asked for.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from bench.records.artifacts import artifact_sha256
from bench.records.job import NOTHING, Job, JobTiming, Result
from bench.records.record import SCHEMA_VERSION, Record
from data_prep.failures import BadInput, CannotWrite
from data_prep.files.atomic_write import atomic_write, sync_folder, write_whole
from data_prep.files.safe_read import MIB, read_file

MANIFEST = "manifest.json"
JOURNAL = "journal"
SET_ASIDE = "set-aside"
MOST_BYTES = 64 * MIB  # of a manifest: one line an object
_FIELDS = Record.__dataclass_fields__.keys()
FIXED = ("suite", "dataset", "views", "seed", "device")  # one directory, one value of each
PROTOCOL = "protocol"  # its version
SHARD = "shard"  # likewise; manifests from before there were any have none


@dataclass(frozen=True, slots=True)
class JobOutcome:
    """What became of a job, without its records.

    artifact_sha256  None where there are no images
    reason           why there are none; empty where there are
    timing           zeros for a job that was done by an earlier start
    """

    artifact_sha256: str | None
    reason: str
    timing: JobTiming = NOTHING

    @classmethod
    def of(cls, result: Result) -> JobOutcome:
        """A result without its records."""
        failed = result.artifact_sha256 is None and result.records
        reason = result.records[0].reason if failed else ""
        return cls(result.artifact_sha256, reason, result.timing)


class _Place(NamedTuple):
    """Where a line begins, and how long it is, in bytes; what became of its job."""

    path: Path
    offset: int
    length: int
    outcome: JobOutcome


class Lines:
    """The lines of a journal that count, by the keys of their jobs."""

    def __init__(self) -> None:
        self._places: dict[str, _Place] = {}

    def __contains__(self, key: str) -> bool:
        return key in self._places

    def outcome(self, key: str) -> JobOutcome | None:
        """What became of a job; None where no line says."""
        place = self._places.get(key)
        return None if place is None else place.outcome

    def result(self, key: str) -> Result:
        """The result of a job with all its records, read back from its line.

        Raises KeyError for a key without a line, and BadInput where the line is no longer what it
        was when the journal was opened.
        """
        path, offset, length, _ = self._places[key]
        try:
            with path.open("rb") as shard:
                shard.seek(offset)
                line = shard.read(length)
        except OSError as error:
            raise BadInput(f"{path}: cannot be read ({error.strerror}); run again") from error
        result = _to_result(line) if _counts(line) else None
        if result is None or result.key != key:
            raise BadInput(f"{path}: the line at byte {offset} has changed; run again")
        return result

    def take(self, shard: Path) -> list[str]:
        """Take over the lines of a journal file, and tell what is wrong with those left out."""
        damage: list[str] = []
        for number, offset, line in _lines(shard):
            if not _counts(line):
                torn = not line.endswith(b"\n")
                what = "was cut short by the end of its run" if torn else "is damaged"
                damage.append(f"{shard}: line {number} {what}; its job is done again")
            elif (result := _to_result(line)) is not None:
                self.put(result, shard, offset, len(line))
        return damage

    def update(self, later: Lines) -> None:
        """Take over all lines of `later`; they replace earlier ones of the same jobs."""
        self._places |= later._places

    def put(self, result: Result, shard: Path, offset: int, length: int) -> None:
        """Note the line of a result; it replaces an earlier one of the same job."""
        self._places[result.key] = _Place(shard, offset, length, JobOutcome.of(result))


@dataclass
class Journal:
    """The finished jobs of a directory.

    `damage` lists what had to be archived, `added` the keys that this start has appended.
    """

    directory: Path
    lines: Lines = field(default_factory=Lines)
    damage: list[str] = field(default_factory=list)
    added: set[str] = field(default_factory=set)
    _shard: BinaryIO | None = None

    def append(self, result: Result) -> None:
        """Write a result down; when this returns, a power cut cannot take it back."""
        if self._shard is None:
            path = _next_shard(self.directory)
            path.parent.mkdir(exist_ok=True)
            self._shard = path.open("xb")
            sync_folder(path.parent)
        line, offset = to_line(result), self._shard.tell()
        self._shard.write(line)
        self._shard.flush()
        os.fsync(self._shard.fileno())
        self.lines.put(result, Path(self._shard.name), offset, len(line))
        self.added.add(result.key)

    def usable(self, job: Job) -> JobOutcome | None:
        """What became of a job where it counts: written down, and its artifact unharmed."""
        outcome = self.lines.outcome(job.key)
        if outcome is None or outcome.artifact_sha256 is None:
            return outcome
        if artifact_sha256(job.artifact) != outcome.artifact_sha256:
            self.damage.append(f"{job.artifact}: missing or altered; its job is done again")
            return None
        return outcome

    def usable_of(self, jobs: Iterable[Job]) -> dict[str, JobOutcome]:
        """What became, by key, of those jobs that count."""
        once = {job.key: job for job in jobs}
        return {key: found for key, job in once.items() if (found := self.usable(job))}

    def close(self) -> None:
        """Close the journal file of this start."""
        if self._shard is not None:
            self._shard.close()


@contextmanager
def open_journal(directory: Path) -> Iterator[Journal]:
    """The directory's journal, for one process at a time.

    Raises BadInput where another run holds the directory.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _not_writable(directory, error) from error
    with _locked(directory):
        journal = Journal(directory)
        for shard in _shards(directory / JOURNAL):
            _read_shard(shard, journal)
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
    """Raises BadInput where a run described by `manifest` must not be written into `directory`."""
    if not _holds_run(directory):
        return
    found = read_manifest(directory)
    for name in (*FIXED, SHARD):
        there, wanted = found.get(name), manifest.get(name)
        if there != wanted:
            raise BadInput(
                f"{directory}: holds a run of {name} {there!r}, not {wanted!r}; "
                "give another --out, or --fresh to start over"
            )


def _holds_run(directory: Path) -> bool:
    """False where nothing is there yet. Raises BadInput where it is something else than a run."""
    if not directory.exists():
        return False
    if not directory.is_dir():
        raise BadInput(f"{directory}: is a file; give a folder with --out")
    if (directory / MANIFEST).exists():
        return True
    if any(not _of_a_start(path.name) for path in directory.iterdir()):
        raise BadInput(f"{directory}: not empty and not a run; give a new --out")
    return False


def _of_a_start(name: str) -> bool:
    """Whether a run that was killed before it had a manifest may have left this file."""
    return name == "lock" or name.startswith(f".{MANIFEST}.")


def read_finished(directory: Path) -> dict[str, Any]:
    """The manifest of a run that has come to its end; while it goes on, records are of another.

    Raises BadInput as `read_manifest`, and where the run was stopped.
    """
    manifest = read_manifest(directory)
    if manifest.get("finished") is None:
        raise BadInput(f"{directory}: the run is not finished; start it again with its command")
    return manifest


def read_manifest(directory: Path) -> dict[str, Any]:
    """Return the manifest of a run.

    Raises BadInput where there is no run, and for one that is damaged or of a newer version.
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
    return {PROTOCOL: 1} | manifest  # the first version was not written down at first


def write_manifest(directory: Path, manifest: Mapping[str, Any]) -> None:
    """Write the manifest, whole or not at all."""
    text = json.dumps(manifest, indent=2, ensure_ascii=False) + "\n"
    write_whole(directory / MANIFEST, text.encode())


def set_aside(directory: Path) -> Path | None:
    """Rename an old run out of the way (`--fresh`); nothing is deleted. None if there is none.

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


def to_line(result: Result) -> bytes:
    """A result as it stands in the journal: the checksum of its JSON, the JSON, a line feed."""
    body = json.dumps(
        {
            "key": result.key,
            "artifact_sha256": result.artifact_sha256,
            "records": [asdict(record) for record in result.records],
        },
        ensure_ascii=False,
    ).encode()
    return sha256(body).hexdigest().encode() + b" " + body + b"\n"


def _shards(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("*.jsonl") if path.stem.isdecimal())


def _next_shard(directory: Path) -> Path:
    """A name that no journal file has or had."""
    folder = directory / JOURNAL
    taken = [int(path.stem) for path in (*_shards(folder), *_shards(folder / SET_ASIDE))]
    return folder / f"{1 + max(taken, default=0):04d}.jsonl"


def read_lines(directory: Path) -> Lines:
    """The lines of a directory's journal that count; others are left alone."""
    found = Lines()
    for shard in _shards(directory / JOURNAL):
        found.take(shard)
    return found


def _read_shard(shard: Path, journal: Journal) -> None:
    found = Lines()
    damage = found.take(shard)
    if damage:
        kept, good = _replace_shard(shard, journal.directory)
        journal.damage += [*damage, f"{shard}: kept for you to look at as {kept}"]
        if good is not None:
            found.take(good)  # the same lines, in other places
    journal.lines.update(found)


def _lines(shard: Path) -> Iterator[tuple[int, int, bytes]]:
    """Number (from 1), first byte and bytes of each line that is not empty."""
    offset = 0
    with shard.open("rb") as file:
        for number, line in enumerate(file, 1):
            if line != b"\n":
                yield number, offset, line
            offset += len(line)


def _counts(line: bytes) -> bool:
    checksum, _, body = line.removesuffix(b"\n").partition(b" ")
    return sha256(body).hexdigest().encode() == checksum


def _to_result(line: bytes) -> Result | None:
    """The result in a line that counts; None for one of another schema: its key, which names the
    schema, is no job's any more."""
    values = json.loads(line.partition(b" ")[2])
    if any(record.keys() != _FIELDS for record in values["records"]):
        return None
    records = tuple(Record(**record) for record in values["records"])
    return Result(values["key"], records, values["artifact_sha256"])


def _replace_shard(shard: Path, directory: Path) -> tuple[Path, Path | None]:
    """Write the good lines into a new journal file, then set the damaged one aside.

    Both places; without good lines there is no new file.
    """
    aside, good = shard.parent / SET_ASIDE / shard.name, _next_shard(directory)
    try:
        if any(_counts(line) for _, _, line in _lines(shard)):
            with atomic_write(good) as new, new.open("wb") as file:
                for _, _, line in _lines(shard):
                    if _counts(line):
                        file.write(line.removesuffix(b"\n") + b"\n")
        else:
            good = None
        aside.parent.mkdir(exist_ok=True)
        shard.replace(aside)
        sync_folder(shard.parent)
    except OSError as error:
        raise _not_writable(directory, error) from error
    return aside, good
