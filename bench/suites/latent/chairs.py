"""The chairs of the suite `latent`: pairs of different families, and triples with an answer.

The two chairs of a pair are of different structural families. The sum A - B + C of a triple has
the right answer D, as A is B with one change, and D is C with the same change.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from data_prep.datasets.registry import ProceduralObject, Split
from data_prep.failures import BadInput
from data_prep.scene import Mesh
from data_prep.shapes.chair.chairs import build_chair
from data_prep.shapes.chair.spec import ChairSpec, draw_chair_spec

ALL = "all"  # in place of the name of a change: of all changes together, or of none


@dataclass(frozen=True)
class SpecifiedChair:
    """A procedural chair with its description; the id of a changed one names the change."""

    id: str
    spec: ChairSpec

    def load(self) -> Mesh:
        """Return the normalised mesh."""
        return build_chair(self.spec)


@dataclass(frozen=True)
class Change:
    """A change of a description."""

    id: str
    fits: Callable[[ChairSpec], bool]  # returns whether a chair can have the change and lacks it
    apply: Callable[[ChairSpec], ChairSpec]  # returns the chair with this change and no other
    about: str  # the change in words


def _can_have_arms(chair: ChairSpec) -> bool:
    has_place = chair.seat != "round" and chair.family in ("four-leg", "pedestal", "sled", "rocker")
    return has_place and not chair.arms


def _with_arms(chair: ChairSpec) -> ChairSpec:
    return replace(chair, arms=True)


def _can_have_a_pedestal(chair: ChairSpec) -> bool:
    return chair.family == "four-leg" and chair.back in ("solid", "curved")


def _with_a_pedestal(chair: ChairSpec) -> ChairSpec:
    return replace(chair, family="pedestal", base="star-5", leg_m=0.05, apron=False)


def _can_have_slats(chair: ChairSpec) -> bool:
    return chair.back == "solid" and chair.family in ("four-leg", "sled")


def _with_slats(chair: ChairSpec) -> ChairSpec:
    return replace(chair, back="slatted", bars=4)


CHANGES = (
    Change("arms", _can_have_arms, _with_arms, "arms, where there were none"),
    # The paper's first example: four legs are exchanged for a single one on a star.
    Change(
        "pedestal",
        _can_have_a_pedestal,
        _with_a_pedestal,
        "one column on a five-pointed star in place of four legs",
    ),
    Change("slats", _can_have_slats, _with_slats, "four slats in place of a solid back"),
)


@dataclass(frozen=True)
class Triple:
    """A sum A - B + C and the answer D, where `a` is `b` changed, and `d` is `c` changed."""

    change: str
    a: SpecifiedChair
    b: SpecifiedChair
    c: SpecifiedChair
    d: SpecifiedChair

    @property
    def id(self) -> str:
        """Return the name of the triple: change, B and C, as "arms: test-0001, test-0004"."""
        return f"{self.change}: {self.b.id}, {self.c.id}"


@dataclass(frozen=True)
class ChairPair:
    """The two ends of a path."""

    start: SpecifiedChair
    end: SpecifiedChair
    change = ALL  # the name of the change, as a triple has it; pairs are of one kind

    @property
    def id(self) -> str:
        """Return the names of both ends, as "test-0001, test-0004"."""
        return f"{self.start.id}, {self.end.id}"


def specified_chairs(split: Split, count: int) -> tuple[SpecifiedChair, ...]:
    """Return the first `count` chairs of a split, which is not that of novel families."""
    chairs = (ProceduralObject("chair", split, i) for i in range(count))
    return tuple(
        SpecifiedChair(chair.object_id, draw_chair_spec(chair.random_numbers())) for chair in chairs
    )


def choose_pairs(
    chairs: Sequence[SpecifiedChair], rng: np.random.Generator
) -> tuple[ChairPair, ...]:
    """Return an even number of chairs in pairs; each chair is in one pair.

    The two chairs of a pair are of different families, unless one family has more than half of the
    chairs. Raises ValueError for an odd number.
    """
    if len(chairs) % 2:
        raise ValueError(f"choose_pairs: {len(chairs)} chairs cannot be paired")
    shuffled = [chairs[i] for i in rng.permutation(len(chairs))]
    # Sorting is stable, so that the chairs of a family stay in their random order.
    ordered = sorted(shuffled, key=lambda chair: chair.spec.family)
    # A chair is paired with the one half the list further on. A family with at most half of the
    # chairs does not reach that far.
    half = len(ordered) // 2
    pairs = [ChairPair(a, b) for a, b in zip(ordered[:half], ordered[half:], strict=True)]
    return tuple(pairs[i] for i in rng.permutation(half))


def choose_triples(
    chairs: Sequence[SpecifiedChair], count: int, rng: np.random.Generator
) -> tuple[Triple, ...]:
    """Return `count` triples, which have the changes in turn; no chair is B or C twice.

    Raises BadInput where too few chairs can have a change.
    """
    left = [chairs[i] for i in rng.permutation(len(chairs))]
    triples = []
    for number in range(count):
        change = CHANGES[number % len(CHANGES)]
        fitting = [chair for chair in left if change.fits(chair.spec)][:2]
        if len(fitting) < 2:
            raise BadInput(
                f"{count} triples: no two chairs are left for the change {change.id!r} after "
                f"{number}; choose fewer, or among more than {len(chairs)} chairs"
            )
        b, c = fitting
        left = [chair for chair in left if chair not in (b, c)]
        a = SpecifiedChair(f"{b.id}+{change.id}", change.apply(b.spec))
        d = SpecifiedChair(f"{c.id}+{change.id}", change.apply(c.spec))
        triples.append(Triple(change.id, a, b, c, d))
    return tuple(triples)
