"""A run that an earlier commit has left: going on with it, its tables, and missing parts."""

from __future__ import annotations

import csv
import io
import json
import shutil
import sqlite3
from contextlib import closing
from importlib import metadata
from itertools import product
from pathlib import Path

import pytest

from bench.analysis.scored_run import read_run
from bench.records.run_folder import read_manifest
from bench.records.store import STORE
from bench.running.options import Options
from bench.running.protocol import Protocol
from bench.running.run import run
from bench.tables.build import make_outputs
from bench.tables.table import TABLES, table_files
from data_prep.plugins import CONDITIONS
from tests.bench import plugin_conditions, plugin_methods
from tests.bench.checking import broken_conditions

from ..builders import file_bytes, refusal, stored_keys, watched

STORED = Path(__file__).parents[1] / "data" / "stored-run"
"""Made by commit d75c6426, its store in the format of since, its protocol, which keys do not hold,
raised: six methods, of which one fails, and four conditions, of which one is broken, of two chairs
from two views."""


@pytest.fixture
def stored(tmp_path, monkeypatch):
    """Return a copy of the run, as on the machine that made it, whose drivers are in the keys."""
    manifest = read_manifest(STORED)
    monkeypatch.setattr("bench.running.protocol.environment", lambda: manifest["environment"])
    installed = metadata.version
    versions = manifest["versions"]
    monkeypatch.setattr(metadata, "version", lambda name: versions.get(name) or installed(name))
    package = tmp_path / "plug-ins"
    with plugin_methods.installed(package, monkeypatch):
        (entries,) = package.glob("*/entry_points.txt")
        condition = f"a-raises = {broken_conditions.__name__}:RAISES\n"
        entries.write_text(f"{entries.read_text()}[{CONDITIONS}]\n{condition}")
        for cache in plugin_conditions.CACHES:
            cache.cache_clear()
        yield Path(shutil.copytree(STORED, tmp_path / "run"))
    for cache in plugin_conditions.CACHES:
        cache.cache_clear()


def test_going_on_with_it_does_no_job(stored, monkeypatch):
    """Keys of jobs stay byte for byte: methods, conditions, objects, views, seeds, features."""
    request = read_manifest(stored)["request"]
    options = Options(
        request["suite"],
        methods=tuple(request["methods"]),
        conditions=tuple(request["conditions"]),
        limit=request["limit"],
        views=request["views"],
        workers=1,
        out=stored,
    )
    before = stored_keys(stored)
    assert len(before) == 2 * (1 + 4 * 4 + 2)  # true-mesh and blank see no cloud
    result = run(options, publish=lambda directory, seconds: None, **watched())
    assert (result.done, result.reused) == (0, len(before))
    assert stored_keys(stored) == before


def test_an_emptied_store_is_not_filled_again_without_a_word(stored, command):
    with closing(sqlite3.connect(stored / STORE)) as database, database:
        database.execute("DELETE FROM job")
    request = read_manifest(stored)["request"]
    names = ("--methods", ",".join(request["methods"]), "--limit", "2", "--views", "2")
    command_line = ("run", "--suite", request["suite"], *names, "--out", stored, "--dry-run")
    status, _, err = command(*command_line)
    assert status == 0
    assert f"{stored}: {STORE} has none of its finished jobs any more; all are done again" in err


def rows(text):
    return list(csv.DictReader(io.StringIO(text)))


@pytest.mark.parametrize("arguments", [("table",), ("check",), ("report",), ("compare",)])
def test_means_are_never_of_fewer_jobs_without_a_word(stored, command, arguments):
    with closing(sqlite3.connect(stored / STORE)) as database, database:
        (first,) = database.execute("SELECT min(object) FROM listed").fetchone()
        chosen = "DELETE FROM listed WHERE method = 'splat' AND condition = '512' AND object = ?"
        database.execute(chosen, [first])
    before = {path: path.read_bytes() for path in stored.rglob("*") if path.is_file()}
    methods = ("--methods", "splat,blank") if arguments == ("compare",) else ()
    status, out, err = command(*arguments, stored, *methods)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert f"lists no job of splat 512 chair {first} (1 of " in err
    assert {path: path.read_bytes() for path in stored.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("methods", ["splat", "blank", "splat"], "methods has 'splat' twice"),
        ("conditions", ["512", "512"], "conditions has '512' twice"),
        ("objects", ["chair/a", "chair/a"], "objects has 'chair/a' twice"),
        ("views", -5, "views is -5, not 1 to 65536"),
        ("schema_version", True, "schema_version is True, no whole number"),
    ],
)
def test_what_no_manifest_has_is_named(stored, command, field, value, told):
    altered_manifest(lambda manifest: manifest | {field: value})(stored)
    status, out, err = command("table", stored)
    assert (status, out, err.count("\n"), told in err) == (2, "", 1, True)


def test_its_tables_are_made_again_to_the_last_digit(stored):
    outputs = make_outputs(read_run(stored))
    files = table_files([*outputs.tables, *outputs.further])
    for path in sorted((stored / TABLES).iterdir()):
        before, after = rows(path.read_text(encoding="utf-8")), rows(files[path.name])
        assert before[0].keys() == after[0].keys()
        assert before == after, path.name


# Without what packages of others add.
FIELDS = read_manifest(STORED) | {"methods": ["splat", "blank"], "conditions": ["2048", "512"]}
MAY_LACK = {
    "condition_identities",
    "workers",
    "code",
    "git",
    "stage_seconds",
    "worker_shares",
    "cluster",
}
OTHER_VALUE = {
    "schema_version": 9,
    "protocol": 1,
    "suite": "thirteen-classes",
    "dataset": "procedural:validation",
    "views": 3,
    "seed": 1,
    "device": "cuda",
    "shard": "1/2",
    "truth": "grey",
    "methods": ["splat", "gone-method"],
    "conditions": ["2048", "gone-condition"],
    "objects": ["chair/gone-object"],
}


def of_other_type(value):
    return "5" if isinstance(value, int) else 5


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        *((name, {}) for name in FIELDS if name != "protocol"),  # which is that of version 1.0.0
        *((name, {name: of_other_type(value)}) for name, value in FIELDS.items()),
        *((name, {name: value}) for name, value in OTHER_VALUE.items()),
    ],
)
def test_a_field_that_lacks_or_is_another_is_named(tmp_path, no_machine, name, changed):
    """Folder, field, value and remedy stand in one line, and nothing is written."""
    kept = {field: value for field, value in FIELDS.items() if field != name}
    (tmp_path / "manifest.json").write_text(json.dumps(kept | changed))
    options = Options(FIELDS["suite"], methods=("blank",), limit=1, views=2, out=tmp_path)
    before = file_bytes(tmp_path)
    if name in MAY_LACK and not changed:
        assert Protocol.from_options(options).shown == {*FIELDS["objects"]}
        return
    message = refusal(Protocol.from_options, options)
    assert str(tmp_path) in message
    (value,) = changed.values() or ("",)
    assert (str(value[-1]) if isinstance(value, list) else str(value)) in message
    assert (name.removesuffix("s") if isinstance(value, list) else name.split("_")[0]) in message
    assert any(remedy in message for remedy in ("run again", "--fresh", "update pc2pix-bench"))
    assert file_bytes(tmp_path) == before


def altered_manifest(change):
    def damage(directory):
        path = directory / "manifest.json"
        path.write_text(json.dumps(change(json.loads(path.read_text()))))

    return damage


def without(name):
    return lambda directory: (directory / name).unlink()


def with_store_1(directory):
    """What a store of version 1 had, in place of the one there."""
    (directory / STORE).unlink()
    with closing(sqlite3.connect(directory / STORE)) as database, database:
        database.execute("PRAGMA application_id = 0x70633270")
        database.execute("PRAGMA user_version = 1")
        database.executescript(
            "CREATE TABLE jobs (id INTEGER PRIMARY KEY, key TEXT NOT NULL UNIQUE, "
            "artifact_sha256 TEXT, reason TEXT NOT NULL, records BLOB NOT NULL);"
            "CREATE TABLE artifacts (id INTEGER PRIMARY KEY, data BLOB NOT NULL);"
            "CREATE TABLE listed (place INTEGER PRIMARY KEY, method TEXT NOT NULL, "
            "condition TEXT NOT NULL, class TEXT NOT NULL, object TEXT NOT NULL, "
            "key TEXT NOT NULL, UNIQUE (class, object, method, condition));"
            "INSERT INTO jobs VALUES (1, 'k', NULL, 'draw: no', x'00');"
            "INSERT INTO listed VALUES (1, 'splat', '2048', 'chair', 'test-0000', 'k');"
        )


without_protocol = altered_manifest(
    lambda manifest: {name: value for name, value in manifest.items() if name != "protocol"}
)
schema_4 = altered_manifest(lambda manifest: manifest | {"schema_version": 4})
EARLIER = "which this one does not read; start "


@pytest.mark.parametrize("earlier", [with_store_1, schema_4, without_protocol])
@pytest.mark.parametrize("arguments", [("table",), ("check",), ("compare",), ("report",), ("run",)])
def test_a_folder_of_version_1_is_refused_by_name(stored, command, earlier, arguments):
    earlier(stored)
    before = {path: path.read_bytes() for path in stored.rglob("*") if path.is_file()}
    more = ("--suite", "chair-robustness", "--views", "2", "--out") if arguments == ("run",) else ()
    methods = ("--methods", "splat,blank") if arguments == ("compare",) else ()
    status, out, err = command(*arguments, *more, stored, *methods)
    assert (status, out) == (2, "")
    assert err.splitlines()[-1].startswith(f"bench: {stored}")
    assert EARLIER in err.splitlines()[-1]
    assert err.endswith(" again with another --out or --fresh\n")
    assert {path: path.read_bytes() for path in stored.rglob("*") if path.is_file()} == before


FEWEST = ("schema_version", "suite", "dataset", "views", "seed", "device", "finished")
newer_manifest = altered_manifest(lambda manifest: manifest | {"schema_version": 6})
bare_manifest = altered_manifest(lambda manifest: {name: manifest[name] for name in FEWEST})
READERS = ("table", "check", "report", "recommend", "score", "merge")


@pytest.mark.parametrize(
    ("damage", "reader"),
    [
        *product((without("manifest.json"), newer_manifest), READERS),
        *product((bare_manifest, without(STORE)), READERS[:4]),
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
