"""The paper's values, and the table of its orderings that a run reproduces, class by class."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from bench.analysis.compare import NAN
from bench.analysis.intervals import FEWEST
from bench.analysis.paper import AVERAGE, NETWORK, SURFACE, VERDICTS, Published
from bench.catalogue.suites import TableSpec
from bench.tables import markdown
from bench.tables.grid import Annotation, Block, Cell, Grid, grid, metric_cell, number_cell, pivot
from bench.tables.table import Table
from data_prep.failures import BadInput

RESULTS = Path(__file__).resolve().parents[2] / "results"


def published(suite: str) -> Published:
    """Return the paper's values by (class, metric, condition, method); empty where it has none."""
    if not _published_path(suite).is_file():
        return {}
    rows = published_rows(suite)
    keys = zip(rows["class"], rows["metric"], rows["condition"], rows["method"], strict=True)
    return dict(zip(keys, rows["value"].astype(float), strict=True))


def published_rows(suite: str) -> pd.DataFrame:
    """Return the paper's values as printed, all columns text.

    Raises BadInput where the suite has no published values.
    """
    path = _published_path(suite)
    if not path.is_file():
        raise BadInput(f"{path}: no published values; run from a checkout that has them")
    return pd.read_csv(path, dtype=str)


def _published_path(suite: str) -> Path:
    return RESULTS / "paper" / f"{suite}.csv"


def seed_spreads() -> dict[tuple[str, str, str], float]:
    """Return by network, metric and condition how far the values of several trainings lie apart.

    It is the highest value less the lowest. The trainings are that of the bundled weights and
    others that differ in the seed alone, on chairs (`studies.seed_spread`). Empty where there is no
    file of them.
    """
    path = RESULTS / "seeds.csv"
    if not path.is_file():
        return {}
    rows = pd.read_csv(path, dtype={"condition": str})
    keys = zip(rows["network"], rows["metric"], rows["condition"], strict=True)
    return dict(zip(keys, rows["spread"].astype(float), strict=True))


MARKS = {
    "reproduced": Annotation("reproduced", "**{value}{interval}**"),
    "opposite": Annotation("opposite", "{value}{interval} *opposite*", against=True),
}


def orderings_table(spec: TableSpec, suite: str, frame: pd.DataFrame) -> Table:
    """Return the table of a run's orderings, a frame with at least one row of `orderings`."""
    network = frame["method"].iloc[0]
    frame.insert(0, "suite", suite)
    remark = _REMARK.format(network=network, surface=SURFACE)
    return Table(spec.name, spec.title, frame, partial(_layout, network), remark)


def _layout(network: str, frame: pd.DataFrame) -> Iterator[Block]:
    """Yield for each condition how many orderings hold by each metric, then the differences."""
    yield (
        f"How much better {markdown.code(network)} is than `{SURFACE}`, over 0 if it is, "
        "[interval, paired over objects], failed images scored as blank ones. The paper orders "
        f"by FID: {NETWORK} is ahead in 11 of 13 classes and on average, SR in rifle and lamp. "
        "**Bold**: that ordering, and the interval does not hold 0; *opposite*: the other one, "
        f"the same; neither: undecided by so many objects, or no interval below {FEWEST}. "
        "Intervals of a metric hold in 95 % for all classes together."
    )
    for condition, of_condition in frame.groupby("condition", sort=False):
        yield f"## {markdown.cell(str(condition))}"
        yield _counts(of_condition, f"classes at {condition}")
        yield _differences(of_condition, f"lead at {condition}")


def _counts(frame: pd.DataFrame, caption: str) -> Grid:
    """Return in how many classes the paper's ordering holds: a line for each metric."""
    lines = []
    for metric, of_metric in frame.groupby("metric", sort=False):
        classes = of_metric[of_metric["class"] != AVERAGE]
        counts = [(classes["verdict"] == verdict).sum() for verdict in VERDICTS]
        same_sign = (classes["lead"] * classes["paper_lead"] > 0).sum()
        (average,) = of_metric.loc[of_metric["class"] == AVERAGE, "verdict"]
        lines.append([str(metric), *map(str, (*counts, same_sign, average))])
    return grid(["classes", *VERDICTS, "same sign", "on average"], lines, caption=caption)


def _differences(frame: pd.DataFrame, caption: str) -> Grid:
    """Return the differences, classes down and metrics across."""
    return pivot(
        frame,
        line="class",
        column="metric",
        cell=_lead,
        before={"objects": _object_count, "paper (FID)": _paper_lead},
        corner="class",
        caption=caption,
    )


def _object_count(row: Mapping[str, Any]) -> Cell:
    return Cell(str(row["objects"]), row["objects"])


def _paper_lead(row: Mapping[str, Any]) -> Cell:
    """Return how much better PC2PIX is than SR by FID, as the paper printed both."""
    return number_cell((row["paper_lead"], NAN, NAN), "{:+.1f}".format)


def _lead(row: Mapping[str, Any]) -> Cell:
    """Return how much better the network is than SR here, marked where the interval decides."""
    lead = row["lead"], row["ci_low"], row["ci_high"]
    mark = MARKS.get(row["verdict"])
    return metric_cell(lead, row["metric"], row["method"], SURFACE, sign="+", special=mark)


_REMARK = (
    "How much better {network} is than {surface}: over 0 if it is, with its interval, paired over "
    "objects; failed images are scored as blank ones. The paper orders by FID, which is not "
    "on the scale of the others. “reproduced” is the paper's ordering, “opposite” the other one, "
    "both with an interval that leaves 0 out; the rest is undecided by so many objects."
)
