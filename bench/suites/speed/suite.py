"""The suite `speed`: what is timed, and how often."""

from __future__ import annotations

from dataclasses import dataclass

from bench.catalogue import suites
from bench.catalogue.suites import Limits, Procedure


@dataclass(frozen=True)
class SpeedSuite(Procedure):
    """The cost of images, which `bench.suites.speed.run` measures.

    methods       timed methods, each in a process of its own for each number of threads
    baselines     methods that all others are compared with; the first is the paper's
    conditions    of the clouds
    class_name    class of the objects
    clouds        objects whose clouds are drawn
    views         views of each cloud, drawn in one call
    singles       views that are also drawn one by one, in each round
    warm_ups      rounds over all clouds that are not counted
    least_rounds  fewest counted rounds over all clouds
    most_rounds   most counted rounds over all clouds
    seconds       time after which no further round begins, once there are `least_rounds`
    amortised     numbers of views that the cost per image is given for
    quiet_cores   more cores than these busy with something else: a warning beside the times
    limits        for one measurement
    """

    baselines: tuple[str, ...]
    conditions: tuple[str, ...]
    class_name: str
    clouds: int
    views: int
    singles: int
    warm_ups: int
    least_rounds: int
    most_rounds: int
    seconds: float
    amortised: tuple[int, ...]
    quiet_cores: float
    limits: Limits


SPEED = SpeedSuite(
    **vars(suites.SPEED),
    baselines=("surface-apss", "surface-fit"),
    conditions=("2048",),
    class_name="chair",
    # As many as an interval over objects needs. Reconstruction takes seconds a cloud: three rounds
    # leave the whole run at some minutes. What takes milliseconds goes on for `seconds`, so that
    # its median is over more than chance, but not beyond `most_rounds`.
    clouds=8,
    views=20,
    singles=5,
    # One: after it libraries have chosen their algorithms for both sizes of a call, and memory is
    # mapped; later rounds were no faster.
    warm_ups=1,
    least_rounds=3,
    most_rounds=100,
    seconds=3.0,
    amortised=(1, 2, 5, 10, 20, 50, 100, 500),
    quiet_cores=0.25,
    limits=Limits(time_s=600.0, memory_gib=8.0),
)
