"""Steps of a test of a plug-in: each runs in a killable worker, observed before and after.

An exception, a call of exit(), a signal and a hang of the worker are findings. This module and
`targets` load no heavy package, so that the imports of a plug-in show.
"""

from __future__ import annotations

import ctypes
import faulthandler
import os
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from bench.catalogue.suites import Limits
from bench.checking.contract.findings import ContractViolation, Finding
from bench.checking.contract.traces import (
    ProcessState,
    await_processes,
    captured_output,
    end_processes,
    traces,
)
from bench.running.isolation import WorkerFailure, run_tasks
from data_prep.failures import BadInput, MissingDependency

EXIT_STATUS = 86  # of a worker in which the plug-in has called os._exit(0)
MOST_DEATHS = 3
PR_SET_CHILD_SUBREAPER = 36  # linux/prctl.h
# By kind of trace: whether it blocks a run, and the text of a finding without any.
TRACES = {
    "stdout": (False, "nothing is printed"),
    "stderr": (False, "nothing is printed"),
    "files left": (False, "none in the working folder and the temporary one"),
    "threads left": (False, "none is running"),
    "processes left": (True, "none is running"),
    "working folder": (True, "stays the same"),
}


@dataclass(frozen=True)
class Passed:
    """The result of a check that passed: its text, and evidence for later steps."""

    text: str
    evidence: Any = None


@dataclass(frozen=True)
class CheckStep:
    """A point of a contract.

    Attributes
    ----------
    subject : str
        Its name in the finding.
    check : callable
        Called with the name of the plug-in, in a worker; raises ContractViolation, or any
        exception of the plug-in. A function of a module, or a partial of one: it crosses processes.
    in_command : bool
        Whether commands call this part of the plug-in in their own process, whose stdout has
        their results.
    blocks : bool
        Whether a run would fail or have false results where the point is not kept.
    """

    subject: str
    check: Callable[[str], Passed]
    in_command: bool = False
    blocks: bool = True


@dataclass(frozen=True)
class StepTask:
    """A step of the test of a plug-in, and the moment at which its worker is ended."""

    step: CheckStep
    name: str
    until: float


@dataclass(frozen=True)
class Report:
    """The finding of a step, and the traces that the plug-in has left during it, by kind.

    is_last  whether no further step is tried, after a hang or a missing library
    """

    step: CheckStep
    finding: Finding
    evidence: Any = None
    traces: Mapping[str, str] = field(default_factory=dict)
    is_last: bool = False


def perform(
    name: str,
    steps: Sequence[CheckStep],
    limits: Limits,
    until: float,
    environment: Mapping[str, str],
) -> Iterator[Report]:
    """Yield the report of each step, in their order; one worker serves as long as it lives.

    It ends after a last step, after MOST_DEATHS workers, and at the moment `until` of the monotonic
    clock.
    """
    deaths = 0
    with tempfile.TemporaryDirectory(prefix=".bench-test-") as temporary:
        tasks = (StepTask(step, name, until) for step in steps)
        around = {**environment, "TMPDIR": temporary}
        with closing(run_tasks(tasks, execute, 1, limits, around)) as results:
            for step, result in _in_order(steps, results):
                is_lost = isinstance(result, WorkerFailure)
                if is_lost and time.monotonic() >= until:
                    return
                report = result if isinstance(result, Report) else _report_of_death(step, result)
                yield report
                deaths += is_lost
                if report.is_last or deaths == MOST_DEATHS:
                    return


def _in_order(
    steps: Sequence[CheckStep], results: Iterable[tuple[StepTask, Report | WorkerFailure]]
) -> Iterator[tuple[CheckStep, Report | WorkerFailure]]:
    """Yield the results in the order of the steps; two at one moment may come in any order."""
    queue, ended = deque(steps), {}
    try:
        for task, result in results:
            ended[task.step.subject] = result
            while queue and queue[0].subject in ended:
                step = queue.popleft()
                yield step, ended[step.subject]
    except BrokenProcessPool as error:
        yield queue[0], WorkerFailure("crash", str(error))


def _report_of_death(step: CheckStep, lost: WorkerFailure) -> Report:
    """Return the report of a step whose worker was killed or has died."""
    reason = lost.reason
    if f"exit code {EXIT_STATUS})" in reason:
        reason = "crash: os._exit(0) was called"
    finding = Finding(False, step.subject, reason, step.blocks)
    return Report(step, finding, is_last=lost.kind == "timeout")


def execute(task: StepTask) -> Report:
    """Carry out a step, in a worker."""
    _mark_exits()
    if sys.platform == "linux":  # children of ended processes become ours, so that they are seen
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)
    temporary = Path(tempfile.gettempdir())
    before = ProcessState.take(temporary)
    with Path(os.devnull).open("w") as nowhere, captured_output() as output:
        # The deadline is kept by a thread that native code cannot hold up.
        remaining_s = max(task.until - time.monotonic(), 0.01)
        faulthandler.dump_traceback_later(remaining_s, exit=True, file=nowhere)
        report = _checked(task)
        faulthandler.cancel_dump_traceback_later()
    await_processes()
    after = ProcessState.take(temporary)
    end_processes()
    os.chdir(before.folder)
    return replace(report, traces={**output, **traces(before, after)})


def _checked(task: StepTask) -> Report:
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
        text = raised(error)
    return Report(step, Finding(False, step.subject, text, blocks), evidence)


def raised(error: BaseException) -> str:
    """Return one line on an exception of a plug-in, with a remedy for one like SystemExit."""
    from bench.running.work import reason_of  # loads pandas, which a plug-in may not

    if isinstance(error, Exception):
        return reason_of(error)
    return f"{type(error).__name__}({error}): raise an exception, do not end the process"


@cache
def _mark_exits() -> None:
    """Make os._exit(0) end this worker with another status, as the pool overlooks 0."""
    leave, worker = os._exit, os.getpid()

    def leave_marked(status: int) -> None:
        leave(EXIT_STATUS if status == 0 and os.getpid() == worker else status)

    os._exit = leave_marked  # type: ignore[assignment]


def trace_findings(reports: Iterable[Report]) -> list[Finding]:
    """Return a finding for each kind of trace, over all steps."""
    reports, findings = list(reports), []
    for kind, (blocks, none_left) in TRACES.items():
        affected = [report for report in reports if kind in report.traces]
        if not affected:
            findings.append(Finding(True, kind, none_left))
            continue
        in_command = any(report.step.in_command for report in affected)
        text = f"{affected[0].step.subject}: {affected[0].traces[kind]}"
        if len(affected) > 1:
            text += f"; {len(affected)} steps in all"
        if kind == "stdout" and in_command:
            text += "; commands print their results there"
        findings.append(Finding(False, kind, text, blocks or (kind == "stdout" and in_command)))
    return findings
