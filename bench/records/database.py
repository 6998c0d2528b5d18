"""The SQLite file of a store: its tables, how it is opened, and what its errors mean to users."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import cache
from pathlib import Path

from bench.records.job import MOST_BYTES
from data_prep.failures import BadInput, CannotWrite

_APPLICATION_ID = 0x70633270  # "pc2p" in ASCII; it stands in the header of the file
_STORE_VERSION = 4  # the version of the tables, in the header, too; raise it when they change
PATIENCE_S = 10.0  # seconds to wait until another process has read what it wants
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


def connect(path: Path, *, write: bool) -> sqlite3.Connection:
    """Return a connection to a store; where there is none to read, to an empty one in memory."""
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
        # A journal is left where a process has died in the first transactions. It has to be written
        # back, so that the file cannot be opened for reading only.
        mode = "rw" if path.with_name(f"{path.name}-journal").exists() else "ro"
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
    """Return a connection that refuses huge values, and reads any text.

    Values of more than MOST_BYTES raise an error; bytes that are no UTF-8 are replaced.
    """
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_BYTES)
    connection.text_factory = lambda data: data.decode("utf-8", "replace")
    return connection


def _is_store(path: Path, connection: sqlite3.Connection) -> bool:
    """Return whether a database has all tables of a store.

    It has none where a process was killed before it made them. Raises BadInput for a database that
    is not a store, is of another version, or has more than the tables and indices of a store: a
    view, a trigger or a virtual table could execute anything when it is read.
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
    """Return the SQL statements by which the tables and indices of a database were made."""
    rows = connection.execute("SELECT sql FROM sqlite_schema WHERE sql IS NOT NULL")
    return frozenset(sql for (sql,) in rows)


@cache
def _own_statements() -> frozenset[str]:
    """Return the SQL statements by which the tables and indices of a store are made."""
    with closing(sqlite3.connect(":memory:")) as connection:
        connection.executescript(_SCHEMA)
        return _statements(connection)


_FULL = (CannotWrite, "cannot be written ({}); make room and run again")
_READ_ONLY = (CannotWrite, "{}; its folder cannot be written: copy it, or give --out")
_IN_USE = (BadInput, "{}; another process uses it: wait, or give --out")
_NO_STORE = (BadInput, "not a store of a run ({}); move it away")
_DAMAGED = (BadInput, "damaged ({}); bring back a copy, or start over with --fresh")
# For each kind of error of SQLite the class of the refusal, and its text, where {} stands for the
# message of SQLite. All other kinds mean that the store is damaged.
_REFUSALS = {
    "FULL": _FULL,
    "IOERR": _FULL,
    "READONLY": _READ_ONLY,
    "CANTOPEN": _READ_ONLY,
    "PERM": _READ_ONLY,
    "BUSY": _IN_USE,
    "LOCKED": _IN_USE,
    "PROTOCOL": _IN_USE,
    "NOTADB": _NO_STORE,
}


@contextmanager
def named_errors(path: Path) -> Iterator[None]:
    """Turn errors of SQLite into refusals that name the file and the remedy."""
    try:
        yield
    except (sqlite3.Error, UnicodeDecodeError) as error:
        name = getattr(error, "sqlite_errorname", "")  # as in "SQLITE_IOERR_WRITE"
        kind = name.removeprefix("SQLITE_").partition("_")[0]
        refusal, why = _REFUSALS.get(kind, _DAMAGED)
        # The message may quote damaged names, with characters that would disturb a terminal.
        text = "".join(char if char.isprintable() else "?" for char in str(error))
        raise refusal(f"{path}: {why.format(text)}") from error
