"""The paper's Table 5: distances and scores class by class, and in the mean over classes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from bench.analysis.frame import Run
from bench.analysis.paper import SURFACE, Published, network_of
from bench.analysis.scores import QualityRow, class_rows
from bench.catalogue.suites import TableSpec
from bench.tables import markdown
from bench.tables.grid import Block, ordered
from bench.tables.quality import (
    all_methods,
    annotated,
    which_are_chosen,
    with_chosen_rows,
    with_paper_values,
)
from bench.tables.table import Table, columns_of

FEW = 10  # objects of a class below which its distances are warned of
IN_A_ROW = 7  # classes side by side, as the paper has them


def class_table(run: Run, spec: TableSpec, published: Published) -> Table[QualityRow]:
    """Return Table 5: values by class, and their means over classes."""
    rows = annotated(class_rows(run, run.suite.class_metrics), run.manifest, published)
    shown = with_chosen_rows(rows)
    remarks = [remark(run), which_are_chosen(shown)]
    return table_of_classes(spec, shown, " ".join(filter(None, remarks)))


def table_of_classes(spec: TableSpec, rows: Iterable[QualityRow], remark: str) -> Table[QualityRow]:
    """Return Table 5 of its rows."""

    def layout(rows: Sequence[QualityRow]) -> Iterator[Block]:
        yield remark
        for condition in ordered(row.condition for row in rows):
            if condition != rows[0].condition:
                yield f"# At {markdown.cell(condition)}"
            of_condition = [row for row in rows if row.condition == condition]
            yield from _paper_layout(of_condition)
            yield from all_methods(of_condition)

    return Table.of_rows(spec.name, spec.title, columns_of(QualityRow), tuple(rows), layout, remark)


def remark(run: Run) -> str:
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


def _paper_layout(rows: Sequence[QualityRow]) -> Iterator[Block]:
    """Yield SR and PC2PIX side by side at one condition, classes in rows of seven."""
    network = network_of([row.method for row in rows])
    if network is None or not any(row.method == SURFACE for row in rows):
        return
    yield (
        f"In the paper's layout: SR is `{SURFACE}`, PC2PIX is {markdown.code(network)}. Below a "
        "line of ours stands the paper's, as published: other data (ShapeNet), other weights."
    )
    by_key = {(row.metric, row.class_name, row.method): row for row in rows}
    names = {SURFACE: "SR", network: "PC2PIX"}
    metrics = ordered(row.metric for row in rows)
    classes = ordered(row.class_name for row in rows)
    for start in range(0, len(classes), IN_A_ROW):
        heads = {
            (class_name, method): f"{class_name} {name}"
            for class_name in classes[start : start + IN_A_ROW]
            for method, name in names.items()
        }
        yield with_paper_values("", metrics, heads, by_key)
