"""Tables of quality: a tidy row for each method, condition, class and metric.

People see them in the paper's layout with the paper's values beside ours, where a suite says so,
then all methods with intervals and counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.compare import NAN, is_better
from bench.analysis.digits import decimals
from bench.analysis.intervals import may_miss
from bench.analysis.paper import (
    AVERAGE,
    PAPER_METHODS,
    SURFACE,
    Published,
    network_of,
    published_value,
)
from bench.analysis.run import Run
from bench.analysis.values import (
    HIDDEN,
    class_rows,
    image_rows,
    recognition_rows,
    set_rows,
    with_averages,
)
from bench.catalogue.chosen import CHOSEN
from bench.catalogue.methods import role, training_objects
from bench.catalogue.metrics import JUDGE, higher_is_better, is_mean
from bench.catalogue.suites import TableKind, TableSpec
from bench.records.folder import PROTOCOL
from bench.records.frames import read_scores, scored_metrics
from bench.records.job import GROUND_TRUTH
from bench.tables import markdown
from bench.tables.grid import (
    BEST,
    DASH,
    Block,
    Cell,
    Grid,
    TableRow,
    metric_cell,
    number_text,
    ordered,
    pivot,
    role_in_words,
    row_mappings,
    unsure,
)
from bench.tables.table import Table, of_protocol
from data_prep.failures import BadInput
from data_prep.progress import log

HEADLINE_TABLE = "headline"  # name of the table
# Objects from which on the headline shows intervals: those of fewer objects are so wide and so
# uncertain that they mislead there.
_FEWEST_SHOWN = 12
FEW = 10  # a class of fewer objects is named in a warning, as its distances depend on their number
_IN_A_ROW = 7  # classes side by side, as in the paper's Table 5
_DETAIL_REMARK = (
    "Where some images have no value, a line below says why; an object without any has no part in "
    "the mean."
)
_DEBIASED = (
    "What the distance would be with endless objects, extrapolated by the jackknife: for comparing "
    "runs of different numbers of objects."
)
_LEGEND = (
    "All methods: value [95 % interval over objects] n_ok/n images. Where images are missing, *b* "
    "is the value with a blank image in place of each."
)
_HEADLINE_LEGEND = (
    "All methods: value [95 % interval over objects], failed images scored as blank ones; n_ok/n "
    "images."
)
_PUBLISHED = (
    "Below a line of ours stands the paper's, as published: other data (ShapeNet), other weights."
)


def image_table(run: Run, spec: TableSpec, published: Published) -> Table:
    """Return the means over objects of the suite's image metrics."""
    rows = image_rows(run, run.suite.image_metrics)
    return quality_table(spec, annotated(rows, run.manifest, published))


def detail_table(run: Run, spec: TableSpec, published: Published) -> Table:
    """Return the means over objects of the suite's detail metrics, which the paper lacks."""
    rows = image_rows(run, run.suite.detail_metrics)
    return quality_table(spec, annotated(rows, run.manifest, {}), _DETAIL_REMARK)


def set_table(run: Run, spec: TableSpec, published: Published) -> Table:
    """Return the distances of methods' images to the true ones by the suite's set metrics."""
    of_metrics = [set_rows(run, metric) for metric in run.suite.set_metrics]
    rows = pd.concat(of_metrics or [image_rows(run, [])], ignore_index=True)
    return quality_table(spec, annotated(rows, run.manifest, published))


def recognition_table(run: Run, spec: TableSpec, published: Published) -> Table:
    """Return what the judge recognises in methods' images: the view, and which object it is."""
    remark = (
        "A judge tells view and shape from the image alone; `true-mesh` shows how far the judge "
        "itself errs. Errors are medians in degrees: by chance 90 (azimuth)."
    )
    if answers := run.features.get(JUDGE):
        sizes = []
        for class_name in run.objects_of:
            objects = {obj for obj, _ in answers.images(GROUND_TRUTH, "", class_name)}
            sizes.append(f"{len(objects)} of class {markdown.cell(class_name)}")
        remark += (
            f" Retrieval is among all objects of the run ({', '.join(sizes)}): by chance 1 in as "
            "many."
        )
    return quality_table(spec, annotated(recognition_rows(run), run.manifest, {}), remark)


def class_table(run: Run, spec: TableSpec, published: Published) -> Table:
    """Return the paper's Table 5: values by class, and their means over classes."""
    rows = annotated(class_rows(run, run.suite.class_metrics), run.manifest, published)
    return quality_table(spec, rows, class_remark(run))


def class_remark(run: Run) -> str:
    """Return the number of objects of each class, and which classes have few or none."""
    counts = run.objects_of
    message = (
        "`fid`, `kid`, `fd-views` and `kd-views` are distances (lower is better), the others "
        "similarities (higher is better). The average is over classes, each counting alike."
    )
    sizes = ", ".join(f"{markdown.cell(name)} {count}" for name, count in counts.items())
    message += f" Objects of each class: {sizes}."
    if missing := [name for name in run.suite.classes if name not in counts]:
        message += f" Left out, because the dataset has none: {', '.join(missing)}."
    if few := [markdown.cell(name) for name, count in counts.items() if count < FEW]:
        message += (
            f" **Fewer than {FEW} objects: {', '.join(few)}.** Distances of so few images are "
            "mostly their number: compare them within the class only, if at all."
        )
    return message


QUALITY_TABLES: Mapping[TableKind, Callable[[Run, TableSpec, Published], Table]] = {
    "images": image_table,
    "sets": set_table,
    "classes": class_table,
    "detail": detail_table,
    "recognition": recognition_table,
}


def headline(run: Run, metrics: Sequence[str] | None = None) -> Table:
    """Return the table of few metrics and all methods that a run shows at its end and before.

    metrics  those that a run has while it goes on; by default all of the headline

    With one class methods are down and conditions across; with several it is the mean over classes.
    Failed images are scored as blank ones, so that all methods have values of the same objects.
    Where the run has fewer than _FEWEST_SHOWN objects only the CSV has intervals.
    """
    suite, manifest = run.suite, run.manifest
    wanted = ordered(suite.headline if metrics is None else metrics)
    with threadpool_limits(1):
        of_images = [metric for metric in wanted if is_mean(metric)]
        means = image_rows(run, of_images, blanks=True)
        distances = [set_rows(run, metric) for metric in wanted if not is_mean(metric)]
        rows = pd.concat([means, *distances], ignore_index=True)
        if suite.table("classes"):
            of_metrics = (rows[rows["metric"] == metric] for metric in wanted)
            rows = pd.concat(map(with_averages, of_metrics), ignore_index=True)
            rows = rows[rows["class"] == AVERAGE]
    objects = len(manifest["objects"])
    planned = manifest.get("planned", objects)

    def layout(frame: pd.DataFrame) -> Iterator[Block]:
        if objects < _FEWEST_SHOWN:
            yield f"Intervals are shown from {_FEWEST_SHOWN} objects on."
            frame = frame.assign(ci_low=NAN, ci_high=NAN)
        elif objects < planned:
            yield (
                "Intervals hold for a number of objects that was fixed beforehand, not for a run "
                "that is ended when its values please."
            )
        # Values here are with blank images already: no second one stands beside them.
        yield from all_methods(frame.assign(failures_as_blank=NAN), _HEADLINE_LEGEND)

    title = f"{' and '.join(suite.headline)}: {objects} of {planned} objects"
    every = in_headline_order(_with_chosen_rows(annotated(rows, manifest, {})))
    table = Table(HEADLINE_TABLE, title, every, layout, hidden=HIDDEN)
    return of_protocol(table, suite, manifest[PROTOCOL])


def in_headline_order(rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows, the best method by the first metric as printed first, references last."""
    if rows.empty:
        return rows
    metrics = ordered(rows["metric"])
    first = rows[rows["metric"] == metrics[0]]
    digits = [decimals(metrics[0], images_of) for images_of in first["images_of"]]
    printed = pd.Series(list(map(round, first["value"], digits)), first["method"])
    means = printed.groupby(level=0).mean() * (-1 if higher_is_better(metrics[0]) else 1)
    is_reference = [role(method) in ("ceiling", "floor") for method in rows["method"]]
    keys = [rows["method"].map(means), is_reference, rows["metric"].map(metrics.index)]
    return rows.iloc[np.lexsort(np.array(keys, np.float64))]  # the last key counts most


def metric_table(run: Run, metric: Any, rows: pd.DataFrame) -> Table:
    """Return the table of a metric of `bench score`, which has an id, a version and an `about`."""
    better = "higher" if higher_is_better(metric.id) else "lower"
    title = f"{metric.id}, version {metric.version}: {metric.about} ({better} is better)"
    spec = TableSpec("images", metric_table_name(metric.id), title)
    return of_protocol(quality_table(spec, rows), run.suite, run.manifest[PROTOCOL])


def metric_table_name(metric_id: str) -> str:
    """Return the name of the table of a metric of `bench score`."""
    return f"metric_{metric_id}"


def further_tables(run: Run) -> list[Table]:
    """Return the tables of all metrics of images that `bench score` has kept of a run.

    Scores of images that have changed since are left out, and a line on stderr names them.
    """
    tables = []
    for metric_id in scored_metrics(run.directory):
        try:
            metric, images = read_scores(run.directory, metric_id)
        except BadInput as error:
            log(str(error))
            continue
        rows = image_rows(run.with_scores(metric, images), [metric_id])
        tables.append(metric_table(run, metric, rows))
    return tables


def annotated(
    rows: pd.DataFrame, manifest: Mapping[str, Any], published: Published
) -> pd.DataFrame:
    """Return the rows with the paper's values, and with what networks were trained on."""
    objectives: Mapping[str, str] = manifest.get("objectives", {})
    methods = rows["method"].tolist()
    keys = zip(rows["class"], rows["metric"], rows["condition"], methods, strict=True)
    return rows.assign(
        paper=[published_value(published, *key) for key in keys],
        trained_on=[training_objects(method, manifest) for method in methods],
        objective=[objectives.get(method, "") for method in methods],
    )


def quality_table(spec: TableSpec, rows: pd.DataFrame, remark: str = "") -> Table:
    """Return the table of a frame of values.

    spec    name, title and kind of the table
    rows    as the functions of `bench.analysis.values` return them
    remark  what a reader has to know to read it

    Several classes at one condition are a line each. In the paper's layout they are shown in its
    Table 5 only.
    """

    def layout(frame: pd.DataFrame) -> Iterator[Block]:
        yield remarks_on(frame)  # which may have some of the methods alone
        if spec.kind != "classes":
            several = frame["condition"].nunique() > 1 or frame["class"].nunique() == 1
            if spec.paper_layout and several:
                yield from _conditions_of_the_paper(frame)
            yield from all_methods(frame)
            return
        for number, (condition, part) in enumerate(frame.groupby("condition", sort=False)):
            if number:
                yield f"# At {markdown.cell(str(condition))}"
            yield from _classes_of_the_paper(part)
            yield from all_methods(part)

    def remarks_on(frame: pd.DataFrame) -> str:
        return " ".join(filter(None, [remark, _which_are_chosen(frame)]))

    frame = _with_chosen_rows(rows)
    return Table(spec.name, spec.title, frame, layout, remarks_on(frame), hidden=HIDDEN)


def _with_chosen_rows(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows, those of chosen methods again as rows like `best-classical`.

    Such a row stands below that of the method which is chosen by its metric at its condition.
    """
    chosen_by = {*zip(rows["metric"], rows["condition"], strict=True)}
    chosen = {name: row.best(chosen_by, {*rows["method"]}) for name, row in CHOSEN.items()}
    if not any(chosen.values()):
        return rows
    result = []
    for row in row_mappings(rows):
        result.append(row)
        for name, best in chosen.items():
            if row["method"] != best.get((row["metric"], row["condition"])):
                continue
            remarks = [row["note"]] if row["skipped"] else [row["method"], row["note"]]
            note = "; ".join(filter(None, remarks))
            result.append(row | {"method": name, "note": note, "paper": NAN})
    return pd.DataFrame(result, columns=rows.columns)


def _which_are_chosen(rows: pd.DataFrame) -> str:
    """Return a sentence for each row like `best-classical`, on the methods that it stands for.

    Empty where there is no such row.
    """
    chosen_by = [*product(rows["metric"].unique(), rows["condition"].unique())]
    sentences = []
    for name, chosen in CHOSEN.items():
        of_name = rows[(rows["method"] == name) & ~rows["skipped"].astype(bool)]
        best = dict(of_name.set_index(["metric", "condition"])["images_of"].items())
        if best:
            sentences.append(chosen.in_words({key: best[key] for key in chosen_by if key in best}))
    return " ".join(sentences)


def _conditions_of_the_paper(frame: pd.DataFrame) -> Iterator[Block]:
    """Yield SR beside PC2PIX at each condition, like the paper's Tables 3 and 4.

    Nothing is yielded for a run without these methods.
    """
    rows = row_mappings(frame[frame["method"].isin(list(PAPER_METHODS))])
    if not rows:
        return
    yield f"In the paper's layout: SR is `{SURFACE}`. {_PUBLISHED}"
    in_run = {row["method"] for row in rows}
    # A variant (`pc2pix@acgan`) has a column only where the run has it.
    methods = [method for method in PAPER_METHODS if method in in_run or "@" not in method]
    conditions = ordered(row["condition"] for row in rows)
    heads = {
        (condition, method): f"{condition} {PAPER_METHODS[method]}"
        for condition, method in product(conditions, methods)
    }
    for class_name in ordered(row["class"] for row in rows):
        of_class = [row for row in rows if row["class"] == class_name]
        yield _with_paper_values(class_name, "condition", heads, of_class)


def _classes_of_the_paper(frame: pd.DataFrame) -> Iterator[Block]:
    """Yield SR beside PC2PIX in each class at one condition, seven classes in a row.

    Nothing is yielded for a run without one of the two.
    """
    network = network_of(frame["method"])
    if network is None or not (frame["method"] == SURFACE).any():
        return
    yield (
        f"In the paper's layout: SR is `{SURFACE}`, PC2PIX is {markdown.code(network)}. "
        f"{_PUBLISHED}"
    )
    classes, rows = ordered(frame["class"]), row_mappings(frame)
    for start in range(0, len(classes), _IN_A_ROW):
        heads = {}
        for class_name in classes[start : start + _IN_A_ROW]:
            heads[class_name, SURFACE] = f"{class_name} SR"
            heads[class_name, network] = f"{class_name} PC2PIX"
        yield _with_paper_values("", "class", heads, rows)


def _with_paper_values(
    corner: str,
    across: str,
    heads: Mapping[tuple[str, str], str],
    rows: Sequence[dict[str, Any]],
) -> Grid:
    """Return a grid with a line of ours for each metric, and the paper's below where it has any.

    corner  what stands above the names of the lines
    across  the column of the rows, `condition` or `class`, whose values stand side by side
    heads   heads of the grid's columns, by a value of the column `across` and a method
    """
    row_at = {(row["metric"], row[across], row["method"]): row for row in rows}
    lines = []
    for metric in ordered(row["metric"] for row in rows):
        of_metric = [row_at.get((metric, *key)) for key in heads]
        cells = [replace(quality_cell(row), interval=None) if row else DASH for row in of_metric]
        if all(row["skipped"] for row in of_metric if row):
            cells = [Cell("skipped") for _ in of_metric]
        lines.append(TableRow(metric, tuple(cells)))
        paper = [row["paper"] if row else NAN for row in of_metric]
        if any(map(math.isfinite, paper)):
            texts = [f"{value:g}" if math.isfinite(value) else "-" for value in paper]
            lines.append(TableRow(f"{metric}, paper", tuple(map(Cell, texts))))
    return Grid(corner, tuple(heads.values()), tuple(lines))


def all_methods(frame: pd.DataFrame, legend: str = _LEGEND) -> Iterator[Block]:
    """Yield a grid of all methods for each metric.

    With one class methods are down and conditions across; with several classes these are down and
    methods across, and each condition has a grid of its own.
    """
    yield legend
    trained = {
        row["method"]: _training(row, markdown.code(row["objective"]))
        for row in row_mappings(frame)
    }
    yield "\n".join(
        f"{markdown.code(method)}: {training}.  "
        for method, training in trained.items()
        if training
    )
    by_class = frame["class"].nunique() > 1
    # What is the same in a whole grid: the condition where classes are down, else the class.
    of_each = frame.groupby("condition" if by_class else "class", sort=False)
    for name, of_name in of_each:
        where = "" if by_class and len(of_each) == 1 else f", {name}"
        said_before: set[str] = set()
        for metric, of_metric in of_name.groupby("metric", sort=False):
            yield f"## {markdown.cell(f'{metric}{where}')}"
            of_all = _grid(of_metric, by_class)
            # A note that holds for several metrics is said once, below the first.
            new = tuple(note for note in of_all.notes if note not in said_before)
            said_before.update(new)
            yield of_all if of_all.void else replace(of_all, notes=new)
            if any(map(math.isfinite, of_metric["debiased"])):
                nothing = dict.fromkeys(("ci_low", "ci_high", "paper", "failures_as_blank"), NAN)
                yield f"## {markdown.cell(f'{metric}, debiased{where}')}"
                yield _DEBIASED
                without_bias = of_metric.assign(value=of_metric["debiased"], **nothing)
                yield _grid(without_bias, by_class, ", debiased")


def _grid(frame: pd.DataFrame, by_class: bool, how: str = "") -> Grid:
    """Return the grid of one metric.

    by_class  whether the frame is of one condition and classes are down; else it is of one class,
              and methods are down
    how       follows the name of the metric
    """
    rows = row_mappings(frame)
    first, higher = rows[0], higher_is_better(rows[0]["metric"])
    skipped = ordered(row["note"] for row in rows if row["skipped"])
    if by_class:
        line, column, about = "class", "method", _nothing_about
        where, named_with = f"at {first['condition']}", "class"
    else:
        line, column, about = "method", "condition", _about
        where, named_with = first["class"], "condition"
    better = "higher is better" if higher else "lower is better"
    return pivot(
        frame,
        line=line,
        column=column,
        cell=partial(_cell, best=best_printed(rows)),
        corner=line,
        about=about,
        metric=first["metric"] + how,
        caption=f"{first['metric']}{how}, {where} ({better})",
        notes=tuple(skipped or _gaps(rows, named_with)),
        void=bool(skipped),
        higher=higher,
    )


def _nothing_about(rows: Sequence[Mapping[str, Any]]) -> str:
    return ""


def _gaps(rows: Sequence[dict[str, Any]], named_with: str) -> list[str]:
    """Return a line for each row with failed images, and one for each other reason of no value.

    named_with  the column, `condition` or `class`, by which a row is named beside its method
    """
    notes: list[str] = []
    undefined: dict[str, list[str]] = {}
    for row in rows:
        if row["method"] in CHOSEN:
            continue  # the method that it stands for has the same line
        if row["failed"]:
            notes.append(f"{row['method']} at {row[named_with]}: {row['note']}")
        elif row["note"]:
            undefined.setdefault(row["note"], []).append(row["method"])
    return notes + [f"{', '.join(ordered(names))}: {note}" for note, names in undefined.items()]


def best_printed(rows: Iterable[dict[str, Any]]) -> set[tuple[str, str, str]]:
    """Return (class, condition, method) of the best methods by one metric.

    Several are the best where they print equal. Reference methods do not compete, nor does a method
    of which all images failed; where fewer than two compete none is the best.
    """
    competing: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in rows:
        if math.isfinite(row["value"]) and row["n_ok"] and not role(row["method"]):
            competing.setdefault((row["class"], row["condition"]), []).append(row)
    best = set()
    for (class_name, condition), rivals in competing.items():
        if len(rivals) < 2:
            continue
        for row in rivals:
            if not any(is_better(other, row) for other in rivals):
                best.add((class_name, condition, row["method"]))
    return best


def _cell(row: Mapping[str, Any], best: Container[tuple[str, str, str]]) -> Cell:
    """Return the cell of a value with everything beside it; `best` as `best_printed` returns it."""
    paper = f"{row['paper']:g}" if math.isfinite(row["paper"]) else ""
    if row["skipped"]:
        return Cell("skipped", paper=paper)
    blank = None
    if row["failed"] and math.isfinite(row["failures_as_blank"]):
        digits = decimals(row["metric"], row["images_of"])
        blank = number_text(row["failures_as_blank"], digits)
    is_best = (row["class"], row["condition"], row["method"]) in best
    return replace(
        quality_cell(row),
        count=(row["n_ok"], row["n"]),
        blank=blank,
        paper=paper,
        special=BEST if is_best else None,
    )


def quality_cell(row: Mapping[str, Any]) -> Cell:
    """Return the cell of a value with its interval alone."""
    estimate = row["value"], row["ci_low"], row["ci_high"]
    cell = metric_cell(estimate, row["metric"], row["images_of"])
    return unsure(cell) if may_miss(row["failed"], row["objects"]) else cell


def _about(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return what stands beside a method's name: its role, and what it was trained on."""
    parts = [role_in_words(rows[0]["method"]), _training(rows[0], rows[0]["objective"])]
    return ", ".join(part for part in parts if part)


def _training(row: Mapping[str, Any], objective: str) -> str:
    """Return what a network was trained on and with, as far as it is known; empty for others."""
    parts = []
    if row["trained_on"] not in ("", "nothing"):
        parts.append(f"on {row['trained_on']}")
    if row["objective"]:
        parts.append(f"with {objective}")
    return f"trained {', '.join(parts)}" if parts else ""
