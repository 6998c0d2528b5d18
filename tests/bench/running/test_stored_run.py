"""A run as an earlier version of the same schema has left it; and the same with a part missing."""

from __future__ import annotations

import csv
import io
import json
import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest

from bench.analysis.scored import read_scored
from bench.catalogue.suites import SUITES
from bench.records.former import JOBS
from bench.records.run_folder import read_manifest, read_store
from bench.records.store import STORE
from bench.running.options import Options
from bench.running.protocol import protocol_of
from bench.running.status import run_status
from bench.tables.build import make_outputs
from bench.tables.table import TABLES, table_files

from ..builders import stored_keys

STORED = Path(__file__).parents[1] / "data" / "run-of-schema-4"


@pytest.fixture
def stored(tmp_path, monkeypatch):
    # As the release of its protocol reads it: this is about the form of records.
    monkeypatch.setattr("data_prep.datasets.protocol_version.PROTOCOL_VERSION", 1)
    return Path(shutil.copytree(STORED, tmp_path / "run"))


def rows(text):
    return list(csv.reader(io.StringIO(text)))


def without_digits(text):
    """Return rows without the column `digits`, which that release had not."""
    (header, *_) = table = rows(text)
    return [[v for v, name in zip(row, header, strict=True) if name != "digits"] for row in table]


def test_its_tables_are_made_again_to_the_last_digit(stored):
    made = make_outputs(read_scored(stored))
    files = table_files([*made.tables, *made.further])
    found = {path.name: path.read_text(encoding="utf-8") for path in (stored / TABLES).iterdir()}
    names = [name for name in found if name.endswith(".csv")]
    assert {n: without_digits(files[n]) for n in names} == {n: rows(found[n]) for n in names}
    assert files.keys() == found.keys()


def test_its_journal_is_imported_and_used_again(stored):
    manifest = read_manifest(stored)
    (suite,) = (suite for suite in SUITES if suite.id == manifest["suite"])
    cells = {"methods": ("splat",), "conditions": tuple(manifest["conditions"])}
    place = {"views": manifest["views"], "device": "cpu", "out": stored}
    options = Options(suite.id, **cells, limit=1, **place)
    # As on the machine that made it: drivers and libraries are part of the keys.
    protocol, _ = protocol_of(suite, options, lambda: manifest["environment"])
    methods = {}
    for name, (version, identity, _) in manifest["identities"].items():
        method = protocol.methods[name]
        methods[name] = replace(
            method, version=version, identity=lambda identity=identity: identity
        )
    lines = sum(file.read_bytes().count(b"\n") for file in (stored / "journal").glob("*.jsonl"))
    status = run_status(options, replace(protocol, methods=methods))
    assert set(status.left.values()) == {0}
    assert len(stored_keys(stored)) == lines
    assert {path.name for path in stored.iterdir()}.isdisjoint({"journal", "artifacts", JOBS})


def test_jobs_that_an_earlier_version_has_added_are_imported_too(stored):
    """It has written beside the store, which it does not know."""
    former = [shutil.copytree(stored / n, stored.parent / n) for n in ("journal", "artifacts")]
    with read_store(stored):
        pass
    keys = stored_keys(stored)
    with closing(sqlite3.connect(stored / STORE)) as database, database:
        database.execute("DELETE FROM jobs WHERE key = ?", [min(keys)])
    for folder in former:
        shutil.copytree(folder, stored / folder.name)
    with read_store(stored) as store:
        assert stored_keys(stored) == keys
        assert [row.key for row in store.listed()]
    assert not (stored / "journal").exists()


def altered_manifest(change):
    def damage(directory):
        path = directory / "manifest.json"
        path.write_text(json.dumps(change(json.loads(path.read_text()))))

    return damage


def without(name):
    return lambda directory: (directory / name).unlink()


FEWEST = ("schema_version", "suite", "dataset", "views", "seed", "device", "finished")
newer_manifest = altered_manifest(lambda manifest: manifest | {"schema_version": 5})
bare_manifest = altered_manifest(lambda manifest: {name: manifest[name] for name in FEWEST})
READERS = ("table", "check", "report", "recommend", "score", "merge")


@pytest.mark.parametrize(
    ("damage", "reader"),
    [
        *product((without("manifest.json"), newer_manifest), READERS),
        *product((bare_manifest, without("records.parquet")), READERS[:4]),
    ],
)
def test_a_missing_part_is_one_line(stored, command, damage, reader, tmp_path):
    damage(stored)
    options = {
        "recommend": ("--budget-ms", "10"),
        "merge": ("--out", tmp_path / "whole"),
        "score": ("--metrics", "ssim"),
    }
    status, _, err = command(reader, stored, *options.get(reader, ()))
    assert status == 2
    assert err.startswith("bench: ")
    assert err.count("\n") == 1
