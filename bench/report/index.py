"""The index over several runs: a card and a report for each, and a leaderboard for each data set.

Values of runs are beside each other only where data set and truth are the same. The page links to
the reports where they are, beside their runs, and loads nothing. `studies.leaderboard` makes a
leaderboard of the project's results by the same functions.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple
from urllib.parse import quote

import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.compare import compared, milliseconds, over_conditions, pooled, with_costs
from bench.analysis.digits import decimals, is_coarse, prints_better
from bench.analysis.ranks import mean_places, ranking
from bench.analysis.run import Run, read_run
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
from bench.records.folder import FIXED, PROTOCOL, TRUTH, locked_run, open_store
from bench.report.answer import counted
from bench.report.build import REPORT, write_report
from bench.report.page import rendered
from bench.tables.build import make_outputs
from bench.tables.differences import too_few
from bench.tables.grid import FEWER, MOVED, row_mappings
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole
from data_prep.progress import progress

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
    about  the same in a few words, which stand beneath the name
    link   address that the name links to
    """

    columns: Sequence[BoardColumn]
    name: str = ""
    title: str = ""
    about: str = ""
    link: str = ""


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
    ids: Mapping[str, str],
    competing: Collection[str],
    notes: Sequence[str],
) -> dict[str, Any]:
    """Return what the template of a leaderboard shows: every method in a row of its own.

    groups     columns of values; places are those in their columns of metrics
    further    columns after the mean places
    ids        ids of the catalogue by the names of all methods
    competing  names of the methods that have places
    notes      stand below, after what the metrics mean

    It has `caption`, `notes`, `groups` as (number of the group's first column, BoardGroup), and
    `rows` in the order of the places: place (or None), name, about, whether it is a reference,
    cells.
    """
    metric_columns = []
    for group in groups:
        metric_columns += [column for column in group.columns if column.placed]
    places = mean_places(
        [(column.name, _values(column)) for column in metric_columns],
        {name: ids[name] for name in competing},
    )
    placed = sorted(places, key=places.__getitem__)
    others = [name for name in ids if name not in places]
    others.sort(key=lambda name: is_reference(ids[name]))
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
    rows = [
        {
            "place": place if method in places else None,
            "name": method,
            "about": _WORDS.get(ids[method], _WORDS.get(role(ids[method]), "")),
            "reference": is_reference(ids[method]),
            "cells": [_cell(column, method, ids) for column in columns],
        }
        for place, method in enumerate((*placed, *others), 1)
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


def _cell(column: BoardColumn, method: str, ids: Mapping[str, str]) -> BoardCell:
    """Return the cell of a method, which says where a white image is better."""
    cell = column.cells.get(method, EMPTY)
    if not column.placed or is_reference(ids[method]) or cell.value is None:
        return cell
    blanks = [value for name, value in _values(column).items() if ids[name] == FLOOR]
    if not blanks or not prints_better(column.name, blanks[0], cell.value, ids[method]):
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
INDEX = "index.html"  # name of the page
_WRITTEN_BY = "pc2pix-bench, index of runs"  # stands in the head of a page that may be replaced
_HEAD_BYTES = 2_000  # bytes at the beginning of a page that have its head
_SHORT = 7  # digits of a checksum in the name of a method
_CHECKSUM = re.compile(r"\b[0-9a-f]{32,}\b")
_LETTERS = (
    "Values are means over objects and conditions; a failed image is scored as a blank one. "
    "Methods that share a letter are not shown to differ (paired object by object, p below .05 "
    "after correction for all pairs of a column)."
)


class NamedRun(NamedTuple):
    """A run, its name among the others, and the address of its report, relative to the page."""

    name: str
    run: Run
    report: str


def write_index(directories: Sequence[Path], out: Path | None = None) -> Path:
    """Write the report of each run, and the index over them into `out`; return the index.

    directories  folders of finished runs, two or more
    out          folder of the index. Default: the one that all folders are in.

    Raises BadInput as `read_run`; where a folder is given twice or holds a copy of another run;
    where the folders are not beside each other and `out` is missing; where `out` is a page; and
    where a page of another origin is in its place. Raises CannotWrite where a page cannot be
    written.
    """
    folders = [directory.resolve() for directory in directories]
    page = _place(folders, out)
    for i, folder in enumerate(folders):
        if folder in folders[:i]:
            raise BadInput(f"{directories[i]}: given twice; give each folder once")
    runs = [read_run(directory) for directory in directories]
    _refuse_copies(runs)
    with progress("reports", len(runs)) as advance:
        for run in runs:
            remedy = "make it writable, or leave this run out"
            with locked_run(run.directory, remedy):
                write_report(make_outputs(run), remedy=remedy)
            advance(0)
    names = [folder.name for folder in folders]
    if len(set(names)) < len(names):
        names = [os.path.relpath(folder, page.parent) for folder in folders]
    named = [
        NamedRun(name, run, quote(os.path.relpath(folder / REPORT, page.parent)))
        for name, run, folder in zip(names, runs, folders, strict=True)
    ]
    write_whole(page, index_html(named).encode(), remedy="give another --out")
    return page


def _place(folders: Sequence[Path], out: Path | None) -> Path:
    """Return the file of the index. Raises BadInput where it would replace another page."""
    if out is None:
        if len({folder.parent for folder in folders}) > 1:
            raise BadInput("the runs are in several folders; give --out, a folder for the index")
        out = folders[0].parent
    page = out.resolve() / INDEX
    if out.suffix in (".html", ".htm") or (out.exists() and not out.is_dir()):
        raise BadInput(f"--out {out}: of several runs a folder is needed; give one for {INDEX}")
    if page.exists():
        with page.open("rb") as file:
            if _WRITTEN_BY.encode() not in file.read(_HEAD_BYTES):
                raise BadInput(f"{page}: is there, and no index of runs; give another --out")
    return page


def _refuse_copies(runs: Sequence[Run]) -> None:
    """Raise BadInput where two folders have the same records, times included, of one request."""
    first: dict[tuple[Any, ...], Path] = {}
    for run in runs:
        request = (run.manifest.get(name) for name in (*FIXED, TRUTH))
        with open_store(run.directory) as store:
            key = (*request, store.digest())
        other = first.setdefault(key, run.directory)
        if other != run.directory:
            raise BadInput(f"{run.directory}: a copy of the run in {other}; give one of the two")


def index_html(runs: Sequence[NamedRun]) -> str:
    """Return the index as one HTML document."""
    return rendered(
        "index.html.jinja",
        groups=run_groups(runs),
        facts=(("protocol", str(runs[0].run.manifest[PROTOCOL])), ("runs", str(len(runs)))),
        written_by=_WRITTEN_BY,
    )


def run_groups(runs: Sequence[NamedRun]) -> list[dict[str, Any]]:
    """Return the runs by data set and truth, which all are of one version of the protocol.

    A group has its `title`, the `cards` of its runs, and their leaderboard as `board`, None where
    no run has a value.
    """
    groups: dict[str, list[NamedRun]] = {}
    for run in runs:
        title = f"{run.run.manifest['dataset']}, against {TRUTHS[run.run.suite.truth]}"
        groups.setdefault(title, []).append(run)
    return [
        {"title": title, "cards": list(map(_card, of_group)), "board": _run_board(of_group)}
        for title, of_group in groups.items()
    ]


def _card(named: NamedRun) -> dict[str, Any]:
    """Return what the page shows of a run: name, address of the report, and facts."""
    run, manifest = named.run, named.run.manifest
    counts = [run.images(image_set) for image_set in run.image_sets]
    drawn = sum(existing for existing, _ in counts)
    planned = sum(number for _, number in counts)
    classes = {str(name).partition("/")[0] for name in manifest["objects"]}
    of_what = f"{len(classes)} classes" if len(classes) > 1 else f"class {min(classes)}"
    facts = (
        ("suite", str(manifest["suite"])),
        ("dataset", str(manifest["dataset"])),
        ("truth", TRUTHS[run.suite.truth]),
        ("objects", f"{len(manifest['objects'])} of {of_what}"),
        ("views", str(manifest["views"])),
        ("conditions", ", ".join(map(condition_words, manifest["conditions"]))),
        ("methods", str(len(manifest["methods"]))),
        ("failed", f"{planned - drawn:,} of {planned:,} images"),
        ("seed", str(manifest["seed"])),
        ("machine", str(manifest.get("machine", {}).get("cpu", "unknown"))),
        ("finished", str(manifest["finished"])[:10]),
        ("protocol", str(manifest[PROTOCOL])),
    )
    return {"name": named.name, "report": named.report, "about": run.suite.about, "facts": facts}


def _run_board(runs: Sequence[NamedRun]) -> dict[str, Any] | None:
    """Return the leaderboard of runs of one data set and truth; None where none has a value.

    Only methods that every run has a value of get places: the mean place of another one would
    depend on the methods that it was compared with.
    """
    ids: dict[str, str] = {}
    taught: dict[str, BoardCell] = {}
    groups, notes = [], [_LETTERS]
    for run, names in zip(runs, _method_names([run.run.manifest for run in runs]), strict=True):
        metrics = run.run.measured([*dict.fromkeys((*HEADLINE_METRICS, *run.run.suite.headline))])
        metrics = [metric for metric in metrics if is_mean(metric)]
        with threadpool_limits(1):
            by_class = compared(run.run, metrics)
            together = pooled(by_class)  # without rows for a single class
            rows = by_class if together.empty else together
            if rows.empty:
                notes.append(f"{run.name} has no scored image.")
                continue
            overall = over_conditions(rows)
            by_metric = overall.groupby("metric", sort=False)
            rankings = {str(metric): ranking(rows) for metric, rows in by_metric}
        groups.append(_of_run(run, names, overall, rankings))
        notes += _missing(run, rankings)
        for method, name in names.items():
            ids.setdefault(name, method)
            taught.setdefault(name, trained_on(method, run.run.manifest))
    if not groups:
        return None
    columns = []
    for group in groups:
        columns += [column for column in group.columns if column.placed]
    rivals = [name for name, method in ids.items() if not is_reference(method)]
    valued_everywhere = set(rivals).intersection(*(column.cells for column in columns))
    competing = [name for name in rivals if name in valued_everywhere]
    if len(competing) < 2:
        competing = []
        notes.append("No places: fewer than two methods have values in every column.")
    elif others := [name for name in rivals if name not in competing]:
        notes.append(f"No place, as they do not have every value: {', '.join(others)}.")
    return leaderboard(
        f"{len(competing)} methods by the mean of their places" if competing else "All methods",
        groups,
        (BoardColumn("trained on", "objects that a network was shown", taught, numeric=False),),
        ids,
        competing,
        notes,
    )


def _of_run(
    run: NamedRun,
    names: Mapping[str, str],
    overall: pd.DataFrame,
    rankings: _Rankings,
) -> BoardGroup:
    """Return the columns of a run: its metrics, and the cost of a cloud on its machine."""
    columns = []
    for metric, (ranked, _) in rankings.items():
        cells = {}
        for row in row_mappings(ranked):
            method, n_ok, n = row["method"], row["n_ok"], row["n"]
            failed = f"{n - n_ok} of {n} failed" if n_ok < n else ""
            cells[names[method]] = value_cell(
                row["value"], metric, method, letters=row["letters"], caveat=failed
            )
        columns.append(metric_column(metric, cells))
    costs, views = {}, int(run.run.manifest["views"])
    for row in row_mappings(with_costs(overall.drop_duplicates("method"), views)):
        cost = row["cost_ms"]
        if math.isfinite(cost) and not role(row["method"]):
            claimed = "claimed" if row["claimed"] else ""
            costs[names[row["method"]]] = BoardCell(milliseconds(cost), cost, beneath=claimed)
    machine = run.run.manifest.get("machine", {}).get("cpu", "an unknown processor")
    drawn = counted(views, "view")
    about = f"a cloud of the first condition with its {drawn}, one thread of {machine}"
    columns.append(BoardColumn(f"{drawn} (ms)", about, costs))
    conditions = list(map(condition_words, run.run.manifest["conditions"]))
    words = conditions[0] if len(conditions) == 1 else f"mean over {len(conditions)} conditions"
    return BoardGroup(
        tuple(columns), name=run.name, title=", ".join(conditions), about=words, link=run.report
    )


def _missing(run: NamedRun, rankings: _Rankings) -> list[str]:
    """Return lines on why a run lacks letters, or metrics of the headline."""
    needed = [objects for _, objects in rankings.values() if objects]
    notes = [f"{run.name} has no letters: {too_few(max(needed))}."] if needed else []
    for metric in HEADLINE_METRICS:
        if metric not in rankings:
            reason = run.run.skipped.get(metric, "not measured")
            notes.append(f"{run.name} has no {metric}: {reason.removeprefix('skipped: ')}.")
    return notes


def _method_names(manifests: Sequence[Mapping[str, Any]]) -> list[dict[str, str]]:
    """Return for each run the names of its methods, by their ids.

    Where runs have an id with different weights or versions, these are different methods, and their
    names say what differs. Different versions of libraries do not count.
    """
    identities: dict[str, list[tuple[str, ...]]] = {}  # by method, each once
    for manifest in manifests:
        for method in manifest["methods"]:
            of_method = identities.setdefault(method, [])
            identity = _identity(manifest, method)
            if identity not in of_method:
                of_method.append(identity)
    suffixes = {method: _suffixes(of_method) for method, of_method in identities.items()}
    names = []
    for manifest in manifests:
        of_run = {}
        for method in manifest["methods"]:
            of_run[method] = method + suffixes[method][_identity(manifest, method)]
        names.append(of_run)
    return names


def _suffixes(identities: Sequence[tuple[str, ...]]) -> dict[tuple[str, ...], str]:
    """Return what stands behind the name of a method to tell its identities apart.

    Checksums are shortened where that leaves them different. A single identity needs nothing.
    """
    if len(identities) == 1:
        return {identities[0]: ""}
    common = set.intersection(*map(set, identities))
    texts, short_texts = {}, {}
    for identity in identities:
        text = ", ".join(part for part in identity if part not in common)
        texts[identity] = text
        short_texts[identity] = _CHECKSUM.sub(lambda match: match[0][:_SHORT], text)
    if len({*short_texts.values()}) == len(short_texts):
        texts = short_texts
    return {identity: f" ({text or 'identity unknown'})" for identity, text in texts.items()}


def _identity(manifest: Mapping[str, Any], method: str) -> tuple[str, ...]:
    """Return the version of a method and its weights; nothing where the run does not say."""
    match manifest.get("identities", {}).get(method):
        case [number, str(text), *_]:
            versions: Mapping[str, str] = manifest.get("versions", {})
            libraries = [f"{library} {version}" for library, version in versions.items()]
            parts = [part for part in text.split(", ") if part and part not in libraries]
            return (f"version {number}", *parts)
        case _:
            return ()
