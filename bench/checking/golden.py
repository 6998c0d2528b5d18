"""The comparison of a run with our golden values, and remarks on the paper's values.

Golden values are those of one run of the default protocol; each has a tolerance and the reason for
it. Values of the whole run are compared with a whole run, values of objects
(`bench.checking.objects`) with any part of one.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from bench.analysis.scored_run import Run, read_run
from bench.catalogue.methods import role
from bench.catalogue.suites import STABILITY
from bench.checking.objects import (
    GoldenDeviation,
    GoldenObjects,
    compare_objects,
    read_objects,
    write_objects,
)
from bench.checking.tolerances import tolerance
from bench.records.run_folder import COLOURED, TRUTH, read_finished
from bench.running.options import Options
from bench.suites.stability.outcomes import read_outcomes, unexpected
from bench.tables.build import class_orderings, condition_sweep, tables
from bench.tables.grid import records
from bench.tables.published import golden, golden_name, golden_path
from bench.tables.table import TABLES, Table, table_files
from data_prep.datasets.protocol_version import PROTOCOL_VERSION, refuse_other_version
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole

CELL = ["method", "condition", "class", "metric"]
PROTOCOL = ["protocol", "dataset", "objects", "views", "seed"]


@dataclass(frozen=True)
class CheckResult:
    """The result of a check.

    compared          number of values
    regressions       a line for each
    remarks           lines that are no criterion
    moved             the values of objects that moved
    headline_metrics  the metrics of the suite's headline table
    headline          number of their values among those compared
    """

    compared: int
    regressions: tuple[str, ...]
    remarks: tuple[str, ...]
    moved: tuple[GoldenDeviation, ...] = ()
    headline_metrics: tuple[str, ...] = ()
    headline: int = 0

    @property
    def by_headline(self) -> tuple[list[str], list[str]]:
        """Return the regressions of the headline metrics, and the others."""
        parts: tuple[list[str], list[str]] = [], []
        for line in self.regressions:
            parts[line.partition(" of ")[0] not in self.headline_metrics].append(line)
        return parts


def check(directory: Path) -> CheckResult:
    """Compare a finished run with the golden values of its suite and truth.

    With golden values by object, the run may have a part of the objects, methods and conditions,
    and others, which are left out. Means and distances of the whole run are compared where the run
    has all objects. A run of the suite `stability` is compared with its expected outcomes.

    Raises BadInput where `directory` is not a finished run, where the golden values belong to
    another protocol (dataset, objects, views or seed), and where nothing could be compared.
    """
    manifest = read_finished(directory)
    is_stability = manifest["suite"] == STABILITY.id
    result = _check_outcomes(directory) if is_stability else _check_values(directory, manifest)
    if not (result.compared or result.regressions):
        raise BadInput(
            f"{directory}: nothing is compared, for none of its methods and conditions has golden "
            f"values; check a run of '{_command(manifest)}', or compare this one with itself: "
            f"'bench check {directory} --again 0.05'"
        )
    return result


def _check_values(directory: Path, manifest: dict[str, Any]) -> CheckResult:
    run = read_run(directory)
    own_tables = tables(run)
    sweep = (class_orderings(run), condition_sweep(run))
    written: list[Table] = [*own_tables, *filter(None, sweep)]
    compared, regressions = Counter[str](), _stale_tables(directory, written)
    name = golden_name(manifest)
    expected, objects = golden(name), read_objects(name)
    whole = _is_whole(directory, manifest, expected, objects)
    if whole:
        compared, moved = _compare_means(own_tables, manifest, expected)
        regressions += moved
    remarks: list[str] = []
    moved_objects: tuple[GoldenDeviation, ...] = ()
    if objects is not None:
        if not whole:
            remarks.append(
                "not all golden objects: means and distances of the run are not compared"
            )
        by_object = compare_objects(run, objects)
        regressions += by_object.lines
        compared += by_object.compared
        remarks += [*_without_golden(manifest, objects), by_object.remark]
        moved_objects = by_object.moved
    metrics = run.suite.headline
    return CheckResult(
        compared.total(),
        tuple(regressions),
        tuple(remarks),
        moved_objects,
        metrics,
        sum(compared[metric] for metric in metrics),
    )


def _compare_means(
    own_tables: Sequence[Table], manifest: dict[str, Any], expected: pd.DataFrame
) -> tuple[Counter[str], list[str]]:
    """Return how many golden values the run has by metric, and a line for each that moved."""
    values = {_cell(row): row["value"] for row in _rows(own_tables)}
    compared, regressions = Counter[str](), []
    methods, conditions = set(manifest["methods"]), set(manifest["conditions"])
    for row in expected.to_dict("records"):
        if row["method"] not in methods or row["condition"] not in conditions:
            continue
        compared[row["metric"]] += 1
        value = values.get((row["method"], row["condition"], row["class"], row["metric"]), math.nan)
        if not abs(value - row["value"]) <= row["tolerance"]:  # also for NaN
            got = f"{value:.6f}" if math.isfinite(value) else "nothing"
            regressions.append(
                f"{row['metric']} of {row['method']} at {row['condition']}: {got}, golden "
                f"{row['value']:.6f} +- {row['tolerance']:.6f} ({row['reason']})"
            )
    return compared, regressions


def _without_golden(manifest: dict[str, Any], golden_objects: GoldenObjects) -> list[str]:
    """Return a line for each kind of name in a run that has no golden values by object."""
    lines = []
    for kind, known in golden_objects.names.items():
        if unknown := [name for name in manifest[kind] if name not in known]:
            lines.append(f"without golden values, left out: {kind} {', '.join(unknown)}")
    return lines


def bless(directory: Path) -> list[Path]:
    """Make this run's values the golden ones of its suite, and return the files (see CONTRIBUTING).

    Raises BadInput where this is not the whole default run, or its images are gone.
    """
    manifest = read_finished(directory)
    run = read_run(directory)
    _refuse_other_protocol(run)
    protocol = _protocol(manifest)
    lines = golden_lines(_rows(tables(run)), protocol)
    # Of 260 objects of thirteen classes, the thumbnails alone would be 2 MB.
    by_object = write_objects(run, protocol) if len(run.suite.classes) == 1 else []
    path = golden_path(golden_name(manifest))
    write_whole(path, pd.DataFrame(lines).to_csv(index=False, lineterminator="\n").encode())
    return [path, *by_object]


def golden_lines(rows: Iterable[dict[str, Any]], protocol: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the lines of a file of golden values, one for each cell.

    Metrics without a tolerance have no line: the default protocol has no weights for fid.
    """
    lines = []
    by_cell = {_cell(row): row for row in rows}  # a metric may stand in two tables
    for cell, row in by_cell.items():
        rule = tolerance(row["method"], row["metric"])
        if role(row["method"]) == "chosen":  # the value of another method
            continue
        if not math.isfinite(row["value"]) or rule is None:
            continue
        allowed = rule.absolute + rule.relative * abs(row["value"])
        lines.append(
            protocol
            | dict(zip(CELL, cell, strict=True))
            | {"value": f"{row['value']:.6f}", "tolerance": f"{allowed:.6f}"}
            | {"reason": rule.reason}
        )
    return lines


def _refuse_other_protocol(run: Run) -> None:
    """Raise BadInput for a run that is not the whole default run of its suite."""
    suite, manifest = run.suite, run.manifest
    default = Options(suite.id)
    objects = suite.endless_limit * len(suite.classes)
    wanted = {
        "protocol": PROTOCOL_VERSION,
        "dataset": default.dataset,
        "objects": objects,
        "views": suite.views,
        "seed": 0,
    }
    have = _protocol(manifest)
    other = [f"{n} {have[n]} (default: {wanted[n]})" for n in PROTOCOL if have[n] != wanted[n]]
    for kind, names in (("methods", suite.methods), ("conditions", suite.conditions)):
        for word, some, others in (("no", names, manifest[kind]), ("also", manifest[kind], names)):
            if only := [name for name in some if name not in others]:
                other.append(f"{word} {kind} {', '.join(only)}")
    if other:
        raise BadInput(
            f"{run.directory}: golden values are of the whole default run, this one has "
            f"{'; '.join(other)}; run '{_command(manifest)}' and give its folder"
        )


def _command(manifest: Mapping[str, Any]) -> str:
    truth = manifest.get(TRUTH, COLOURED)
    return f"bench run --suite {manifest['suite']}" + f" --truth {truth}" * (truth != COLOURED)


def _protocol(manifest: dict[str, Any]) -> dict[str, Any]:
    return {
        "protocol": manifest["protocol"],
        "dataset": manifest["dataset"],
        "objects": len(manifest["objects"]),
        "views": manifest["views"],
        "seed": manifest["seed"],
    }


def _is_whole(
    directory: Path,
    manifest: dict[str, Any],
    expected: pd.DataFrame,
    objects: GoldenObjects | None,
) -> bool:
    """Return whether a run has all golden objects and no others: its means can be compared then.

    Raises BadInput where it has another protocol. Without golden values by object, that includes
    another number of objects; with them, one golden object is enough.
    """
    have = _protocol(manifest)
    want = {name: expected[name].iloc[0] for name in PROTOCOL}
    path = golden_path(golden_name(manifest))
    refuse_other_version(path, int(want["protocol"]), "write it with 'bench check DIR --bless'")
    compared = [name for name in PROTOCOL if objects is None or name != "objects"]
    other = [f"{n} {have[n]} (golden: {want[n]})" for n in compared if have[n] != want[n]]
    whole = have["objects"] == want["objects"]
    if objects is not None:
        if objects.protocol != want:
            raise BadInput(
                f"{path}: of another protocol than the golden values by "
                "object beside it; restore both with git, or write them with "
                "'bench check DIR --bless'"
            )
        measured, named = set(manifest["objects"]), objects.names["objects"]
        whole = measured == named
        if measured.isdisjoint(named):
            other.append("none of its objects is golden")
    if other:
        raise BadInput(
            f"{directory}: no golden values for this protocol: {', '.join(other)}; "
            f"check a run of '{_command(manifest)}' with its defaults"
        )
    return whole


def _stale_tables(directory: Path, written: Sequence[Table]) -> list[str]:
    """Return a line for each file of a table that differs from the table of the records."""
    stale = []
    for name, text in table_files(written).items():
        path = directory / TABLES / name
        if not path.is_file() or path.read_bytes() != text.encode():
            stale.append(
                f"{path}: not what the records give; 'bench table {directory}' restores it"
            )
    return stale


def _check_outcomes(directory: Path) -> CheckResult:
    """Return a regression for each unexpected outcome in the tables of a stability run."""
    outcomes = read_outcomes(directory / TABLES)
    return CheckResult(len(outcomes), tuple(unexpected(outcomes)), ())


def _rows(own_tables: Iterable[Table]) -> list[dict[str, Any]]:
    return [row for table in own_tables for row in records(table.frame)]


def _cell(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(row[name] for name in CELL)
