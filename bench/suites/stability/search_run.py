"""The run of a search for extremes, `bench run --suite stability --search TIME`, and its tables."""

from __future__ import annotations

import re
import shlex
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from bench.catalogue.loaders import GPU
from bench.catalogue.suites import StabilitySuite
from bench.records.run_folder import MANIFEST
from bench.running.environment import cores, environment
from bench.running.manifest import manifest_of
from bench.running.options import RUNS, Options
from bench.running.run import open_run
from bench.suites.procedure import SuiteRun, methods_of
from bench.suites.stability.generated import CloudInput
from bench.suites.stability.metrics import METRICS
from bench.suites.stability.oracles import SearchSubject, method_subject, metric_subject
from bench.suites.stability.outcomes import CaseOutcome
from bench.suites.stability.search import FailingInput, SearchResult, require_hypothesis, search
from bench.suites.stability.tables import matrix
from bench.tables import markdown
from bench.tables.grid import Block, grid
from bench.tables.table import Table, columns_of, write_tables
from data_prep.failures import BadInput
from data_prep.files.clouds import save_ply
from data_prep.progress import log

FOLDER = "smallest"  # of the clouds that fail
EXPECTED = "a valid result or a named failure, the same again, within time and memory"


@dataclass(frozen=True)
class SearchRow:
    """A kind of failure of a method or metric, or a row without one.

    Attributes
    ----------
    inputs, refused, seconds, inputs_per_s
        Of all inputs of the method or metric; `refused` by a named failure.
    problem, seed, smallest
        The failure, the seed that finds it at once, and its smallest input as a Python expression
        of `bench.suites.stability.generated`; empty without a failure.
    command : str
        Command that draws the smallest cloud; empty for a metric.
    """

    subject: str
    inputs: int
    refused: int
    seconds: float
    inputs_per_s: float
    unexpected: int
    problem: str = ""
    seed: int | None = None
    smallest: str = ""
    command: str = ""


def run_search(
    options: Options,
    suite: StabilitySuite,
    subjects: Sequence[SearchSubject] | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> SuiteRun:
    """Search the methods and metrics of a request, and write tables and the smallest clouds.

    Without methods and metrics in the request, all are searched. The tables are written anew after
    each method or metric. Raises BadInput for options that the user has to fix.
    """
    start, seconds = clock(), options.search or 0.0
    directory = options.out or RUNS / "stability-search"
    options = replace(options, out=directory)
    if subjects is None:
        subjects = _subjects(options, suite)
    require_hypothesis()
    if (directory / MANIFEST).exists() and not options.fresh:
        raise BadInput(f"{directory}: holds a run; give another --out, or --fresh to start over")
    hours = seconds * len(subjects) / 3600
    log(f"{len(subjects)} methods and metrics, {seconds:g} s each: {hours:.2g} h")
    workers, seed = options.workers or cores(), options.seed or 0
    methods = [subject.id for subject in subjects if subject.id not in METRICS]
    manifest = manifest_of(
        options,
        suite.id,
        0,
        environment(),
        methods=methods,
        search_s=seconds,
        workers=workers,
    )
    del manifest["request"]  # `--config` knows no search
    rows: list[SearchRow] = []
    tables: tuple[Table[SearchRow], Table[CaseOutcome]] = _tables(rows)
    with open_run(directory, manifest, options.fresh):
        for subject in subjects:
            rows += _rows(search(subject, seconds, seed, workers, clock=clock), directory)
            tables = _tables(rows)
            write_tables(directory, tables)
    printed = [markdown.document(list(_layout(rows)))]
    return SuiteRun(directory, tables, printed, f"{clock() - start:.0f} s")


def stability_methods(options: Options, suite: StabilitySuite) -> tuple[str, ...]:
    """Return the methods of a run of the suite. Raises BadInput for options without a meaning."""
    methods = methods_of(
        options,
        suite,
        conditions="its cases take their place",
        views="each case has its own",
        **dict.fromkeys(("limit", "shard", "ray"), "all cases are taken of one object"),
        inception_weights="no fid is taken",
    )
    if options.dataset != "procedural":
        raise BadInput(
            f"--dataset {options.dataset}: the suite {suite.id} states what happens to one "
            "procedural object; leave it"
        )
    return methods


def _subjects(options: Options, suite: StabilitySuite) -> list[SearchSubject]:
    methods: tuple[str, ...] = ()
    if options.methods is not None or options.metrics is None:
        # The folder of a search has no methods to keep.
        methods = stability_methods(replace(options, metrics=None, fresh=True), suite)
    metrics = options.metrics or () if options.methods or options.metrics else tuple(METRICS)
    device = GPU if options.device == GPU else "cpu"
    return [
        *(method_subject(method, device) for method in methods),
        *map(metric_subject, dict.fromkeys(metrics)),
    ]


def _rows(result: SearchResult, directory: Path) -> Iterator[SearchRow]:
    """Yield a row for each failure, or one without; write the clouds that fail."""
    row = SearchRow(
        result.subject,
        result.inputs,
        result.refused,
        round(result.seconds, 1),
        round(result.inputs / max(result.seconds, 1e-9), 2),
        len(result.failing),
    )
    if not result.failing:
        yield row
    for number, failing in enumerate(result.failing.values(), start=1):
        name = re.sub(r"[^A-Za-z0-9._@-]+", "-", result.subject)[-100:]
        path = directory / FOLDER / f"{name}-{number}.ply"
        yield replace(
            row,
            problem=failing.problem,
            seed=failing.seed,
            smallest=repr(failing.input),
            command=_command(result.subject, failing, path),
        )


def _command(subject: str, failing: FailingInput, path: Path) -> str:
    """Write the cloud of a failing input, and return the command that draws it."""
    if not isinstance(failing.input, CloudInput):
        return ""
    save_ply(failing.input.cloud().points, path)
    view = failing.input.views[0]
    arguments = ("--as-is", "--method", subject, "--azimuth", repr(view.azimuth_deg))
    more = ("--elevation", repr(view.elevation_deg), "-o", "out.png")
    return shlex.join(["bench", "render", str(path), *arguments, *more])


def _tables(rows: Sequence[SearchRow]) -> tuple[Table[SearchRow], Table[CaseOutcome]]:
    """Return the table of a search, and its verdicts, which `bench check` reads."""
    remark = "Generated inputs; the table `search` has all numbers."
    return (
        Table("search", "Search for extremes", columns_of(SearchRow, ".6g"), tuple(rows), _layout),
        matrix("stability_search", "Search for extremes", remark, map(_outcome, rows)),
    )


def _outcome(row: SearchRow) -> CaseOutcome:
    if not row.problem:
        observed = f"{row.inputs:,} inputs, {row.refused:,} of them refused by name"
        return CaseOutcome("search", "search", row.subject, EXPECTED, observed, "holds")
    case = f"search-{row.seed}"
    observed = f"{row.problem}: {row.smallest}"
    return CaseOutcome(case, "search", row.subject, EXPECTED, observed, "unexpected")


def _layout(rows: Sequence[SearchRow]) -> Iterator[Block]:
    first = {row.subject: row for row in rows}
    yield f"Expected of each input: {EXPECTED}."
    yield grid(
        ["method or metric", "inputs", "refused", "inputs/s", "kinds of failure"],
        (
            [r.subject, f"{r.inputs:,}", f"{r.refused:,}", f"{r.inputs_per_s:g}", str(r.unexpected)]
            for r in first.values()
        ),
    )
    for row in rows:
        if row.problem:
            lines = [f"**{row.subject}**: {row.problem}; seed {row.seed}", f"`{row.smallest}`"]
            yield "\n\n".join([*lines, *([f"`{row.command}`"] if row.command else [])])
