"""Pairs of `bench compare`: the methods of two runs, or two methods of one run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.compare import (
    CloudSet,
    best_first,
    candidates,
    compared,
    known_objects,
    pooled,
)
from bench.analysis.differences import by_method, paired_differences, two_methods
from bench.analysis.run import Run, read_run
from bench.catalogue.chosen import BEST_CLASSICAL, CHOSEN, MetricAtCondition
from bench.catalogue.methods import FLOOR
from bench.catalogue.metrics import declared_metric, is_mean
from bench.catalogue.suites import TRUTHS
from bench.records.folder import CONDITION_IDENTITIES
from bench.records.frames import read_records
from data_prep.failures import BadInput

# The most by which the ssim of a blank image differs between two runs whose true images are the
# same: graphics drivers move it by less, another object by more.
_SAME_TRUTH = 0.005
NAMED = 3  # objects that a message names; it counts the others
IMAGES_OF = ("images_of_a", "images_of_b")  # columns of the methods that drew the images


@dataclass(frozen=True, eq=False)
class Differences:
    """The differences of two sides by all criteria.

    a, b     names of the two sides: two methods of one run, or the folders of two runs
    rows     as `bench.analysis.differences.paired_differences` returns them
    remarks  a sentence on each thing that was left out
    truth    the true images that both sides are scored against, in words
    """

    a: str
    b: str
    rows: pd.DataFrame
    remarks: tuple[str, ...]
    truth: str


def compare_methods(
    directory: Path, methods: Sequence[str], metrics: Sequence[str] | None
) -> Differences:
    """Return method b against method a of one finished run, under every condition and class.

    Of several classes there are also the differences of all objects together, by metrics of images.
    One of the two may be a row that stands for another method by each metric and condition, such as
    `best-classical` (`bench.catalogue.chosen`).

    Raises BadInput where there are not two methods, for methods and metrics that the run does not
    have, and for a run without scores.
    """
    run = read_run(directory).with_further(metrics or ())
    if len(set(methods)) != 2:
        raise BadInput("one run is compared by two methods; give --methods a,b or a second folder")
    return _two_methods(run, methods, metrics)


@dataclass(frozen=True, eq=False)
class Standing:
    """The standing of a method among those of its run, under the conditions where it has images.

    conditions  these conditions, in the order of the run
    images      by condition how many images it has, and how many it should have
    places      by metric of the headline its place, by the mean over conditions and classes, and
                the number of methods that have a place
    against     (metrics, differences) for each method that is the best of the others by some
                metrics: these metrics, and the differences from that method. Those from
                `best-classical` come last, without metrics
    """

    conditions: tuple[str, ...]
    images: Mapping[str, tuple[int, int]]
    places: Mapping[str, tuple[int, int]]
    against: Sequence[tuple[tuple[str, ...], Differences]]


def method_standing(run: Run, method: str, added: Sequence[str]) -> Standing:
    """Return how a method stands among the methods of a run.

    added  methods that were added together with it: it is not compared with them

    Where no other method competes it is compared with `blank`. Raises BadInput for a run without
    scores.
    """
    metrics = _metrics([run], None, [])
    rows = compared(run, metrics, {*candidates(run.manifest["methods"]), FLOOR, method})
    drawn = rows[(rows["method"] == method) & (rows["metric"] == metrics[0])]
    sums = drawn.groupby("condition", sort=False)[["n_ok", "n"]].sum()
    images = {str(name): (int(row["n_ok"]), int(row["n"])) for name, row in sums.iterrows()}
    conditions = tuple(name for name, (count, _) in images.items() if count)
    among = rows[rows["condition"].isin(conditions)]
    values = among.groupby(["metric", "method", "images_of"], sort=False)["value"]
    means = values.agg(lambda of_method: of_method.mean(skipna=False)).reset_index()
    if not conditions:
        return Standing(conditions, images, {}, [])
    places: dict[str, tuple[int, int]] = {}
    best_by: dict[str, tuple[str, ...]] = {}  # the metrics that a method is the best by
    for metric in metrics:
        of_metric = means[means["metric"] == metric]
        ranked = best_first(of_metric[of_metric["method"].isin(candidates(means["method"]))])
        before = dict(zip(ranked["method"], ranked["before"], strict=True))
        if method in before:
            places[metric] = before[method] + 1, len(before)
        best = next((name for name in before if name not in added), FLOOR)
        best_by[best] = (*best_by.get(best, ()), metric)
    chosen = _chosen_rows(run, metrics).get(BEST_CLASSICAL, {})
    if any(condition in conditions for _, condition in chosen):
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
    """Return method b against method a of a run; None: by its headline, under all conditions."""
    remarks: list[str] = []
    chosen = _metrics([run], metrics, remarks)
    chosen_rows = _chosen_rows(run, chosen)
    _refuse_unknown("--methods", methods, [*run.manifest["methods"], *chosen_rows])
    a, b = methods
    folder = _name(run.directory)
    rows = _compare(run, methods, chosen)
    if conditions is not None:
        rows = rows[rows["condition"].isin(conditions)]
    named = [name for name in CHOSEN if name in chosen_rows and name in methods]
    for name in named:
        known = {condition for _, condition in chosen_rows[name]}
        unknown = [at for at in rows["condition"].unique() if at not in known]
        if unknown:
            remarks.append(f"{', '.join(unknown)} left out: no `{name}` has been chosen there.")
    together = pooled(rows)
    parts = [rows] if together.empty else [rows, together]
    rows = pd.concat([two_methods(part.assign(run=folder), chosen, a, b) for part in parts])
    remarks += [CHOSEN[name].in_words(chosen_rows[name]) for name in named]
    truth = TRUTHS[run.suite.truth]
    rows = rows.sort_values(
        "metric", key=lambda names: names.map(chosen.index), kind="stable", ignore_index=True
    )
    return Differences(a, b, rows, tuple(remarks), truth)


def compare_runs(
    first: Path, second: Path, methods: Sequence[str] | None, metrics: Sequence[str] | None
) -> Differences:
    """Return each method of run b against that of run a, under every condition and class.

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
    refuse_other_objects(a, b)
    remarks: list[str] = []
    shared, conditions = (
        _common(name, a.manifest[name], b.manifest[name], remarks)
        for name in ("methods", "conditions")
    )
    _refuse_unknown("--methods", methods or (), shared)
    _leave_out_changed(a, b, conditions, remarks)
    chosen = _metrics([a, b], metrics, remarks)
    among = _shared_objects(a, b, conditions, remarks)
    names = methods or shared
    compared_a = _compare(a, names, chosen, among).assign(run=_name(first))
    compared_b = _compare(b, names, chosen, among).assign(run=_name(second))
    cloud_sets = compared_a[["condition", "class"]].drop_duplicates()
    in_a, in_b = by_method(compared_a), by_method(compared_b)
    pairs = []
    for metric in chosen:
        for condition, class_name in cloud_sets.itertuples(index=False):
            criterion = (metric, condition, class_name)
            pairs += [(in_a[name][criterion], in_b[name][criterion]) for name in names]
    truth = TRUTHS[a.suite.truth]
    sides = _name(first), _name(second)
    return Differences(*sides, paired_differences(pairs), tuple(remarks), truth)


def _name(directory: Path) -> str:
    """Return the path of a run as text that a file can hold: without lone surrogates."""
    return str(directory).encode(errors="backslashreplace").decode()


def _shared_objects(
    a: Run, b: Run, conditions: Sequence[str], remarks: list[str]
) -> dict[CloudSet, set[str]]:
    """Return the objects with true images in both runs, by condition and class.

    A remark names those whose true images failed in one of the runs.
    """
    of_a, of_b = known_objects(a), known_objects(b)
    cloud_sets = [cloud_set for cloud_set in of_a | of_b if cloud_set[0] in conditions]
    both: dict[CloudSet, set[str]] = {}
    of_one: dict[str, set[str]] = {}  # by class, the objects that only one run has
    for cloud_set in cloud_sets:
        _, class_name = cloud_set
        in_a, in_b = of_a.get(cloud_set, set()), of_b.get(cloud_set, set())
        both[cloud_set] = in_a & in_b
        of_one.setdefault(class_name, set()).update(in_a ^ in_b)
    for class_name, objects in sorted(of_one.items()):
        if not objects:
            continue
        names = sorted(objects)
        first = ", ".join(names[:NAMED])
        others = " and others" if len(names) > NAMED else ""
        most = max(len(shared) for (_, name), shared in both.items() if name == class_name)
        remarks.append(
            f"{len(names)} of class {class_name} left out, as their true images failed in one of "
            f"the runs: {first}{others}; {most} are in both."
        )
    return both


def _compare(
    run: Run,
    methods: Sequence[str],
    metrics: Sequence[str],
    among: Mapping[CloudSet, AbstractSet[str]] | None = None,
) -> pd.DataFrame:
    """Return the comparison of methods, with the rows of those that choose another method.

    among  objects that take part, by condition and class; by default all
    """
    chosen_rows = {
        name: best for name, best in _chosen_rows(run, metrics).items() if name in methods
    }
    chosen = {method for best in chosen_rows.values() for method in best.values()}
    with threadpool_limits(1):  # the same digits on any number of cores
        rows = compared(run, metrics, {*methods, *chosen}, among)
    chosen_by = pd.MultiIndex.from_frame(rows[["metric", "condition"]])
    parts = [rows]
    for name, best in chosen_rows.items():
        parts.append(rows[rows["method"] == chosen_by.map(best)].assign(method=name))
    return pd.concat(parts)


def _chosen_rows(run: Run, metrics: Sequence[str]) -> dict[str, dict[MetricAtCondition, str]]:
    """Return the rows that choose a method, each as methods by metric and condition.

    Conditions under which a row has no method by one of the metrics are left out, and rows without
    any other condition.
    """
    rows = {}
    for name, row in CHOSEN.items():
        best: dict[MetricAtCondition, str] = {}
        for condition in run.manifest["conditions"]:
            chosen_by = [(metric, condition) for metric in dict.fromkeys(metrics)]
            at_condition = row.best(chosen_by, run.manifest["methods"])
            if len(at_condition) == len(chosen_by):
                best |= at_condition
        if best:
            rows[name] = best
    return rows


def _metrics(scored: Sequence[Run], wanted: Sequence[str] | None, remarks: list[str]) -> list[str]:
    """Return the wanted metrics, by default those of the headline that all runs have.

    There is a remark where distances between sets of images cannot be compared. Raises BadInput for
    a wanted metric that a run does not have.
    """
    suite = scored[0].suite
    further = [metric for metric in wanted or () if declared_metric(metric)]
    every = [*suite.image_metrics, *suite.detail_metrics, *suite.set_metrics, *further]
    every.sort(key=lambda metric: metric not in suite.headline)  # a stable sort: the headline first
    metrics = every
    for run in scored:
        metrics = run.measured(metrics)
    extractors = {repr(sorted(r.manifest.get("feature_identity", {}).items())) for r in scored}
    if len(extractors) > 1:
        remarks.append("Features were taken by different extractors; set metrics are left out.")
        metrics = [metric for metric in metrics if is_mean(metric)]
    if wanted is not None:
        _refuse_unknown("--metric", wanted, metrics)
        return list(wanted)
    return [metric for metric in scored[0].headline if metric in metrics] or metrics[:1]


def _common(name: str, a: Sequence[str], b: Sequence[str], remarks: list[str]) -> list[str]:
    """Return the methods or conditions that both runs have, with a remark on the others.

    name  "methods" or "conditions"
    """
    common = [value for value in a if value in b]
    if not common:
        raise BadInput(f"the runs have no {name} in common: {', '.join(a)}; {', '.join(b)}")
    if alone := [value for value in (*a, *b) if value not in common]:
        remarks.append(f"Only one of the runs has the {name} {', '.join(dict.fromkeys(alone))}.")
    return common


def _leave_out_changed(a: Run, b: Run, conditions: list[str], remarks: list[str]) -> None:
    """Remove the conditions whose clouds differ between the runs, with a remark."""
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
    """Raise BadInput for a name of an option (--methods or --metric) that is not known."""
    for name in wanted:
        if name not in known:
            raise BadInput(
                f"{option} {name}: cannot be compared here; there are {', '.join(known)}"
            )


def refuse_other_objects(*runs: Run) -> None:
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
    # A blank image that failed has no ssim; NaN is not above the limit, so that it is passed over.
    for view in both[(both["ssim_a"] - both["ssim_b"]).abs() > _SAME_TRUTH].itertuples():
        raise BadInput(
            f"different true images: {view.name} is not the same object in both runs (a blank "
            f"image has ssim {view.ssim_a:.3f} and {view.ssim_b:.3f}); give both the same --dataset"
        )


def _true_views(run: Run) -> pd.DataFrame:
    """Return the direction of view of each true image, and the ssim of a blank image with it."""
    columns = ("class", "object", "view", "azimuth_deg", "elevation_deg", "ssim")
    blank = read_records(run.directory, columns, method=FLOOR)
    blank["name"] = blank["class"] + "/" + blank["object"]
    # The true images are the same at every condition: one row of each is kept.
    views = blank.drop(columns=["class", "object"])
    return views.drop_duplicates(["name", "view"], keep="last")
