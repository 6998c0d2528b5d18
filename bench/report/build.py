"""The report of a finished run: one HTML file with everything, for use offline."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.comparison import ALL, pooled
from bench.analysis.frame import in_order
from bench.analysis.paired import verdicts_of
from bench.analysis.scores import QualityRow
from bench.catalogue.conditions import condition_words, known_condition
from bench.catalogue.images import entered_claims
from bench.catalogue.method import is_module_name
from bench.catalogue.methods import find_method, known_method, role
from bench.catalogue.metrics import (
    METRICS,
    column,
    declared_metric,
)
from bench.catalogue.suites import TRUTHS, Suite, Truth
from bench.records.artifacts import JobName
from bench.records.record import TIMES
from bench.records.store import STORE
from bench.records.stored_artifacts import read_jobs
from bench.report.families import family_curves
from bench.report.headline import compact_table
from bench.report.images import cases, extremes, grids, shown_objects
from bench.report.legend import legend
from bench.report.page import (
    Choice,
    Failure,
    FailureGroup,
    Page,
    Plot,
    PlotGroup,
    Statement,
    TableGroup,
    html,
)
from bench.report.pareto import cost_plots
from bench.report.robustness import curve_panels, curves
from bench.report.stored import Sources, open_sources
from bench.report.styles import MethodStyle, method_styles
from bench.report.summary import in_short, objects_in_words
from bench.tables.build import Outputs, how_timed
from bench.tables.frontier import cost_grid
from bench.tables.grid import Tags
from bench.tables.markdown import visible
from bench.tables.table import Table
from data_prep.clouds.conditions import CONDITIONS
from data_prep.failures import BadInput, CannotWrite
from data_prep.files.atomic_write import write_whole

REPORT = "report.html"
MOST_LISTED = 200  # failures listed for one reason
_MARKUP = re.compile(r"`|\*\*|\\(.)")  # what remarks have, and escapes
OPEN_PLOTS = 4  # of a group: two by two, or two wide ones


def write_report(
    made: Outputs, out: Path | None = None, remedy: str = "give another --out"
) -> Path:
    """Write the report of a finished run to `out` (default: report.html in its folder).

    The same run gives the same bytes. Images that are no longer there, and clouds that cannot be
    made again, are named as missing. Raises BadInput where the store cannot be read, and
    CannotWrite where `out` cannot be written, with the `remedy`.
    """
    path = out or made.run.directory / REPORT
    text = html(read_page(made))
    try:
        write_whole(path, text.encode())
    except OSError as error:
        raise CannotWrite(f"{path}: cannot be written ({error.strerror}); {remedy}") from error
    return path


def read_page(made: Outputs) -> Page:
    """Return the content of the report of a finished run. Raises BadInput as `write_report`."""
    run, manifest, suite = made.run, made.run.manifest, made.run.suite
    views = int(manifest["views"])
    headline = run.headline
    by = ("method", "condition", "class", "object", "view")
    columns = (*by, "azimuth_deg", "elevation_deg", "outcome", "reason", "notes", *TIMES)
    records = in_order(run.read_images((*columns, column(headline[0]))), manifest, by)
    chosen = extremes(records, headline[0])
    sources = open_sources(run.directory, manifest, _shown(records, chosen))
    styles = method_styles(manifest["methods"])
    of_cost = run.measured(suite.frontier or suite.headline)
    panels = curve_panels(made.tables)
    first = [panel for panel in panels if panel.metric in headline]
    with threadpool_limits(1):
        compared = run.compared(headline)
        answer = in_short(pooled(compared) or compared, headline, views)
        comparisons, verdicts = run.compared(of_cost), verdicts_of(run, of_cost)
        costs = cost_plots(comparisons, of_cost, views, styles, verdicts)
        costed = cost_grid(comparisons, of_cost[0], views, verdicts)
    left_out = _left_out(manifest["methods"])
    if made.curves:
        drawn, title = family_curves(made.curves, styles), "Beyond training"
        remark = f"{_OF_OBJECTS} {_BANDS} {left_out}"
    else:
        others = [panel for panel in panels if panel not in first]
        drawn = curves(others, styles)
        title = "Class by class" if records["class"].nunique() > 1 else "Robustness"
        remark = f"{_OF_TABLES} {left_out}"
    rows = [row for table in made.tables for row in table.rows]
    all_failed = _ALL_FAILED if any(row.failed and not row.n_ok for row in rows) else ""
    ends = (manifest["conditions"][0], manifest["conditions"][-1])
    return Page(
        title=manifest["suite"],
        about=suite.about,
        head=_head(manifest, records, suite.truth),
        quality=headline[0],
        jobs=_jobs(run.directory, records),
        facts=_facts(manifest),
        outcomes=tuple((str(o), int(n)) for o, n in records["outcome"].value_counts().items()),
        shares=tuple(dict(manifest.get("worker_shares", {})).items()),
        choices=_choices(records, bool(manifest.get("skipped_metrics"))),
        answer=(*answer, *(Statement("Not measured", (((), line),)) for line in run.not_measured)),
        headline=compact_table(made.headline.rows),
        first=_group("first", curves(first, styles, "first"), styles, len(first)),
        curves=_group("curve", drawn, styles),
        curves_title=title,
        curves_remark=" ".join(filter(None, [remark.strip(), all_failed])),
        tables=(
            *(
                [replace(table_group(made.condition_sweep), unfolded=True)]
                if made.condition_sweep
                else ()
            ),
            *map(table_group, made.tables),
            *([table_group(made.orderings, folded=False)] if made.orderings else ()),
        ),
        # The first condition and the last are the most different ones.
        costs=_group(
            "cost", sorted(costs, key=lambda plot: plot.tags.condition not in ends), styles
        ),
        cost_table=costed,
        cost_remark=how_timed(manifest),
        grids=grids(records, sources, headline[0]),
        cases=cases(chosen, sources, headline[0]),
        unseen=_unseen(sources),
        failures=failure_groups(records),
        failed_images=int((records["outcome"] != "ok").sum()),
        skipped=tuple(dict(manifest.get("skipped_metrics", {})).items()),
        command=_command(manifest),
        manifest=tuple(json.dumps(manifest, indent=2, ensure_ascii=False).split("\n")),
        meanings=_meanings(manifest, suite, made.tables),
    )


def _group(
    name: str,
    plots: Sequence[Plot],
    styles: Mapping[str, MethodStyle],
    unfolded: int | None = None,
) -> PlotGroup:
    """Return plots with a legend of all methods that have a line or a point.

    unfolded  number of plots that are not folded; None for as many as fill two lines
    """
    if unfolded is None:
        unfolded = OPEN_PLOTS // (2 if any(plot.wide for plot in plots) else 1)
    drawn = [method for method in styles if plots and role(method) != "ceiling"]
    drawn = [m for m in drawn if any(f'data-method="{visible(m)}"' in p.svg.inside for p in plots)]
    return PlotGroup(legend(drawn, styles, f"legend-{name}"), tuple(plots), unfolded)


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


def _head(manifest: Mapping[str, Any], records: pd.DataFrame, truth: Truth) -> tuple[str, ...]:
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
        head.append(_duration(sum(seconds.values())) + on)
    return tuple(head)


def _jobs(directory: Path, records: pd.DataFrame) -> tuple[int, int]:
    """Return the number of jobs of a run, and of those that failed."""
    keys = ["method", "condition", "class", "object"]
    failed = records.loc[records["outcome"] != "ok", keys].drop_duplicates()
    jobs = read_jobs(directory)  # of what sees no cloud one for all conditions, a line for each
    keys = {tuple(job.name): job.key for job in jobs}
    names = map(tuple, failed.astype(str).itertuples(index=False))
    return len(set(keys.values())), len({keys.get(name, name) for name in names})


def _facts(manifest: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    machine = manifest.get("machine", {})
    facts = [
        ("dataset", str(manifest["dataset"])),
        ("finished", str(manifest["finished"]).replace("T", " ").replace("+00:00", " UTC")),
    ]
    if machine:
        facts.append(("machine", f"{machine.get('cpu')}, {machine.get('cores')} cores"))
    version = manifest.get("versions", {}).get("pc2pix-bench")
    if version:
        facts.append(("pc2pix-bench", str(version)))
    return tuple(facts)


def _duration(seconds: float) -> str:
    minutes = seconds / 60
    return f"{seconds:.0f} s" if minutes < 2 else f"{minutes:.0f} min"


def _choices(records: pd.DataFrame, skipped: bool) -> tuple[Choice, ...]:
    """Return the filters with at least two choices."""
    outcomes = list(dict.fromkeys(map(str, records["outcome"]))) + ["skipped"] * skipped
    offered = (
        Choice("method", "Method", tuple(dict.fromkeys(map(str, records["method"])))),
        Choice("condition", "Condition", tuple(dict.fromkeys(map(str, records["condition"])))),
        Choice("class", "Class", tuple(sorted(set(map(str, records["class"]))))),
        Choice("outcome", "Outcome", tuple(dict.fromkeys(outcomes))),
    )
    return tuple(choice for choice in offered if len(choice.options) > 1)


_OF_TABLES = (
    "Each point is a value of the tables, with its 95 % interval over objects. No line joins "
    "different kinds of changes."
)
_ALL_FAILED = "Where a method has no point, all its images failed."
_OF_OBJECTS = (
    "Each point is a mean over objects, failed images scored as blank ones, with its 95 % interval."
)
_BANDS = "A band is what a network was shown in training."


def _left_out(methods: list[str]) -> str:
    ceilings = [method for method in methods if role(method) == "ceiling"]
    if not ceilings:
        return ""
    return f"Left out, because drawn from the mesh behind the cloud: {', '.join(ceilings)}."


def _unseen(sources: Sources) -> tuple[str, ...]:
    description = [sources.unseen] if sources.unseen else []
    if not sources.artifacts:
        description.append(
            f"The images of this run are no longer there (its {STORE} is empty or gone); "
            "its command makes them again."
        )
    return tuple(description)


def _command(manifest: Mapping[str, Any]) -> str:
    """Return the command line that started the run."""
    arguments = [str(argument) for argument in manifest.get("command", [])[1:]]
    return shlex.join(["bench", *arguments]) if arguments else f"bench run {manifest['suite']}"


def _meanings(
    manifest: Mapping[str, Any], suite: Suite, tables: Sequence[Table[QualityRow]]
) -> tuple[tuple[str, tuple[tuple[str, str], ...]], ...]:
    metrics = {
        m.id: "Fréchet distance, lower is better: " * (m.kind == "set") + m.about
        for m in METRICS.values()
    }
    shown = {row.metric for table in tables for row in table.rows}
    requested = manifest.get("request", {}).get("metrics", ())
    further = {
        m: metrics.get(m, "of another package")
        for m in (*requested, *sorted(m for m in shown if declared_metric(m)))
    }
    measured = (
        *suite.image_metrics,
        *suite.detail_metrics,
        *suite.set_metrics,
        *suite.class_metrics,
        *suite.control_metrics,
        *further,
    )
    return (
        ("Metrics", tuple((m, (metrics | further)[m]) for m in dict.fromkeys(measured))),
        ("Methods", tuple((m, _source(m, manifest)) for m in manifest["methods"])),
        ("Conditions", tuple((c, _origin(c)) for c in manifest["conditions"])),
    )


def _origin(condition_id: str) -> str:
    known = known_condition(condition_id)
    return f"{condition_words(condition_id)}; {known.source}" if known else "unknown"


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


def table_group(table: Table[Any], folded: bool = True) -> TableGroup:
    """Return the grids of a table; `folded` folds all but the first that has values."""
    grids = table.grids()
    first = next((i for i, grid in enumerate(grids) if grid.valued), 0)
    return TableGroup(
        table.title,
        _MARKUP.sub(r"\1", table.remark),
        tuple(replace(g, unfolded=not folded or i == first) for i, g in enumerate(grids)),
    )


def failure_groups(records: pd.DataFrame) -> tuple[FailureGroup, ...]:
    """Images that are not there, by reason, the most frequent first.

    Each listed is one method on one cloud, with the views that it lacks.
    """
    failed = records[records["outcome"] != "ok"]
    groups = []
    for (outcome, reason), of_reason in failed.groupby(["outcome", "reason"], sort=True):  # type: ignore[misc]
        items = of_reason.groupby(["method", "condition", "class", "object"], sort=False)
        listed = [
            Failure(
                f"{method}/{condition}/{class_name}/{obj}",
                _views(group["view"].tolist()),
                Tags(str(method), str(condition), str(class_name), (str(outcome),)),
            )
            for (method, condition, class_name, obj), group in items  # type: ignore[misc]
        ]
        count = f"{len(of_reason)} images of {len(listed)} clouds"
        kept = tuple(listed[:MOST_LISTED])
        group = FailureGroup(str(reason), count, kept, len(listed) - len(kept))
        groups.append((-len(of_reason), group))
    return tuple(group for _, group in sorted(groups, key=lambda pair: pair[0]))


def _views(views: Sequence[int]) -> str:
    if len(views) > 1 and list(views) == list(range(views[0], views[0] + len(views))):
        return f"views {views[0]} to {views[-1]}"
    return f"view{'s' * (len(views) > 1)} {', '.join(map(str, views))}"
