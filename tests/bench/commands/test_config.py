"""A manifest that repeats its run."""

from __future__ import annotations

import pytest

from bench.commands import run as module
from bench.records.folder import read_manifest
from bench.running.options import REPEATED, Options

from ..builders import make_manifest, write_manifest


@pytest.fixture
def asked(command, monkeypatch):
    """Return the options of `bench run --dry-run` with some arguments, or how it ends."""
    given = []
    monkeypatch.setattr(module, "describe_run", lambda options: given.append(options) or "")

    def ask(*arguments):
        done = command("run", "--dry-run", *arguments)
        return given.pop() if given else done

    return ask


def objects(*numbers):
    return [f"chair/test-{number:04d}" for number in numbers]


@pytest.fixture
def repeated(asked, tmp_path):
    """Return the options of the repetition of a run whose manifest has some values."""

    def repeat(*arguments, **changes):
        options = Options("chair-robustness", seed=7, device="cpu", limit=5)
        manifest = {"request": options.request, "objects": objects(0, 1), "planned": 5} | changes
        write_manifest(tmp_path, make_manifest(**manifest))
        return asked("--config", tmp_path / "manifest.json", *arguments)

    return repeat


def test_a_manifest_repeats_its_run_with_what_was_left_to_defaults(repeated):
    """The stored run has two complete objects of five; the device may be another one here."""
    assert repeated() == Options(
        "chair-robustness",
        methods=("splat", "true-mesh", "blank"),
        conditions=("2048", "512"),
        limit=2,
        views=2,
        seed=7,
    )


def test_a_manifest_says_nothing_about_where_how_and_over_what(repeated, tmp_path):
    """It may come from anywhere."""
    request = Options("chair-robustness", seed=7, limit=5).request
    foreign = {"out": str(tmp_path / "mine"), "fresh": True, "ray": "ray://there:1", "workers": 64}
    foreign |= {"budget": "1s", "device": "cuda", "dry-run": True, "format": "csv"}
    assert repeated(request=request | foreign) == repeated(request=request)


def test_the_command_line_comes_first(repeated):
    changed = repeated("--limit", "5", "--methods", "pc2pix")
    assert (changed.limit, changed.methods, changed.conditions) == (
        5,
        ("pc2pix",),
        ("2048", "512"),
    )


def test_other_objects_may_be_asked_for(repeated):
    assert repeated("--limit", "3", objects=objects(0, 2)).limit == 3


def test_the_request_of_a_run_states_its_defaults(finished, tmp_path, asked):
    manifest = read_manifest(finished[0])
    request = manifest["request"]
    assert set(request) <= set(REPEATED)
    for name in ("suite", "methods", "conditions", "views", "seed"):
        assert request[name] == manifest[name]
    assert request["limit"] == 3
    again = asked("--config", finished[0] / "manifest.json")
    assert (again.methods, again.limit) == (tuple(manifest["methods"]), 3)
