"""The parts that suites with a procedure of their own share: checks, folder, files and result.

Such a suite (stability, speed, latent) does not draw all methods under all conditions, as other
suites do, but measures something else in its own way.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.catalogue.methods import find_method, objectives
from bench.catalogue.suites import Procedure
from bench.records.folder import MANIFEST, read_manifest
from bench.records.store import Store
from bench.report.plots import FIGURES, save
from bench.running.environment import environment_changes, environment_of
from bench.running.options import Options, refuse, refuse_values
from bench.running.protocol import manifest_of
from bench.running.run import open_run
from bench.tables.table import Table, write_tables
from data_prep.progress import log

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class SuiteRun:
    """The result of a run of such a suite."""

    # The tables of the run. Those without a layout are for scripts alone: they are written, but
    # `run_suite` does not return them.
    tables: tuple[Table, ...]
    figures: Mapping[str, Figure] = field(default_factory=dict)  # by the names of their files
    summary: str = ""  # the last line that `bench run` prints; `run_suite` adds the time to it
    printed: Sequence[str] = ()  # what `bench run` prints before; where it is empty, the tables
    directory: Path = Path()  # the folder of the run, set by `run_suite`


def suite_manifest(
    options: Options,
    suite: Procedure,
    views: int,
    environment: Mapping[str, str],
    **entries: object,
) -> dict[str, Any]:
    """Return the manifest of a run.

    options      with the values that the suite has chosen for options that were not given, so that
                 the manifest says all that repeats the run
    environment  the driver and the libraries that images depend on
    entries      further entries that only this suite has
    """
    methods = options.methods or ()
    entries = {"objectives": objectives(map(find_method, methods))} | entries
    return manifest_of(
        request=options.request,
        environment=environment,
        suite=suite.id,
        dataset=options.dataset,
        views=views,
        seed=options.seed or 0,
        device=options.device,
        methods=list(methods),
        **entries,
    )


def run_suite(
    options: Options, manifest: dict[str, Any], procedure: Callable[[Store], SuiteRun]
) -> SuiteRun:
    """Carry out a procedure in the folder of a run, and write its tables and figures.

    procedure  takes the store of the folder, and measures

    Raises BadInput where the folder holds another run.
    """
    start, directory = time.perf_counter(), options.directory
    if not options.fresh and (directory / MANIFEST).is_file():
        was, here = environment_of(read_manifest(directory)), environment_of(manifest)
        if changes := environment_changes(was, here):
            log(f"{directory}: goes on in another environment: {changes}; --fresh starts over")
    with open_run(directory, manifest, options.fresh) as store:
        done = procedure(store)
        write_tables(directory, done.tables)
        for name, figure in done.figures.items():
            save(figure, directory / FIGURES / f"{name}.png")
        # A run before, with other methods perhaps, may have left figures that this one has not.
        for old in (directory / FIGURES).glob("*.png"):
            if old.stem not in done.figures:
                old.unlink()
    readable = tuple(table for table in done.tables if table.layout)
    return replace(
        done,
        tables=readable,
        summary=f"{done.summary}{time.perf_counter() - start:.0f} s",
        printed=done.printed or [table.to_markdown() for table in readable],
        directory=directory,
    )


def methods_of(options: Options, suite: Procedure, **meaningless: str) -> tuple[str, ...]:
    """Return the methods of a run, each once, in the order in which they are asked for.

    Without `--methods` they are those of the suite, in its order.

    meaningless  the options that this suite does not take, beside those that no such suite takes,
                 each with the reason

    Raises BadInput for a meaningless option, for counts out of their range, for a missing GPU and
    for unknown methods.
    """
    given = vars(options)
    meaningless = {
        "budget": "which is not done object by object",
        "truth": "which has no true images in grey",
        "metrics": "which does not compare images with true ones",
        "inception_weights": "no fid is taken",
        **meaningless,
    }
    refuse(suite.id, [(name, given[name], why) for name, why in meaningless.items()])
    refuse_values(options)
    methods = tuple(dict.fromkeys(options.methods or suite.methods))
    for method in methods:
        find_method(method)
    return methods
