"""The answer of a run in a few lines: pc2pix against classical methods, who is ahead, the costs.

Who is ahead of whom is what `bench compare` says of the two
(`bench.analysis.differences.Verdicts`).
Reference methods, settings of a parameter and methods measured for their cost alone do not take
part.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from bench.analysis.compare import (
    ALL,
    Row,
    best_first,
    candidates,
    is_better,
    milliseconds,
)
from bench.analysis.differences import Verdicts
from bench.analysis.digits import decimals, is_coarse
from bench.analysis.frontier import frontier_verdicts
from bench.analysis.intervals import FEWEST
from bench.analysis.paper import network_of
from bench.catalogue.chosen import BEST_CLASSICAL, CHOSEN
from bench.catalogue.conditions import condition_name, condition_words, conditions_in_words
from bench.catalogue.methods import COST_VARIANTS, FLOOR, find_setting, role
from bench.catalogue.metrics import higher_is_better
from bench.tables.grid import FEWER, MOVED, number_text, ordered, row_mappings
from bench.tables.quality import best_printed

_Key = tuple[str, str, str]  # method, metric and condition of a cell


# How a method stands in a column: the mark of the page, and what it means.
STANDINGS = {
    "ahead": ("▲", "shown to be ahead of all others"),
    "level": ("=", "not shown to be behind the best"),
    "behind": ("▼", "shown to be behind the best"),
}


def compact_table(rows: pd.DataFrame, standings: Mapping[_Key, str]) -> dict[str, Any] | None:
    """Return the values of the headline, with a column for each metric and condition.

    rows       as `quality_frame` returns them, in the order of `bench.tables.quality.headline`
    standings  as `in_short` returns them

    The best of a column is marked, and what is worse than a white image. None where no method has
    a value.
    """
    rows = rows[~rows["skipped"].astype(bool)]
    if not np.isfinite(rows["value"].astype(float)).any():
        return None
    metrics = ordered(rows["metric"])
    columns = ordered(zip(rows["metric"], rows["condition"], strict=True))
    columns.sort(key=lambda column: metrics.index(column[0]))
    row_of = {(row["method"], row["metric"], row["condition"]): row for row in row_mappings(rows)}
    best: set[_Key] = set()
    for metric in metrics:
        of_metric = row_mappings(rows[rows["metric"] == metric])
        best |= {(method, metric, at) for _, at, method in best_printed(of_metric)}

    caption = f"Best first by {metrics[0]}"
    if len(columns) > len(metrics):
        caption += f", mean over {len(columns) // len(metrics)} conditions"
    heads = []
    for metric, condition in columns:
        name = condition_name(condition)
        kind = name.kind if name.kind != "points" else ""
        heads.append((metric, higher_is_better(metric), kind, name))
    lines = []
    for method in ordered(rows["method"]):
        cells = [_cell(row_of, best, (method, *column)) for column in columns]
        for column, cell in zip(columns, cells, strict=True):
            cell["standing"] = standings.get((method, *column), "")
        lines.append((method, role(method), cells))
    coarse = any(is_coarse(row["metric"], row["images_of"]) for row in row_of.values())
    widths = Counter(metric for metric, _ in columns)
    return {
        "caption": caption,
        "metrics": [(metric, higher_is_better(metric), widths[metric]) for metric in metrics],
        "columns": heads,
        "lines": lines,
        "standings": {name: STANDINGS[name] for name in STANDINGS if name in standings.values()},
        "failed": bool(rows["failed"].any()),
        "coarse": f"{FEWER}. " if coarse else "",
    }


def _cell(rows: Mapping[_Key, Any], best: Container[_Key], key: _Key) -> dict[str, Any]:
    """Return the cell of a method by a metric at a condition; a dash where it has no value."""
    row, (method, metric, condition) = rows.get(key), key
    if row is None or not math.isfinite(row["value"]):
        about = row["note"] if row else "not measured"
        return {"text": "–", "value": None, "about": about, "best": False, "below": False}
    digits = decimals(metric, row["images_of"])
    about = [f"{method}, {metric}, {condition_words(condition)}"]
    if math.isfinite(row["low"]):
        low, high = number_text(row["low"], digits), number_text(row["high"], digits)
        about.append(f"95 % interval {low} to {high}")
    if row["failed"]:
        about.append(f"{row['n_ok']} of {row['n']} images, the others scored as blank ones")
    text = number_text(row["value"], digits)
    if is_coarse(metric, row["images_of"]):
        text = MOVED + text
    if row["failed"]:
        text += "*"
    blank = rows.get((FLOOR, metric, condition))
    return {
        "text": text,
        "value": row["value"],
        "about": "; ".join(about),
        "best": key in best,
        "below": blank is not None and is_better(blank, row),
    }


ALIKE = 1.1  # costs of which the highest is below this multiple of the lowest are given as one
# What is said of the network against a rival, by who is ahead.
SHOWN = {"b": "ahead of {}", "a": "behind {}", "tie": "not shown to differ from {}"}


class Statement(NamedTuple):
    """A line of the answer: what it is about, and entries of (methods, text after their names)."""

    term: str
    entries: tuple[tuple[tuple[str, ...], str], ...]


class Answer(NamedTuple):
    """The lines of an answer, and one of `STANDINGS` by method, metric and condition."""

    lines: tuple[Statement, ...]
    standings: Mapping[_Key, str]


@dataclass(frozen=True)
class _Contest:
    """The methods by one metric at one condition.

    rows     rows of the comparison by method, also of `blank`
    methods  those that compete and have drawn an image, the best first
    """

    rows: Mapping[str, Row]
    metric: str
    condition: str
    methods: tuple[str, ...]
    verdicts: Verdicts

    def ahead(self, a: str, b: str) -> str:
        """Return who of two methods is ahead: "a", "b", "tie" or "unknown"."""
        class_name = self.rows[a]["class"]
        difference = self.verdicts.difference(a, b, self.metric, self.condition, class_name)
        return difference["ahead"]

    @property
    def leader(self) -> str:
        """Return the best method by its mean."""
        return self.methods[0]

    @property
    def decides(self) -> bool:
        """Return whether there are enough objects to show a difference."""
        ahead = [self.ahead(self.leader, method) for method in self.methods[1:]]
        return not ahead or any(who != "unknown" for who in ahead)

    def standing(self, method: str) -> str | None:
        """Return whether a method is "ahead" of all others, "level" with the best or "behind" it.

        Level are those that are not shown to be behind. None where nothing is shown of the two.
        """
        if method == self.leader:
            others = {self.ahead(method, other) for other in self.methods[1:]}
            if others <= {"unknown"}:
                return None
            return "ahead" if others == {"a"} else "level"
        return {"b": "behind", "tie": "level"}.get(self.ahead(method, self.leader))

    def cheapest(self, views: int) -> tuple[str, float] | None:
        """Return the cheapest method that no other is shown to be better than, and its cost in ms.

        Only methods on the frontier are considered. None where there is none.
        """
        points = frontier_verdicts(pd.DataFrame(self.rows.values()), views, self.verdicts)
        frontier = points[points["verdict"] == "frontier"].set_index("method")["cost_ms"]
        unbeaten = [m for m in self.methods if m in frontier and not self._is_beaten(m)]
        cheapest = min(unbeaten, key=frontier.__getitem__, default=None)
        return None if cheapest is None else (cheapest, frontier[cheapest])

    def _is_beaten(self, method: str) -> bool:
        """Return whether any other method is shown to be better."""
        others = [other for other in self.methods if other != method]
        return any(self.ahead(method, other) == "b" for other in others)


def in_short(compared: pd.DataFrame, metrics: Sequence[str], views: int) -> Answer:
    """Return the answer of a run: its lines, and how each method stands in each column.

    compared  a comparison of one class; of several classes that of all objects together
    metrics   metrics of images that the comparison has, the most important first
    views     number of views of a cloud

    It has a line for each question that the run answers, first which method is the best.
    """
    verdicts, every = Verdicts(compared), ordered(compared["condition"])
    for_cost_alone = [method.id for method in COST_VARIANTS]
    considered = [
        method
        for method in candidates(compared["method"])
        if find_setting(method) is None and method not in for_cost_alone
    ]
    competing = compared[compared["method"].isin([*considered, FLOOR])]
    contests = []
    for metric, condition in product(metrics, every):
        rows = competing[(competing["metric"] == metric) & (competing["condition"] == condition)]
        drew = rows[(rows["n_ok"] > 0) & (rows["method"] != FLOOR)]
        methods = tuple(best_first(drew)["method"])
        if methods:
            by_method = {row["method"]: row for row in rows.to_dict("records")}
            contests.append(_Contest(by_method, metric, condition, methods, verdicts))
    if not contests:
        none = "no image of a method that competes was scored, nothing can be said"
        return Answer((Statement("No answer", (((), none),)),), {})
    lines = (
        _best(contests, every),
        _question(contests, every),
        _undecided(contests),
        _cheapest(contests, views, every),
    )
    standings = {
        (method, contest.metric, contest.condition): standing
        for contest in contests
        for method in contest.methods
        if (standing := contest.standing(method))
    }
    return Answer(tuple(line for line in lines if line.entries), standings)


def _best(contests: Sequence[_Contest], every: Sequence[str]) -> Statement:
    """Return which methods have the best means, by which metrics and where."""
    by_leader: dict[str, list[_Contest]] = {}
    for contest in contests:
        by_leader.setdefault(contest.leader, []).append(contest)
    entries = [((leader,), _where(led, every)) for leader, led in by_leader.items()]
    return Statement("Best mean", tuple(entries))


def _question(contests: Sequence[_Contest], every: Sequence[str]) -> Statement:
    """Return the answer to the paper's question: its network against the best that learns nothing.

    That rival is `best-classical` of the catalogue, or else surface reconstruction.
    """
    best_classical = CHOSEN[BEST_CLASSICAL]
    by_words: dict[str, list[_Contest]] = {}
    network = ""
    for contest in contests:
        methods = [method for method in contest.rows if method in contest.methods]
        network = network_of(methods) or network
        surface = next((method for method in methods if method.startswith("surface-")), None)
        key = (contest.metric, contest.condition)
        rival = best_classical.best([key], methods).get(key, surface)
        ahead = contest.ahead(rival, network) if network in methods and rival else ""
        if ahead in SHOWN:
            by_words.setdefault(SHOWN[ahead].format(rival), []).append(contest)
    entries = [
        ((network,), f"{words} at {_where(of_words, every)}")
        for words, of_words in by_words.items()
    ]
    return Statement("pc2pix against what learns nothing", tuple(entries))


def _undecided(contests: Sequence[_Contest]) -> Statement:
    """Return why nothing can be decided; a line without entries where something can."""
    first = contests[0].rows[contests[0].leader]
    objects = objects_in_words(len(first["objects"]), first["class"])
    why = f"nothing can be shown with {objects} here: at least {FEWEST} are needed"
    decided = any(contest.decides for contest in contests)
    return Statement("Not decided", () if decided else (((), why),))


def counted(count: int, noun: str, many: str = "s") -> str:
    """Return a number with its noun, which has the end `many` unless the number is 1."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}{many}"


def objects_in_words(count: int, class_name: str) -> str:
    """Return a number of objects of a class, or of `ALL` classes, with their name."""
    if class_name == ALL or not class_name.isalpha():
        return counted(count, "object")
    many = "es" if class_name.endswith(("s", "x", "ch", "sh")) else "s"
    return counted(count, class_name, many)


def _cheapest(contests: Sequence[_Contest], views: int, every: Sequence[str]) -> Statement:
    """Return the cheapest method that nothing beats in each contest, with its cost."""
    won: dict[str, list[tuple[_Contest, float]]] = {}
    for contest in contests:
        cheapest = contest.cheapest(views) if contest.decides else None
        if cheapest is not None:
            method, cost_ms = cheapest
            won.setdefault(method, []).append((contest, cost_ms))
    drawn = f"its {views} views" if views > 1 else "one view"
    entries = []
    for method, of_method in won.items():
        costs = [cost_ms for _, cost_ms in of_method]
        low, high = min(costs), max(costs)
        if high < ALIKE * low:
            text = milliseconds(low)
        else:
            text = f"{milliseconds(low)} to {milliseconds(high)}"
        where = _where([contest for contest, _ in of_method], every)
        entries.append(((method,), f"{text} ms for a cloud with {drawn}; {where}"))
    return Statement("Cheapest not shown to be behind any", tuple(entries))


def _where(contests: Iterable[_Contest], every: Sequence[str]) -> str:
    """Return the conditions and metrics of contests in words: "every condition (ssim, lpips)"."""
    by_metric: dict[str, list[str]] = {}
    for contest in contests:
        by_metric.setdefault(contest.metric, []).append(contest.condition)
    by_conditions: dict[str, list[str]] = {}
    for metric, conditions in by_metric.items():
        by_conditions.setdefault(conditions_in_words(conditions, every), []).append(metric)
    parts = [
        f"{conditions} ({', '.join(metrics)})" for conditions, metrics in by_conditions.items()
    ]
    return "; ".join(parts)
