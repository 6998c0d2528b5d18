"""Objects that a test looks at, drawn at random and sorted by structural family."""

from __future__ import annotations

import numpy as np

from data_prep.shapes.shape_class import Drawn, ShapeClass

Families = dict[str, list[Drawn]]


def by_family(shape_class: ShapeClass, seed: int, count: int) -> Families:
    """That many objects of a class, each family's in the order in which they were drawn."""
    rng = np.random.default_rng(seed)
    families: Families = {family: [] for family in shape_class.families}
    for _ in range(count):
        drawn = shape_class.draw(rng)
        families[drawn.family].append(drawn)
    return families
