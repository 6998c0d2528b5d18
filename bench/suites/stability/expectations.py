"""Expected outcomes of each method on each case of the suite `stability`.

By default a method is expected to draw images of every case, and where the case names another one
(`Case.like`), the same images as of that. `expectations.csv` states the exceptions.

Of a method that the file does not mention, such as one of another package, any image is accepted,
and any failure that names a stage of the method. An exception of Python, a crash, and an exceeded
limit of time or memory are never accepted of it.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from bench.suites.stability.cases import Case

Kind = Literal["holds", "refused", "differs", "contained", "unexpected"]
# The kinds of outcomes with their meanings, which the tables print.
KINDS: dict[Kind, str] = {
    "holds": "the stated value or invariant",
    "refused": "a named failure, as stated",
    "differs": "the invariant does not hold, as stated",
    "contained": "a defect of a library, as stated; it costs its own item",
    "unexpected": "none of what was stated",
}


# By how much, in grey levels 0..255, images of exactly the same inputs may differ, in the mean over
# all pixels and at most: float32 sums in another order differ by some 1e-6, which now and then
# takes a pixel over the edge between two grey levels.
EXACT_MEAN, EXACT_MOST = 0.01, 1
# The same in the mean where the input is rounded, to 11 bits (float16) or to a thousandth of the
# radius. A point moves by up to 5e-4, which is 0.03 px; means of 0.004 to 0.4 were measured.
ROUNDED_MEAN = 1.0
# The cases whose input is rounded.
ROUNDED = ("float16", "millimetres")


@dataclass(frozen=True)
class Draws:
    """The expectation of finite images of the right shape that are not of one colour."""


@dataclass(frozen=True)
class Agrees:
    """The expectation of the same images as of the case that is named as `like`.

    mean  the largest mean difference over all pixels, in grey levels 0..255
    most  the largest difference of a pixel, in grey levels; None for any
    """

    mean: float
    most: int | None = None


@dataclass(frozen=True)
class Changes:
    """The expectation of other images than of the case named as `like`, against intuition.

    mean  the mean difference over all pixels that is exceeded, in grey levels 0..255
    why   the reason in words
    """

    mean: float
    why: str


@dataclass(frozen=True)
class Fails:
    """The expectation of no images, for a reason that matches a regular expression."""

    reason: str
    kind: Kind = "refused"


@dataclass(frozen=True)
class Either:
    """The expectation of one of several outcomes: rounding or the machine's speed decides which."""

    options: tuple[Expectation, ...]
    why: str


@dataclass(frozen=True)
class NoExpectation:
    """The expectation of any image, or of any failure that names a stage."""


Expectation = Draws | Agrees | Changes | Fails | Either | NoExpectation

_FILE = Path(__file__).with_name("expectations.csv")


def _alternative(word: str, row: Mapping[str, str], reason: str) -> Expectation:
    """Return the expectation that `word` names in a row of the file.

    reason  the part of the row's column "reason" that belongs to this word
    """
    match word:
        case "images":
            return Draws()
        case "agrees":
            most = row["most_change"]
            return Agrees(float(row["mean_change"]), int(most) if most else None)
        case "changes":
            return Changes(float(row["mean_change"]), reason)
        case "fails":
            return Fails(reason)
        case "contained":
            return Fails(reason, "contained")
    raise ValueError(f"{_FILE}: no expectation is called {word!r}")


def _stated(row: Mapping[str, str]) -> Expectation:
    """Return the expectation of a row; where it has several words, any of them is accepted."""
    words = row["expected"].split(" or ")
    reasons = iter(row["reason"].split(" | "))
    with_reason = ("changes", "fails", "contained")
    options = tuple(
        _alternative(word, row, next(reasons) if word in with_reason else "") for word in words
    )
    return options[0] if len(options) == 1 else Either(options, row["remark"])


def _read_expectations() -> dict[str, dict[str, Expectation]]:
    """Return the expectations of `expectations.csv`, by method and case.

    A row is about one or several methods and cases, separated by spaces. A method without
    exceptions has a row without cases. The other columns:

    expected      `images`, `agrees`, `changes`, `fails`, `contained` (see `KINDS`), or several of
                  these with " or " between
    mean_change   the mean difference in grey levels: for `agrees` the largest that is accepted, for
                  `changes` one that has to be exceeded
    most_change   for `agrees` the largest accepted difference of a pixel in grey levels; empty for
                  any
    reason        for `fails` and `contained` a regular expression that the reason of the failure
                  has to match, for `changes` an explanation; of several words separated by " | "
    remark        why several outcomes are accepted; in other rows a remark that nothing prints
    """
    expected: dict[str, dict[str, Expectation]] = {}
    with _FILE.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            for method in row["methods"].split():
                cases = expected.setdefault(method, {})
                for case in row["cases"].split():
                    if case in cases:
                        raise ValueError(f"{_FILE}: {method} has two expectations on {case}")
                    cases[case] = _stated(row)
    return expected


# For each method its exceptions from the default expectation, by case.
EXPECTED: Mapping[str, Mapping[str, Expectation]] = _read_expectations()


def expectation(method: str, case: Case) -> Expectation:
    """Return the expectation for a method and a case."""
    exceptions = EXPECTED.get(method)
    if exceptions is None:
        return NoExpectation()
    if case.id in exceptions:
        return exceptions[case.id]
    if case.like is None:
        return Draws()
    if case.id in ROUNDED:
        return Agrees(ROUNDED_MEAN)
    if case.repetitions > 1:
        return Agrees(EXACT_MEAN)
    return Agrees(EXACT_MEAN, EXACT_MOST)


def in_words(expected: Expectation, like: str | None) -> str:
    """Return an expectation in words for people; `like` is that of its case."""
    match expected:
        case Draws():
            return "images"
        case Agrees(mean, most):
            at_most = "" if most is None else f", at most {most}"
            return f"as {like}: mean change up to {mean:g} grey levels{at_most}"
        case Changes(mean, why):
            return f"not as {like} (mean change above {mean:g}): {why}"
        case Fails(reason):
            return f"failed: {reason.rstrip(': ')}"
        case Either(options, why):
            return " or ".join(in_words(option, like) for option in options) + f" ({why})"
        case NoExpectation():
            return "images or a named failure" + (f", as {like}" if like else "")
