"""What a stability case was expected to do, what it did, and what to call that.

One `Outcome` is one cell of a matrix cases x subjects, whatever the subject is: a method, a metric,
a number format.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal["holds", "refused", "differs", "contained", "unexpected"]
KINDS: dict[Kind, str] = {  # and what they mean, for people
    "holds": "the stated value or invariant",
    "refused": "a named failure, as stated",
    "differs": "the invariant does not hold, as stated",
    "contained": "a defect of a library, as stated; it costs its own item",
    "unexpected": "none of what was stated",
}


@dataclass(frozen=True)
class Outcome:
    """One case on one subject.

    case      kebab-case id, unique within a matrix
    group     what kind of case it is, "outlier" say; cases of a group stand together
    subject   the method, metric or format
    expected  in words: a value with its tolerance, an invariant, or a named failure
    observed  in words; what `expected` is compared with
    kind      the verdict, see `KINDS`
    """

    case: str
    group: str
    subject: str
    expected: str
    observed: str
    kind: Kind
