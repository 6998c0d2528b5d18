"""`bench compare`: two runs, or two methods of one, object by object."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import nullcontext
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import pandas as pd
import typer

from bench.analysis import intervals
from bench.analysis.differences import undecided
from bench.commands.options import (
    Format,
    names,
    path_argument,
    path_option,
)
from bench.records.folder import locked_run
from bench.running.options import file_name
from bench.tables.grid import row_mappings
from bench.tables.markdown import visible
from bench.tables.terminal import terminal_width
from data_prep.datasets.dataset import first_names
from data_prep.failures import BadInput, CannotWrite

_COMPARISONS = "comparisons"  # the folder within that of a run in which comparisons are written


class _ComparisonFormat(StrEnum):
    """The formats in which a comparison is printed."""

    text = "text"
    md = "md"
    csv = "csv"
    json = "json"
    latex = "latex"


class _Failing(StrEnum):
    """The outcome of a comparison at which the command exits with 1."""

    worse = "worse"


def compare(
    directories: Annotated[
        list[Path], path_argument("DIR [DIR]", "The folder of one finished run, or of two.")
    ],
    methods: Annotated[
        str | None,
        typer.Option(
            help="Methods, comma-separated: of one run the two to compare with each other; of two "
            "runs those to compare between the runs. Default: all."
        ),
    ] = None,
    metric: Annotated[
        str | None,
        typer.Option(
            help="Metrics of images or of sets of images, comma-separated. Default: ssim-object, "
            "lpips."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        path_option(
            "Folder for the tables and the figure. Default: comparisons/A-B in the folder of the "
            "last run."
        ),
    ] = None,
    format_: Annotated[
        _ComparisonFormat | None,
        typer.Option(
            "--format",
            help="Print who is ahead (text), values with intervals (md, latex), or all columns "
            "(csv, json). Default: text on a terminal, else md.",
        ),
    ] = None,
    fail_on: Annotated[
        _Failing | None,
        typer.Option(
            help="Exit 1 where the second method or run is shown to be worse in any comparison, 2 "
            "where the objects are too few to show it. Default: exit 0."
        ),
    ] = None,
) -> None:
    """Compare two runs, or two methods of one run, object by object.

    Printed is which of the two is ahead, and whether its lead is beyond chance.
    """
    from bench.analysis.pairs import compare_methods, compare_runs
    from bench.commands.printing import in_format
    from bench.report.run_figures import write_differences
    from bench.tables.differences import comparison_lines, differences_table
    from bench.tables.table import table_files
    from data_prep.files.atomic_write import write_whole

    if len(directories) > 2:
        raise BadInput(
            f"{len(directories)} folders: give one run, to compare its methods, or two runs"
        )
    if len(directories) == 1:
        differences = compare_methods(directories[0], names(methods) or (), names(metric))
    else:
        first, second = directories
        differences = compare_runs(first, second, names(methods), names(metric))
    if differences.rows.empty:
        raise BadInput(
            f"{' '.join(map(str, directories))}: no object has true images and scores on both "
            "sides, so nothing is compared; 'bench report DIR' shows what failed"
        )
    not_decided = "" if fail_on is None else _not_decided(differences.rows, directories)
    folder = out or directories[-1] / _COMPARISONS / file_name(
        Path(differences.a).name, Path(differences.b).name
    )
    table = differences_table(differences)
    with locked_run(directories[-1], "give --out") if out is None else nullcontext():
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise CannotWrite(
                f"{folder}: cannot be made ({error.strerror}); give another folder with --out"
            ) from error
        for name, text in table_files([table]).items():
            write_whole(folder / name, text.encode())
        write_differences(folder / "differences", differences)
    print(f"written to {folder}", file=sys.stderr)  # before the verdict, which is the last line
    if format_ is None:
        format_ = _ComparisonFormat.text if sys.stdout.isatty() else _ComparisonFormat.md
    if format_ is _ComparisonFormat.text:
        print("\n".join(comparison_lines(differences, terminal_width())))
    elif format_ is _ComparisonFormat.md:
        print(table.to_markdown())
    else:
        print(in_format([table], Format(format_)), end="")
    if not_decided:
        print(f"bench: {visible(not_decided)}", file=sys.stderr)
    if fail_on is not None and (differences.rows["ahead"] == "a").any():
        raise typer.Exit(1)


def _not_decided(cells: pd.DataFrame, directories: Sequence[Path]) -> str:
    """Return a line on the comparisons that --fail-on cannot decide; empty where there are none.

    cells  the rows of the comparison: one for each metric, method, condition and class

    Raises BadInput where --fail-on can decide no row of a metric: the command would pass whatever
    was measured. Rows in which no object moved do not count as decided here.
    """
    left = undecided(cells)
    for metric, of_metric in cells.groupby("metric", sort=False):
        if metric not in set(left["metric"]) or (of_metric["ahead"] != "unknown").any():
            continue
        objects = max(of_metric.loc[of_metric["difference"].notna(), "objects"], default=0)
        if len(directories) == 1:
            have, more = "this run has", "give a run with more objects"
        else:
            old, new = directories
            have = "these runs share"
            more = (
                f"give runs with more objects, or compare any number with 'bench check {old} "
                f"--bless golden.json' and 'bench check {new} --golden golden.json'"
            )
        of_class = " of a class" if of_metric["class"].nunique() > 1 else ""
        raise BadInput(
            f"--fail-on: {metric} decides nothing: {intervals.FEWEST} objects{of_class} with a "
            f"value are needed, {have} {objects}; {more}"
        )
    if left.empty:
        return ""
    named = [
        f"{row['metric']} of {row['method_b']} at {row['condition']} in {row['class']} "
        f"({row['objects']})"
        for row in row_mappings(left)
    ]
    return (
        f"--fail-on: {len(left)} of {len(cells)} comparisons are not decided, as they have fewer "
        f"than {intervals.FEWEST} objects with a value: {first_names(named)}"
    )
