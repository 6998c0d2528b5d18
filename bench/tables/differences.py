"""`bench compare`: two runs, or two methods of one run, paired object by object."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.comparison import Comparison, compare, decimals, paired, pooled
from bench.analysis.intervals import FEWEST
from bench.analysis.paired import (
    SIGNIFICANCE,
    ComparedPair,
    PairedDifference,
    Side,
    paired_differences,
)
from bench.catalogue.methods import FLOOR
from bench.catalogue.metrics import IMAGE_METRICS, higher_is_better, is_mean
from bench.catalogue.reconstruction import BEST_RECONSTRUCTION, best_by_condition
from bench.records.journal import PROTOCOL
from bench.tables import markdown
from bench.tables.scored import ScoredRun, read_scored
from bench.tables.table import (
    BOLD,
    NOTHING,
    Annotation,
    Block,
    Cell,
    Table,
    columns,
    number,
    ordered,
    pivot,
    shown,
)
from data_prep.failures import BadInput

SAME_TRUTH = 0.005  # of that ssim: graphics drivers differ by less, objects by more
NAMED = 3  # objects in a message


@dataclass(frozen=True)
class Differences:
    """What `bench compare` says.

    a, b     names of the two sides: methods of one run, or folders of two
    remarks  what was left out, a sentence each
    """

    a: str
    b: str
    cells: tuple[PairedDifference, ...]
    remarks: tuple[str, ...]

    @property
    def table(self) -> Table[PairedDifference]:
        """One row a cell; people see a grid for each metric and class."""
        made = (
            *columns(("metric", "pair.metric"), ("condition", "pair.condition")),
            *columns(("class", "pair.class_name"), ("run_a", "pair.a.run")),
            *columns(("method_a", "pair.a.method"), ("run_b", "pair.b.run")),
            *columns(("method_b", "pair.b.method"), ("value_a", "pair.quality_a.estimate.value")),
            *columns(("value_b", "pair.quality_b.estimate.value")),
            *columns(("difference", "difference.value"), ("ci_low", "difference.low")),
            *columns(("ci_high", "difference.high"), "p", "p_holm", "ahead"),
            *columns(("objects", "pair.objects"), "objects_needed"),
        )
        title = f"{self.b} against {self.a}"
        return Table("differences", title, made, self.cells, self._layout)

    def _layout(self, rows: Sequence[PairedDifference]) -> Iterator[Block]:
        yield _legend(rows)
        yield from self.remarks
        if any(row.pair.objects < FEWEST for row in rows):
            yield f"Fewer than {FEWEST} objects have no interval, and show no difference."
        for metric, class_name in ordered((r.pair.metric, r.pair.class_name) for r in rows):
            of_grid = [
                r for r in rows if (r.pair.metric, r.pair.class_name) == (metric, class_name)
            ]
            better = "higher" if higher_is_better(metric) else "lower"
            yield f"## {markdown.cell(f'{metric}, {class_name}')} ({better} is better)"
            yield pivot(
                *(of_grid, "pair.b.method", "pair.condition", difference_cell),
                corner="method",
                named=_methods,
            )


def _legend(rows: Sequence[PairedDifference]) -> str:
    """Return the meaning of the marks that the cells can have."""
    legend = (
        "Each cell: value of a, value of b, and b - a with its 95 % interval, paired object by "
        "object, failed images scored as blank ones."
    )
    if tested := sum(not math.isnan(row.p) for row in rows):
        legend += (
            f" **Bold**: the two differ (p below {SIGNIFICANCE} after Holm's correction for "
            f"{tested} cells). `=`: a tie, no difference is shown."
        )
    if needed := [row.objects_needed for row in rows if row.objects_needed]:
        legend += f" `?`: {too_few(max(needed))}."
    return legend


def too_few(objects_needed: int) -> str:
    """Return the words for a cell that so few objects cannot decide."""
    return f"too few objects to decide: at least {objects_needed}"


def _methods(row: PairedDifference) -> str:
    a, b = row.pair.a.method, row.pair.b.method
    return b if a == b else f"{b} against {a}"


def difference_cell(row: PairedDifference) -> Cell:
    """Return both values and their difference with its interval; a dash where there is none."""
    if not math.isfinite(row.difference.value):
        return NOTHING
    digits = decimals(row.pair.metric)
    of_a, of_b = row.pair.quality_a.estimate, row.pair.quality_b.estimate
    values = f"{shown(of_a.value, digits)} to {shown(of_b.value, digits)}: "
    special = _TOO_FEW if row.objects_needed else _MARKS.get(row.ahead)
    cell = number(row.difference, f"{{:+.{digits}f}}".format, special=special)
    return replace(cell, text=values + cell.text)


_MARKS = {
    "a": BOLD,
    "b": BOLD,
    "tie": Annotation("tie", "{value}{interval} ="),
}
_TOO_FEW = Annotation("too few objects", "{value}{interval} ?")


def methods_of_run(
    directory: Path, methods: Sequence[str], metrics: Sequence[str] | None
) -> Differences:
    """Two methods of one finished run, method b against method a, in every condition and class.

    Of several classes also all objects together, by image metrics.

    `best-reconstruction` is one, too: at each condition the reconstruction that was best on
    validation chairs (`bench.catalogue.reconstruction`).

    Raises BadInput where there are not two methods, for methods and metrics that the run does not
    have, and for a run of which there are no scores.
    """
    run = read_scored(directory)
    if len(set(methods)) != 2:
        raise BadInput("one run is compared by two methods; give --methods a,b or a second folder")
    best = _best_by_condition(run)
    there = [*run.manifest["methods"], *([BEST_RECONSTRUCTION] if best else [])]
    _refuse_unknown("--methods", methods, there)
    remarks: list[str] = []
    chosen = _metrics([run], metrics, remarks)
    one, other = methods
    compared = _compare(run, methods, chosen)
    pairs = [
        _pair(metric, of, of, Side(str(directory), one), Side(str(directory), other))
        for of in [*compared, *pooled(compared)]
        for metric in of.qualities
    ]
    if BEST_RECONSTRUCTION in methods:
        parts = (f"`{method}` at {condition}" for condition, method in best.items())
        remarks.append(f"`{BEST_RECONSTRUCTION}` is {', '.join(parts)}.")
    cells = tuple(paired_differences(_by_metric(pairs, chosen)))
    return Differences(one, other, cells, tuple(remarks))


def runs(
    first: Path, second: Path, methods: Sequence[str] | None, metrics: Sequence[str] | None
) -> Differences:
    """Each method of two finished runs, run b against run a, in every condition and class.

    Methods and conditions that only one of them has are left out, with a remark. Raises BadInput
    where the runs did not see the same objects from the same views, naming what differs; where they
    have no method or condition in common; and as `methods_of_run`.
    """
    a, b = read_scored(first), read_scored(second)
    refuse_other_protocol(a, b)
    _refuse_other_objects(first, a.records, second, b.records)
    remarks: list[str] = []
    common = {
        name: _common(name, a.manifest[name], b.manifest[name], remarks)
        for name in ("methods", "conditions")
    }
    if methods is not None:
        _refuse_unknown("--methods", methods, common["methods"])
    names = methods or common["methods"]
    chosen = _metrics([a, b], metrics, remarks)
    in_a, in_b = (
        {(of.condition, of.class_name): of for of in _compare(run, names, chosen)} for run in (a, b)
    )
    pairs = [
        _pair(metric, of, in_b[cell], Side(str(first), name), Side(str(second), name))
        for cell, of in in_a.items()
        if cell in in_b
        for metric in chosen
        for name in names
    ]
    cells = tuple(paired_differences(_by_metric(pairs, chosen)))
    return Differences(str(first), str(second), cells, tuple(remarks))


def _compare(run: ScoredRun, methods: Sequence[str], metrics: Sequence[str]) -> list[Comparison]:
    best = _best_by_condition(run) if BEST_RECONSTRUCTION in methods else {}
    wanted = run.records[run.records["method"].isin([*methods, *best.values(), FLOOR])]
    with threadpool_limits(1):  # the same digits on any number of cores
        compared = compare(wanted, run.features, metrics)
    if not best:
        return compared
    return [
        replace(
            of,
            qualities={
                metric: {**by_method, BEST_RECONSTRUCTION: by_method[best[of.condition]]}
                for metric, by_method in of.qualities.items()
            },
        )
        for of in compared
    ]


def _best_by_condition(run: ScoredRun) -> dict[str, str]:
    """The best reconstruction at each condition of a run; empty where one has none."""
    conditions, methods = run.manifest["conditions"], run.manifest["methods"]
    best = best_by_condition(conditions, methods)
    return best if len(best) == len(conditions) else {}


def _pair(metric: str, in_a: Comparison, in_b: Comparison, a: Side, b: Side) -> ComparedPair:
    one, other = in_a.qualities[metric][a.method], in_b.qualities[metric][b.method]
    return ComparedPair(
        condition=in_a.condition,
        class_name=in_a.class_name,
        a=a,
        b=b,
        quality_a=one,
        quality_b=other,
        objects=len(paired(other, one)) if is_mean(metric) else len(in_a.objects),
    )


def _by_metric(pairs: Sequence[ComparedPair], metrics: Sequence[str]) -> list[ComparedPair]:
    return sorted(pairs, key=lambda pair: metrics.index(pair.metric))


def _metrics(
    scored: Sequence[ScoredRun], wanted: Sequence[str] | None, remarks: list[str]
) -> list[str]:
    """The metrics of all runs: those wanted, else ssim, those of the headline table, and the set
    metrics with features."""
    suite = scored[0].suite
    every = [*suite.image_metrics, *suite.detail_metrics, *suite.set_metrics]
    there = [metric for metric in every if all(run.measured([metric]) for run in scored)]
    if len({_identity(run) for run in scored}) > 1:
        remarks.append("Features were taken by different extractors; set metrics are left out.")
        there = [metric for metric in there if metric in IMAGE_METRICS]
    if wanted is not None:
        _refuse_unknown("--metric", wanted, there)
        return list(wanted)
    usual = ("ssim", *suite.headline)
    return [metric for metric in there if metric in usual or metric not in IMAGE_METRICS]


def _identity(run: ScoredRun) -> str:
    return repr(sorted(run.manifest.get("feature_identity", {}).items()))


def _common(name: str, a: Sequence[str], b: Sequence[str], remarks: list[str]) -> list[str]:
    common = [one for one in a if one in b]
    if not common:
        raise BadInput(f"the runs have no {name} in common: {', '.join(a)}; {', '.join(b)}")
    if alone := [one for one in (*a, *b) if one not in common]:
        remarks.append(f"Only one of the runs has the {name} {', '.join(dict.fromkeys(alone))}.")
    return common


def _refuse_unknown(option: str, wanted: Sequence[str], there: Sequence[str]) -> None:
    for name in wanted:
        if name not in there:
            raise BadInput(
                f"{option} {name}: cannot be compared here; there are {', '.join(there)}"
            )


class _Seen(NamedTuple):
    """Where an image is seen from, and the ssim of a blank one with the true one."""

    azimuth_deg: float
    elevation_deg: float
    blank_ssim: float


def refuse_other_protocol(a: ScoredRun, b: ScoredRun) -> None:
    """Raises BadInput, naming both, for runs of two versions of the protocol."""
    of_a, of_b = a.manifest[PROTOCOL], b.manifest[PROTOCOL]
    if of_a != of_b:
        raise BadInput(
            f"different protocols: {a.directory} has {of_a}, {b.directory} has {of_b}; run both "
            "with one version ('bench --protocol')"
        )


def _refuse_other_objects(first: Path, a: pd.DataFrame, second: Path, b: pd.DataFrame) -> None:
    """Raises BadInput where two runs did not see the same objects from the same views."""
    in_a, in_b = _seen(a), _seen(b)
    objects_a, objects_b = ({name for name, _ in seen} for seen in (in_a, in_b))
    for own, other, folder in ((objects_a, objects_b, first), (objects_b, objects_a, second)):
        if alone := sorted(own - other):
            raise BadInput(f"different objects: only {folder} has {_named(alone)}; run both alike")
    if in_a.keys() != in_b.keys():
        of_each = f"{len(in_a) // len(objects_a)} and {len(in_b) // len(objects_b)}"
        raise BadInput(f"different views: {of_each} of an object; give both the same --views")
    for (name, view), of_a in in_a.items():
        of_b = in_b[name, view]
        if of_a[:2] != of_b[:2]:
            raise BadInput(
                f"different views: view {view} of {name} is at azimuth {of_a.azimuth_deg:.2f} and "
                f"{of_b.azimuth_deg:.2f} degrees; give both the same --seed"
            )
        if abs(of_a.blank_ssim - of_b.blank_ssim) > SAME_TRUTH:  # not for NaN: a blank that failed
            raise BadInput(
                f"different true images: {name} is not the same object in both runs (a blank image "
                f"has ssim {of_a.blank_ssim:.3f} and {of_b.blank_ssim:.3f}); give both the same "
                "--dataset"
            )


def _seen(records: pd.DataFrame) -> dict[tuple[str, int], _Seen]:
    """What a run saw, by "class/object" and view."""
    blank = records[records["method"] == FLOOR]
    names = blank["class"].astype(str) + "/" + blank["object"].astype(str)
    seen = map(_Seen, blank["azimuth_deg"], blank["elevation_deg"], blank["ssim"])
    return dict(zip(zip(names, blank["view"], strict=True), seen, strict=True))


def _named(objects: Sequence[str]) -> str:
    more = f" and {len(objects) - NAMED} more" if len(objects) > NAMED else ""
    return ", ".join(objects[:NAMED]) + more
