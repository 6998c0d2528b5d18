"""The store of a run: one SQLite file with its jobs, their scores, their images and features.

    job     a row for each finished job, by its key: why it gave no images, its notes and times, the
            directions and scores of its views, the checksums of its images and features, the
            environment that it was made in, as JSON, and the checksum of all this
    blob    the images and the features of each extractor, apart: scores are read without images
    listed  the jobs of the last complete run, in the order of its plan
    metric  the metrics of `bench score`; what they gave for each job is in score

The checksum of a job is compared whenever a part of it is read. The other tables have an index over
all their columns, so that SQLite's own integrity check finds any difference between the two.

A result counts when its transaction is committed. A kill, a full disk or a power cut takes back
only a result that has not been committed. While a run goes on, its last transactions lie in
`run.sqlite-wal`; the next process that opens the file folds them in.
"""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import astuple, dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.records.job import (
    GROUND_TRUTH,
    IMAGES,
    JOB,
    MOST_BYTES,
    MOST_TEXT,
    OF_VIEWS,
    JobName,
    Result,
    stored_text,
    unpack,
)
from data_prep.arrays import Floats
from data_prep.failures import BadInput, CannotWrite
from data_prep.files.safe_read import is_regular_file

STORE = "run.sqlite"
_APPLICATION_ID = 0x70633270  # "pc2p", in the header of the file
_STORE_VERSION = 4
PATIENCE_S = 10.0  # for a reader in another process to let go
_MOST_NUMBER = 1e300  # greater ones overflow in sums
MOST_VIEWS = 2**16
_MOST_DECIMALS = 6
_SCHEMA = """
CREATE TABLE IF NOT EXISTS job (
    id INTEGER PRIMARY KEY,
    key TEXT NOT NULL UNIQUE,
    suite TEXT NOT NULL, reason TEXT NOT NULL, notes TEXT NOT NULL,
    prepare_s REAL, draw_s REAL,
    views BLOB NOT NULL,
    blobs TEXT NOT NULL,
    environment TEXT NOT NULL,
    sha256 TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS blob (
    job INTEGER NOT NULL, name TEXT NOT NULL, data BLOB NOT NULL, PRIMARY KEY (job, name)
);
CREATE TABLE IF NOT EXISTS listed (
    place INTEGER PRIMARY KEY,
    method TEXT NOT NULL, condition TEXT NOT NULL, class TEXT NOT NULL, object TEXT NOT NULL,
    key TEXT NOT NULL,
    UNIQUE (method, condition, class, object, key)
);
CREATE INDEX IF NOT EXISTS of_object ON listed (class, object);
CREATE TABLE IF NOT EXISTS metric (
    id TEXT NOT NULL,
    version INTEGER NOT NULL, about TEXT NOT NULL, higher_is_better INTEGER NOT NULL,
    decimals INTEGER NOT NULL,
    UNIQUE (id, version, about, higher_is_better, decimals)
);
CREATE TABLE IF NOT EXISTS score (
    metric TEXT NOT NULL, job INTEGER NOT NULL, data BLOB NOT NULL,
    UNIQUE (metric, job, data)
);
"""
_JOB = "job.key, suite, reason, notes, prepare_s, draw_s, views, blobs, environment, sha256"
_OF_JOB = _JOB.partition(", ")[2]  # all but the key
_NAME = ", ".join(JOB)
_IS_CELL = "method = ? AND condition = ? AND class = ?"
_ARRAYS = "JOIN job USING (key) JOIN blob ON blob.job = job.id AND blob.name = ?"


class DamagedJob(BadInput):
    """A job whose images, features or records are not what was stored."""

    def __init__(self, path: Path, key: str, what: str = "images") -> None:
        named = key if key.isprintable() else repr(key)  # it may be damaged, too
        super().__init__(
            f"{path}: the {what} of job {named} are missing or altered; start the run again with "
            "its command, which finds and draws them anew"
        )
        self.path, self.key = path, key


class JobRow(NamedTuple):
    """A job of a complete run: its key, its name, and whether it gave images."""

    key: str
    name: JobName
    has_images: bool


@dataclass(frozen=True)
class ScoredMetric:
    """An image metric that a run was scored by."""

    id: str
    version: int
    about: str  # one line for people
    higher_is_better: bool
    decimals: int  # digits after the point that its values are printed with


class Store:
    """An open store; `open_store` gives one."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection
        self.appended = 0  # jobs, by this process
        self.environment: Mapping[str, str] = {}  # that the jobs appended are made in
        self._intact: set[str] = set()  # tables that SQLite has checked

    @property
    def is_empty(self) -> bool:
        """Return whether no job is finished."""
        return not self._rows("SELECT 1 FROM job LIMIT 1")

    @property
    def has_list(self) -> bool:
        """Return whether jobs of a complete run are listed, whole or damaged."""
        return bool(self._rows("SELECT 1 FROM listed LIMIT 1"))

    def find(self, keys: Collection[str]) -> dict[str, Result]:
        """Return the results of the finished jobs: key, suite, reason and environment alone."""
        rows = self._rows(
            f"SELECT key, suite, substr(reason, 1, {MOST_TEXT}), environment FROM job "
            "WHERE key IN (SELECT value FROM json_each(?))",
            json.dumps([*keys]),
        )
        return {row[0]: Result(*row[:3], environment=str(row[3])) for row in rows}

    def result(self, key: str) -> Result:
        """Return a job's result with its views, without arrays. Raises KeyError and DamagedJob."""
        return self._result(self._row(key))

    def _row(self, key: str) -> tuple[Any, ...]:
        for row in self._rows(f"SELECT {_JOB} FROM job WHERE key = ?", key):
            return row
        raise KeyError(key)

    def _result(self, row: tuple[Any, ...]) -> Result:
        """Return the result in a row, which may come from anywhere. Raises DamagedJob."""
        key, suite, reason, notes, prepare_s, draw_s, views, _, environment, checksum = row
        size = 8 * len(OF_VIEWS)
        if not (
            all(isinstance(text, str) for text in (key, suite, reason, notes, environment))
            and all(t is None or (type(t) is float and abs(t) < _MOST_NUMBER) for t in row[4:6])
            and isinstance(views, bytes)
            and len(views) % size == 0
            and len(views) <= MOST_VIEWS * size
            and not (np.abs(np.frombuffer(views, "<f8")) >= _MOST_NUMBER).any()
            and checksum == row_checksum(row[:-1])
        ):
            raise DamagedJob(self.path, str(key), "records")
        reason, notes = reason[:MOST_TEXT], notes[:MOST_TEXT]
        times = prepare_s, draw_s
        return Result(key, suite, reason, notes, *times, views, environment=environment)

    def array(self, key: str, name: str = IMAGES) -> bytes:
        """Return the packed images of a job, or its features by an extractor.

        Raises KeyError for a job without, and DamagedJob where they are missing or have changed.
        """
        joined = "job LEFT JOIN blob ON blob.job = job.id AND blob.name = ?"
        for *row, data in self._rows(f"SELECT {_JOB}, data FROM {joined} WHERE key = ?", name, key):
            self._result(tuple(row))  # refuses one that has changed
            if name in self._names(key, row[7]):
                return self._checked(key, name, row[7], data)
        raise KeyError(f"{name} of job {key}")

    def arrays(self, key: str) -> dict[str, bytes]:
        """Return the packed images and features of a job by name, as `array`."""
        row = self._row(key)
        self._result(row)  # refuses one that has changed
        return {name: self.array(key, name) for name in self._names(key, row[7])}

    def _names(self, key: str, blobs: object) -> dict[str, str]:
        with suppress(ValueError, TypeError, RecursionError):
            names = json.loads(blobs)  # type: ignore[arg-type]  # of any type in a foreign file
            if isinstance(names, dict):
                return names
        raise DamagedJob(self.path, key, "records")

    def _checked(self, key: str, name: str, blobs: object, data: object) -> bytes:
        digest = self._names(key, blobs).get(name)
        if not isinstance(data, bytes) or sha256(data).hexdigest() != digest:
            raise DamagedJob(self.path, key, name if name == IMAGES else f"features ({name})")
        return data

    def append(self, result: Result) -> None:
        """Store a result with its views and arrays, in place of an earlier one of its job.

        When this returns, a power cut cannot take it back. Raises CannotWrite where the disk is
        full or refuses; nothing of the result is stored then.
        """
        row = (
            *(result.key, result.suite, stored_text(result.reason), stored_text(result.notes)),
            *map(_stored_time, (result.prepare_s, result.draw_s)),
            result.views,
            json.dumps({name: sha256(data).hexdigest() for name, data in result.arrays.items()}),
            packed_environment(self.environment),
        )
        row = (*row, row_checksum(row))
        marks = ", ".join("?" * len(row))
        with self._transaction() as execute:
            _forget(execute, "key = ?", result.key)
            job = execute(
                f"INSERT INTO job ({_JOB.removeprefix('job.')}) VALUES ({marks})", row
            ).lastrowid
            for name, data in result.arrays.items():
                execute("INSERT INTO blob VALUES (?, ?, ?)", (job, name, data))
        self.appended += 1

    def forget_damaged(self) -> int:
        """Remove the jobs of which anything has changed, also of no complete run; count them."""
        damaged = set()
        for number, *row in self._each(f"SELECT id, {_JOB} FROM job"):
            try:
                self.arrays(self._result(tuple(row)).key)
            except (DamagedJob, KeyError):  # an index that is damaged does not find it
                damaged.add(number)
        with self._transaction() as execute:
            for number in damaged:
                _forget(execute, "id = ?", number)
        return len(damaged)

    def list_jobs(self, jobs: Iterable[tuple[str, JobName]]) -> None:
        """Note keys and names of a complete run's jobs, in its order, in place of those before."""
        with self._transaction() as execute:
            execute("DELETE FROM listed")
            for key, name in jobs:
                execute(f"INSERT INTO listed ({_NAME}, key) VALUES (?, ?, ?, ?, ?)", (*name, key))

    def _listed(
        self, columns: str, rest: str, *values: object
    ) -> Iterator[tuple[str, JobName, tuple[Any, ...]]]:
        """Yield key, name and some columns of jobs of the complete run. Raises BadInput."""
        query = f"SELECT {_NAME}, listed.key, {columns} FROM listed {rest}"
        for row in self._each(query, *values):
            if not all(isinstance(text, str) for text in row[:5]):
                raise self._damaged_list()
            yield row[4], JobName(*row[:4]), row[5:]

    def _refuse_damaged_list(self) -> None:
        if not self._is_intact("listed"):
            raise self._damaged_list()

    def _damaged_list(self) -> BadInput:
        return BadInput(
            f"{self.path}: the list of its jobs is damaged; start the run again with its command, "
            "which writes it anew"
        )

    def _is_intact(self, table: str) -> bool:
        """Return whether a table equals its index over all columns; looked at once."""
        if table not in self._intact:
            if self._rows(f"PRAGMA integrity_check({table})") != [("ok",)]:
                return False
            self._intact.add(table)
        return True

    def listed(self, *obj: str) -> Iterator[JobRow]:
        """Yield the jobs of the complete run, or of an object (class, name), in its order.

        Raises BadInput for a damaged list, and DamagedJob.
        """
        self._refuse_damaged_list()
        where = "WHERE class = ? AND object = ?" if obj else ""
        rest = f"LEFT JOIN job USING (key) {where} ORDER BY place"
        for key, name, row in self._listed(_OF_JOB, rest, *obj):
            yield JobRow(key, name, self._result((key, *row)).has_images)

    def environments(self) -> list[tuple[dict[str, str], int]]:
        """Return the environments of the complete run's jobs, each with its number of jobs.

        That of the most jobs comes first.
        """
        rows = self._rows(
            "SELECT environment, COUNT(*) FROM job WHERE key IN (SELECT key FROM listed) "
            "GROUP BY environment ORDER BY COUNT(*) DESC, environment"
        )
        return [(unpacked_environment(text), count) for text, count in rows]

    def results(self, **only: str) -> Iterator[tuple[JobName, Result]]:
        """Yield the complete run's jobs with their views, sorted by name, but for ground truths.

        `only` gives values of the columns in JOB. Raises DamagedJob where one is missing, too.
        """
        self._refuse_damaged_list()
        where = "".join(f" AND {JOB[JOB.index(name)]} = ?" for name in only)
        rest = f"LEFT JOIN job USING (key) WHERE method != '{GROUND_TRUTH}'{where} ORDER BY {_NAME}"
        before = ("",)
        for key, name, row in self._listed(_OF_JOB, rest, *only.values()):
            if name <= before:  # an index that is damaged gives one twice, and leaves another out
                raise DamagedJob(self.path, key, "records")
            before = name
            yield name, self._result((key, *row))

    def has_features(self, extractor: str) -> bool:
        """Return whether any job of the complete run has features by an extractor."""
        self._refuse_damaged_list()  # for `features` and `images_with`, cell by cell
        return any(self._listed("1", f"{_ARRAYS} LIMIT 1", extractor))

    def features(
        self, extractor: str, *cell: str, first: str = "", last: str = ""
    ) -> Iterator[tuple[str, NDArray[Any]]]:
        """Yield object and features [V, d] of a cell (method, condition, class), by object.

        `first` and `last` are the objects to begin and to end with. Raises DamagedJob.
        """
        rest = f"{_ARRAYS} WHERE {_IS_CELL} AND object BETWEEN ? AND ? ORDER BY object"
        values = (extractor, *cell, first, last)
        for key, name, (*row, data) in self._listed(f"{_OF_JOB}, data", rest, *values):
            self._result((key, *row))  # refuses one that has changed
            yield name.object_id, unpack(self._checked(key, extractor, row[6], data))

    def images_with(self, extractor: str, *cell: str) -> list[tuple[str, int]]:
        """Return a cell's objects that have features, sorted, with their numbers of views."""
        rest = f"{_ARRAYS} WHERE {_IS_CELL} ORDER BY object"
        rows = self._listed(_OF_JOB, rest, extractor, *cell)
        return [(name.object_id, self._result((key, *row)).count) for key, name, row in rows]

    def put_scores(self, metric: ScoredMetric, scores: Mapping[str, Floats]) -> None:
        """Store the scores [V] by a metric by the keys of jobs, in place of earlier ones."""
        with self._transaction() as execute:
            execute("DELETE FROM metric WHERE id = ?", (metric.id,))
            execute("INSERT INTO metric VALUES (?, ?, ?, ?, ?)", astuple(metric))
            execute("DELETE FROM score WHERE metric = ?", (metric.id,))
            for key, values in scores.items():
                data = np.asarray(values, "<f8").tobytes()
                execute(
                    "INSERT INTO score SELECT ?, id, ? FROM job WHERE key = ?",
                    (metric.id, data, key),
                )

    def metrics(self) -> dict[str, ScoredMetric]:
        """Return the metrics that jobs were scored by, by id; none that cannot be used."""
        usable = {}
        for row in (
            self._rows("SELECT * FROM metric ORDER BY id") if self._is_intact("metric") else ()
        ):
            fits = [*map(type, row)] == [str, int, str, int, int] and 0 <= row[4] <= _MOST_DECIMALS
            if fits:
                usable[row[0]] = ScoredMetric(row[0], row[1], row[2], bool(row[3]), row[4])
        return usable

    def scores(self, metric: str) -> Iterator[tuple[JobName, Floats | None]]:
        """Yield the scores [V] of the complete run's jobs that have images, sorted by name.

        None where a job has none, or others than were stored.
        """
        self._refuse_damaged_list()
        is_intact = self._is_intact("score")
        rest = (
            "JOIN job USING (key) LEFT JOIN score ON score.job = job.id AND score.metric = ? "
            f"WHERE method != '{GROUND_TRUTH}' ORDER BY {_NAME}"
        )
        for key, name, (*row, data) in self._listed(f"{_OF_JOB}, data", rest, metric):
            result = self._result((key, *row))
            if not result.has_images:
                continue
            fits = isinstance(data, bytes) and len(data) == 8 * result.count
            yield name, np.frombuffer(data, "<f8") if fits and is_intact else None

    def digest(self) -> str:
        """Return a checksum of the complete run's jobs: their names, records and images."""
        digest = sha256()
        for _, name, row in self._listed("sha256", f"LEFT JOIN job USING (key) ORDER BY {_NAME}"):
            digest.update(repr((name, row)).encode("utf-8", "replace"))
        return digest.hexdigest()

    def _rows(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        with _named(self.path):
            return self._connection.execute(query, values).fetchall()

    def _each(self, query: str, *values: object) -> Iterator[tuple[Any, ...]]:
        with _named(self.path):
            # `yield from` would close the cursor, perhaps after its connection.
            for row in self._connection.execute(query, values):  # noqa: UP028
                yield row

    @contextmanager
    def _transaction(self) -> Iterator[Callable[..., sqlite3.Cursor]]:
        with _named(self.path):
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield self._connection.execute
                self._connection.execute("COMMIT")
            except BaseException:
                with suppress(sqlite3.Error):  # SQLite has taken it back by itself
                    self._connection.execute("ROLLBACK")
                raise


def _stored_time(seconds: float | None) -> float | None:  # an author may claim anything
    return None if seconds is None or not abs(seconds) < _MOST_NUMBER else float(seconds)


def packed_environment(environment: Mapping[str, str]) -> str:
    """Return an environment as the store has it."""
    return json.dumps(environment, sort_keys=True)


def unpacked_environment(text: str) -> dict[str, str]:
    """Return an environment of the store; {} for a text that is none, which checksums refuse."""
    with suppress(ValueError, RecursionError):
        facts = json.loads(text)
        if isinstance(facts, dict):
            return {str(name): str(value) for name, value in facts.items()}
    return {}


def row_checksum(row: tuple[Any, ...]) -> str:
    """Return the checksum of the columns of a job that stand before it."""
    digest = sha256(repr((*row[:6], *row[7:])).encode("utf-8", "replace"))
    digest.update(row[6])
    return digest.hexdigest()


def _forget(execute: Callable[..., sqlite3.Cursor], where: str, value: object) -> None:
    """Remove the jobs that a condition is true of, with all that is theirs."""
    for table in ("blob", "score"):
        execute(f"DELETE FROM {table} WHERE job IN (SELECT id FROM job WHERE {where})", (value,))
    execute(f"DELETE FROM job WHERE {where}", (value,))


@contextmanager
def open_store(directory: Path, *, write: bool = False) -> Iterator[Store]:
    """Yield the store of a run's folder; an empty one where it has none and is only read.

    To write, the process holds the folder's lock (`bench.records.folder`). Raises BadInput for
    a file that is no store, is damaged, or of another version, and CannotWrite.
    """
    path = directory / STORE
    for end in ("", "-wal", "-shm", "-journal"):  # a pipe is opened for ever, a link leads out
        file = directory / f"{STORE}{end}"
        if os.path.lexists(file) and (file.is_symlink() or not is_regular_file(file)):
            raise BadInput(f"{file}: no file of this folder, but a link or a pipe; move it away")
    new = write and not path.exists()
    with _named(path), closing(_connect(path, write=write)) as connection:
        store = Store(path, connection)
        try:
            yield store
        finally:
            # Then it is one file, which can be read where nothing can be written. SQLite refuses
            # while another process reads, or on a full disk: the second file stays until later.
            if write:
                with suppress(sqlite3.OperationalError):
                    connection.execute("PRAGMA journal_mode = DELETE")
    if new and not store.appended:  # of a suite without jobs
        path.unlink()


def _connect(path: Path, *, write: bool) -> sqlite3.Connection:
    """Return a connection to a store; in memory, to an empty one, where there is none to read."""
    if write:
        connection = _limited(sqlite3.connect(path, timeout=PATIENCE_S, isolation_level=None))
        if not _is_store(path, connection):
            connection.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
            connection.execute(f"PRAGMA user_version = {_STORE_VERSION}")
            connection.executescript(_SCHEMA)
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = FULL")
        return connection
    if path.exists():
        # What a process that died has left of its first transactions is taken back.
        mode = "rw" if path.with_name(f"{STORE}-journal").exists() else "ro"
        uri = f"{path.absolute().as_uri()}?mode={mode}"
        connection = _limited(
            sqlite3.connect(uri, timeout=PATIENCE_S, isolation_level=None, uri=True)
        )
        if _is_store(path, connection):
            return connection
        connection.close()
    connection = sqlite3.connect(":memory:", isolation_level=None)
    connection.executescript(_SCHEMA)
    return connection


def _limited(connection: sqlite3.Connection) -> sqlite3.Connection:
    """Return a connection that reads no value beyond all measure, and no text that cannot be."""
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_BYTES)
    connection.text_factory = lambda data: data.decode("utf-8", "replace")
    return connection


def _is_store(path: Path, connection: sqlite3.Connection) -> bool:
    """Return whether a database has all tables: a process may have been killed before it made them.

    Raises BadInput for a database that is not a store of a version known here, and for one with
    anything beside: a view, a trigger or a virtual table may execute anything, and without end.
    """
    try:
        ((application,),) = connection.execute("PRAGMA application_id")
        ((version,),) = connection.execute("PRAGMA user_version")
        present = _statements(connection)
        if present and application != _APPLICATION_ID:
            raise BadInput(f"{path}: a database, but not the store of a run; move it away")
        if version > _STORE_VERSION:
            raise BadInput(
                f"{path}: store version {version} is newer than {_STORE_VERSION}; update "
                "pc2pix-bench"
            )
        if present and version < _STORE_VERSION:
            raise BadInput(
                f"{path}: a store of version 2.0.0 or earlier, which this one does not read; "
                "start the run again with another --out or --fresh"
            )
        if not present <= _own_statements():
            raise BadInput(f"{path}: a database, but not the store of a run; move it away")
    except BaseException:
        connection.close()
        raise
    return present == _own_statements()


def _statements(connection: sqlite3.Connection) -> frozenset[str]:
    """Return the statements that a database was made by."""
    rows = connection.execute("SELECT sql FROM sqlite_schema WHERE sql IS NOT NULL")
    return frozenset(sql for (sql,) in rows)


@cache
def _own_statements() -> frozenset[str]:
    """Return the statements that a store is made by."""
    with closing(sqlite3.connect(":memory:")) as connection:
        connection.executescript(_SCHEMA)
        return _statements(connection)


_NO_FOLDER = "{}; its folder cannot be written: copy it, or give --out"
_DAMAGED = "", BadInput, "damaged ({}); bring back a copy, or start over with --fresh"
_ERRORS = (  # of SQLite, the refusal, and its text with {} for the message
    ("FULL IOERR", CannotWrite, "cannot be written ({}); make room and run again"),
    ("READONLY CANTOPEN PERM", CannotWrite, _NO_FOLDER),
    ("BUSY LOCKED PROTOCOL", BadInput, "{}; another process uses it: wait, or give --out"),
    ("NOTADB", BadInput, "not a store of a run ({}); move it away"),
)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Turn errors of SQLite into refusals that name the file and the remedy."""
    try:
        yield
    except (sqlite3.Error, UnicodeDecodeError) as error:  # its message may quote damaged names
        kind = getattr(error, "sqlite_errorname", "")
        text = "".join(c if c.isprintable() else "?" for c in str(error))
        kind = kind.removeprefix("SQLITE_").partition("_")[0]
        fitting = (row for row in _ERRORS if kind in row[0].split())
        _, refusal, why = next(fitting, _DAMAGED)
        raise refusal(f"{path}: {why.format(text)}") from error
