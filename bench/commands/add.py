"""`bench add`: a method is added to a finished run, and set against the best there."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from bench.catalogue.lookup import variant_of
from bench.catalogue.methods import allow_modules, find_run_method, is_module_name
from bench.check.contract.findings import is_blocked, summary
from bench.commands.config import JOB_SUITES, repeated_request
from bench.commands.contract import printed
from bench.commands.options import (
    RunDirectory,
    WorkersOption,
    names,
    path_option,
    worker_count,
)
from bench.entered.claims import ENTERED, IMAGES_PREFIX
from bench.records.folder import MANIFEST, read_finished
from bench.running.options import Options, default_name
from data_prep.datasets.exported import ExportedObject
from data_prep.datasets.registry import open_dataset
from data_prep.failures import BadInput
from data_prep.plugins import announced
from data_prep.progress import log


def add(
    methods: Annotated[
        str,
        typer.Argument(
            metavar="METHOD",
            help="A method, or several, comma-separated, as --methods of 'bench run' takes them; "
            "or MODULE:NAME for a method in a module, which may be in the current folder (no other "
            "form executes files there); or images:TREE for a method that drew an export "
            "elsewhere, see docs/extending.md.",
        ),
    ],
    directory: RunDirectory,
    workers: WorkersOption = None,
    test: Annotated[
        bool,
        typer.Option(
            "--test/--no-test",
            help="Test a method of your own first, as 'bench test' does. A method that needs more "
            "than 20 seconds for a cloud does not pass.",
        ),
    ] = True,
    dataset: Annotated[
        str | None,
        typer.Option(
            help="A dataset with other objects, as --dataset of 'bench run' takes it. The methods "
            "of the run and yours are measured on it with the settings of the run, in a new folder "
            "beside DIR. Default: the objects of the run.",
        ),
    ] = None,
    limit: Annotated[
        int | None,
        typer.Option(help="Objects of each class of --dataset at most. Default: as in the run."),
    ] = None,
    out: Annotated[
        Path | None,
        path_option("The folder of the run on --dataset. Default: DIR-DATASET, beside DIR."),
    ] = None,
) -> None:
    """Add a method to a finished run: test it, draw what the run drew, and say where it stands.

    Printed are its values, its place, and how it compares, object by object, with the best of the
    other methods by each metric of the headline table, and with best-classical.

    Only its jobs are done. Exit 1 if the test finds what blocks a run, or if all its images fail.
    """
    from bench.commands.run import leave, print_ending
    from bench.commands.terminal import shown, watching
    from bench.finish import run_suite
    from bench.report.build import REPORT
    from bench.tables.differences import standing_lines
    from bench.tables.terminal import terminal_width

    asked = names(methods) or ()
    options = options_of(directory, asked, worker_count(workers))
    if dataset is not None:
        options = on_dataset(options, dataset, limit, out)
    elif limit is not None or out is not None:
        name = "--out" if limit is None else "--limit"
        raise BadInput(f"{name}: the objects are those of {directory}; give --dataset with it")
    elif any(name.startswith(IMAGES_PREFIX) for name in asked):
        options = with_export(options, asked)
    allow_modules(asked)
    for name in asked:
        if test and is_own(name):
            _pass_test(name)
    finished = run_suite(options, watching())
    ids = [find_run_method(name).id for name in asked]
    if finished.outputs is not None:
        run, headline = finished.outputs.run, finished.outputs.headline
        print("\n".join(shown(headline)))
        for name in ids:
            print("\n".join(standing_lines(run, headline, name, ids, terminal_width())))
        print(f"\nreport: {finished.directory / REPORT}")
    # Methods of the run that had no image before are no result of this command.
    new = tuple(name for name in finished.hopeless if name in ids)
    finished = replace(finished, hopeless=new)
    print_ending(finished)
    leave(finished)


def options_of(directory: Path, methods: Sequence[str], workers: int | None) -> Options:
    """Return the options of a run of these methods on the objects and views of a finished run.

    Raises BadInput for a run that is not finished, or that this version cannot go on with.
    """
    manifest = read_finished(directory)
    if (suite := manifest["suite"]) not in JOB_SUITES:
        every = ",".join(dict.fromkeys((*manifest["methods"], *methods)))
        raise BadInput(
            f"{directory}: a run of the suite {suite}; use 'bench run --suite {suite} --methods "
            f"{every} --out {directory}', which goes on with it"
        )
    request = repeated_request(directory / MANIFEST)
    values = {k: tuple(v) if isinstance(v, list) else v for k, v in request.items()}
    asked = {"methods": tuple(methods), "workers": workers, "out": directory}
    asked["device"] = manifest["device"]
    return Options(**{**values, **asked, "adds": True})


def with_export(options: Options, methods: Sequence[str]) -> Options:
    """Return the options with the checksum that an export of the run's inputs would have.

    Where the dataset is itself an export, they are unchanged. Raises BadInput where images among
    the methods were drawn of another export than the run's inputs would give.
    """
    from bench.running.export import checksum_of_inputs

    drawn = [find_run_method(name) for name in methods if name.startswith(IMAGES_PREFIX)]
    if open_dataset(options.dataset).checksum is not None:
        return options
    log(f"{options.dataset}: its clouds and true images are compared with those of the export")
    export = checksum_of_inputs(options)
    for method in drawn:
        if method.images is not None and method.images.claims.export != export:
            run = read_finished(options.directory)
            raise BadInput(
                f"{method.id}: its export has other clouds or views than {options.directory}: "
                f"{len(run['objects'])} objects of {run['dataset']}, {run['views']} views, "
                f"conditions {', '.join(run['conditions'])}, seed {run['seed']}; draw an export of "
                "these, or measure the methods of the run on yours with --dataset exported:PATH"
            )
    return replace(options, export=export)


def on_dataset(options: Options, dataset: str, limit: int | None, out: Path | None) -> Options:
    """Return the options of `bench add` for a run on another dataset, alike but for the objects.

    Its methods are those of the run and the new ones. Methods of the run that cannot draw there are
    left out, as a line on stderr says. Raises BadInput for an unknown dataset.
    """
    opened = open_dataset(dataset)
    before, asked = read_finished(options.directory), options.methods or ()
    bound = {*before.get(ENTERED, ()), *filter(is_module_name, before["methods"])}
    kept = [m for m in before["methods"] if m not in bound]
    if left_out := [m for m in before["methods"] if m not in kept and m not in asked]:
        why = "images of other clouds, or of a module that this command does not name"
        log(f"{', '.join(left_out)}: left out on {dataset}: {why}")
    exported = [obj for obj in opened.finite or () if isinstance(obj, ExportedObject)]
    views = (options.views, *(len(obj.exported_views) for obj in exported))
    conditions = before["conditions"]
    if exported and any(name.startswith(IMAGES_PREFIX) for name in asked):
        drawn = set.intersection(*({name for name, _ in obj.clouds} for obj in exported))
        conditions = [name for name in conditions if name in drawn]
        if left_out := [name for name in before["conditions"] if name not in drawn]:
            log(f"{dataset}: has no clouds of {', '.join(left_out)}, which are left out")
        if not conditions:
            raise BadInput(f"{dataset}: has no clouds of the conditions of the run; export these")
    beside = options.directory if options.directory.name else options.directory.resolve()
    return replace(
        options,
        dataset=dataset,
        conditions=tuple(conditions),
        methods=tuple(dict.fromkeys((*kept, *asked))),
        limit=options.limit if limit is None else limit,
        views=min(filter(None, views)),
        seed=options.seed if opened.seed is None else None,
        out=out or beside.with_name(default_name(beside.name, dataset)),
        adds=False,
    )


def is_own(name: str) -> bool:
    """Return whether a method, or its file of weights, is the user's and not this project's."""
    is_file = variant_of(name).endswith(".safetensors")
    return is_file or is_module_name(name) or name in announced("method")


def _pass_test(name: str) -> None:
    """Test a method, and print the points of the contract that it does not keep.

    Raises typer.Exit where one of them blocks a run.
    """
    from bench.check.contract.plugin import plugin_findings

    print(f"testing {name}, at most a minute of processor time", file=sys.stderr)
    findings = printed(plugin_findings(name), failed_only=True)
    if is_blocked(findings):
        print(summary(findings, "fix what is marked FAIL, then add it again"))
        raise typer.Exit(1)
    print(summary(findings))
