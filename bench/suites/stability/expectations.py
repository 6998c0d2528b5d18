"""Expected outcomes of each method on each case of the suite `stability`.

`expectations.csv` has what is not plainly expected of a method: images of every case, and the same
images as those of the plain cloud where the case says so.

A method without a statement, which is one of another package, may draw any image and may fail with
any name; an exception of Python, a crash, a time or memory limit is never expected of it.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from bench.suites.stability.cases import Case

Kind = Literal["holds", "refused", "differs", "contained", "unexpected"]
KINDS: dict[Kind, str] = {  # with their meanings, which the tables print
    "holds": "the stated value or invariant",
    "refused": "a named failure, as stated",
    "differs": "the invariant does not hold, as stated",
    "contained": "a defect of a library, as stated; it costs its own item",
    "unexpected": "none of what was stated",
}


# Tolerance of an agreement of exactly the same inputs: float32 sums in another order differ by some
# 1e-6, which now and then takes a pixel over the edge between two grey levels.
EXACT_MEAN, EXACT_MOST = 0.01, 1
# The input is rounded, to 11 bits (float16) or to a thousandth of the radius. A point moves by up
# to 5e-4, which is 0.03 px; measured means were 0.004 to 0.4 grey levels.
ROUNDED_MEAN = 1.0
ROUNDED = ("float16", "millimetres")


@dataclass(frozen=True)
class Draws:
    """The expectation of images of the right shape, finite, none of one colour throughout."""


@dataclass(frozen=True)
class Agrees:
    """The expectation of the images of the case's `like`, to within grey levels 0..255."""

    mean: float
    most: int | None = None


@dataclass(frozen=True)
class Changes:
    """The expectation of images that differ from the case's `like`, against intuition."""

    mean: float
    why: str


@dataclass(frozen=True)
class Fails:
    """The expectation of no images, for a reason that matches a regular expression."""

    reason: str
    kind: Kind = "refused"


@dataclass(frozen=True)
class Either:
    """The expectation of one of several, decided by rounding or the machine's speed."""

    options: tuple[Expectation, ...]
    why: str


@dataclass(frozen=True)
class NoExpectation:
    """The expectation of any image, or any failure with a name."""


Expectation = Draws | Agrees | Changes | Fails | Either | NoExpectation

_FILE = Path(__file__).with_name("expectations.csv")


def _alternative(word: str, row: Mapping[str, str], reason: str) -> Expectation:
    """Return one expectation of a row of the file; `reason` is its own part of that column."""
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
    """Return the expectation of a row: one, or several of which any may come."""
    words = row["expected"].split(" or ")
    reasons = iter(row["reason"].split(" | "))
    with_reason = ("changes", "fails", "contained")
    options = tuple(
        _alternative(word, row, next(reasons) if word in with_reason else "") for word in words
    )
    return options[0] if len(options) == 1 else Either(options, row["remark"])


def _read_expectations() -> dict[str, dict[str, Expectation]]:
    """Return the expectations of `expectations.csv`, by method and case.

    A row is of several methods and cases, with spaces between; a method without exceptions has a
    row without cases. Its columns:

    expected      `images`, `agrees`, `changes`, `fails`, `contained` (see `KINDS`), or several of
                  these with " or " between
    mean_change   of `agrees` the largest, of `changes` the smallest mean difference, grey levels
    most_change   of `agrees` the largest difference of a pixel, grey levels; empty: any
    reason        of `fails` and `contained` a regular expression, of `changes` why; " | " between
                  those of several
    remark        why several are expected; of others a remark for readers, which nothing prints
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


# By method, its cases that are not simply drawn, or do not simply agree.
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
