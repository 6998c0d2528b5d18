"""The chairs of the suite `latent`: pairs of different families, and triples with an answer.

A pair differs in structure, as its families do. A - B + C has the right answer D, as A is B with
one change, and D is C with the same change.
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

ALL = "all"  # changes


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
    fits: Callable[[ChairSpec], bool]  # whether a chair can be changed so, and is not so already
    apply: Callable[[ChairSpec], ChairSpec]  # with everything else as it was
    about: str


CHANGES = (
    Change(
        "arms",
        lambda s: (
            not s.arms
            and s.seat != "round"
            and s.family in ("four-leg", "pedestal", "sled", "rocker")
        ),
        lambda s: replace(s, arms=True),
        "arms, where there were none",
    ),
    # After the paper's first example: four legs against a single one on a star.
    Change(
        "pedestal",
        lambda s: s.family == "four-leg" and s.back in ("solid", "curved"),
        lambda s: replace(s, family="pedestal", base="star-5", leg_m=0.05, apron=False),
        "one column on a five-pointed star in place of four legs",
    ),
    Change(
        "slats",
        lambda s: s.back == "solid" and s.family in ("four-leg", "sled"),
        lambda s: replace(s, back="slatted", bars=4),
        "four slats in place of a solid back",
    ),
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
    change = ALL  # of no kind

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
    """Return all of an even number of chairs in pairs, none twice.

    The families of a pair differ, unless one family has more than half of the chairs.
    """
    if len(chairs) % 2:
        raise ValueError(f"choose_pairs: {len(chairs)} chairs cannot be paired")
    shuffled = [chairs[i] for i in rng.permutation(len(chairs))]
    ordered = sorted(shuffled, key=lambda chair: chair.spec.family)  # stable: shuffled within
    # No family of at most half the chairs reaches from a place to that half the chairs further on.
    half = len(ordered) // 2
    pairs = [ChairPair(a, b) for a, b in zip(ordered[:half], ordered[half:], strict=True)]
    return tuple(pairs[i] for i in rng.permutation(half))


def choose_triples(
    chairs: Sequence[SpecifiedChair], count: int, rng: np.random.Generator
) -> tuple[Triple, ...]:
    """Return `count` triples, the changes in turn; no chair is B or C twice.

    Raises BadInput where too few chairs fit.
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
        a, d = (
            SpecifiedChair(f"{chair.id}+{change.id}", change.apply(chair.spec)) for chair in (b, c)
        )
        triples.append(Triple(change.id, a, b, c, d))
    return tuple(triples)
