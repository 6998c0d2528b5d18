"""`bench plan`, and the jobs, time and disk space of a run for `bench run --dry-run`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated

import numpy as np
import typer

from bench.catalogue.lookup import find
from bench.catalogue.modules import allow_modules
from bench.catalogue.suite_types import TRUTHS
from bench.catalogue.suites import ALL_SUITES, Suite
from bench.commands.options import RUN_OPTIONS, options_from_dataclass
from bench.records.record import CLAIMED, GROUND_TRUTH
from bench.records.run_folder import read_store
from bench.records.store import DamagedArtifact
from bench.running.options import Options
from bench.running.pilot import Cost, Sample, mean_costs, run_pilot
from bench.running.protocol import protocol_of
from bench.running.schedule import JOB_S, START_S, end_s
from bench.running.status import MethodCondition, RunStatus, refuse_small, run_status
from bench.tables.grid import BOLD, Block, Cell, Grid, grid
from bench.tables.markdown import cell, code, document
from data_prep.progress import log

ENOUGH = 20  # recorded jobs that are read of a method at a condition
# Of a job of the default suite on two cores, for each image.
SCORING_S, IMAGE_B = 0.02, 7_000


def recorded_costs(run: RunStatus) -> dict[MethodCondition, Cost]:
    """Return the mean cost of a job by method and condition, from the jobs in the run's folder."""
    costs: list[tuple[MethodCondition, Cost]] = []
    read = dict.fromkeys(run.left, 0)
    with read_store(run.directory) as store:
        for obj in () if store.is_empty else run.plan:
            drawn = store.find([job.key for job in obj.jobs])
            for job in obj.jobs:
                place = job.method, job.condition
                if read[place] == ENOUGH or job.key not in drawn:
                    continue
                if drawn[job.key].has_images:
                    try:
                        size_b = float(len(store.artifact(job.key)))
                    except DamagedArtifact:  # a run finds it, and draws it anew
                        continue
                    read[place] += 1
                    records = store.records(job.key)  # times of the method alone
                    draw_s = sum(record.draw_s or 0.0 for record in records)
                    drawn_s = (records[0].prepare_s or 0.0) + draw_s
                    here_s = 0.0 if records[0].notes == CLAIMED else drawn_s
                    seconds = here_s + SCORING_S * len(records)
                    costs.append((place, Cost(seconds, size_b)))
            if min(read.values()) == ENOUGH:
                break
    return mean_costs(costs, run.left)


def expected_cost(run: RunStatus) -> str:
    """Return the jobs, time and disk space of a run that is not to be measured, as Markdown."""
    recorded = recorded_costs(run)
    guess = Cost(JOB_S, float(IMAGE_B * run.protocol.views))
    whole = _total(run.left, {place: recorded.get(place, guess) for place in run.left})
    guessed = {method for (method, _), jobs in run.left.items() if jobs} - {m for m, _ in recorded}
    basis = (
        f"{len(guessed)} methods have no job in the folder: {JOB_S:g} s a job are assumed, 'bench "
        "plan' measures them"
    )
    jobs = sum(run.left.values())
    summary = (
        f"about {_time(run, whole)} with {_workers(run)}, {whole.size_b / 1e6:,.0f} MB "
        f"({basis if guessed else 'by the jobs in the folder'})"
    )
    blocks: list[Block] = [
        f"jobs: {jobs:,} to do, {run.plan.job_count - jobs:,} done",
        cost_table(run, recorded),
        summary if jobs else "",
    ]
    return document(blocks).removesuffix("\n")


def plan_of(run: RunStatus, samples: Sequence[Sample]) -> Iterator[Block]:
    """Yield the jobs, time, disk space and memory of a run, from the samples of its pilot."""
    protocol, jobs = run.protocol, sum(run.left.values())
    done = run.plan.job_count - jobs
    places = (((s.job.method, s.job.condition), s.cost) for s in samples)
    costs = mean_costs(places, run.left)
    objects = {(s.job.object.class_name, s.job.object.object_id) for s in samples}
    shard = f", shard {protocol.shard}" if protocol.shard else ""
    truth = f", against {TRUTHS[protocol.suite.truth]}"
    yield f"# Plan of {cell(protocol.suite.id)} on {cell(protocol.dataset)}{shard}{truth}"
    yield (
        f"{len(protocol.objects):,} objects x {protocol.views} views x "
        f"{len(protocol.conditions)} conditions x {len(protocol.methods)} methods: "
        f"{jobs:,} jobs to do"
        + (f", {done:,} done in {code(str(run.directory))}" if done else "")
        + f". Measured just now on {len(objects)} objects with {_workers(run)}."
    )
    yield cost_table(run, costs)
    yield (
        f"With {_workers(run)}: **{_time(run, _total(run.left, costs))}**, tables and figures "
        f"included; memory {run.workers} x {max(s.peak_mib for s in samples):,.0f} MiB at most."
    )
    if failed := sum(bool(s.reason) for s in samples):
        yield f"{failed} jobs of the pilot failed; they count as they were."


def cost_table(run: RunStatus, costs: Mapping[MethodCondition, Cost]) -> Grid:
    """Return the jobs to do, the jobs done, time and disk space by method."""

    def line(name: Cell, methods: Sequence[str]) -> list[Cell]:
        left = {place: jobs for place, jobs in run.left.items() if place[0] in methods}
        jobs, cost = sum(left.values()), _total(left, costs)
        values = (
            f"{jobs:,}",
            f"{len(left) * len(run.plan) - jobs:,}",
            _digits(cost.seconds / jobs if jobs else math.nan),
            _digits(cost.seconds / 3600),
            _digits(cost.size_b / 1e6),
        )
        return [name, *map(Cell, values)]

    methods = (GROUND_TRUTH, *run.protocol.methods)
    return grid(
        ["method", "to do", "done", "core-s a job", "core-hours", "disk, MB"],
        [
            *(line(Cell(method), (method,)) for method in methods),
            line(Cell("all", special=BOLD), methods),
        ],
    )


def _total(left: Mapping[MethodCondition, int], costs: Mapping[MethodCondition, Cost]) -> Cost:
    """Return the cost of all jobs left; nan where that of one is unknown."""
    unknown = Cost(math.nan, math.nan)
    parts = [(jobs, costs.get(place, unknown)) for place, jobs in left.items() if jobs]
    return Cost(
        sum(jobs * cost.seconds for jobs, cost in parts),
        sum(jobs * cost.size_b for jobs, cost in parts),
    )


def _time(run: RunStatus, cost: Cost) -> str:
    busy = min(run.workers, sum(run.left.values()))
    seconds = START_S + cost.seconds / busy + end_s(len(run.protocol.objects)) if busy else 0.0
    if seconds < 120 or math.isnan(seconds):
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def _digits(value: float) -> str:
    """Return a number with two or three digits and without an exponent; - for nan."""
    if not math.isfinite(value):
        return "-"
    if abs(value) >= 100:
        return f"{value:,.0f}"
    digits = 2 if abs(value) < 10 else 3
    return np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")


def _workers(run: RunStatus) -> str:
    return "one worker" if run.workers == 1 else f"{run.workers} workers"


NO_LONGER = typer.Option(metavar="TEXT", help="Not used. Default: none.", hidden=True)


@options_from_dataclass(Options, RUN_OPTIONS, leave_out=("fresh", "ray", "budget", "search"))
def plan(
    options: Options,
    pilot: Annotated[
        int, typer.Option(help="Objects measured now, with all methods and conditions.")
    ] = 6,
    also: Annotated[str | None, NO_LONGER] = None,
    samples: Annotated[str | None, NO_LONGER] = None,
) -> None:
    """Measure a few objects now; estimate time, disk and memory of a run or of the rest of one."""
    for option in (also and "also", samples and "samples"):
        if option:
            log(f"bench: --{option} does nothing any more")
    allow_modules(options.methods or ())
    suite = find(options.suite, ALL_SUITES, "suite")
    if not isinstance(suite, Suite):
        raise refuse_small(suite.id, "bench plan")
    run = run_status(options, protocol_of(suite, options)[0])
    if not any(run.left.values()):
        print(f"{run.directory}: nothing is left to do; the run would make its tables.")
        return
    measured = run_pilot(run.protocol, pilot, run.workers)
    print(document(plan_of(run, measured)).removesuffix("\n"))
