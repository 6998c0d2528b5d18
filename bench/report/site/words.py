"""Metrics and methods in words, for people who open a site."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from types import MappingProxyType
from typing import Any

from bench.catalogue.methods import RECOMMENDED, RECOMMENDED_IN_COLOUR, role, training_objects
from bench.catalogue.metrics import IMAGE_METRICS, higher_is_better

_ROLES = {"ceiling": "reference: the true mesh", "floor": "reference: sees no cloud"}


def metric_words(metric: str) -> str:
    """Return the meaning of a metric and its better direction."""
    better = "higher is better" if higher_is_better(metric) else "lower is better"
    return f"{IMAGE_METRICS.get(metric, 'a metric of another package')}; {better}"


def method_words(method_id: str) -> str:
    """Return what a reader has to know beside the name of a method; empty for most."""
    if method_id == RECOMMENDED:
        return "recommended"
    if method_id == RECOMMENDED_IN_COLOUR:
        return "recommended in colours"
    return _ROLES.get(role(method_id), "")


def trained_on(method_id: str, manifest: Mapping[str, Any] = MappingProxyType({})) -> str:
    """Return the objects that a method was trained on, "unknown" where nobody says.

    `manifest` is that of a run which has the method.
    """
    return training_objects(method_id, manifest) or "unknown"


def p_words(value: float) -> str:
    """Return a p value with two digits."""
    return "< .001" if value < 0.001 else f"{value:.2g}".removeprefix("0")


def joined_names(names: Sequence[str]) -> str:
    """Return names as a list in a sentence."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def letter_range(letters: str) -> str:
    """Return letters of a rank, three or more in a row as their ends: "d-g" for "defg"."""
    if not letters.isalpha():  # beyond "z" letters have numbers
        return letters
    runs = groupby(enumerate(letters), key=lambda pair: ord(pair[1]) - pair[0])
    return "".join(_shortened([letter for _, letter in run]) for _, run in runs)


def _shortened(run: Iterable[str]) -> str:
    text = "".join(run)
    return text if len(text) < 3 else f"{text[0]}–{text[-1]}"
