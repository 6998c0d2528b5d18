"""The leaderboard of the project's own results, on the front page of the documentation.

    python -m studies.leaderboard > leaderboard.html

It is made from `results/docs` as the leaderboards of `bench report`. As an extension of Sphinx it
stands at the mark `<!-- leaderboard -->` of `docs/index.md`, or above its first section.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.comparison import milliseconds
from bench.analysis.paper import AVERAGE
from bench.catalogue.chosen import (
    BEST_CLASSICAL,
    CHOSEN,
    MEASURED_ON,
    cost_of,
    measured_methods,
)
from bench.catalogue.conditions import condition_words
from bench.report.board import (
    HEADLINE,
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

FULL = "2048"
_MARK = "<!-- leaderboard -->"


@dataclass(frozen=True)
class ResultGroup:
    """Two columns of the leaderboard: the headline metrics on a set of objects.

    measurement  the name of the measurement (`studies.measurements`), whose values and comparisons
                 with the best classical method are shown
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
    """Return the leaderboard of the results in a folder.

    Methods are sorted by the mean of their places in the columns that they have values in; weights
    that are no method of the package are left out. Raises OSError where a file is missing.
    """
    columns = {group: _group(numbers, group) for group in groups}
    valued = dict.fromkeys(
        line["method"] for g in groups for line in _read(numbers / f"{g.measurement}.csv")
    )
    methods = [
        method
        for method in valued
        if any(method in column.cells for group in columns.values() for column in group.columns)
    ]
    competing = [method for method in methods if not is_reference(method)]
    costs, cell = measured_methods(), ("lpips", FULL)  # a chosen row costs what is it by lpips
    chosen = {name: row.best([cell], methods).get(cell, name) for name, row in CHOSEN.items()}
    cost_cells = {
        method: BoardCell(milliseconds(cost.one_view_ms), cost.one_view_ms)
        for method in competing
        if (cost := cost_of(chosen.get(method, method), costs))
    }
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
        {method: method for method in methods},
        competing,
        (
            f"Better, worse, not decided: against {BEST_CLASSICAL}, object by object, p below "
            ".05 after Holm's correction. A failed image is scored as a blank one. "
            " Results has commands, dates and intervals.",
        ),
    )


def _group(numbers: Path, group: ResultGroup) -> BoardGroup:
    """Return the columns of a group, with weights that are no method of the package left out."""
    lines = _read(numbers / f"{group.measurement}.csv")
    methods = dict.fromkeys(line["method"] for line in lines)
    columns = []
    for metric in HEADLINE:
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
    with path.open(encoding="utf-8", newline="") as file:
        return tuple(csv.DictReader(file))


def _lines(lines: Sequence[Line], group: ResultGroup, metric: str, method: str) -> list[Line]:
    """Return the line of a value, which is an average over classes where there are several."""
    wanted = {"method": method, "metric": metric, "condition": group.condition}
    of_cell = [line for line in lines if wanted.items() <= line.items()]
    return [line for line in of_cell if line["class"] == AVERAGE] or of_cell


def _verdicts(path: Path, group: ResultGroup, metric: str) -> dict[str, str]:
    """Return the outcome of each method's comparison, of all classes together if several."""
    at = {"metric": metric, "condition": group.condition}
    lines = [line for line in _read(path) if at.items() <= line.items()]
    lines.sort(key=lambda line: line["class"] == "all")  # it replaces those of single classes
    return {line["method_b"]: VERDICTS[line["ahead"]] for line in lines}


def _fragment() -> str:
    """Return the leaderboard as HTML that stands in a page of Sphinx, with style and script."""
    return rendered(
        "board-fragment.html.jinja",
        board=board(),
        style=bundled("tables.css") + _STYLE,
    )


# The names of the page's colours, for the theme's; it changes them in the dark. Its column of text
# is 46em wide: heads and words wrap so that the table fits.
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
    """Put the leaderboard at its mark in the front page."""
    if page == "index":
        raw = f"\n```{{raw}} html\n{_fragment()}\n```\n"
        source[0] = source[0].replace(_MARK, raw)


def setup(app: Any) -> dict[str, bool]:
    """Connect the leaderboard to a build of Sphinx."""
    connect: Callable[..., Any] = app.connect
    connect("source-read", show)
    return {"parallel_read_safe": True}


if __name__ == "__main__":
    print(_fragment())
