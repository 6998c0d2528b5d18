"""The suite `stability`: methods at the extremes, and whether the outcomes are as expected.

Workers that can be killed draw the clouds, and a run that was stopped goes on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import pandas as pd

from bench.catalogue import suites
from bench.catalogue.methods import FLOORS, find_method
from bench.catalogue.suites import Limits, Procedure
from bench.records.frames import write_records
from bench.records.job import RECORDS_VERSION, Job, unpack
from bench.records.store import Store
from bench.running.environment import cores, environment
from bench.running.options import Options
from bench.running.plan import digest
from bench.running.protocol import method_identity
from bench.running.work import JobPool, run_jobs
from bench.suites.procedure import SuiteRun, methods_of, run_suite, suite_manifest
from bench.suites.stability.cases import CASES, TURN_DEG, VIEWS
from bench.suites.stability.expectations import EXPECTED, KINDS
from bench.suites.stability.figures import extremes_figure, matrix_figure
from bench.suites.stability.outcomes import matrix, observe, outcomes_of, unexpected
from bench.tables import markdown
from bench.tables.grid import grid
from bench.tables.table import Table
from data_prep.datasets.registry import ProceduralObject
from data_prep.failures import BadInput

# The limits of one method on one case. Ball pivoting of 100,000 points takes minutes, which no run
# should wait for: it is expected to exceed them.
LIMITS = Limits(time_s=60.0, memory_gib=4.0)


@dataclass(frozen=True)
class _StabilitySuite(Procedure):
    """A suite of extreme inputs with expected outcomes of methods."""

    class_name: str = "chair"  # the class of the one procedural object that all cases are made of
    index: int = 0  # the number of that object in the split "test"
    limits: Limits = LIMITS  # time and memory for a method on a case


STABILITY = _StabilitySuite(**vars(suites.STABILITY))
# A part of the jobs' keys. Increase it when a change in `data_prep.clouds.extremes` gives a case
# other points, so that stored images of the old points are not taken for those of the new ones.
_CASES_VERSION = 1


def _stability_jobs(
    suite: _StabilitySuite,
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
            suite.id,
            RECORDS_VERSION,
            _CASES_VERSION,
            obj.fingerprint(),
            seed,
            method,
            sorted(environment.items()),
            method_identity(find_method(method), device),
        ]
        for case in CASES:
            views = [[view.azimuth_deg, view.elevation_deg] for view in case.views]
            for condition in case.conditions:
                # The condition is in the key, too, as it seeds the random numbers of the case.
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


def run(options: Options, suite: _StabilitySuite = STABILITY) -> SuiteRun:
    """Carry out the suite, or the rest of a run that was stopped.

    Raises BadInput for options that the user has to fix.
    """
    methods = methods_of(
        options,
        suite,
        conditions="its cases take their place",
        views="each case has its own",
        limit="all cases are taken of one object",
        ray="all cases are taken of one object",
    )
    if options.dataset != "procedural":
        raise BadInput(
            f"--dataset {options.dataset}: the suite {suite.id} states what happens to one "
            "procedural object; leave out --dataset"
        )
    options = replace(options, methods=methods)
    workers, machine = options.workers or cores(), environment()
    jobs = _stability_jobs(suite, methods, options.seed or 0, options.device, machine)
    manifest = suite_manifest(
        options,
        suite,
        len(VIEWS),
        machine,
        objects=[f"{suite.class_name}/test-{suite.index:04d}"],
        cases=[case.id for case in CASES],
        workers=workers,
    )
    return run_suite(options, manifest, partial(_draw_all, suite, jobs, methods, options, workers))


def _draw_all(
    suite: _StabilitySuite,
    jobs: Sequence[Job],
    methods: Sequence[str],
    options: Options,
    workers: int,
    store: Store,
) -> SuiteRun:
    """Do the jobs whose results are not in the store, and return the outcomes of all jobs."""
    pool = partial(JobPool, limits=suite.limits, workers=workers)
    results = run_jobs(jobs, store, suite.id, pool)
    store.list_jobs((job.key, job.name) for job in jobs)
    write_records(options.directory, store)
    observations = observe(jobs, store)
    outcomes = outcomes_of(observations)
    table = matrix(_remark(methods), outcomes)
    images = {
        (job.condition, job.method): unpack(store.array(job.key))[0]
        for job in jobs
        if results[job.key].has_images
    }
    shown = [method for method in methods if method not in FLOORS]
    counts = outcomes["kind"].value_counts()
    return SuiteRun(
        (table, Table("observations", "", pd.DataFrame(observations), digits=".6g")),
        {
            table.name: matrix_figure(outcomes, table.title),
            "extremes": extremes_figure([case.id for case in CASES], shown, images),
        },
        printed=[
            markdown.table(grid([*KINDS], [[str(counts.get(kind, 0)) for kind in KINDS]])),
            *(f"UNEXPECTED {line}" for line in unexpected(outcomes)),
        ],
    )


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
