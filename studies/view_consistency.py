"""The motion of drawn silhouettes against true ones when the camera turns around the object.

    python -m studies.view_consistency --out DIR [--methods a,b] [--chairs 100] [--threads 1]

Procedural chairs of the test split, 72 views 5 degrees apart at elevation 20, by each method at
`2048`, `512` and `noise-0.05`. The clouds are those of a run with seed 0. Silhouettes are those of
`silhouette-iou` (`bench.metrics.silhouette`); a boundary pixel is one of a silhouette with an open
side, where its neighbour is not of the silhouette, or beyond the frame. Lengths are in pixels, from
pixel centre to pixel centre.

distance  View by view: from each boundary pixel of the drawn silhouette to the nearest of the true
          one, and from each true one to the nearest drawn one. Two pixels at the 95th percentile is
          what is asked for.
flicker   From each view to the next: how much an offset changes. The offset of a true boundary
          pixel is its signed distance from the boundary of the drawn silhouette, positive inside;
          the place that corresponds to it in the next view is the nearest true boundary pixel that
          is open to the same side (left of a slat to left of a slat); the change is that of the
          offset between the two. The same is done for drawn boundary pixels and the true
          silhouette, so that neither what vanishes nor what pops up is missed. A pixel counts once
          for each open side.

A silhouette that is too fat everywhere has a distance and no flicker; one that is wrong in another
way in each view has both. Pinholes have a boundary, too, which may be far from the true one.

Percentiles pool all boundary pixels of all views and objects: the least value that so many percent
do not exceed. Intervals are 95 % percentile bootstraps over objects. Where one silhouette is empty
and the other not, values are infinite. An object that a method fails on is left out of its
percentiles, counted in n_ok/n, and named with the reason.

Written to DIR: `view-consistency.csv` (tidy) and `.md`, and for each condition a chair with a
slatted back: `strip-CONDITION.png`, neighbouring views with what is drawn beyond the true
silhouette in red and what is missing in blue, and `turntable-CONDITION.gif`.

A chair takes about half a minute of processor time, most of it `surface-apss`.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from itertools import count, product
from pathlib import Path
from typing import Any, TypeVar

from bench.catalogue.lookup import find
from bench.catalogue.methods import find_method
from bench.catalogue.suites import Limits
from bench.rendering.cloud import Drawing, Failed, draw_cloud
from bench.rendering.files import write_images
from bench.rendering.sheet import Tile, draw_sheet
from bench.running.isolation import WorkerFailure, run_tasks
from bench.tables.markdown import cell, visible
from bench.tables.table import csv_text
from data_prep.clouds.conditions import CONDITIONS
from data_prep.datasets.registry import ProceduralObject
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole
from data_prep.progress import progress
from data_prep.randomness import generator
from data_prep.scene import PointCloud, UInt8Images, View
from data_prep.shapes.chair.spec import draw_chair_spec
from studies.arguments import names, positive
from studies.silhouette_motion import (
    ASKED_PX,
    STATISTICS,
    WITHIN,
    Tally,
    distances,
    estimates,
    flicker,
    silhouettes,
)
from studies.tables import markdown

CLASS, SPLIT, RUN_SEED = "chair", "test", 0
METHODS = ("splat-net@chair", "pc2pix", "surface-apss", "splat")
SHOWN_CONDITIONS = ("2048", "512", "noise-0.05")
STEP_DEG, ELEVATION_DEG = 5, 20.0
VIEWS = tuple(View((a + 180) % 360 - 180.0, ELEVATION_DEG) for a in range(0, 360, STEP_DEG))
STRIP = slice(6, 12)  # 30 to 55 degrees: slats are seen at a slant
SCALE = 2
LIMITS = Limits(time_s=600.0, memory_gib=4.0)
MEASURES = ("distance", "flicker")
TOO_MUCH, TOO_LITTLE = (225, 60, 50), (50, 110, 235)


@dataclass(frozen=True)
class Turn:
    """The views of a turn around a chair, and the conditions of its cloud."""

    views: tuple[View, ...] = VIEWS
    conditions: tuple[str, ...] = SHOWN_CONDITIONS


TURN = Turn()


@dataclass(frozen=True)
class ChairTask:
    """A method on a chair of the test split, under a condition."""

    method: str
    condition: str
    chair: int
    views: tuple[View, ...] = VIEWS


Measured = dict[str, Tally]  # by measure
Result = TypeVar("Result")
RunTasks = Callable[..., Iterable[tuple[ChairTask, Any]]]  # `bench.running.isolation.run_tasks`
Cell = tuple[str, str]  # method, condition
ResultsByCell = Mapping[Cell, Sequence[Measured | Failed]]  # chairs in their order


@dataclass(frozen=True)
class StatisticRow:
    """One statistic of a method under a condition, in pixels or as a share, with its interval."""

    method: str
    condition: str
    measure: str
    statistic: str
    value: float
    ci_low: float
    ci_high: float
    n_ok: int
    n: int


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print and write."""
    options = argparse.ArgumentParser(description="Do drawn silhouettes move as the true ones do?")
    options.add_argument("--out", type=Path, required=True)
    options.add_argument("--methods", type=names, default=METHODS, help="comma-separated")
    options.add_argument("--chairs", type=positive, default=100)
    options.add_argument("--threads", type=positive, default=1, help="workers of one thread each")
    given = options.parse_args(arguments)
    try:
        for method in given.methods:
            find_method(method)
        print(study(given.out, given.methods, given.chairs, given.threads), end="")
    except BadInput as error:
        sys.exit(f"view_consistency: {error}")


def study(
    out: Path,
    methods: Sequence[str],
    chairs: int,
    workers: int,
    turn: Turn = TURN,
    run: RunTasks = run_tasks,
) -> str:
    """Measure methods on the first chairs, write all files to `out`, and return the Markdown."""
    measured = measure_all(methods, chairs, workers, turn, run)
    rows = [r for cell_, results in measured.items() for r in rows_of(*cell_, results)]
    text = to_markdown(rows) + failures(measured)
    out.mkdir(parents=True, exist_ok=True)
    write_whole(out / "view-consistency.csv", to_csv(rows).encode())
    write_whole(out / "view-consistency.md", text.encode())
    show(out, methods, workers, turn, run)
    return text


# --- one object -----------------------------------------------------------------------------------


def drawing_of(task: ChairTask) -> tuple[PointCloud, Drawing]:
    """Return the cloud and the drawing of a task, with the random numbers of a run."""
    chair = ProceduralObject(CLASS, SPLIT, task.chair)
    identity = (CLASS, chair.object_id)
    perturbation = find(task.condition, CONDITIONS, "condition").perturbation
    cloud = perturbation.apply(
        chair.cloud(generator(RUN_SEED, "cloud", *identity)),
        generator(RUN_SEED, task.condition, *identity),
    )
    rng = generator(RUN_SEED, "method", task.method, task.condition, *identity)
    return cloud, Drawing(task.method, task.views, "cpu", rng=rng)


def draw(task: ChairTask) -> UInt8Images | Failed:
    """Return the method's images of all views."""
    return draw_cloud(*drawing_of(task))


def measure(task: ChairTask) -> Measured | Failed:
    """Return both measures of a method on one chair."""
    images = draw(task)
    if isinstance(images, Failed):
        return images
    truth = ProceduralObject(CLASS, SPLIT, task.chair).truth(task.views)
    true, seen = silhouettes(truth, images)
    return {
        "distance": Tally.of(distances(true, seen)),
        "flicker": Tally.of(flicker(true, seen)),
    }


# --- all objects ----------------------------------------------------------------------------------


def run_all(
    title: str,
    tasks: Sequence[ChairTask],
    work: Callable[[ChairTask], Result | Failed],
    workers: int,
    run: RunTasks,
) -> dict[ChairTask, Result | Failed]:
    """Return the results of all tasks, with progress.

    Raises BadInput for bad weights.
    """
    done: dict[ChairTask, Result | Failed] = {}
    with progress(title, len(tasks)) as advance:
        for task, result in run(tasks, work, workers, LIMITS):
            done[task] = Failed(result.reason) if isinstance(result, WorkerFailure) else result
            advance(sum(isinstance(outcome, Failed) for outcome in done.values()))
    return done


def measure_all(
    methods: Sequence[str], chairs: int, workers: int, turn: Turn, run: RunTasks
) -> ResultsByCell:
    """Return every method under every condition on the first chairs.

    Raises BadInput for bad weights.
    """
    cells = list(product(methods, turn.conditions))
    # Chair by chair, so that the progress shows how long all of it takes.
    tasks = [ChairTask(*cell_, chair, turn.views) for chair in range(chairs) for cell_ in cells]
    done = run_all("measuring", tasks, measure, workers, run)
    return {
        cell_: [done[ChairTask(*cell_, chair, turn.views)] for chair in range(chairs)]
        for cell_ in cells
    }


def rows_of(
    method: str, condition: str, results: Sequence[Measured | Failed]
) -> list[StatisticRow]:
    """Return all statistics of one method under one condition.

    The list is empty where it failed on all objects.
    """
    ok = [result for result in results if not isinstance(result, Failed)]
    rows = []
    for measure_ in MEASURES if ok else ():
        estimated = estimates([of_object[measure_] for of_object in ok]).T.tolist()
        for statistic, (value, low, high) in zip(STATISTICS, estimated, strict=True):
            rows.append(
                StatisticRow(
                    method, condition, measure_, statistic, value, low, high, len(ok), len(results)
                )
            )
    return rows


# --- what is written ------------------------------------------------------------------------------


def to_csv(rows: Iterable[StatisticRow]) -> str:
    """Return all rows, tidy; six digits; nothing where there is no interval."""

    def text(value: object) -> object:
        if not isinstance(value, float):
            return value
        return "" if math.isnan(value) else f"{value:.6g}"

    return csv_text(
        [field.name for field in fields(StatisticRow)], (map(text, astuple(row)) for row in rows)
    )


def to_markdown(rows: Sequence[StatisticRow]) -> str:
    """Return a table for each measure: a line for each method and condition."""
    heads = ["median", "95th percentile", "99th percentile", f"within {ASKED_PX:g} px"]
    parts = []
    for measure_ in MEASURES:
        lines = []
        of_measure = [r for r in rows if r.measure == measure_]
        for method, condition in dict.fromkeys((r.method, r.condition) for r in of_measure):
            of_cell = {
                r.statistic: r for r in of_measure if (r.method, r.condition) == (method, condition)
            }
            (n_ok, n), *_ = [(r.n_ok, r.n) for r in of_cell.values()]
            values = [_with_interval(of_cell[statistic]) for statistic in STATISTICS]
            lines.append([cell(method), cell(condition), *values, f"{n_ok}/{n}"])
        table = markdown(["method", "condition", *heads, "n_ok/n"], lines, left=2)
        parts.append(f"**{measure_.capitalize()}**, px [95 % interval over objects]\n\n{table}")
    return "\n".join(parts)


def _with_interval(row: StatisticRow) -> str:
    form = "{:.1%}" if row.statistic == WITHIN else "{:.2f}"
    value, low, high = (form.format(v) for v in (row.value, row.ci_low, row.ci_high))
    return value if math.isnan(row.ci_low) else f"{value} [{low}, {high}]"


def failures(results_by_cell: ResultsByCell) -> str:
    """Return a line for each failure; nothing where there is none."""
    return "".join(
        f"- {cell(method)}, {cell(condition)}, {SPLIT}-{chair:04d}: {cell(result.reason)}\n"
        for (method, condition), results in results_by_cell.items()
        for chair, result in enumerate(results)
        if isinstance(result, Failed)
    )


def show(folder: Path, methods: Sequence[str], workers: int, turn: Turn, run: RunTasks) -> None:
    """Draw a strip and a turntable of a chair with slats, for each condition."""
    chair = slatted_chair()
    tasks = [ChairTask(*cell_, chair, turn.views) for cell_ in product(methods, turn.conditions)]
    drawn = run_all("drawing", tasks, draw, workers, run)
    truth = ProceduralObject(CLASS, SPLIT, chair).truth(turn.views)
    for condition in turn.conditions:
        rows: dict[str, UInt8Images | Failed] = {"truth": truth}
        rows |= {m: drawn[ChairTask(m, condition, chair, turn.views)] for m in methods}
        strip = [t for label, row in rows.items() for t in strip_row(label, turn.views, truth, row)]
        columns = len(turn.views[STRIP])
        write_images(draw_sheet(strip, columns, SCALE), folder / f"strip-{condition}.png")
        tiles = [
            Tile(visible(label), visible(row.reason) if isinstance(row, Failed) else row)
            for label, row in rows.items()
        ]
        film = draw_sheet(tiles, len(tiles), SCALE)
        write_images(film, folder / f"turntable-{condition}.gif")


def slatted_chair() -> int:
    """Return the number of the first chair of the test split with a slatted back."""
    chairs = (ProceduralObject(CLASS, SPLIT, i) for i in count())
    return next(
        chair.index
        for chair in chairs
        if draw_chair_spec(generator("procedural", CLASS, SPLIT, chair.index)).back == "slatted"
    )


def strip_row(
    label: str, views: Sequence[View], truth: UInt8Images, images: UInt8Images | Failed
) -> list[Tile]:
    """Return neighbouring views: the first tile has the label, the others their azimuth."""
    labels = [visible(label), *(f"{view.azimuth_deg:g}°" for view in views[STRIP][1:])]
    if isinstance(images, Failed):
        return [Tile(text, visible(images.reason)) for text in labels]
    tinted = tint(truth[STRIP], images[STRIP])
    return [Tile(text, tinted[i : i + 1]) for i, text in enumerate(labels)]


def tint(truth: UInt8Images, images: UInt8Images) -> UInt8Images:
    """Return the images, red where more is drawn than the true silhouette, blue where less."""
    true, seen = silhouettes(truth, images)
    tinted = images.copy()
    tinted[seen & ~true] = TOO_MUCH
    tinted[true & ~seen] = TOO_LITTLE
    return tinted


if __name__ == "__main__":
    main()
