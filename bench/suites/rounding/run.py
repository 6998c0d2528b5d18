"""The suite `rounding`: a suite repeated in other arithmetics, to tell which digits are above them.

Each job of the suite is drawn and scored in random rounding, again and again; at some conditions
also with one stage rounded at a time, in IEEE's directed modes, on two threads, a view at a time,
and with networks in other number formats. Ground truths are drawn once, in the plain arithmetic.
"""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial

from threadpoolctl import threadpool_limits

from bench.analysis.scored import read_run
from bench.catalogue.methods import find_method
from bench.catalogue.suites import ROUNDING, RoundingSuite
from bench.records.stored_artifacts import StoredArtifacts
from bench.running.environment import cores
from bench.running.executors import JobPool, run_jobs
from bench.running.manifest import describe
from bench.running.options import Options
from bench.running.plan import plan
from bench.running.protocol import protocol_of
from bench.running.run import open_run, write_parquet
from bench.suites.procedure import SuiteRun, methods_of
from bench.suites.rounding.arithmetics import arithmetics, repeated
from bench.suites.rounding.deviations import deviations, moves, stage_deviations
from bench.suites.rounding.tables import deviations_table, moves_table, stages_table
from bench.tables.table import write_tables
from data_prep.progress import log
from data_prep.rounding import rounding_modes


def run(options: Options, suite: RoundingSuite = ROUNDING) -> SuiteRun:
    """Carry out the suite, or the rest of a run that was stopped.

    Raises BadInput for options that the user has to fix, and MissingDependency on a machine without
    rounding modes.
    """
    start = time.perf_counter()
    rounding_modes()
    methods = methods_of(
        options, suite, **dict.fromkeys(("shard", "ray"), "whose jobs are repeated on one machine")
    )
    views = options.views or suite.base.views
    suite = replace(suite, base=replace(suite.base, views=views))
    protocol, skipped = protocol_of(suite.base, replace(options, methods=methods))
    workers = options.workers or cores()
    planned = plan(protocol)
    truths = [obj.truth for obj in planned]
    jobs = [
        repeated(job, arithmetic)
        for obj in planned
        for job in obj.method_jobs
        for arithmetic in arithmetics(find_method(job.method), job.condition, suite)
    ]
    manifest = describe(protocol, workers, skipped) | {
        "request": replace(options, methods=tuple(protocol.methods)).request,
        "repetitions": suite.repetitions,
    }
    directory = options.directory
    with open_run(directory, manifest, options.fresh) as store:
        pool = partial(JobPool, limits=suite.base.limits, workers=workers)
        run_jobs(truths, store, f"{suite.id}, ground truths", pool)
        run_jobs(jobs, store, suite.id, pool)
        store.list_jobs((job.key, job.name) for job in (*truths, *jobs))
        log("tables")
        extractors = [name for name, _ in protocol.features]
        write_parquet(manifest, directory, store, extractors, {})
        cells = manifest | {"conditions": list(dict.fromkeys(job.condition for job in jobs))}
        scored = read_run(directory, suite.base, cells)
        with threadpool_limits(1):
            tables = (
                deviations_table(deviations(scored, suite, protocol.conditions)),
                stages_table(stage_deviations(scored, suite, protocol.conditions)),
                moves_table(moves(scored, suite, protocol.conditions, StoredArtifacts(directory))),
            )
        write_tables(directory, tables)
    seconds = time.perf_counter() - start
    return SuiteRun(
        directory, tables, [table.to_markdown() for table in tables], f"{seconds:.0f} s"
    )
