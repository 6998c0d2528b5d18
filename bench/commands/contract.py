"""`bench test` and `bench add`: a plug-in against its contract, a method in a finished run."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from bench.catalogue.lookup import family_of, variant_of
from bench.catalogue.method import allow_modules, is_module_name, search_folder, stated_id
from bench.catalogue.methods import find_run_method
from bench.checking.contract.findings import Finding, is_blocked, summary
from bench.commands.config import JOB_SUITES, repeated_request
from bench.commands.options import RunDirectory, WorkersOption, names, worker_count
from bench.records.run_folder import MANIFEST, read_finished
from bench.running.options import Options, read_shard
from bench.tables.markdown import visible
from data_prep.failures import BadInput
from data_prep.plugins import announced


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


def add(
    methods: Annotated[
        str,
        typer.Argument(
            metavar="METHOD",
            help="A method, or several, comma-separated: as --methods of 'bench run' takes them; "
            "MODULE:NAME of a module in the current folder, too, which alone executes files of it.",
        ),
    ],
    directory: RunDirectory,
    workers: WorkersOption = None,
    test: Annotated[
        bool,
        typer.Option(
            "--test/--no-test",
            help="Test a method of your own first, as 'bench test'. A method of more than 20 "
            "seconds a cloud does not pass.",
        ),
    ] = True,
) -> None:
    """Add a method to a finished run: test it, draw what the run drew, compare it with the best.

    The best of the other methods by each metric of the headline table, and best-reconstruction.

    Only its jobs are done. Exit 1 if the test finds what blocks a run, or if all its images fail.
    """
    from bench.commands.publish import run_suite
    from bench.commands.run import leave, print_ending
    from bench.commands.terminal import shown
    from bench.report.build import REPORT

    options = options_of(directory, names(methods) or (), worker_count(workers))
    asked = options.methods or ()
    allow_modules(asked)
    for name in asked:
        if test and is_own(name):
            _pass_test(name)
    finished = run_suite(options)
    ids = [find_run_method(name).id for name in asked]
    if finished.outputs is not None:
        for line in (*shown(finished.outputs.headline), *_verdict_lines(directory, ids)):
            print(line)
        print(f"report: {directory / REPORT}")
    new = tuple(name for name in finished.hopeless if name in ids)  # others were so before
    finished = replace(finished, hopeless=new)
    print_ending(finished)
    leave(finished)


def options_of(directory: Path, methods: Sequence[str], workers: int | None) -> Options:
    """Return the options of a run of these methods on the objects and views of a finished run.

    Raises BadInput for a run that is not finished, or that this version cannot go on with.
    """
    manifest = read_finished(directory)
    if (suite := manifest["suite"]) not in JOB_SUITES:
        raise BadInput(
            f"{directory}: a run of the suite {suite}; use 'bench run --suite {suite} --methods "
            f"{','.join(methods)} --out {directory}', which goes on with it"
        )
    request = repeated_request(directory / MANIFEST)
    values = {k: tuple(v) if isinstance(v, list) else v for k, v in request.items()}
    if "shard" in values:
        values["shard"] = read_shard(str(values["shard"]))
    asked = {"methods": tuple(methods), "workers": workers, "out": directory}
    asked["device"] = manifest["device"]
    return Options(**{**values, **asked, "same_objects": True})


def is_own(name: str) -> bool:
    """Return whether a method, or its weights, are of the user and not of this project."""
    is_file = variant_of(name).endswith(".safetensors")
    return is_file or is_module_name(name) or name in announced("method")


def _pass_test(name: str) -> None:
    """Test a method, and print what is not kept. Raises typer.Exit where this blocks a run."""
    from bench.checking.contract.plugin import plugin_findings

    print(f"testing {name}, at most a minute", file=sys.stderr)
    findings = printed(plugin_findings(name), failed_only=True)
    if is_blocked(findings):
        print(summary(findings, "mend what FAIL says, then add it again"))
        raise typer.Exit(1)
    print(summary(findings))


def _verdict_lines(directory: Path, methods: Sequence[str]) -> Iterator[str]:
    """Yield the lines of each method against the best of a run, paired object by object."""
    from bench.analysis.run_pairs import against_best
    from bench.tables.differences import comparison_lines
    from bench.tables.terminal import terminal_width

    for method in methods:
        name = stated_id(method)
        if name != method:
            yield f"{name}: {method} in the tables"
        for metrics, differences in against_best(directory, method, methods):
            yield ""
            if metrics:
                yield f"the best there by {' and '.join(metrics)}: {visible(differences.a)}"
            named = replace(differences, b=name)
            yield from comparison_lines(named, terminal_width(), hint="")
            command = f"bench compare {directory} --methods {differences.a},{method} --format md"
            yield f"intervals: {command}"
    yield ""
