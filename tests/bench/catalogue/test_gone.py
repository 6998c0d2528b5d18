"""Names that are gone: one line, exit status 2, with what to use now."""

from __future__ import annotations

import pytest

from bench.catalogue import lookup
from bench.records.run_folder import write_manifest

from ..builders import make_manifest


@pytest.mark.parametrize(
    ("kind", "name", "arguments"),
    [
        ("command", "old", ("old", "run.json")),
        ("option", "run --old", ("run", "--suite", "chair-robustness", "--old")),
        ("suite", "old", ("run", "--suite", "old")),
        ("method", "old", ("run", "--suite", "chair-robustness", "--methods", "old@width=2")),
        ("condition", "old", ("run", "--suite", "chair-robustness", "--conditions", "old")),
        ("metric", "old", ("run", "--suite", "chair-robustness", "--metrics", "old")),
    ],
)
def test_one_line_says_what_to_use_now(command, monkeypatch, tmp_path, kind, name, arguments):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(lookup.GONE[kind], name, "use another")
    status, out, err = command(*arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"bench: {kind} '")
    assert err.endswith("went with version 2.0: use another\n")
    assert list(tmp_path.iterdir()) == []


def test_a_run_of_a_suite_that_is_gone_names_its_folder(refused, tmp_path):
    write_manifest(tmp_path, make_manifest(suite="rounding"))
    assert f"{tmp_path}: suite 'rounding' went with version 2.0: " in refused("table", tmp_path)
