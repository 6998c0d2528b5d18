"""`bench table`: the tables of a finished run, made again."""

from __future__ import annotations

from bench.analysis.run import read_run
from bench.commands.options import (
    FormatOption,
    RunDirectory,
)
from bench.records.folder import locked_run


def table(directory: RunDirectory, format_: FormatOption = None) -> None:
    """Make the tables of a run again, from its records."""
    from bench.commands.printing import print_outputs
    from bench.tables.build import write_outputs

    read_run(directory)  # refuses a folder that is no run before a lock file is made in it
    with locked_run(directory):
        outputs = write_outputs(read_run(directory))
    print_outputs(outputs, format_)
