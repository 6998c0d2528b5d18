"""Tables of quality: a tidy row for each method, condition, class and metric.

People see them in the paper's layout with the paper's values beside ours, where a suite says so,
then all methods with intervals and counts.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from bench.analysis.comparison import NAN
from bench.analysis.digits import prints_better
from bench.analysis.frame import Run
from bench.analysis.paper import PAPER_METHODS, Published, published_value
from bench.analysis.scores import QualityRow, image_rows, recognition_rows, set_rows
from bench.catalogue.chosen import CHOSEN
from bench.catalogue.methods import role, training_objects
from bench.catalogue.metrics import JUDGE, higher_is_better
from bench.catalogue.suites import TableSpec
from bench.records.record import GROUND_TRUTH
from bench.tables import markdown
from bench.tables.grid import (
    BEST,
    NOTHING,
    Block,
    Cell,
    ColumnHeader,
    Grid,
    TableRow,
    Tags,
    measured,
    ordered,
    pivot,
    shown,
)
from bench.tables.table import Table, columns_of

DETAIL_REMARK = (
    "Means are over the images that have a value; where some have none, a line below says why."
)
_DEBIASED = (
    "What the distance would be with endless objects, extrapolated by the jackknife: for comparing "
    "runs of different numbers of objects."
)


def image_table(run: Run, spec: TableSpec, published: Published) -> Table[QualityRow]:
    """Return the means over images of the suite's image metrics."""
    rows = [sampled.row for sampled in image_rows(run, run.suite.image_metrics)]
    return quality_table(spec, annotated(rows, run.manifest, published))


def detail_table(run: Run, spec: TableSpec, published: Published) -> Table[QualityRow]:
    """Return the means over images of the suite's detail metrics, which the paper does not have."""
    rows = [sampled.row for sampled in image_rows(run, run.suite.detail_metrics)]
    return quality_table(spec, annotated(rows, run.manifest, {}), DETAIL_REMARK)


def set_table(run: Run, spec: TableSpec, published: Published) -> Table[QualityRow]:
    """Return the distances of methods' images to the true ones by the suite's set metrics."""
    rows = [sampled.row for metric in run.suite.set_metrics for sampled in set_rows(run, metric)]
    return quality_table(spec, annotated(rows, run.manifest, published))


def recognition_table(run: Run, spec: TableSpec, published: Published) -> Table[QualityRow]:
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


def annotated(
    rows: Iterable[QualityRow], manifest: Mapping[str, Any], published: Published
) -> list[QualityRow]:
    """Return the rows with the paper's values, and what the networks' weights were trained with."""
    objectives: Mapping[str, str] = manifest.get("objectives", {})
    return [
        replace(
            row,
            paper=published_value(published, row.class_name, row.metric, row.condition, row.method),
            trained_on=training_objects(row.method, manifest),
            objective=objectives.get(row.method, ""),
        )
        for row in rows
    ]


def quality_table(
    spec: TableSpec, rows: Iterable[QualityRow], remark: str = ""
) -> Table[QualityRow]:
    """Return a table of rows.

    Several classes at one condition are never in the paper's layout: they are a line each.
    """

    def layout(rows: Sequence[QualityRow]) -> Iterator[Block]:
        yield remark
        one_condition = len({row.condition for row in rows}) == 1
        if spec.paper_layout and not (one_condition and len({row.class_name for row in rows}) > 1):
            yield from _paper_layout(rows)
        yield from all_methods(rows)

    rows = with_chosen_rows(rows)
    remark = " ".join(filter(None, [remark, which_are_chosen(rows)]))
    return Table.of_rows(spec.name, spec.title, columns_of(QualityRow), rows, layout, remark)


def with_chosen_rows(rows: Iterable[QualityRow]) -> tuple[QualityRow, ...]:
    """Return the rows, with those of chosen methods a second time by the name of their row."""
    rows = tuple(rows)
    conditions, methods = {row.condition for row in rows}, {row.method for row in rows}
    chosen = {name: row.by_condition(conditions, methods) for name, row in CHOSEN.items()}
    result = []
    for row in rows:
        result.append(row)
        for name, best in chosen.items():
            if row.method == best.get(row.condition):
                note = row.note if row.skipped else "; ".join(filter(None, [row.method, row.note]))
                result.append(replace(row, method=name, note=note, paper=NAN))
    return tuple(result)


def which_are_chosen(rows: Iterable[QualityRow]) -> str:
    """Return a sentence for each chosen row, on its method at each condition; empty without any."""
    rows = tuple(rows)
    sentences = []
    for name in CHOSEN:
        conditions: dict[str, list[str]] = {}
        for row in rows:
            if row.method == name and not row.skipped:
                conditions.setdefault(row.note.partition("; ")[0], []).append(row.condition)
        parts = [f"`{method}` at {', '.join(ordered(at))}" for method, at in conditions.items()]
        if parts:
            sentences.append(f"`{name}`, chosen on validation objects, is {'; '.join(parts)}.")
    return " ".join(sentences)


def _paper_layout(rows: Sequence[QualityRow]) -> Iterator[Block]:
    """Yield SR beside PC2PIX at each condition, the paper's values below; nothing without both."""
    rows = [row for row in rows if row.method in PAPER_METHODS]
    if not rows:
        return
    yield (
        "In the paper's layout: SR is `surface-apss`. Below a line of ours stands the paper's, as "
        "published: other data (ShapeNet), other weights."
    )
    measured = {row.method for row in rows}
    methods = [method for method in PAPER_METHODS if method in measured or "@" not in method]
    heads = {
        (condition, method): f"{condition} {PAPER_METHODS[method]}"
        for condition in ordered(row.condition for row in rows)
        for method in methods
    }
    metrics = ordered(row.metric for row in rows)
    for class_name in ordered(row.class_name for row in rows):
        of_class = [row for row in rows if row.class_name == class_name]
        by_key = {(row.metric, row.condition, row.method): row for row in of_class}
        yield with_paper_values(class_name, metrics, heads, by_key)


def with_paper_values(
    corner: str,
    metrics: Iterable[str],
    heads: Mapping[tuple[str, str], str],
    rows: Mapping[tuple[str, str, str], QualityRow],
) -> Grid:
    """Return a grid with a line of ours for each metric, and the paper's below where it has any.

    heads  heads of the columns by their keys
    rows   rows by metric and key of the column
    """
    lines = []
    for metric in metrics:
        of_metric = [rows.get((metric, *key)) for key in heads]
        cells = [replace(quality_cell(row), interval=None) if row else NOTHING for row in of_metric]
        if all(row.skipped for row in of_metric if row):
            cells = [Cell("skipped")] * len(of_metric)
        lines.append(TableRow(metric, tuple(cells)))
        paper = [row.paper if row else NAN for row in of_metric]
        if any(map(math.isfinite, paper)):
            texts = [f"{value:g}" if math.isfinite(value) else "-" for value in paper]
            lines.append(TableRow(f"{metric}, paper", tuple(map(Cell, texts))))
    return Grid(corner, tuple(map(ColumnHeader, heads.values())), tuple(lines))


_LEGEND = (
    "All methods: value [95 % interval over objects] n_ok/n images. Where images are missing, *b* "
    "is the value with a blank image in place of each."
)


def all_methods(rows: Sequence[QualityRow], legend: str = _LEGEND) -> Iterator[Block]:
    """Yield all cells, with a grid for each metric.

    With one class methods are down and conditions across; with several classes these are down and
    methods across, condition by condition.
    """
    yield legend
    trained = {row.method: _training(row, markdown.code(row.objective)) for row in rows}
    yield "\n".join(
        f"{markdown.code(method)}: {training}.  "
        for method, training in trained.items()
        if training
    )
    told: set[str] = set()
    by_class = len({row.class_name for row in rows}) > 1
    attribute = "condition" if by_class else "class_name"
    groups: dict[str, dict[str, list[QualityRow]]] = {}
    for row in rows:
        groups.setdefault(getattr(row, attribute), {}).setdefault(row.metric, []).append(row)
    for name in groups:
        where = "" if by_class and len(groups) == 1 else f", {name}"
        for metric in ordered(row.metric for row in rows if row.metric in groups[name]):
            of_metric = groups[name][metric]
            yield f"## {markdown.cell(metric + where)}"
            shown_grid = _grid(of_metric, by_class)
            # What holds for several metrics is said once, below the first.
            new = tuple(note for note in shown_grid.notes if f"{name} {note}" not in told)
            told |= {f"{name} {note}" for note in new}
            yield replace(shown_grid, notes=shown_grid.notes if shown_grid.void else new)
            if any(math.isfinite(row.debiased) for row in of_metric):
                nothing = dict.fromkeys(("ci_low", "ci_high", "paper", "failures_as_blank"), NAN)
                without_bias = [replace(row, value=row.debiased, **nothing) for row in of_metric]
                yield f"## {markdown.cell(f'{metric}, debiased{where}')}"
                yield _DEBIASED
                yield _grid(without_bias, by_class, ", debiased")


def _grid(rows: Sequence[QualityRow], by_class: bool, how: str = "") -> Grid:
    """Return the grid of one metric at one condition, or else of one class.

    `how` follows the metric's name.
    """
    metric, higher = rows[0].metric, higher_is_better(rows[0].metric)
    skipped = ordered(row.note for row in rows if row.skipped)
    if by_class:
        line, column, corner = "class_name", "method", "class"
        where, across, tags = f"at {rows[0].condition}", line, Tags(condition=rows[0].condition)
    else:
        line, column, corner = "method", "condition", "method"
        where, across, tags = rows[0].class_name, column, Tags(class_name=rows[0].class_name)
    return pivot(
        rows,
        line,
        column,
        partial(_cell, best=best_printed(rows)),
        corner=corner,
        outcomes=_outcomes,
        about=(lambda rows: "") if by_class else _about,
        metric=metric + how,
        caption=f"{metric}{how}, {where} ({'higher' if higher else 'lower'} is better)",
        notes=tuple(skipped or _gaps(rows, across)),
        void=bool(skipped),
        higher=higher,
        tags=tags,
    )


def _gaps(rows: Sequence[QualityRow], across: str) -> list[str]:
    """Return a line for each cell with failures; cells that lack a value for one reason share."""
    notes: list[str] = []
    undefined: dict[str, list[str]] = {}
    for row in rows:
        if row.method in CHOSEN:
            continue  # named as the method that it is
        if row.only_undefined:
            undefined.setdefault(row.note, []).append(row.method)
        elif row.n_ok < row.n:
            notes.append(f"{row.method} at {getattr(row, across)}: {row.note}")
    return notes + [f"{', '.join(ordered(names))}: {note}" for note, names in undefined.items()]


def best_printed(rows: Sequence[QualityRow]) -> set[tuple[str, str, str]]:
    """Return the methods that compete in each class and condition and are the best of it, printed.

    None where fewer than two compete.
    """
    by_cell: dict[tuple[str, str], list[QualityRow]] = {}
    for row in rows:
        if math.isfinite(row.value) and not role(row.method):
            by_cell.setdefault((row.class_name, row.condition), []).append(row)
    return {
        (*key, row.method)
        for key, of_cell in by_cell.items()
        for row in of_cell
        if len(of_cell) > 1 and not any(is_worse(row, other) for other in of_cell)
    }


def is_worse(row: QualityRow, other: QualityRow) -> bool:
    """Return whether a value is worse than another in the digits that both are printed with."""
    methods = row.measured_method, other.measured_method
    return prints_better(row.metric, other.value, row.value, *methods)


def _cell(row: QualityRow, best: Container[tuple[str, str, str]]) -> Cell:
    paper = f"{row.paper:g}" if math.isfinite(row.paper) else ""
    if row.skipped:
        return Cell("skipped", paper=paper)
    beside = row.failed and math.isfinite(row.failures_as_blank)
    blank = shown(row.failures_as_blank, row.decimals) if beside else None
    is_best = (row.class_name, row.condition, row.method) in best
    return replace(
        quality_cell(row),
        count=(row.n_ok, row.n),
        blank=blank,
        paper=paper,
        special=BEST if is_best else None,
    )


def quality_cell(row: QualityRow) -> Cell:
    """Return the cell of a value with its interval alone."""
    return measured((row.value, row.ci_low, row.ci_high), row.metric, row.measured_method)


def _about(rows: Sequence[QualityRow]) -> str:
    parts = [role(rows[0].method), _training(rows[0], rows[0].objective)]
    return ", ".join(part for part in parts if part)


def _training(row: QualityRow, objective: str) -> str:
    """Return what a network was trained on and with, as far as it is known; empty for others."""
    parts = [f" on {row.trained_on}"] if row.trained_on not in ("", "nothing") else []
    parts += [f" with {objective}"] if row.objective else []
    return "trained" + ",".join(parts) if parts else ""


def _outcomes(rows: Sequence[QualityRow]) -> tuple[str, ...]:
    """Return the outcomes of the images of these rows, in the words of the records."""
    measured = [row for row in rows if not row.skipped]
    outcomes = {
        "failed": any(row.failed for row in measured),
        "ok": any(row.n_ok > 0 for row in measured),
        "skipped": len(measured) < len(rows),
    }
    return tuple(outcome for outcome, occurs in outcomes.items() if occurs)
