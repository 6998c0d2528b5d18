"""`bench compare`: two runs, or two methods of one run, in words on a terminal."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from bench.commands.options import Format, names, path_argument, path_option
from bench.running.options import file_name
from data_prep.failures import BadInput, CannotWrite
from data_prep.files.atomic_write import write_whole

_COMPARISONS = "comparisons"


class _ComparisonFormat(StrEnum):
    """The formats in which a comparison is printed."""

    text = "text"
    md = "md"
    csv = "csv"
    json = "json"


def compare(
    directories: Annotated[
        list[Path], path_argument("DIR [DIR]", "The folder of one finished run, or of two.")
    ],
    methods: Annotated[
        str | None,
        typer.Option(
            help="Methods, comma-separated: the two of one run, or those of two runs to compare. "
            "Default: all."
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
        path_option("Folder for tables and figure. Default: comparisons/A-B in the last run."),
    ] = None,
    format_: Annotated[
        _ComparisonFormat | None,
        typer.Option(
            "--format",
            help="Print who is ahead (text), values with intervals (md), or all columns (csv, "
            "json). Default: text on a terminal, else md.",
        ),
    ] = None,
) -> None:
    """Compare two runs, or two methods of one, object by object: who is ahead, and is it shown."""
    from bench.analysis.run_pairs import methods_of_run, runs
    from bench.commands.publish import in_format
    from bench.report.run_figures import write_differences
    from bench.tables.differences import comparison_lines, differences_table
    from bench.tables.table import table_files
    from bench.tables.terminal import terminal_width

    if len(directories) > 2:
        raise BadInput(f"{len(directories)} folders: two runs are compared; give one or two")
    if len(directories) == 1:
        differences = methods_of_run(directories[0], names(methods) or (), names(metric))
    else:
        first, second = directories
        differences = runs(first, second, names(methods), names(metric))
    if differences.cells.empty:
        raise BadInput(
            f"{' '.join(map(str, directories))}: no object has true images and scores on both "
            "sides, so nothing is compared; 'bench report DIR' shows what failed"
        )
    folder = out or directories[-1] / _COMPARISONS / file_name(
        Path(differences.a).name, Path(differences.b).name
    )
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CannotWrite(f"{folder}: cannot be made ({error.strerror}); give --out") from error
    table = differences_table(differences)
    for name, text in table_files([table]).items():
        write_whole(folder / name, text.encode())
    write_differences(folder / "differences", differences)
    print(f"written to {folder}", file=sys.stderr)  # first: the verdict is the last line
    if format_ is None:
        format_ = _ComparisonFormat.text if sys.stdout.isatty() else _ComparisonFormat.md
    if format_ is _ComparisonFormat.text:
        print("\n".join(comparison_lines(differences, terminal_width())))
    elif format_ is _ComparisonFormat.md:
        print(table.to_markdown())
    else:
        print(in_format([table], Format(format_)), end="")
