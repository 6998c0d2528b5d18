"""Names of conditions in words, for sentences, axes and heads of columns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from data_prep.clouds.conditions import (
    CONDITIONS,
    GaussianNoise,
    Missing,
    Outliers,
    Perturbation,
    Stride,
    Unchanged,
    UnevenDensity,
)
from data_prep.scene import CLOUD_SIZE

GAP = 0.6  # of a step of an axis, between kinds of conditions


class ConditionName(NamedTuple):
    """The names of a condition; conditions of one kind stand together on an axis.

    kind     the kind of the change; "" for a condition that is not known
    short    name beside others of its kind
    words    name that needs nothing beside it
    """

    kind: str
    short: str
    words: str

    @property
    def brief(self) -> str:
        """Return the name for a narrow column: "noise 5 %", "2,048"."""
        kind = self.kind if self.kind != "points" else ""
        return f"{kind} {self.short}".lstrip()


def condition_name(condition_id: str) -> ConditionName:
    """Return the names of a condition; of one that is not known its id."""
    known = (c.perturbation for c in CONDITIONS if c.id == condition_id)
    return ConditionName(*_names(next(known, None), condition_id))


def condition_words(condition_id: str) -> str:
    """Return a condition in words that need nothing beside them; the id of an unknown one."""
    return condition_name(condition_id).words


def _names(change: Perturbation | None, condition_id: str) -> tuple[str, str, str]:
    match change:
        case Unchanged():
            return "points", f"{CLOUD_SIZE:,}", f"{CLOUD_SIZE:,} points"
        case Stride(step):
            count = -(-CLOUD_SIZE // step)
            return "points", f"{count:,}", f"{count:,} of {CLOUD_SIZE:,} points"
        case GaussianNoise(sigma):
            return "noise", _percent(sigma), f"noise {_percent(sigma)} of the radius"
        case Outliers(share):
            return "outliers", _percent(share), f"{_percent(share)} outliers"
        case Missing(share):
            return "missing", _percent(share), f"{_percent(share)} missing on one side"
        case UnevenDensity(ratio):
            words = f"{CLOUD_SIZE // 2:,} points, {ratio:g} times as dense at one end"
            return "density", f"{ratio:g} : 1", words
        case _:
            return "", condition_id, condition_id


def _percent(share: float) -> str:
    return f"{100 * share:g} %"


def places(conditions: Sequence[str]) -> list[float]:
    """Return places on an axis, a step apart, with a gap where another kind of change begins."""
    kinds = [condition_name(condition).kind for condition in conditions]
    at, gaps = [], 0.0
    for i, kind in enumerate(kinds):
        gaps += GAP * (i > 0 and kind != kinds[i - 1])
        at.append(i + gaps)
    return at


def listed(conditions: Iterable[str], every: Sequence[str]) -> str:
    """Return conditions in words: all of `every` but some, all of a kind, or one by one."""
    chosen = set(conditions)
    if chosen == set(every) and len(every) > 1:
        return "every condition"
    others = [condition for condition in every if condition not in chosen]
    if others and 4 * len(others) <= len(every):
        return f"every condition but {listed(others, every)}"
    by_kind: dict[str, list[str]] = {}
    for condition in every:
        by_kind.setdefault(condition_name(condition).kind, []).append(condition)
    parts = []
    for kind, of_kind in by_kind.items():
        if kind and len(of_kind) > 1 and chosen.issuperset(of_kind):
            parts.append("any number of points" if kind == "points" else f"any {kind}")
        else:
            parts += [condition_words(c) for c in of_kind if c in chosen]
    return ", ".join(parts)
