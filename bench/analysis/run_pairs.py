"""Pairs of `bench compare`: the methods of two runs, or two methods of one run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.comparison import best_first, candidates, known_objects, pooled
from bench.analysis.paired import by_method, paired_differences, two_methods
from bench.analysis.scored_run import Run, read_run
from bench.catalogue.chosen import BEST_CLASSICAL, CHOSEN, MetricAtCondition
from bench.catalogue.methods import FLOOR
from bench.catalogue.metrics import declared_metric, is_mean
from bench.catalogue.suites import TRUTHS
from bench.records.frames import read_records
from bench.records.run_folder import CONDITION_IDENTITIES
from data_prep.failures import BadInput

_SAME_TRUTH = 0.005  # of that ssim: graphics drivers differ by less, objects by more
NAMED = 3  # objects in a message
MEASURED = ("images_of_a", "images_of_b")  # the methods whose images they are


@dataclass(frozen=True, eq=False)
class Differences:
    """The differences of two sides in all cells.

    a, b     names of the two sides: methods of one run, or folders of two
    cells    as `bench.analysis.paired.paired_differences` returns them
    remarks  what was left out, a sentence each
    truth    the truth that both sides are scored against, in words
    """

    a: str
    b: str
    cells: pd.DataFrame
    remarks: tuple[str, ...]
    truth: str


def methods_of_run(
    directory: Path, methods: Sequence[str], metrics: Sequence[str] | None
) -> Differences:
    """Return method b against method a of one finished run, in every condition and class.

    With several classes also all objects together, by image metrics. A method may be a chosen row:
    another method by each metric and condition (`bench.catalogue.chosen`).

    Raises BadInput where there are not two methods, for methods and metrics that the run does not
    have, and for a run without scores.
    """
    run = read_run(directory).with_further(metrics or ())
    if len(set(methods)) != 2:
        raise BadInput("one run is compared by two methods; give --methods a,b or a second folder")
    return _two_methods(run, methods, metrics)


@dataclass(frozen=True, eq=False)
class Standing:
    """The standing of a method among those of its run, in the cells under some conditions.

    conditions  those at which it has images, in the order of the run
    images      by condition how many images it has, and should have
    places      by headline metric its place in the mean over the cells, and among how many methods
    against     its differences from the best of the others by each metric, with the metrics that it
                is the best by; none for `best-classical`, which comes last
    """

    conditions: tuple[str, ...]
    images: Mapping[str, tuple[int, int]]
    places: Mapping[str, tuple[int, int]]
    against: Sequence[tuple[tuple[str, ...], Differences]]


def standing(run: Run, method: str, added: Sequence[str]) -> Standing:
    """Return the standing of a method among the methods of a run; the best are none of `added`.

    Where nothing competes, `blank` is the best. Raises BadInput for a run without scores.
    """
    metrics = _metrics([run], None, [])
    compared = run.compared(metrics, {*candidates(run.manifest["methods"]), FLOOR, method})
    drawn = compared[(compared["method"] == method) & (compared["metric"] == metrics[0])]
    sums = drawn.groupby("condition", sort=False)[["n_ok", "n"]].sum()
    images = {str(name): (int(row["n_ok"]), int(row["n"])) for name, row in sums.iterrows()}
    conditions = tuple(name for name, (count, _) in images.items() if count)
    among = compared[compared["condition"].isin(conditions)]
    values = among.groupby(["metric", "method", "images_of"], sort=False)["value"]
    means = values.agg(lambda of_cells: of_cells.mean(skipna=False)).reset_index()
    places: dict[str, tuple[int, int]] = {}
    best_by: dict[str, tuple[str, ...]] = {}
    for metric in metrics if conditions else ():
        of_metric = means[means["metric"] == metric]
        ranked = best_first(of_metric[of_metric["method"].isin([*candidates(means["method"])])])
        before = dict(zip(ranked["method"], ranked["before"], strict=True))
        if method in before:
            places[metric] = before[method] + 1, len(before)
        best = next((name for name in before if name not in added), FLOOR)
        best_by[best] = (*best_by.get(best, ()), metric)
    if BEST_CLASSICAL in _chosen_rows(run, metrics) and conditions:
        best_by[BEST_CLASSICAL] = ()
    against = [
        (by, _two_methods(run, (best, method), None, conditions)) for best, by in best_by.items()
    ]
    return Standing(conditions, images, places, against)


def _two_methods(
    run: Run,
    methods: Sequence[str],
    metrics: Sequence[str] | None,
    conditions: Sequence[str] | None = None,
) -> Differences:
    remarks: list[str] = []
    chosen = _metrics([run], metrics, remarks)
    chosen_rows = _chosen_rows(run, chosen)
    _refuse_unknown("--methods", methods, [*run.manifest["methods"], *chosen_rows])
    a, b = methods
    folder = _name(run.directory)
    compared = _compare(run, methods, chosen)
    if conditions is not None:
        compared = compared[compared["condition"].isin(conditions)]
    together = pooled(compared)
    parts = [compared] if together.empty else [compared, together]
    cells = pd.concat([two_methods(part.assign(run=folder), chosen, a, b) for part in parts])
    named = chosen_rows.keys() & set(methods)
    remarks += [CHOSEN[name].in_words(chosen_rows[name]) for name in CHOSEN if name in named]
    truth = TRUTHS[run.suite.truth]
    cells = cells.sort_values(
        "metric", key=lambda names: names.map(chosen.index), kind="stable", ignore_index=True
    )
    return Differences(a, b, cells, tuple(remarks), truth)


def runs(
    first: Path, second: Path, methods: Sequence[str] | None, metrics: Sequence[str] | None
) -> Differences:
    """Return each method of run b against that of run a, in every condition and class.

    Methods and conditions that only one run has are left out, with a remark. Raises BadInput where
    the runs did not see the same objects from the same views, naming what differs; where they have
    no method or condition in common; and as `methods_of_run`.
    """
    a, b = (read_run(d).with_further(metrics or ()) for d in (first, second))
    if a.suite.truth != b.suite.truth:
        raise BadInput(
            f"different truths: {first} is scored against {TRUTHS[a.suite.truth]}, {second} "
            f"against {TRUTHS[b.suite.truth]}; give both the same --truth"
        )
    _refuse_other_objects(a, b)
    remarks: list[str] = []
    shared, conditions = (
        _common(name, a.manifest[name], b.manifest[name], remarks)
        for name in ("methods", "conditions")
    )
    _refuse_unknown("--methods", methods or (), shared)
    _leave_out_changed(a, b, conditions, remarks)
    chosen = _metrics([a, b], metrics, remarks)
    among = _shared_objects(a, b, conditions, remarks)
    compared = [
        _compare(run, methods or shared, chosen, among).assign(run=_name(directory))
        for run, directory in ((a, first), (b, second))
    ]
    cells, names = compared[0][["condition", "class"]].drop_duplicates(), methods or shared
    in_a, in_b = map(by_method, compared)
    pairs = [
        (in_a[name][metric, *cell], in_b[name][metric, *cell])
        for metric in chosen
        for cell in cells.itertuples(index=False)
        for name in names
    ]
    truth = TRUTHS[a.suite.truth]
    sides = _name(first), _name(second)
    return Differences(*sides, paired_differences(pairs), tuple(remarks), truth)


def _name(directory: Path) -> str:
    """Return the path of a run as text that files and columns can hold: without lone surrogates."""
    return str(directory).encode(errors="backslashreplace").decode()


def _shared_objects(
    a: Run, b: Run, conditions: Sequence[str], remarks: list[str]
) -> dict[tuple[str, str], set[str]]:
    """Return the objects with true images in both runs, by condition and class.

    There is a remark on those whose true images failed in one of them.
    """
    of_a, of_b = known_objects(a), known_objects(b)
    cells = [cell for cell in of_a | of_b if cell[0] in conditions]
    both = {cell: of_a.get(cell, set()) & of_b.get(cell, set()) for cell in cells}
    lost: dict[str, set[str]] = {}
    for cell in cells:
        lost.setdefault(cell[1], set()).update(of_a.get(cell, set()) ^ of_b.get(cell, set()))
    for class_name, alone in sorted(lost.items()):
        names = sorted(alone)
        shown = f"{', '.join(names[:NAMED])}{' and others' * (len(names) > NAMED)}"
        most = max(len(here) for (_, name), here in both.items() if name == class_name)
        remarks += [
            f"{len(names)} of class {class_name} left out, as their true images failed in one of "
            f"the runs: {shown}; {most} are in both."
        ] * bool(names)
    return both


def _compare(
    run: Run,
    methods: Sequence[str],
    metrics: Sequence[str],
    among: Mapping[tuple[str, str], AbstractSet[str]] | None = None,
) -> pd.DataFrame:
    rows = {name: best for name, best in _chosen_rows(run, metrics).items() if name in methods}
    chosen = {method for best in rows.values() for method in best.values()}
    with threadpool_limits(1):  # the same digits on any number of cores
        compared = run.compared(metrics, {*methods, *chosen}, among)
    cells = pd.MultiIndex.from_frame(compared[["metric", "condition"]])
    best_rows = (
        compared[compared["method"] == cells.map(best)].assign(method=name)
        for name, best in rows.items()
    )
    return pd.concat([compared, *best_rows])


def _chosen_rows(run: Run, metrics: Sequence[str]) -> dict[str, dict[MetricAtCondition, str]]:
    """Return the methods of the chosen rows by cell; only rows that each cell has."""
    conditions = run.manifest["conditions"]
    cells = [(metric, condition) for metric in dict.fromkeys(metrics) for condition in conditions]
    rows = {name: row.best(cells, run.manifest["methods"]) for name, row in CHOSEN.items()}
    return {name: best for name, best in rows.items() if len(best) == len(cells)}


def _metrics(scored: Sequence[Run], wanted: Sequence[str] | None, remarks: list[str]) -> list[str]:
    """Return the metrics wanted, all of which the runs have to have.

    By default the metrics of the headline table.
    """
    suite = scored[0].suite
    further = [metric for metric in wanted or () if declared_metric(metric)]
    every = [*suite.image_metrics, *suite.detail_metrics, *suite.set_metrics, *further]
    every.sort(key=lambda metric: metric not in suite.headline)
    metrics = [metric for metric in every if all(run.measured([metric]) for run in scored)]
    extractors = {repr(sorted(r.manifest.get("feature_identity", {}).items())) for r in scored}
    if len(extractors) > 1:
        remarks.append("Features were taken by different extractors; set metrics are left out.")
        metrics = [metric for metric in metrics if is_mean(metric)]
    if wanted is not None:
        _refuse_unknown("--metric", wanted, metrics)
        return list(wanted)
    return [metric for metric in scored[0].headline if metric in metrics] or metrics[:1]


def _common(name: str, a: Sequence[str], b: Sequence[str], remarks: list[str]) -> list[str]:
    common = [value for value in a if value in b]
    if not common:
        raise BadInput(f"the runs have no {name} in common: {', '.join(a)}; {', '.join(b)}")
    if alone := [value for value in (*a, *b) if value not in common]:
        remarks.append(f"Only one of the runs has the {name} {', '.join(dict.fromkeys(alone))}.")
    return common


def _leave_out_changed(a: Run, b: Run, conditions: list[str], remarks: list[str]) -> None:
    """Take out the conditions of packages that give other clouds in the two runs, with a remark."""
    in_a, in_b = (run.manifest.get(CONDITION_IDENTITIES, {}) for run in (a, b))
    changed = [name for name in conditions if in_a.get(name) != in_b.get(name)]
    for name in changed:
        conditions.remove(name)
    if changed and not conditions:
        raise BadInput(
            f"the runs have no condition in common: {', '.join(changed)} of one run is another "
            "version of it; run one of them again"
        )
    if changed:
        remarks.append(f"Left out, as the clouds differ: the conditions {', '.join(changed)}.")


def _refuse_unknown(option: str, wanted: Sequence[str], known: Sequence[str]) -> None:
    for name in wanted:
        if name not in known:
            raise BadInput(
                f"{option} {name}: cannot be compared here; there are {', '.join(known)}"
            )


def _refuse_other_objects(*runs: Run) -> None:
    """Raise BadInput where two runs did not see the same objects from the same views."""
    seen = [_true_views(run) for run in runs]
    names = [{*views["name"]} for views in seen]
    for run, here, others in zip(runs, names, reversed(names), strict=True):
        if alone := sorted(here - others):
            more = f" and {len(alone) - NAMED} more" if len(alone) > NAMED else ""
            raise BadInput(
                f"different objects: only {run.directory} has {', '.join(alone[:NAMED])}{more}; "
                "run both alike"
            )
    both = seen[0].merge(seen[1], on=["name", "view"], suffixes=("_a", "_b"))
    if any(len(views) != len(both) for views in seen):
        of_each = " and ".join(f"{len(views) // len(names[0])}" for views in seen)
        raise BadInput(f"different views: {of_each} of an object; give both the same --views")
    turned = (both["azimuth_deg_a"] != both["azimuth_deg_b"]) | (
        both["elevation_deg_a"] != both["elevation_deg_b"]
    )
    for view in both[turned].itertuples():
        raise BadInput(
            f"different views: view {view.view} of {view.name} is at azimuth/elevation "
            f"{view.azimuth_deg_a:.2f}/{view.elevation_deg_a:.2f} and "
            f"{view.azimuth_deg_b:.2f}/{view.elevation_deg_b:.2f} degrees; give both the same "
            "--seed"
        )
    # Not for NaN: a blank image that failed.
    for view in both[(both["ssim_a"] - both["ssim_b"]).abs() > _SAME_TRUTH].itertuples():
        raise BadInput(
            f"different true images: {view.name} is not the same object in both runs (a blank "
            f"image has ssim {view.ssim_a:.3f} and {view.ssim_b:.3f}); give both the same --dataset"
        )


def _true_views(run: Run) -> pd.DataFrame:
    """Return the directions of the true images, and the ssim of a blank image with each."""
    columns = ("class", "object", "view", "azimuth_deg", "elevation_deg", "ssim")
    blank = read_records(run.directory, columns, method=FLOOR)
    blank["name"] = blank["class"] + "/" + blank["object"]
    # They are the same at every condition.
    views = blank.drop(columns=["class", "object"])
    return views.drop_duplicates(["name", "view"], keep="last")
