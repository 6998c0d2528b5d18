"""The suite `stability`: methods at the extremes, and whether the outcomes are as expected.

Workers that can be killed draw the clouds, and a run that was stopped goes on.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from bench.catalogue.methods import FLOORS, find_method, objectives
from bench.records.artifacts import unpack_images
from bench.records.job import Job
from bench.records.parquet import write_records
from bench.records.record import SCHEMA_VERSION
from bench.report.figure import FIGURES, save
from bench.running.environment import cores, environment
from bench.running.executors import JobPool, run_jobs
from bench.running.options import Options
from bench.running.plan import digest
from bench.running.protocol import manifest_of, method_identity
from bench.running.run import open_run
from bench.suites.procedure import SuiteRun, methods_of
from bench.suites.stability.cases import CASES, TURN_DEG, VIEWS
from bench.suites.stability.expectations import EXPECTED
from bench.suites.stability.figures import extremes_figure, matrix_figure
from bench.suites.stability.outcomes import CaseOutcome, observe, outcome
from bench.suites.stability.suite import STABILITY, StabilitySuite
from bench.suites.stability.tables import counts, matrix, observations_table, unexpected
from bench.tables import markdown
from bench.tables.table import Table, write_tables
from data_prep.datasets.registry import ProceduralObject
from data_prep.failures import BadInput
from data_prep.scene import UInt8Images

CASES_VERSION = 1  # raise when a perturbation of `data_prep.clouds.extremes` changes a cloud


def stability_jobs(
    suite: StabilitySuite,
    methods: Sequence[str],
    seed: int,
    device: str,
    environment: Mapping[str, str],
) -> list[Job]:
    """Return one job per method, case and repetition, without ground truth.

    Raises BadInput for an unknown method.
    """
    obj = ProceduralObject(suite.class_name, "test", suite.index)
    jobs = []
    for method in methods:
        common = [
            *(suite.id, SCHEMA_VERSION, CASES_VERSION, obj.fingerprint(), seed, method),
            *(sorted(environment.items()), method_identity(find_method(method), device)),
        ]
        for case in CASES:
            views = [[view.azimuth_deg, view.elevation_deg] for view in case.views]
            for condition in case.conditions:
                # The key has the condition, too, as random numbers are drawn by it.
                key = digest([*common, condition, repr(case.perturbation), views, case.batch])
                jobs.append(
                    Job(
                        key=key,
                        suite=suite.id,
                        method=method,
                        condition=condition,
                        perturbation=case.perturbation,
                        object=obj,
                        views=case.views,
                        seed=seed,
                        device=device,
                        features=(),
                        reference_key=None,
                        batch=case.batch,
                    )
                )
    return jobs


def run(options: Options, suite: StabilitySuite = STABILITY) -> SuiteRun:
    """Carry out the suite, or the rest of a run that was stopped.

    Raises BadInput for options that the user has to fix.
    """
    start = time.perf_counter()
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
    directory = options.directory
    workers = options.workers or cores()
    machine = environment()
    jobs = stability_jobs(suite, methods, options.seed or 0, options.device, machine)
    manifest = manifest_of(
        replace(options, methods=methods),  # a repetition has no defaults
        suite.id,
        len(VIEWS),
        machine,
        methods=list(methods),
        objectives=objectives(map(find_method, methods)),
        objects=[f"{suite.class_name}/test-{suite.index:04d}"],
        cases=[case.id for case in CASES],
        workers=workers,
    )
    with open_run(directory, manifest, options.fresh) as store:
        outcomes = run_jobs(
            jobs, store, suite.id, partial(JobPool, limits=suite.limits, workers=workers)
        )
        store.list_jobs((job.key, job.name) for job in jobs)
        write_records(directory, store.listed_columns())
        observations = observe(jobs, store)
        table = matrix(_remark(methods), map(outcome, observations))
        write_tables(directory, [table, observations_table(observations)])
        images = {
            (job.condition, job.method): unpack_images(store.artifact(job.key))[0]
            for job in jobs
            if outcomes[job.key].has_images
        }
        _draw(directory, table, images, methods)
    printed = [markdown.table(counts(table))] + [
        f"UNEXPECTED {cell.subject}, {cell.case}: {cell.observed}; stated was: {cell.expected}"
        for cell in unexpected(table)
    ]
    return SuiteRun(directory, (table,), printed, f"{time.perf_counter() - start:.0f} s")


def _remark(methods: Sequence[str]) -> str:
    views = ", ".join(f"{view.azimuth_deg:g}/{view.elevation_deg:g}" for view in VIEWS)
    unstated = [method for method in methods if method not in EXPECTED]
    remark = (
        f"One chair from four views (azimuth/elevation {views} degrees) unless the case says "
        "otherwise. Changes are absolute differences in grey levels 0..255, mean over all pixels "
        f"and at most, to the images of the case named. Turned: by {TURN_DEG:g} degrees."
    )
    if unstated:
        remark += f" Nothing is stated about {', '.join(unstated)}: what has a name is in order."
    return remark


def _draw(
    directory: Path,
    table: Table[CaseOutcome],
    images: Mapping[tuple[str, str], UInt8Images],
    methods: Sequence[str],
) -> None:
    """Write the figures; `images` are the first views by case and method."""
    folder = directory / FIGURES
    save(matrix_figure(table), folder / f"{table.name}.png")
    shown = [method for method in methods if method not in FLOORS]
    extremes = extremes_figure([case.id for case in CASES], shown, images)
    save(extremes, folder / "extremes.png", dpi=100)
