"""The suite `speed`: the cost of each method, alone on this machine.

It takes one measurement after the other, each in a process of its own; an earlier measurement is
kept as long as versions, code and machine are the same. No other program should run meanwhile.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bench.catalogue.conditions import find_condition
from bench.catalogue.methods import find_method, objectives
from bench.report.figure import FIGURES, save
from bench.running.environment import CODE, code_sha256, cores, environment
from bench.running.isolation import WorkerFailure, run_tasks, thread_counts
from bench.running.options import Options, seed_of
from bench.running.plan import digest
from bench.running.protocol import manifest_of, method_identity
from bench.running.run import open_run
from bench.suites.procedure import SuiteRun, methods_of
from bench.suites.speed.figure import amortised_figure
from bench.suites.speed.measure import Unit, lost, measure
from bench.suites.speed.samples import (
    FORM,
    Measurement,
    read_measurement,
    write_measurement,
)
from bench.suites.speed.suite import SPEED, SpeedSuite
from bench.suites.speed.summary import Summary, summarise
from bench.suites.speed.tables import (
    amortised_table,
    break_even_table,
    samples_table,
    speed_table,
)
from bench.tables.published import published
from bench.tables.table import Table, write_tables
from data_prep.datasets.registry import SceneObject, open_dataset
from data_prep.progress import log, progress


def measure_alone(unit: Unit, run_tasks: Callable[..., Any] = run_tasks) -> Measurement:
    """Return the measurement of a unit in a fresh process, or of its failure if lost."""
    # Memory is not filled as in other suites (`bench.running.isolation`): reconstruction is the
    # same twice with it, and encoding a cloud a third slower.
    environment = thread_counts(unit.threads)
    ((_, result),) = run_tasks([unit], measure, 1, unit.suite.limits, environment)
    return lost(unit, result.reason) if isinstance(result, WorkerFailure) else result


@dataclass(frozen=True)
class Laboratory:
    """The machine and the procedure that a run measures with.

    environment  describes the drivers that images depend on
    cores        counts the cores that this process may use
    measure      takes one measurement
    """

    environment: Callable[[], Mapping[str, str]] = environment
    cores: Callable[[], int] = cores
    measure: Callable[[Unit], Measurement] = measure_alone


def speed_units(
    suite: SpeedSuite, manifest: Mapping[str, Any], objects: Sequence[SceneObject], code: str
) -> list[Unit]:
    """Return one unit per method, condition and number of threads, in measuring order.

    manifest  of the run: methods, conditions, threads, views, seed, device, and the environment,
              versions and machine that times depend on
    code      digest of all code: whatever a method imports decides how long it takes

    Raises BadInput for an unknown method or condition.
    """
    machine_info = {name: manifest[name] for name in ("environment", "versions", "machine")}
    views, seed, device = (manifest[name] for name in ("views", "seed", "device"))
    common = [
        # `Method.version` is raised when images change; times also change where they do not.
        *(FORM, suite.id, code, machine_info, views, seed),
        *(suite.singles, suite.warm_ups, suite.least_rounds, suite.most_rounds, suite.seconds),
        [[obj.class_name, obj.object_id, obj.fingerprint()] for obj in objects],
    ]
    units = []
    for method in manifest["methods"]:
        identity = [method, method_identity(find_method(method), device)]
        for name in manifest["conditions"]:
            condition = find_condition(name)
            of_cloud = [condition.id, condition.key]
            units += [
                Unit(
                    key=digest([common, identity, of_cloud, count]),
                    suite=suite,
                    method=method,
                    condition=condition.id,
                    perturbation=condition.perturbation,
                    objects=tuple(objects),
                    threads=count,
                    views=views,
                    seed=seed,
                    device=device,
                )
                for count in manifest["threads"]
            ]
    return units


def run(
    options: Options, suite: SpeedSuite = SPEED, laboratory: Laboratory = Laboratory()
) -> SuiteRun:
    """Carry out the suite, or the rest of a run that was stopped.

    Raises BadInput for options that the user has to fix.
    """
    start = time.perf_counter()
    methods = methods_of(
        options,
        suite,
        workers="its measurements are taken one after the other",
        shard="which times one machine",
        ray="which times one machine",
        inception_weights="no fid is taken",
    )
    conditions = tuple(dict.fromkeys(options.conditions or suite.conditions))
    clouds = options.limit or suite.clouds
    dataset = open_dataset(options.dataset)
    pinned = {"limit": clouds, "views": options.views or suite.views}  # for a repetition
    pinned |= {"methods": methods, "conditions": conditions, "seed": seed_of(dataset, options)}
    options = replace(options, **pinned)
    objects = dataset.objects(suite.class_name, clouds, clouds)
    directory = options.directory
    manifest = manifest_of(
        options,
        suite.id,
        options.views or suite.views,
        laboratory.environment(),
        methods=list(methods),
        objectives=objectives(map(find_method, methods)),
        conditions=list(conditions),
        threads=sorted({1, laboratory.cores()}),
        objects=[f"{obj.class_name}/{obj.object_id}" for obj in objects],
    )
    units = speed_units(suite, manifest, objects, code_sha256(CODE))
    with open_run(directory, manifest, options.fresh):
        measured, reused = _measure_all(units, directory, laboratory.measure)
        summaries = [summarise(measurement) for measurement in measured]
        tables = _write(directory, summaries, suite, manifest["machine"])
    failed = sum(bool(measurement.failures) for measurement in measured)
    noisy = sum((m.elsewhere_cores or 0) > suite.quiet_cores for m in measured)
    summary = (
        f"{len(units) - reused} measurements taken, {reused} from before, {failed} with failures"
        + (f", {noisy} while something else ran" if noisy else "")
        + f"; {time.perf_counter() - start:.0f} s"
    )
    return SuiteRun(directory, tables, [table.to_markdown() for table in tables], summary)


def _measure_all(
    units: Sequence[Unit], directory: Path, measure: Callable[[Unit], Measurement]
) -> tuple[list[Measurement], int]:
    """Return the measurements of all units, and how many of them were kept from before."""
    measured = {unit.key: read_measurement(directory, unit.key) for unit in units}
    missing = [unit for unit in units if measured[unit.key] is None]
    reused = len(units) - len(missing)
    if missing and reused:
        log(f"{units[0].suite.id}: {reused} of {len(units)} are there from before")
    failures = 0
    with progress(units[0].suite.id, len(missing)) as advance:
        for unit in missing:
            measurement = measure(unit)
            write_measurement(directory, measurement)
            measured[unit.key] = measurement
            failures += bool(measurement.failures)
            advance(failures)
    return [m for unit in units if (m := measured[unit.key]) is not None], reused


def _write(
    directory: Path, summaries: Sequence[Summary], suite: SpeedSuite, machine: dict[str, Any]
) -> tuple[Table[Any], ...]:
    """Write all tables and the figure, and return the tables that are for people."""
    people = (
        speed_table(summaries, suite, machine, published(suite.id)),
        amortised_table(summaries, suite),
    )
    scripts = (
        samples_table(summary.measurement for summary in summaries),
        break_even_table(summaries, suite),
    )
    write_tables(directory, [*people, *scripts])
    figure = amortised_figure(summaries, suite)
    if figure is not None:
        save(figure, directory / FIGURES / "amortised.png")
    return people
