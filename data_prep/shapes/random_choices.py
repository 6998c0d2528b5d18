"""Random choices of the procedural shapes: weighted choices and ranges."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

T = TypeVar("T")


def pick(rng: np.random.Generator, weights: Mapping[T, float]) -> T:
    """Return a key, as often as its weight says; weights need not add up to 1."""
    values, chances = list(weights), np.cumsum(list(weights.values()))
    place = int(np.searchsorted(chances, rng.random() * chances[-1], side="right"))
    return values[min(place, len(values) - 1)]


def chance(rng: np.random.Generator, probability: float) -> bool:
    """Return True with this probability."""
    return bool(rng.random() < probability)


def uniform(rng: np.random.Generator, low_high: tuple[float, float]) -> float:
    """Return a number between the two."""
    return float(rng.uniform(*low_high))
