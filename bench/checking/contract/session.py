"""Steps of a test of a plug-in: each runs in a killable worker, which holds back its output.

An exception, a call of exit(), a signal and a hang of the worker are findings. This module and
`targets` load no heavy package, so that the imports of a plug-in show.
"""

from __future__ import annotations

import faulthandler
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from bench.catalogue.suites import Limits
from bench.checking.contract.findings import ContractViolation, Finding
from bench.running.isolation import TaskPool, WorkerFailure
from data_prep.failures import BadInput, MissingDependency

_EXIT_STATUS = 86  # of a worker in which the plug-in has called os._exit(0)
_MOST_DEATHS = 3
_MOST_SHOWN = 60  # characters of an output


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
    in_command  whether commands call this part of the plug-in in their own process, whose stdout
                has their results
    blocks      whether a run would fail or have false results where the point is not kept
    """

    subject: str
    check: Callable[[str], Passed]
    in_command: bool = False
    blocks: bool = True


class _StepTask(NamedTuple):
    """A step of the test of a plug-in, and the moment at which its worker is ended."""

    step: CheckStep
    name: str
    until: float


@dataclass(frozen=True)
class Report:
    """The finding of a step.

    printed  what the plug-in has written to stdout, in words
    is_last  whether no further step is tried, after a hang or a missing library
    """

    step: CheckStep
    finding: Finding
    evidence: Any = None
    printed: str = ""
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
                pool.submit(_StepTask(step, name, until))
                try:
                    ((_, result),) = pool.wait_any()
                except BrokenProcessPool as error:
                    result, deaths = WorkerFailure("crash", str(error)), _MOST_DEATHS
                if isinstance(result, WorkerFailure):
                    if time.monotonic() >= until:
                        return
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
    with Path(os.devnull).open("w") as nowhere, captured_output() as printed:
        # The deadline is kept by a thread that native code cannot hold up.
        remaining_s = max(task.until - time.monotonic(), 0.01)
        faulthandler.dump_traceback_later(remaining_s, exit=True, file=nowhere)
        report = _checked(task)
        faulthandler.cancel_dump_traceback_later()
    os.chdir(folder)
    return replace(report, printed="".join(printed))


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


@contextmanager
def captured_output() -> Iterator[list[str]]:
    """Hold back all output to stdout and stderr; afterwards the list describes that to stdout.

    File descriptors are redirected, as native libraries and sub-processes write to them.
    """
    described: list[str] = []
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        saved = [os.dup(descriptor) for descriptor in (1, 2)]
        _flush()
        try:
            for descriptor, file in ((1, out), (2, err)):
                os.dup2(file.fileno(), descriptor)
            yield described
        finally:
            _flush()
            for descriptor, copy in zip((1, 2), saved, strict=True):
                os.dup2(copy, descriptor)
                os.close(copy)
            out.seek(0)
            if written := out.read():
                first = written.decode(errors="replace").strip().partition("\n")[0]
                described.append(f"{len(written)} bytes: {first[:_MOST_SHOWN]!r}")


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        if stream is not None and not stream.closed:
            stream.flush()


def output_finding(reports: Sequence[Report]) -> Finding:
    """Return the finding about what was printed, over all steps."""
    printed = [report for report in reports if report.printed]
    if not printed:
        return Finding(True, "stdout", "nothing is printed")
    text = f"{printed[0].step.subject}: {printed[0].printed}"
    if len(printed) > 1:
        text += f"; {len(printed)} steps in all"
    in_command = any(report.step.in_command for report in printed)
    text += "; commands print their results there" * in_command
    return Finding(False, "stdout", text, in_command)
