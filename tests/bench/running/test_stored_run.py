"""A run that an earlier commit has left: going on with it, its tables, and missing parts."""

from __future__ import annotations

import csv
import io
import shutil
import sqlite3
from contextlib import closing
from importlib import metadata
from pathlib import Path

import pytest

from bench.analysis.run import read_run
from bench.records.folder import read_manifest
from bench.records.store import STORE
from bench.running.options import Options
from bench.running.run import run
from bench.tables.build import make_outputs
from bench.tables.table import TABLES, table_files
from data_prep.plugins import CONDITIONS
from tests.bench import plugin_conditions, plugin_methods
from tests.bench.check import broken_conditions

from ..builders import stored_keys, watched

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
    names = [f"--{kind}={','.join(request[kind])}" for kind in ("methods", "conditions")]
    names += ["--limit", "2", "--views", "2"]
    command_line = ("run", "--suite", request["suite"], *names, "--out", stored, "--dry-run")
    status, _, err = command(*command_line)
    assert status == 0
    assert f"{stored}: {STORE} has none of its finished jobs any more; all are done again" in err


def rows(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_its_tables_are_made_again_to_the_last_digit(stored):
    outputs = make_outputs(read_run(stored))
    files = table_files([*outputs.tables, *outputs.further])
    for path in sorted((stored / TABLES).iterdir()):
        before, after = rows(path.read_text(encoding="utf-8")), rows(files[path.name])
        assert before[0].keys() == after[0].keys()
        assert before == after, path.name
