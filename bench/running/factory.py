"""The executors that the options of a run ask for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

from bench.catalogue.modules import is_module_name
from bench.records.job import Job, Result
from bench.running.executors import JobPool
from bench.running.isolation import QUEUED, Executor
from bench.running.options import LOCAL, Options, workers_of
from bench.running.protocol import Protocol
from bench.running.ray import RayPool, connected
from data_prep.failures import BadInput


@dataclass(frozen=True)
class ExecutorFactory:
    """The executors of a run: worker processes of this machine, or a cluster.

    Attributes
    ----------
    start : callable
        Returns an executor for a number of jobs.
    workers : int
        Processes at work at once.
    cluster : dict or None
        What the manifest says about the cluster; None for this machine.
    """

    start: Callable[[int], Executor[Job, Result]]
    workers: int
    cluster: dict[str, Any] | None

    @property
    def capacity(self) -> int:
        """Return how many jobs keep the workers busy when the run starts."""
        return QUEUED * max(1, self.workers)


@contextmanager
def executor_factory(options: Options, protocol: Protocol) -> Iterator[ExecutorFactory]:
    """Yield the executors that the options ask for, connected to the cluster within the block.

    Raises BadInput for options that have no meaning, and as `bench.running.ray.connected`.
    """
    suite = protocol.suite
    workers = workers_of(suite, options)
    if options.ray is None:
        start = partial(JobPool, workers=workers, limits=suite.limits)
        yield ExecutorFactory(start, workers, None)
        return
    if suite.timed:
        raise BadInput(
            f"--ray: has no meaning for the suite {suite.id}, whose times are compared; leave it"
        )
    if modules := list(filter(is_module_name, protocol.methods)):
        raise BadInput(
            f"--ray: {modules[0]} is of a module of this machine; install its package on all "
            "nodes, and give the id of its method"
        )
    if options.workers is not None and options.ray != LOCAL:
        raise BadInput("--workers: has no meaning with --ray, whose nodes bring theirs; leave it")
    with connected(options.ray, workers) as cluster:
        yield ExecutorFactory(lambda _: RayPool(cluster, protocol), cluster.cpus, asdict(cluster))
