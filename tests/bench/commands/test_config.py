"""Options from a file: their order, their refusals, and a manifest that repeats its run."""

from __future__ import annotations

import re

import pytest

from bench.commands import run as module
from bench.records.run_folder import read_manifest
from bench.running.options import REPEATED, Options, Shard

from ..builders import make_manifest, write_manifest

TEXT = """
suite = "chair-robustness"
methods = ["splat", "blank"]
conditions = "2048"
inception-weights = "download"
limit = 3
fresh = true
device = "cpu"
"""
SAID = Options(
    "chair-robustness",
    methods=("splat", "blank"),
    conditions=("2048",),
    limit=3,
    inception_weights="download",
    fresh=True,
    device="cpu",
)


@pytest.fixture
def asked(command, monkeypatch):
    """Return the options of `bench run --dry-run` with some arguments, or how it ends."""
    given = []
    monkeypatch.setattr(module, "describe_run", lambda options: given.append(options) or "")

    def ask(*arguments):
        done = command("run", "--dry-run", *arguments)
        return given.pop() if given else done

    return ask


def test_options_come_from_the_file_and_the_command_line_comes_first(asked, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(TEXT)
    assert asked("--config", file) == SAID
    changed = asked("--config", file, "--limit", "5", "--methods", "pc2pix")
    assert (changed.limit, changed.methods, changed.conditions) == (5, ("pc2pix",), ("2048",))


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


def test_a_shard_is_repeated_as_a_shard(repeated):
    again = repeated(shard="2/2", objects=objects(1, 3))
    assert (again.shard, again.limit) == (Shard(2, 2), 5)


def test_objects_that_options_cannot_choose_are_refused(repeated):
    message = (
        "manifest.json: the 2 objects of that run are not the 2 that options can choose now; "
        "finish it with its command, bring its dataset back as it was, or give another --limit\n"
    )
    status, _, err = repeated(objects=objects(0, 2))
    assert (status, err.endswith(message), err.count("\n")) == (2, True, 1)
    assert repeated("--limit", "3", objects=objects(0, 2)).limit == 3
    status, _, err = repeated(shard="2/2", objects=objects(1))  # of two
    assert (status, "the 1 objects of that run are not the 2" in err) == (2, True)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"protocol": 0},
            "that made it, or give the manifest.json of a run, or state the options in a TOML file",
        ),
        (
            {"schema_version": 4},
            "manifest.json: a run of version 1.0.0 or earlier (schema 4, this one reads 5)",
        ),
    ],
)
def test_a_run_of_another_version_is_not_repeated(repeated, changes, message):
    status, _, err = repeated(**changes)
    assert (status, err.count("\n"), message in err) == (2, 1, True)


def test_the_request_of_a_run_states_its_defaults(finished, tmp_path, asked):
    manifest = read_manifest(finished[0])
    request = manifest["request"]
    assert set(request) <= set(REPEATED)
    for name in ("suite", "methods", "conditions", "views", "seed"):
        assert request[name] == manifest[name]
    assert request["limit"] == 3
    again = asked("--config", finished[0] / "manifest.json")
    assert (again.methods, again.limit) == (tuple(manifest["methods"]), 3)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.toml", "metods = 3", "unknown option 'metods': did you mean 'methods'.* --help'"),
        ("a.toml", "config = 'b.toml'", "unknown option 'config'"),
        ("a.toml", "until_decided = true", "option 'run --until-decided' went with version 2.0: "),
        ("a.toml", "limit = 'x'", "a.toml: limit = 'x': .*integer"),
        ("a.toml", "limit = true", "a.toml: limit = True: give text, a whole number or a list"),
        ("a.toml", "views = 1.5", "a.toml: views = 1.5: give text, a whole number or a list"),
        ("a.toml", "fresh = 1", "a.toml: fresh = 1: give true or false"),
        ("a.toml", "device = 'gpu'", "a.toml: device = 'gpu': .*cuda"),
        ("a.toml", "suite: x", "a.toml: cannot be read .*; give a TOML file"),
        (
            "a.json",
            "{",
            r"a.json: not a manifest .*; give the manifest.json of a run, or",
        ),
        ("a.json", "[]", r"a.json: not a manifest \("),
        ("a.json", "{}", r"a.json: not a manifest \("),
        ("gone.toml", None, "gone.toml"),
    ],
)
def test_what_cannot_be_used_is_named(asked, tmp_path, name, text, message):
    file = tmp_path / name
    if text is not None:
        file.write_text(text)
    status, _, errors = asked("--config", file)
    assert status == 2
    assert errors.count("\n") == 1
    assert re.search(message, errors)


def test_what_a_file_switches_on_the_command_line_switches_off(asked, tmp_path, command):
    file = tmp_path / "mine.toml"
    file.write_text("suite = 'chair-robustness'\nfresh = true\n")
    assert asked("--config", file).fresh
    assert not asked("--config", file, "--no-fresh").fresh
    file.write_text("suite = 'no-such-suite'\ndry-run = true\n")
    status, _, err = command("run", "--config", file, "--no-dry-run")
    assert (status, err.startswith("bench: unknown suite 'no-such-suite'")) == (2, True)


def test_every_option_has_its_name_of_the_command_line(asked, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("suite = 'chair-robustness'\nformat = 'csv'\nlimit = 1\n")
    assert asked("--config", file).limit == 1
    file.write_text("format = 'xml'\n")
    status, _, err = asked("--config", file)
    assert (status, "mine.toml: format = 'xml': " in err) == (2, True)


def test_the_home_folder_is_expanded(asked, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    file = tmp_path / "mine.toml"
    file.write_text("suite = 'chair-robustness'\nout = '~/x'\n")
    assert asked("--config", file).out == tmp_path / "x"
    assert asked("--suite", "chair-robustness", "--out=~/y").out == tmp_path / "y"
    status, _, err = asked("--suite", "chair-robustness", "--out=~nobody-of-this-name/y")
    assert (status, "~nobody-of-this-name/y: no such user; give the path" in err) == (2, True)
