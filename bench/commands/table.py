"""`bench table`: the tables of a finished run, made again."""

from __future__ import annotations

from typing import Annotated

import typer

from bench.analysis.run import read_run
from bench.catalogue.chosen import CHOSEN
from bench.commands.options import Format, FormatOption, RunDirectory, names
from bench.records.folder import locked_run
from data_prep.failures import unknown


def table(
    directory: RunDirectory,
    format_: FormatOption = None,
    tables: Annotated[
        str | None,
        typer.Option(
            help="Print these tables alone, comma-separated (table3_ssim,headline), by default in "
            "Markdown. The folder keeps all. Default: all."
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

    asked, asked_methods = names(tables), names(methods)
    run = read_run(directory)  # refuses a folder that is no run before a lock file is made in it
    of_run = [*run.manifest["methods"], *CHOSEN]
    for name in {*(asked_methods or ())} - {*of_run}:  # before the tables, which take seconds
        raise unknown(name, of_run, f"method of {directory}")
    with locked_run(directory):
        outputs = write_outputs(read_run(directory))
    if asked is None and asked_methods is None:
        print_outputs(outputs, format_)
        return
    every = [outputs.headline, *outputs.tables, *outputs.further]
    by_name = {each.name: each for each in every}
    for name in {*(asked or ())} - by_name.keys():
        raise unknown(name, [*by_name], f"table of {directory}")
    chosen = [by_name[name] for name in asked or by_name]
    if asked_methods is not None:
        known = sorted({method for each in chosen for method in each.frame["method"]})
        for name in {*asked_methods} - {*known}:
            raise unknown(name, known, "method of these tables")
        chosen = [each.of_methods(asked_methods) for each in chosen]
    print(in_format(chosen, format_ or Format.md), end="")
