"""The suite `speed`, which measures what each method costs when it runs alone on this machine.

It takes one measurement after the other, each in a process of its own. Measurements of an earlier
run in the folder are kept where versions, code and machine are the same. No other program should
run meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from bench.catalogue.conditions import find_condition
from bench.catalogue.methods import find_method
from bench.records.store import Store
from bench.running.environment import CODE, code_sha256, cores, environment
from bench.running.options import Options, seed_of
from bench.running.plan import digest
from bench.running.pool import WorkerFailure, run_tasks, thread_counts
from bench.running.protocol import method_identity
from bench.suites.procedure import SuiteRun, methods_of, run_suite, suite_manifest
from bench.suites.speed.measure import (
    FORM,
    SPEED,
    Measurement,
    SpeedSuite,
    Unit,
    lost,
    measure,
    read_measurement,
    write_measurement,
)
from bench.suites.speed.tables import (
    amortised_figure,
    amortised_rows,
    amortised_table,
    samples_table,
    speed_table,
)
from bench.tables.paper import published
from data_prep.datasets.registry import SceneObject, open_dataset
from data_prep.progress import log, progress


def measure_alone(unit: Unit, run_tasks: Callable[..., Any] = run_tasks) -> Measurement:
    """Take a measurement in a fresh process; where the process dies, return one of failures."""
    # Other suites have glibc fill memory (`bench.running.pool`), so that results repeat. Here it
    # would falsify the times: it leaves reconstruction as fast, but encoding a cloud takes a third
    # longer.
    environment = thread_counts(unit.threads)
    ((_, result),) = run_tasks([unit], measure, 1, unit.suite.limits, environment)
    return lost(unit, result.reason) if isinstance(result, WorkerFailure) else result


def speed_units(
    suite: SpeedSuite, manifest: Mapping[str, Any], objects: Sequence[SceneObject], code: str
) -> list[Unit]:
    """Return the measurements to be taken, in their order.

    There is one for each method, condition and number of threads.

    manifest  the manifest of the run, with methods, conditions, threads, views, seed and device,
              and with the environment, versions and machine, on which times depend
    code      the checksum of all code, because times depend on all that a method imports

    Raises BadInput for an unknown method or condition.
    """
    machine_info = {name: manifest[name] for name in ("environment", "versions", "machine")}
    views, seed, device = (manifest[name] for name in ("views", "seed", "device"))
    # What all keys name. Of the code it is the checksum and not `Method.version`, which changes
    # with images: times change where images do not.
    common = [
        FORM,
        suite.id,
        code,
        machine_info,
        views,
        seed,
        suite.singles,
        suite.warm_ups,
        suite.least_rounds,
        suite.most_rounds,
        suite.seconds,
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
    options: Options,
    suite: SpeedSuite = SPEED,
    environment: Callable[[], Mapping[str, str]] = environment,
    cores: Callable[[], int] = cores,
    measure: Callable[[Unit], Measurement] = measure_alone,
) -> SuiteRun:
    """Carry out the suite, or the rest of a run that was stopped.

    environment  returns the driver and the libraries that images depend on
    cores        returns the number of cores that this process may use
    measure      takes one measurement

    Raises BadInput for options that the user has to fix.
    """
    methods = methods_of(
        options,
        suite,
        workers="its measurements are taken one after the other",
        ray="which times one machine",
    )
    clouds, dataset = options.limit or suite.clouds, open_dataset(options.dataset)
    options = replace(
        options,
        methods=methods,
        conditions=tuple(dict.fromkeys(options.conditions or suite.conditions)),
        limit=clouds,
        views=options.views or suite.views,
        seed=seed_of(dataset, options),
    )
    objects = dataset.objects(suite.class_name, clouds, clouds)
    manifest = suite_manifest(
        options,
        suite,
        options.views or suite.views,
        environment(),
        conditions=list(options.conditions or ()),
        threads=sorted({1, cores()}),
        objects=[f"{obj.class_name}/{obj.object_id}" for obj in objects],
    )
    units = speed_units(suite, manifest, objects, code_sha256(CODE))
    return run_suite(
        options,
        manifest,
        partial(_carry_out, suite, units, options.directory, manifest["machine"], measure),
    )


def _carry_out(
    suite: SpeedSuite,
    units: Sequence[Unit],
    directory: Path,
    machine: Mapping[str, Any],
    measure: Callable[[Unit], Measurement],
    _: Store,
) -> SuiteRun:
    """Take the measurements that the folder does not have, and return the tables of all of them."""
    kept = {unit.key: read_measurement(directory, unit.key) for unit in units}
    missing = [unit for unit in units if kept[unit.key] is None]
    reused, failures = len(units) - len(missing), 0
    if missing and reused:
        log(f"{suite.id}: {reused} of {len(units)} are there from before")
    with progress(suite.id, len(missing)) as advance:
        for unit in missing:
            measurement = kept[unit.key] = measure(unit)
            write_measurement(directory, measurement)
            failures += bool(measurement.failures)
            advance(failures)
    measured = [m for m in kept.values() if m is not None]
    amortised = amortised_rows(measured, suite)
    failed = sum(bool(measurement.failures) for measurement in measured)
    noisy = sum((m.elsewhere_cores or 0) > suite.quiet_cores for m in measured)
    summary = (
        f"{len(units) - reused} measurements taken, {reused} from before, {failed} with failures"
    )
    if noisy:
        summary += f", {noisy} while something else ran"
    return SuiteRun(
        tables=(
            speed_table(measured, suite, machine, published(suite.id)),
            amortised_table(amortised, suite, measured[0].views),
            samples_table(measured),
        ),
        figures={} if amortised.empty else {"amortised": amortised_figure(amortised)},
        summary=f"{summary}; ",
    )
