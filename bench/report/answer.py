"""The answer of a run in a few lines: pc2pix against classical methods, who is ahead, the costs.

Who is ahead of whom is what `bench compare` says of the two
(`bench.analysis.differences.Verdicts`).
Reference methods, settings of a parameter and methods measured for their cost alone do not take
part.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
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
    worse_than_blank,
)
from bench.analysis.differences import Verdicts
from bench.analysis.digits import decimals, is_coarse
from bench.analysis.frontier import frontier_verdicts
from bench.analysis.intervals import FEWEST
from bench.analysis.paper import network_of
from bench.catalogue.chosen import BEST_CLASSICAL, CHOSEN
from bench.catalogue.conditions import condition_name, condition_words, conditions_in_words
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import COST_VARIANTS, FLOOR, find_setting, role
from bench.catalogue.metrics import higher_is_better
from bench.tables.grid import MOVED, number_text, ordered, row_mappings
from bench.tables.quality import best_printed

_Key = tuple[str, str, str]  # method, metric and condition of a cell


def compact_table(rows: pd.DataFrame) -> dict[str, Any] | None:
    """Return the values of the headline, with a column for each metric and condition.

    rows  as `quality_frame` returns them

    The best by the first metric stand first, the reference methods last. The best of a column is
    marked, and what is worse than a white image. None where no method has a value.
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

    def sort_key(method: str) -> tuple[bool, float]:
        is_reference = role(method) in ("ceiling", "floor")
        of_first = [row_of.get((method, metrics[0], condition)) for _, condition in columns]
        mean = _mean_printed(metrics[0], [row for row in of_first if row])
        if math.isnan(mean):
            return is_reference, math.inf
        return is_reference, -mean if higher_is_better(metrics[0]) else mean

    methods = sorted(ordered(rows["method"]), key=sort_key)
    caption = f"Best first by {metrics[0]}"
    if len(columns) > len(metrics):
        caption += f", mean over {len(columns) // len(metrics)} conditions"
    heads = []
    for metric, condition in columns:
        name = condition_name(condition)
        kind = name.kind if name.kind != "points" else ""
        heads.append((metric, higher_is_better(metric), kind, name))
    lines = []
    for method in methods:
        cells = [_cell(row_of, best, (method, *column)) for column in columns]
        lines.append((method, role(method), cells))
    widths = Counter(metric for metric, _ in columns)
    return {
        "caption": caption,
        "metrics": [(metric, higher_is_better(metric), widths[metric]) for metric in metrics],
        "columns": heads,
        "lines": lines,
        "failed": bool(rows["failed"].any()),
        "coarse": any(is_coarse(row["metric"], row["images_of"]) for row in row_of.values()),
    }


def _mean_printed(metric: str, rows: Sequence[Mapping[str, Any]]) -> float:
    """Return the mean of the values in the digits that are printed; NaN where there is none."""
    values = [round(row["value"], decimals(metric, row["images_of"])) for row in rows]
    finite = [value for value in values if math.isfinite(value)]
    return float(np.mean(finite)) if finite else math.nan


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


NAMED = 3  # methods that are named beside each other; the others are counted
ALIKE = 1.1  # costs of which the highest is below this multiple of the lowest are given as one
# What is said of the network against a rival, by who is ahead.
SHOWN = {"b": "ahead of {}", "a": "behind {}", "tie": "not shown to differ from {}"}


class Statement(NamedTuple):
    """A line of the answer: what it is about, and entries of (methods, text after their names)."""

    term: str
    entries: tuple[tuple[tuple[str, ...], str], ...]


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

    @property
    def undecided(self) -> tuple[str, ...]:
        """Return the methods that are not shown to be behind the leader, the best first."""
        return tuple(m for m in self.methods[1:] if self.ahead(m, self.leader) != "b")

    @property
    def rivals(self) -> tuple[str, ...]:
        """Return those of other families than the leader that are not shown to be behind it."""
        return tuple(m for m in self.undecided if family_of(m) != family_of(self.leader))

    def clear_leader(self) -> tuple[str, ...]:
        """Return the leader where it is shown to be ahead of all other families, else nothing."""
        return () if self.rivals else (self.leader,)

    def undecided_families(self) -> tuple[str, ...]:
        """Return the leader and its rivals; nothing where it has none."""
        return (self.leader, *self.rivals) if self.rivals else ()

    def undecided_variants(self) -> tuple[str, ...]:
        """Return the leader and variants of it that it is not shown to be ahead of.

        Nothing where there are none, or where a method of another family is undecided as well.
        """
        if self.rivals or not self.undecided:
            return ()
        return (self.leader, *self.undecided)

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


def in_short(compared: pd.DataFrame, metrics: Sequence[str], views: int) -> tuple[Statement, ...]:
    """Return the answer of a run, line by line.

    compared  a comparison of one class; of several classes that of all objects together
    metrics   metrics of images that the comparison has, the most important first
    views     number of views of a cloud

    It has a line for each question that the run answers, the paper's first.
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
        return (Statement("No answer", (((), none),)),)
    lines = (
        _question(contests, every),
        *_leads(contests, every),
        _below_blank(contests, every),
        _cheapest(contests, views, every),
    )
    return tuple(line for line in lines if line.entries)


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
        if network in methods and rival:
            words = _against(contest, network, rival)
            by_words.setdefault(words, []).append(contest)
    entries = [
        ((network,), f"{words} at {_where(of_words, every)}")
        for words, of_words in by_words.items()
    ]
    return Statement("pc2pix against what learns nothing", tuple(entries))


def _against(contest: _Contest, network: str, rival: str) -> str:
    """Return how the network does against a rival; by the means where objects are too few."""
    ahead = contest.ahead(rival, network)
    if ahead in SHOWN:
        return SHOWN[ahead].format(rival)
    if is_better(contest.rows[network], contest.rows[rival]):
        return f"ahead of {rival} by its mean alone"
    return f"behind {rival} by its mean alone"


def _leads(contests: Sequence[_Contest], every: Sequence[str]) -> Iterable[Statement]:
    """Yield who is ahead, where that is shown and where not, or why nothing can be decided."""
    leader = contests[0].leader
    if all(len(contest.methods) == 1 for contest in contests):
        yield Statement("One method", (((leader,), "has nothing to be compared with"),))
    elif not any(contest.decides for contest in contests):
        first = contests[0].rows[leader]
        objects = objects_in_words(len(first["objects"]), first["class"])
        decide = f"{objects} here: at least {FEWEST} are needed"
        yield Statement("Not decided", (((), f"nothing can be shown with {decide}"),))
        yield _statement("Best by its mean alone", lambda at: (at.leader,), contests, every)
    else:
        ahead, families, variants = (
            "Ahead of all other families",
            "Not decided from second place",
            "Not decided between variants",
        )
        yield _statement(ahead, _Contest.clear_leader, contests, every)
        yield _statement(families, _Contest.undecided_families, contests, every)
        yield _statement(variants, _Contest.undecided_variants, contests, every)


def counted(count: int, noun: str, many: str = "s") -> str:
    """Return a number with its noun, which has the end `many` unless the number is 1."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}{many}"


def objects_in_words(count: int, class_name: str) -> str:
    """Return a number of objects of a class, or of `ALL` classes, with their name."""
    if class_name == ALL or not class_name.isalpha():
        return counted(count, "object")
    many = "es" if class_name.endswith(("s", "x", "ch", "sh")) else "s"
    return counted(count, class_name, many)


def _below_blank(contests: Sequence[_Contest], every: Sequence[str]) -> Statement:
    """Return the methods that a white image is better than, and where that is so."""
    methods_by_text: dict[str, tuple[str, ...]] = {}
    for method in dict.fromkeys(method for contest in contests for method in contest.methods):
        below = []
        for contest in contests:
            if method not in contest.methods:
                continue
            if method in worse_than_blank(pd.DataFrame(contest.rows.values())):
                below.append(contest)
        if below:
            text = _where(below, every)
            methods_by_text[text] = (*methods_by_text.get(text, ()), method)
    entries = tuple((methods, text) for text, methods in methods_by_text.items())
    return Statement("Below a white image", entries)


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
    return Statement("Cheapest that nothing beats", tuple(entries))


def _statement(
    term: str,
    methods_of: Callable[[_Contest], tuple[str, ...]],
    contests: Iterable[_Contest],
    every: Sequence[str],
) -> Statement:
    """Return a line with an entry for each group of methods: at which conditions, by which metrics.

    methods_of  returns the methods that a contest names, none where it has no part in the line
    every       all conditions of the run, in their order
    """
    by_methods: dict[tuple[str, ...], list[_Contest]] = {}
    for contest in contests:
        if methods := methods_of(contest):
            by_methods.setdefault(methods, []).append(contest)
    entries = []
    for methods, of_methods in by_methods.items():
        text = _where(of_methods, every)
        if len(methods) > NAMED:
            text = f"and {len(methods) - NAMED} more, {text}"
        entries.append((methods[:NAMED], text))
    return Statement(term, tuple(entries))


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
