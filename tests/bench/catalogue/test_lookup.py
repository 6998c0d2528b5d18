from __future__ import annotations

from dataclasses import dataclass

import pytest

from bench.catalogue.lookup import find
from data_prep.failures import BadInput


@dataclass(frozen=True)
class Entry:
    id: str


TABLE = (Entry("surface-apss"), Entry("splat"), Entry("blank"))


@pytest.mark.parametrize(
    ("wanted", "hint"),
    [
        ("splta", "did you mean 'splat'? "),
        ("surface", "did you mean 'surface-apss'? "),
        ("Blank", "did you mean 'blank'? "),
        ("", ""),
        ("xyz", ""),
        ("nosuch", ""),
    ],
)
def test_an_unknown_id_is_refused_with_the_nearest_where_one_is_similar(wanted, hint):
    assert find("splat", TABLE, "method") is TABLE[1]
    with pytest.raises(BadInput) as error:
        find(wanted, TABLE, "method")
    assert str(error.value) == (
        f"unknown method '{wanted}': {hint}there are surface-apss, splat, blank"
    )


def test_of_many_five_are_named():
    many = [Entry(f"name-{i}") for i in range(7)]
    with pytest.raises(BadInput) as error:
        find("nosuch", many, "metric")
    assert str(error.value) == (
        "unknown metric 'nosuch': there are name-0, name-1, name-2, name-3, name-4 and 2 more; "
        "see 'bench list'"
    )
