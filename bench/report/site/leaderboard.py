"""The leaderboard of a site's runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from bench.analysis.comparison import milliseconds, worse_than_blank
from bench.analysis.leaderboard import MeanRanks, mean_ranks, object_scores
from bench.analysis.paired import SIGNIFICANCE
from bench.analysis.ranks import Ranking
from bench.catalogue.condition_names import condition_words
from bench.catalogue.methods import RECOMMENDED, role
from bench.catalogue.metrics import higher_is_better
from bench.report.page import PageImage
from bench.report.site.board import (
    EMPTY,
    Board,
    BoardCell,
    BoardColumn,
    BoardGroup,
    BoardRow,
    fraction,
    row_kinds,
)
from bench.report.site.site_run import HEADLINE, SiteRun, manifest_of, method_file, method_id_of
from bench.report.site.words import (
    joined_names,
    letter_range,
    method_words,
    metric_words,
    p_words,
    trained_on,
)
from bench.tables.differences import too_few
from bench.tables.grid import FEWER, MOVED

MOST_RUNS = 3  # beside each other on a screen
MEANS = "means-"  # begins the anchors of the glossary


def site_ranks(runs: Sequence[SiteRun]) -> MeanRanks:
    """Return the mean ranks of all methods over runs, conditions and metrics."""
    cells = []
    for run in runs:
        names = {method.id: name for name, method in run.methods.items()}
        dataset = str(run.run.manifest["dataset"])
        for comparison in run.compared:
            for metric in run.metrics:
                cell = object_scores(comparison, metric, dataset)
                if cell is not None:
                    scores = {names[id_]: values for id_, values in cell.scores.items()}
                    cells.append(replace(cell, scores=scores))
    return mean_ranks(cells)


def leaderboard(
    runs: Sequence[SiteRun],
    methods: Sequence[str],
    ranks: MeanRanks,
    thumbnails: Mapping[str, PageImage],
) -> Board:
    """Return the leaderboard of runs of one truth; methods without a mean rank come last."""
    by_rank = [rank.method for rank in ranks.ranks]
    ordered = [*by_rank, *(m for m in methods if m not in by_rank)]
    ids = {method: method_id_of(runs, method) for method in ordered}
    references = {m for m in ordered if role(ids[m])}
    ordered.sort(key=lambda method: method in references)  # stable: references come last
    kinds = row_kinds(ordered, ids, {RECOMMENDED})
    of_rank = {rank.method: rank for rank in ranks.ranks}
    machines = {run.machine for run in runs}
    groups = (
        *map(_of_run, runs),
        BoardGroup(_general_columns(len(by_rank), machines, len(runs))),
    )
    # Of many runs the values are beyond the right edge, where they may be rather than the ranks.
    general_first = len(runs) > MOST_RUNS
    if general_first:
        groups = (groups[-1], *groups[:-1])
    rows = []
    for method in ordered:
        rank = of_rank.get(method)
        mean = EMPTY
        if rank is not None:
            tied = not math.isnan(rank.p_first) and rank.p_first >= SIGNIFICANCE
            p = f"p {p_words(rank.p_first)} against {ranks.first}" if tied else ""
            mean = BoardCell(f"{rank.rank:.1f}", rank.rank, beneath=p)
        cells = [_value(run, metric, method) for run in runs for metric in run.metrics]
        cost = _cost(runs, method, len(machines) > 1)
        taught = trained_on(ids[method], manifest_of(runs, method))
        of_runs = sum(method in run.methods for run in runs)
        general = [mean, cost, BoardCell(taught), BoardCell(str(of_runs), float(of_runs))]
        cells = [*general, *cells] if general_first else [*cells, *general]
        rows.append(
            BoardRow(
                by_rank.index(method) + 1 if rank else None,
                method,
                tuple(cells),
                kinds[method],
                letter_range(rank.letters) if rank else "",
                method_words(ids[method]),
                method_file(method),
                thumbnails.get(method),
            )
        )
    return Board(
        f"All methods by their mean rank among the {len(by_rank)} that compete, against "
        f"{runs[0].truth}",
        groups,
        tuple(rows),
        _notes(runs, ranks),
    )


def _of_run(run: SiteRun) -> BoardGroup:
    count = len(run.compared)
    about = f"mean over {count} conditions" if count > 1 else "one condition"
    columns = tuple(
        BoardColumn(m, metric_words(m), f"#{MEANS}{m}", higher=higher_is_better(m))
        for m in run.metrics
    )
    conditions = ", ".join(condition_words(c.condition) for c in run.compared)
    title = f"{run.objects}; {about}: {conditions}"
    return BoardGroup(columns, run.name, title, run.page)


def _general_columns(count: int, machines: set[str], runs: int) -> tuple[BoardColumn, ...]:
    """Return the columns that no single run gives."""
    rank = (
        f"mean rank among {count} methods over objects, conditions, metrics and runs; to methods "
        "that it has not met one is taken to lose as often as to others"
    )
    cost = "milliseconds for a cloud and its first view, median over objects, one thread"
    return (
        BoardColumn("mean rank", rank, f"#{MEANS}rank", f"of {count}"),
        BoardColumn(
            "ms a view", cost, f"#{MEANS}cost", min(machines) if len(machines) == 1 else ""
        ),
        BoardColumn("trained on", "objects that a network was shown", sort="text"),
        BoardColumn("runs", "runs that have the method", "#runs", f"of {runs}", higher=True),
    )


def _value(run: SiteRun, metric: str, method: str) -> BoardCell:
    """Return the mean of a method over the conditions of a run, with the letters of its rank."""
    ranking = run.overall_rankings[metric]
    rank = ranking.of(method)
    if rank is None:
        return EMPTY
    id_ = run.methods[method].id
    n_ok, n = run.overall.images[id_]
    below = not role(id_) and id_ in worse_than_blank(run.overall.qualities[metric])
    caveats = [f"{n - n_ok} of {n} failed"] * (n_ok < n) + ["worse than blank"] * below
    digits, half = rank.precision
    return BoardCell(
        MOVED * (half is not None) + fraction(rank.estimate.value, digits),
        rank.estimate.value,
        letter_range(rank.letters),
        _against_best(ranking, method),
        caveat="; ".join(caveats),
    )


def _against_best(ranking: Ranking, method: str) -> str:
    """Return the p value against the best of a ranking; empty for the best and references."""
    best = ranking.ranks[0].method
    for cell in ranking.pairs:
        if {cell.pair.a.method, cell.pair.b.method} == {best, method} and cell.p_holm >= 0:
            outcome = "not shown to differ" if cell.ahead == "tie" else "differs"
            if cell.ahead == "unknown":
                outcome = "undecided"
            return f"against {best}: {outcome}, p {p_words(cell.p_holm)}"
    return ""


def _cost(runs: Sequence[SiteRun], method: str, name_machine: bool) -> BoardCell:
    """Return the cost of a view in the first run that has it, timed runs before others."""
    for run in sorted(runs, key=lambda run: not run.run.suite.timed):
        if method in run.methods and (id_ := run.methods[method].id) in run.overall.images:
            cost = run.overall.cost_ms(id_, 1).value
            if math.isfinite(cost) and not role(id_):
                beneath = run.machine if name_machine else ""
                if id_ in run.overall.claimed:
                    beneath = "claimed"
                return BoardCell(milliseconds(cost), cost, beneath=beneath)
    return EMPTY


def _notes(runs: Sequence[SiteRun], ranks: MeanRanks) -> tuple[str, ...]:
    """Return how to read the table, and what is missing in it."""
    notes = [
        "Methods that share a letter are not shown to differ (paired object by object, p below .05 "
        "after Holm's correction for all pairs). Values are means over objects and conditions; a "
        "failed image is scored as a blank one. Without letters: too few objects in common with "
        "others to decide."
    ]
    if any(
        rank.precision.half is not None
        for run in runs
        for ranking in run.overall_rankings.values()
        for rank in ranking.ranks
    ):
        notes.append(f"{FEWER}.")
    if ranks.objects_needed:
        notes.append(f"Mean ranks without letters: {too_few(ranks.objects_needed)}.")
    for run in runs:
        for metric in dict.fromkeys([*HEADLINE, *(m for other in runs for m in other.metrics)]):
            if metric in run.metrics:
                continue
            reason = run.run.skipped.get(metric, "not measured")
            notes.append(f"{run.name} has no {metric}: {reason.removeprefix('skipped: ')}.")
        competing = [m for m, method in run.methods.items() if not role(method.id)]
        if len(competing) < 2:
            named = joined_names(competing) or "none"
            notes.append(f"{run.name} ranks nothing; methods that compete: {named}.")
    return tuple(notes)
