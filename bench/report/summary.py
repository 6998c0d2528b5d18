"""The answer of a run in a few lines: who is ahead, what is not decided, below blank, cheapest.

Who is ahead of whom is what `bench compare` says of the two (`bench.analysis.paired.Verdicts`).
Reference methods, settings of a parameter and methods measured for their cost alone do not take
part.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from bench.analysis.comparison import (
    ALL,
    Comparison,
    best_first,
    candidates,
    milliseconds,
    worse_than_blank,
)
from bench.analysis.frontier import places
from bench.analysis.intervals import FEWEST
from bench.analysis.paired import Verdicts
from bench.catalogue.conditions import listed
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import COST_VARIANTS, FLOOR, find_setting
from bench.report.page import Statement

NAMED = 3  # methods named beside each other
ALIKE = 1.1  # costs that differ by a smaller factor are given as one


@dataclass(frozen=True)
class _Cell:
    """A metric at a condition.

    methods  those that compete and drew an image, the best first
    """

    comparison: Comparison
    metric: str
    methods: tuple[str, ...]
    verdicts: Verdicts

    @property
    def at(self) -> tuple[str, str]:
        """Return metric and condition."""
        return self.metric, self.comparison.condition

    @property
    def leader(self) -> str:
        """Return the method with the best mean."""
        return self.methods[0]

    @property
    def decides(self) -> bool:
        """Return whether there are enough objects to show a difference."""
        at = self.metric, self.comparison.condition, self.comparison.class_name
        cells = [self.verdicts.difference(self.leader, m, *at) for m in self.methods[1:]]
        return not cells or any(cell.ahead != "unknown" for cell in cells)

    def shows(self, better: str, worse: str) -> bool:
        """Return whether a method is shown to be better than another."""
        return self.verdicts.shows(better, worse, self.metric, self.comparison)

    @property
    def undecided(self) -> list[str]:
        """Return the methods that are not shown to be behind the leader, the best first."""
        return [m for m in self.methods[1:] if not self.shows(self.leader, m)]

    @property
    def rivals(self) -> list[str]:
        """Return the undecided methods of other families."""
        return [m for m in self.undecided if family_of(m) != family_of(self.leader)]

    @property
    def below_blank(self) -> list[str]:
        """Return the methods that a white image is better than."""
        below = worse_than_blank(self.comparison.qualities[self.metric])
        return [method for method in self.methods if method in below]

    def cheapest(self, views: int) -> str:
        """Return the cheapest method of the frontier that no other is shown to be better than."""
        frontier = {
            point.method
            for point in places(self.comparison, (self.metric,), views, self.verdicts)
            if point.verdict == "frontier"
        }
        unbeaten = [
            m
            for m in self.methods
            if m in frontier and not any(self.shows(o, m) for o in self.methods)
        ]
        cost = {m: self.comparison.cost_ms(m, views).value for m in unbeaten}
        return min(cost, key=cost.__getitem__, default="")


def in_short(
    compared: Sequence[Comparison], metrics: Sequence[str], views: int
) -> tuple[Statement, ...]:
    """Return the answer of a run, line by line.

    Parameters
    ----------
    compared : sequence of Comparison
        A comparison of each condition; of several classes all objects together.
    metrics : sequence of str
        Metrics of images that the comparisons have, the most important first.
    views : int
        Number of views of a cloud.

    Returns
    -------
    tuple of Statement
        A line for each question that the run answers.
    """
    verdicts = Verdicts(compared)
    compared = [_competing(comparison) for comparison in compared]
    cells = [
        _Cell(comparison, metric, methods, verdicts)
        for metric in metrics
        for comparison in compared
        if (methods := _ranked(comparison, metric))
    ]
    if not cells:
        none = "no image of a method that competes was scored, nothing can be said"
        return (Statement("No answer", (((), none),)),)
    every = list(dict.fromkeys(comparison.condition for comparison in compared))
    lines = [*_leads(cells, every)]
    below = [(cell.at, (method,)) for cell in cells for method in cell.below_blank]
    lines.append(_merged(_statement("Below a white image", below, every)))
    lines.append(_cheapest(cells, views, every))
    return tuple(line for line in lines if line.entries)


def _competing(comparison: Comparison) -> Comparison:
    """Return a comparison of the methods that one would choose from, and of blank."""
    of_cost = {method.id for method in COST_VARIANTS}
    chosen = [
        m for m in candidates(comparison.images) if find_setting(m) is None and m not in of_cost
    ]
    images = {m: n for m, n in comparison.images.items() if m in (*chosen, FLOOR)}
    qualities = {
        metric: {m: quality for m, quality in by_method.items() if m in images}
        for metric, by_method in comparison.qualities.items()
    }
    return replace(comparison, images=images, qualities=qualities)


def _ranked(comparison: Comparison, metric: str) -> tuple[str, ...]:
    """Return the methods that compete and drew an image, the best first."""
    by_method = comparison.qualities[metric]
    drew = {m: by_method[m] for m, (n_ok, _) in comparison.images.items() if n_ok and m != FLOOR}
    return tuple(best_first(drew))


def _leads(cells: Sequence[_Cell], every: Sequence[str]) -> Iterable[Statement]:
    """Yield who is ahead, shown or not decided, or why there is nothing to decide."""
    if all(len(cell.methods) == 1 for cell in cells):
        yield Statement("One method", (((cells[0].leader,), "has nothing to be compared with"),))
        return
    if not any(cell.decides for cell in cells):
        first = cells[0].comparison
        objects = objects_in_words(len(first.objects), first.class_name)
        decide = f"{objects} here: at least {FEWEST} are needed"
        yield Statement("Not decided", (((), f"nothing can be shown with {decide}"),))
        by_mean = [(cell.at, (cell.leader,)) for cell in cells]
        yield _statement("Best by its mean alone", by_mean, every)
        return
    shown = [(cell.at, (cell.leader,)) for cell in cells if not cell.rivals]
    yield _statement("Ahead of all other families", shown, every)
    open_cells = [(cell.at, (cell.leader, *cell.rivals)) for cell in cells if cell.rivals]
    yield _statement("Not decided from second place", open_cells, every)
    variants = [
        (cell.at, (cell.leader, *cell.undecided))
        for cell in cells
        if cell.undecided and not cell.rivals
    ]
    yield _statement("Not decided between variants", variants, every)


def objects_in_words(count: int, class_name: str) -> str:
    """Return a number of objects of a class, or of `ALL` classes, with their name."""
    if class_name == ALL or not class_name.isalpha():
        return f"{count} object{'s' * (count != 1)}"
    many = "es" if class_name.endswith(("s", "x", "ch", "sh")) else "s"
    return f"{count} {class_name}{many * (count != 1)}"


def _cheapest(cells: Sequence[_Cell], views: int, every: Sequence[str]) -> Statement:
    deciding = [cell for cell in cells if cell.decides]
    chosen = [(cell, method) for cell in deciding if (method := cell.cheapest(views))]
    statement = _statement(
        "Cheapest that nothing beats", [(cell.at, (method,)) for cell, method in chosen], every
    )
    entries = []
    for methods, where in statement.entries:
        costs = [
            cell.comparison.cost_ms(method, views).value
            for cell, method in chosen
            if (method,) == methods
        ]
        low, high = min(costs), max(costs)
        text = milliseconds(low if high < ALIKE * low else high)
        text = text if high < ALIKE * low else f"{milliseconds(low)} to {text}"
        drawn = f"its {views} views" if views > 1 else "one view"
        entries.append((methods, f"{text} ms for a cloud with {drawn}; {where}"))
    return replace(statement, entries=tuple(entries))


def _merged(statement: Statement) -> Statement:
    """Return a line in which methods with the same places share them."""
    methods: dict[str, tuple[str, ...]] = {}
    for names, text in statement.entries:
        methods[text] = (*methods.get(text, ()), *names)
    return replace(statement, entries=tuple((names, text) for text, names in methods.items()))


def _statement(
    term: str, cells: Iterable[tuple[tuple[str, str], tuple[str, ...]]], every: Sequence[str]
) -> Statement:
    """Return a line of the places (metric, condition) of each group of methods."""
    where: dict[tuple[str, ...], dict[str, list[str]]] = {}
    for (metric, condition), methods in cells:
        where.setdefault(methods, {}).setdefault(metric, []).append(condition)
    entries = []
    for methods, by_metric in where.items():
        by_place: dict[str, list[str]] = {}
        for metric, conditions in by_metric.items():
            by_place.setdefault(listed(conditions, every), []).append(metric)
        parts = [f"{place} ({', '.join(of_place)})" for place, of_place in by_place.items()]
        more = len(methods) - NAMED
        rest = f"and {more} more, " if more > 0 else ""
        entries.append((methods[:NAMED], rest + "; ".join(parts)))
    return Statement(term, tuple(entries))
