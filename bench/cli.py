"""The list of commands, each loaded when it is called. Results go to stdout, the rest to stderr.

Exit status:
0    done
1    a negative result: a value that moved, jobs that give other results when computed again, an
     installation with failed checks, a training that diverged, or a method that failed (on a cloud,
     or on all objects of a run)
2    an error that the user can fix
130  interrupted with Ctrl-C
141  the reader of the output closed it
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

from bench.commands.options import SETTINGS, USAGE_ERROR, Group, plain_message

# By the name of each command: its module in bench.commands and its function there, and the line on
# it in the help of bench.
COMMANDS = {
    "run": ("run:run", "Run a suite, or go on with a stopped run; print its tables."),
    "list": (
        "listing:list_all",
        "List suites, methods and variants, conditions, metrics, datasets.",
    ),
    "table": ("table:table", "Make the tables of a run again, from its records."),
    "check": ("check:check", "Compare a run with golden values or itself; exit 1 if not equal."),
    "report": ("report:report", "Make an HTML page of a run, and a site over several."),
    "compare": ("compare:compare", "Compare two runs, or two methods of one, object by object."),
    "score": ("score:score", "Measure a run with further metrics, or the images of two folders."),
    "surface": ("surface:surface", "Score the meshes of a run: Chamfer distance, F-score."),
    "render": ("render:render_clouds", "Draw the point clouds of files."),
    "train": ("train:app", "Train the networks."),
    "data": ("data:app", "Inspect, verify and export datasets."),
    "new": ("new:new", "Write a package to start from: a method, metric or dataset."),
    "test": ("contract:test", "Test a method, metric, dataset or condition of your own."),
    "add": ("add:add", "Add a method to a finished run; compare it with the best there."),
    "cite": ("cite:cite", "Print BibTeX of this program and of the paper."),
    "doctor": ("doctor:doctor", "Check that everything that a run needs is installed."),
}
PACKAGE = "pc2pix-bench"
# Seconds in which a further Ctrl-C is ignored, as the first one is still being handled.
_INTERRUPT_EVERY_S = 1.0


class Commands(Group):
    """The group of all commands. An error in one becomes a line on stderr and an exit status."""

    def list_commands(self, ctx: Any) -> list[str]:  # click's Context, which some Typers contain
        """Return the names of the commands in the order of the help."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command from its module; None for an unknown name."""
        if cmd_name not in COMMANDS:
            return None
        module, _, name = COMMANDS[cmd_name][0].partition(":")
        function = getattr(import_module(f"bench.commands.{module}"), name)
        if isinstance(function, typer.Typer):  # a group of commands
            group = typer.main.get_command(function)
            group.name = cmd_name
            return group
        single = typer.Typer(**SETTINGS)
        single.command(cmd_name)(function)
        return typer.main.get_command(single)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands into the help without loading any."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, about) for name, (_, about) in COMMANDS.items()])

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Read the options before the command."""
        try:
            return super().make_context(*args, **kwargs)
        except USAGE_ERROR as error:
            raise _refused(error) from error

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        # Interrupts and broken pipes are handled here, as typer would catch them around `app()` and
        # print messages of its own.
        from data_prep.failures import BadInput
        from learning.divergence import TrainingDiverged

        try:
            result = super().invoke(ctx)
            sys.stdout.flush()
            return result
        except BadInput as error:
            raise _ended(str(error)) from error
        except TrainingDiverged as error:
            raise _ended(f"{error}; a lower learning rate may help", 1) from error
        except USAGE_ERROR as error:  # an unknown command or option, or a wrong value
            raise _refused(error) from error
        except SystemExit as error:  # our commands raise typer.Exit; a plug-in may call exit()
            raise _ended(
                f"an installed package has called exit({error.code}); 'bench test NAME' with its "
                "methods, metrics, datasets and conditions says which",
                1,
            ) from error
        except KeyboardInterrupt as error:
            # When Python ends, it restores the kernel's handling of Ctrl-C, so that another Ctrl-C
            # would kill it with another exit status: it is ignored from here on.
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            text = "interrupted"
            if ctx.invoked_subcommand in ("run", "train", "surface"):
                text = "interrupted; the same command goes on from here"
            raise _ended(text, 130) from error
        except BrokenPipeError as error:
            # When Python ends, it writes what is left in these streams, which would fail again and
            # print a traceback: they lead to nowhere from here on.
            for stream in (sys.stdout, sys.stderr):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
            raise typer.Exit(141) from error  # the status of a program that SIGPIPE (13) kills
        except OSError as error:  # a full disk, a folder that may not be written
            raise _ended(f"{error}; fix this, and the same command goes on") from error


def _ended(text: str, status: int = 2) -> typer.Exit:
    """Print why a command ends as one line, and return the exit."""
    from bench.tables.markdown import visible

    print(f"bench: {visible(text)}", file=sys.stderr)
    return typer.Exit(status)


def _refused(error: Any) -> typer.Exit:
    """Return the exit of a usage error."""
    command = error.ctx.command_path if error.ctx else "bench"
    return _ended(f"{plain_message(error.format_message())}; see '{command} --help'")


app = typer.Typer(
    cls=Commands,
    help="Benchmark of pc2pix against surface-reconstruction rendering.",
    pretty_exceptions_enable=False,
    **SETTINGS,
)


def _print_protocol(wanted: bool) -> None:
    from data_prep.datasets.protocol_version import CHANGES

    if wanted:
        for version, changes in sorted(CHANGES.items(), reverse=True):
            print(f"{version}: {changes}")
        raise typer.Exit


def _print_version(wanted: bool) -> None:
    from importlib.metadata import version

    if wanted:
        print(f"{PACKAGE} {version(PACKAGE)}")
        raise typer.Exit


@app.callback()
def _all(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_print_version,
            is_eager=True,
            help="Print the name of the package and its version.",
        ),
    ] = False,
    protocol: Annotated[
        bool,
        typer.Option(
            "--protocol",
            callback=_print_protocol,
            is_eager=True,
            help="Print the versions of the protocol, the current one first, and what changed.",
        ),
    ] = False,
) -> None:
    """Take the options of the group; the commands themselves are loaded by `Commands`."""


def _interrupt_handler(
    clock: Callable[[], float] = time.monotonic,
) -> Callable[[int, object], None]:
    """Return a handler of Ctrl-C that raises KeyboardInterrupt, but not twice within a second."""
    # A second one would interrupt what the first has begun: stopping workers and closing files.
    last = float("-inf")

    def handle(signum: int, frame: object) -> None:
        nonlocal last
        now = clock()
        if now > last + _INTERRUPT_EVERY_S:
            last = now
            raise KeyboardInterrupt

    return handle


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the console script `bench` with `arguments`, by default those of the process."""
    if sys.platform == "win32":  # has no fork and no locks of files, which workers and runs need
        print(
            "bench: Windows is not supported; use WSL 2 or Docker (docs/platforms.md)",
            file=sys.stderr,
        )
        raise SystemExit(2)
    # A process that was started in the background ignores Ctrl-C; that stays so.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt_handler())
    for name in ("stdout", "stderr"):  # a stream is None where the caller has closed it
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))
        # Characters that the terminal cannot show are escaped, as they would raise an error.
        if reconfigure := getattr(getattr(sys, name), "reconfigure", None):
            reconfigure(errors="backslashreplace")
    try:
        Path.cwd()
    except OSError:
        print("bench: the current folder is gone; change to another, with cd", file=sys.stderr)
        raise SystemExit(2) from None
    # Figures are only written into files. MPLBACKEND is set, as a notebook exports a backend of its
    # own, which may not be installed here.
    os.environ["MPLBACKEND"] = "agg"
    app(arguments, prog_name="bench")


if __name__ == "__main__":
    main()
