"""`bench run`, and what it prints with `--dry-run`: the protocol and cost of the run."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping
from importlib import import_module
from typing import Annotated, Any

import typer

from bench.catalogue.chosen import MeasuredMethod, measured_methods
from bench.catalogue.lookup import find
from bench.catalogue.methods import allow_modules
from bench.catalogue.plugins import find_metric
from bench.catalogue.suites import ALL_SUITES, TRUTHS, Suite
from bench.commands.config import ConfigOption, refuse_other_objects
from bench.commands.options import RUN_OPTIONS, FormatOption, options_from_dataclass
from bench.commands.printing import in_format, print_outputs
from bench.commands.terminal import watching
from bench.finish import run_suite
from bench.report.build import REPORT
from bench.running.options import Options
from bench.running.run import RunResult, RunStatus, run_status
from bench.tables.build import Outputs
from bench.tables.markdown import visible
from data_prep.failures import BadInput


def describe_run(options: Options) -> str:
    """Return the protocol, folder, files of weights and expected cost of a run, as text.

    Raises BadInput where the run would, and for suites without jobs, such as speed and latent.
    """
    suite = find(options.suite, ALL_SUITES, "suite")
    if not isinstance(suite, Suite):
        raise BadInput(
            f"--dry-run: the suite {suite.id} has no jobs to describe and takes minutes; leave out "
            "--dry-run"
        )
    for metric in options.metrics or ():
        find_metric(metric)  # raises BadInput for an unknown metric
    status = run_status(options)
    protocol = status.plan.protocol
    methods = {}
    for name, (version, libraries, _) in protocol.identities.items():
        methods[name] = f"version {version}" + (f", {libraries}" if libraries else "")
    files = {name: method.weights_file for name, method in protocol.methods.items()}
    weights = {method: str(file()) for method, file in files.items() if file}
    lines = [f"{name:<13}{visible(text)}" for name, text in _settings(status, options)]
    lines += _section("methods", methods)
    lines += _section("weights", weights | dict(protocol.features))
    lines += _section("skipped", protocol.skipped)
    lines += ["", *_expected(status, measured_methods())]
    return "\n".join(lines)


def _settings(status: RunStatus, options: Options) -> list[tuple[str, str]]:
    """Return name and text of each setting of a run, in the order in which they are printed."""
    protocol = status.plan.protocol
    suite, classes = protocol.suite, Counter(obj.class_name for obj in protocol.objects)
    features = dict(protocol.features)
    set_metrics = [metric for metric in suite.set_metrics if metric in features]
    if not status.directory.exists():
        state = "new"
    else:
        state = "the run there would be renamed" if options.fresh else "there already"
    if options.ray:
        workers = f"those of the Ray cluster {options.ray}"
    else:
        workers = f"{status.workers} processes of this machine"
    settings = [
        ("suite", f"{suite.id}: {suite.about}"),
        ("dataset", protocol.dataset),
        ("truth", TRUTHS[suite.truth]),
        ("objects", ", ".join(f"{number} {name}" for name, number in classes.items())),
        ("conditions", ", ".join(protocol.conditions)),
        ("views", str(protocol.views)),
        ("seed", str(protocol.seed)),
        ("device", protocol.device),
        ("workers", workers),
        ("limits", f"{suite.limits.time_s:g} s and {suite.limits.memory_gib:g} GiB a job"),
        ("metrics", ", ".join([*suite.image_metrics, *suite.detail_metrics, *set_metrics])),
    ]
    if options.metrics:
        settings.append(("on request", ", ".join(options.metrics)))
    environment = ", ".join(f"{name} {text}" for name, text in protocol.environment.items())
    settings += [
        ("of a judge", ", ".join(suite.control_metrics) or "nothing"),
        ("environment", environment),
        ("folder", f"{status.directory} ({state})"),
    ]
    return settings


def _expected(status: RunStatus, costs: Mapping[str, MeasuredMethod]) -> list[str]:
    """Return the jobs that are left, and the time and disk space that they take."""
    lines = [f"jobs: {status.jobs:,} to do, {status.done:,} done"]
    if not status.jobs:
        return lines
    seconds = status.seconds(costs)
    if seconds < 120:
        time = f"{seconds:.0f} s"
    else:
        time = f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
    workers = "one worker" if status.workers == 1 else f"{status.workers} workers"
    lines.append(f"time: about {time} with {workers}, by the costs that 'bench list' shows")
    if unmeasured := status.unmeasured(costs):
        lines.append(f"without a measured cost, left out of the time: {', '.join(unmeasured)}")
    return [*lines, f"disk: about {status.size_b / 1e6:,.0f} MB"]


def _section(title: str, lines: Mapping[str, str]) -> list[str]:
    """Return an empty line, the title and a line for each name; nothing without any name."""
    if not lines:
        return []
    shown = [f"  {visible(name):<24} {visible(text)}" for name, text in lines.items()]
    return ["", f"{title}:", *shown]


@options_from_dataclass(Options, RUN_OPTIONS)
def run(
    options: Options,
    context: typer.Context,
    config: ConfigOption = None,
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run",
            help="Print what would run, with the number of jobs, the time and the disk space that "
            "it takes; run nothing.",
        ),
    ] = False,
    format_: FormatOption = None,
) -> None:
    """Run a suite, or go on with a stopped run; print its headline table."""
    refuse_other_objects(options, config)
    source: Any = context.get_parameter_source("methods")
    if config is None or source.name == "COMMANDLINE":
        # Only what the user typed may name a module to execute: a manifest may be a stranger's.
        allow_modules(options.methods or ())
    suite = find(options.suite, ALL_SUITES, "suite")
    if dry_run:
        print(describe_run(options))
        return
    if not isinstance(suite, Suite):
        result = import_module(f"bench.suites.{suite.id}.run").run(options)
        texts = result.printed if format_ is None else [in_format(result.tables, format_)]
        print("\n".join(texts))
        print(f"{result.summary}\nresults in {result.directory}", file=sys.stderr)
        return
    finished = run_suite(options, watching())
    if finished.outputs is not None:
        print_outputs(finished.outputs, format_)
    print_ending(finished)
    leave(finished)


def print_ending(finished: RunResult[Outputs]) -> None:
    """Print on stderr what was done, what is not complete, and which methods have no image."""
    directory = finished.directory
    print(f"{_summary(finished)}\nresults in {directory}", file=sys.stderr)
    run = finished.outputs.run if finished.outputs else None
    if run is not None:
        for line in (*run.not_measured, *run.far_off):
            print(f"bench: {visible(line)}", file=sys.stderr)
    if finished.objects < finished.planned:
        kept = "" if finished.outputs is not None else "; the tables there stay those of before"
        if finished.interrupted:
            why, without = "interrupted", ""
        else:
            why, without = "the budget is used up", " without --budget"
        print(
            f"bench: {why}: {finished.objects} of {finished.planned} objects are complete{kept}; "
            f"the same command{without} goes on with the others",
            file=sys.stderr,
        )
    if finished.hopeless:
        print(
            f"bench: without a single image: {', '.join(finished.hopeless)}; the reasons are in "
            f"{directory / REPORT}",
            file=sys.stderr,
        )


def leave(finished: RunResult[Outputs]) -> None:
    """Raise typer.Exit where the run was interrupted, or where a method has no image at all."""
    if finished.interrupted:
        raise typer.Exit(130)
    if finished.hopeless:
        raise typer.Exit(1)


def _summary(finished: RunResult[Outputs]) -> str:
    stages = ", ".join(f"{name} {value:.1f} s" for name, value in finished.seconds.items())
    parts = ", ".join(f"{name} {share:.0%}" for name, share in finished.shares.items())
    return (
        f"{finished.done} jobs done, {finished.reused} from before, {finished.failed} failed "
        f"({stages})\ntime of the workers: {parts}"
    )
