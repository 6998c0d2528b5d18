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

from bench.analysis.scored import in_order
from bench.catalogue.methods import find_method, role
from bench.catalogue.metrics import (
    CONTROL_METRICS,
    IMAGE_METRICS,
    KERNEL_METRICS,
    RECOGNITION_METRICS,
    SET_METRICS,
)
from bench.catalogue.suites import Suite
from bench.records.artifacts import JobName
from bench.report.families import family_curves
from bench.report.images import cases, extremes, grids, shown_objects
from bench.report.page import Choice, Failure, FailureGroup, Page, TableGroup, html
from bench.report.pareto import cost_plots
from bench.report.robustness import curves
from bench.report.stored import Sources, open_sources
from bench.report.styles import method_styles
from bench.tables.build import Outputs, how_timed
from bench.tables.frontier import cost_grid
from bench.tables.grid import Tags
from bench.tables.table import Table
from data_prep.clouds.conditions import CONDITIONS
from data_prep.failures import BadInput, CannotWrite
from data_prep.files.atomic_write import write_whole

REPORT = "report.html"
MOST_LISTED = 200  # failures listed for one reason
_MARKUP = re.compile(r"`|\*\*|\\(.)")  # what remarks have, and escapes
QUALITY = "ssim"  # what cost is compared with where a suite names no metric


def write_report(made: Outputs, out: Path | None = None) -> Path:
    """Write the report of a finished run to `out` (default: report.html in its folder).

    The same run gives the same bytes. Images that are no longer there, and clouds that cannot be
    made again, are named as missing. Raises BadInput where the list of jobs cannot be read, and
    CannotWrite where `out` cannot be written.
    """
    path = out or made.run.directory / REPORT
    text = html(read_page(made))
    try:
        write_whole(path, text.encode())
    except OSError as error:
        raise CannotWrite(
            f"{path}: cannot be written ({error.strerror}); give another --out"
        ) from error
    return path


def read_page(made: Outputs) -> Page:
    """Return the content of the report of a finished run. Raises BadInput as `write_report`."""
    run, manifest, suite = made.run, made.run.manifest, made.run.suite
    by = ("method", "condition", "class", "object", "view")
    records = in_order(run.records, manifest, by)
    views = int(manifest["views"])
    chosen = extremes(records)
    sources = open_sources(run.directory, manifest, _shown(records, chosen))
    styles = method_styles(manifest["methods"])
    metrics = run.measured(suite.frontier or (QUALITY,))
    with threadpool_limits(1):
        comparisons = run.compared(metrics)
        costs = cost_plots(comparisons, metrics, views, styles)
        costed = cost_grid(comparisons, metrics[0], views)
    failures = failure_groups(records)
    left_out = _left_out(manifest["methods"])
    if made.curves:
        drawn, title = family_curves(made.curves, styles), "Beyond training"
        remark = f"{_OF_OBJECTS} {_BANDS} {left_out}"
    else:
        drawn = curves(made.tables, styles)
        title = "Class by class" if records["class"].nunique() > 1 else "Robustness"
        rows = [row for table in made.tables for row in table.rows]
        all_failed = _ALL_FAILED if any(row.failed and not row.n_ok for row in rows) else ""
        remark = " ".join(filter(None, [_OF_TABLES, all_failed, left_out]))
    return Page(
        title=manifest["suite"],
        about=suite.about,
        facts=_facts(manifest, records),
        outcomes=tuple((str(o), int(n)) for o, n in records["outcome"].value_counts().items()),
        shares=tuple(dict(manifest.get("worker_shares", {})).items()),
        choices=_choices(records, bool(manifest.get("skipped_metrics"))),
        curves=drawn,
        curves_title=title,
        curves_remark=remark.strip(),
        tables=(
            *([table_group(made.condition_sweep)] if made.condition_sweep else ()),
            *map(table_group, made.tables),
            *([table_group(made.orderings, folded=False)] if made.orderings else ()),
        ),
        costs=costs,
        cost_table=costed,
        cost_remark=how_timed(manifest),
        grids=grids(records, sources),
        cases=cases(chosen, sources),
        unseen=_unseen(sources),
        failures=failures,
        failed_images=int((records["outcome"] != "ok").sum()),
        skipped=tuple(dict(manifest.get("skipped_metrics", {})).items()),
        command=_command(manifest),
        manifest=tuple(json.dumps(manifest, indent=2, ensure_ascii=False).split("\n")),
        meanings=_meanings(manifest, suite),
    )


def _shown(records: pd.DataFrame, chosen: pd.DataFrame) -> list[JobName]:
    """Return the jobs whose clouds are shown."""
    conditions = list(dict.fromkeys(map(str, records["condition"])))
    of_grids = [JobName("", c, *obj) for obj in shown_objects(records) for c in conditions]
    names = (chosen[name].tolist() for name in ("condition", "class", "object"))
    return of_grids + [JobName("", *map(str, of_case)) for of_case in zip(*names, strict=True)]


def _facts(manifest: Mapping[str, Any], records: pd.DataFrame) -> tuple[tuple[str, str], ...]:
    objects = len(records[["class", "object"]].drop_duplicates())
    classes = list(dict.fromkeys(map(str, records["class"])))
    of_classes = f" of {len(classes)} classes" if len(classes) > 1 else f" of class {classes[0]}"
    seconds: Mapping[str, float] = manifest.get("stage_seconds", {})
    machine = manifest.get("machine", {})
    facts = [
        ("dataset", str(manifest["dataset"])),
        ("objects", f"{objects}{of_classes} × {manifest['views']} views"),
        ("methods", str(len(manifest["methods"]))),
        ("conditions", str(len(manifest["conditions"]))),
        ("finished", str(manifest["finished"]).replace("T", " ").replace("+00:00", " UTC")),
    ]
    if seconds:
        facts.append(("took", _duration(sum(seconds.values()))))
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


_OF_TABLES = "Each point is a value of the tables, with its 95 % interval over objects."
_ALL_FAILED = "Where a method has no point, all its images failed."
_OF_OBJECTS = (
    "Each point is a mean over objects, failed pictures scored as blank ones, with its 95 % "
    "interval."
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
            "The pictures of this run are no longer there (its folder artifacts is empty or gone); "
            "its command makes them again."
        )
    return tuple(description)


def _command(manifest: Mapping[str, Any]) -> str:
    """Return the command line that started the run."""
    arguments = [str(argument) for argument in manifest.get("command", [])[1:]]
    return shlex.join(["bench", *arguments]) if arguments else f"bench run {manifest['suite']}"


def _meanings(
    manifest: Mapping[str, Any], suite: Suite
) -> tuple[tuple[str, tuple[tuple[str, str], ...]], ...]:
    known = {c.id: c.source for c in CONDITIONS}
    distances = {m.id: f"Fréchet distance, lower is better: {m.about}" for m in SET_METRICS}
    kernel = {metric: about for metric, (_, about) in KERNEL_METRICS.items()}
    metrics = IMAGE_METRICS | distances | kernel | RECOGNITION_METRICS | CONTROL_METRICS
    measured = (
        *suite.image_metrics,
        *suite.detail_metrics,
        *suite.set_metrics,
        *suite.class_metrics,
        *suite.control_metrics,
    )
    return (
        ("Metrics", tuple((m, metrics[m]) for m in dict.fromkeys(measured))),
        ("Methods", tuple((m, _source(m)) for m in manifest["methods"])),
        ("Conditions", tuple((c, known.get(c, "unknown")) for c in manifest["conditions"])),
    )


def _source(method: str) -> str:
    try:
        return find_method(method).source
    except BadInput as error:
        return f"no longer there: {error}"


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
        count = f"{len(of_reason)} pictures of {len(listed)} clouds"
        kept = tuple(listed[:MOST_LISTED])
        group = FailureGroup(str(reason), count, kept, len(listed) - len(kept))
        groups.append((-len(of_reason), group))
    return tuple(group for _, group in sorted(groups, key=lambda pair: pair[0]))


def _views(views: Sequence[int]) -> str:
    if len(views) > 1 and list(views) == list(range(views[0], views[0] + len(views))):
        return f"views {views[0]} to {views[-1]}"
    return f"view{'s' * (len(views) > 1)} {', '.join(map(str, views))}"
