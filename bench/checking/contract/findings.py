"""A finding for each point of a contract."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from bench.running.work import reason_of
from data_prep.failures import BadInput, MissingDependency
from data_prep.scene import View

VIEWS = (View(30.0, 20.0), View(-60.0, -10.0), View(120.0, 35.0))


@dataclass(frozen=True)
class Finding:
    """`ok` is False where something has to be fixed."""

    ok: bool
    subject: str
    text: str


class Broken(Exception):
    """The contract is broken; the message says how."""


def tried(name: str, check: Callable[[], str]) -> Finding:
    """What a check says, or how it fails."""
    try:
        return Finding(True, name, check())
    except (BadInput, MissingDependency, Broken) as error:
        return Finding(False, name, str(error))
    except Exception as error:  # whatever a stranger's function raises
        return Finding(False, name, reason_of(error))
