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
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bench.analysis.intervals import RESAMPLES, SEED
from bench.catalogue.lookup import find
from bench.catalogue.methods import find_method
from bench.catalogue.suites import Limits
from bench.metrics.silhouette import Masks, Pairs
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
from data_prep.scene import UInt8Images, View
from data_prep.shapes.chair.spec import draw_chair_spec
from studies.arguments import names, positive
from studies.tables import markdown

CLASS, SPLIT, RUN_SEED = "chair", "test", 0
METHODS = ("splat-net", "pc2pix", "surface-apss", "splat")
SHOWN_CONDITIONS = ("2048", "512", "noise-0.05")
STEP_DEG, ELEVATION_DEG = 5, 20.0
VIEWS = tuple(View((a + 180) % 360 - 180.0, ELEVATION_DEG) for a in range(0, 360, STEP_DEG))
STRIP = slice(6, 12)  # 30 to 55 degrees: slats are seen at a slant
SCALE = 2
LIMITS = Limits(time_s=600.0, memory_gib=4.0)
ASKED_PX = 2.0
PERCENTILES = (50, 95, 99)
WITHIN = f"within-{ASKED_PX:g}px"
STATISTICS = (*(f"p{q}" for q in PERCENTILES), WITHIN)
MEASURES = ("distance", "flicker")
TOO_MUCH, TOO_LITTLE = (225, 60, 50), (50, 110, 235)


@dataclass(frozen=True)
class ChairTask:
    """A method on a chair of the test split, under a condition."""

    method: str
    condition: str
    chair: int


@dataclass(frozen=True, eq=False)
class Tally:
    """The values [D] of one object's boundary pixels, rising, and how often each occurs [D].

    Values are kept to a thousandth of a pixel: they are few then, whatever the number of views.
    """

    values: NDArray[np.float64]
    counts: NDArray[np.int64]

    @staticmethod
    def of(values: NDArray[np.float64]) -> Tally:
        """Return the tally of values in any order."""
        return Tally(*np.unique(np.round(values, 3), return_counts=True))


Measured = dict[str, Tally]  # by measure


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


def main() -> None:
    """Measure, print and write."""
    options = argparse.ArgumentParser(description="Do drawn silhouettes move as the true ones do?")
    options.add_argument("--out", type=Path, required=True)
    options.add_argument("--methods", type=names, default=METHODS, help="comma-separated")
    options.add_argument("--chairs", type=positive, default=100)
    options.add_argument("--threads", type=positive, default=1, help="workers of one thread each")
    given = options.parse_args()
    try:
        for method in given.methods:
            find_method(method)
        measured = measure_all(given.methods, given.chairs, given.threads)
        rows = [r for cell_, results in measured.items() for r in rows_of(*cell_, results)]
        text = to_markdown(rows) + failures(measured)
        print(text, end="")
        given.out.mkdir(parents=True, exist_ok=True)
        write_whole(given.out / "view-consistency.csv", to_csv(rows).encode())
        write_whole(given.out / "view-consistency.md", text.encode())
        show(given.out, given.methods, given.threads)
    except BadInput as error:
        sys.exit(f"view_consistency: {error}")


# --- one object -----------------------------------------------------------------------------------


def draw(task: ChairTask) -> UInt8Images | Failed:
    """Return the method's images of all views."""
    chair = ProceduralObject(CLASS, SPLIT, task.chair)
    identity = (CLASS, chair.object_id)
    perturbation = find(task.condition, CONDITIONS, "condition").perturbation
    cloud = perturbation.apply(
        chair.cloud(generator(RUN_SEED, "cloud", *identity)),
        generator(RUN_SEED, task.condition, *identity),
    )
    rng = generator(RUN_SEED, "method", task.method, task.condition, *identity)
    return draw_cloud(cloud, Drawing(task.method, VIEWS, "cpu", rng=rng))


def measure(task: ChairTask) -> Measured | Failed:
    """Return both measures of a method on one chair."""
    images = draw(task)
    if isinstance(images, Failed):
        return images
    truth = ProceduralObject(CLASS, SPLIT, task.chair).truth(VIEWS)
    true, seen = silhouettes(truth, images)
    return {
        "distance": Tally.of(distances(true, seen)),
        "flicker": Tally.of(flicker(true, seen)),
    }


def silhouettes(truth: UInt8Images, images: UInt8Images) -> tuple[Masks, Masks]:
    """Return the silhouettes of true images and of images of the same objects, [N, H, W] each."""
    pairs = Pairs(truth, images)
    return pairs.shown, pairs.drawn(pairs.shown)


# --- silhouettes to pixels ------------------------------------------------------------------------


def open_sides(masks: Masks) -> NDArray[np.bool_]:
    """Return the pixels of masks with a neighbour outside above, below, left, right.

    Masks are [N, H, W], the result is [4, N, H, W].

    Beyond the frame is outside.
    """
    padded = np.pad(masks, ((0, 0), (1, 1), (1, 1)))
    middle = slice(1, -1)
    neighbours = (
        padded[:, :-2, middle],
        padded[:, 2:, middle],
        padded[:, middle, :-2],
        padded[:, middle, 2:],
    )
    return np.stack([masks & ~neighbour for neighbour in neighbours])


def boundary(masks: Masks) -> Masks:
    """Return the pixels of masks [N, H, W] with an open side."""
    return np.logical_or.reduce(open_sides(masks))


def offsets(masks: Masks) -> NDArray[np.float64]:
    """Return every pixel's signed distance from its mask's boundary, [N, H, W], positive inside.

    The boundary's own pixels have 0, those beside them outside -1. -inf for an empty mask.
    """
    from scipy.ndimage import distance_transform_edt

    signed = np.full(masks.shape, -np.inf)
    for field, mask, around in zip(signed, masks, boundary(masks), strict=True):
        if mask.any():
            field[:] = np.where(mask, 1.0, -1.0) * distance_transform_edt(~around)
    return signed


def distances(true: Masks, seen: Masks) -> NDArray[np.float64]:
    """Return each boundary pixel's distance to the other silhouette's boundary, views pooled.

    The views are [N, H, W].

    From drawn to true and from true to drawn. Infinite where the other silhouette is empty; no
    values where both are.
    """
    there_and_back = ((true, seen), (seen, true))
    return np.concatenate(
        [np.abs(offsets(other)[boundary(subject)]) for subject, other in there_and_back]
    )


def flicker(true: Masks, seen: Masks) -> NDArray[np.float64]:
    """Return the change of the offset at each boundary pixel from a view to the next, pooled.

    The views are a full turn: the first follows on the last. Infinite where one of the four
    silhouettes compared is empty; see the head of this file.
    """
    changes = [np.empty(0)]
    for subject, other in ((true, seen), (seen, true)):
        offset = offsets(other)
        for side in open_sides(subject):
            for i in range(len(subject)):
                after = (i + 1) % len(subject)
                changes.append(change(side[i], side[after], offset[i], offset[after]))
    return np.concatenate(changes)


def change(
    here: NDArray[np.bool_],
    there: NDArray[np.bool_],
    before: NDArray[np.float64],
    after: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return how much `before` [H, W] differs from `after` at the nearest pixel of `there`.

    It has one value for each pixel of `here`.

    Infinite where there is no pixel, and where one of the two is not finite.
    """
    from scipy.ndimage import distance_transform_edt

    if not here.any() or not there.any():
        return np.full(np.count_nonzero(here), np.inf)
    nearest = distance_transform_edt(~there, return_distances=False, return_indices=True)
    assert isinstance(nearest, np.ndarray)
    rows, columns = nearest[:, here]
    with np.errstate(invalid="ignore"):  # both infinite
        changed = np.abs(before[here] - after[rows, columns])
    return np.where(np.isnan(changed), np.inf, changed)


# --- all objects ----------------------------------------------------------------------------------

Result = TypeVar("Result")
Cell = tuple[str, str]  # method, condition
Found = Mapping[Cell, Sequence[Measured | Failed]]  # chairs in their order


def run_all(
    title: str,
    tasks: Sequence[ChairTask],
    work: Callable[[ChairTask], Result | Failed],
    workers: int,
) -> dict[ChairTask, Result | Failed]:
    """Return the results of all tasks, with progress.

    Raises BadInput for bad weights.
    """
    done: dict[ChairTask, Result | Failed] = {}
    with progress(title, len(tasks)) as advance:
        for task, result in run_tasks(tasks, work, workers, LIMITS):
            done[task] = Failed(result.reason) if isinstance(result, WorkerFailure) else result
            advance(sum(isinstance(outcome, Failed) for outcome in done.values()))
    return done


def measure_all(methods: Sequence[str], chairs: int, workers: int) -> Found:
    """Return every method under every condition on the first chairs.

    Raises BadInput for bad weights.
    """
    cells = list(product(methods, SHOWN_CONDITIONS))
    # Chair by chair, so that the progress shows how long all of it takes.
    tasks = [ChairTask(*cell_, chair) for chair in range(chairs) for cell_ in cells]
    done = run_all("measuring", tasks, measure, workers)
    return {cell_: [done[ChairTask(*cell_, chair)] for chair in range(chairs)] for cell_ in cells}


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


def estimates(tallies: Sequence[Tally]) -> NDArray[np.float64]:
    """Return value, low and high end of the interval [3] of each of STATISTICS: [3, S].

    The ends are NaN for fewer than 2 objects. Resamples depend on the number of objects alone.
    """
    values, member = np.unique(
        np.concatenate([tally.values for tally in tallies]), return_inverse=True
    )
    counts = np.zeros((len(tallies), len(values)), np.int64)
    which = np.repeat(np.arange(len(tallies)), [len(tally.values) for tally in tallies])
    counts[which, member] = np.concatenate([tally.counts for tally in tallies])
    point = statistics(values, counts.sum(axis=0))
    if len(tallies) < 2:
        return np.stack([point, np.full_like(point, np.nan), np.full_like(point, np.nan)])
    rng = np.random.default_rng(SEED)
    # How often each object is drawn in a resample.
    times = rng.multinomial(len(tallies), np.full(len(tallies), 1 / len(tallies)), RESAMPLES)
    resampled = np.stack([statistics(values, sample_counts @ counts) for sample_counts in times])
    # A value that was attained, not one between two: they may be infinite.
    ends = np.percentile(resampled, [2.5, 97.5], axis=0, method="inverted_cdf")
    return np.concatenate([point[None], ends])


def statistics(values: NDArray[np.float64], counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return STATISTICS of values [D], rising, that occur so often [D]; NaN of none."""
    until = counts.cumsum()
    if not until[-1:].any():
        return np.full(len(STATISTICS), np.nan)
    places = np.searchsorted(100 * until, np.array(PERCENTILES) * until[-1])
    return np.append(values[places], counts[values <= ASKED_PX].sum() / until[-1])


# --- what is written ------------------------------------------------------------------------------


def to_csv(rows: Iterable[StatisticRow]) -> str:
    """Return all rows, tidy; six digits; nothing where there is no interval."""
    return csv_text(
        [field.name for field in fields(StatisticRow)],
        ([_number(v) if isinstance(v, float) else v for v in astuple(r)] for r in rows),
    )


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.6g}"


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


def failures(found: Found) -> str:
    """Return a line for each failure; nothing where there is none."""
    return "".join(
        f"- {cell(method)}, {cell(condition)}, {SPLIT}-{chair:04d}: {cell(result.reason)}\n"
        for (method, condition), results in found.items()
        for chair, result in enumerate(results)
        if isinstance(result, Failed)
    )


def show(folder: Path, methods: Sequence[str], workers: int) -> None:
    """Draw a strip and a turntable of a chair with slats, for each condition."""
    chair = slatted_chair()
    tasks = [ChairTask(*cell_, chair) for cell_ in product(methods, SHOWN_CONDITIONS)]
    drawn = run_all("drawing", tasks, draw, workers)
    truth = ProceduralObject(CLASS, SPLIT, chair).truth(VIEWS)
    for condition in SHOWN_CONDITIONS:
        images = {method: drawn[ChairTask(method, condition, chair)] for method in methods}
        strip = [
            *strip_row("truth", truth, truth),
            *(
                t
                for method, method_images in images.items()
                for t in strip_row(method, truth, method_images)
            ),
        ]
        columns = len(VIEWS[STRIP])
        write_images(draw_sheet(strip, columns, SCALE), folder / f"strip-{condition}.png")
        tiles = [
            Tile(
                visible(label),
                visible(method_images.reason)
                if isinstance(method_images, Failed)
                else method_images,
            )
            for label, method_images in {"truth": truth, **images}.items()
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


def strip_row(label: str, truth: UInt8Images, images: UInt8Images | Failed) -> list[Tile]:
    """Return neighbouring views: the first tile has the label, the others their azimuth."""
    labels = [visible(label), *(f"{view.azimuth_deg:g}°" for view in VIEWS[STRIP][1:])]
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
