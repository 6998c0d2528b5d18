"""Options from a file: which come first, which are refused, and a manifest that repeats its run."""

from __future__ import annotations

import json
import re

import pytest

from bench.commands import run as module
from bench.commands.config import read_config
from bench.running.protocol import REPEATED, Options, Shard

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
    """What `bench run --dry-run` with some arguments would run."""
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


def test_a_manifest_repeats_the_request_of_its_run(asked, tmp_path):
    options = Options(
        "thirteen-classes", "folder:x", ("splat",), None, 4, views=2, seed=7, shard=Shard(1, 2)
    )
    write_manifest(tmp_path, make_manifest(request=options.request))
    repeated = asked("--config", tmp_path / "manifest.json")
    assert all(getattr(repeated, name) == getattr(options, name) for name in REPEATED)
    assert repeated.shard is None  # how and where is said anew


def test_the_request_of_a_run_is_in_its_manifest(finished):
    request = json.loads((finished[0] / "manifest.json").read_text())["request"]
    assert request["suite"] == "chair-robustness"
    assert set(request) <= set(REPEATED)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.toml", "metods = 3", "unknown option 'metods': did you mean 'methods'.* --help'"),
        ("a.toml", "config = 'b.toml'", "unknown option 'config'"),
        ("a.toml", "suite: x", "a.toml: cannot be read .*; give a TOML file"),
        ("a.json", "{", "a.json: cannot be read"),
        ("a.json", "[]", "a.json: cannot be read"),
        ("a.json", "{}", "a.json: says not what was asked for; give the manifest.json of a run"),
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


def test_lists_are_what_commas_separate(tmp_path):
    (tmp_path / "a.toml").write_text("methods = ['a', 'b']\nlimit = 2\nfresh = false\n")
    found = read_config(tmp_path / "a.toml")
    assert found == {"methods": "a,b", "limit": 2, "fresh": False}
