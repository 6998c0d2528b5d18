"""The comparison of a run with our golden values, and remarks on the paper's values.

Golden values are the values of one run of the default protocol. Each has a tolerance, and the
reason for that tolerance. There are golden values of the whole run (means and distances), which
only a run with all objects is compared with, and golden values of single objects
(`bench.check.objects`), which a run with some of the objects is compared with, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from bench.analysis.run import Run, read_run
from bench.catalogue.methods import FLOOR, role
from bench.catalogue.suites import STABILITY
from bench.check.golden_values import golden, golden_name, golden_path
from bench.check.objects import (
    IMAGE_CHECKSUM,
    GoldenComparison,
    GoldenDeviation,
    GoldenObjects,
    Widths,
    compare_objects,
    is_gain,
    number,
    read_golden_file,
    read_objects,
    write_file,
    write_objects,
)
from bench.check.tolerances import tolerance
from bench.records.folder import COLOURED, TRUTH, read_finished
from bench.running.options import Options
from bench.suites.stability.outcomes import read_outcomes, unexpected
from bench.tables.build import class_orderings, condition_sweep, tables
from bench.tables.grid import row_mappings
from bench.tables.table import TABLES, Table, table_files
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole

VALUE_KEY = ["method", "condition", "class", "metric"]  # the columns that identify a value
# The entries of a manifest in which a run and its golden values have to agree.
PROTOCOL = ["protocol", "dataset", "objects", "views", "seed"]


@dataclass(frozen=True)
class CheckResult:
    """The result of comparing a run with golden values.

    comparisons       the values that were compared, grouped by method, condition and metric
    others            a line for each file of a table that its records do not give, and for each
                      unexpected outcome of the suite `stability`
    remarks           lines that people should read, which do not decide about success
    moved             the values of objects that are beyond their tolerances
    headline_metrics  the metrics of the suite's headline table
    outcomes          the number of outcomes of the suite `stability` that were compared
    """

    comparisons: tuple[GoldenComparison, ...]
    others: tuple[str, ...]
    remarks: tuple[str, ...]
    moved: tuple[GoldenDeviation, ...] = ()
    headline_metrics: tuple[str, ...] = ()
    outcomes: int = 0

    @property
    def compared(self) -> int:
        """Return the number of values and outcomes that were compared."""
        return self.outcomes + sum(comparison.compared for comparison in self.comparisons)

    @property
    def headline(self) -> int:
        """Return the number of values of the headline metrics that were compared."""
        return sum(
            comparison.compared
            for comparison in self.comparisons
            if comparison.metric in self.headline_metrics
        )

    @property
    def by_headline(self) -> tuple[list[str], list[str]]:
        """Return the lines on what differs by the headline metrics, and by all others."""
        headline: list[str] = []
        others = [f"DIFFERS {line}" for line in self.others]
        for comparison in self.comparisons:
            if not comparison.problem:
                continue
            if comparison.metric in self.headline_metrics:
                headline.append(f"{comparison.verdict} {comparison}")
            else:
                others.append(f"{comparison.verdict} {comparison}")
        return headline, others

    @property
    def differing(self) -> tuple[str, ...]:
        """Return a line for each comparison beyond its tolerance, and for all else that differs."""
        problems = [str(comparison) for comparison in self.comparisons if comparison.problem]
        return (*self.others, *problems)


def check(directory: Path, widths: Widths | None = None, file: Path | None = None) -> CheckResult:
    """Compare a finished run with the golden values in a user's file, or with those of its suite.

    Where there are golden values of single objects, the run may lack some of their objects, methods
    and conditions. It may have further ones, too, which are not compared. Means and distances are
    compared where the run has exactly the golden objects. A run of the suite `stability` is
    compared with its expected outcomes.

    directory  the folder of the run
    widths     the tolerances of values of objects (default: those of `object_tolerance`)
    file       the user's file of golden values (default: those of the suite)

    Raises BadInput where `directory` has no finished run, where the golden values are of another
    protocol (dataset, objects, views or seed), and where there is nothing to compare.
    """
    if file is not None:
        return _check_file(read_run(directory), file, widths or Widths())
    manifest = read_finished(directory)
    if manifest["suite"] == STABILITY.id:
        outcomes = read_outcomes(directory / TABLES)
        result = CheckResult((), tuple(unexpected(outcomes)), (), outcomes=len(outcomes))
    else:
        result = _check_values(read_run(directory), widths or Widths())
    if not (result.compared or result.differing):
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
    comparisons, moved, notes = compare_objects(run, golden_values, widths, means=True)
    if not comparisons:
        raise BadInput(
            f"{file}: has no method, condition and object of {run.directory} in common; check a "
            f"run with methods of {', '.join(sorted(golden_values.names['methods']))}"
        )
    remarks = _without_golden(run.manifest, golden_values)
    for kind, known in golden_values.names.items():
        absent = known - {*run.manifest[kind]}
        if absent:
            names = ", ".join(sorted(absent))
            remarks.append(f"golden values of what this run has not, left out: {kind} {names}")
    remarks += notes
    comparisons, truth = _truth_once(comparisons, moved)
    return CheckResult(comparisons, truth, tuple(remarks), moved, run.suite.headline)


def _own_protocol(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the properties in which a run and a user's own golden values have to agree.

    Of a dataset in a folder only the kind has to agree, not the path, and the number of objects may
    differ. Where the content of an object has changed, the values of the method `blank` differ.
    """
    common = {"suite": manifest["suite"], "truth": manifest.get(TRUTH, COLOURED)}
    common |= _protocol(manifest)
    common["dataset"] = str(manifest["dataset"]).partition(":")[0]
    del common["objects"]
    return common


def _check_values(run: Run, widths: Widths) -> CheckResult:
    """Compare a run with the golden values of its suite, and its tables with its records."""
    own_tables = tables(run)
    further = [class_orderings(run), condition_sweep(run)]
    written = [*own_tables, *(table for table in further if table is not None)]
    comparisons: tuple[GoldenComparison, ...] = ()
    moved: tuple[GoldenDeviation, ...] = ()
    remarks: list[str] = []
    name = golden_name(run.manifest)
    expected, objects = golden(name), read_objects(name)
    whole = _is_whole(run, expected, objects)
    if whole:
        comparisons = _compare_means(own_tables, run.manifest, expected)
    else:
        remarks.append("not all golden objects: means and distances of the run are not compared")
    if objects is not None:
        by_object, moved, notes = compare_objects(run, objects, widths, means=not whole)
        comparisons += by_object
        remarks += [*_without_golden(run.manifest, objects), *notes]
    comparisons, truth = _truth_once(comparisons, moved)
    others = (*truth, *_stale_tables(run.directory, written))
    return CheckResult(comparisons, others, tuple(remarks), moved, run.suite.headline)


def _truth_once(
    comparisons: Sequence[GoldenComparison], moved: Sequence[GoldenDeviation]
) -> tuple[tuple[GoldenComparison, ...], tuple[str, ...]]:
    """Return the comparisons, cleared of problems that other true images make, and a line on these.

    Other true images show where a white image and another method have moved on one object; else
    there is no line. Checksums of images, and cells that moved on further objects, keep their
    problems.
    """
    # The values of white images, and those of other methods with them, differ where the truth does.
    other = {deviation.item.object for deviation in moved if deviation.item.method == FLOOR}
    if not {each.item.method for each in moved if each.item.object in other} - {FLOOR}:
        return tuple(comparisons), ()
    else_moved = {
        (each.item.method, each.item.condition, each.metric)
        for each in moved
        if each.item.object not in other
    }
    kept, following = [], 0
    for each in comparisons:
        cell = (each.method, each.condition, each.metric)
        follows = each.problem and each.metric != IMAGE_CHECKSUM and cell not in else_moved
        if follows:
            following += 1
            kept.append(replace(each, problem=""))
        else:
            kept.append(each)
    line = (
        f"the true images, or the metrics: a white image has other values on {len(other)} objects, "
        f"{'/'.join(min(other))} among them. {following} lines that follow from it are left out"
    )
    return tuple(kept), (line,)


def _compare_means(
    own_tables: Sequence[Table], manifest: dict[str, Any], expected: pd.DataFrame
) -> tuple[GoldenComparison, ...]:
    """Compare each golden value of a method and condition that the run has."""
    values = {_value_key(row): row["value"] for row in _rows(own_tables)}
    comparisons = []
    methods, conditions = set(manifest["methods"]), set(manifest["conditions"])
    for row in expected.to_dict("records"):
        if row["method"] not in methods or row["condition"] not in conditions:
            continue
        value = values.get(_value_key(row), math.nan)
        problem = ""
        if not abs(value - row["value"]) <= row["tolerance"]:  # also for NaN
            problem = (
                f"{number(value)}, golden {row['value']:.6f} +- {row['tolerance']:.6f} "
                f"({row['reason']})"
            )
        comparisons.append(
            GoldenComparison(
                method=row["method"],
                condition=row["condition"],
                metric=row["metric"],
                compared=1,
                problem=problem,
                better=is_gain(row["metric"], value - row["value"]),
            )
        )
    return tuple(comparisons)


def _without_golden(manifest: dict[str, Any], golden_objects: GoldenObjects) -> list[str]:
    """Return lines that name the methods, conditions and objects without golden values."""
    lines = []
    for kind, known in golden_objects.names.items():
        if unknown := [name for name in manifest[kind] if name not in known]:
            lines.append(f"without golden values, left out: {kind} {', '.join(unknown)}")
    return lines


def bless(directory: Path, target: Path | None = None) -> list[Path]:
    """Write the values of a run as golden values, and return the files that were written.

    target  a user's own file, for golden values of single objects; or None or the folder of golden
            values of this project (see CONTRIBUTING), to replace those of the run's suite

    Raises BadInput for any other folder, for a run without scores or images, and where the golden
    values of a suite are to be replaced by those of a run that is not its whole default run.
    Raises CannotWrite where a file cannot be written.
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
    # A suite of several classes gets no values of single objects: for the 260 objects of thirteen
    # classes, the thumbnails alone would take 2 MB.
    by_object = write_objects(run, protocol) if len(run.suite.classes) == 1 else []
    write_whole(path, pd.DataFrame(lines).to_csv(index=False, lineterminator="\n").encode())
    return [path, *by_object]


def golden_lines(rows: Iterable[dict[str, Any]], protocol: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the lines of a file of golden values, one for each value of the tables.

    A metric without a tolerance has no line: such are fid and kid, whose weights the default
    protocol does not have. A chosen row (`bench.catalogue.chosen`) has none either, for its values
    are those of other methods.
    """
    lines = []
    row_of = {_value_key(row): row for row in rows}  # once, though two tables may show a value
    for key, row in row_of.items():
        rule = tolerance(row["method"], row["metric"])
        if rule is None or role(row["method"]) == "chosen" or not math.isfinite(row["value"]):
            continue
        allowed = rule.absolute + rule.relative * abs(row["value"])
        line = {
            **protocol,
            **dict(zip(VALUE_KEY, key, strict=True)),
            "value": f"{row['value']:.6f}",
            "tolerance": f"{allowed:.6f}",
            "reason": rule.reason,
        }
        lines.append(line)
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
    for kind, default in (("methods", suite.methods), ("conditions", suite.conditions)):
        missing = [name for name in default if name not in manifest[kind]]
        added = [name for name in manifest[kind] if name not in default]
        if missing:
            other.append(f"no {kind} {', '.join(missing)}")
        if added:
            other.append(f"also {kind} {', '.join(added)}")
    if other:
        raise BadInput(
            f"{run.directory}: golden values are of the whole default run, this one has "
            f"{'; '.join(other)}; run '{_command(manifest)}' and give its folder"
        )


def _command(manifest: Mapping[str, Any]) -> str:
    """Return the command of the default run of a run's suite, with the run's true images."""
    command = f"bench run --suite {manifest['suite']}"
    truth = manifest.get(TRUTH, COLOURED)
    if truth != COLOURED:
        command += f" --truth {truth}"
    return command


def _protocol(manifest: Mapping[str, Any]) -> dict[str, Any]:
    return {name: manifest[name] for name in PROTOCOL} | {"objects": len(manifest["objects"])}


def _differing(have: Mapping[str, Any], want: Mapping[str, Any], of: str = "golden") -> list[str]:
    """Return in words the entries of a protocol that differ from those wanted.

    of  what the wanted values are called, as in "views 3 (golden: 20)"
    """
    differing = [name for name in have if have[name] != want.get(name)]
    return [f"{name} {have[name]} ({of}: {want.get(name)})" for name in differing]


def _is_whole(run: Run, expected: pd.DataFrame, objects: GoldenObjects | None) -> bool:
    """Return whether a run has exactly the golden objects, so that its means can be compared.

    Raises BadInput where the run is of another protocol. Where there are no golden values of single
    objects, another number of objects is another protocol, too; where there are some, the run needs
    at least one of their objects.
    """
    have = _protocol(run.manifest)
    want = {name: expected[name].iloc[0] for name in PROTOCOL}
    other = _differing(have, want)
    whole = True  # without golden values of single objects, a part of a run is refused below
    if objects is not None:
        if objects.protocol != want:
            raise BadInput(
                f"{golden_path(golden_name(run.manifest))}: of another protocol than the golden "
                "values by object beside it; restore both with git, or write them with "
                "'bench check DIR --bless results/golden'"
            )
        other = _differing(have | {"objects": want["objects"]}, want)
        in_run, golden_objects = set(run.manifest["objects"]), objects.names["objects"]
        whole = in_run == golden_objects
        if in_run.isdisjoint(golden_objects):
            other.append("none of its objects is golden")
    if other:
        raise BadInput(
            f"{run.directory}: no golden values for this protocol: {', '.join(other)}; "
            f"check a run of '{_command(run.manifest)}' with its defaults"
        )
    return whole


def _stale_tables(directory: Path, written: Sequence[Table]) -> list[str]:
    """Return a line for each file of a table that is missing or not what the records give."""
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


def _value_key(row: Mapping[Any, Any]) -> tuple[Any, ...]:
    return tuple(row[name] for name in VALUE_KEY)
