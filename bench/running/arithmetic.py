"""Jobs computed in another arithmetic than the usual one, in the process of a worker."""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from typing import Any

import numpy as np

from bench.records.arithmetic import Arithmetic
from bench.running.isolation import library_threads
from data_prep.rounding import rounded, rounded_at_random
from data_prep.stages import NETWORK, at_stages


def computed(arithmetic: Arithmetic, rng: np.random.Generator) -> AbstractContextManager[object]:
    """Return a context that computes in an arithmetic; `rng` draws rounding modes.

    Raises MissingDependency where the machine has no rounding modes.
    """
    stages = arithmetic.stages
    match arithmetic.kind:
        case "plain" | "one-view":
            return nullcontext()
        case "random":
            choices = random.Random(int(rng.integers(2**63)))
            return at_stages(stages, partial(rounded_at_random, choices))
        case "down" | "up" | "toward-zero" as mode:
            return at_stages(stages, partial(rounded, mode))
        case "two-threads":
            return library_threads(2)
        case "float64" | "bfloat16" | "float16" as name:
            return _number_format(name)


@contextmanager
def _number_format(name: Any) -> Iterator[None]:
    from learning.number_formats import in_format, plain_layouts

    with plain_layouts(), at_stages((NETWORK,), partial(in_format, name)):
        yield
