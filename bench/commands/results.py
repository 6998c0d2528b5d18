"""The commands on finished runs: table, report, compare, recommend."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
import typer

from bench.analysis import intervals
from bench.analysis.comparison import milliseconds
from bench.analysis.paired import undecided, verdicts_of
from bench.analysis.recommend import (
    ALTERNATIVES,
    BEST,
    NEXT,
    NO_BEST,
    SSIM,
    Requirements,
    at_condition,
)
from bench.analysis.recommend import recommend as best_methods
from bench.analysis.scored_run import Run, read_run
from bench.catalogue.metrics import declared_metric
from bench.catalogue.suites import TRUTHS
from bench.commands.options import (
    Format,
    FormatOption,
    RunDirectory,
    names,
    path_argument,
    path_option,
)
from bench.records.run_folder import locked_run
from bench.running.options import file_name
from bench.tables.build import how_timed
from bench.tables.grid import FEWER, MOVED, Cell, measured, number, records
from bench.tables.markdown import visible
from bench.tables.terminal import laid_out, line_width, terminal_width
from bench.tables.terminal import table as terminal_table
from data_prep.datasets.dataset import listed
from data_prep.failures import BadInput, CannotWrite

_COMPARISONS = "comparisons"


def table(directory: RunDirectory, format_: FormatOption = None) -> None:
    """Make the tables of a run again, from its records."""
    from bench.commands.publish import print_outputs
    from bench.tables.build import write_outputs

    read_run(directory)  # one that is refused keeps its folder as it is, without a lock
    with locked_run(directory):
        outputs = write_outputs(read_run(directory))
    print_outputs(outputs, format_)


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
            help="Print who is ahead (text), values with intervals (md, latex), or all columns "
            "(csv, json). Default: text on a terminal, else md.",
        ),
    ] = None,
    fail_on: Annotated[
        _Failing | None,
        typer.Option(
            help="Exit 1 where the second one is shown to be worse in a cell, 2 where the objects "
            "are too few to show it. Default: exit 0."
        ),
    ] = None,
) -> None:
    """Compare two runs, or two methods of one, object by object: who is ahead, and is it shown."""
    from bench.analysis.run_pairs import methods_of_run, runs
    from bench.commands.publish import in_format
    from bench.report.run_figures import write_differences
    from bench.tables.differences import comparison_lines, differences_table
    from bench.tables.table import table_files
    from data_prep.files.atomic_write import write_whole

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
    not_decided = "" if fail_on is None else _not_decided(differences.cells, directories)
    folder = out or directories[-1] / _COMPARISONS / file_name(
        Path(differences.a).name, Path(differences.b).name
    )
    table = differences_table(differences)
    with locked_run(directories[-1], "give --out") if out is None else nullcontext():
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise CannotWrite(f"{folder}: cannot be made ({error.strerror}); give --out") from error
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
    if not_decided:
        print(f"bench: {visible(not_decided)}", file=sys.stderr)
    if fail_on is not None and (differences.cells["ahead"] == "a").any():
        raise typer.Exit(1)


def _not_decided(cells: pd.DataFrame, directories: Sequence[Path]) -> str:
    """Return a line on the cells that --fail-on cannot decide; empty where it decides all.

    Raises BadInput where it decides no cell of a metric, but for those in which no object moved: it
    would pass whatever was measured.
    """
    left = undecided(cells)
    for metric, of_metric in cells.groupby("metric", sort=False):
        if metric not in set(left["metric"]) or (of_metric["ahead"] != "unknown").any():
            continue
        objects = max(of_metric.loc[of_metric["difference"].notna(), "objects"], default=0)
        if len(directories) == 1:
            have, more = "this run has", "give a run of more"
        else:
            old, new = directories
            have = "these runs share"
            more = (
                f"give runs of more, or compare any number with 'bench check {old} --bless "
                f"golden.json' and 'bench check {new} --golden golden.json'"
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
        for row in records(left)
    ]
    return (
        f"--fail-on: {len(left)} of {len(cells)} cells are not decided, as they have fewer than "
        f"{intervals.FEWEST} objects with a value: {listed(named)}"
    )


def recommend(
    directory: RunDirectory,
    budget_ms: Annotated[
        float | None,
        typer.Option(help="Milliseconds for a cloud with all its images. Default: no limit."),
    ] = None,
    views: Annotated[
        int | None, typer.Option(help="Images of a cloud. Default: as many as in the run.")
    ] = None,
    condition: Annotated[
        str | None, typer.Option(help="A condition of the run, in full. Default: all, in short.")
    ] = None,
    min_ssim: Annotated[
        float | None, typer.Option(help="Least SSIM that is good enough, 0 to 1. Default: none.")
    ] = None,
    metric: Annotated[
        str | None,
        typer.Option(
            help="Metrics of images that judge within the budget, comma-separated. Default: "
            "ssim-object, lpips."
        ),
    ] = None,
) -> None:
    """Recommend a method for a budget, or for a quality. Exit 1 if no method meets it."""
    run = read_run(directory).with_further(names(metric) or ())
    manifest = run.manifest
    request = Requirements(manifest["views"] if views is None else views, budget_ms, min_ssim)
    metrics = _judging_metrics(run, names(metric))
    measured = [*metrics, SSIM] if min_ssim is not None and SSIM not in metrics else metrics
    compared = at_condition(run.compared(measured), condition)
    choices, met = best_methods(compared, request, metrics, verdicts_of(run, measured))
    in_full = condition is not None
    asked = {BEST: in_full or budget_ms is not None, NEXT: in_full, NO_BEST: budget_ms is not None}
    choices = choices[[asked.get(choice, True) for choice in choices["choice"]]]
    lines = [f"{how_timed(manifest)} Scores are against {TRUTHS[run.suite.truth]}."]
    if request.views != manifest["views"]:
        lines.append(
            f"Costs of {request.views} view{'s' * (request.views > 1)} are reckoned from the share "
            "of one; drawn in a call of their own they may differ."
        )
    if compared["ci_low"].isna().all():
        objects = max(map(len, compared["objects"]))
        lines.append(
            f"Means alone decide: {intervals.FEWEST} objects of a class are needed to show that a "
            f"method is ahead of another, or surely good enough, and there are {objects}."
        )
    print("\n".join(laid_out([*lines, "", *_choices(choices, compared, request)], line_width())))
    if not met:
        raise typer.Exit(1)


def _judging_metrics(run: Run, wanted: Sequence[str] | None) -> list[str]:
    """Return the wanted metrics, else those of the headline that the run has.

    Raises BadInput for a metric that is none of images, or that the run does not have.
    """
    further = [metric for metric in wanted or () if declared_metric(metric)]
    images = [*run.suite.image_metrics, *run.suite.detail_metrics, *further]
    measured = run.measured(sorted(images, key=lambda metric: metric not in run.suite.headline))
    for name in wanted or ():
        if name not in measured:
            raise BadInput(f"--metric {name}: cannot judge here; there are {', '.join(measured)}")
    return list(wanted or run.headline or [SSIM])


def _choices(choices: pd.DataFrame, compared: pd.DataFrame, request: Requirements) -> list[Any]:
    """Return the choices as a table, what one has to know beside them, and what marks mean."""
    where = ["condition", *["class"] * (choices["class"].nunique() > 1)]
    metrics = compared["metric"].unique()
    heads = [*where, "choice", "method", *metrics, "ms a cloud", "ms an image"]
    values = {
        (row["condition"], row["class"], row["method"], row["metric"]): _text(
            measured((row["value"], row["ci_low"], row["ci_high"]), row["metric"], row["method"])
        )
        for row in records(compared)
    }
    lines, remarks = [], []
    for row in records(choices):
        cloud = (row["condition"], row["class"], row["method"])
        cost = row["cost_ms"], row["cost_ci_low"], row["cost_ci_high"]
        place = [*(row[name] for name in where), f"{row['choice']} by {row['metric']}"]
        line = [
            *place,
            row["method"],
            *(values.get((*cloud, metric), "-") for metric in metrics),
            _text(number(cost, milliseconds)),
            milliseconds(row["cost_ms"] / request.views),
        ]
        lines.append(list(map(visible, line)))
        if remark := "; ".join(_remarks(row, request)):
            remarks.append(visible(f"{', '.join(place)}: {remark}."))
    moved = any(MOVED in text for line in (*lines, remarks) for text in line)
    remarks += [f"{FEWER}."] * moved
    return [terminal_table(heads, lines, left=len(heads)), *[""] * bool(remarks), *remarks]


def _remarks(row: Mapping[str, Any], request: Requirements) -> Iterator[str]:
    """Yield what one has to know beside the numbers of a choice."""
    if row["choice"] == NEXT:
        lead = row["lead"], row["lead_low"], row["lead_high"]
        yield f"behind by {_text(measured(lead, row['metric'], row['method']))}"
    for words, methods in (
        ("not shown to be ahead of", "undecided"),
        ("no choice, worse than a white image:", "below"),
    ):
        if isinstance(row[methods], list) and row[methods]:
            more = f" and {len(row[methods]) - ALTERNATIVES} more"
            named = ", ".join(row[methods][:ALTERNATIVES])
            yield f"{words} {named}{more * (len(row[methods]) > ALTERNATIVES)}"
    if row["n_ok"] < row["n"]:
        yield f"{row['n'] - row['n_ok']:.0f} of {row['n']:.0f} images failed"
    if request.budget_ms is not None and row["cost_ms"] > request.budget_ms:
        yield "over the budget"
    elif request.budget_ms is not None and row["cost_ci_high"] > request.budget_ms:
        yield "the interval of its cost reaches beyond the budget"


def _text(cell: Cell) -> str:
    return cell.text + (" [{}, {}]".format(*cell.interval) if cell.interval else "")
