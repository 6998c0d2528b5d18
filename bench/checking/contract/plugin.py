"""The test of a plug-in: its steps in two workers, one after the other, within 60 seconds."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.methods import Method
from bench.catalogue.plugins import ImageMetric, SetMetric
from bench.catalogue.suites import Limits
from bench.checking.contract import conditions, datasets, methods, metrics
from bench.checking.contract.findings import ContractViolation, Finding
from bench.checking.contract.methods import LIMITS, apart
from bench.checking.contract.session import CheckStep, Passed, Report, output_finding, perform
from bench.checking.contract.targets import (
    DatasetSource,
    check_import,
    check_name,
    find_target,
    kind_of,
)
from bench.running.isolation import TASKS_PER_WORKER, WORKER_ENVIRONMENT, thread_counts
from data_prep.clouds.conditions import Condition

_TOTAL_S = 60.0
_CLOSING_S = 3.0  # of _TOTAL_S, for workers that end
CALLS, CALLS_S = 8, 5.0  # fewer for slow plug-ins
# Memory that a worker may keep of each call, to stay within its limit until it is replaced.
_KEPT_MIB = LIMITS.memory_gib * 2**10 / TASKS_PER_WORKER
_GROWN_MIB = 512.0  # is enough to see that memory grows
WARM_UP = 3  # calls after which memory has settled


@dataclass(frozen=True)
class Kind:
    """What is tested of a kind of plug-in; each function takes the name of one.

    use             what the plug-in makes of an input of this number, checked
    result          the word for that
    facts           values that are the same in each process, with words for them
    check_identity  the check of its fields
    first, last     the steps before and after those of all kinds
    rtol, atol      how far results in another process may be apart
    """

    use: Callable[[str, int], NDArray[Any]]
    result: str
    facts: Callable[[str], Mapping[str, Any]]
    check_identity: Callable[[str], Passed]
    first: Sequence[CheckStep]
    last: Sequence[CheckStep] = ()
    remedy: str = "take all randomness from `rng`, and keep nothing of a cloud"
    rtol: float = 0.0
    atol: float = 0.0


_of_metrics = partial(
    *(Kind, metrics.use, "values", lambda name: {}, metrics.check_identity),
    remedy="a value depends on its image and the truth alone",
    rtol=1e-5,
    atol=1e-8,
)
KINDS: Mapping[type, Kind] = {
    Method: Kind(
        *(methods.use, "images", methods.facts, methods.check_identity),
        first=methods.FIRST,
        last=methods.LAST,  # a hang ends the test
        atol=1,  # grey level
    ),
    ImageMetric: _of_metrics(first=metrics.OF_IMAGES),
    SetMetric: _of_metrics(first=metrics.OF_SETS),
    DatasetSource: Kind(
        *(datasets.use, "points", datasets.facts, datasets.check_identity),
        first=datasets.FIRST,
        atol=1e-6,
    ),
    Condition: Kind(
        *(conditions.use, "points", conditions.facts, conditions.check_identity),
        first=conditions.FIRST,
    ),
}


def _kind(name: str) -> Kind:
    return KINDS[kind_of(find_target(name))]


def check_identity(name: str) -> Passed:
    """Check the fields of a plug-in, in a worker."""
    return _kind(name).check_identity(name)


def _use_first(name: str, order: Sequence[int] = (1, 0)) -> Passed:
    """Use a plug-in for the first time, in the opposite order of the other process."""
    kind = _kind(name)
    results = {number: kind.use(name, number) for number in order}
    return Passed("", (kind.facts(name), [results[number] for number in (0, 1)]))


def _check_elsewhere(name: str, elsewhere: Any) -> Passed:
    """Compare with the evidence of the first use in another process, on two threads.

    `elsewhere` is a text, the reason, where there is none.
    """
    kind, (facts, results) = _kind(name), _use_first(name, (0, 1)).evidence
    if isinstance(elsewhere, str):
        raise ContractViolation(f"works here, but not in another process: {elsewhere}")
    for what, fact in facts.items():
        if fact != (other := elsewhere[0][what]):
            both = f" ({fact!r}, there {other!r})" if isinstance(fact, str) else ""
            raise ContractViolation(
                f"not the same {what} in another process{both}; finished work would be lost"
            )
    for here, second in zip(results, elsewhere[1], strict=True):
        alike = here.shape == second.shape and np.allclose(
            here.astype(np.float64), second, kind.rtol, kind.atol
        )
        if not alike:
            raise ContractViolation(
                f"other {kind.result} in another process, on two threads, in another order: "
                f"{apart(here, second)}; {kind.remedy}"
            )
    return Passed("the same in two processes, on one thread and on two, in another order")


def check_repeatable(name: str) -> Passed:
    """Use the plug-in twice with the same input."""
    kind = _kind(name)
    first, second = kind.use(name, 0), kind.use(name, 0)
    if not np.array_equal(first, second):
        raise ContractViolation(
            f"other {kind.result} the second time: {apart(first, second)}; {kind.remedy}"
        )
    return Passed(f"the same {kind.result} the second time")


def check_calls(name: str) -> Passed:
    """Use the plug-in often, then as at first, and check memory and results."""
    kind, start = _kind(name), time.perf_counter()
    first, resident = kind.use(name, 0), [_resident_mib()]
    for call in range(CALLS):
        kind.use(name, 1 + call)
        resident.append(_resident_mib())
        if resident[-1] - resident[0] > _GROWN_MIB:
            break
        if call >= 2 and time.perf_counter() - start > CALLS_S:
            break
    growth = _growth_mib(resident)
    if growth > _KEPT_MIB:
        raise ContractViolation(
            f"{growth:.0f} MiB more with every call; {TASKS_PER_WORKER} of them exceed "
            f"{LIMITS.memory_gib:g} GiB"
        )
    again, others = kind.use(name, 0), len(resident) - 1
    if not np.array_equal(first, again):
        raise ContractViolation(
            f"other {kind.result} after {others} others: {apart(first, again)}; {kind.remedy}"
        )
    return Passed(f"{others} others between change nothing; memory grows by {growth:.1f} MiB")


def _growth_mib(resident: Sequence[float]) -> float:
    """Return the median growth of memory from one measurement to the next, once it has settled."""
    settled = resident[WARM_UP:] if len(resident) > WARM_UP + 1 else resident
    return statistics.median(b - a for a, b in pairwise(settled))


def _resident_mib() -> float:
    """Return the resident memory of this process, after a garbage collection."""
    import psutil

    gc.collect()
    return psutil.Process().memory_info().rss / 2**20


_IMPORT = CheckStep("import", check_import, in_command=True)
_FIRST_USE = CheckStep("first use", _use_first)
_FIRST_STEPS = [_IMPORT, CheckStep("identity", check_identity, in_command=True), _FIRST_USE]
# The two processes differ in threads, hash seed and order of work, which results may not depend on.
_FIRST_ENVIRONMENT = WORKER_ENVIRONMENT | thread_counts(2) | {"PYTHONHASHSEED": "2"}
_SECOND_ENVIRONMENT = WORKER_ENVIRONMENT | {"PYTHONHASHSEED": "1"}


def steps_of(kind: type, elsewhere: Any) -> list[CheckStep]:
    """Return the steps in the second process; `elsewhere` is the evidence of the first."""
    # `bench score` calls a metric in its own process.
    step = partial(CheckStep, in_command=kind in (ImageMetric, SetMetric))
    return [
        *KINDS[kind].first,
        step("calls", check_calls),
        step("another process", partial(_check_elsewhere, elsewhere=elsewhere)),
        step("repeatable", check_repeatable),
        *KINDS[kind].last,
    ]


def plugin_findings(
    name: str, limits: Limits = LIMITS, total_s: float = _TOTAL_S
) -> Iterator[Finding]:
    """Yield all findings about a method, metric, dataset or condition.

    `limits` are those of a step. Raises BadInput for an unknown name.
    """
    check_name(name)
    until = time.monotonic() + total_s - _CLOSING_S
    reports: list[Report] = []
    kind, evidence = None, None
    for report in perform(name, _FIRST_STEPS, limits, until, _FIRST_ENVIRONMENT):
        reports.append(report)
        if report.step == _FIRST_USE:
            evidence = report.evidence if report.finding.ok else report.finding.text
        if report.step != _FIRST_USE or report.is_last:  # else the next steps tell it
            yield report.finding
        if report.step == _IMPORT and (kind := report.evidence) is None:
            break
    if not reports:  # a machine so busy that no worker could begin
        yield Finding(False, "not tested", f"all of it: {total_s:g} s are over")
        return
    steps = [] if kind is None else steps_of(kind, evidence)
    if not reports[-1].is_last:
        for report in perform(name, steps, limits, until, _SECOND_ENVIRONMENT):
            reports.append(report)
            yield report.finding
    performed = {report.step.subject for report in reports}
    if untested := [step for step in steps if step.subject not in performed]:
        reason = f"after '{reports[-1].step.subject}'"
        if time.monotonic() >= until:
            reason = f"{total_s:g} s are over"
        subjects = ", ".join(step.subject for step in untested)
        blocks = any(step.blocks for step in untested)
        yield Finding(False, "not tested", f"{subjects}: {reason}", blocks)
    yield output_finding(reports)
