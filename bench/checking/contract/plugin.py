"""The test of a plug-in: its steps in two workers, one after the other, within 60 seconds."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from types import ModuleType
from typing import Any

from bench.catalogue.methods import Method
from bench.catalogue.plugins import ImageMetric, SetMetric
from bench.catalogue.suites import Limits
from bench.checking.contract import conditions, datasets, methods, metrics
from bench.checking.contract.conditions import condition_steps
from bench.checking.contract.datasets import dataset_steps
from bench.checking.contract.findings import Finding
from bench.checking.contract.methods import LIMITS, method_steps
from bench.checking.contract.metrics import metric_steps
from bench.checking.contract.session import CheckStep, Passed, Report, perform, trace_findings
from bench.checking.contract.targets import (
    DatasetSource,
    check_import,
    check_name,
    find_target,
    kind_of,
)
from bench.running.isolation import WORKER_ENVIRONMENT, thread_counts
from data_prep.clouds.conditions import Condition

TOTAL_S = 60.0
CLOSING_S = 3.0  # of TOTAL_S, for workers that end

KINDS: Mapping[type, ModuleType] = {
    Method: methods,
    ImageMetric: metrics,
    SetMetric: metrics,
    DatasetSource: datasets,
    Condition: conditions,
}


def check_identity(name: str) -> Passed:
    """Check the fields of a plug-in, in a worker."""
    return KINDS[kind_of(find_target(name))].check_identity(name)


def use_first(name: str) -> Passed:
    """Use a plug-in for the first time, in the opposite order of the other process."""
    module = KINDS[kind_of(find_target(name))]
    return Passed("", module.first_evidence(name, backwards=True))


IMPORT = CheckStep("import", check_import, in_command=True)
FIRST_USE = CheckStep("first use", use_first)
FIRST_STEPS = [IMPORT, CheckStep("identity", check_identity, in_command=True), FIRST_USE]
# The two processes differ in threads, hash seed and order of work, which results may not depend on.
FIRST_ENVIRONMENT = WORKER_ENVIRONMENT | thread_counts(2) | {"PYTHONHASHSEED": "2"}
SECOND_ENVIRONMENT = WORKER_ENVIRONMENT | {"PYTHONHASHSEED": "1"}


def plugin_findings(
    name: str, limits: Limits = LIMITS, total_s: float = TOTAL_S
) -> Iterator[Finding]:
    """Yield all findings about a method, metric, dataset or condition.

    `limits` are those of a step. Raises BadInput for an unknown name.
    """
    check_name(name)
    until = time.monotonic() + total_s - CLOSING_S
    reports: list[Report] = []
    kind, evidence = None, None
    for report in perform(name, FIRST_STEPS, limits, until, FIRST_ENVIRONMENT):
        reports.append(report)
        if report.step == FIRST_USE:
            evidence = report.evidence if report.finding.ok else report.finding.text
        if report.step != FIRST_USE or report.is_last:  # else the next steps tell it
            yield report.finding
        if report.step == IMPORT and (kind := report.evidence) is None:
            break
    if not reports:  # a machine so busy that no worker could begin
        yield Finding(False, "not tested", f"all of it: {total_s:g} s are over")
        return
    steps = [] if kind is None else _steps(kind, evidence)
    if not reports[-1].is_last:
        for report in perform(name, steps, limits, until, SECOND_ENVIRONMENT):
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
    yield from trace_findings(reports)


def _steps(kind: type, evidence: Any) -> list[CheckStep]:
    if kind is Method:
        return method_steps(evidence)
    if kind is DatasetSource:
        return dataset_steps(evidence)
    if kind is Condition:
        return condition_steps(evidence)
    return metric_steps(evidence, of_images=kind is ImageMetric)
