"""The report of a finished run: one HTML file with everything, for use offline."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.compare import ALL, compared, pooled
from bench.analysis.differences import verdicts_of
from bench.analysis.frontier import frontier_verdicts
from bench.analysis.run import in_order
from bench.catalogue.conditions import CONDITIONS, condition_words, known_condition
from bench.catalogue.methods import find_method, is_module_name, known_method, role
from bench.catalogue.metrics import METRICS, column, declared_metric
from bench.catalogue.suites import TRUTHS, Suite, Truth
from bench.entered.claims import entered_claims
from bench.records.frames import read_jobs
from bench.records.job import TIMES, JobName
from bench.report.answer import Statement, compact_table, counted, in_short, objects_in_words
from bench.report.images import cases, extremes, grids, open_sources, shown_objects
from bench.report.look import of_run
from bench.report.page import inline, rendered
from bench.report.run_figures import (
    cost_figures,
    family_figure,
    family_panels,
    quality_figure,
    quality_frame,
    quality_panels,
)
from bench.report.styles import method_styles
from bench.tables.build import Outputs, how_timed
from bench.tables.frontier import cost_grid
from bench.tables.table import Table
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole

# Sections of (title, entries), an entry a term and its meaning.
Glossary = list[tuple[str, list[tuple[str, str]]]]
REPORT = "report.html"  # in the folder of a run
_MOST_NAMED = 200  # clouds that are named for one reason of a failure; the others are counted
_MARKUP = re.compile(r"`|\*\*|\\(.)")  # the Markdown of remarks, which the page has without it
_NARROW_IN = 4.6  # inches: width of the plot beside the answer


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
    """Return the values that the template of a report shows. Raises BadInput as `write_report`."""
    run, manifest, suite = made.run, made.run.manifest, made.run.suite
    views = int(manifest["views"])
    headline = run.headline
    by = ("method", "condition", "class", "object", "view")
    columns = (*by, "azimuth_deg", "elevation_deg", "outcome", "reason", "notes", *TIMES)
    records = in_order(run.read_images((*columns, column(headline[0]))), manifest, by)
    chosen = extremes(records, headline[0])
    sources = open_sources(run.directory, manifest, _shown(records, chosen))
    cost_metrics = run.measured(suite.frontier or suite.headline)
    with threadpool_limits(1):
        by_headline = compared(run, headline)
        together = pooled(by_headline)  # without rows for a single class
        answer = in_short(by_headline if together.empty else together, headline, views)
        by_cost, verdicts = compared(run, cost_metrics), verdicts_of(run, cost_metrics)
        points = frontier_verdicts(by_cost, views, verdicts)
        costed = cost_grid(by_cost, cost_metrics[0], views, verdicts)
    not_measured = [Statement("Not measured", (((), text),)) for text in run.not_measured]
    unfolded = (made.condition_sweep, made.orderings)
    tables = []
    for table in (made.condition_sweep, *made.tables, made.tails, made.orderings):
        if table is not None:
            remark = _MARKUP.sub(r"\1", table.remark)
            tables.append((table.title, remark, table.grids(), table in unfolded))
    glossary = _glossary(manifest, suite, made.tables)
    return {
        "scripts": ("report.js", "pictures.js", "viewer.js"),
        "title": manifest["suite"],
        "about": suite.about,
        "head": _head(manifest, records, suite.truth),
        "quality": headline[0],
        "jobs": _jobs(run.directory, records),
        "facts": _facts(manifest),
        "outcomes": [(str(o), int(n)) for o, n in records["outcome"].value_counts().items()],
        "shares": dict(manifest.get("worker_shares", {})),
        "answer": [*answer.lines, *not_measured],
        "headline": compact_table(quality_frame(made.headline.frame), answer.standings),
        **_plots(made, points),
        "tables": tables,
        "cost_table": costed,
        "cost_remark": how_timed(manifest),
        "look": of_run(records, sources, headline[0]),
        "grids": grids(records, sources, headline[0]),
        "cases": cases(chosen, sources, headline[0]),
        "unseen": [sources.unseen] if sources.unseen else [],
        "failures": _failure_groups(records),
        "failed_images": int((records["outcome"] != "ok").sum()),
        "command": _shown_command(manifest.get("command", ())) or f"bench run {suite.id}",
        "added": list(map(_shown_command, manifest.get("added", ()))),
        "manifest": json.dumps(manifest, indent=2, ensure_ascii=False).split("\n"),
        "meanings": glossary,
        "glossary": _anchors(glossary),
    }


def _shown_command(command: Sequence[str]) -> str:
    """Return a command line as one types it; "" for one without arguments."""
    return shlex.join(["bench", *command[1:]]) if command[1:] else ""


def _anchors(glossary: Glossary) -> dict[str, tuple[str, str]]:
    """Return by term the id of its entry on the page, and its meaning."""
    anchors = {}
    for title, entries in glossary:
        for number, (term, meaning) in enumerate(entries):
            anchors[term] = f"{title.lower()}-{number}", meaning
    return anchors


def _plots(made: Outputs, points: pd.DataFrame) -> dict[str, Any]:
    """Return the plots of a page as SVG: `first` of the headline, `curves` of the other metrics.

    `costs` are (metric, SVG); `curves_title` and `curves_remark` stand above the curves.
    """
    manifest, headline = made.run.manifest, made.run.headline
    styles = method_styles(manifest["methods"])
    shown = quality_panels(made.tables)
    first = [panel for (metric, _), panel in shown.items() if metric in headline]
    others = [panel for (metric, _), panel in shown.items() if metric not in headline]
    if not made.curves.empty:
        title, remark, draw = "Beyond training", _OF_OBJECTS, family_figure
        others = family_panels(made.curves)
    else:
        by_condition = all(panel.joined for panel in shown.values())
        title = "Robustness" if by_condition else "Class by class"
        remark, draw = _OF_TABLES, quality_figure
    frames = [table.frame for table in made.tables]
    failed = any((frame["failed"] & (frame["n_ok"] == 0)).any() for frame in frames)
    all_failed = _ALL_FAILED if failed else ""
    ceilings = [method for method in manifest["methods"] if role(method) == "ceiling"]
    left_out = f"{_LEFT_OUT} {', '.join(ceilings)}." if ceilings else ""
    narrow = {"columns": 1, "width_in": _NARROW_IN, "panel_in": 2.0}
    plots = {"first": [], "curves": [], "costs": []}
    if first:
        figure = quality_figure(first, styles, **narrow)
        plots["first"].append(inline(figure, "first", _WORDS))
    if others:
        plots["curves"].append(inline(draw(others, styles), "curves", _WORDS))
    for number, (metric, figure) in enumerate(cost_figures(points, styles).items()):
        plots["costs"].append((metric, inline(figure, f"cost-{number}", _WORDS)))
    remarks = [remark, left_out, all_failed]
    return {**plots, "curves_title": title, "curves_remark": " ".join(filter(None, remarks))}


def _shown(records: pd.DataFrame, chosen: pd.DataFrame) -> list[JobName]:
    """Return the names of the clouds that the page shows, as jobs without a method.

    chosen  the records that are shown as worst and best cases
    """
    conditions = list(dict.fromkeys(map(str, records["condition"])))
    of_grids = [JobName("", at, *obj) for obj, at in product(shown_objects(records), conditions)]
    names = (chosen[name].tolist() for name in ("condition", "class", "object"))
    of_cases = [JobName("", *map(str, of_case)) for of_case in zip(*names, strict=True)]
    # Clouds are made again in this process. A condition of another package that ended the workers
    # could end it, too: only conditions are taken at which a method has seen a cloud and drawn it.
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
        f"{objects}{of_classes} × {counted(views, 'view')}",
        counted(methods, "method"),
        TRUTHS[truth].removeprefix("the "),
    ]
    seconds: Mapping[str, float] = manifest.get("stage_seconds", {})
    if seconds:
        workers = manifest.get("workers")
        duration = sum(seconds.values())
        text = f"{duration:.0f} s" if duration < 120 else f"{duration / 60:.0f} min"
        if workers:
            text += f" on {counted(workers, 'core')}"
        head.append(text)
    return head


def _jobs(directory: Path, records: pd.DataFrame) -> tuple[int, int]:
    """Return the number of jobs of a run, and of those that failed."""
    columns = ["method", "condition", "class", "object"]
    failed = records.loc[records["outcome"] != "ok", columns].drop_duplicates()
    # A method that sees no cloud has one job for all conditions, which is listed at each of them:
    # its key is the same, and is counted once.
    keys = {tuple(job.name): job.key for job in read_jobs(directory)}
    names = map(tuple, failed.astype(str).itertuples(index=False))
    return len(set(keys.values())), len({keys.get(name, name) for name in names})


def _facts(manifest: Mapping[str, Any]) -> dict[str, str]:
    """Return what stands in the head of the page on data, time, machine and version."""
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
_WORDS = "A plot; the tables of this page have its values."  # for readers who do not see it
_ALL_FAILED = "Where a method has no point, all its images failed."
_OF_OBJECTS = (
    "Up is better. Each point is a mean over objects, failed images scored as blank ones, with its "
    "95 % interval. A band is what a network was shown in training."
)
_LEFT_OUT = "Left out, because drawn from the mesh behind the cloud:"


def _glossary(manifest: Mapping[str, Any], suite: Suite, tables: Sequence[Table]) -> Glossary:
    """Return the meanings of the metrics, methods and conditions of a run."""
    in_tables = {metric for table in tables for metric in table.frame["metric"]}
    metrics = (
        *suite.image_metrics,
        *suite.detail_metrics,
        *suite.set_metrics,
        *suite.class_metrics,
        *suite.control_metrics,
        *manifest.get("request", {}).get("metrics", ()),
        *sorted(metric for metric in in_tables if declared_metric(metric)),
    )
    conditions = []
    for condition in manifest["conditions"]:
        known = known_condition(condition)
        meaning = f"{condition_words(condition)}; {known.source}" if known else "unknown"
        conditions.append((condition, meaning))
    return [
        ("Metrics", [(metric, _meaning(metric)) for metric in dict.fromkeys(metrics)]),
        ("Methods", [(method, _source(method, manifest)) for method in manifest["methods"]]),
        ("Conditions", conditions),
    ]


def _meaning(metric: str) -> str:
    """Return what a metric measures."""
    known = METRICS.get(metric)
    if known is None:
        return "of another package"
    if known.kind == "set":
        return f"Fréchet distance, lower is better: {known.about}"
    return known.about


def _source(method: str, manifest: Mapping[str, Any]) -> str:
    """Return where a method comes from and what it was trained on."""
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
    """Return the images that failed by reason, the most frequent reason first.

    A group has the `reason`, the `count` in words, the `failures` as (one method on one cloud, the
    views that it lacks), and how many `more` clouds there are that are not named.
    """
    failed = records[records["outcome"] != "ok"]
    groups = []
    for reason, of_reason in failed.groupby("reason", sort=True):
        items = of_reason.groupby(["method", "condition", "class", "object"], sort=False)
        failures = []
        for name, of_job in items:
            job = "/".join(map(str, name))  # type: ignore[arg-type]
            failures.append((job, _views(of_job["view"].tolist())))
        group = {
            "reason": reason,
            "count": f"{len(of_reason)} images of {len(failures)} clouds",
            "failures": failures[:_MOST_NAMED],
            "more": max(len(failures) - _MOST_NAMED, 0),
        }
        groups.append((len(of_reason), group))
    return [group for _, group in sorted(groups, key=lambda pair: -pair[0])]


def _views(views: Sequence[int]) -> str:
    """Return the numbers of views in words: "view 3", "views 0 to 9" or "views 1, 4"."""
    if len(views) == 1:
        return f"view {views[0]}"
    if list(views) == list(range(views[0], views[0] + len(views))):
        return f"views {views[0]} to {views[-1]}"
    return f"views {', '.join(map(str, views))}"
