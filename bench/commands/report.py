"""`bench report`: an HTML page of a finished run, and a site over several."""

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
from data_prep.failures import BadInput


def report(
    directories: Annotated[
        list[Path], path_argument("DIR...", "The folder of a finished run, or of several.")
    ],
    out: Annotated[
        Path | None,
        path_option(
            "The HTML file. Default: report.html in DIR. Of several runs a folder.", "--out", "-o"
        ),
    ] = None,
) -> None:
    """Make an HTML page of a run: tables, curves, images, worst cases, failures; offline.

    Of several runs a site: leaderboards, each report, and a page a method; publish it as it is.
    """
    from bench.report.build import write_report
    from bench.report.site import write_site
    from bench.tables.build import make_outputs

    if len(directories) > 1:
        if out is None:
            raise BadInput("several runs become a site; give --out, the folder for it")
        print(write_site(directories, out))
        return
    outputs = make_outputs(read_run(directories[0]))
    with locked_run(directories[0], "give --out") if out is None else nullcontext():
        print(write_report(outputs, out))
