"""The suite `stability`: extremes, and whether what happens there is what is stated.

Three matrices: methods on extreme clouds and views (killable workers, resumable), metrics on
extreme pictures and features, and pc2pix in other number formats.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from bench import manifest as manifests
from bench.columns import JobRow, write_records
from bench.job_results import do_jobs
from bench.methods import FLOORS, find_method, objectives
from bench.observations import Observation, observe
from bench.one_thread import one_thread
from bench.options import Options, refuse
from bench.pool import JobPool
from bench.probe import environment
from bench.progress import say
from bench.record import SCHEMA_VERSION
from bench.stability_cases import CASES, TURN_DEG, VIEWS
from bench.stability_expectations import STATED, outcome
from bench.stability_figures import write_matrix, write_pictures
from bench.stability_formats import (
    format_outcomes,
    formats_to_csv,
    formats_to_markdown,
    measure_formats,
)
from bench.stability_metrics import metric_outcomes
from bench.stability_plan import stability_jobs
from bench.stability_tables import Matrix, observations_to_csv
from bench.store import Settled, check_directory, open_journal, set_aside, write_manifest
from bench.suites import STABILITY, StabilitySuite
from bench.work import Job
from data_prep.failures import BadInput
from data_prep.whole_files import write_whole

TABLES = "tables"
FIGURES = "figures"


@dataclass(frozen=True)
class StabilityRun:
    """A finished run: where it is, its matrices, and how long it took."""

    directory: Path
    matrices: tuple[Matrix, ...]
    seconds: float


def run(options: Options, suite: StabilitySuite = STABILITY) -> StabilityRun:
    """Carry out the suite, or what is left of it. Raises BadInput for what the user has to mend."""
    start = time.perf_counter()
    _check(options, suite)
    methods = tuple(dict.fromkeys(options.methods or suite.methods))
    for method in methods:
        find_method(method)
    directory = options.directory
    workers = options.workers or manifests.cores()
    machine = environment()
    jobs = stability_jobs(suite, methods, options.seed, options.device, machine, directory)
    manifest = _describe(options, suite, methods, workers, machine)
    if options.fresh and (old := set_aside(directory)):
        say(f"the old run is now {old}")
    check_directory(directory, manifest)
    with open_journal(directory) as journal:
        write_manifest(directory, manifest)
        settled = do_jobs(
            jobs, journal, suite.id, partial(JobPool, limits=suite.limits, workers=workers)
        )
        for line in journal.damage:
            say(line)
        results = journal.lines.result
        rows = [JobRow(job.key, job.item, settled[job.key].artifact_sha256) for job in jobs]
        write_records(directory, rows, lambda row: results(row.key).records)
        observations = observe(jobs, results)
        say("metrics and number formats")
        matrices = _matrices(methods, observations, directory)
        _write(directory, matrices, observations)
        _draw(directory, matrices, jobs, settled, methods)
        write_manifest(directory, manifest | {"finished": manifests.now()})
    return StabilityRun(directory, matrices, time.perf_counter() - start)


def _check(options: Options, suite: StabilitySuite) -> None:
    """Raises BadInput for wishes that have no meaning here."""
    refuse(
        suite.id,
        (
            ("conditions", options.conditions, "its cases take their place"),
            ("views", options.views, "each case has its own"),
            ("limit", options.limit, "all cases are taken of one object"),
            ("shard", options.shard, "all cases are taken of one object"),
            ("ray", options.ray, "all cases are taken of one object"),
            ("inception-weights", options.inception_weights, "no fid is taken"),
        ),
    )
    if options.dataset != "procedural":
        raise BadInput(
            f"--dataset {options.dataset}: the suite {suite.id} states what happens to one "
            "procedural object; leave it"
        )


def _describe(
    options: Options,
    suite: StabilitySuite,
    methods: Sequence[str],
    workers: int,
    machine: Mapping[str, str],
) -> dict[str, Any]:
    return {
        "schema_version": SCHEMA_VERSION,
        "suite": suite.id,
        "dataset": options.dataset,
        "views": len(VIEWS),
        "seed": options.seed,
        "device": options.device,
        "methods": list(methods),
        "objectives": objectives(methods),
        "objects": [f"{suite.class_name}/test-{suite.index:04d}"],
        "cases": [case.id for case in CASES],
        "environment": dict(machine),
        "workers": workers,
    } | manifests.circumstances()


def _matrices(
    methods: Sequence[str], observations: Sequence[Observation], directory: Path
) -> tuple[Matrix, ...]:
    with one_thread():
        formats = measure_formats()
    for suffix, text in (("csv", formats_to_csv(formats)), ("md", formats_to_markdown(formats))):
        write_whole(directory / TABLES / f"number_formats.{suffix}", text.encode())
    return (
        Matrix(
            "stability_methods",
            "Methods at the extremes",
            _remark(methods),
            tuple(map(outcome, observations)),
        ),
        Matrix(
            "stability_metrics",
            "Metrics at the extremes",
            "Closed forms, invariants and refusals.",
            tuple(metric_outcomes()),
        ),
        Matrix(
            "stability_formats",
            "pc2pix in other number formats",
            "Against float64 on the same cloud; the figures are in number_formats.",
            tuple(format_outcomes(formats)),
        ),
    )


def _remark(methods: Sequence[str]) -> str:
    views = ", ".join(f"{view.azimuth_deg:g}/{view.elevation_deg:g}" for view in VIEWS)
    strangers = [method for method in methods if method not in STATED]
    remark = (
        f"One chair from four views (azimuth/elevation {views} degrees) unless the case says "
        "otherwise. Changes are absolute differences in grey levels 0..255, mean over all pixels "
        f"and at most, to the pictures of the case named. Turned: by {TURN_DEG:g} degrees."
    )
    if strangers:
        remark += f" Nothing is stated about {', '.join(strangers)}: what has a name is in order."
    return remark


def _write(
    directory: Path, matrices: Sequence[Matrix], observations: Sequence[Observation]
) -> None:
    files = {"observations.csv": observations_to_csv(observations)}
    for matrix in matrices:
        files |= {f"{matrix.name}.csv": matrix.to_csv(), f"{matrix.name}.md": matrix.to_markdown()}
    for name, text in files.items():
        write_whole(directory / TABLES / name, text.encode())


def _draw(
    directory: Path,
    matrices: Sequence[Matrix],
    jobs: Sequence[Job],
    settled: Mapping[str, Settled],
    methods: Sequence[str],
) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    folder = directory / FIGURES
    folder.mkdir(exist_ok=True)
    for matrix in matrices:
        write_matrix(folder / f"{matrix.name}.png", matrix)
    first = {
        (job.condition, job.method): job.made.pictures()[0]
        for job in jobs
        if settled[job.key].artifact_sha256
    }
    rivals = [method for method in methods if method not in FLOORS]
    write_pictures(folder / "extremes.png", [case.id for case in CASES], rivals, first)
