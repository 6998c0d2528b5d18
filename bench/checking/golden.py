"""The comparison of a run with our golden values, and remarks on the paper's values.

Golden values are those of one run of the default protocol; each has a tolerance and the reason for
it. Values of the whole run are compared with a whole run, values of objects
(`bench.checking.objects`) with any part of one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from bench.analysis.scored_run import Run, read_run
from bench.catalogue.methods import role
from bench.catalogue.suites import STABILITY
from bench.checking.objects import (
    GoldenCell,
    GoldenDeviation,
    GoldenObjects,
    Widths,
    compare_objects,
    number,
    read_golden_file,
    read_objects,
    write_file,
    write_objects,
)
from bench.checking.tolerances import tolerance
from bench.records.run_folder import COLOURED, TRUTH, read_finished
from bench.running.options import Options
from bench.suites.stability.outcomes import read_outcomes, unexpected
from bench.tables.build import class_orderings, condition_sweep, tables
from bench.tables.grid import row_mappings
from bench.tables.published import golden, golden_name, golden_path
from bench.tables.table import TABLES, Table, table_files
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole

CELL = ["method", "condition", "class", "metric"]
PROTOCOL = ["protocol", "dataset", "objects", "views", "seed"]


@dataclass(frozen=True)
class CheckResult:
    """The result of a check.

    cells             what was compared
    others            a line for each table that is stale, and for each unexpected outcome
    remarks           lines that are no criterion
    moved             the values of objects that moved
    headline_metrics  the metrics of the suite's headline table
    outcomes          number of outcomes compared
    """

    cells: tuple[GoldenCell, ...]
    others: tuple[str, ...]
    remarks: tuple[str, ...]
    moved: tuple[GoldenDeviation, ...] = ()
    headline_metrics: tuple[str, ...] = ()
    outcomes: int = 0

    @property
    def compared(self) -> int:
        """Return the number of values."""
        return self.outcomes + sum(cell.compared for cell in self.cells)

    @property
    def headline(self) -> int:
        """Return the number of values of the headline metrics."""
        return sum(c.compared for c in self.cells if c.metric in self.headline_metrics)

    @property
    def by_headline(self) -> tuple[list[str], list[str]]:
        """Return a line for each regression of the headline metrics, and of the others."""
        parts: tuple[list[str], list[str]] = [], [*self.others]
        for cell in self.cells:
            if cell.problem:
                parts[cell.metric not in self.headline_metrics].append(str(cell))
        return parts

    @property
    def regressions(self) -> tuple[str, ...]:
        """Return a line for each regression."""
        return (*self.others, *(str(cell) for cell in self.cells if cell.problem))


def check(directory: Path, widths: Widths | None = None, file: Path | None = None) -> CheckResult:
    """Compare a finished run with the golden values in a file, or with those of its suite.

    With golden values by object, the run may have a part of the objects, methods and conditions,
    and others, which are left out. Means and distances of the whole run are compared where the run
    has all objects. A run of the suite `stability` is compared with its expected outcomes.

    Raises BadInput where `directory` is not a finished run, where the golden values belong to
    another protocol (dataset, objects, views or seed), and where nothing could be compared.
    """
    if file is not None:
        return _check_file(read_run(directory), file, widths or Widths())
    manifest = read_finished(directory)
    if manifest["suite"] == STABILITY.id:
        outcomes = read_outcomes(directory / TABLES)
        result = CheckResult((), tuple(unexpected(outcomes)), (), outcomes=len(outcomes))
    else:
        result = _check_values(read_run(directory), widths or Widths())
    if not (result.compared or result.regressions):
        raise BadInput(
            f"{directory}: nothing is compared, for none of its methods and conditions has golden "
            f"values; check a run of '{_command(manifest)}', or compare this one with itself: "
            f"'bench check {directory} --again 0.05'"
        )
    return result


def _check_file(run: Run, file: Path, widths: Widths) -> CheckResult:
    """Compare the objects of a run with those in a user's file."""
    golden_values = read_golden_file(file)
    if other := _differing(_own_protocol(run.manifest), golden_values.protocol):
        raise BadInput(
            f"{file}: of another protocol than {run.directory}: {', '.join(other)}; check a run "
            "with the same options, or write golden values of this one with --bless FILE"
        )
    cells, moved, notes = compare_objects(run, golden_values, widths, means=True)
    if not cells:
        raise BadInput(
            f"{file}: has no method, condition and object of {run.directory} in common; check a "
            f"run with methods of {', '.join(sorted(golden_values.names['methods']))}"
        )
    absent = (
        f"golden values of what this run has not, left out: {kind} {', '.join(sorted(lost))}"
        for kind, known in golden_values.names.items()
        if (lost := known - {*run.manifest[kind]})
    )
    remarks = (*_without_golden(run.manifest, golden_values), *absent, *notes)
    return CheckResult(cells, (), remarks, moved, run.suite.headline)


def _own_protocol(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return what golden values of a user's own and a run have to have in common.

    A folder may lie elsewhere and hold fewer objects; where one has changed, `blank` differs.
    """
    common = {"suite": manifest["suite"], "truth": manifest.get(TRUTH, COLOURED)}
    common |= _protocol(manifest) | {"dataset": str(manifest["dataset"]).partition(":")[0]}
    return {name: value for name, value in common.items() if name != "objects"}


def _check_values(run: Run, widths: Widths) -> CheckResult:
    own_tables = tables(run)
    written = [*own_tables, *filter(None, (class_orderings(run), condition_sweep(run)))]
    cells: tuple[GoldenCell, ...] = ()
    moved: tuple[GoldenDeviation, ...] = ()
    remarks: list[str] = []
    name = golden_name(run.manifest)
    expected, objects = golden(name), read_objects(name)
    whole = _is_whole(run, expected, objects)
    if whole:
        cells = _compare_means(own_tables, run.manifest, expected)
    else:
        remarks.append("not all golden objects: means and distances of the run are not compared")
    if objects is not None:
        by_object, moved, notes = compare_objects(run, objects, widths, means=not whole)
        cells += by_object
        remarks += [*_without_golden(run.manifest, objects), *notes]
    stale = tuple(_stale_tables(run.directory, written))
    return CheckResult(cells, stale, tuple(remarks), moved, run.suite.headline)


def _compare_means(
    own_tables: Sequence[Table], manifest: dict[str, Any], expected: pd.DataFrame
) -> tuple[GoldenCell, ...]:
    """Return a cell for each golden value that the run has."""
    values = {_cell(row): row["value"] for row in _rows(own_tables)}
    cells = []
    methods, conditions = set(manifest["methods"]), set(manifest["conditions"])
    for row in expected.to_dict("records"):
        if row["method"] not in methods or row["condition"] not in conditions:
            continue
        value = values.get((row["method"], row["condition"], row["class"], row["metric"]), math.nan)
        problem = ""
        if not abs(value - row["value"]) <= row["tolerance"]:  # also for NaN
            problem = (
                f"{number(value)}, golden {row['value']:.6f} +- {row['tolerance']:.6f} "
                f"({row['reason']})"
            )
        cells.append(GoldenCell(row["method"], row["condition"], row["metric"], 1, problem))
    return tuple(cells)


def _without_golden(manifest: dict[str, Any], golden_objects: GoldenObjects) -> list[str]:
    """Return a line for each kind of name in a run that has no golden values by object."""
    lines = []
    for kind, known in golden_objects.names.items():
        if unknown := [name for name in manifest[kind] if name not in known]:
            lines.append(f"without golden values, left out: {kind} {', '.join(unknown)}")
    return lines


def bless(directory: Path, target: Path | None = None) -> list[Path]:
    """Write a run's values as golden ones to a file, or as its suite's, and return the files.

    The folder of the golden values of all suites is the target for these (see CONTRIBUTING).
    Raises BadInput for another folder, for a run without scores or images, and of a suite where
    this is not the whole default run; CannotWrite where a file cannot be written.
    """
    manifest = read_finished(directory)
    run = read_run(directory)
    path = golden_path(golden_name(manifest))
    if target is not None and target.resolve() != path.parent.resolve():
        if target.is_dir():
            raise BadInput(f"{target}: a folder; give the name of a file, such as golden.json")
        write_file(run, _own_protocol(manifest), target)
        return [target]
    _refuse_other_protocol(run)
    protocol = _protocol(manifest)
    lines = golden_lines(_rows(tables(run)), protocol)
    # Of 260 objects of thirteen classes, the thumbnails alone would be 2 MB.
    by_object = write_objects(run, protocol) if len(run.suite.classes) == 1 else []
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
    wanted = {
        "dataset": Options(suite.id).dataset,
        "objects": suite.endless_limit * len(suite.classes),
        "views": suite.views,
        "seed": 0,
    }
    other = _differing({name: _protocol(manifest)[name] for name in wanted}, wanted, "default")
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


def _protocol(manifest: Mapping[str, Any]) -> dict[str, Any]:
    return {name: manifest[name] for name in PROTOCOL} | {"objects": len(manifest["objects"])}


def _differing(have: Mapping[str, Any], want: Mapping[str, Any], of: str = "golden") -> list[str]:
    """Return the parts of a protocol that are others than they should, in words."""
    return [f"{n} {have[n]} ({of}: {want.get(n)})" for n in have if have[n] != want.get(n)]


def _is_whole(run: Run, expected: pd.DataFrame, objects: GoldenObjects | None) -> bool:
    """Return whether a run has all golden objects and no others: its means can be compared then.

    Raises BadInput where it has another protocol. Without golden values by object, that includes
    another number of objects; with them, one golden object is enough.
    """
    have = _protocol(run.manifest)
    want = {name: expected[name].iloc[0] for name in PROTOCOL}
    other = _differing(have, want)
    whole = True  # else it is refused
    if objects is not None:
        if objects.protocol != want:
            raise BadInput(
                f"{golden_path(golden_name(run.manifest))}: of another protocol than the golden "
                "values by object beside it; restore both with git, or write them with "
                "'bench check DIR --bless results/golden'"
            )
        other = _differing(have | {"objects": want["objects"]}, want)
        measured, named = set(run.manifest["objects"]), objects.names["objects"]
        whole = measured == named
        if measured.isdisjoint(named):
            other.append("none of its objects is golden")
    if other:
        raise BadInput(
            f"{run.directory}: no golden values for this protocol: {', '.join(other)}; "
            f"check a run of '{_command(run.manifest)}' with its defaults"
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


def _rows(own_tables: Iterable[Table]) -> list[dict[str, Any]]:
    return [row for table in own_tables for row in row_mappings(table.frame)]


def _cell(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(row[name] for name in CELL)
