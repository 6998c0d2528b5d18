"""The report of a finished run: one HTML file with everything, for use offline."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.comparison import ALL, pooled
from bench.analysis.frontier import places
from bench.analysis.paired import verdicts_of
from bench.analysis.scored_run import in_order
from bench.catalogue.conditions import condition_words, known_condition
from bench.catalogue.images import entered_claims
from bench.catalogue.method import is_module_name
from bench.catalogue.methods import find_method, known_method, role
from bench.catalogue.metrics import METRICS, column, declared_metric
from bench.catalogue.suites import TRUTHS, Suite, Truth
from bench.records.frames import read_jobs
from bench.records.job import JobName
from bench.records.record import TIMES
from bench.report.headline import compact_table
from bench.report.images import cases, extremes, grids, shown_objects
from bench.report.page import inline, rendered
from bench.report.plots import SweepPanel
from bench.report.run_figures import (
    cost_figures,
    described,
    family_figure,
    family_panels,
    quality_figure,
    quality_frame,
    quality_panels,
)
from bench.report.stored import open_sources
from bench.report.styles import method_styles
from bench.report.summary import Statement, in_short, objects_in_words
from bench.tables.build import Outputs, how_timed
from bench.tables.frontier import cost_grid
from bench.tables.table import Table
from data_prep.clouds.conditions import CONDITIONS
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole

REPORT = "report.html"
_MOST_LISTED = 200  # failures listed for one reason
_MARKUP = re.compile(r"`|\*\*|\\(.)")  # what remarks have, and escapes
_NARROW_IN = 4.6  # width of the plot beside the answer


def write_report(
    made: Outputs, out: Path | None = None, remedy: str = "give another --out"
) -> Path:
    """Write the report of a finished run to `out` (default: report.html in its folder).

    The same run gives the same bytes. Images that are no longer there, and clouds that cannot be
    made again, are named as missing. Raises BadInput where the store cannot be read, and
    CannotWrite where `out` cannot be written, with the `remedy`.
    """
    path = out or made.run.directory / REPORT
    text = rendered("report.html.jinja", **read_page(made))
    write_whole(path, text.encode(), remedy=remedy)
    return path


def read_page(made: Outputs) -> dict[str, Any]:
    """Return what the template of a report shows. Raises BadInput as `write_report`."""
    run, manifest, suite = made.run, made.run.manifest, made.run.suite
    views = int(manifest["views"])
    headline = run.headline
    by = ("method", "condition", "class", "object", "view")
    columns = (*by, "azimuth_deg", "elevation_deg", "outcome", "reason", "notes", *TIMES)
    records = in_order(run.read_images((*columns, column(headline[0]))), manifest, by)
    chosen = extremes(records, headline[0])
    sources = open_sources(run.directory, manifest, _shown(records, chosen))
    of_cost = run.measured(suite.frontier or suite.headline)
    with threadpool_limits(1):
        compared = run.compared(headline)
        together = pooled(compared)  # of several classes
        answer = in_short(compared if together.empty else together, headline, views)
        by_cost, verdicts = run.compared(of_cost), verdicts_of(run, of_cost)
        points = places(by_cost, views, verdicts)
        costed = cost_grid(by_cost, of_cost[0], views, verdicts)
    unfolded = (made.condition_sweep, made.orderings)
    every = (made.condition_sweep, *made.tables, made.tails, made.orderings)
    tables = [table for table in every if table is not None]
    arguments = ["bench", *map(str, manifest.get("command", [])[1:])]
    glossary = _glossary(manifest, suite, made.tables)
    return {
        "title": manifest["suite"],
        "about": suite.about,
        "head": _head(manifest, records, suite.truth),
        "quality": headline[0],
        "jobs": _jobs(run.directory, records),
        "facts": _facts(manifest),
        "outcomes": [(str(o), int(n)) for o, n in records["outcome"].value_counts().items()],
        "shares": dict(manifest.get("worker_shares", {})),
        "answer": [*answer, *(Statement("Not measured", (((), t),)) for t in run.not_measured)],
        "headline": compact_table(quality_frame(made.headline.frame)),
        **_plots(made, points),
        "tables": [
            (table.title, _MARKUP.sub(r"\1", table.remark), table.grids(), table in unfolded)
            for table in tables
        ],
        "cost_table": costed,
        "cost_remark": how_timed(manifest),
        "grids": grids(records, sources, headline[0]),
        "cases": cases(chosen, sources, headline[0]),
        "unseen": [sources.unseen] if sources.unseen else [],
        "failures": _failure_groups(records),
        "failed_images": int((records["outcome"] != "ok").sum()),
        "command": shlex.join(arguments) if arguments[1:] else f"bench run {suite.id}",
        "manifest": json.dumps(manifest, indent=2, ensure_ascii=False).split("\n"),
        "meanings": glossary,
        "glossary": {
            term: (f"{title.lower()}-{number}", meaning)
            for title, entries in glossary
            for number, (term, meaning) in enumerate(entries)
        },
    }


def _plots(made: Outputs, points: pd.DataFrame) -> dict[str, Any]:
    """Return the plots of a page, as (title, SVG): of the headline, of the rest, of the cost."""
    manifest, headline = made.run.manifest, made.run.headline
    styles = method_styles(manifest["methods"])
    shown = quality_panels(made.tables)
    first = [panel for (metric, _), panel in shown.items() if metric in headline]
    others = [panel for (metric, _), panel in shown.items() if metric not in headline]
    title = "Class by class" if not all(p.joined for p in shown.values()) else "Robustness"
    remark = _OF_TABLES
    if not made.curves.empty:
        title, remark, others = "Beyond training", _OF_OBJECTS, family_panels(made.curves)
    draw = quality_figure if made.curves.empty else family_figure
    frames = [table.frame for table in made.tables]
    failed = any((frame["failed"] & (frame["n_ok"] == 0)).any() for frame in frames)
    all_failed = _ALL_FAILED if failed else ""
    ceilings = [method for method in manifest["methods"] if role(method) == "ceiling"]
    left_out = f"{_LEFT_OUT} {', '.join(ceilings)}." if ceilings else ""
    narrow = {"columns": 1, "width_in": _NARROW_IN, "panel_in": 2.0}
    plots = {"first": [], "curves": [], "costs": []}
    if first:
        figure = quality_figure(first, styles, **narrow)
        plots["first"].append(inline(figure, "first", _in_words(first)))
    if others:
        plots["curves"].append(inline(draw(others, styles), "curves", _in_words(others)))
    for number, (metric, (figure, words)) in enumerate(cost_figures(points, styles).items()):
        plots["costs"].append((metric, inline(figure, f"cost-{number}", words)))
    remarks = [remark, left_out, all_failed]
    return {**plots, "curves_title": title, "curves_remark": " ".join(filter(None, remarks))}


def _in_words(shown: Sequence[SweepPanel]) -> str:
    return " ".join(f"{panel.title or panel.y_label}. {described(panel)}" for panel in shown)


def _shown(records: pd.DataFrame, chosen: pd.DataFrame) -> list[JobName]:
    """Return the jobs whose clouds are shown."""
    conditions = list(dict.fromkeys(map(str, records["condition"])))
    of_grids = [JobName("", c, *obj) for obj in shown_objects(records) for c in conditions]
    names = (chosen[name].tolist() for name in ("condition", "class", "object"))
    of_cases = [JobName("", *map(str, of_case)) for of_case in zip(*names, strict=True)]
    # A condition of another package that failed in the workers could end this process, too.
    saw_cloud = [m for m in records["method"].unique() if role(m) not in ("ceiling", "floor")]
    drawn = records[(records["outcome"] == "ok") & records["method"].isin(saw_cloud)]
    safe = {known.id for known in CONDITIONS} | {*drawn["condition"]}
    return [name for name in (*of_grids, *of_cases) if name.condition in safe]


def _head(manifest: Mapping[str, Any], records: pd.DataFrame, truth: Truth) -> list[str]:
    """Return in a few words what was run, against which truth, and how long it took."""
    count = len(records[["class", "object"]].drop_duplicates())
    classes = list(dict.fromkeys(map(str, records["class"])))
    objects = objects_in_words(count, classes[0] if len(classes) == 1 else ALL)
    of_classes = f" of {len(classes)} classes" if len(classes) > 1 else ""
    methods, views = len(manifest["methods"]), int(manifest["views"])
    head = [
        f"{objects}{of_classes} × {views} view{'s' * (views != 1)}",
        f"{methods} method{'s' * (methods > 1)}",
        TRUTHS[truth].removeprefix("the "),
    ]
    seconds: Mapping[str, float] = manifest.get("stage_seconds", {})
    if seconds:
        workers = manifest.get("workers")
        on = f" on {workers} core{'s' * (workers > 1)}" if workers else ""
        took = sum(seconds.values())
        head.append((f"{took:.0f} s" if took < 120 else f"{took / 60:.0f} min") + on)
    return head


def _jobs(directory: Path, records: pd.DataFrame) -> tuple[int, int]:
    """Return the number of jobs of a run, and of those that failed."""
    keys = ["method", "condition", "class", "object"]
    failed = records.loc[records["outcome"] != "ok", keys].drop_duplicates()
    jobs = read_jobs(directory)  # of what sees no cloud one for all conditions, a line for each
    keys = {tuple(job.name): job.key for job in jobs}
    names = map(tuple, failed.astype(str).itertuples(index=False))
    return len(set(keys.values())), len({keys.get(name, name) for name in names})


def _facts(manifest: Mapping[str, Any]) -> dict[str, str]:
    machine = manifest.get("machine", {})
    finished = str(manifest["finished"]).replace("T", " ").replace("+00:00", " UTC")
    return {
        "dataset": str(manifest["dataset"]),
        "finished": finished,
        "machine": f"{machine.get('cpu', 'unknown')}, {machine.get('cores', 'unknown')} cores",
        "pc2pix-bench": str(manifest.get("versions", {}).get("pc2pix-bench", "unknown")),
    }


_OF_TABLES = (
    "Up is better. Each point is a value of the tables, with its 95 % interval over objects. No "
    "line joins different kinds of changes."
)
_ALL_FAILED = "Where a method has no point, all its images failed."
_OF_OBJECTS = (
    "Up is better. Each point is a mean over objects, failed images scored as blank ones, with its "
    "95 % interval. A band is what a network was shown in training."
)
_LEFT_OUT = "Left out, because drawn from the mesh behind the cloud:"


def _glossary(
    manifest: Mapping[str, Any], suite: Suite, tables: Sequence[Table]
) -> list[tuple[str, list[tuple[str, str]]]]:
    """Return the meanings of metrics, methods and conditions."""
    metrics = {
        m.id: "Fréchet distance, lower is better: " * (m.kind == "set") + m.about
        for m in METRICS.values()
    }
    shown = {metric for table in tables for metric in table.frame["metric"]}
    requested = manifest.get("request", {}).get("metrics", ())
    further = {
        m: metrics.get(m, "of another package")
        for m in (*requested, *sorted(m for m in shown if declared_metric(m)))
    }
    measured = (
        *(*suite.image_metrics, *suite.detail_metrics, *suite.set_metrics),
        *(*suite.class_metrics, *suite.control_metrics, *further),
    )
    known = {c: known_condition(c) for c in manifest["conditions"]}
    origins = {c: f"{condition_words(c)}; {k.source}" for c, k in known.items() if k}
    return [
        ("Metrics", [(m, (metrics | further)[m]) for m in dict.fromkeys(measured)]),
        ("Methods", [(m, _source(m, manifest)) for m in manifest["methods"]]),
        ("Conditions", [(c, origins.get(c, "unknown")) for c in known]),
    ]


def _source(method: str, manifest: Mapping[str, Any]) -> str:
    if is_module_name(method) and known_method(method) is None:
        return "of a module that was not loaded for this page"
    if claims := entered_claims(manifest, method):
        return f"{claims.about}; trained on {claims.trained_on}"
    try:
        known = find_method(method)
    except BadInput as error:
        return f"no longer there: {error}"
    return f"{known.source}; trained on {known.trained_on or 'unknown objects'}"


def _failure_groups(records: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the images that are not there, by reason, the most frequent first.

    Each listed is (one method on one cloud, the views that it lacks); `more` are not listed.
    """
    failed = records[records["outcome"] != "ok"]
    groups = []
    for reason, of_reason in failed.groupby("reason", sort=True):
        items = of_reason.groupby(["method", "condition", "class", "object"], sort=False)
        listed = [("/".join(map(str, name)), _views(g["view"].tolist())) for name, g in items]  # type: ignore[arg-type]
        count = f"{len(of_reason)} images of {len(listed)} clouds"
        more = max(len(listed) - _MOST_LISTED, 0)
        group = {"reason": reason, "count": count, "failures": listed[:_MOST_LISTED], "more": more}
        groups.append((len(of_reason), group))
    return [group for _, group in sorted(groups, key=lambda pair: -pair[0])]


def _views(views: Sequence[int]) -> str:
    if len(views) > 1 and list(views) == list(range(views[0], views[0] + len(views))):
        return f"views {views[0]} to {views[-1]}"
    return f"view{'s' * (len(views) > 1)} {', '.join(map(str, views))}"
