"""The failure of a training that diverges."""

from __future__ import annotations


class TrainingDiverged(RuntimeError):
    """The failure of a training: a loss or a weight is not finite."""
