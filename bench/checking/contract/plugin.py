"""The test of a plug-in: its steps in two workers, one after the other, within 60 seconds."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from types import ModuleType
from typing import Any

from bench.catalogue.methods import Method
from bench.catalogue.plugins import ImageMetric, SetMetric
from bench.catalogue.suites import Limits
from bench.checking.contract import datasets, methods, metrics
from bench.checking.contract.datasets import dataset_steps
from bench.checking.contract.findings import Finding
from bench.checking.contract.methods import LIMITS, method_steps
from bench.checking.contract.metrics import metric_steps
from bench.checking.contract.session import (
    Deadline,
    Passed,
    Report,
    Step,
    perform,
    trace_findings,
)
from bench.checking.contract.targets import DatasetSource, check_import, check_name, find_target
from bench.running.isolation import WORKER_ENVIRONMENT, thread_counts

TOTAL_S = 60.0
CLOSING_S = 3.0  # of TOTAL_S, for workers that end

KINDS: Mapping[type, ModuleType] = {
    Method: methods,
    ImageMetric: metrics,
    SetMetric: metrics,
    DatasetSource: datasets,
}


def plugin_findings(
    name: str, limits: Limits = LIMITS, total_s: float = TOTAL_S
) -> Iterator[Finding]:
    """Yield all findings about a method, metric or dataset.

    `limits` are those of a step. Raises BadInput for an unknown name.
    """
    check_name(name)
    deadline = Deadline(total_s, time.monotonic() + total_s - CLOSING_S)
    reports: list[Report] = []

    def told(steps: list[Step], environment: Mapping[str, str]) -> Iterator[Report]:
        for report in perform(name, steps, limits, deadline, environment):
            reports.append(report)
            yield report

    # Whatever depends on the process, on threads or on the order of work differs between the two.
    other = WORKER_ENVIRONMENT | thread_counts(2) | {"PYTHONHASHSEED": "2"}
    first = [
        Step("import", check_import, in_command=True),
        Step("identity", check_identity, in_command=True),
        Step("first use", use_first),
    ]
    kind, evidence, is_over = None, None, False
    for report in told(first, other):
        subject, finding = report.step.subject, report.finding
        if subject == "import":
            kind = report.evidence
        if subject == "first use" and finding.subject == subject:
            evidence = report.evidence if finding.ok else finding.text
            is_over = finding.text.startswith("timeout: ")
            if not is_over:
                continue  # told by the steps that follow
        is_over |= finding.subject == "not tested"
        yield finding
        if subject == "import" and kind is None:
            break
    if kind is not None and not is_over:
        for report in told(_steps(kind, evidence), WORKER_ENVIRONMENT | {"PYTHONHASHSEED": "1"}):
            yield report.finding
    yield from trace_findings(reports)


def _steps(kind: type, evidence: Any) -> list[Step]:
    if kind is Method:
        return method_steps(evidence)
    if kind is DatasetSource:
        return dataset_steps(evidence)
    return metric_steps(evidence, of_images=kind is ImageMetric)


def check_identity(name: str) -> Passed:
    """Look at what a plug-in says of itself; in a worker."""
    return KINDS[type(find_target(name))].check_identity(name)


def use_first(name: str) -> Passed:
    """Use a plug-in for the first time, in the order opposite to that of the other process."""
    module = KINDS[type(find_target(name))]
    return Passed("", module.first_evidence(name, backwards=True))
