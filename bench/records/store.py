"""The store of a run: one SQLite file with its jobs, their records and their images.

    jobs       a row for each finished job, by its key: its records, or why it gave no images
    artifacts  the images and features of the jobs, apart from them: scores are read without images
    listed     the jobs of the last complete run, in the order of its plan

A result counts when its transaction is committed. A kill, a full disk or a power cut takes back
only a result that has not been committed. While a run goes on, its last transactions lie in
`run.sqlite-wal`; the next process that opens the file folds them in.
"""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from bench.records.artifacts import JobName
from bench.records.job import MOST_TEXT, Result
from bench.records.packed_records import pack_records, unpack_columns
from bench.records.record import GROUND_TRUTH, Record
from data_prep.failures import BadInput, CannotWrite
from data_prep.files.safe_read import is_regular_file

STORE = "run.sqlite"
APPLICATION_ID = 0x70633270  # "pc2p", in the header of the file
STORE_VERSION = 1
TABLES = 3
PATIENCE_S = 10.0  # for a reader in another process to let go
SCHEMA = """
CREATE TABLE IF NOT EXISTS jobs (
    id INTEGER PRIMARY KEY,
    key TEXT NOT NULL UNIQUE,
    artifact_sha256 TEXT,
    reason TEXT NOT NULL,
    records BLOB NOT NULL
);
CREATE TABLE IF NOT EXISTS artifacts (id INTEGER PRIMARY KEY, data BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS listed (
    place INTEGER PRIMARY KEY,
    method TEXT NOT NULL, condition TEXT NOT NULL, class TEXT NOT NULL, object TEXT NOT NULL,
    key TEXT NOT NULL,
    UNIQUE (class, object, method, condition)
);
"""
_LISTED = """
    SELECT listed.key, method, condition, class, object, artifact_sha256
    FROM listed LEFT JOIN jobs ON jobs.key = listed.key
"""
_BY_NAME = "ORDER BY method, condition, class, object"


class DamagedJob(BadInput):
    """A job whose images or records are not what was stored.

    Attributes
    ----------
    path : Path
        The file of the store.
    key : str
    """

    def __init__(self, path: Path, key: str, what: str = "images") -> None:
        super().__init__(
            f"{path}: the {what} of job {key} are missing or altered; start the run again with its "
            "command, which finds and draws them anew"
        )
        self.path, self.key = path, key


@dataclass(frozen=True)
class JobRow:
    """A job of a complete run: its key and its name.

    `artifact_sha256` is None for a job that gave no images.
    """

    key: str
    name: JobName
    artifact_sha256: str | None


class Store:
    """An open store; `open_store` gives one."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection
        self.appended = 0  # jobs, by this process

    @property
    def is_empty(self) -> bool:
        """Return whether no job is finished."""
        return not self._rows("SELECT 1 FROM jobs LIMIT 1")

    def find(self, keys: Collection[str]) -> dict[str, Result]:
        """Return the results of the jobs that are finished, without records and artifacts."""
        rows = self._rows(
            f"SELECT key, artifact_sha256, substr(reason, 1, {MOST_TEXT}) FROM jobs "
            "WHERE key IN (SELECT value FROM json_each(?))",
            json.dumps([*keys]),
        )
        return {key: Result(key, (), sha, reason) for key, sha, reason in rows}

    def records(self, key: str) -> list[Record]:
        """Return the records of a job.

        Raises KeyError for one that is not finished, and DamagedJob where they have changed.
        """
        rows = self._rows("SELECT records FROM jobs WHERE key = ?", key)
        if not rows:
            raise KeyError(key)
        values = zip(*self._unpacked(key, rows[0][0]).values(), strict=True)
        return [Record(*row) for row in values]

    def _unpacked(self, key: str, data: bytes) -> dict[str, list[Any]]:
        try:
            return unpack_columns(data)
        except BadInput as error:
            raise DamagedJob(self.path, key, "records") from error

    def artifact(self, key: str) -> bytes:
        """Return the artifact of a job.

        Raises KeyError for a job without images, and DamagedJob where it has changed.
        """
        rows = self._rows(
            "SELECT artifact_sha256, data FROM jobs LEFT JOIN artifacts USING (id) "
            "WHERE key = ? AND artifact_sha256 IS NOT NULL",
            key,
        )
        if not rows:
            raise KeyError(key)
        ((expected, data),) = rows
        if data is None or sha256(data).hexdigest() != expected:
            raise DamagedJob(self.path, key)
        return data

    def append(self, result: Result) -> None:
        """Store a result with its records and artifact, in place of an earlier one of its job.

        When this returns, a power cut cannot take it back. Raises CannotWrite where the disk is
        full or refuses; nothing of the result is stored then.
        """
        row = result.key, result.artifact_sha256, result.reason, pack_records(result.records)
        self._put(row, result.artifact)

    def copy(self, keys: Collection[str], source: Store) -> set[str]:
        """Copy jobs from another store as far as this one does not have them, or has others.

        Return the keys of the jobs that this store has then. Raises DamagedJob where an
        artifact of `source` has changed.
        """
        query = (
            "SELECT key, artifact_sha256, reason, records FROM jobs "
            "WHERE key IN (SELECT value FROM json_each(?))"
        )
        named = json.dumps([*keys])
        present = {*self._rows(query, named)}
        wanted = source._rows(query, named)
        for row in wanted:
            if row not in present:
                key, sha, *_ = row
                self._put(row, source.artifact(key) if sha else None)
        return {key for key, *_ in wanted}

    def _put(self, row: tuple[Any, ...], artifact: bytes | None) -> None:
        key = row[0]
        with self._transaction() as execute:
            execute(
                "INSERT INTO jobs (key, artifact_sha256, reason, records) VALUES (?, ?, ?, ?) "
                "ON CONFLICT (key) DO UPDATE SET artifact_sha256 = excluded.artifact_sha256, "
                "reason = excluded.reason, records = excluded.records",
                row,
            )
            ((row_id,),) = execute("SELECT id FROM jobs WHERE key = ?", (key,))
            if artifact is None:
                execute("DELETE FROM artifacts WHERE id = ?", (row_id,))
            else:
                execute("REPLACE INTO artifacts VALUES (?, ?)", (row_id, artifact))
        self.appended += 1

    def forget_damaged(self, known: str = "") -> int:
        """Remove the jobs of which anything has changed, also those of no complete run; count them.

        `known` is the key of one that is.
        """
        damaged = [(known,)] if known else []
        for key, sha in self._each("SELECT key, artifact_sha256 FROM jobs"):
            try:
                self.records(key)
                if sha:
                    self.artifact(key)
            except DamagedJob:
                damaged += [(key,)] if key != known else []
        with self._transaction() as execute:
            for key in damaged:
                execute("DELETE FROM artifacts WHERE id = (SELECT id FROM jobs WHERE key = ?)", key)
                execute("DELETE FROM jobs WHERE key = ?", key)
        return len(damaged)

    def list_jobs(self, jobs: Iterable[tuple[str, JobName]]) -> None:
        """Note keys and names of the jobs of a complete run, in place of those of the run before.

        `jobs` are in the order of the plan.
        """
        with self._transaction() as execute:
            execute("DELETE FROM listed")
            for key, name in jobs:
                execute(
                    "INSERT INTO listed (method, condition, class, object, key) "
                    "VALUES (?, ?, ?, ?, ?)",
                    (*name, key),
                )

    def listed(self, *, by_name: bool = False) -> Iterator[JobRow]:
        """Yield the jobs of the complete run in the order of its plan, or sorted by name."""
        rows = self._each(f"{_LISTED} {_BY_NAME if by_name else 'ORDER BY place'}")
        return (JobRow(key, JobName(*name), sha) for key, *name, sha in rows)

    def listed_of(self, *obj: str) -> list[JobRow]:
        """Return the jobs of an object (class, name) of the complete run, as its plan has them."""
        rows = self._rows(f"{_LISTED} WHERE class = ? AND object = ? ORDER BY place", *obj)
        return [JobRow(key, JobName(*name), sha) for key, *name, sha in rows]

    def listed_columns(self) -> Iterator[tuple[JobName, dict[str, list[Any]]]]:
        """Yield the names and records of the complete run's jobs, sorted by name.

        The records are as `unpack_columns` gives them. Ground truths are left out.
        """
        rows = self._each(
            "SELECT method, condition, class, object, key, records FROM listed "
            f"JOIN jobs USING (key) WHERE method != '{GROUND_TRUTH}' {_BY_NAME}"
        )
        for *name, key, records in rows:
            yield JobName(*name), self._unpacked(key, records)

    def key_of(self, name: JobName) -> str | None:
        """Return the key of a job of the complete run; None for one without images."""
        rows = self._rows(
            "SELECT key FROM listed JOIN jobs USING (key) WHERE method = ? AND condition = ? "
            "AND class = ? AND object = ? AND artifact_sha256 IS NOT NULL",
            *name,
        )
        return rows[0][0] if rows else None

    def _rows(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        with _named(self.path):
            return self._connection.execute(query, values).fetchall()

    def _each(self, query: str) -> Iterator[tuple[Any, ...]]:
        with _named(self.path):
            # `yield from` would close the cursor, perhaps after its connection.
            for row in self._connection.execute(query):  # noqa: UP028
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


@contextmanager
def open_store(directory: Path, *, write: bool = False) -> Iterator[Store]:
    """Yield the store of a run's folder; an empty one where it has none and is only read.

    To write, the process holds the folder's lock (`bench.records.run_folder`).

    Raises
    ------
    BadInput
        For a file that is no store, is damaged, or of a newer version.
    CannotWrite
        Where the file cannot be written.
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
        connection = sqlite3.connect(path, PATIENCE_S, isolation_level=None)
        if not _is_store(path, connection):
            connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
            connection.execute(f"PRAGMA user_version = {STORE_VERSION}")
            connection.executescript(SCHEMA)
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = FULL")
        return connection
    if path.exists():
        uri = f"{path.absolute().as_uri()}?mode=ro"
        connection = sqlite3.connect(uri, PATIENCE_S, isolation_level=None, uri=True)
        if _is_store(path, connection):
            return connection
        connection.close()
    connection = sqlite3.connect(":memory:", isolation_level=None)
    connection.executescript(SCHEMA)
    return connection


def _is_store(path: Path, connection: sqlite3.Connection) -> bool:
    """Return whether a database has tables: a process may have been killed before it had made them.

    Raises BadInput for a database that is not a store of a version known here.
    """
    try:
        ((application,),) = connection.execute("PRAGMA application_id")
        ((version,),) = connection.execute("PRAGMA user_version")
        kinds = connection.execute("SELECT type, name, sql FROM sqlite_schema").fetchall()
        tables = [name for kind, name, _ in kinds if kind == "table"]
        # A view, a trigger or a virtual table may execute anything, and without end.
        others = [name for kind, name, sql in kinds if _is_code(kind, sql)]
        if others or (tables and application != APPLICATION_ID):
            raise BadInput(f"{path}: a database, but not the store of a run; move it away")
        if version > STORE_VERSION:
            raise BadInput(
                f"{path}: store version {version} is newer than {STORE_VERSION}; update "
                "pc2pix-bench"
            )
    except BaseException:
        connection.close()
        raise
    return len(tables) >= TABLES


def _is_code(kind: str, sql: str | None) -> bool:
    return kind in ("view", "trigger") or (sql or "").upper().startswith("CREATE VIRTUAL")


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Turn errors of SQLite into refusals that name the file and the remedy."""
    try:
        yield
    except sqlite3.Error as error:
        kind = getattr(error, "sqlite_errorname", "")
        if kind.startswith(("SQLITE_FULL", "SQLITE_IOERR")):
            raise CannotWrite(
                f"{path}: cannot be written ({error}); make room and run again"
            ) from error
        if kind.startswith(("SQLITE_READONLY", "SQLITE_CANTOPEN", "SQLITE_PERM")):
            raise CannotWrite(
                f"{path}: {error}; its folder cannot be written: copy it, or give --out"
            ) from error
        if kind.startswith(("SQLITE_BUSY", "SQLITE_LOCKED", "SQLITE_PROTOCOL")):
            raise BadInput(
                f"{path}: {error}; another process uses it: wait, or give --out"
            ) from error
        if kind == "SQLITE_NOTADB":
            raise BadInput(f"{path}: not a store of a run ({error}); move it away") from error
        raise BadInput(
            f"{path}: damaged ({error}); bring back a copy, or start over with --fresh"
        ) from error
