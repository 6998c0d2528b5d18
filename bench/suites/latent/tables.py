"""The tables of the suite `latent`: values of paths and sums, and their means."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from bench.analysis.intervals import mean_interval
from bench.suites.latent.chairs import ALL
from bench.tables import markdown
from bench.tables.grid import Block, Cell, number, ordered, pivot
from bench.tables.table import Table

VALUES = ["method", "what", "kind", "item", "metric", "value"]
GROUP = ["method", "what", "kind", "metric"]


def latent_table(
    name: str,
    title: str,
    remark: str,
    about: Mapping[str, str],
    subjects: Mapping[str, str],
    rows: pd.DataFrame,
) -> Table[Any]:
    """Return a table of means with the text that readers need.

    about     text on each metric, by its id, in the order of the table
    subjects  text on each `what`, by its id, in the order of the table
    rows      of `means`
    """

    def cell(row: Any) -> Cell:
        n_ok, n = row["n_ok"], row["n"]
        if not n_ok:
            return Cell(f"- 0/{n}")
        count = f" {n_ok}/{n}" if n_ok < n else ""
        estimate = row["value"], row["ci_low"], row["ci_high"]
        return number(estimate, "{:.3g}".format, rest=count)

    def layout(_: pd.DataFrame) -> Iterator[Block]:
        yield remark
        yield "\n".join(f"* **{subject}**: {message}" for subject, message in subjects.items())
        for method in ordered(rows["method"]):
            for kind, chosen in rows[rows["method"] == method].groupby("kind", sort=False):
                subject = markdown.cell(method if kind == ALL else f"{method}, {kind} only")
                yield f"## {subject} (n = {chosen['n'].max()})"
                shown = {*chosen["what"]}
                across = [subject for subject in subjects if subject in shown]
                axes: dict[str, Any] = {"lines": about, "columns": across, "missing": Cell("")}
                yield pivot(chosen, "metric", "what", cell, **axes)
        yield "\n".join(f"* {metric}: {message}" for metric, message in about.items())

    return Table(name, title, rows, layout, digits=".6g")


def means(suite: str, values: pd.DataFrame) -> pd.DataFrame:
    """Return means with 95 % intervals over pairs or triples; `n_ok` of `n` have a value.

    A row for each method, subject, kind and metric, in the order of first values; values of several
    kinds are also averaged over all of them, in the first rows.

    values  method; `what`, the path or the code that is compared with the right answer; `kind`, the
            change of a triple or ALL; `item`, the pair or triple; metric; value, NaN where it is
            undefined, as for a path without any move
    """
    both = pd.concat([values.assign(kind=ALL), values[values["kind"] != ALL]])
    rows = []
    for key, group in both.groupby(GROUP, sort=False)["value"]:
        finite = group.dropna().to_numpy()
        mean = float(finite.mean()) if len(finite) else np.nan
        rows.append((suite, *key, mean, *mean_interval(finite), len(finite), len(group)))
    return pd.DataFrame(rows, columns=["suite", *GROUP, "value", "ci_low", "ci_high", "n_ok", "n"])
