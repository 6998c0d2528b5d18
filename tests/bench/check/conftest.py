from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

import bench.catalogue.suites
import bench.check.golden_values
from bench.catalogue.suites import SUITES
from bench.check.golden import bless

from ..builders import make_manifest, write_run_with_tables


def be_default(patch, **changes):
    """The suite is as small as the runs of `write_run`, which are its default runs then."""
    manifest = make_manifest(**changes)
    small = replace(
        SUITES[0],
        methods=tuple(manifest["methods"]),
        conditions=tuple(manifest["conditions"]),
        views=manifest["views"],
        endless_limit=len(manifest["objects"]),
        grey_methods=(),
    )
    patch.setattr(bench.catalogue.suites, "SUITES", (small, *SUITES[1:]))


@pytest.fixture
def results(tmp_path, monkeypatch):
    """The folder of golden values, which is empty."""
    folder = tmp_path / "results"
    monkeypatch.setattr(bench.check.golden_values, "GOLDEN", folder / "golden")
    be_default(monkeypatch)
    return folder


@pytest.fixture(scope="module")
def blessed(tmp_path_factory):
    """A folder with a finished run, and results whose golden values are its own."""
    folder = tmp_path_factory.mktemp("blessed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bench.check.golden_values, "GOLDEN", folder / "results" / "golden")
        be_default(patch)
        bless(write_run_with_tables(folder / "run"))
    return folder


@pytest.fixture
def run(blessed, tmp_path, results):
    """Copies of both, to be altered."""
    shutil.copytree(blessed / "results", results)
    return Path(shutil.copytree(blessed / "run", tmp_path / "run"))
