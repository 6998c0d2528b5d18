"""`bench test`: whether a method, a metric or a dataset keeps to what the benchmark expects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated

import typer

from bench.catalogue.plugins import metric_ids, plugin_problem
from bench.checking.contract.datasets import dataset_findings
from bench.checking.contract.findings import Finding
from bench.checking.contract.methods import method_findings
from bench.checking.contract.metrics import metric_findings
from data_prep.datasets import is_dataset
from data_prep.failures import BadInput


def findings_of(name: str) -> Iterator[Finding]:
    """Return those about a dataset, a metric of another package, or else a method.

    Raises BadInput for an unknown name, and for one that a package announces and may not have.
    """
    for kind, id_ in (("method", name), ("metric", name), ("dataset", name.partition(":")[0])):
        if problem := plugin_problem(kind, id_):
            raise BadInput(problem)
    if is_dataset(name):
        return dataset_findings(name)
    if name in metric_ids():
        return metric_findings(name)
    return method_findings(name)


def test(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help="A method ('convex-hull', 'splat-net@FILE.safetensors'), a metric of another "
            "package, or a dataset ('list:PATH').",
        ),
    ],
) -> None:
    """Test a method, metric or dataset of your own. Exit 0 if it keeps the contract, 1 if not."""
    conclude(findings_of(name))


def conclude(findings: Iterable[Finding]) -> None:
    """Print a line for each; ends with status 1 where one is not ok."""
    fine = True
    for finding in findings:
        fine &= finding.ok
        print(f"{'ok  ' if finding.ok else 'FAIL'} {finding.subject}: {finding.text}", flush=True)
    if not fine:
        raise typer.Exit(1)
