"""Objects that a test looks at, drawn at random by structural family; read only."""

from __future__ import annotations

import functools

import numpy as np

from data_prep.shapes.catalogue import FAMILIES, NOVEL_FAMILIES
from data_prep.shapes.shape_class import Drawn

Families = dict[str, list[Drawn]]
NOVEL = {f"novel {name}": families for name, families in NOVEL_FAMILIES.items()}


@functools.cache
def of_each_family(name: str, seed: int = 4, count: int = 2) -> Families:
    """That many objects of each family of a class."""
    rng = np.random.default_rng(seed)
    return {
        family: [Drawn(family, tuple(build(rng))) for _ in range(count)]
        for family, (_, build) in (FAMILIES | NOVEL)[name].items()
    }
