"""The store of a run: one SQLite file with its jobs, their scores, images and features.

    job     a row for each finished job, by its key: why it gave no images, its notes and times, the
            directions and scores of its views, the checksums of its images and features, the
            environment that it was made in, as JSON, and the checksum of all this
    blob    the images of each job, and its features by each extractor; they are in a table of their
            own so that scores can be read without them
    listed  the jobs of the last complete run, in the order of its plan
    metric  the metrics by which `bench score` has scored the run
    score   the values that each of these metrics gave for each job

The checksum of a job is compared whenever a part of the job is read. The other tables have an index
over all their columns, so that SQLite's own integrity check finds any change of a table.

A result counts as stored when its transaction is committed. A kill, a full disk or a power cut
loses only results that have not been committed. While a run goes on, its last transactions lie in
`run.sqlite-wal`; the next process that opens the store moves them into `run.sqlite`.
"""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import astuple, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.records.database import connect, named_errors
from bench.records.job import (
    GROUND_TRUTH,
    IMAGES,
    JOB,
    MOST_TEXT,
    OF_VIEWS,
    JobName,
    Result,
    stored_text,
    unpack,
)
from data_prep.arrays import Floats
from data_prep.failures import BadInput
from data_prep.files.safe_read import is_regular_file

STORE = "run.sqlite"
_MOST_NUMBER = 1e300  # the largest score or time that is read: sums of larger ones overflow
MOST_VIEWS = 2**16  # the most views of a job that are read
_MOST_DECIMALS = 6  # the most decimals that the values of a metric are printed with
# Parts of SQL statements.
_OF_JOB = "suite, reason, notes, prepare_s, draw_s, views, blobs, environment, sha256"
_JOB = f"job.key, {_OF_JOB}"  # all columns of a job
_NAME = ", ".join(JOB)  # the columns of `listed` that name a job
_IN_GROUP = "method = ? AND condition = ? AND class = ?"
_ARRAYS = "JOIN job USING (key) JOIN blob ON blob.job = job.id AND blob.name = ?"


class DamagedJob(BadInput):
    """The error for a job whose images, features or records are not as they were stored.

    what  which of them are not
    """

    def __init__(self, path: Path, key: str, what: str = "images") -> None:
        named = key if key.isprintable() else repr(key)  # even the key may be damaged
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
    """An image metric by which `bench score` has scored a run."""

    id: str
    version: int
    about: str  # a line that says to readers what the metric measures
    higher_is_better: bool
    decimals: int  # how many decimals its values are printed with


class Store:
    """An open store. `open_store` opens it."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection
        self.appended = 0  # how many jobs this process has stored
        self.environment: Mapping[str, str] = {}  # the environment that new jobs are made in
        self._intact: set[str] = set()  # the tables that SQLite has found intact

    @property
    def is_empty(self) -> bool:
        """Return whether the store has no finished job."""
        return not self._rows("SELECT 1 FROM job LIMIT 1")

    @property
    def has_list(self) -> bool:
        """Return whether the jobs of a complete run are listed; the list may be damaged."""
        return bool(self._rows("SELECT 1 FROM listed LIMIT 1"))

    def find(self, keys: Collection[str]) -> dict[str, Result]:
        """Return the results of those jobs that are finished, by key.

        The results have nothing but their key, suite, reason and environment.
        """
        rows = self._rows(
            f"SELECT key, suite, substr(reason, 1, {MOST_TEXT}), environment FROM job "
            "WHERE key IN (SELECT value FROM json_each(?))",
            json.dumps([*keys]),
        )
        return {row[0]: Result(*row[:3], environment=str(row[3])) for row in rows}

    def result(self, key: str) -> Result:
        """Return the result of a job with its scores, without images and features.

        Raises KeyError where the job is not finished, and DamagedJob.
        """
        return self._result(self._row(key))

    def _row(self, key: str) -> tuple[Any, ...]:
        """Return all columns of a job, in the order of `_JOB`. Raises KeyError."""
        for row in self._rows(f"SELECT {_JOB} FROM job WHERE key = ?", key):
            return row
        raise KeyError(key)

    def _result(self, row: tuple[Any, ...]) -> Result:
        """Return the result in a row with the columns of `_JOB`.

        Raises DamagedJob where the row is not as it was stored. The file may come from anybody, so
        that a column can have any type and a checksum that fits.
        """
        key, suite, reason, notes, prepare_s, draw_s, views, _, environment, checksum = row
        texts = (key, suite, reason, notes, environment)
        if not (
            all(isinstance(text, str) for text in texts)
            and _is_time(prepare_s)
            and _is_time(draw_s)
            and _are_views(views)
            and checksum == row_checksum(row[:-1])
        ):
            raise DamagedJob(self.path, str(key), "records")
        return Result(
            key=key,
            suite=suite,
            reason=reason[:MOST_TEXT],
            notes=notes[:MOST_TEXT],
            prepare_s=prepare_s,
            draw_s=draw_s,
            views=views,
            environment=environment,
        )

    def array(self, key: str, name: str = IMAGES) -> bytes:
        """Return the packed images of a job, or its features by an extractor.

        Raises KeyError where the job has none, and DamagedJob where they are lost or have changed.
        """
        joined = "job LEFT JOIN blob ON blob.job = job.id AND blob.name = ?"
        for *row, data in self._rows(f"SELECT {_JOB}, data FROM {joined} WHERE key = ?", name, key):
            self._result(tuple(row))  # raises DamagedJob for a row that has changed
            if name in self._names(key, row[7]):
                return self._checked(key, name, row[7], data)
        raise KeyError(f"{name} of job {key}")

    def arrays(self, key: str) -> dict[str, bytes]:
        """Return the packed images and features of a job by name. Raises as `array`."""
        row = self._row(key)
        self._result(row)  # raises DamagedJob for a row that has changed
        return {name: self.array(key, name) for name in self._names(key, row[7])}

    def _names(self, key: str, blobs: object) -> dict[str, str]:
        """Return the checksums of a job's images and features by name, from the column `blobs`."""
        with suppress(ValueError, TypeError, RecursionError):
            # In a file from elsewhere the column may have any type: then TypeError is raised.
            names = json.loads(blobs)  # type: ignore[arg-type]
            if isinstance(names, dict):
                return names
        raise DamagedJob(self.path, key, "records")

    def _checked(self, key: str, name: str, blobs: object, data: object) -> bytes:
        """Return packed images or features. Raises DamagedJob where their checksum differs."""
        digest = self._names(key, blobs).get(name)
        if not isinstance(data, bytes) or sha256(data).hexdigest() != digest:
            raise DamagedJob(self.path, key, name if name == IMAGES else f"features ({name})")
        return data

    def append(self, result: Result) -> None:
        """Store a result with its scores, images and features, in place of an earlier one.

        When this returns, a power cut cannot take it back. Raises CannotWrite where the disk is
        full or refuses to write; nothing of the result is stored then.
        """
        checksums = {name: sha256(data).hexdigest() for name, data in result.arrays.items()}
        row: tuple[Any, ...] = (
            result.key,
            result.suite,
            stored_text(result.reason),
            stored_text(result.notes),
            _stored_time(result.prepare_s),
            _stored_time(result.draw_s),
            result.views,
            json.dumps(checksums),
            packed_environment(self.environment),
        )
        row = (*row, row_checksum(row))
        marks = ", ".join("?" * len(row))
        with self._transaction() as execute:
            _forget(execute, "key = ?", result.key)
            job = execute(f"INSERT INTO job (key, {_OF_JOB}) VALUES ({marks})", row).lastrowid
            for name, data in result.arrays.items():
                execute("INSERT INTO blob VALUES (?, ?, ?)", (job, name, data))
        self.appended += 1

    def forget_damaged(self) -> int:
        """Remove all jobs of which anything has changed, and return their number."""
        damaged = set()
        for number, *row in self._each(f"SELECT id, {_JOB} FROM job"):
            try:
                self.arrays(self._result(tuple(row)).key)
            except (DamagedJob, KeyError):  # KeyError: by its damaged index a job is not found
                damaged.add(number)
        with self._transaction() as execute:
            for number in damaged:
                _forget(execute, "id = ?", number)
        return len(damaged)

    def list_jobs(self, jobs: Iterable[tuple[str, JobName]]) -> None:
        """Store the list of a complete run's jobs (key, name) in place of that of a run before."""
        with self._transaction() as execute:
            execute("DELETE FROM listed")
            for key, name in jobs:
                execute(f"INSERT INTO listed ({_NAME}, key) VALUES (?, ?, ?, ?, ?)", (*name, key))

    def _listed(
        self, columns: str, rest: str, *values: object
    ) -> Iterator[tuple[str, JobName, tuple[Any, ...]]]:
        """Yield the key, the name and some columns of the listed jobs.

        columns  which columns, of any table that is joined
        rest     the rest of the SQL query: what is joined, and which jobs, in which order
        values   what stands for the question marks in `rest`

        Raises BadInput where the list is damaged.
        """
        query = f"SELECT {_NAME}, listed.key, {columns} FROM listed {rest}"
        for row in self._each(query, *values):
            if not all(isinstance(text, str) for text in row[:5]):
                raise self._damaged_list()
            yield row[4], JobName(*row[:4]), row[5:]

    def _refuse_damaged_list(self) -> None:
        """Raise BadInput where the list of the complete run's jobs has changed."""
        if not self._is_intact("listed"):
            raise self._damaged_list()

    def _damaged_list(self) -> BadInput:
        return BadInput(
            f"{self.path}: the list of its jobs is damaged; start the run again with its command, "
            "which writes it anew"
        )

    def _is_intact(self, table: str) -> bool:
        """Return whether a table equals its index over all columns.

        SQLite is asked only until it has said so once.
        """
        if table not in self._intact:
            if self._rows(f"PRAGMA integrity_check({table})") != [("ok",)]:
                return False
            self._intact.add(table)
        return True

    def listed(self, *obj: str) -> Iterator[JobRow]:
        """Yield the jobs of the complete run in the order of its plan.

        obj  the class and the name of the object whose jobs are wanted; without it, all jobs

        Raises BadInput where the list is damaged, and DamagedJob.
        """
        self._refuse_damaged_list()
        where = "WHERE class = ? AND object = ?" if obj else ""
        rest = f"LEFT JOIN job USING (key) {where} ORDER BY place"
        for key, name, row in self._listed(_OF_JOB, rest, *obj):
            yield JobRow(key, name, self._result((key, *row)).has_images)

    def environments(self) -> list[tuple[dict[str, str], int]]:
        """Return the environments of the complete run's jobs, each with its number of jobs.

        The environment of most jobs comes first.
        """
        rows = self._rows(
            "SELECT environment, COUNT(*) FROM job WHERE key IN (SELECT key FROM listed) "
            "GROUP BY environment ORDER BY COUNT(*) DESC, environment"
        )
        return [(unpacked_environment(text), count) for text, count in rows]

    def results(self, **only: str) -> Iterator[tuple[JobName, Result]]:
        """Yield the jobs of methods in the complete run with their scores, sorted by name.

        only  values that the columns in JOB are to have

        Raises DamagedJob for a job that is damaged or missing.
        """
        self._refuse_damaged_list()
        # By its place in JOB a name can only be that of a column, and no other SQL.
        where = "".join(f" AND {JOB[JOB.index(name)]} = ?" for name in only)
        rest = f"LEFT JOIN job USING (key) WHERE method != '{GROUND_TRUTH}'{where} ORDER BY {_NAME}"
        before = ("",)
        for key, name, row in self._listed(_OF_JOB, rest, *only.values()):
            if name <= before:  # by a damaged index a job comes twice, and another not at all
                raise DamagedJob(self.path, key, "records")
            before = name
            yield name, self._result((key, *row))

    def has_features(self, extractor: str) -> bool:
        """Return whether any job of the complete run has features by an extractor.

        Raises BadInput where the list of jobs is damaged. `features` and `images_with`, which are
        called many times after this, do not check it again.
        """
        self._refuse_damaged_list()
        return any(self._listed("1", f"{_ARRAYS} LIMIT 1", extractor))

    def features(
        self,
        extractor: str,
        method: str,
        condition: str,
        class_name: str,
        *,
        first: str = "",
        last: str = "",
    ) -> Iterator[tuple[str, NDArray[Any]]]:
        """Yield the features of a method under a condition, for each object of a class in order.

        `first` and `last` are the first object and the last. Yields the name of the object and its
        features [V, d]. Raises DamagedJob.
        """
        rest = f"{_ARRAYS} WHERE {_IN_GROUP} AND object BETWEEN ? AND ? ORDER BY object"
        values = (extractor, method, condition, class_name, first, last)
        for key, name, (*row, data) in self._listed(f"{_OF_JOB}, data", rest, *values):
            self._result((key, *row))  # raises DamagedJob for a row that has changed
            yield name.object_id, unpack(self._checked(key, extractor, row[6], data))

    def images_with(
        self, extractor: str, method: str, condition: str, class_name: str
    ) -> list[tuple[str, int]]:
        """Return the objects that have such features, sorted, each with its number of views."""
        rest = f"{_ARRAYS} WHERE {_IN_GROUP} ORDER BY object"
        rows = self._listed(_OF_JOB, rest, extractor, method, condition, class_name)
        return [(name.object_id, self._result((key, *row)).count) for key, name, row in rows]

    def put_scores(self, metric: ScoredMetric, scores: Mapping[str, Floats]) -> None:
        """Store the scores [V] of each job by a metric, in place of earlier ones.

        scores  by the keys of the jobs
        """
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
        """Return the metrics that jobs were scored by, by id.

        Metrics whose entries have changed, or are of no use, are left out.
        """
        usable: dict[str, ScoredMetric] = {}
        if not self._is_intact("metric"):
            return usable
        for row in self._rows("SELECT * FROM metric ORDER BY id"):
            id_, version, about, higher_is_better, decimals = row
            has_types = [type(value) for value in row] == [str, int, str, int, int]
            if has_types and 0 <= decimals <= _MOST_DECIMALS:
                usable[id_] = ScoredMetric(id_, version, about, bool(higher_is_better), decimals)
        return usable

    def scores(self, metric: str) -> Iterator[tuple[JobName, Floats | None]]:
        """Yield the scores [V] of the complete run's jobs that have images, sorted by name.

        None stands for scores that are missing or have changed.
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
        """Return all rows that a query gives."""
        with named_errors(self.path):
            return self._connection.execute(query, values).fetchall()

    def _each(self, query: str, *values: object) -> Iterator[tuple[Any, ...]]:
        """Yield the rows that a query gives, one at a time."""
        with named_errors(self.path):
            # Not by `yield from`, which would close the cursor, perhaps after its connection.
            for row in self._connection.execute(query, values):  # noqa: UP028
                yield row

    @contextmanager
    def _transaction(self) -> Iterator[Callable[..., sqlite3.Cursor]]:
        """Yield the function that executes statements, of which all count or none."""
        with named_errors(self.path):
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield self._connection.execute
                self._connection.execute("COMMIT")
            except BaseException:
                with suppress(sqlite3.Error):  # raised where SQLite has already rolled it back
                    self._connection.execute("ROLLBACK")
                raise


def _stored_time(seconds: float | None) -> float | None:
    """Return a time as it is stored: None for NaN and for times beyond all measure.

    The author of images may claim any time.
    """
    if seconds is None or not abs(seconds) < _MOST_NUMBER:
        return None
    return float(seconds)


def _is_time(value: object) -> bool:
    """Return whether a value from the store is a time, or None for an unknown one."""
    return value is None or (type(value) is float and abs(value) < _MOST_NUMBER)


def _are_views(value: object) -> bool:
    """Return whether a value from the store is the packed scores of at most MOST_VIEWS views."""
    size = 8 * len(OF_VIEWS)  # bytes of a view
    if not isinstance(value, bytes) or len(value) % size or len(value) > MOST_VIEWS * size:
        return False
    return not (np.abs(np.frombuffer(value, "<f8")) >= _MOST_NUMBER).any()


def packed_environment(environment: Mapping[str, str]) -> str:
    """Return an environment as the text that the store has of it."""
    return json.dumps(environment, sort_keys=True)


def unpacked_environment(text: str) -> dict[str, str]:
    """Return an environment from the text in the store; {} where the text is none.

    Such a text is damaged, and its job is refused by the checksum when it is read.
    """
    with suppress(ValueError, RecursionError):
        facts = json.loads(text)
        if isinstance(facts, dict):
            return {str(name): str(value) for name, value in facts.items()}
    return {}


def row_checksum(row: tuple[Any, ...]) -> str:
    """Return the checksum of a job, from all its columns before the checksum itself."""
    *before, views, blobs, environment = row
    digest = sha256(repr((*before, blobs, environment)).encode("utf-8", "replace"))
    digest.update(views)
    return digest.hexdigest()


def _forget(execute: Callable[..., sqlite3.Cursor], where: str, value: object) -> None:
    """Remove the jobs for which an SQL condition is true, with their arrays and scores.

    value  what stands for the question mark in `where`
    """
    for table in ("blob", "score"):
        execute(f"DELETE FROM {table} WHERE job IN (SELECT id FROM job WHERE {where})", (value,))
    execute(f"DELETE FROM job WHERE {where}", (value,))


@contextmanager
def open_store(directory: Path, *, write: bool = False) -> Iterator[Store]:
    """Yield the store of a run's folder.

    Where the folder has none, an empty one is yielded, which is written with `write` only. Who
    writes has to hold the folder's lock (`bench.records.folder`). Raises BadInput for a file that
    is no store, is damaged, or of another version, and CannotWrite.
    """
    path = directory / STORE
    # To open a pipe would wait for its other end, and a link leads out of the folder.
    for end in ("", "-wal", "-shm", "-journal"):
        file = directory / f"{STORE}{end}"
        if os.path.lexists(file) and (file.is_symlink() or not is_regular_file(file)):
            raise BadInput(f"{file}: no file of this folder, but a link or a pipe; move it away")
    new = write and not path.exists()
    with named_errors(path), closing(connect(path, write=write)) as connection:
        store = Store(path, connection)
        try:
            yield store
        finally:
            # This makes one file of the store, which can be read where nothing can be written.
            # While another process reads, and on a full disk, SQLite refuses it; the file
            # `run.sqlite-wal` then stays, and the next process that writes tries again.
            if write:
                with suppress(sqlite3.OperationalError):
                    connection.execute("PRAGMA journal_mode = DELETE")
    if new and not store.appended:  # the run of a suite that has no jobs needs no store
        path.unlink()
