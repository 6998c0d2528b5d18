from __future__ import annotations

import functools

import pytest

from data_prep.scene import Mesh
from tests.data_prep.shapes.samples import Families, of_each_family


@pytest.fixture(scope="session")
def drawn():
    """Objects of each family of a class, drawn once: `drawn("chair")["pedestal"]`; read only."""

    @functools.cache
    def of_class(name: str) -> Families:
        return of_each_family(name, seed=4, count=2)

    return of_class


@pytest.fixture(scope="session")
def meshes_of(drawn):
    """Their meshes: `meshes_of("chair")`."""

    @functools.cache
    def of_class(name: str) -> list[Mesh]:
        return [obj.mesh() for family in drawn(name).values() for obj in family]

    return of_class
