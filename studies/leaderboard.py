"""The leaderboard of the project's own results, on the front page of the documentation.

    python -m studies.leaderboard > leaderboard.html

It is made from `results/docs` by the templates of `bench site`. As an extension of Sphinx it stands
at the mark `<!-- leaderboard -->` of `docs/index.md`, or above its first section.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.comparison import decimals, milliseconds
from bench.analysis.paper import AVERAGE
from bench.analysis.significant_digits import Precision, RoundingErrors, rounding_errors
from bench.catalogue.chosen import BEST_RECONSTRUCTION
from bench.catalogue.condition_names import condition_words
from bench.catalogue.costs import cost_of, view_costs_ms
from bench.catalogue.methods import FLOOR, RECOMMENDED, role
from bench.catalogue.metrics import higher_is_better
from bench.report.page import bundled, rendered
from bench.report.site.board import (
    EMPTY,
    REFERENCES,
    Board,
    BoardCell,
    BoardColumn,
    BoardGroup,
    BoardRow,
    fraction,
    row_kinds,
)
from bench.report.site.site_run import HEADLINE
from bench.report.site.words import method_words, metric_words, trained_on
from bench.tables.grid import FEWER, MOVED
from studies.documents import NUMBERS, VERDICTS
from studies.measurements import differences_of
from studies.printed_digits import Line, line_precision, with_objects

FULL = "2048"
COSTS = "view-costs.csv"
NAMED = {RECOMMENDED, "splat-net@grey"}  # by the front page: never hidden as variants
MARK = "<!-- leaderboard -->"


@dataclass(frozen=True)
class ResultGroup:
    """Two columns of the leaderboard: the headline metrics on a set of objects.

    Attributes
    ----------
    measurement : str
        The name of the measurement (`studies.measurements`), whose values and comparisons with the
        best reconstruction are shown.
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


def board(
    numbers: Path = NUMBERS,
    groups: Sequence[ResultGroup] = GROUPS,
    errors: RoundingErrors | None = None,
) -> Board:
    """Return the leaderboard of the results in a folder.

    Digits are those that survive `errors`, by default the ones of `results/rounding.csv`.
    Methods are sorted by the mean of their places in the columns that they have values in; weights
    that are no method of the package are left out. Raises OSError where a file is missing.
    """
    errors = errors or rounding_errors()
    lines = {g.name: _read(numbers / f"{g.measurement}.csv") for g in groups}
    found_methods = dict.fromkeys(
        line["method"] for of_group in lines.values() for line in of_group
    )
    methods = [
        method
        for method in found_methods
        if any(_value(lines[g.name], g, metric, method) for g in groups for metric in HEADLINE)
        and not method.endswith(".safetensors")
    ]
    values = {
        (group.name, metric): {m: _value(lines[group.name], group, metric, m) for m in methods}
        for group in groups
        for metric in HEADLINE
    }
    ranks = _mean_places(values, methods)
    references = {m for m in methods if role(m) in REFERENCES}
    ordered = sorted(methods, key=lambda m: (m in references, ranks.get(m, math.inf)))
    kinds = row_kinds(ordered, {m: m for m in ordered}, NAMED)
    costs = view_costs_ms(numbers / COSTS)
    rows = []
    for place, method in enumerate(ordered, 1):
        cells = []
        for group in groups:
            verdicts = _verdicts(numbers / differences_of(group.measurement), group, method)
            for metric in HEADLINE:
                of_column = values[group.name, metric]
                digits = _precision(lines[group.name], group, metric, method, errors)
                cells.append(_cell(metric, method, of_column, verdicts.get(metric, ""), digits))
        cost = cost_of(method, costs) if method not in references else None
        cells += [
            BoardCell(f"{ranks[method]:.1f}", ranks[method]) if method in ranks else EMPTY,
            BoardCell(milliseconds(cost), cost) if cost else EMPTY,
            BoardCell("another at each condition" if role(method) else trained_on(method)),
        ]
        competes = method in ranks
        about = method_words(method)
        rows.append(
            BoardRow(place if competes else None, method, tuple(cells), kinds[method], about=about)
        )
    return Board(
        f"The {len(ranks)} methods measured against the truth in grey, by the mean of their places",
        (*map(_columns, groups), BoardGroup(_LAST)),
        tuple(rows),
        (
            "; ".join(f"{metric}: {metric_words(metric)}" for metric in HEADLINE) + ".",
            f"Better, worse, not decided: against {BEST_RECONSTRUCTION}, object by object, p below "
            ".05 after Holm's correction. A failed image is scored as a blank one. "
            " Results has commands, dates and intervals.",
            *([f"{FEWER}."] if any(MOVED in c.text for row in rows for c in row.cells) else []),
        ),
    )


_LAST = (
    BoardColumn("mean place", "of the columns that have a value; stretched to all methods"),
    BoardColumn("ms a view", "a cloud and its first view, on one core of an Intel Xeon"),
    BoardColumn("trained on", "objects that a network was shown", sort="text"),
)


def _columns(group: ResultGroup) -> BoardGroup:
    columns = (BoardColumn(m, metric_words(m), higher=higher_is_better(m)) for m in HEADLINE)
    return BoardGroup(tuple(columns), group.name, group.title)


@cache
def _read(path: Path) -> tuple[Line, ...]:
    with path.open(encoding="utf-8", newline="") as file:
        return tuple(with_objects(csv.DictReader(file), path.name))


def _lines(lines: Sequence[Line], group: ResultGroup, metric: str, method: str) -> list[Line]:
    """Return the line of a value, which is an average over classes where there are several."""
    wanted = {"method": method, "metric": metric, "condition": group.condition}
    of_cell = [line for line in lines if wanted.items() <= line.items()]
    return [line for line in of_cell if line["class"] == AVERAGE] or of_cell


def _precision(
    lines: Sequence[Line], group: ResultGroup, metric: str, method: str, errors: RoundingErrors
) -> Precision | None:
    """Return the digits of a method's value; None without one."""
    of_cell = _lines(lines, group, metric, method)
    return line_precision(of_cell[0], errors) if of_cell else None


def _value(lines: Sequence[Line], group: ResultGroup, metric: str, method: str) -> float | None:
    """Return a method's value, the mean over classes of several; None without one."""
    texts = [
        line["failures_as_blank"] or line["value"] for line in _lines(lines, group, metric, method)
    ]
    return float(np.mean([float(text) for text in texts])) if texts and all(texts) else None


def _mean_places(
    values: Mapping[tuple[str, str], Mapping[str, float | None]], methods: Sequence[str]
) -> dict[str, float]:
    """Return the mean place of each method that competes, 1 for one that is always the best."""
    from scipy.stats import rankdata

    competing = [m for m in methods if role(m) not in REFERENCES]
    places: dict[str, list[float]] = {}
    for (_, metric), of_column in values.items():
        known = {m: v for m in competing if (v := of_column[m]) is not None}
        sign = -1 if higher_is_better(metric) else 1
        ranks = rankdata([sign * round(v, decimals(metric)) for v in known.values()])
        for method, rank in zip(known, ranks, strict=True):
            places.setdefault(method, []).append((rank - 1) / max(len(known) - 1, 1))
    return {m: 1 + (len(places) - 1) * float(np.mean(p)) for m, p in places.items()}


def _verdicts(path: Path, group: ResultGroup, method: str) -> dict[str, str]:
    """Return the outcome of a comparison by metric, of all classes together if several."""
    of_method = [
        line
        for line in _read(path)
        if (line["method_b"], line["condition"]) == (method, group.condition)
    ]
    together = [line for line in of_method if line["class"] == "all"] or of_method
    return {line["metric"]: VERDICTS[line["ahead"]] for line in together}


def _cell(
    metric: str,
    method: str,
    of_column: Mapping[str, float | None],
    verdict: str,
    precision: Precision | None,
) -> BoardCell:
    value, blank = of_column[method], of_column.get(FLOOR)
    if value is None or precision is None:
        return EMPTY
    sign = 1 if higher_is_better(metric) else -1
    competes = role(method) not in REFERENCES
    below = competes and blank is not None and sign * value < sign * blank
    text = MOVED * (precision.half is not None) + fraction(value, precision.decimals)
    return BoardCell(text, value, beneath=verdict, caveat="worse than blank" if below else "")


def fragment() -> str:
    """Return the leaderboard as HTML that stands in a page of Sphinx, with style and script."""
    from markupsafe import Markup

    style = Markup(bundled("site.css") + _STYLE)
    return rendered(
        "site-fragment.html.jinja", board=board(), site_style=style, script=bundled("site.js")
    )


# The names of the site's colours, for the theme's; it changes them in the dark. Its column of text
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
    """Put the leaderboard at its mark in the front page, or above the first section."""
    if page == "index":
        raw = f"```{{raw}} html\n{fragment()}\n```\n"
        head, mark, rest = source[0].partition(MARK)
        if not mark:
            head, mark, rest = source[0].partition("\n## ")
            raw += mark
        source[0] = f"{head}\n{raw}{rest}"


def setup(app: Any) -> dict[str, bool]:
    """Connect the leaderboard to a build of Sphinx."""
    connect: Callable[..., Any] = app.connect
    connect("source-read", show)
    return {"parallel_read_safe": True}


if __name__ == "__main__":
    print(fragment())
