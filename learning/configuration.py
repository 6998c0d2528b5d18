"""The part that configurations of all trainings share; command lines load it without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Precision = Literal["float32", "bfloat16"]


@dataclass(frozen=True)
class Cadence:
    """The intervals, in steps, at which something is written."""

    log: int = 10
    sheet: int = 500
    checkpoint: int = 500


DEFAULT_CADENCE = Cadence()
