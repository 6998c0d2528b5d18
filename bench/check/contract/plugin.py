"""The test of a plug-in in at most 60 seconds of processor time.

One worker imports the plug-in, and another one carries out the other steps.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.methods import Method
from bench.catalogue.plugins import ImageMetric, SetMetric
from bench.catalogue.suites import Limits
from bench.check.contract import conditions, datasets, methods, metrics
from bench.check.contract.files import watch_files
from bench.check.contract.findings import ContractViolation, Finding
from bench.check.contract.methods import LIMITS, apart
from bench.check.contract.session import CheckStep, Passed, Report, perform
from bench.check.contract.targets import (
    DatasetSource,
    check_import,
    check_name,
    find_target,
    kind_of,
)
from bench.running.pool import WORKER_ENVIRONMENT
from data_prep.clouds.conditions import Condition

_TOTAL_S = 60.0  # seconds of processor time that a whole test may take
_CLOCK_S = 300.0  # seconds by the clock, for a plug-in that waits; a busy machine is slower
_CLOSING_S = 3.0  # the seconds of _CLOCK_S that are kept for ending the workers
_AGAIN = "test it again when the machine is less busy"
# Other inputs that a plug-in is used with between two uses of the same input, whose results are
# compared. After CALLS_S seconds it is no longer used with more of them than FEWEST_CALLS.
CALLS, FEWEST_CALLS = 8, 3
CALLS_S = 5.0


@dataclass(frozen=True)
class Kind:
    """The test of plug-ins of a kind; each function takes the name of a plug-in.

    use             the function that returns the checked result of a plug-in for an input, which is
                    chosen by its number
    result          what messages call such results, in the plural
    check_identity  the step that checks the fields of a plug-in
    first, last     the steps before and after those that all kinds have
    remedy          the remedy in messages on results that are others the second time
    """

    use: Callable[[str, int], NDArray[Any]]
    result: str
    check_identity: Callable[[str], Passed]
    first: Sequence[CheckStep]
    last: Sequence[CheckStep] = ()
    remedy: str = "take all randomness from `rng`, and keep nothing of a cloud"


_of_metrics = partial(
    Kind,
    use=metrics.use,
    result="values",
    check_identity=metrics.check_identity,
    remedy="a value depends on its image and the truth alone",
)
KINDS: Mapping[type, Kind] = {
    Method: Kind(
        use=methods.use,
        result="images",
        check_identity=methods.check_identity,
        first=methods.FIRST,
        last=methods.LAST,  # the steps that may hang come last, as a hang ends the test
    ),
    ImageMetric: _of_metrics(first=metrics.OF_IMAGES),
    SetMetric: _of_metrics(first=metrics.OF_SETS),
    DatasetSource: Kind(
        use=datasets.use,
        result="points",
        check_identity=datasets.check_identity,
        first=datasets.FIRST,
    ),
    Condition: Kind(
        use=conditions.use,
        result="points",
        check_identity=conditions.check_identity,
        first=conditions.FIRST,
    ),
}


def _kind(name: str) -> Kind:
    watch_files()  # before the module is loaded, which may read files
    return KINDS[kind_of(find_target(name))]


def check_identity(name: str) -> Passed:
    """Check the fields of a plug-in, in a worker."""
    return _kind(name).check_identity(name)


def check_repeatable(name: str) -> Passed:
    """Use the plug-in twice with the same input, and compare the results."""
    kind = _kind(name)
    first, second = kind.use(name, 0), kind.use(name, 0)
    if not np.array_equal(first, second):
        raise ContractViolation(
            f"other {kind.result} the second time: {apart(first, second)}; {kind.remedy}"
        )
    return Passed(f"the same {kind.result} the second time")


def check_calls(name: str) -> Passed:
    """Use the plug-in with other inputs, then with the first one again, and compare the results."""
    kind, start = _kind(name), time.perf_counter()
    first, others = kind.use(name, 0), 0
    for number in range(1, 1 + CALLS):
        kind.use(name, number)
        others = number
        if others >= FEWEST_CALLS and time.perf_counter() - start > CALLS_S:
            break
    again = kind.use(name, 0)
    if not np.array_equal(first, again):
        raise ContractViolation(
            f"other {kind.result} after {others} others: {apart(first, again)}; {kind.remedy}"
        )
    return Passed(f"{others} others between change nothing")


_IMPORT = CheckStep("import", check_import)
_IDENTITY = CheckStep("identity", check_identity)


def steps_of(kind: type) -> list[CheckStep]:
    """Return the steps after the import, in their order."""
    return [
        _IDENTITY,
        *KINDS[kind].first,
        CheckStep("calls", check_calls),
        CheckStep("repeatable", check_repeatable),
        *KINDS[kind].last,
    ]


def plugin_findings(
    name: str, limits: Limits = LIMITS, total_s: float = _TOTAL_S, clock_s: float = _CLOCK_S
) -> Iterator[Finding]:
    """Yield all findings about a method, metric, dataset or condition.

    `limits` are those of a step. What there is no time for is a warning. Raises BadInput for an
    unknown name.
    """
    check_name(name)
    until = time.monotonic() + clock_s - _CLOSING_S
    steps: list[CheckStep] = []
    reports: list[Report] = []
    for report in perform(name, [_IMPORT], limits, until, WORKER_ENVIRONMENT):
        reports.append(report)
        yield report.finding
        if report.evidence is not None:
            steps = steps_of(report.evidence)
    if not reports:  # the machine is so busy that no worker could begin
        yield Finding(False, "not tested", f"all of it: {clock_s:g} s are over; {_AGAIN}", False)
        return
    for report in perform(name, steps, limits, until, WORKER_ENVIRONMENT):
        reports.append(report)
        yield report.finding
        if sum(each.processor_s for each in reports) >= total_s:
            break
    performed = {report.step.subject for report in reports}
    if untested := [step for step in steps if step.subject not in performed]:
        subjects = ", ".join(step.subject for step in untested)
        reason, blocks = f"after '{reports[-1].step.subject}'", any(s.blocks for s in untested)
        if time.monotonic() >= until:
            reason, blocks = f"{clock_s:g} s are over; {_AGAIN}", False
        elif sum(each.processor_s for each in reports) >= total_s:
            reason, blocks = f"{total_s:g} s of processor time are over", False
        yield Finding(False, "not tested", f"{subjects}: {reason}", blocks)
