"""The help of every command, and the types of its options."""

from __future__ import annotations

import inspect
from importlib import import_module
from pathlib import Path
from typing import get_args

import pytest
import typer
from typer.testing import CliRunner

from bench.cli import COMMANDS, Commands, app
from bench.commands.options import read_path

NESTED = ("train", "data")


def commands():
    """Yield the words of each command, and the command."""
    group = typer.main.get_command(app)
    assert isinstance(group, Commands)
    for name in COMMANDS:
        command = group.get_command(None, name)
        if name in NESTED:
            for inner in command.list_commands(None):
                yield (name, inner), command.get_command(None, inner)
        else:
            yield (name,), command


@pytest.mark.parametrize(
    ("words", "command"), [pytest.param(*c, id=" ".join(c[0])) for c in commands()]
)
def test_every_option_says_what_it_takes_and_its_default(words, command):
    assert command.help
    for option in command.params:
        where = f"bench {' '.join(words)}: {option.name}"
        assert option.help, where
        if option.default is None and not option.required:
            assert "Default: " in option.help, where
        elif option.default is not None and not isinstance(option.default, bool):
            assert option.show_default, where


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


def test_the_home_folder_of_paths_that_a_shell_leaves(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    for words in (["table", "~/no"], ["data", "verify", "~/no"], ["compare", "~/no", "~/no"]):
        ended = CliRunner().invoke(app, words, prog_name="bench")
        assert (ended.exit_code, ended.stderr.startswith(f"bench: {tmp_path}/no: ")) == (2, True)


@pytest.mark.parametrize("words", [[], ["train"], ["data"]], ids=" ".join)
def test_a_group_alone_shows_its_help(words):
    ended = CliRunner().invoke(app, words, prog_name="bench")
    assert ended.exit_code == 2
    assert ended.stderr.startswith(f"Usage: {' '.join(['bench', *words])} [OPTIONS] COMMAND")
    assert "--install-completion" not in ended.stderr
