"""What help says: of every option of every command what it takes, and its default."""

from __future__ import annotations

import pytest
import typer
from typer.testing import CliRunner

from bench.cli import COMMANDS, Commands, app

NESTED = ("train", "data")


def commands():
    """(words of the command, command), all of them."""
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
        assert option.help[0].isupper(), where
        assert option.help.endswith("."), where
        if option.default is None and not option.required:
            assert "Default: " in option.help, where
        elif option.default is not None and not isinstance(option.default, bool):
            assert option.show_default, where


@pytest.mark.parametrize("words", [[], ["train"], ["data"]], ids=" ".join)
def test_a_group_alone_shows_its_help(words):
    ended = CliRunner().invoke(app, words, prog_name="bench")
    assert ended.exit_code == 2
    assert ended.stderr.startswith(f"Usage: {' '.join(['bench', *words])} [OPTIONS] COMMAND")
    assert "--install-completion" not in ended.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--foo"], "bench: No such option: --foo; see 'bench --help'\n"),
        (
            ["runn"],
            "bench: unknown command 'runn': did you mean 'run'? there are run, plan, merge, list, "
            "table and 12 more; see 'bench --help'\n",
        ),
        (["run"], "bench: Missing option '--suite'; see 'bench run --help'\n"),
        (
            ["train", "gan", "--zzz"],
            "bench: No such option: --zzz; see 'bench train gan --help'\n",
        ),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_usage_error_is_one_line(words, said):
    ended = CliRunner().invoke(app, words, prog_name="bench")
    assert (ended.exit_code, ended.stderr) == (2, said)
