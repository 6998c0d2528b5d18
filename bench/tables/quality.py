"""The paper's tables, as pure functions of records and features.

A table has a tidy row for each method, condition, class and metric. People see it in the paper's
layout with the paper's values beside ours, then all methods with intervals and counts.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analysis.comparison import decimals
from bench.analysis.distances import CellKey, FeatureDistances
from bench.analysis.intervals import (
    clipped,
    debiased,
    distance_interval,
    jackknife_interval,
    mean_interval,
    median_interval,
)
from bench.analysis.recognition import true_gallery
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import FLOOR, role
from bench.catalogue.metrics import (
    KERNEL_METRICS,
    UNDEFINED,
    column,
    extractor_of,
    higher_is_better,
    value_range,
)
from bench.catalogue.reconstruction import BEST_RECONSTRUCTION, best_by_condition
from bench.catalogue.suites import Suite
from bench.judges import answers as control
from bench.metrics.kernel_distance import kernel_distance, left_out_kernel_distances
from bench.records.features import Features, ImageKey
from bench.records.record import GROUND_TRUTH
from bench.tables import markdown
from bench.tables.table import (
    BEST,
    NAN,
    Block,
    Cell,
    ColumnHeader,
    Grid,
    Table,
    TableRow,
    Tags,
    columns_of,
    number,
    ordered,
    pivot,
    shown,
)
from data_prep.arrays import Floats

# Published values by (class, metric, condition, method).
Published = Mapping[tuple[str, str, str, str], float]


NO_VALUE = "no value"
PAPER_METHODS = {"surface-apss": "SR", "pc2pix": "PC2PIX", "pc2pix@acgan": "PC2PIX@acgan"}


@dataclass(frozen=True)
class Row:
    """One cell of a table. A number that does not exist is NaN.

    value              over the images whose outcome is ok
    ci_low, ci_high    95 % interval over objects
    n_ok, n            images that are there and have a value, images there should be
    paper              as published, on the paper's data
    failures_as_blank  the value with a blank image in place of each failed one
    note               why there is no value, or the reasons of the failures and how many images
                       have no value though they are there; of the best reconstruction first the
                       method that it is
    debiased           of a Fréchet distance, `bench.analysis.intervals.debiased`
    objective          what the weights of a network were trained with; empty for other methods
    """

    suite: str
    method: str
    condition: str
    class_name: str
    metric: str
    value: float
    ci_low: float
    ci_high: float
    n_ok: int
    n: int
    paper: float
    failures_as_blank: float
    note: str
    debiased: float = NAN
    objective: str = ""

    @property
    def skipped(self) -> bool:
        """Whether the metric was not measured."""
        return self.note.startswith("skipped")

    @property
    def only_undefined(self) -> bool:
        """Whether the note is about images that are there and have no value, and no others."""
        if self.n_ok == self.n:
            return bool(self.note) and self.method != BEST_RECONSTRUCTION
        return f" x {NO_VALUE}: " in self.note and "; " not in self.note

    @property
    def failed(self) -> bool:
        """Whether images are missing."""
        return self.n_ok < self.n and not self.only_undefined


def quality_table(
    name: str,
    title: str,
    rows: Iterable[Row],
    remark: str = "",
    paper_layout: bool = True,
) -> Table[Row]:
    """A table of rows; `paper_layout` says whether Markdown begins with it.

    Several classes at one condition are never in the paper's layout: they are a line each.
    """

    def layout(rows: Sequence[Row]) -> Iterator[Block]:
        yield remark
        one_condition = len({row.condition for row in rows}) == 1
        if paper_layout and not (one_condition and len({row.class_name for row in rows}) > 1):
            yield from _paper_layout(rows)
        yield from all_methods(rows)

    rows = with_best_reconstruction(rows)
    remark = " ".join(filter(None, [remark, which_is_best(rows)]))
    return Table(name, title, columns_of(Row), rows, layout, remark)


def with_best_reconstruction(rows: Iterable[Row]) -> tuple[Row, ...]:
    """The rows, and each that is the best reconstruction at its condition a second time, by that
    name."""
    rows = tuple(rows)
    best = best_by_condition({row.condition for row in rows}, {row.method for row in rows})
    made = []
    for row in rows:
        made.append(row)
        if row.method == best.get(row.condition):
            note = row.note if row.skipped else "; ".join(filter(None, [row.method, row.note]))
            made.append(replace(row, method=BEST_RECONSTRUCTION, note=note, paper=NAN))
    return tuple(made)


def which_is_best(rows: Iterable[Row]) -> str:
    """What the best reconstruction is at each condition; nothing where there is none."""
    conditions: dict[str, list[str]] = {}
    for row in rows:
        if row.method == BEST_RECONSTRUCTION and not row.skipped:
            at = conditions.setdefault(row.note.partition("; ")[0], [])
            at += [row.condition] if row.condition not in at else []
    parts = [f"`{method}` at {', '.join(at)}" for method, at in conditions.items()]
    if not parts:
        return ""
    return f"`{BEST_RECONSTRUCTION}`, chosen on validation chairs, is {'; '.join(parts)}."


def _paper_layout(rows: Sequence[Row]) -> Iterator[Block]:
    """SR beside PC2PIX at each condition, the paper's values below ours; nothing without either."""
    rows = [row for row in rows if row.method in PAPER_METHODS]
    if not rows:
        return
    yield (
        "In the paper's layout: SR is `surface-apss`. Below a line of ours stands the paper's, as "
        "published: other data (ShapeNet), other weights."
    )
    there = {row.method for row in rows}
    methods = [method for method in PAPER_METHODS if method in there or "@" not in method]
    across = {
        (condition, method): f"{condition} {PAPER_METHODS[method]}"
        for condition in ordered(row.condition for row in rows)
        for method in methods
    }
    metrics = ordered(row.metric for row in rows)
    for class_name in ordered(row.class_name for row in rows):
        of_class = [row for row in rows if row.class_name == class_name]
        at = {(row.metric, row.condition, row.method): row for row in of_class}
        yield with_paper_values(class_name, metrics, across, at)


def with_paper_values(
    corner: str,
    metrics: Iterable[str],
    across: Mapping[tuple[str, str], str],
    at: Mapping[tuple[str, str, str], Row],
) -> Grid:
    """A line of ours for each metric, and below it the paper's where it has any.

    across  heads of the columns by their places
    at      rows by metric and place
    """
    made = []
    for metric in metrics:
        rows = [at.get((metric, *place)) for place in across]
        texts = [shown(row.value, decimals(metric)) if row else "-" for row in rows]
        if all(row.skipped for row in rows if row):
            texts = ["skipped"] * len(rows)
        made.append(TableRow(metric, tuple(map(Cell, texts))))
        paper = [row.paper if row else NAN for row in rows]
        if any(map(math.isfinite, paper)):
            texts = [f"{value:g}" if math.isfinite(value) else "-" for value in paper]
            made.append(TableRow(f"{metric}, paper", tuple(map(Cell, texts))))
    return Grid(corner, tuple(map(ColumnHeader, across.values())), tuple(made))


def all_methods(rows: Sequence[Row]) -> Iterator[Block]:
    """What all cells hold, with a grid for each metric: of one class methods down and conditions
    across, of several classes these down and methods across, condition by condition."""
    yield (
        "All methods: value [95 % interval over objects] n_ok/n pictures. Where pictures are "
        "missing, *b* is the value with a blank picture in place of each."
    )
    trained = {row.method: row.objective for row in rows if row.objective}
    yield "\n".join(
        f"{markdown.code(method)}: weights trained with {markdown.code(objective)}.  "
        for method, objective in trained.items()
    )
    by_class = len({row.class_name for row in rows}) > 1
    places = ordered(row.condition if by_class else row.class_name for row in rows)
    for place in places:
        for metric in ordered(row.metric for row in rows):
            chosen = [
                row
                for row in rows
                if row.metric == metric and place == (row.condition if by_class else row.class_name)
            ]
            if not chosen:
                continue
            where = "" if by_class and len(places) == 1 else f", {place}"
            yield f"## {markdown.cell(metric + where)}"
            yield _grid(chosen, by_class)
            if any(math.isfinite(row.debiased) for row in chosen):
                yield f"## {markdown.cell(f'{metric}, debiased{where}')}"
                yield _DEBIASED
                yield _grid(list(map(_without_bias, chosen)), by_class, ", debiased")


_DEBIASED = (
    "What the distance would be with endless objects, extrapolated by the jackknife: for comparing "
    "runs of different numbers of objects."
)


def _without_bias(row: Row) -> Row:
    nothing = dict.fromkeys(("ci_low", "ci_high", "paper", "failures_as_blank"), NAN)
    return replace(row, value=row.debiased, **nothing)


def _grid(rows: Sequence[Row], by_class: bool, how: str = "") -> Grid:
    """Of one metric, and of one condition or else of one class; `how` follows the metric's name."""
    metric, higher = rows[0].metric, higher_is_better(rows[0].metric)
    skipped = ordered(row.note for row in rows if row.skipped)
    place = rows[0].condition if by_class else rows[0].class_name
    where, line, column = place, "method", "condition"
    if by_class:
        where, line, column = f"at {place}", "class_name", "method"
    return pivot(
        rows,
        line,
        column,
        partial(_cell, best=_best(rows)),
        corner="class" if by_class else "method",
        about=(lambda of_line: "") if by_class else _about,
        outcomes=_outcomes,
        caption=f"{metric}{how}, {where} ({'higher' if higher else 'lower'} is better)",
        notes=tuple(skipped or _gaps(rows, "class_name" if by_class else "condition")),
        void=bool(skipped),
        higher=higher,
        tags=Tags(condition=place) if by_class else Tags(class_name=place),
    )


def _gaps(rows: Sequence[Row], across: str) -> list[str]:
    """A line for each cell with failures; of cells that only have no value, those alike share."""
    notes: list[str] = []
    alike: dict[str, list[str]] = {}
    for row in rows:
        if row.method == BEST_RECONSTRUCTION:
            continue  # as the method that it is
        if row.only_undefined:
            alike.setdefault(row.note, []).append(row.method)
        elif row.n_ok < row.n:
            notes.append(f"{row.method} at {getattr(row, across)}: {row.note}")
    return notes + [f"{', '.join(ordered(methods))}: {note}" for note, methods in alike.items()]


def _best(rows: Sequence[Row]) -> dict[tuple[str, str], float]:
    """By class and condition the best value as printed, of those that compete; NaN of fewer than
    two."""
    rivals: dict[tuple[str, str], list[float]] = {}
    for row in rows:
        values = rivals.setdefault((row.class_name, row.condition), [])
        if math.isfinite(row.value) and not role(row.method):
            values.append(round(row.value, decimals(row.metric)))
    best = max if higher_is_better(rows[0].metric) else min
    return {place: best(values) if len(values) > 1 else NAN for place, values in rivals.items()}


def _cell(row: Row, best: Mapping[tuple[str, str], float]) -> Cell:
    show = partial(shown, decimals=decimals(row.metric))
    leads = round(row.value, decimals(row.metric)) == best[row.class_name, row.condition]
    beside = {
        "count": (row.n_ok, row.n),
        "blank": show(row.failures_as_blank) if row.failed else None,
        "paper": f"{row.paper:g}" if math.isfinite(row.paper) else "",
        "special": BEST if leads and not role(row.method) else None,
    }
    if row.skipped:
        return Cell("skipped", paper=beside["paper"])
    estimate = row.value, row.ci_low, row.ci_high
    return number(estimate, show, **beside)


def _about(rows: Sequence[Row]) -> str:
    parts = [role(rows[0].method), rows[0].objective and f"trained with {rows[0].objective}"]
    return ", ".join(part for part in parts if part)


def _outcomes(rows: Sequence[Row]) -> tuple[str, ...]:
    """What became of the images of these rows, in the words of the records."""
    found = set()
    for row in rows:
        if row.skipped:
            found.add("skipped")
            continue
        if row.n_ok > 0:
            found.add("ok")
        if row.failed:
            found.add("failed")
    return tuple(sorted(found))


def image_table(
    name: str,
    title: str,
    records: pd.DataFrame,
    skipped: Mapping[str, str],
    suite: Suite,
    published: Published,
) -> Table[Row]:
    """Means over images of the suite's image metrics, with intervals over objects."""
    made = image_rows(suite.image_metrics, records, skipped, suite, published)
    rows = [measured.row for measured in made]
    return quality_table(name, title, rows, paper_layout=_as_paper(suite))


def _as_paper(suite: Suite) -> bool:
    """Whether a suite is laid out as the paper's tables; those of our own are not."""
    return suite.painted and not suite.frontier and not suite.crossings


def detail_table(
    name: str, title: str, records: pd.DataFrame, skipped: Mapping[str, str], suite: Suite
) -> Table[Row]:
    """As `image_table`, of the suite's detail metrics, which the paper has not."""
    remark = (
        "Means are over the pictures that have a value; where some have none, a line below says "
        "why."
    )
    rows = [made.row for made in image_rows(suite.detail_metrics, records, skipped, suite, {})]
    return quality_table(name, title, rows, remark, paper_layout=False)


class RowWithSamples(NamedTuple):
    """A row, and what its interval was made from.

    per_object  float64 [G]: of a metric of images the mean of each object that has a value, of a
                distance of sets the distance without each block of objects
                (`bench.metrics.frechet`)
    """

    row: Row
    per_object: Floats


def image_rows(
    metrics: Sequence[str],
    records: pd.DataFrame,
    skipped: Mapping[str, str],
    suite: Suite,
    published: Published,
) -> list[RowWithSamples]:
    """Means over images of metrics that the records have, for all cells.

    `skipped` says of a metric why no image has a value.
    """
    made = []
    names = [column(metric) for metric in metrics if metric not in skipped]
    for cell, group in cells(records):
        ok = group[group["outcome"] == "ok"]
        means = ok.groupby("object", sort=True)[names].mean()
        # The floor's scores do not depend on the condition.
        missing = _floor_of_failed(cell, group, records)
        for metric in metrics:
            if metric in skipped:
                row = make_row(
                    suite, cell, metric, NAN, (NAN, NAN), group, published, NAN, skipped[metric]
                )
                made.append(RowWithSamples(row, np.empty(0)))
                continue
            name = column(metric)
            scores, floor = ok[name].to_numpy(), missing[name].to_numpy()
            per_object = means[name].to_numpy()
            if metric in UNDEFINED:  # of any other metric, no value is an error and shows as such
                scores, floor = scores[~np.isnan(scores)], floor[~np.isnan(floor)]
                per_object = per_object[~np.isnan(per_object)]
            with_blank = np.concatenate([scores, floor])
            row = make_row(
                suite,
                cell,
                metric,
                _mean(scores),
                clipped(mean_interval(per_object), value_range(metric)),
                group,
                published,
                _mean(with_blank),
                "",
                undefined=len(ok) - len(scores),
            )
            made.append(RowWithSamples(row, per_object))
    return made


def _floor_of_failed(
    cell: tuple[str, str, str], group: pd.DataFrame, records: pd.DataFrame
) -> pd.DataFrame:
    """The floor's records of the images that failed in a cell, where it has them."""
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


def recognition_table(
    records: pd.DataFrame, judged: Features | None, skipped: str, suite: Suite
) -> Table[Row]:
    """What the judge makes of each method's images: the view, and which object it is.

    Angles: medians over images of the error in degrees, intervals by a bootstrap over objects.
    Retrieval: a share of images. `judged` are the judge's answers; where there are none,
    `skipped` says why.
    """
    sizes: dict[str, int] = {}
    among: control.Gallery | None = None
    made = []
    for cell, group in cells(records):
        ok = group[group["outcome"] == "ok"]
        missing = _floor_of_failed(cell, group, records)
        answers, floor = np.empty(0), np.empty(0)
        if judged is not None:
            if among is None or among.class_name != cell[2]:  # of one class at a time
                among = true_gallery(judged, cell[2])
                sizes[cell[2]] = len(among.objects)
            answers = _answers(cell, ok, judged)
            floor = _answers((FLOOR, *cell[1:]), missing, judged)
        for metric in suite.control_metrics:
            note, value, interval, with_blank = skipped, NAN, (NAN, NAN), NAN
            if among is not None:
                why = control.why_no_retrieval(among) if metric == "retrieval" else ""
                note = why or ("no pictures" if ok.empty else "")
            if among is not None and not note:
                values = _per_image(metric, ok, answers, among)
                of_floor = _per_image(metric, missing, floor, among)
                value, interval, with_blank = _judged(metric, values, of_floor, ok)
            row = make_row(suite, cell, metric, value, interval, group, {}, with_blank, note)
            made.append(row)
    message = ", ".join(f"{count} of class {markdown.cell(name)}" for name, count in sizes.items())
    remark = (
        "A judge tells view and shape from the picture alone; `true-mesh` shows how far the judge "
        "itself errs. Errors are medians in degrees: by chance 90 (azimuth)."
    )
    if message:
        remark += f" Retrieval is among all objects of the run ({message}): by chance 1 in as many."
    title = "Control: does the picture show the view and the object it should?"
    return quality_table("table_control", title, made, remark, paper_layout=False)


def _judged(
    metric: str, values: Floats, floor: Floats, records: pd.DataFrame
) -> tuple[float, tuple[float, float], float]:
    """Value of the records' images, its interval, and the value with the floor's images."""
    objects = records["object"].to_numpy()
    with_blank = np.concatenate([values, floor])
    if metric == "retrieval":
        per_object = pd.Series(values).groupby(objects, sort=True).mean().to_numpy()
        interval = clipped(mean_interval(per_object), value_range(metric))
        return _mean(values), interval, _mean(with_blank)
    interval = median_interval(values, objects)
    return float(np.median(values)), interval, float(np.median(with_blank))


def image_keys(records: pd.DataFrame) -> list[ImageKey]:
    """Object and view of each record."""
    return list(zip(records["object"].tolist(), records["view"].tolist(), strict=True))


def _answers(cell: CellKey, records: pd.DataFrame, judged: Features) -> NDArray[Any]:
    """What the judge says of each record's image, in their order."""
    return np.empty(0) if records.empty else judged.of(*cell, image_keys(records))


def _per_image(
    metric: str, records: pd.DataFrame, answers: NDArray[Any], among: control.Gallery
) -> Floats:
    """The error or the hit of each record's image, in their order."""
    if records.empty:
        return np.empty(0)
    if metric == "azimuth-error-deg":
        return control.azimuth_error_deg(answers, records["azimuth_deg"].to_numpy())
    if metric == "elevation-error-deg":
        return control.elevation_error_deg(answers, records["elevation_deg"].to_numpy())
    return control.found(among, answers, image_keys(records))


def set_table(
    name: str,
    title: str,
    records: pd.DataFrame,
    features: Mapping[str, FeatureDistances],
    skipped: Mapping[str, str],
    suite: Suite,
    published: Published,
) -> Table[Row]:
    """Distances between a method's images and the ground truth of the same views.

    `skipped` gives the reason for each extractor that has no features.
    """
    rows = [
        measured.row
        for metric in suite.set_metrics
        for measured in set_rows(metric, records, features, skipped, suite, published)
    ]
    return quality_table(name, title, rows, paper_layout=_as_paper(suite))


class SetDistance(NamedTuple):
    """A distance between images of a cell and the true ones of the same views.

    between   features, cell and images: the distance, and those without each block of objects
    interval  95 %, from these two
    debiased  as it would be with endless objects, from the same; NaN where that is the value
    """

    between: Callable[[FeatureDistances, CellKey, Sequence[ImageKey]], tuple[float, Floats]]
    interval: Callable[[float, Floats], tuple[float, float]]
    debiased: Callable[[float, Floats], float]


def _kernel(
    features: FeatureDistances, cell: CellKey, shown: Sequence[ImageKey]
) -> tuple[float, Floats]:
    x, y = features.filled(cell, shown), features.of(GROUND_TRUTH, "", cell[2], shown)
    objects = np.array([obj for obj, _ in shown])
    return kernel_distance(x, y), left_out_kernel_distances(x, y, objects, objects)


def _kernel_interval(value: float, leave_one_out: Floats) -> tuple[float, float]:
    return jackknife_interval(value, [leave_one_out])


FRECHET = SetDistance(FeatureDistances.distance, distance_interval, debiased)
KERNEL = SetDistance(_kernel, _kernel_interval, lambda value, leave_one_out: NAN)


def set_rows(
    metric: str,
    records: pd.DataFrame,
    features: Mapping[str, FeatureDistances],
    skipped: Mapping[str, str],
    suite: Suite,
    published: Published,
) -> list[RowWithSamples]:
    """Distances by one set metric, for all cells.

    `skipped` says of an extractor why there are no features.
    """
    distance = KERNEL if metric in KERNEL_METRICS else FRECHET
    extractor = extractor_of(metric)
    found, reason = features.get(extractor), skipped.get(extractor, "")
    return distance_rows(metric, distance, records, found, reason, suite, published)


def distance_rows(
    metric: str,
    distance: SetDistance,
    records: pd.DataFrame,
    found: FeatureDistances | None,
    reason: str,
    suite: Suite,
    published: Published,
) -> list[RowWithSamples]:
    """A distance by features, for all cells; `reason` says why there are none."""
    made = []
    for cell, group in cells(records):
        value, leave_one_out, with_blank, note = NAN, np.empty(0), NAN, reason
        if found is not None:
            value, leave_one_out, with_blank, note = _distances(cell, found, distance)
        interval = distance.interval(value, leave_one_out)
        row = make_row(suite, cell, metric, value, interval, group, published, with_blank, note)
        row = replace(row, debiased=distance.debiased(value, leave_one_out))
        made.append(RowWithSamples(row, leave_one_out))
    return made


def _distances(
    cell: tuple[str, str, str], features: FeatureDistances, distance: SetDistance
) -> tuple[float, Floats, float, str]:
    """Value, without each block of objects, with the floor's images for failed ones, why none."""
    _, condition, class_name = cell
    drawn = features.images(*cell)
    if len(drawn) < 2:
        return NAN, np.empty(0), NAN, "fewer than two pictures"
    value, leave_one_out = distance.between(features, cell, drawn)
    wanted = set(features.images(GROUND_TRUTH, "", class_name)) - set(drawn)
    missing = wanted & set(features.images(FLOOR, condition, class_name)) if wanted else wanted
    with_blank = value
    if missing:
        with_blank, _ = distance.between(features, cell, sorted([*drawn, *missing]))
    return value, leave_one_out, with_blank, ""


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

    `undefined` is the number of images that are there and have no value of this metric.
    """
    method, condition, class_name = cell
    outcomes = records["outcome"].tolist()
    pairs = zip(outcomes, records["reason"].tolist(), strict=True)
    reasons = Counter(reason for outcome, reason in pairs if outcome == "failed")
    message = [f"{count} x {reason}" for reason, count in reasons.most_common()]
    if undefined:
        message.append(f"{undefined} x {NO_VALUE}: {UNDEFINED[metric]}")
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
        note=note or "; ".join(message),
    )


def as_published(
    published: Published, class_name: str, metric: str, condition: str, method: str
) -> float:
    """The paper's value for a cell; NaN where it has none.

    For a network of ours that the paper has not, that of its architecture.
    """
    names = (method, family_of(method))
    values = (published.get((class_name, metric, condition, name)) for name in names)
    return next((value for value in values if value is not None), NAN)


def _mean(values: NDArray[np.float64]) -> float:
    return float(values.mean()) if len(values) else NAN


def with_objectives(table: Table[Row], objectives: Mapping[str, str]) -> Table[Row]:
    """The table with what the weights of each network were trained with."""
    rows = (replace(row, objective=objectives.get(row.method, "")) for row in table.rows)
    return replace(table, rows=tuple(rows))
