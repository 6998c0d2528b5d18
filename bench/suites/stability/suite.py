"""The suite `stability`: the object that its inputs are made of."""

from __future__ import annotations

from dataclasses import dataclass

from bench.catalogue import suites
from bench.catalogue.suites import Limits, Procedure


@dataclass(frozen=True)
class StabilitySuite(Procedure):
    """A suite of extreme inputs with expected outcomes of methods.

    methods     methods that draw `bench.suites.stability.cases.CASES`
    class_name  class of the one procedural test object
    index       number of that object
    limits      for one method on one case
    """

    class_name: str
    index: int
    limits: Limits


STABILITY = StabilitySuite(
    **vars(suites.STABILITY),
    class_name="chair",
    index=0,
    limits=Limits(time_s=60.0, memory_gib=4.0),
)
