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
    ],
)
def test_an_unknown_id_is_refused_with_the_nearest_and_all(wanted, hint):
    assert find("splat", TABLE, "method") is TABLE[1]
    with pytest.raises(BadInput) as error:
        find(wanted, TABLE, "method")
    assert str(error.value) == (
        f"unknown method '{wanted}': {hint}there are surface-apss, splat, blank"
    )
