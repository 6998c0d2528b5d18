"""`bench test`: the check of a plug-in against the contract of the benchmark."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from bench.catalogue.lookup import family_of
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
        sys.path.append(str(Path.cwd()))  # last: no file of this folder hides an installed module
    findings = printed(plugin_findings(name))
    print(summary(findings))
    if is_blocked(findings):
        raise typer.Exit(1)


def printed(findings: Iterable[Finding], failed_only: bool = False) -> list[Finding]:
    """Print a line for each finding as it comes, or for each that is not ok; return all."""
    seen = []
    for finding in findings:
        if not (failed_only and finding.ok):
            print(f"{finding.verdict:<4} {finding.subject}: {visible(finding.text)}", flush=True)
        seen.append(finding)
    return seen
