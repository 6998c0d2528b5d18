"""The index over several runs: a leaderboard for each, and a link to its report.

Runs share a leaderboard only where they differ in nothing but their methods: one with the easier
objects or conditions would seem better. `bench.report.site` writes the page with those it links to;
`studies.leaderboard` makes a leaderboard of the project's results by the same functions.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.compare import (
    ALL,
    compared,
    milliseconds,
    over_conditions,
    pooled,
    with_costs,
)
from bench.analysis.digits import decimals, is_coarse, prints_better
from bench.analysis.pairs import refuse_other_objects
from bench.analysis.ranks import mean_places, ranking
from bench.analysis.run import Run
from bench.catalogue.conditions import condition_words
from bench.catalogue.methods import (
    FLOOR,
    RECOMMENDED,
    RECOMMENDED_IN_COLOUR,
    role,
    training_objects,
)
from bench.catalogue.metrics import METRICS, higher_is_better, is_mean
from bench.catalogue.suites import TRUTHS
from bench.entered.claims import ENTERED
from bench.records.folder import CONDITION_IDENTITIES, FIXED, PROTOCOL, TRUTH, entry
from bench.report.answer import counted, objects_in_words
from bench.report.page import rendered
from bench.tables.differences import too_few
from bench.tables.grid import FEWER, MOVED, row_mappings
from data_prep.failures import BadInput

HEADLINE_METRICS = ("ssim-object", "lpips")  # stand before the other metrics of a suite
_WORDS = {  # what stands beside a method's name, by its id or by its role
    "ceiling": "reference: the true mesh",
    "floor": "reference: sees no cloud",
    RECOMMENDED: "recommended",
    RECOMMENDED_IN_COLOUR: "recommended in colours",
}


class BoardCell(NamedTuple):
    """A cell of a leaderboard.

    text     the value as people read it
    value    the number by which its column is sorted; None comes last
    letters  letters of a rank: methods that share one do not differ significantly
    beneath  a remark in small letters beneath the value
    caveat   what speaks against the value
    """

    text: str
    value: float | None = None
    letters: str = ""
    beneath: str = ""
    caveat: str = ""


EMPTY = BoardCell("–")  # of a method without a value


class BoardColumn(NamedTuple):
    """A column of a leaderboard.

    title    what its values are, in full
    cells    by the name of a method, for those that have a value
    numeric  whether it is sorted by numbers
    higher   whether a higher value is better
    placed   whether it is a metric, in which methods have places
    """

    name: str
    title: str
    cells: Mapping[str, BoardCell]
    numeric: bool = True
    higher: bool = False
    placed: bool = False


class BoardGroup(NamedTuple):
    """Columns under one common head; columns of a group without a name have none above them.

    title  what the values are, in full
    """

    columns: Sequence[BoardColumn]
    name: str = ""
    title: str = ""


Pages = Mapping[str, tuple[str, str]]  # by method: its page, and the data URI of an image or ""


def value_cell(value: float, metric: str, method: str, **beside: str) -> BoardCell:
    """Return the cell of a value, which is written without a 0 before the point.

    beside  further fields of the cell
    """
    text = f"{value:.{decimals(metric, method)}f}"
    text = text.removeprefix("0") if text.startswith("0.") else text.replace("-0.", "−.")
    if is_coarse(metric, method):
        text = MOVED + text
    return BoardCell(text, value, **beside)


def metric_column(metric: str, cells: Mapping[str, BoardCell]) -> BoardColumn:
    """Return the column of a metric, in which methods have places."""
    higher = higher_is_better(metric)
    return BoardColumn(metric, _metric_words(metric), cells, higher=higher, placed=True)


def leaderboard(
    caption: str,
    groups: Sequence[BoardGroup],
    further: Sequence[BoardColumn],
    methods: Sequence[str],
    notes: Sequence[str],
    pages: Pages = MappingProxyType({}),
) -> dict[str, Any]:
    """Return what the template of a leaderboard shows: every method in a row of its own.

    groups     columns of values; places are those in their columns of metrics
    further    columns after the mean places
    methods    all methods
    notes      stand below, after what the metrics mean

    It has `caption`, `notes`, `groups` as (number of the group's first column, BoardGroup), and
    `rows` in the order of the places: place (or None), name, about, whether it is a reference,
    page (of `pages`, or None), cells.
    """
    metric_columns = []
    for group in groups:
        metric_columns += [column for column in group.columns if column.placed]
    places = mean_places(
        [(column.name, _values(column)) for column in metric_columns],
        [method for method in methods if not is_reference(method)],
    )
    placed = sorted(places, key=places.__getitem__)
    others = [method for method in methods if method not in places]
    others.sort(key=is_reference)
    mean = BoardColumn(
        "mean place",
        "of the columns that have a value; stretched to all methods",
        {method: BoardCell(f"{place:.1f}", place) for method, place in places.items()},
    )
    groups = (*groups, BoardGroup((mean, *further)))
    numbered_groups = []
    columns: list[BoardColumn] = []
    for group in groups:
        # The first two columns of the page have the place and the name.
        numbered_groups.append((2 + len(columns), group))
        columns += group.columns
    # Methods with equal mean places share a rank, as in sports.
    means = sorted(places.values())
    ranks = {method: 1 + means.index(places[method]) for method in placed}
    rows = [
        {
            "place": ranks.get(method),
            "name": method,
            "about": _WORDS.get(method, _WORDS.get(role(method), "")),
            "reference": is_reference(method),
            "page": pages.get(method),
            "cells": [_cell(column, method) for column in columns],
        }
        for method in (*placed, *others)
    ]
    metrics = dict.fromkeys(column.name for column in metric_columns)
    meanings = "; ".join(f"{metric}: {_metric_words(metric)}" for metric in metrics)
    all_notes = [f"{meanings}.", *notes]
    if any(cell.text.startswith(MOVED) for row in rows for cell in row["cells"]):
        all_notes.append(f"{FEWER}.")
    return {"caption": caption, "groups": numbered_groups, "rows": rows, "notes": all_notes}


def _values(column: BoardColumn) -> dict[str, float]:
    """Return the values of a column by the names of the methods that have one."""
    return {name: cell.value for name, cell in column.cells.items() if cell.value is not None}


def _cell(column: BoardColumn, method: str) -> BoardCell:
    """Return the cell of a method, which says where a white image is better."""
    cell = column.cells.get(method, EMPTY)
    if not column.placed or is_reference(method) or cell.value is None:
        return cell
    blank = column.cells.get(FLOOR, EMPTY).value
    if blank is None or not prints_better(column.name, blank, cell.value, method):
        return cell
    caveats = [cell.caveat, "worse than blank"]
    return cell._replace(caveat="; ".join(filter(None, caveats)))


def is_reference(method_id: str) -> bool:
    """Return whether a method is shown for comparison only, and has no place."""
    return role(method_id) in ("ceiling", "floor")


def _metric_words(metric: str) -> str:
    """Return what a metric measures, and which values are better."""
    better = "higher is better" if higher_is_better(metric) else "lower is better"
    known = METRICS.get(metric)
    return f"{known.about if known else 'a metric of another package'}; {better}"


def trained_on(method_id: str, manifest: Mapping[str, Any] = MappingProxyType({})) -> BoardCell:
    """Return the cell with the objects that a method was trained on, or "unknown".

    manifest  of a run that has the method, where it is not of the catalogue
    """
    if is_reference(method_id):
        return EMPTY
    if role(method_id):
        return BoardCell("another at each condition")
    return BoardCell(training_objects(method_id, manifest) or "unknown")


_Rankings = Mapping[str, tuple[pd.DataFrame, int | None]]  # by metric, as `ranking` returns them
# Entries of a manifest that runs have alike where they share a leaderboard.
_ALIKE = (*FIXED, TRUTH, "conditions", CONDITION_IDENTITIES, "objects")
WRITTEN_BY = "pc2pix-bench, index of runs"  # stands in the head of a page that may be replaced
_LETTERS = (
    "Values are means over objects and conditions; a failed image is scored as a blank one. "
    "Methods that share a letter are not shown to differ (paired object by object, p below .05 "
    "after correction for all pairs of a column)."
)


class NamedRun(NamedTuple):
    """A run, its name among the others, and the addresses of its pages, relative to the index."""

    name: str
    run: Run
    report: str
    pages: Pages = MappingProxyType({})


def index_html(runs: Sequence[NamedRun]) -> str:
    """Return the index as one HTML document, of runs by one version of the protocol."""
    return rendered("index.html.jinja", groups=run_groups(runs), written_by=WRITTEN_BY)


def run_groups(runs: Sequence[NamedRun]) -> list[dict[str, Any]]:
    """Return the runs in groups that share a leaderboard, those that are alike together.

    A group has its `title`, what its values are of as `about`, its `runs` as (name, address of the
    report, how it was measured), and its leaderboard as `board`, None where it has no value.
    """
    groups: list[list[NamedRun]] = []
    for run in runs:
        for group in groups:
            if all(_are_alike(other.run, run.run) for other in group):
                group.append(run)
                break
        else:
            groups.append([run])
    return [
        {
            "title": ", ".join(run.name for run in group),
            "about": _in_common(group[0].run),
            "runs": [(run.name, run.report, _how_measured(run.run)) for run in group],
            "board": _run_board(group),
        }
        for group in groups
    ]


def _are_alike(a: Run, b: Run) -> bool:
    """Return whether two runs differ in nothing but methods that only one of them has."""
    if any(entry(a.manifest, name) != entry(b.manifest, name) for name in _ALIKE):
        return False
    versions_a, versions_b = (run.manifest["identities"] for run in (a, b))
    shared = {*a.manifest["methods"]} & {*b.manifest["methods"]}
    if any(versions_a.get(method) != versions_b.get(method) for method in shared):
        return False
    try:
        refuse_other_objects(a, b)
    except BadInput:
        return False
    return _metrics(a) == _metrics(b)


def _joined(runs: Sequence[Run]) -> Run:
    """Return runs that are alike as one, which takes each method from the first that has it."""
    methods: list[str] = []
    jobs, entered = [], {}
    for run in runs:
        further = [method for method in run.manifest["methods"] if method not in methods]
        jobs.append(run.jobs[run.jobs["method"].isin(further)])
        methods += further
        entered = run.manifest.get(ENTERED, {}) | entered
    processors = ", ".join(dict.fromkeys(map(_processor, runs)))
    named = {"methods": methods, ENTERED: entered, "machine": {"cpu": processors}}
    manifest = runs[0].manifest | named
    return replace(runs[0], manifest=manifest, jobs=pd.concat(jobs, ignore_index=True))


def _in_common(run: Run) -> str:
    """Return in words what the values of a run are of."""
    manifest = run.manifest
    classes = {str(name).partition("/")[0] for name in manifest["objects"]}
    objects = objects_in_words(len(manifest["objects"]), min(classes) if len(classes) == 1 else ALL)
    of_classes = f" of {len(classes)} classes" if len(classes) > 1 else ""
    conditions = ", ".join(map(condition_words, manifest["conditions"]))
    return (
        f"{objects}{of_classes} ({manifest['dataset']}), {counted(manifest['views'], 'view')} of "
        f"each, seed {manifest['seed']}; {conditions}; against {TRUTHS[run.suite.truth]}; protocol "
        f"{manifest[PROTOCOL]}."
    )


def _how_measured(run: Run) -> str:
    """Return in words how a run was measured: its suite, its failures, its time and machine."""
    counts = [run.images(image_set) for image_set in run.image_sets]
    planned = sum(number for _, number in counts)
    failed = planned - sum(drawn for drawn, _ in counts)
    return (
        f"{run.manifest['suite']}, {failed:,} of {planned:,} images failed; finished "
        f"{run.manifest['finished'][:10]} on {_processor(run)}"
    )


def _processor(run: Run) -> str:
    """Return the processor that a run was made on."""
    return str(run.manifest.get("machine", {}).get("cpu", "an unknown processor"))


def _metrics(run: Run) -> list[str]:
    """Return the metrics of a run that a leaderboard shows."""
    metrics = run.measured([*dict.fromkeys((*HEADLINE_METRICS, *run.suite.headline))])
    return [metric for metric in metrics if is_mean(metric)]


def _run_board(group: Sequence[NamedRun]) -> dict[str, Any] | None:
    """Return the leaderboard of runs that are alike; None where they have no value."""
    run = _joined([named.run for named in group])
    with threadpool_limits(1):
        rows = compared(run, _metrics(run))
        if rows.empty:
            return None
        together = pooled(rows)  # without rows for a single class
        overall = over_conditions(rows if together.empty else together)
        by_metric = overall.groupby("metric", sort=False)
        rankings = {str(metric): ranking(of_metric) for metric, of_metric in by_metric}
    methods = run.manifest["methods"]
    taught = {method: trained_on(method, run.manifest) for method in methods}
    notes = [_LETTERS, *_missing(run, rankings)]
    everywhere = Counter(method for named in group for method in named.run.manifest["methods"])
    if repeated := [method for method in methods if everywhere[method] > 1]:
        notes.append(f"Of several runs, and here of the first that has it: {', '.join(repeated)}.")
    pages = {method: page for named in group[::-1] for method, page in named.pages.items()}
    return leaderboard(
        "Methods by the mean of their places",
        (_columns(run, overall, rankings),),
        (BoardColumn("trained on", "objects that a network was shown", taught, numeric=False),),
        methods,
        notes,
        pages,
    )


def _columns(run: Run, overall: pd.DataFrame, rankings: _Rankings) -> BoardGroup:
    """Return the columns of a run: its metrics, and the cost of a cloud on its machine."""
    columns = []
    for metric, (ranked, _) in rankings.items():
        cells = {}
        for row in row_mappings(ranked):
            method, n_ok, n = row["method"], row["n_ok"], row["n"]
            failed = f"{n - n_ok} of {n} failed" if n_ok < n else ""
            cells[method] = value_cell(
                row["value"], metric, method, letters=row["letters"], caveat=failed
            )
        columns.append(metric_column(metric, cells))
    costs, views = {}, int(run.manifest["views"])
    for row in row_mappings(with_costs(overall.drop_duplicates("method"), views)):
        cost = row["cost_ms"]
        if math.isfinite(cost) and not role(row["method"]):
            claimed = "claimed" if row["claimed"] else ""
            costs[row["method"]] = BoardCell(milliseconds(cost), cost, beneath=claimed)
    drawn = counted(views, "view")
    about = f"a cloud of the first condition with its {drawn}, one thread of {_processor(run)}"
    columns.append(BoardColumn(f"{drawn} (ms)", about, costs))
    conditions = list(map(condition_words, run.manifest["conditions"]))
    words = conditions[0] if len(conditions) == 1 else f"mean over {len(conditions)} conditions"
    return BoardGroup(tuple(columns), name=words, title=", ".join(conditions))


def _missing(run: Run, rankings: _Rankings) -> list[str]:
    """Return lines on why a run lacks letters, or metrics of the headline."""
    needed = [objects for _, objects in rankings.values() if objects]
    notes = [f"No letters: {too_few(max(needed))}."] if needed else []
    for metric in HEADLINE_METRICS:
        if metric not in rankings:
            reason = run.skipped.get(metric, "not measured")
            notes.append(f"No {metric}: {reason.removeprefix('skipped: ')}.")
    return notes
