"""The order in which a run begins its objects: seeded, class by class in turns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from data_prep.randomness import generator


def seeded_turns(names: Iterable[str], seed: int) -> list[str]:
    """Return objects "class/name" in turns: one of each class, another of each...

    Within a class they come in an order that depends on the seed and on their names alone, so that
    it says nothing about results, and neither more objects nor an earlier start change the order of
    the others. Classes keep their order.
    """
    names = list(names)
    classes = {name: name.partition("/")[0] for name in names}
    rank = {name: i for i, name in enumerate(dict.fromkeys(classes.values()))}
    keys = {name: generator(seed, "order of objects", name).random() for name in names}
    turns: Counter[str] = Counter()
    order = []
    for name in sorted(names, key=keys.__getitem__):
        turns[classes[name]] += 1
        order.append((turns[classes[name]], rank[classes[name]], name))
    return [name for _, _, name in sorted(order)]
