"""One cell of a table, and how it is shown: what all tables and their Markdown have in common."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

NAN = float("nan")
NO_VALUE = "no value"
PAPER_METHODS = {"surface-apss": "SR", "pc2pix": "PC2PIX", "pc2pix@acgan": "PC2PIX@acgan"}


@dataclass(frozen=True)
class Row:
    """One cell of a table. A number that does not exist is NaN.

    value              over the pictures whose outcome is ok
    ci_low, ci_high    95 % interval over objects
    n_ok, n            pictures that are there and have a value, pictures there should be
    paper              as published, on the paper's data
    failures_as_blank  the value with a blank picture in place of each failed one
    note               why there is no value, or the reasons of the failures and how many pictures
                       have no value though they are there
    objective          what the weights of a network were trained with; empty for other methods
    """

    suite: str
    method: str
    condition: str
    class_name: str
    metric: str
    value: float
    ci_low: float
    ci_high: float
    n_ok: int
    n: int
    paper: float
    failures_as_blank: float
    note: str
    objective: str = ""


HEADER = [name if name != "class_name" else "class" for name in Row.__dataclass_fields__]


def shown(value: float, decimals: int) -> str:
    """A number for people; a dash where there is none."""
    return f"{value:.{decimals}f}" if math.isfinite(value) else "-"


def ordered(values: Iterable[str]) -> list[str]:
    """Each value once, in the order of the first times."""
    return list(dict.fromkeys(values))
