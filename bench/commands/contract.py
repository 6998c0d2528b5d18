"""`bench test`: the check of a plug-in against the contract of the benchmark."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

import typer

from bench.catalogue.lookup import family_of
from bench.catalogue.method import search_folder
from bench.checking.contract.findings import Finding, is_blocked, summary
from bench.tables.markdown import visible


def test(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help="A method ('convex-hull', 'splat-net@FILE.safetensors'), a metric or condition of "
            "another package, a dataset ('list:PATH'), or MODULE:NAME of a module without a "
            "package, of a reader MODULE:NAME:PATH. The module may be in the current folder: this "
            "form alone executes files of it.",
        ),
    ],
) -> None:
    """Test a method, metric, dataset or condition of your own in workers, in at most a minute.

    Exit 0 if it keeps the contract, 1 if something blocks a run or falsifies its results.
    """
    from bench.checking.contract.plugin import plugin_findings
    from data_prep.datasets.registry import is_dataset

    if ":" in family_of(name) and not is_dataset(name):  # MODULE:NAME
        search_folder()
    findings = printed(plugin_findings(name))
    if is_blocked(findings):
        print(summary(findings, f"mend what FAIL says, then bench test {name}"))
        raise typer.Exit(1)
    print(summary(findings, _next_command(name)))


def _next_command(name: str) -> str:
    """Return the command that uses a plug-in which has passed its test."""
    from bench.checking.contract.targets import DatasetSource, Method, find_target
    from data_prep.clouds.conditions import Condition
    from data_prep.datasets.registry import is_dataset
    from data_prep.plugins import announced

    target = find_target(name)
    if isinstance(target, Method):
        return f"bench add {name} DIR"
    installed = is_dataset(name) or name in (*announced("metric"), *announced("condition"))
    install = "" if installed else "pip install its package, then "
    if isinstance(target, DatasetSource):
        return f"{install}bench run --suite thirteen-classes --dataset {target.id}"
    if isinstance(target, Condition):
        return f"{install}bench run --suite chair-robustness --conditions {target.id}"
    return f"{install}bench score DIR --metrics {target.id}"


def printed(findings: Iterable[Finding], failed_only: bool = False) -> list[Finding]:
    """Print a line for each finding as it comes, or for each that is not ok; return all."""
    seen = []
    for finding in findings:
        if not (failed_only and finding.ok):
            print(f"{finding.verdict:<4} {finding.subject}: {visible(finding.text)}", flush=True)
        seen.append(finding)
    return seen
