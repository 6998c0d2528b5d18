from __future__ import annotations

import numpy as np
import pytest

from data_prep.shapes.random_choices import chance, pick
from data_prep.shapes.shape_class import shape_class
from data_prep.shapes.solids import box

LAST = 1 - 2**-53  # the largest number in [0, 1)


class Fixed(np.random.Generator):
    """A stream whose numbers in [0, 1) are all the same."""

    def __init__(self, number: float) -> None:
        super().__init__(np.random.PCG64(0))
        self._number = number

    def random(self, *args, **kwargs) -> float:  # pyright: ignore[reportIncompatibleMethodOverride]
        return self._number


@pytest.mark.parametrize(
    ("number", "key"),
    [(0.0, "a"), (0.124, "a"), (0.125, "b"), (0.874, "b"), (0.875, "c"), (LAST, "c")],
)
def test_a_key_has_the_share_of_its_weight(number: float, key: str) -> None:
    # An eighth, six eighths, an eighth: weights need not add up to 1, and 0 is never drawn.
    assert pick(Fixed(number), {"0": 0.0, "a": 0.5, "b": 3.0, "c": 0.5, "d": 0.0}) == key


def test_a_chance_is_the_share_of_numbers_below_it() -> None:
    assert [chance(Fixed(number), 0.25) for number in (0.0, 0.249, 0.25)] == [True, True, False]
    assert not chance(Fixed(0.0), 0.0)
    assert chance(Fixed(LAST), 1.0)


def test_a_class_draws_its_family_by_weight_and_then_builds_it() -> None:
    def cube(size: float):
        return lambda rng: [box((0, 0, 0), (size, size, size + rng.uniform()), (120, 121, 122))]

    of_cubes = shape_class("cube", {"small": (0.25, cube(1.0)), "large": (0.75, cube(2.0))})
    assert (of_cubes.name, of_cubes.families) == ("cube", ("small", "large"))
    for number, family, width in ((0.2, "small", 1.0), (0.3, "large", 2.0)):
        drawn = of_cubes.draw(Fixed(number))
        assert drawn.family == family
        assert np.ptp(drawn.parts[0].vertices[:, 0]) == width
