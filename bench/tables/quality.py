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

import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.comparison import NAN, is_better
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
from bench.analysis.scored_run import Run
from bench.analysis.scores import (
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
from bench.records.frames import read_scores, scored_metrics
from bench.records.record import GROUND_TRUTH
from bench.records.run_folder import PROTOCOL
from bench.tables import markdown
from bench.tables.grid import (
    BEST,
    NOTHING,
    Block,
    Cell,
    Grid,
    TableRow,
    measured,
    ordered,
    pivot,
    records,
    shown,
    unsure,
)
from bench.tables.table import Table, of_protocol
from data_prep.failures import BadInput
from data_prep.progress import log

HEADLINE = "headline"
_FEWEST_SHOWN = (
    12  # objects: intervals of fewer are so wide and so uncertain that they mislead here
)
FEW = 10  # objects of a class below which its distances are warned of
_IN_A_ROW = 7  # classes side by side, as the paper has them
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
        sizes = ", ".join(
            f"{len({obj for obj, _ in answers.images(GROUND_TRUTH, '', name)})} of class "
            f"{markdown.cell(name)}"
            for name in run.objects_of
        )
        remark += f" Retrieval is among all objects of the run ({sizes}): by chance 1 in as many."
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
    """Return the table that a run shows while it goes on, and at its end: few metrics, all methods.

    With one class methods are down and conditions across; with several it is the mean over classes.
    Failed images are scored as blank ones, so that all methods have values of the same objects.
    `metrics` are those that the run has while it goes on, by default all. People see intervals from
    _FEWEST_SHOWN objects on; its CSV has them before.
    """
    suite, manifest = run.suite, run.manifest
    wanted = ordered(suite.headline if metrics is None else metrics)
    with threadpool_limits(1):
        means = image_rows(run, [metric for metric in wanted if is_mean(metric)], True)
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
        # The value itself is the one with blank images.
        yield from all_methods(frame.assign(failures_as_blank=NAN), _HEADLINE_LEGEND)

    title = f"{' and '.join(suite.headline)}: {objects} of {planned} objects"
    every = _with_chosen_rows(annotated(rows, manifest, {}))
    table = Table(HEADLINE, title, every, layout, hidden=HIDDEN)
    return of_protocol(table, suite, manifest[PROTOCOL])


def metric_table(run: Run, metric: Any, rows: pd.DataFrame) -> Table:
    """Return the table of a further metric, which has an id, a version and a line about it."""
    better = "higher" if higher_is_better(metric.id) else "lower"
    title = f"{metric.id}, version {metric.version}: {metric.about} ({better} is better)"
    spec = TableSpec("images", metric_table_name(metric.id), title)
    return of_protocol(quality_table(spec, rows), run.suite, run.manifest[PROTOCOL])


def metric_table_name(metric_id: str) -> str:
    """Return the name of the table of a metric of `bench score`."""
    return f"metric_{metric_id}"


def further_tables(run: Run) -> list[Table]:
    """Return the tables of all image metrics that a run was scored by.

    Scores of records that have changed since are left out, and a line on stderr names them.
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
    """Return the rows with the paper's values, and what the networks' weights were trained with."""
    objectives: Mapping[str, str] = manifest.get("objectives", {})
    methods = rows["method"].tolist()
    cells = zip(rows["class"], rows["metric"], rows["condition"], methods, strict=True)
    return rows.assign(
        paper=[published_value(published, *cell) for cell in cells],
        trained_on=[training_objects(method, manifest) for method in methods],
        objective=[objectives.get(method, "") for method in methods],
    )


def quality_table(spec: TableSpec, rows: pd.DataFrame, remark: str = "") -> Table:
    """Return a table of rows.

    Several classes at one condition are a line each, and in the paper's layout in its Table 5 only.
    """

    def layout(frame: pd.DataFrame) -> Iterator[Block]:
        yield told
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

    frame = _with_chosen_rows(rows)
    told = " ".join(filter(None, [remark, _which_are_chosen(frame)]))
    return Table(spec.name, spec.title, frame, layout, told, hidden=HIDDEN)


def _with_chosen_rows(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows, with those of chosen methods a second time by the name of their row."""
    cells = {*zip(rows["metric"], rows["condition"], strict=True)}
    chosen = {name: row.best(cells, {*rows["method"]}) for name, row in CHOSEN.items()}
    if not any(chosen.values()):
        return rows
    result = []
    for row in records(rows):
        result.append(row)
        for name, best in chosen.items():
            if row["method"] == best.get((row["metric"], row["condition"])):
                also = [] if row["skipped"] else [row["method"]]
                note = "; ".join(filter(None, [*also, row["note"]]))
                result.append(row | {"method": name, "note": note, "paper": NAN})
    return pd.DataFrame(result, columns=rows.columns)


def _which_are_chosen(rows: pd.DataFrame) -> str:
    """Return a sentence for each chosen row, on its method in each cell; empty without any."""
    cells = [*product(rows["metric"].unique(), rows["condition"].unique())]
    sentences = []
    for name, chosen in CHOSEN.items():
        of_name = rows[(rows["method"] == name) & ~rows["skipped"].astype(bool)]
        best = dict(of_name.set_index(["metric", "condition"])["images_of"].items())
        if best:
            sentences.append(chosen.in_words({cell: best[cell] for cell in cells if cell in best}))
    return " ".join(sentences)


def _conditions_of_the_paper(frame: pd.DataFrame) -> Iterator[Block]:
    """Yield SR beside PC2PIX at each condition, as the paper's Tables 3 and 4; or nothing."""
    rows = records(frame[frame["method"].isin(list(PAPER_METHODS))])
    if not rows:
        return
    yield f"In the paper's layout: SR is `{SURFACE}`. {_PUBLISHED}"
    measured = {row["method"] for row in rows}
    methods = [method for method in PAPER_METHODS if method in measured or "@" not in method]
    heads = {
        (condition, method): f"{condition} {PAPER_METHODS[method]}"
        for condition in ordered(row["condition"] for row in rows)
        for method in methods
    }
    for class_name in ordered(row["class"] for row in rows):
        of_class = [row for row in rows if row["class"] == class_name]
        yield _with_paper_values(class_name, "condition", heads, of_class)


def _classes_of_the_paper(frame: pd.DataFrame) -> Iterator[Block]:
    """Yield SR and PC2PIX side by side at one condition, classes in rows of seven; or nothing."""
    network = network_of(frame["method"])
    if network is None or not (frame["method"] == SURFACE).any():
        return
    yield (
        f"In the paper's layout: SR is `{SURFACE}`, PC2PIX is {markdown.code(network)}. "
        f"{_PUBLISHED}"
    )
    classes, rows = ordered(frame["class"]), records(frame)
    for start in range(0, len(classes), _IN_A_ROW):
        heads = {
            (class_name, method): f"{class_name} {name}"
            for class_name in classes[start : start + _IN_A_ROW]
            for method, name in {SURFACE: "SR", network: "PC2PIX"}.items()
        }
        yield _with_paper_values("", "class", heads, rows)


def _with_paper_values(
    corner: str,
    across: str,
    heads: Mapping[tuple[str, str], str],
    rows: Sequence[dict[str, Any]],
) -> Grid:
    """Return a grid with a line of ours for each metric, and the paper's below where it has any.

    `heads` are those of the columns by their value of the column `across` and their method.
    """
    at = {(row["metric"], row[across], row["method"]): row for row in rows}
    lines = []
    for metric in ordered(row["metric"] for row in rows):
        of_metric = [at.get((metric, *key)) for key in heads]
        cells = [replace(quality_cell(row), interval=None) if row else NOTHING for row in of_metric]
        if all(row["skipped"] for row in of_metric if row):
            cells = [Cell("skipped")] * len(of_metric)
        lines.append(TableRow(metric, tuple(cells)))
        paper = [row["paper"] if row else NAN for row in of_metric]
        if any(map(math.isfinite, paper)):
            texts = [f"{value:g}" if math.isfinite(value) else "-" for value in paper]
            lines.append(TableRow(f"{metric}, paper", tuple(map(Cell, texts))))
    return Grid(corner, tuple(heads.values()), tuple(lines))


def all_methods(frame: pd.DataFrame, legend: str = _LEGEND) -> Iterator[Block]:
    """Yield all cells, with a grid for each metric.

    With one class methods are down and conditions across; with several classes these are down and
    methods across, condition by condition.
    """
    yield legend
    trained = {
        row["method"]: _training(row, markdown.code(row["objective"])) for row in records(frame)
    }
    yield "\n".join(
        f"{markdown.code(method)}: {training}.  "
        for method, training in trained.items()
        if training
    )
    told: set[str] = set()
    by_class = frame["class"].nunique() > 1
    places = frame.groupby("condition" if by_class else "class", sort=False)
    for name, of_place in places:
        where = "" if by_class and len(places) == 1 else f", {name}"
        for metric, of_metric in of_place.groupby("metric", sort=False):
            yield f"## {markdown.cell(f'{metric}{where}')}"
            shown_grid = _grid(of_metric, by_class)
            # What holds for several metrics is said once, below the first.
            new = tuple(note for note in shown_grid.notes if f"{name} {note}" not in told)
            told |= {f"{name} {note}" for note in new}
            yield replace(shown_grid, notes=shown_grid.notes if shown_grid.void else new)
            if any(map(math.isfinite, of_metric["debiased"])):
                nothing = dict.fromkeys(("ci_low", "ci_high", "paper", "failures_as_blank"), NAN)
                yield f"## {markdown.cell(f'{metric}, debiased{where}')}"
                yield _DEBIASED
                without_bias = of_metric.assign(value=of_metric["debiased"], **nothing)
                yield _grid(without_bias, by_class, ", debiased")


def _grid(frame: pd.DataFrame, by_class: bool, how: str = "") -> Grid:
    """Return the grid of one metric at one condition, or else of one class.

    `how` follows the metric's name.
    """
    rows = records(frame)
    first, higher = rows[0], higher_is_better(rows[0]["metric"])
    skipped = ordered(row["note"] for row in rows if row["skipped"])
    if by_class:
        line, column, corner, across = "class", "method", "class", "class"
        where = f"at {first['condition']}"
    else:
        line, column, corner, across = "method", "condition", "method", "condition"
        where = first["class"]
    return pivot(
        frame,
        line,
        column,
        partial(_cell, best=best_printed(rows)),
        corner=corner,
        about=(lambda rows: "") if by_class else _about,
        metric=first["metric"] + how,
        caption=f"{first['metric']}{how}, {where} ({'higher' if higher else 'lower'} is better)",
        notes=tuple(skipped or _gaps(rows, across)),
        void=bool(skipped),
        higher=higher,
    )


def _gaps(rows: Sequence[dict[str, Any]], across: str) -> list[str]:
    """Return a line for each cell with failures; cells that lack a value for one reason share."""
    notes: list[str] = []
    undefined: dict[str, list[str]] = {}
    for row in rows:
        if row["method"] in CHOSEN:
            continue  # named as the method that it is
        if row["failed"]:
            notes.append(f"{row['method']} at {row[across]}: {row['note']}")
        elif row["note"]:
            undefined.setdefault(row["note"], []).append(row["method"])
    return notes + [f"{', '.join(ordered(names))}: {note}" for note, names in undefined.items()]


def best_printed(rows: Iterable[dict[str, Any]]) -> set[tuple[str, str, str]]:
    """Return the methods that compete in each class and condition and are the best of it, printed.

    None where fewer than two compete. A value of blank images alone has no part.
    """
    by_cell: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in rows:
        if math.isfinite(row["value"]) and row["n_ok"] and not role(row["method"]):
            by_cell.setdefault((row["class"], row["condition"]), []).append(row)
    return {
        (*key, row["method"])
        for key, of_cell in by_cell.items()
        for row in of_cell
        if len(of_cell) > 1 and not any(is_better(other, row) for other in of_cell)
    }


def _cell(row: Mapping[str, Any], best: Container[tuple[str, str, str]]) -> Cell:
    paper = f"{row['paper']:g}" if math.isfinite(row["paper"]) else ""
    if row["skipped"]:
        return Cell("skipped", paper=paper)
    blank = row["failures_as_blank"]
    beside = row["failed"] and math.isfinite(blank)
    is_best = (row["class"], row["condition"], row["method"]) in best
    return replace(
        quality_cell(row),
        count=(row["n_ok"], row["n"]),
        blank=shown(blank, decimals(row["metric"], row["images_of"])) if beside else None,
        paper=paper,
        special=BEST if is_best else None,
    )


def quality_cell(row: Mapping[str, Any]) -> Cell:
    """Return the cell of a value with its interval alone."""
    estimate = row["value"], row["ci_low"], row["ci_high"]
    cell = measured(estimate, row["metric"], row["images_of"])
    return unsure(cell) if may_miss(row["failed"], row["objects"]) else cell


def _about(rows: Sequence[Mapping[str, Any]]) -> str:
    parts = [role(rows[0]["method"]), _training(rows[0], rows[0]["objective"])]
    return ", ".join(part for part in parts if part)


def _training(row: Mapping[str, Any], objective: str) -> str:
    """Return what a network was trained on and with, as far as it is known; empty for others."""
    parts = [f" on {row['trained_on']}"] if row["trained_on"] not in ("", "nothing") else []
    parts += [f" with {objective}"] if row["objective"] else []
    return "trained" + ",".join(parts) if parts else ""
