"""The paper's tables, as pure functions of records and features.

A table is a list of tidy rows, one per method, condition, class and metric. It is written as CSV,
and as Markdown in the paper's layout with the paper's values beside ours.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analysis import recognition as control
from bench.analysis.distances import MeasuredFeatures
from bench.analysis.intervals import mean_interval, median_interval
from bench.catalogue.methods import FLOOR
from bench.catalogue.metrics import UNDEFINED, column
from bench.catalogue.suites import Suite
from bench.metrics.frechet import interval_of_left_out
from bench.records.features import Features, Picture
from bench.records.record import GROUND_TRUTH
from bench.tables import markdown
from bench.tables.table import (
    HEADER,
    NAN,
    NO_VALUE,
    Row,
    all_methods,
    by_class,
    csv_text,
    paper_layout,
)

Floats = NDArray[np.float64]
# Published values by (class, metric, condition, method).
Published = Mapping[tuple[str, str, str, str], float]


@dataclass(frozen=True)
class Table:
    """A finished table.

    name          of its files, without suffix
    decimals      digits for people
    remark        what people have to know to read it
    paper_layout  whether Markdown begins with the paper's layout
    """

    name: str
    title: str
    rows: tuple[Row, ...]
    decimals: int
    remark: str = ""
    paper_layout: bool = True

    def to_csv(self) -> str:
        """Numbers with 6 decimals; an empty field where there is none."""
        rows = ([_csv_field(value) for value in astuple(row)] for row in self.rows)
        return csv_text(HEADER, rows)

    def to_markdown(self) -> str:
        """The paper's layout (SR beside PC2PIX), then all methods with intervals and counts.

        Several classes at one condition are a row each; else the conditions are columns.
        """
        lines = [f"# {self.title}", ""]
        if self.remark:
            lines += [self.remark, ""]
        classes = {row.class_name for row in self.rows}
        several = len(classes) > 1 and len({row.condition for row in self.rows}) == 1
        if self.paper_layout and not several:
            lines += paper_layout(self.rows, self.decimals)
        lines += (by_class if several else all_methods)(self.rows, lambda metric: self.decimals)
        return "\n".join(lines)


def image_table(
    name: str, title: str, records: pd.DataFrame, suite: Suite, published: Published
) -> Table:
    """Means over pictures of the suite's image metrics, with intervals over objects."""
    made = image_rows(suite.image_metrics, records, suite, published)
    return Table(name, title, tuple(measured.row for measured in made), decimals=3)


def detail_table(name: str, title: str, records: pd.DataFrame, suite: Suite) -> Table:
    """As `image_table`, of the suite's detail metrics, which the paper has not."""
    made = image_rows(suite.detail_metrics, records, suite, {})
    rows = tuple(measured.row for measured in made)
    return Table(name, title, rows, decimals=3, remark=_DETAIL_REMARK, paper_layout=False)


_DETAIL_REMARK = (
    "Means are over the pictures that have a value; where some have none, a line below says why."
)


class Measured(NamedTuple):
    """A row, and what its interval was made from.

    per_object  float64 [G]: of a metric of pictures the mean of each object that has a value, of a
                distance of sets the distance without each block of objects
                (`bench.metrics.frechet`)
    """

    row: Row
    per_object: Floats


def image_rows(
    metrics: Sequence[str], records: pd.DataFrame, suite: Suite, published: Published
) -> list[Measured]:
    """Means over pictures of metrics that the records have, for all cells."""
    made = []
    for cell, group in cells(records):
        ok = group[group["outcome"] == "ok"]
        # The floor's scores do not depend on the condition.
        missing = _floor_of_failed(cell, group, records)
        for metric in metrics:
            name = column(metric)
            valued, floor = ok[["object", name]], missing[name]
            if metric in UNDEFINED:  # of any other metric, no value is an error and shows as such
                valued, floor = valued.dropna(), floor.dropna()
            scores = valued[name].to_numpy()
            per_object = valued.groupby("object", sort=True)[name].mean().to_numpy()
            with_blank = np.concatenate([scores, floor.to_numpy()])
            row = make_row(
                suite,
                cell,
                metric,
                _mean(scores),
                mean_interval(per_object),
                group,
                published,
                _mean(with_blank),
                "",
                undefined=len(ok) - len(valued),
            )
            made.append(Measured(row, per_object))
    return made


def _floor_of_failed(
    cell: tuple[str, str, str], group: pd.DataFrame, records: pd.DataFrame
) -> pd.DataFrame:
    """The floor's records of the pictures that failed in a cell, where it has them."""
    failed = group[group["outcome"] == "failed"]
    if failed.empty:
        return records.iloc[:0]
    floor = records[
        (records["method"] == FLOOR)
        & (records["condition"] == cell[1])
        & (records["outcome"] == "ok")
        & (records["class"] == cell[2])
    ]
    return floor.merge(failed[["object", "view"]], on=["object", "view"])


def control_table(
    name: str,
    title: str,
    records: pd.DataFrame,
    judged: Features | None,
    skipped: str,
    suite: Suite,
) -> Table:
    """What the judge makes of each method's pictures: the view, and which object it is.

    Angles: medians over pictures of the error in degrees, intervals by a bootstrap over objects.
    Retrieval: a share of pictures. `judged` are the judge's answers; where there are none,
    `skipped` says why.
    """
    sizes: dict[str, int] = {}
    among: control.Gallery | None = None
    made = []
    for cell, group in cells(records):
        if judged is None:
            answered = [(NAN, (NAN, NAN), NAN, skipped)] * len(suite.control_metrics)
        else:
            ok = group[group["outcome"] == "ok"]
            missing = _floor_of_failed(cell, group, records)
            if among is None or among.class_name != cell[2]:  # of one class at a time
                among = control.gallery(judged, cell[2])
                sizes[cell[2]] = len(among.objects)
            answers = _answers(cell, ok, judged)
            floor = _answers((FLOOR, *cell[1:]), missing, judged)
            answered = [
                _controlled(metric, ok, answers, missing, floor, among)
                for metric in suite.control_metrics
            ]
        made += [
            make_row(suite, cell, metric, value, interval, group, {}, with_blank, note)
            for metric, (value, interval, with_blank, note) in zip(
                suite.control_metrics, answered, strict=True
            )
        ]
    told = ", ".join(f"{count} of class {markdown.cell(name)}" for name, count in sizes.items())
    remark = (
        "A judge tells view and shape from the picture alone; `true-mesh` shows how far the judge "
        "itself errs. Errors are medians in degrees: by chance 90 (azimuth)."
    )
    if told:
        remark += f" Retrieval is among all objects of the run ({told}): by chance 1 in as many."
    return Table(name, title, tuple(made), decimals=2, remark=remark, paper_layout=False)


def _controlled(
    metric: str,
    ok: pd.DataFrame,
    answers: NDArray[Any],
    missing: pd.DataFrame,
    floor: NDArray[Any],
    among: control.Gallery,
) -> tuple[float, tuple[float, float], float, str]:
    """Value, interval, value with the floor's pictures (`missing`), reason why there is none."""
    note = control.why_no_retrieval(among) if metric == "retrieval" else ""
    if not note and ok.empty:
        note = "no pictures"
    if note:
        return NAN, (NAN, NAN), NAN, note
    values = _per_picture(metric, ok, answers, among)
    with_blank = np.concatenate([values, _per_picture(metric, missing, floor, among)])
    objects = ok["object"].to_numpy()
    if metric == "retrieval":
        per_object = pd.Series(values).groupby(objects, sort=True).mean().to_numpy()
        return _mean(values), mean_interval(per_object), _mean(with_blank), ""
    interval = median_interval(values, objects)
    return float(np.median(values)), interval, float(np.median(with_blank)), ""


def _pictures(records: pd.DataFrame) -> list[Picture]:
    return list(zip(records["object"].tolist(), records["view"].tolist(), strict=True))


def _answers(cell: tuple[str, str, str], records: pd.DataFrame, judged: Features) -> NDArray[Any]:
    """What the judge says of each record's picture, in their order."""
    return np.empty(0) if records.empty else judged.of(*cell, _pictures(records))


def _per_picture(
    metric: str, records: pd.DataFrame, answers: NDArray[Any], among: control.Gallery
) -> NDArray[np.float64]:
    """The error or the hit of each record's picture, in their order."""
    if records.empty:
        return np.empty(0)
    if metric == "azimuth-error-deg":
        return control.azimuth_error_deg(answers, records["azimuth_deg"].to_numpy())
    if metric == "elevation-error-deg":
        return control.elevation_error_deg(answers, records["elevation_deg"].to_numpy())
    return control.found(among, answers, _pictures(records))


def set_table(
    name: str,
    title: str,
    records: pd.DataFrame,
    features: Mapping[str, MeasuredFeatures],
    skipped: Mapping[str, str],
    suite: Suite,
    published: Published,
) -> Table:
    """Fréchet distances between a method's pictures and the ground truth of the same views.

    `skipped` gives the reason for each set metric that has no features.
    """
    made = (
        measured
        for metric in suite.set_metrics
        for measured in set_rows(
            metric, records, features.get(metric), skipped.get(metric, ""), suite, published
        )
    )
    return Table(name, title, tuple(measured.row for measured in made), decimals=1)


def set_rows(
    metric: str,
    records: pd.DataFrame,
    features: MeasuredFeatures | None,
    skipped: str,
    suite: Suite,
    published: Published,
) -> list[Measured]:
    """Fréchet distances of one extractor's features, for all cells; `skipped` says why none."""
    made = []
    for cell, group in cells(records):
        value, left_out, with_blank, note = NAN, np.empty(0), NAN, skipped
        if features is not None:
            value, left_out, with_blank, note = _distances(cell, features)
        interval = interval_of_left_out(value, left_out)
        row = make_row(suite, cell, metric, value, interval, group, published, with_blank, note)
        made.append(Measured(row, left_out))
    return made


def _distances(
    cell: tuple[str, str, str], features: MeasuredFeatures
) -> tuple[float, Floats, float, str]:
    """Value, without each block of objects, with the floor's pictures for failed ones, why none."""
    _, condition, class_name = cell
    drawn = features.pictures(*cell)
    if len(drawn) < 2:
        return NAN, np.empty(0), NAN, "fewer than two pictures"
    value, left_out = features.distance(cell, drawn)
    wanted = set(features.pictures(GROUND_TRUTH, "", class_name)) - set(drawn)
    missing = wanted & set(features.pictures(FLOOR, condition, class_name)) if wanted else wanted
    with_blank = features.distance(cell, sorted([*drawn, *missing])).value if missing else value
    return value, left_out, with_blank, ""


def cells(records: pd.DataFrame) -> Iterator[tuple[tuple[str, str, str], pd.DataFrame]]:
    """The records of each (method, condition, class), in their order, one cell at a time."""
    groups = records.groupby(["method", "condition", "class"], sort=False)
    return (((str(m), str(c), str(k)), group) for (m, c, k), group in groups)  # type: ignore[misc]


def make_row(
    suite: Suite,
    cell: tuple[str, str, str],
    metric: str,
    value: float,
    interval: tuple[float, float],
    records: pd.DataFrame,
    published: Published,
    failures_as_blank: float,
    note: str,
    undefined: int = 0,
) -> Row:
    """A row, with the counts and the reasons that the records give.

    `undefined` is the number of pictures that are there and have no value of this metric.
    """
    method, condition, class_name = cell
    outcomes = records["outcome"].tolist()
    pairs = zip(outcomes, records["reason"].tolist(), strict=True)
    reasons = Counter(reason for outcome, reason in pairs if outcome == "failed")
    told = [f"{count} x {reason}" for reason, count in reasons.most_common()]
    if undefined:
        told.append(f"{undefined} x {NO_VALUE}: {UNDEFINED[metric]}")
    return Row(
        suite=suite.id,
        method=method,
        condition=condition,
        class_name=class_name,
        metric=metric,
        value=value,
        ci_low=interval[0],
        ci_high=interval[1],
        n_ok=outcomes.count("ok") - undefined,
        n=len(outcomes),
        paper=as_published(published, class_name, metric, condition, method),
        failures_as_blank=failures_as_blank,
        note=note or "; ".join(told),
    )


def as_published(
    published: Published, class_name: str, metric: str, condition: str, method: str
) -> float:
    """The paper's value for a cell; NaN where it has none.

    For a network of ours that the paper has not, that of its architecture.
    """
    names = (method, method.partition("@")[0])
    values = (published.get((class_name, metric, condition, name)) for name in names)
    return next((value for value in values if value is not None), NAN)


def _mean(values: NDArray[np.float64]) -> float:
    return float(values.mean()) if len(values) else NAN


def _csv_field(value: object) -> object:
    if not isinstance(value, float):
        return value
    return f"{value:.6f}" if math.isfinite(value) else ""


def with_objectives(table: Table, objectives: Mapping[str, str]) -> Table:
    """The table with each network's row told what its weights were trained with."""
    rows = (replace(row, objective=objectives.get(row.method, "")) for row in table.rows)
    return replace(table, rows=tuple(rows))
