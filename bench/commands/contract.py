"""`bench test`: a plug-in against its contract."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

import typer

from bench.catalogue.lookup import family_of
from bench.catalogue.methods import search_folder
from bench.check.contract.findings import Finding, is_blocked, summary
from bench.tables.markdown import visible
from data_prep.datasets.registry import OUR_KINDS, is_dataset, open_dataset
from data_prep.plugins import announced


def test(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help="A method ('convex-hull', 'splat-net@FILE.safetensors'), a metric or condition of "
            "another package, a dataset ('list:PATH'), or MODULE:NAME for a plug-in in a module "
            "without a package; for a reader of datasets MODULE:NAME:PATH. The module may be in "
            "the current folder; no other form executes files there.",
        ),
    ],
) -> None:
    """Test a method, metric, dataset or condition of your own, in a minute of processor time.

    Exit 0 if it keeps the contract, 1 if something blocks a run or falsifies its results.
    """
    from bench.check.contract.plugin import plugin_findings

    if ":" in family_of(name) and not is_dataset(name):  # the form MODULE:NAME
        search_folder()
    if name.partition(":")[0] in OUR_KINDS:
        open_dataset(name)  # what cannot be opened is refused in one line, not in one for each step
    findings = printed(plugin_findings(name))
    if is_blocked(findings):
        print(summary(findings, f"fix what is marked FAIL, then bench test {name}"))
        raise typer.Exit(1)
    print(summary(findings, _next_command(name)))


def _next_command(name: str) -> str:
    """Return the command that uses a plug-in which has passed its test."""
    from bench.check.contract.targets import DatasetSource, Method, find_target
    from data_prep.clouds.conditions import Condition

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
    """Print a line for each finding as it comes, and return all of them.

    With `failed_only`, findings that are ok are not printed.
    """
    seen = []
    for finding in findings:
        if not (failed_only and finding.ok):
            print(f"{finding.verdict:<4} {finding.subject}: {visible(finding.text)}", flush=True)
        seen.append(finding)
    return seen
