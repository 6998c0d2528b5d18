"""`bench report`: an HTML page of a finished run, and an index over several."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

from bench.analysis.run import read_run
from bench.commands.options import (
    path_argument,
    path_option,
)
from bench.records.folder import locked_run


def report(
    directories: Annotated[
        list[Path], path_argument("DIR...", "The folder of a finished run, or of several.")
    ],
    out: Annotated[
        Path | None,
        path_option(
            "The HTML file; of several runs a folder. Default: where the runs are.", "--out", "-o"
        ),
    ] = None,
) -> None:
    """Make an HTML page of a run: tables, curves, images, worst cases, failures; offline.

    Of several runs a page each, and an index over them: their leaderboards by data set and truth.
    """
    from bench.report.build import write_report
    from bench.report.index import write_index
    from bench.tables.build import make_outputs

    if len(directories) > 1:
        print(write_index(directories, out))
        return
    outputs = make_outputs(read_run(directories[0]))
    with locked_run(directories[0], "give --out") if out is None else nullcontext():
        print(write_report(outputs, out))
