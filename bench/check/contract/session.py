"""Steps of a test of a plug-in: each runs in a killable worker.

An exception, a call of exit(), a signal and a hang of the worker are findings. This module and
`targets` load no heavy package, so that the imports of a plug-in show.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from bench.catalogue.suites import Limits
from bench.check.contract.findings import ContractViolation, Finding
from bench.running.pool import TaskPool, WorkerFailure
from data_prep.failures import BadInput, MissingDependency

_EXIT_STATUS = 86  # of a worker in which the plug-in has called os._exit(0)
_MOST_DEATHS = 3


class Passed(NamedTuple):
    """The result of a check that passed: its text, and evidence for later steps."""

    text: str
    evidence: Any = None


@dataclass(frozen=True)
class CheckStep:
    """A point of a contract.

    subject     its name in the finding
    check       called with the name of the plug-in, in a worker; raises ContractViolation, or any
                exception of the plug-in. A function of a module, or a partial of one
    blocks      whether a run would fail or have false results where the point is not kept
    """

    subject: str
    check: Callable[[str], Passed]
    blocks: bool = True


class _StepTask(NamedTuple):
    """A step of the test of a plug-in."""

    step: CheckStep
    name: str


@dataclass(frozen=True)
class Report:
    """The finding of a step.

    is_last  whether no further step is tried, after a hang or a missing library
    """

    step: CheckStep
    finding: Finding
    evidence: Any = None
    is_last: bool = False


def perform(
    name: str,
    steps: Sequence[CheckStep],
    limits: Limits,
    until: float,
    environment: Mapping[str, str],
) -> Iterator[Report]:
    """Yield the report of each step, in their order; one worker serves as long as it lives.

    It ends after a last step, after _MOST_DEATHS workers, and at the moment `until` of the
    monotonic clock.
    """
    deaths = 0
    with tempfile.TemporaryDirectory(prefix=".bench-test-") as temporary:
        around = {**environment, "TMPDIR": temporary}
        with closing(TaskPool(execute, 1, limits, around)) as pool:
            for step in steps:
                pool.submit(_StepTask(step, name))
                try:
                    ended = list(pool.wait_any(until - time.monotonic()))
                except BrokenProcessPool as error:
                    ended = [(None, WorkerFailure("crash", str(error)))]
                    deaths = _MOST_DEATHS
                if not ended:  # the time of the whole test is over: the pool ends its worker
                    return
                ((_, result),) = ended
                if isinstance(result, WorkerFailure):
                    result, deaths = _report_of_death(step, result), deaths + 1
                yield result
                if result.is_last or deaths >= _MOST_DEATHS:
                    return


def _report_of_death(step: CheckStep, lost: WorkerFailure) -> Report:
    """Return the report of a step whose worker was killed or has died."""
    reason = lost.reason
    if f"exit code {_EXIT_STATUS})" in reason:
        reason = "crash: os._exit(0) was called"
    finding = Finding(False, step.subject, reason, step.blocks)
    return Report(step, finding, is_last=lost.kind == "timeout")


def execute(task: _StepTask) -> Report:
    """Carry out a step, in a worker."""
    _mark_exits()
    folder = Path.cwd()
    report = _checked(task)
    os.chdir(folder)
    return report


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

        text = f"{type(error).__name__}({error}): raise an exception, do not end the process"
        text = reason_of(error) if isinstance(error, Exception) else text
    return Report(step, Finding(False, step.subject, text, blocks), evidence)


@cache
def _mark_exits() -> None:
    """Make os._exit(0) end this worker with another status, as the pool overlooks 0."""
    leave, worker = os._exit, os.getpid()

    def leave_marked(status: int) -> None:
        leave(_EXIT_STATUS if status == 0 and os.getpid() == worker else status)

    os._exit = leave_marked  # type: ignore[assignment]
