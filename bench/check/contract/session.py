"""The steps of a test of a plug-in, which run in a worker that can be killed.

An exception, a call of exit(), a signal and a hang of the worker become findings. This module and
`targets` import no heavy package, so that one that is loaded afterwards is the plug-in's.
"""

from __future__ import annotations

import math
import os
import resource
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from bench.catalogue.suites import Limits
from bench.check.contract.findings import ContractViolation, Finding
from bench.running.pool import TaskPool, WorkerFailure
from data_prep.failures import BadInput, MissingDependency

# The exit status of a worker in which the plug-in called os._exit(0): any that nothing else uses.
_EXIT_STATUS = 86
_MOST_SLOWED = 5.0  # how many times as long a step may take on a busy machine
_MOST_DEATHS = 3  # workers that a plug-in may end before its test is given up


class Passed(NamedTuple):
    """The result of a check that passed: its text, and what it found out for later steps."""

    text: str
    evidence: Any = None


@dataclass(frozen=True)
class CheckStep:
    """A step of a test, which checks one point of a contract.

    subject  the name of the point in the finding
    check    the function that a worker calls with the name of the plug-in. It raises
             ContractViolation, or any exception of the plug-in. As it is pickled, it is a function
             of a module, or a partial of one
    blocks   whether a run would fail or have false results where the point is not kept
    """

    subject: str
    check: Callable[[str], Passed]
    blocks: bool = True


class _StepTask(NamedTuple):
    """A step of the test of a plug-in, with the seconds of processor time that it may take."""

    step: CheckStep
    name: str
    processor_s: float


@dataclass(frozen=True)
class Report:
    """The finding of a step.

    evidence     what the step found out for later steps
    is_last      whether no further step is tried, as after a hang or with a missing library
    processor_s  the processor time of the step, seconds; 0 where its worker died
    """

    step: CheckStep
    finding: Finding
    evidence: Any = None
    is_last: bool = False
    processor_s: float = 0.0


def perform(
    name: str,
    steps: Sequence[CheckStep],
    limits: Limits,
    until: float,
    environment: Mapping[str, str],
) -> Iterator[Report]:
    """Yield the report of each step, in their order.

    One worker does all steps; where a step ends it, the next step gets a new one. No step follows a
    report with `is_last`, the death of _MOST_DEATHS workers, or the time `until` of
    `time.monotonic`. `limits.time_s` is processor time, of which a busy machine gives a worker
    little: only after _MOST_SLOWED times as long by the clock a step is ended as one that hangs.
    """
    deaths, by_clock = 0, replace(limits, time_s=_MOST_SLOWED * limits.time_s)
    with tempfile.TemporaryDirectory(prefix=".bench-test-") as temporary:
        around = {**environment, "TMPDIR": temporary}
        with closing(TaskPool(execute, 1, by_clock, around)) as pool:
            for step in steps:
                pool.submit(_StepTask(step, name, limits.time_s))
                try:
                    ended = list(pool.wait_any(until - time.monotonic()))
                except BrokenProcessPool as error:
                    ended = [(None, WorkerFailure("crash", str(error)))]
                    deaths = _MOST_DEATHS
                if not ended:  # the time is over: closing the pool kills the worker
                    return
                ((_, result),) = ended
                if isinstance(result, WorkerFailure):
                    result, deaths = _report_of_death(step, result, limits), deaths + 1
                yield result
                if result.is_last or deaths >= _MOST_DEATHS:
                    return


def _report_of_death(step: CheckStep, lost: WorkerFailure, limits: Limits) -> Report:
    """Return the report of a step whose worker was killed or has died."""
    reason = lost.reason
    if too_long := signal.SIGXCPU.name in reason:
        reason = f"timeout: no result within {limits.time_s:g} s of processor time"
    if f"exit code {_EXIT_STATUS})" in reason:
        reason = "crash: os._exit(0) was called"
    finding = Finding(False, step.subject, reason, step.blocks)
    return Report(step, finding, is_last=too_long or lost.kind == "timeout")


def execute(task: _StepTask) -> Report:
    """Carry out a step, in a worker."""
    _mark_exits()
    folder, start = Path.cwd(), time.process_time()
    # At the soft limit the system ends the worker by SIGXCPU, also within code that is not Python.
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(start + task.processor_s), hard))
    report = _checked(task)
    os.chdir(folder)
    return replace(report, processor_s=time.process_time() - start)


def _checked(task: _StepTask) -> Report:
    step, evidence, blocks = task.step, None, task.step.blocks
    try:
        passed = step.check(task.name)
        return Report(step, Finding(True, step.subject, passed.text), passed.evidence)
    except ContractViolation as error:
        text, evidence, blocks = str(error), error.evidence, blocks and error.blocks
    except MissingDependency as error:
        return Report(step, Finding(False, step.subject, str(error)), is_last=True)
    except BadInput as error:
        text = str(error)
    except BaseException as error:  # the plug-in may call exit(), or raise KeyboardInterrupt
        from bench.running.work import reason_of  # loads pandas, which a plug-in may not

        if isinstance(error, Exception):
            text = reason_of(error)
        else:
            text = f"{type(error).__name__}({error}): raise an exception, do not end the process"
    return Report(step, Finding(False, step.subject, text, blocks), evidence)


@cache
def _mark_exits() -> None:
    """Make os._exit(0) end this worker with another status, as the pool overlooks 0."""
    leave, worker = os._exit, os.getpid()

    def leave_marked(status: int) -> None:
        leave(_EXIT_STATUS if status == 0 and os.getpid() == worker else status)

    os._exit = leave_marked  # type: ignore[assignment]
