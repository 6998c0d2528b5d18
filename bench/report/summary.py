"""The answer of a run in a few lines: pc2pix against classical methods, who is ahead, the costs.

Who is ahead of whom is what `bench compare` says of the two (`bench.analysis.paired.Verdicts`).
Reference methods, settings of a parameter and methods measured for their cost alone do not take
part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import pandas as pd

from bench.analysis.comparison import (
    ALL,
    Row,
    best_first,
    candidates,
    is_better,
    milliseconds,
    worse_than_blank,
)
from bench.analysis.frontier import places
from bench.analysis.intervals import FEWEST
from bench.analysis.paired import Verdicts
from bench.analysis.paper import network_of
from bench.catalogue.chosen import BEST_CLASSICAL, CHOSEN
from bench.catalogue.conditions import conditions_in_words
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import COST_VARIANTS, FLOOR, find_setting
from bench.tables.grid import ordered

NAMED = 3  # methods named beside each other
ALIKE = 1.1  # costs that differ by a smaller factor are given as one
# What the network is, by who is ahead and, where there are too few objects, by the means.
SHOWN = {"b": "ahead of {}", "a": "behind {}", "tie": "not shown to differ from {}"}
_BY_MEAN = ("behind {} by its mean alone", "ahead of {} by its mean alone")


class Statement(NamedTuple):
    """A line of the answer; `entries` are (methods, text that follows their names)."""

    term: str
    entries: tuple[tuple[tuple[str, ...], str], ...]


@dataclass(frozen=True)
class _Cell:
    """A metric at a condition, with the methods that compete and drew an image, the best first."""

    rows: Mapping[str, Row]  # of the comparison, by method; of blank, too
    metric: str
    condition: str
    methods: tuple[str, ...]
    verdicts: Verdicts

    def ahead(self, a: str, b: str) -> str:
        at = self.metric, self.condition, self.rows[a]["class"]
        return self.verdicts.difference(a, b, *at)["ahead"]

    @property
    def leader(self) -> str:
        return self.methods[0]

    @property
    def decides(self) -> bool:
        """Return whether there are enough objects to show a difference."""
        ahead = [self.ahead(self.leader, method) for method in self.methods[1:]]
        return not ahead or any(who != "unknown" for who in ahead)

    @property
    def undecided(self) -> tuple[str, ...]:
        """Return the methods that are not shown to be behind the leader, the best first."""
        return tuple(m for m in self.methods[1:] if self.ahead(m, self.leader) != "b")

    @property
    def rivals(self) -> tuple[str, ...]:
        """Return the undecided methods of other families."""
        return tuple(m for m in self.undecided if family_of(m) != family_of(self.leader))

    def cheapest(self, views: int) -> tuple[str, float] | None:
        """Return the cheapest method of the frontier that no other is shown to be better than.

        With its cost, milliseconds; None where there is none.
        """
        points = places(pd.DataFrame(self.rows.values()), views, self.verdicts)
        frontier = points[points["verdict"] == "frontier"].set_index("method")["cost_ms"]
        unbeaten = [
            m
            for m in self.methods
            if m in frontier and not any(self.ahead(m, o) == "b" for o in self.methods if o != m)
        ]
        return min(((m, frontier[m]) for m in unbeaten), key=lambda costed: costed[1], default=None)


def in_short(compared: pd.DataFrame, metrics: Sequence[str], views: int) -> tuple[Statement, ...]:
    """Return the answer of a run, line by line.

    compared  a comparison of one class; of several classes all objects together
    metrics   metrics of images that the comparisons have, the most important first
    views     number of views of a cloud

    A line for each question that the run answers, the paper's first.
    """
    verdicts, every = Verdicts(compared), ordered(compared["condition"])
    of_cost = [method.id for method in COST_VARIANTS]
    chosen = [
        m for m in candidates(compared["method"]) if find_setting(m) is None and m not in of_cost
    ]
    competing = compared[compared["method"].isin([*chosen, FLOOR])]
    cells = []
    for metric, condition in product(metrics, every):
        at = (competing["metric"] == metric) & (competing["condition"] == condition)
        drew = competing[at & (competing["n_ok"] > 0) & (competing["method"] != FLOOR)]
        rows = {row["method"]: row for row in competing[at].to_dict("records")}
        if methods := tuple(best_first(drew)["method"]):
            cells.append(_Cell(rows, metric, condition, methods, verdicts))
    if not cells:
        none = "no image of a method that competes was scored, nothing can be said"
        return (Statement("No answer", (((), none),)),)
    lines = (
        _question(cells, every),
        *_leads(cells, every),
        _below_blank(cells, every),
        _cheapest(cells, views, every),
    )
    return tuple(line for line in lines if line.entries)


def _question(cells: Sequence[_Cell], every: Sequence[str]) -> Statement:
    """Return the paper's question: its network against the best that learns nothing."""
    best = CHOSEN[BEST_CLASSICAL]
    by_words: dict[str, list[_Cell]] = {}
    network = ""
    for cell in cells:
        methods = [method for method in cell.rows if method in cell.methods]
        network = network_of(methods) or network
        surface = next((m for m in methods if m.startswith("surface-")), None)
        at = (cell.metric, cell.condition)
        rival = best.best([at], methods).get(at, surface)
        if network in methods and rival:
            by_mean = _BY_MEAN[is_better(cell.rows[network], cell.rows[rival])]
            words = SHOWN.get(cell.ahead(rival, network), by_mean)
            by_words.setdefault(words.format(rival), []).append(cell)
    entries = [
        ((network,), f"{words} at {text}")
        for words, of_words in by_words.items()
        for _, text in _statement("", lambda cell: (network,), of_words, every).entries
    ]
    return Statement("pc2pix against what learns nothing", tuple(entries))


def _leads(cells: Sequence[_Cell], every: Sequence[str]) -> Iterable[Statement]:
    """Yield who is ahead, shown or not decided, or why there is nothing to decide."""
    if all(len(cell.methods) == 1 for cell in cells):
        yield Statement("One method", (((cells[0].leader,), "has nothing to be compared with"),))
    elif not any(cell.decides for cell in cells):
        first = cells[0].rows[cells[0].leader]
        objects = objects_in_words(len(first["objects"]), first["class"])
        decide = f"{objects} here: at least {FEWEST} are needed"
        yield Statement("Not decided", (((), f"nothing can be shown with {decide}"),))
        yield _statement("Best by its mean alone", lambda cell: (cell.leader,), cells, every)
    else:
        terms: dict[str, Callable[[_Cell], tuple[str, ...]]] = {
            "Ahead of all other families": lambda c: () if c.rivals else (c.leader,),
            "Not decided from second place": lambda c: c.rivals and (c.leader, *c.rivals),
            "Not decided between variants": lambda c: (
                () if c.rivals or not c.undecided else (c.leader, *c.undecided)
            ),
        }
        for term, methods_of in terms.items():
            yield _statement(term, methods_of, cells, every)


def objects_in_words(count: int, class_name: str) -> str:
    """Return a number of objects of a class, or of `ALL` classes, with their name."""
    if class_name == ALL or not class_name.isalpha():
        return f"{count} object{'s' * (count != 1)}"
    many = "es" if class_name.endswith(("s", "x", "ch", "sh")) else "s"
    return f"{count} {class_name}{many * (count != 1)}"


def _below_blank(cells: Sequence[_Cell], every: Sequence[str]) -> Statement:
    """Return the methods that a white image is better than; those with the same places together."""
    methods: dict[str, tuple[str, ...]] = {}
    for method in dict.fromkeys(m for cell in cells for m in cell.methods):
        below = [
            cell
            for cell in cells
            if method in cell.methods
            and method in worse_than_blank(pd.DataFrame(cell.rows.values()))
        ]
        for _, text in _statement("", lambda cell: ("",), below, every).entries:
            methods[text] = (*methods.get(text, ()), method)
    entries = tuple((of_text, text) for text, of_text in methods.items())
    return Statement("Below a white image", entries)


def _cheapest(cells: Sequence[_Cell], views: int, every: Sequence[str]) -> Statement:
    chosen = [(c, *costed) for c in cells if c.decides and (costed := c.cheapest(views))]
    entries = []
    for method in ordered(method for _, method, _ in chosen):
        of_method = [cell for cell, cheapest, _ in chosen if cheapest == method]
        costs = [cost for _, cheapest, cost in chosen if cheapest == method]
        low, high = min(costs), max(costs)
        text = milliseconds(low if high < ALIKE * low else high)
        text = text if high < ALIKE * low else f"{milliseconds(low)} to {text}"
        drawn = f"its {views} views" if views > 1 else "one view"
        ((_, where),) = _statement("", lambda cell: ("",), of_method, every).entries
        entries.append(((method,), f"{text} ms for a cloud with {drawn}; {where}"))
    return Statement("Cheapest that nothing beats", tuple(entries))


def _statement(
    term: str,
    methods_of: Callable[[_Cell], tuple[str, ...]],
    cells: Iterable[_Cell],
    every: Sequence[str],
) -> Statement:
    """Return a line of the places (conditions and metrics) of each group of methods."""
    where: dict[tuple[str, ...], dict[str, list[str]]] = {}
    for cell in cells:
        if methods := methods_of(cell):
            at = where.setdefault(methods, {}).setdefault(cell.metric, [])
            at.append(cell.condition)
    entries = []
    for methods, by_metric in where.items():
        by_place: dict[str, list[str]] = {}
        for metric, conditions in by_metric.items():
            by_place.setdefault(conditions_in_words(conditions, every), []).append(metric)
        parts = [f"{place} ({', '.join(of_place)})" for place, of_place in by_place.items()]
        more = len(methods) - NAMED
        rest = f"and {more} more, " if more > 0 else ""
        entries.append((methods[:NAMED], rest + "; ".join(parts)))
    return Statement(term, tuple(entries))
