"""A finished run: its tables from its records, and the files they are kept in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.comparison import Comparison, compare
from bench.analysis.crossings import ConditionCurve, condition_curves, paired_comparisons
from bench.analysis.distances import MeasuredFeatures
from bench.analysis.frontier import Place, Thinned, places, thinned
from bench.analysis.recognition import read_class_head
from bench.catalogue.lookup import find
from bench.catalogue.metrics import (
    IMAGE_METRICS,
    JUDGE,
    RECOGNITION_METRICS,
    find_extractor,
)
from bench.catalogue.suites import LATENT, SPEED, STABILITY, SUITES, Suite
from bench.judges import VIEWS_WEIGHTS
from bench.records.features import Features
from bench.records.journal import read_finished
from bench.records.parquet import read_features, read_records
from bench.tables import markdown
from bench.tables.classes import class_table, with_confidence
from bench.tables.crossings import Step, crossings_table
from bench.tables.frontier import frontier_table, points_table
from bench.tables.orderings import Ordering, orderings
from bench.tables.published import published
from bench.tables.quality import (
    Row,
    control_table,
    detail_table,
    image_table,
    set_table,
    with_objectives,
)
from bench.tables.table import TABLES, Table, grid, write_tables
from data_prep.failures import BadInput
from data_prep.fingerprints import file_sha256
from data_prep.whole_files import write_whole

COST = "cost.md"
# File names and titles of image, set and detail table: the paper's, and of a suite of our own.
PAPER_TITLES = (
    ("table3_ssim", "Table 3: SSIM and its components against the true mesh (higher is better)"),
    ("table4_fid", "Table 4: Fréchet distances to pictures of the true mesh (lower is better)"),
    ("table_detail", "Detail: the object alone, its outline and its thin parts (higher is better)"),
)
OWN_TITLES = (
    ("table_ssim", "SSIM and its components against the true mesh (higher is better)"),
    ("table_frechet", "Fréchet distances to pictures of the true mesh (lower is better)"),
    ("table_detail", "Detail: the outline (higher is better)"),
)
BEYOND_TITLES = (
    *OWN_TITLES[:2],
    ("table_detail", "Detail: the outline and the thin parts (higher is better)"),
)
VIEWS = "fd-views"


@dataclass(frozen=True, eq=False)
class ScoredRun:
    """A run whose images were scored: its records in the order of the tables and its features,
    read once, with the comparisons and distances that have been computed.

    features  by extractor
    skipped   reasons of the extractors without features
    """

    directory: Path
    suite: Suite
    manifest: dict[str, Any]
    records: pd.DataFrame
    features: dict[str, MeasuredFeatures]
    skipped: dict[str, str]
    _compared: dict[tuple[str, ...], list[Comparison]] = field(default_factory=dict, repr=False)

    def measured(self, metrics: Sequence[str]) -> list[str]:
        """Those of these metrics of images and of sets that the run has."""
        return [m for m in metrics if m in IMAGE_METRICS or m in self.features]

    def compared(self, metrics: Sequence[str]) -> list[Comparison]:
        """The methods on the same objects, by these metrics."""
        if tuple(metrics) not in self._compared:
            self._compared[tuple(metrics)] = compare(self.records, self.features, metrics)
        return self._compared[tuple(metrics)]


def tables(run: ScoredRun) -> list[Table[Row]]:
    """The tables of a run, from its records and features alone.

    One BLAS thread, so that the last digits are the same however many cores there are.
    """
    ours = run.suite.frontier or run.suite.class_metrics
    titles = BEYOND_TITLES if run.suite.crossings else OWN_TITLES if ours else PAPER_TITLES
    images, sets, detail = titles
    paper = published(run.suite.id)
    with threadpool_limits(1):
        of_features = run.records, run.features, run.skipped, run.suite, paper
        by_class = run.suite.class_metrics
        made = [
            image_table(*images, run.records, run.suite, paper),
            class_table(*of_features) if by_class else set_table(*sets, *of_features),
            detail_table(*detail, run.records, run.suite),
        ]
        if run.suite.control_metrics:
            judged, skipped = run.features.get(JUDGE), run.skipped.get(JUDGE, "")
            made.append(control_table(run.records, judged, skipped, run.suite))
        objectives = dict(run.manifest.get("objectives", {}))
        return [with_objectives(table, objectives) for table in made]


def class_orderings(run: ScoredRun) -> Table[Ordering] | None:
    """Which of the paper's orderings of Table 5 a run reproduces; None where it has none."""
    if not run.suite.class_metrics:
        return None
    with threadpool_limits(1):
        return orderings(run.records, run.features, run.suite, published(run.suite.id))


def curves(run: ScoredRun) -> tuple[ConditionCurve, ...]:
    """The methods of a run along the families of conditions that it has; none for other suites."""
    metrics = run.measured(run.suite.crossings)
    with threadpool_limits(1):
        return condition_curves(run.compared(metrics), metrics) if metrics else ()


def crossings(run: ScoredRun) -> Table[Step] | None:
    """Who is ahead of whom along these, and where that changes; None without two such methods."""
    metrics = run.measured(run.suite.crossings)
    with threadpool_limits(1):
        found = paired_comparisons(run.compared(metrics), metrics) if metrics else ()
    return crossings_table(run.suite.id, found) if found else None


def trade(run: ScoredRun) -> tuple[Table[Place], Table[Thinned]] | None:
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
        return frontier, points_table(thinned(compared, metrics, views), views)


@dataclass(frozen=True)
class Outputs:
    """What is made of the records and features of a run; see the functions of the same names."""

    run: ScoredRun
    tables: tuple[Table[Row], ...]
    cost: str
    trade: tuple[Table[Place], Table[Thinned]] | None
    orderings: Table[Ordering] | None
    curves: tuple[ConditionCurve, ...]
    crossings: Table[Step] | None

    @property
    def further(self) -> list[Table[Any]]:
        """The tables that only some suites have."""
        return [t for t in (*(self.trade or ()), self.orderings, self.crossings) if t is not None]


def make_outputs(run: ScoredRun) -> Outputs:
    """All tables of a run."""
    return Outputs(
        run,
        tables=tuple(tables(run)),
        cost=cost_table(run.records, how_timed(run.manifest)),
        trade=trade(run),
        orderings=class_orderings(run),
        curves=curves(run),
        crossings=crossings(run),
    )


def write_outputs(run: ScoredRun) -> Outputs:
    """Make the tables of a run and write them into its folder."""
    made = make_outputs(run)
    write_tables(run.directory, [*made.tables, *made.further])
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


def _suite(directory: Path, manifest: Mapping[str, Any]) -> Suite:
    """The suite of a run. Raises BadInput for one that makes its tables itself."""
    made_by_the_run = [suite.id for suite in (LATENT, STABILITY, SPEED)]
    if manifest.get("suite") in made_by_the_run:
        raise BadInput(
            f"{directory}: a run of {manifest['suite']} writes its tables itself; they are in "
            f"{directory / TABLES}"
        )
    return find(str(manifest.get("suite")), SUITES, "suite")


def read_scored(directory: Path) -> ScoredRun:
    """A finished run whose images were scored. Raises BadInput for anything else."""
    return scored_run(directory, read_finished(directory))


def scored_run(directory: Path, manifest: dict[str, Any]) -> ScoredRun:
    """A run with this manifest, whose records and features are written.

    Raises BadInput where they cannot be read, for a manifest that does not describe them, and for a
    suite that makes its tables itself.
    """
    suite = _suite(directory, manifest)
    if lacking := [name for name in ("methods", "conditions", "objects") if name not in manifest]:
        raise BadInput(
            f"{directory}: its manifest has no {', '.join(lacking)}; start the run again with its "
            "command"
        )
    records = in_order(read_records(directory), manifest, ("condition", "method"))
    features: dict[str, MeasuredFeatures] = {}
    skipped: dict[str, str] = dict(manifest.get("skipped_metrics", {}))
    for metric in suite.extractors:
        found = read_features(directory, metric)
        if metric not in skipped and found is None:
            skipped[metric] = "skipped: no features in this run"
        elif found is not None:
            features[metric] = MeasuredFeatures(found)
    for metric in set(suite.class_metrics) & RECOGNITION_METRICS.keys():
        if reason := _why_unrecognised(manifest, features, records):
            skipped[metric] = f"skipped: {reason}"
        else:
            head = read_class_head(VIEWS_WEIGHTS)
            records = with_confidence(records, features[VIEWS], head)
    return ScoredRun(directory, suite, manifest, records, features, skipped)


def _why_unrecognised(
    manifest: Mapping[str, Any], features: Mapping[str, Features], records: pd.DataFrame
) -> str:
    """Why the bundled classifier cannot be asked about the features of a run; empty if it can."""
    if VIEWS not in features:
        return f"no features of {VIEWS} in this run"
    bundled = f"{find_extractor(VIEWS).version} {file_sha256(VIEWS_WEIGHTS)}"
    if manifest.get("feature_identity", {}).get(VIEWS) != bundled:
        return f"the features are not of the bundled weights of {VIEWS}; start the run again"
    known = read_class_head(VIEWS_WEIGHTS).classes
    strange = [name for name in dict.fromkeys(records["class"]) if name not in known]
    if strange:
        return f"the classifier of {VIEWS} does not know {', '.join(strange)}"
    return ""


def in_order(records: pd.DataFrame, manifest: Mapping[str, Any], by: Sequence[str]) -> pd.DataFrame:
    """Records by some columns, methods and conditions in the order of the manifest; stable."""
    ranks = {
        column: {name: i for i, name in enumerate(manifest[plural])}
        for column, plural in (("method", "methods"), ("condition", "conditions"))
    }
    return records.sort_values(
        list(by),
        key=lambda values: values.map(ranks[str(values.name)]) if values.name in ranks else values,
        kind="stable",
        ignore_index=True,
    )
