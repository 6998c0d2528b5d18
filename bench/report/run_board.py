"""The leaderboard of runs of one data set and truth: a group of columns for each run."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from threadpoolctl import threadpool_limits

from bench.analysis.comparison import Comparison, milliseconds, pooled
from bench.analysis.frame import Run
from bench.analysis.leaderboard import over_conditions
from bench.analysis.ranks import Ranking, ranking
from bench.catalogue.conditions import condition_words
from bench.catalogue.methods import RECOMMENDED, role
from bench.catalogue.metrics import is_mean
from bench.report.board import (
    HEADLINE,
    Board,
    BoardCell,
    BoardColumn,
    BoardGroup,
    is_reference,
    leaderboard,
    metric_column,
    trained_on,
    value_cell,
)
from bench.tables.differences import too_few

SHORT = 7  # digits of a checksum in a name
_CHECKSUM = re.compile(r"\b[0-9a-f]{32,}\b")
LETTERS = (
    "Values are means over objects and conditions; a failed image is scored as a blank one. "
    "Methods that share a letter are not shown to differ (paired object by object, p below .05 "
    "after correction for all pairs of a column)."
)


@dataclass(frozen=True)
class NamedRun:
    """A run, its name among others, and the address of its report."""

    name: str
    run: Run
    report: str


def run_board(runs: Sequence[NamedRun]) -> Board | None:
    """Return the leaderboard of runs of one data set and truth; None where none has a value.

    Methods have places where every run with values has them: among others a mean of places would
    depend on whom a method has met.
    """
    ids: dict[str, str] = {}
    taught: dict[str, BoardCell] = {}
    groups, notes = [], [LETTERS]
    for run, names in zip(runs, method_names([run.run.manifest for run in runs]), strict=True):
        metrics = run.run.measured([*dict.fromkeys((*HEADLINE, *run.run.suite.headline))])
        metrics = [metric for metric in metrics if is_mean(metric)]
        with threadpool_limits(1):
            by_class = run.run.compared(metrics)
            compared = pooled(by_class) or by_class  # of several classes all objects together
            if not compared or not metrics:
                notes.append(f"{run.name} has no scored image.")
                continue
            overall = over_conditions(compared)
            rankings = [ranking(overall, metric) for metric in metrics]
        groups.append(_of_run(run, names, overall, rankings))
        notes += _missing(run, rankings)
        for method, name in names.items():
            ids.setdefault(name, method)
            taught.setdefault(name, trained_on(method, run.run.manifest))
    if not groups:
        return None
    columns = [column for group in groups for column in group.columns if column.placed]
    rivals = [name for name, method in ids.items() if not is_reference(method)]
    competing = [m for m in rivals if all(m in column.cells for column in columns)]
    if len(competing) < 2:
        competing = []
        notes.append("No places: fewer than two methods have values in every column.")
    elif others := [m for m in rivals if m not in competing]:
        notes.append(f"No place, as they do not have every value: {', '.join(others)}.")
    return leaderboard(
        f"{len(competing)} methods by the mean of their places" if competing else "All methods",
        groups,
        (BoardColumn("trained on", "objects that a network was shown", taught, "text"),),
        ids,
        competing,
        named={RECOMMENDED},
        notes=notes,
    )


def _of_run(
    run: NamedRun,
    names: Mapping[str, str],
    overall: Comparison,
    rankings: Sequence[Ranking],
) -> BoardGroup:
    """Return the columns of a run: its metrics, and the cost of a cloud on its machine."""
    columns = []
    for of_metric in rankings:
        cells = {}
        for rank in of_metric.ranks:
            n_ok, n = overall.images[rank.method]
            failed = f"{n - n_ok} of {n} failed" if n_ok < n else ""
            cells[names[rank.method]] = value_cell(
                rank.estimate.value,
                of_metric.metric,
                rank.method,
                letters=rank.letters,
                caveat=failed,
            )
        columns.append(metric_column(of_metric.metric, cells))
    costs, views = {}, int(run.run.manifest["views"])
    for method in overall.images:
        cost = overall.cost_ms(method, views).value
        if math.isfinite(cost) and not role(method):
            claimed = "claimed" if method in overall.claimed else ""
            costs[names[method]] = BoardCell(milliseconds(cost), cost, beneath=claimed)
    machine = run.run.manifest.get("machine", {}).get("cpu", "an unknown processor")
    drawn = f"{views} view{'s' * (views > 1)}"
    about = f"a cloud of the first condition with its {drawn}, one thread of {machine}"
    columns.append(BoardColumn(f"{drawn} (ms)", about, costs))
    shown = list(map(condition_words, run.run.manifest["conditions"]))
    words = f"mean over {len(shown)} conditions" if len(shown) > 1 else shown[0]
    return BoardGroup(tuple(columns), run.name, ", ".join(shown), words, run.report)


def _missing(run: NamedRun, rankings: Sequence[Ranking]) -> list[str]:
    """Return why letters and metrics of the headline are missing in a run."""
    needed = [of_metric.objects_needed for of_metric in rankings if of_metric.objects_needed]
    notes = [f"{run.name} has no letters: {too_few(max(needed))}."] if needed else []
    measured = [of_metric.metric for of_metric in rankings]
    for metric in HEADLINE:
        if metric not in measured:
            reason = run.run.skipped.get(metric, "not measured")
            notes.append(f"{run.name} has no {metric}: {reason.removeprefix('skipped: ')}.")
    return notes


def method_names(manifests: Sequence[Mapping[str, Any]]) -> list[dict[str, str]]:
    """Return the names of the methods of each run by their ids.

    An id with other weights or of another version is another method: its name has what differs.
    Versions of libraries make no other method.
    """
    stated = [{m: _identity(manifest, m) for m in manifest["methods"]} for manifest in manifests]
    identities: dict[str, set[tuple[str, ...]]] = {}
    for methods in stated:
        for method, identity in methods.items():
            identities.setdefault(method, set()).add(identity)
    return [
        {method: _name(method, identity, identities[method]) for method, identity in run.items()}
        for run in stated
    ]


def _identity(manifest: Mapping[str, Any], method: str) -> tuple[str, ...]:
    """Return the version of a method and its weights; nothing where the run does not say."""
    match manifest.get("identities", {}).get(method):
        case [version, str(text), *_]:
            parts = [part for part in text.split(", ") if part]
        case _:
            return ()
    libraries = {f"{name} {number}" for name, number in manifest.get("versions", {}).items()}
    return (f"version {version}", *(part for part in parts if part not in libraries))


def _name(method: str, identity: tuple[str, ...], all_of_id: set[tuple[str, ...]]) -> str:
    """Return a name that no other identity of the same id has."""
    if len(all_of_id) == 1:
        return method
    common = set.intersection(*map(set, all_of_id))
    suffixes = {
        parts: ", ".join(part for part in parts if part not in common) or "identity unknown"
        for parts in all_of_id
    }
    short = {
        parts: _CHECKSUM.sub(lambda checksum: checksum[0][:SHORT], text)
        for parts, text in suffixes.items()
    }
    if len(set(short.values())) == len(short):
        suffixes = short
    return f"{method} ({suffixes[identity]})"
