"""`bench table`: the tables of a finished run, made again."""

from __future__ import annotations

from typing import Annotated

import typer

from bench.analysis.run import read_run
from bench.commands.options import Format, FormatOption, RunDirectory, names
from bench.records.folder import locked_run
from data_prep.failures import unknown


def table(
    directory: RunDirectory,
    format_: FormatOption = None,
    tables: Annotated[
        str | None,
        typer.Option(
            help="Print these tables alone, comma-separated, by the names of their files, as in "
            "'table3_ssim,headline'; in Markdown where --format is not given. The folder keeps "
            "all. Default: all."
        ),
    ] = None,
    methods: Annotated[
        str | None,
        typer.Option(
            help="Print these methods alone, comma-separated; bold is the best of them. The "
            "folder keeps all. Default: all."
        ),
    ] = None,
) -> None:
    """Make the tables of a run again, from its records; print all, or those asked for."""
    from bench.commands.printing import in_format, print_outputs
    from bench.tables.build import write_outputs
    from bench.tables.grid import ordered

    asked, asked_methods = names(tables), names(methods)
    read_run(directory)  # refuses a folder that is no run before a lock file is made in it
    with locked_run(directory):
        outputs = write_outputs(read_run(directory))
    if asked is None and asked_methods is None:
        print_outputs(outputs, format_)
        return
    by_name = {each.name: each for each in outputs.every}
    for name in asked or ():
        if name not in by_name:
            raise unknown(name, [*by_name], f"table of {directory}")
    chosen = [by_name[name] for name in asked or by_name]
    if asked_methods is not None:
        known = ordered(method for each in chosen for method in each.frame["method"])
        for name in asked_methods:
            if name not in known:
                raise unknown(name, known, "method of these tables")
        chosen = [each.of_methods(asked_methods) for each in chosen]
    print(in_format(chosen, format_ or Format.md), end="")
