"""The leaderboard of the project's own results, on the front page of the documentation.

    python -m studies.leaderboard > leaderboard.html

It is made from the values in `results/docs`, in the form of the leaderboards of `bench report`. The
module is also an extension of Sphinx, which puts the leaderboard in place of the comment
`<!-- leaderboard -->` in `docs/index.md`.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.compare import milliseconds
from bench.analysis.paper import AVERAGE
from bench.catalogue.chosen import (
    BEST_CLASSICAL,
    CHOSEN,
    MEASURED_ON,
    cost_of,
    measured_methods,
)
from bench.catalogue.conditions import condition_words
from bench.report.index import (
    HEADLINE_METRICS,
    BoardCell,
    BoardColumn,
    BoardGroup,
    is_reference,
    leaderboard,
    metric_column,
    trained_on,
    value_cell,
)
from bench.report.page import bundled, rendered
from studies.documents import NUMBERS, VERDICTS, Line, measured_method
from studies.measurements import differences_of

FULL = "2048"  # the condition of whole clouds without noise
_MARK = "<!-- leaderboard -->"  # the comment in whose place the leaderboard is put


@dataclass(frozen=True)
class ResultGroup:
    """Two columns of the leaderboard: the headline metrics on a set of objects.

    name         title of the columns
    objects      which objects they are, in words
    measurement  name of the measurement (`studies.measurements`) whose values are shown, with its
                 comparisons with the best classical method
    condition    of the clouds
    """

    name: str
    objects: str
    measurement: str
    condition: str

    @property
    def title(self) -> str:
        """Return the objects and the condition in words."""
        return f"{self.objects}; {condition_words(self.condition)}"


KNOWN = "chairs of the generator that the networks were trained with"
REAL = "real meshes, mean of 13 classes"
GROUPS = (
    ResultGroup("known chairs", KNOWN, "known-chairs-grey", FULL),
    ResultGroup("real objects", REAL, "real-meshes-grey", FULL),
    ResultGroup("real, noise 10 %", REAL, "real-meshes-grey", "noise-0.10"),
)


def board(numbers: Path = NUMBERS, groups: Sequence[ResultGroup] = GROUPS) -> dict[str, Any]:
    """Return the leaderboard of the results in a folder, as `bench.report.index.leaderboard` does.

    Methods are sorted by the mean of their places in the columns in which they have values. Weights
    that do not belong to the package are left out.

    Raises OSError where a file is missing.
    """
    columns = {group: _group(numbers, group) for group in groups}
    shown: set[str] = set()  # methods with a value in some column
    for of_group in columns.values():
        for column in of_group.columns:
            shown.update(column.cells)
    methods: list[str] = []  # these in the order of the files
    for group in groups:
        for line in _read(numbers / f"{group.measurement}.csv"):
            if line["method"] in shown and line["method"] not in methods:
                methods.append(line["method"])
    competing = [method for method in methods if not is_reference(method)]
    cost_cells = _costs_of(competing, methods)
    return leaderboard(
        f"The {len(competing)} methods measured against the truth in grey, by the mean of their "
        "places",
        tuple(columns.values()),
        (
            BoardColumn(
                "one view (ms)",
                f"a new cloud prepared and one view drawn, on one thread of {MEASURED_ON}",
                cost_cells,
            ),
            BoardColumn(
                "trained on",
                "objects that a network was shown",
                {method: trained_on(method) for method in methods},
                numeric=False,
            ),
        ),
        methods,
        (
            f"Better, worse, not decided: against {BEST_CLASSICAL}, object by object, p below "
            ".05 after Bonferroni's correction. A failed image is scored as a blank one. "
            " Results has commands, dates and intervals.",
        ),
    )


def _costs_of(competing: Sequence[str], methods: Sequence[str]) -> dict[str, BoardCell]:
    """Return the cost of one view of each method that has been measured.

    A row such as `best-classical` has the cost of the method that is chosen by LPIPS on whole
    clouds, among `methods`.
    """
    costs, by = measured_methods(), ("lpips", FULL)
    cells = {}
    for method in competing:
        measured = method
        if method in CHOSEN:
            measured = CHOSEN[method].best([by], methods).get(by, method)
        if cost := cost_of(measured, costs):
            cells[method] = BoardCell(milliseconds(cost.one_view_ms), cost.one_view_ms)
    return cells


def _group(numbers: Path, group: ResultGroup) -> BoardGroup:
    """Return the columns of a group, without weights that do not belong to the package."""
    lines = _read(numbers / f"{group.measurement}.csv")
    methods = dict.fromkeys(line["method"] for line in lines)
    columns = []
    for metric in HEADLINE_METRICS:
        verdicts = _verdicts(numbers / differences_of(group.measurement), group, metric)
        cells = {}
        for method in methods:
            of_cell = _lines(lines, group, metric, method)
            texts = [line["failures_as_blank"] or line["value"] for line in of_cell]
            if not method.endswith(".safetensors") and texts and all(texts):
                value = float(np.mean([float(text) for text in texts]))
                measured = measured_method(of_cell[0])
                cells[method] = value_cell(
                    value, metric, measured, beneath=verdicts.get(method, "")
                )
        columns.append(metric_column(metric, cells))
    return BoardGroup(tuple(columns), group.name, group.title)


@cache
def _read(path: Path) -> tuple[Line, ...]:
    """Return the lines of a CSV file."""
    with path.open(encoding="utf-8", newline="") as file:
        return tuple(csv.DictReader(file))


def _lines(lines: Sequence[Line], group: ResultGroup, metric: str, method: str) -> list[Line]:
    """Return the lines of a value: that of the average over classes, or else those of classes."""
    wanted = {"method": method, "metric": metric, "condition": group.condition}
    of_classes = [line for line in lines if wanted.items() <= line.items()]
    averages = [line for line in of_classes if line["class"] == AVERAGE]
    return averages or of_classes


def _verdicts(path: Path, group: ResultGroup, metric: str) -> dict[str, str]:
    """Return the outcome of each method's comparison in words, over all classes where there is one.

    path  of the file of comparisons
    """
    at = {"metric": metric, "condition": group.condition}
    lines = [line for line in _read(path) if at.items() <= line.items()]
    # Lines of all classes together come last, and so replace those of single classes.
    lines.sort(key=lambda line: line["class"] == "all")
    return {line["method_b"]: VERDICTS[line["ahead"]] for line in lines}


def _fragment() -> str:
    """Return the leaderboard as a part of an HTML page, with its style and script."""
    return rendered(
        "board-fragment.html.jinja",
        board=board(),
        style=bundled("tables.css") + _STYLE,
    )


# The leaderboard's colours are set to those of the Sphinx theme, which has others for dark mode.
# The theme's column of text is 46em wide, so titles and words have to wrap for the table to fit.
_STYLE = """
.leaderboard {
  --ink: var(--color-foreground-primary); --soft: var(--color-foreground-secondary);
  --rule: var(--color-background-border); --strong-rule: var(--color-foreground-border);
  --paper: var(--color-background-primary); --accent: var(--color-brand-content);
  --good: var(--color-foreground-primary); --bad: var(--color-foreground-primary);
  font-size: 0.78rem;
}
.leaderboard .board :is(th, td) { padding-right: 0.3rem; }
.leaderboard .board .start { padding-left: 0.4rem; }
.leaderboard .board :is(thead .of-run, thead span, td:last-child) { white-space: normal; }
@media (min-width: 40rem) { .leaderboard .board tbody th { min-width: 7.2rem; } }
.leaderboard .board small { font-size: 0.7rem; }
"""


def show(_: Any, page: str, source: list[str]) -> None:
    """Put the leaderboard into the front page, when Sphinx has read the source of a page."""
    if page == "index":
        raw = f"\n```{{raw}} html\n{_fragment()}\n```\n"
        source[0] = source[0].replace(_MARK, raw)


def setup(app: Any) -> dict[str, bool]:
    """Register this extension with Sphinx."""
    connect: Callable[..., Any] = app.connect
    connect("source-read", show)
    return {"parallel_read_safe": True}


if __name__ == "__main__":
    print(_fragment())
