"""A finished run: its tables from its records, and the files they are kept in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.comparison import Comparison, compare
from bench.analysis.crossings import Course, contests, courses
from bench.analysis.frontier import Place, Thinned
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
from bench.records.journal import read_manifest
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
from bench.tables.table import Table, grid, table_files
from data_prep.failures import BadInput
from data_prep.fingerprints import file_sha256
from data_prep.whole_files import write_whole

TABLES = "tables"
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
_COSTED = ("method", "condition", "class", "object", "outcome", "prepare_s", "draw_s")


@dataclass(frozen=True)
class Trade:
    """Quality against cost: the frontier, and what fewer points save."""

    frontier: Table[Place]
    points: Table[Thinned]


@dataclass(frozen=True)
class Beyond:
    """The methods along the families of conditions that a run has, of which there may be none.

    crossings  who is ahead of whom, and where that changes; None without two such methods
    """

    courses: tuple[Course, ...]
    crossings: Table[Step] | None


def tables(directory: Path) -> list[Table[Row]]:
    """The tables of a finished run, from its records and features alone.

    One BLAS thread, so that the last digits are the same however many cores there are. Raises
    BadInput where `directory` is not a finished run.
    """
    run = read_scored(directory)
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
            made.append(
                control_table(
                    "table_control",
                    "Control: does the picture show the view and the object it should?",
                    run.records,
                    run.features.get(JUDGE),
                    run.skipped.get(JUDGE, ""),
                    run.suite,
                )
            )
        objectives = dict(run.manifest.get("objectives", {}))
        return [with_objectives(table, objectives) for table in made]


def class_orderings(directory: Path) -> Table[Ordering] | None:
    """Which of the paper's orderings of Table 5 a finished run reproduces; None where it has none.

    From records and features alone, as `tables`.
    """
    if not _suite(directory, read_manifest(directory)).class_metrics:
        return None
    run = read_scored(directory)
    with threadpool_limits(1):
        return orderings(run.records, run.features, run.suite, published(run.suite.id))


def beyond(directory: Path) -> Beyond | None:
    """The methods of a finished run along families of conditions; None for suites without.

    From records and features alone, as `tables`.
    """
    if not _suite(directory, read_manifest(directory)).crossings:
        return None
    run = read_scored(directory)
    metrics = [m for m in run.suite.crossings if m in IMAGE_METRICS or m in run.features]
    with threadpool_limits(1):
        compared = compare(run.records, run.features, metrics)
        fought = contests(compared, metrics)
        table = crossings_table(run.suite.id, fought) if fought else None
        return Beyond(courses(compared, metrics), table)


def write_tables(directory: Path) -> list[Table[Row]]:
    """Make the tables and write them into `directory`/tables."""
    made = tables(directory)
    for name, text in table_files(made).items():
        write_whole(directory / TABLES / name, text.encode())
    return made


def write_orderings(directory: Path) -> Table[Ordering] | None:
    """Write the orderings beside the tables; None for suites without."""
    made = class_orderings(directory)
    if made is not None:
        for name, text in table_files([made]).items():
            write_whole(directory / TABLES / name, text.encode())
    return made


def write_beyond(directory: Path) -> Beyond | None:
    """Write the crossings beside the tables, where there are any; None for suites without."""
    made = beyond(directory)
    if made is not None and made.crossings is not None:
        for name, text in table_files([made.crossings]).items():
            write_whole(directory / TABLES / name, text.encode())
    return made


def write_trade(directory: Path) -> Trade | None:
    """Write the tables of quality against cost beside the others; None for suites without a trade.

    Not among `tables`: times differ from run to run, so nothing is ever compared with them.
    """
    if not _suite(directory, read_manifest(directory)).frontier:
        return None
    run = read_scored(directory)
    metrics = [m for m in run.suite.frontier if m in IMAGE_METRICS or m in run.features]
    views = int(run.manifest["views"])
    with threadpool_limits(1):
        compared = compare(run.records, run.features, metrics)
        frontier = frontier_table(compared, metrics, views, how_timed(run.manifest))
        made = Trade(frontier, points_table(compared, metrics, views))
    for name, text in table_files([made.frontier, made.points]).items():
        write_whole(directory / TABLES / name, text.encode())
    return made


def read_comparisons(directory: Path, metrics: Sequence[str]) -> list[Comparison]:
    """The methods of a finished run, compared by image metrics.

    Raises BadInput where `directory` is no finished run whose pictures were scored.
    """
    return compare(read_scored(directory).records, {}, metrics)


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


def write_cost(directory: Path) -> str:
    """Write `cost.md` beside the tables, and return it."""
    manifest = read_manifest(directory)
    records = _in_suite_order(read_records(directory, _COSTED), manifest)
    text = cost_table(records, how_timed(manifest))
    write_whole(directory / COST, text.encode())
    return text


@dataclass(frozen=True, eq=False)
class ScoredRun:
    """What a run has left: records in the order of the tables, features by extractor.

    skipped  reasons of the extractors without features
    """

    suite: Suite
    manifest: dict[str, Any]
    records: pd.DataFrame
    features: dict[str, Features]
    skipped: dict[str, str]


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
    """A finished run whose pictures were scored. Raises BadInput for anything else."""
    manifest = read_manifest(directory)
    suite = _suite(directory, manifest)
    records = _in_suite_order(read_records(directory), manifest)
    features: dict[str, Features] = {}
    skipped: dict[str, str] = dict(manifest.get("skipped_metrics", {}))
    for metric in suite.extractors:
        found = read_features(directory, metric)
        if metric not in skipped and found is None:
            skipped[metric] = "skipped: no features in this run"
        elif found is not None:
            features[metric] = found
    for metric in set(suite.class_metrics) & RECOGNITION_METRICS.keys():
        if reason := _why_unrecognised(manifest, features, records):
            skipped[metric] = f"skipped: {reason}"
        else:
            head = read_class_head(VIEWS_WEIGHTS)
            records = with_confidence(records, features[VIEWS], head)
    return ScoredRun(suite, manifest, records, features, skipped)


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


def _in_suite_order(records: pd.DataFrame, manifest: dict[str, Any]) -> pd.DataFrame:
    """Rows in the order of the manifest's conditions and methods, which is the tables' order."""
    rank = [
        records[column].map({name: i for i, name in enumerate(manifest[plural])})
        for column, plural in (("condition", "conditions"), ("method", "methods"))
    ]
    order = pd.DataFrame({"condition": rank[0], "method": rank[1]}).sort_values(
        ["condition", "method"], kind="stable"
    )
    return records.loc[order.index].reset_index(drop=True)
