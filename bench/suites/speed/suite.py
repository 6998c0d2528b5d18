"""The suite `speed`: what is timed, and how often."""

from __future__ import annotations

from dataclasses import dataclass

from bench.catalogue import suites
from bench.catalogue.suites import Limits, Procedure

LIMITS = Limits(time_s=600.0, memory_gib=8.0)


@dataclass(frozen=True)
class SpeedSuite(Procedure):
    """The cost of images, which `bench.suites.speed.run` measures.

    Each method is timed in a process of its own for each number of threads.
    """

    # All others are compared with these; the first is the paper's.
    baselines: tuple[str, ...] = ("surface-apss", "surface-fit")
    conditions: tuple[str, ...] = ("2048",)
    class_name: str = "chair"
    # As many as an interval over objects needs. Reconstruction takes seconds a cloud: three rounds
    # leave the whole run at some minutes. What takes milliseconds goes on for `seconds`, so that
    # its median is over more than chance, but not beyond `most_rounds`.
    clouds: int = 8
    views: int = 20  # of each cloud, drawn in one call
    singles: int = 5  # views that are also drawn one by one, in each round
    # Rounds over all clouds that do not count. One: after it libraries have chosen their algorithms
    # for both sizes of a call, and memory is mapped; later rounds were no faster.
    warm_ups: int = 1
    least_rounds: int = 3  # that count
    most_rounds: int = 100
    seconds: float = 3.0  # after which no round begins, once there are `least_rounds`
    amortised: tuple[int, ...] = (1, 2, 5, 10, 20, 50, 100, 500)  # views of the cost an image
    quiet_cores: float = 0.25  # more than these busy with something else: a mark beside the times
    limits: Limits = LIMITS  # of one measurement


SPEED = SpeedSuite(**vars(suites.SPEED))
