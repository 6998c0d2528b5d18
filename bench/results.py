"""A finished run: its tables from its records, and the files they are kept in."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
from threadpoolctl import threadpool_limits

from bench import markdown
from bench.columns import read_features, read_records
from bench.lookup import find
from bench.metric_table import JUDGE
from bench.published import published
from bench.store import read_manifest
from bench.suites import LATENT, STABILITY, SUITES
from bench.tables import (
    Features,
    Table,
    control_table,
    detail_table,
    image_table,
    set_table,
    with_objectives,
)
from bench.work import write_whole
from data_prep.failures import BadInput

TABLES = "tables"
COST = "cost.md"


def tables(directory: Path) -> list[Table]:
    """The tables of a finished run, from its records and features alone.

    One BLAS thread, so that the last digits are the same however many cores there are. Raises
    BadInput where `directory` is not a finished run.
    """
    manifest = read_manifest(directory)
    made_by_the_run = [suite.id for suite in (LATENT, STABILITY)]
    if manifest.get("suite") in made_by_the_run:
        raise BadInput(
            f"{directory}: a run of {manifest['suite']} writes its tables itself; they are in "
            f"{directory / TABLES}"
        )
    suite = find(str(manifest.get("suite")), SUITES, "suite")
    records = _in_suite_order(read_records(directory), manifest)
    paper = published(suite.id)
    features: dict[str, Features] = {}
    skipped: dict[str, str] = dict(manifest.get("skipped_metrics", {}))
    for metric in suite.extractors:
        found = read_features(directory, metric)
        if metric not in skipped and found is None:
            skipped[metric] = "skipped: no features in this run"
        elif found is not None:
            features[metric] = found
    with threadpool_limits(1):
        made = [
            image_table(
                "table3_ssim",
                "Table 3: SSIM and its components against the true mesh (higher is better)",
                records,
                suite,
                paper,
            ),
            set_table(
                "table4_fid",
                "Table 4: Fréchet distances to pictures of the true mesh (lower is better)",
                records,
                features,
                skipped,
                suite,
                paper,
            ),
            detail_table(
                "table_detail",
                "Detail: the object alone, and its thin parts (higher is better)",
                records,
                suite,
            ),
        ]
        if suite.control_metrics:
            made.append(
                control_table(
                    "table_control",
                    "Control: does the picture show the view and the object it should?",
                    records,
                    features.get(JUDGE),
                    skipped.get(JUDGE, ""),
                    suite,
                )
            )
        objectives = dict(manifest.get("objectives", {}))
        return [with_objectives(table, objectives) for table in made]


def table_files(made: list[Table]) -> dict[str, str]:
    """File names and contents of tables: each as CSV and as Markdown."""
    return {
        name: text
        for table in made
        for name, text in (
            (f"{table.name}.csv", table.to_csv()),
            (f"{table.name}.md", table.to_markdown()),
        )
    }


def write_tables(directory: Path) -> list[Table]:
    """Make the tables and write them into `directory`/tables."""
    made = tables(directory)
    for name, text in table_files(made).items():
        write_whole(directory / TABLES / name, text.encode())
    return made


def cost_table(records: pd.DataFrame) -> str:
    """What the numbers cost, in Markdown: medians in milliseconds, per cloud and per view.

    Not one of the tables: times differ from run to run, and were taken while other workers ran.
    """
    ok = records[records["outcome"] == "ok"]
    per_cloud = ok.drop_duplicates(["method", "condition", "class", "object"])
    conditions = list(dict.fromkeys(records["condition"]))
    lines = [
        "# Cost: median milliseconds to prepare a cloud + to draw a view (one thread)",
        "",
        "Taken while other workers ran; compare within this run only.",
        "",
        markdown.row(["method", *map(markdown.cell, conditions)]),
        "|---" * (len(conditions) + 1) + "|",
    ]
    for method in dict.fromkeys(records["method"]):
        cells = []
        for condition in conditions:
            chosen = (per_cloud["method"] == method) & (per_cloud["condition"] == condition)
            prepare_s, draw_s = per_cloud.loc[chosen, ["prepare_s", "draw_s"]].median()
            cells.append(f"{1000 * prepare_s:.1f} + {1000 * draw_s:.1f}" if chosen.any() else "-")
        lines.append(markdown.row([markdown.cell(method), *cells]))
    return "\n".join(lines) + "\n"


def write_cost(directory: Path) -> str:
    """Write `cost.md` beside the tables, and return it."""
    text = cost_table(_in_suite_order(read_records(directory), read_manifest(directory)))
    write_whole(directory / COST, text.encode())
    return text


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
