"""The arithmetics of the suite `rounding`: in which each method draws each condition."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from bench.catalogue.methods import Method
from bench.catalogue.suites import RoundingSuite
from bench.records.arithmetic import FORMATS, INPUT, PLAIN, SEPARATOR, Arithmetic, Kind
from bench.records.job import Job
from bench.running.plan import digest
from data_prep.stages import METRICS, NETWORK

ARITHMETICS_VERSION = 1  # raise when an arithmetic of the same id computes otherwise
ALONE: tuple[Kind, ...] = ("down", "up", "toward-zero", "two-threads", "one-view")
CHAIN = ("normals", "ball-pivoting", "close-holes", "apss")
STAGES = {  # by the family of a method, between the input and the metrics, in order
    "surface-apss": (*CHAIN, "draw"),
    "surface-fit": (*CHAIN, "draw"),
    "surface-bpa": (*CHAIN[:-1], "draw"),
    "alpha-wrap": ("alpha-wrap", "draw"),
    "denoised-wrap": ("alpha-wrap", "draw"),
    "fused-net": ("alpha-wrap", NETWORK),
    "occupancy-net": (NETWORK, "draw"),
}


def stages_of(method: Method) -> tuple[str, ...]:
    """Return the stages of a method whose rounding is told apart, in the order of the work."""
    usual = (NETWORK,) if method.kind == "network" else ("prepare", "draw")
    input_ = (INPUT,) if method.sees_cloud else ()
    return (*input_, *STAGES.get(method.family, usual), METRICS)


def arithmetics(method: Method, condition: str, suite: RoundingSuite) -> Iterator[Arithmetic]:
    """Yield the arithmetics that a method is repeated in at a condition, the plain one first."""
    if not method.sees_cloud and condition != suite.base.conditions[0]:
        return  # the same images whatever the condition
    yield PLAIN
    yield from (Arithmetic("random", (), n) for n in range(suite.repetitions))
    if condition not in suite.told_apart:
        return
    yield from map(Arithmetic, ALONE)
    if method.kind == "network":
        yield from map(Arithmetic, FORMATS)
    for stage in stages_of(method):
        yield from (Arithmetic("random", (stage,), n) for n in range(suite.stage_repetitions))


def repeated(job: Job, arithmetic: Arithmetic) -> Job:
    """Return a job of another suite, computed in an arithmetic."""
    return replace(
        job,
        key=digest([job.key, ARITHMETICS_VERSION, arithmetic.id]),
        condition=f"{job.condition}{SEPARATOR}{arithmetic.id}",
        arithmetic=arithmetic,
        batch=1 if arithmetic.kind == "one-view" else None,
    )
