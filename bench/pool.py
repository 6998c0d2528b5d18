"""Jobs in killable worker processes: spawned, one library thread each, replaced now and then.

Native libraries hang, leak and crash (see CONTRIBUTING.md); a job that does costs its own records
and nothing else. One thread a worker, whatever their number, so that no result depends on how many
neighbours an item had: sums are taken in the same order.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait

from bench.work import Job, Result, do, failed

JOBS_PER_WORKER = 400  # then a fresh process: what leaks, leaks no further
WORKER_ENVIRONMENT = {
    # One thread a library.
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMEXPR_NUM_THREADS": "1",
    "LP_NUM_THREADS": "1",  # Mesa's software rasteriser
    # MeshLab's APSS reads memory that it has not written: in about half of all processes some
    # vertices end up a rounding error away, and where the surface is ill-conditioned a spike more
    # or less moves SSIM by 0.05. With glibc filling what it hands out (255 is a fill of noughts)
    # and keeping no cache of freed blocks, every process reads the same.
    "GLIBC_TUNABLES": "glibc.malloc.perturb=255:glibc.malloc.tcache_count=0",
}


def run_jobs(
    jobs: Sequence[Job], workers: int, time_limit_s: float
) -> Generator[Result, None, None]:
    """The results of `jobs`, as they come. Closing the iterator stops all workers at once.

    A job that takes longer than `time_limit_s` or whose process dies becomes failed records.
    """
    from pebble import ProcessExpired, ProcessPool

    before = {name: os.environ.get(name) for name in WORKER_ENVIRONMENT}
    os.environ.update(WORKER_ENVIRONMENT)  # read by a spawned worker when it starts
    pool = ProcessPool(
        max_workers=workers,
        max_tasks=JOBS_PER_WORKER,
        initializer=_die_with_parent,
        context=multiprocessing.get_context("spawn"),
    )
    try:
        waiting: dict[Future[Result], Job] = {}
        queue = iter(jobs)
        while True:
            # A short queue: what is scheduled has been pickled, and a run may have 10^5 jobs.
            while len(waiting) < 2 * workers and (job := next(queue, None)) is not None:
                waiting[pool.schedule(do, args=[job], timeout=time_limit_s)] = job  # type: ignore[index]
            if not waiting:
                return
            for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                job = waiting.pop(future)
                try:
                    yield future.result()
                except TimeoutError:
                    yield failed(job, f"timeout: no result within {time_limit_s:g} s")
                except ProcessExpired as error:
                    yield failed(job, f"crash: the worker died (exit code {error.exitcode})")
    finally:
        pool.stop()
        pool.join()
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _die_with_parent() -> None:
    """In a worker: SIGKILL to the run ends it too, even where native code hangs (Linux)."""
    if sys.platform == "linux":
        pr_set_pdeathsig = 1  # linux/prctl.h
        ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)
