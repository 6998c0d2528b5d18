"""The seeded order of the objects of a run."""

from __future__ import annotations

from bench.running.turns import seeded_turns

CHAIRS = [f"chair/{i:03d}" for i in range(40)]
CARS = [f"car/{i:03d}" for i in range(3)]


def test_classes_take_turns_and_every_object_comes_once():
    order = seeded_turns([*CHAIRS, *CARS], 0)
    assert sorted(order) == sorted([*CHAIRS, *CARS])
    kinds = [name.partition("/")[0] for name in order]
    assert kinds == ["chair", "car"] * 3 + ["chair"] * 37


def test_the_order_depends_on_seed_and_names_alone():
    order = seeded_turns(CHAIRS, 0)
    assert order != CHAIRS
    assert seeded_turns(reversed(CHAIRS), 0) == order
    assert seeded_turns(CHAIRS, 1) != order
    # objects that are added or left out do not change the order of the others
    assert seeded_turns(CHAIRS[:20], 0) == [name for name in order if name in CHAIRS[:20]]
