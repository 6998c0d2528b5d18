"""Who does the jobs of a run: processes of this machine, or a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

from bench.running.executor import Executor
from bench.running.executors import JobPool
from bench.running.options import Options, workers_of
from bench.running.protocol import Protocol
from bench.running.ray import LOCAL, RayPool, connected
from bench.running.ray_node import demands
from bench.running.work import Job, Result
from data_prep.failures import BadInput


@dataclass(frozen=True)
class Workforce:
    """How to begin: `start` gives an executor for so many jobs.

    workers  processes at work at once
    cluster  what it is, for the manifest; None for this machine
    """

    start: Callable[[int], Executor[Job, Result]]
    workers: int
    cluster: dict[str, Any] | None


@contextmanager
def workforce(options: Options, protocol: Protocol) -> Iterator[Workforce]:
    """As wished; connected to the cluster for as long as the block lasts.

    Raises BadInput for wishes that have no meaning, and as `bench.running.ray.connected`.
    """
    suite = protocol.suite
    workers = workers_of(suite, options)
    if options.ray is None:
        start = partial(JobPool, workers=workers, limits=suite.limits)
        yield Workforce(start, workers, None)
        return
    if suite.frontier:
        raise BadInput(f"--ray: has no meaning for the suite {suite.id}, whose times are compared")
    if options.workers is not None and options.ray != LOCAL:
        raise BadInput("--workers: has no meaning with --ray, whose nodes bring theirs; leave it")
    asked = demands(protocol)
    with connected(options.ray, workers) as cluster:
        yield Workforce(
            lambda _: RayPool(cluster, suite.limits, asked), cluster.cpus, asdict(cluster)
        )
