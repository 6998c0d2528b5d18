"""The paper's Table 5: distances and scores class by class, and in the mean over classes.

Pure functions of records and features, as `bench.tables.quality`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from bench.analysis.distances import FeatureDistances
from bench.analysis.intervals import clipped, interval_of_means, jackknife_interval
from bench.analysis.recognition import ClassHead
from bench.catalogue.lookup import family_of
from bench.catalogue.metrics import RECOGNITION_METRICS, column, is_mean, value_range
from bench.catalogue.suites import Suite
from bench.records.features import Features
from bench.tables import markdown
from bench.tables.quality import (
    Published,
    Row,
    RowWithSamples,
    all_methods,
    as_published,
    cells,
    image_keys,
    image_rows,
    set_rows,
    which_is_best,
    with_best_reconstruction,
    with_paper_values,
)
from bench.tables.table import NAN, Block, Table, columns_of, ordered

AVERAGE = "average"
SURFACE = "surface-apss"  # the paper's SR
NETWORK = "pc2pix"  # the first variant of it in a run is the paper's PC2PIX
FEW = 10  # objects of a class below which its distances are warned of
IN_A_ROW = 7  # classes side by side, as the paper has them


CLASSES = "table5_classes"


def class_table(
    records: pd.DataFrame,
    features: Mapping[str, FeatureDistances],
    skipped: Mapping[str, str],
    suite: Suite,
    published: Published,
) -> Table[Row]:
    """Table 5 from records (with class confidence, where it is known) and features by extractor.

    `skipped` gives the reason for each metric and extractor that there is nothing of.
    """
    rows: list[Row] = []
    for metric in suite.class_metrics:
        made = _measured(metric, records, features, skipped, suite, published)
        rows += _in_order([*(m.row for m in made), *_averages(metric, made, published)])
    shown = with_best_reconstruction(rows)
    remarks = [remark(records, suite), which_is_best(shown)]
    return table_of_classes(shown, " ".join(filter(None, remarks)))


def table_of_classes(rows: Iterable[Row], remark: str) -> Table[Row]:
    """Table 5 of its rows. Several metrics, each with digits of its own."""

    def layout(rows: Sequence[Row]) -> Iterator[Block]:
        yield remark
        for condition in ordered(row.condition for row in rows):
            if condition != rows[0].condition:
                yield f"# At {markdown.cell(condition)}"
            of_condition = [row for row in rows if row.condition == condition]
            yield from _paper_layout(of_condition)
            yield from all_methods(of_condition)

    title = "Table 5: classes, against pictures of the true meshes"
    return Table(CLASSES, title, columns_of(Row), tuple(rows), layout, remark)


def with_confidence(records: pd.DataFrame, features: Features, head: ClassHead) -> pd.DataFrame:
    """The records with a column of what the classifier gives the true class, NaN of no image."""
    values = np.full(len(records), np.nan)
    places = records.reset_index(drop=True)
    for cell, group in cells(places[places["outcome"] == "ok"]):
        values[group.index] = head.confidence(features.of(*cell, image_keys(group)), cell[2])
    (metric,) = RECOGNITION_METRICS
    return records.assign(**{column(metric): values})


def network_of(methods: Sequence[str]) -> str | None:
    """What stands for the paper's PC2PIX in a run; None where no variant of it was measured."""
    return next((m for m in methods if family_of(m) == NETWORK), None)


def remark(records: pd.DataFrame, suite: Suite) -> str:
    """What one has to know about the classes of a run: how many objects, which are lacking."""
    counts = objects_of(records)
    message = (
        "`fid`, `kid`, `fd-views` and `kd-views` are distances (lower is better), the others "
        "similarities (higher is better). The average is over classes, each counting alike."
    )
    sizes = ", ".join(f"{markdown.cell(name)} {count}" for name, count in counts.items())
    message += f" Objects of each class: {sizes}."
    if lacking := [name for name in suite.classes if name not in counts]:
        message += f" Left out, because the dataset has none: {', '.join(lacking)}."
    if few := [markdown.cell(name) for name, count in counts.items() if count < FEW]:
        message += (
            f" **Fewer than {FEW} objects: {', '.join(few)}.** Distances of so few pictures are "
            "mostly their number: compare them within the class only, if at all."
        )
    return message


def objects_of(records: pd.DataFrame) -> dict[str, int]:
    """How many objects of each class there are."""
    return {str(name): of["object"].nunique() for name, of in records.groupby("class")}


def _measured(
    metric: str,
    records: pd.DataFrame,
    features: Mapping[str, FeatureDistances],
    skipped: Mapping[str, str],
    suite: Suite,
    published: Published,
) -> list[RowWithSamples]:
    if is_mean(metric):
        return image_rows([metric], records, skipped, suite, published)
    return set_rows(metric, records, features, skipped, suite, published)


def _averages(metric: str, made: Sequence[RowWithSamples], published: Published) -> list[Row]:
    """The mean over classes for each method and condition, of the classes that have a value."""
    by_cell: dict[tuple[str, str], list[RowWithSamples]] = {}
    for measured in made:
        by_cell.setdefault((measured.row.method, measured.row.condition), []).append(measured)
    return [_average(metric, of_cell, published) for of_cell in by_cell.values()]


def _average(metric: str, of_cell: Sequence[RowWithSamples], published: Published) -> Row:
    first = of_cell[0].row
    valued = [m for m in of_cell if math.isfinite(m.row.value)]
    lacking = [m.row.class_name for m in of_cell if not math.isfinite(m.row.value)]
    value = float(np.mean([m.row.value for m in valued])) if valued else NAN
    of_classes = [m.per_object for m in valued]
    mean = is_mean(metric)
    interval = interval_of_means(of_classes) if mean else jackknife_interval(value, of_classes)
    low, high = clipped(interval, value_range(metric))
    note = f"without {', '.join(lacking)}" if lacking else ""
    return Row(
        suite=first.suite,
        method=first.method,
        condition=first.condition,
        class_name=AVERAGE,
        metric=metric,
        value=value,
        ci_low=low,
        ci_high=high,
        n_ok=sum(m.row.n_ok for m in of_cell),
        n=sum(m.row.n for m in of_cell),
        paper=as_published(published, AVERAGE, metric, first.condition, first.method),
        failures_as_blank=float(np.mean([m.row.failures_as_blank for m in of_cell])),
        note=note if valued else first.note,
        debiased=float(np.mean([m.row.debiased for m in valued])) if valued else NAN,
    )


def _in_order(rows: Sequence[Row]) -> list[Row]:
    """Class by class, the average last; methods and conditions as they came."""
    classes = ordered(row.class_name for row in rows)
    return [row for name in classes for row in rows if row.class_name == name]


def _paper_layout(rows: Sequence[Row]) -> Iterator[Block]:
    """Of one condition: SR and PC2PIX side by side, classes in rows of seven."""
    network = network_of([row.method for row in rows])
    if network is None or not any(row.method == SURFACE for row in rows):
        return
    yield (
        f"In the paper's layout: SR is `{SURFACE}`, PC2PIX is {markdown.code(network)}. Below a "
        "line of ours stands the paper's, as published: other data (ShapeNet), other weights."
    )
    at = {(row.metric, row.class_name, row.method): row for row in rows}
    names = {SURFACE: "SR", network: "PC2PIX"}
    metrics = ordered(row.metric for row in rows)
    classes = ordered(row.class_name for row in rows)
    for start in range(0, len(classes), IN_A_ROW):
        across = {
            (class_name, method): f"{class_name} {name}"
            for class_name in classes[start : start + IN_A_ROW]
            for method, name in names.items()
        }
        yield with_paper_values("", metrics, across, at)
