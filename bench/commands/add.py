"""`bench add`: a further method in a finished run, and whether it is ahead of the best there."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from bench.catalogue.lookup import variant_of
from bench.catalogue.method import allow_modules, is_module_name, stated_id
from bench.catalogue.methods import find_run_method
from bench.commands.config import JOB_SUITES, repeated_request
from bench.commands.contract import printed
from bench.commands.options import RunDirectory, WorkersOption, names, worker_count
from bench.commands.publish import run_suite
from bench.commands.run import leave, print_ending
from bench.commands.terminal import shown
from bench.records.run_folder import MANIFEST, read_finished
from bench.report.build import REPORT
from bench.running.options import Options, read_shard
from bench.tables.markdown import visible
from data_prep.failures import BadInput
from data_prep.plugins import announced


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
    from bench.checking.contract.findings import is_blocked, summary
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
