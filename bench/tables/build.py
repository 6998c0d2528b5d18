"""A finished run: its tables from its records, and the files they are kept in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.condition_sweep import ConditionCurve, condition_curves, paired_comparisons
from bench.analysis.frontier import FrontierPoint, SubsampledFrontier, places, thinned
from bench.catalogue.metrics import JUDGE
from bench.records.journal import PROTOCOL
from bench.tables import markdown
from bench.tables.classes import class_table
from bench.tables.condition_sweep import ConditionStep, condition_sweep_table
from bench.tables.frontier import frontier_table, points_table
from bench.tables.headline import headline
from bench.tables.orderings import Ordering, orderings
from bench.tables.published import published
from bench.tables.quality import (
    QualityRow,
    detail_table,
    image_table,
    recognition_table,
    set_table,
    with_objectives,
)
from bench.tables.scored import ScoredRun
from bench.tables.table import Table, grid, of_protocol, write_tables
from data_prep.files.atomic_write import write_whole

R = TypeVar("R")
COST = "cost.md"
# File names and titles of image, set and detail table: the paper's, and of a suite of our own.
DETAIL = ("table_detail", "Detail: the object alone, its outline and its thin parts")
PAPER_TITLES = (
    ("table3_ssim", "Table 3: SSIM and its components against the true mesh (higher is better)"),
    ("table4_fid", "Table 4: distances to pictures of the true mesh (lower is better)"),
    DETAIL,
)
GREY_TITLES = (
    ("table_ssim", "SSIM and its components against the true mesh in grey (higher is better)"),
    ("table_frechet", "Distances to pictures of the true mesh in grey (lower is better)"),
    DETAIL,
)
OWN_TITLES = (
    ("table_ssim", "SSIM and its components against the true mesh (higher is better)"),
    ("table_frechet", "Distances to pictures of the true mesh (lower is better)"),
    DETAIL,
)


def tables(run: ScoredRun) -> list[Table[QualityRow]]:
    """The tables of a run, from its records and features alone.

    One BLAS thread, so that the last digits are the same however many cores there are.
    """
    ours = run.suite.frontier or run.suite.class_metrics or run.suite.condition_sweep
    titles = OWN_TITLES if ours else PAPER_TITLES
    images, sets, detail = titles if run.suite.painted else GREY_TITLES
    paper = published(run.suite.id)
    with threadpool_limits(1):
        of_features = run.records, run.features, run.skipped, run.suite, paper
        by_class = run.suite.class_metrics
        made = [
            image_table(*images, run.records, run.skipped, run.suite, paper),
            class_table(*of_features) if by_class else set_table(*sets, *of_features),
            detail_table(*detail, run.records, run.skipped, run.suite),
        ]
        if run.suite.control_metrics:
            judged, skipped = run.features.get(JUDGE), run.skipped.get(JUDGE, "")
            made.append(recognition_table(run.records, judged, skipped, run.suite))
        objectives = dict(run.manifest.get("objectives", {}))
        return [_of_run(run, with_objectives(table, objectives)) for table in made]


def _of_run(run: ScoredRun, table: Table[R]) -> Table[R]:
    return of_protocol(table, run.manifest[PROTOCOL])


def class_orderings(run: ScoredRun) -> Table[Ordering] | None:
    """Which of the paper's orderings of Table 5 a run reproduces; None where it has none."""
    if not run.suite.class_metrics:
        return None
    with threadpool_limits(1):
        made = orderings(run.records, run.features, run.suite, published(run.suite.id))
    return None if made is None else _of_run(run, made)


def curves(run: ScoredRun) -> tuple[ConditionCurve, ...]:
    """The methods of a run along the families of conditions that it has; none for other suites."""
    metrics = run.measured(run.suite.condition_sweep)
    with threadpool_limits(1):
        return condition_curves(run.compared(metrics), metrics) if metrics else ()


def condition_sweep(run: ScoredRun) -> Table[ConditionStep] | None:
    """Who is ahead of whom along these, and where that changes; None without two such methods."""
    metrics = run.measured(run.suite.condition_sweep)
    with threadpool_limits(1):
        found = paired_comparisons(run.compared(metrics), metrics) if metrics else ()
    return _of_run(run, condition_sweep_table(run.suite.id, found)) if found else None


def frontier_tables(
    run: ScoredRun,
) -> tuple[Table[FrontierPoint], Table[SubsampledFrontier]] | None:
    """Quality against cost: the frontier, and what fewer points save; None for other suites.

    Not among `tables`: times differ from run to run, so nothing is ever compared with them.
    """
    if not run.suite.frontier:
        return None
    metrics, views = run.measured(run.suite.frontier), int(run.manifest["views"])
    with threadpool_limits(1):
        compared = run.compared(metrics)
        # Also with a single view: its frontier is another.
        placed = (
            place
            for count in dict.fromkeys((views, 1))
            for comparison in compared
            for place in places(comparison, metrics, count)
        )
        frontier = frontier_table(placed, how_timed(run.manifest))
        fewer = points_table(thinned(compared, metrics, views), views)
    return _of_run(run, frontier), _of_run(run, fewer)


@dataclass(frozen=True)
class Outputs:
    """What is made of the records and features of a run; see the functions of the same names."""

    run: ScoredRun
    headline: Table[QualityRow]
    tables: tuple[Table[QualityRow], ...]
    cost: str
    frontier_tables: tuple[Table[FrontierPoint], Table[SubsampledFrontier]] | None
    orderings: Table[Ordering] | None
    curves: tuple[ConditionCurve, ...]
    condition_sweep: Table[ConditionStep] | None

    @property
    def further(self) -> list[Table[Any]]:
        """The tables that only some suites have."""
        return [
            t
            for t in (*(self.frontier_tables or ()), self.orderings, self.condition_sweep)
            if t is not None
        ]


def make_outputs(run: ScoredRun) -> Outputs:
    """All tables of a run."""
    return Outputs(
        run,
        headline=headline(run),
        tables=tuple(tables(run)),
        cost=cost_table(run.records, how_timed(run.manifest)),
        frontier_tables=frontier_tables(run),
        orderings=class_orderings(run),
        curves=curves(run),
        condition_sweep=condition_sweep(run),
    )


def write_outputs(run: ScoredRun) -> Outputs:
    """Make the tables of a run and write them into its folder."""
    made = make_outputs(run)
    write_tables(run.directory, [made.headline, *made.tables, *made.further])
    write_whole(run.directory / COST, made.cost.encode())
    return made


def how_timed(manifest: Mapping[str, Any]) -> str:
    """How the times of a run were taken, in a sentence."""
    workers = manifest.get("workers")
    if workers == 1:
        beside = "nothing beside it"
    elif workers is None:
        beside = "it is not known what ran beside it"
    else:
        beside = f"{workers} workers at a time: compare costs within this run only"
    cpu = manifest.get("machine", {}).get("cpu", "an unknown processor")
    return (
        f"Wall time of one thread on {markdown.cell(str(cpu))}, {beside}; all {manifest['views']} "
        "views of a cloud drawn in one call."
    )


def cost_table(records: pd.DataFrame, remark: str) -> str:
    """What the numbers cost, in Markdown: medians in milliseconds, per cloud and per view.

    Not one of the tables: times differ from run to run. `remark` says how they were taken.
    """
    ok = records[records["outcome"] == "ok"]
    per_cloud = ok.drop_duplicates(["method", "condition", "class", "object"])
    conditions = list(dict.fromkeys(records["condition"]))
    lines = []
    for method in dict.fromkeys(records["method"]):
        line = [method]
        for condition in conditions:
            chosen = (per_cloud["method"] == method) & (per_cloud["condition"] == condition)
            prepare_s, draw_s = per_cloud.loc[chosen, ["prepare_s", "draw_s"]].median()
            line.append(f"{1000 * prepare_s:.1f} + {1000 * draw_s:.1f}" if chosen.any() else "-")
        lines.append(line)
    title = "# Cost: median milliseconds to prepare a cloud + to draw a view (one thread)"
    return markdown.document([title, remark, grid(["method", *conditions], lines)])
