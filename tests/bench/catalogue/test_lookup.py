from __future__ import annotations

from dataclasses import dataclass

import pytest

from bench.catalogue.lookup import find
from data_prep.failures import BadInput


@dataclass(frozen=True)
class Entry:
    id: str


TABLE = (Entry("surface-apss"), Entry("splat"), Entry("blank"))


def test_finds_by_id():
    assert find("splat", TABLE, "method") is TABLE[1]


@pytest.mark.parametrize(
    ("wanted", "nearest"), [("splta", "splat"), ("surface", "surface-apss"), ("Blank", "blank")]
)
def test_suggests_the_nearest(wanted, nearest):
    with pytest.raises(BadInput) as error:
        find(wanted, TABLE, "method")
    assert str(error.value) == (
        f"unknown method '{wanted}': did you mean '{nearest}'? there are surface-apss, splat, blank"
    )


@pytest.mark.parametrize("wanted", ["", "xyz"])
def test_suggests_nothing_far_away(wanted):
    with pytest.raises(BadInput) as error:
        find(wanted, TABLE, "suite")
    assert str(error.value) == f"unknown suite '{wanted}': there are surface-apss, splat, blank"
