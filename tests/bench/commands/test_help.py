"""The help of every command, the types of its options, and the versions."""

from __future__ import annotations

import inspect
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import get_args

import pytest
import typer

from bench.cli import COMMANDS, app
from bench.commands.options import read_path
from data_prep.datasets.protocol_version import PROTOCOL_VERSION


def commands():
    """Yield each command, and those of groups."""
    group = typer.main.get_command(app)
    for name in COMMANDS:
        command = group.get_command(None, name)
        inner = getattr(command, "list_commands", lambda context: ())(None)
        yield from [command.get_command(None, word) for word in inner] or [command]


def test_every_option_says_what_it_takes_and_its_default():
    for command in commands():
        assert command.help
        for option in command.params:
            where = f"{command.name} {option.name}"
            assert option.help, where
            if option.default is None and not option.required:
                assert "Default: " in option.help, where


@pytest.mark.parametrize("place", [place for place, _ in COMMANDS.values()])
def test_every_path_is_parsed_with_the_home_folder(place):
    module, _, name = place.partition(":")
    function = getattr(import_module(f"bench.commands.{module}"), name)
    inner = function.registered_commands if isinstance(function, typer.Typer) else []
    for callback in [command.callback for command in inner] or [function]:
        for option in inspect.signature(callback, eval_str=True).parameters.values():
            if option.annotation is typer.Context:
                continue
            kind, settings = get_args(option.annotation)
            if Path in (kind, *get_args(kind)):
                assert settings.parser is read_path, f"{place} {callback.__name__} {option.name}"


def test_the_home_folder_of_paths_that_a_shell_leaves(refused, monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    for words in (["table", "~/no"], ["data", "verify", "~/no"], ["compare", "~/no", "~/no"]):
        assert refused(*words).startswith(f"{tmp_path}/no: ")


@pytest.mark.parametrize("words", [[], ["train"], ["data"]], ids=" ".join)
def test_a_group_alone_shows_its_help(command, words):
    status, out, err = command(*words)
    assert (status, out) == (2, "")
    assert err.startswith(f"Usage: {' '.join(['bench', *words])} [OPTIONS] COMMAND")
    assert "--install-completion" not in err


def test_the_version_and_that_of_the_protocol_with_what_changed(command):
    assert command("--version") == (0, f"pc2pix-bench {version('pc2pix-bench')}\n", "")
    status, out, err = command("--protocol")
    versions = [int(line.partition(": ")[0]) for line in out.splitlines()]
    assert (status, err) == (0, "")
    assert versions == list(range(PROTOCOL_VERSION, 0, -1))


def test_help_names_all_commands(command):
    status, out, err = command("--help")
    assert (status, err) == (0, "")
    trained = "autoencoder gan decoder splat-net fused-net occupancy-net upsampler"
    for text, expected in ((out, " ".join(COMMANDS)), (command("train", "--help")[1], trained)):
        assert all(f"\n  {name} " in text for name in expected.split())
