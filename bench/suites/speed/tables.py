"""The tables and the figure of the suite `speed`, as pure functions of its measurements."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from bench.catalogue.methods import find_method
from bench.report.plots import SweepPanel, grouped, sweep_figure
from bench.report.styles import method_styles
from bench.suites.speed.measure import Measurement, SpeedSuite, TimingSample
from bench.tables import markdown
from bench.tables.grid import BOLD, ITALIC, Block, Cell, Grid, grid, ordered
from bench.tables.table import Table
from data_prep.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_PAPER_CLASS = "all"  # stands for the 13 classes of the paper, which gives one number for all
# The values that the paper has printed, by class, metric, condition and method.
Paper = Mapping[tuple[str, str, str, str], float]
_SETTING = ["condition", "threads"]  # the columns by which measurements stand in one grid
WHERE = ["method", *_SETTING]  # the columns that identify a measurement


MS = 1000.0  # milliseconds of a second
_UNITS = ("ms", "core-ms")  # milliseconds by the clock, and of processor time

# For each metric its value, and the number of samples behind it.
Statistics = dict[str, tuple[float, int]]


def summarise(measurement: Measurement) -> Statistics:
    """Return medians over clouds and rounds, in milliseconds and MiB; NaN without a sample.

    prepare, draw-1, draw-V     a cloud prepared, and a view's share of a call that draws 1 or V;
                                by the clock, and of processor time (core). The first calls in a
                                process, of round 0, do not count
    picture-of-1, picture-of-V  an image where 1 or V are drawn of a cloud, prepared for them: sums
                                of the medians above
    further-view-core           what each view more in a call costs, up to V
    peak-mib, idle-mib          most memory of the process, and before the method's load
    """
    samples = pd.DataFrame(
        map(vars, measurement.samples), columns=[*TimingSample.__dataclass_fields__]
    )
    batch, values = measurement.views, Statistics()
    timed = {"prepare": ("prepare", 0), "draw-1": ("draw", 1), f"draw-{batch}": ("draw", batch)}
    for name, (stage, views) in timed.items():
        of_stage = (samples["stage"] == stage) & (samples["views"] == views)
        warm = samples[of_stage & (samples["round"] > 0)]
        share = MS / max(views, 1)
        values[f"{name}-ms"] = _median(share * warm["wall_s"])
        values[f"{name}-core-ms"] = _median(share * warm["core_s"])
    for views in (1, batch):
        n = values[f"draw-{views}-ms"][1]
        for unit in _UNITS:
            (cost,) = costs(values, unit, batch, [views])
            values[f"picture-of-{views}-{unit}"] = float(cost), n if math.isfinite(cost) else 0
    further = _further_view(values, "core-ms", batch)
    n = values[f"draw-{batch}-ms"][1] if math.isfinite(further) else 0
    values["further-view-core-ms"] = further, n
    for name, mib in (("peak-mib", measurement.peak_mib), ("idle-mib", measurement.idle_mib)):
        values[name] = (math.nan, 0) if mib is None else (mib, 1)
    return values


def costs(values: Statistics, unit: str, batch: int, views: ArrayLike) -> Floats:
    """Return the cost of an image where `views` [K] of a cloud are drawn; NaN where unknown.

    A cloud is prepared once and drawn any number of times. Drawing was timed in calls of one view
    and of a batch; between them the cost of a call is taken to grow evenly, and more views than a
    batch are drawn in batches. The costs of one view and of whole batches are as measured:

        total(V) = prepare + one + (V - 1) (all - one) / (batch - 1)    1 <= V <= batch
        total(V) = prepare + V all / batch                              V >= batch
    """
    prepare, single, share = _parts(values, unit, batch)
    count = np.asarray(views, float)
    within = single + (count - 1) * _further_view(values, unit, batch)
    return (prepare + np.where(count < batch, within, count * share)) / count


def _further_view(values: Statistics, unit: str, batch: int) -> float:
    """Return the cost of each view more in a call, up to a batch; NaN where unknown."""
    prepare, single, share = _parts(values, unit, batch)
    further = single if batch == 1 else (share * batch - single) / (batch - 1)
    return further + 0 * prepare  # unknown, too, where no cloud was prepared


def _parts(values: Statistics, unit: str, batch: int) -> list[float]:
    return [values[f"{name}-{unit}"][0] for name in ("prepare", "draw-1", f"draw-{batch}")]


def _median(samples: pd.Series) -> tuple[float, int]:
    count = len(samples)
    return float(np.median(samples)) if count else math.nan, count


def samples_table(measurements: Iterable[Measurement]) -> Table:
    """Return the table of all timed calls behind the other tables, a row for each, for scripts."""
    rows = []
    for measurement in measurements:
        where = {name: getattr(measurement, name) for name in WHERE}
        rows += [where | vars(sample) for sample in measurement.samples]
    return Table("speed_samples", "", pd.DataFrame(rows), digits=".6g")


def speed_rows(
    measurements: Sequence[Measurement],
    suite: SpeedSuite,
    machine: Mapping[str, Any],
    paper: Paper,
) -> pd.DataFrame:
    """Return a row for each statistic, with the value that the paper has printed for it.

    The paper's values are from an NVIDIA GTX 1060, and stand beside the cost of an image when a
    batch is drawn. Where a method and the first baseline both have a cost, the last statistics tell
    how many times cheaper an image is than with that baseline.
    """
    by_where = {(m.method, m.condition, m.threads): summarise(m) for m in measurements}
    rows = []
    for m in measurements:
        values = dict(by_where[m.method, m.condition, m.threads])
        rival = by_where.get((suite.baselines[0], m.condition, m.threads), {})
        for views in dict.fromkeys((1, m.views)):
            (value, n), (other, _) = (
                v.get(f"picture-of-{views}-ms", (math.nan, 0)) for v in (values, rival)
            )
            if math.isfinite(other / value):
                values[f"picture-of-{views}-speedup"] = other / value, n
        for metric, (value, n) in values.items():
            published = metric.replace(f"picture-of-{m.views}-", "picture-")
            key = (_PAPER_CLASS, published, m.condition, m.method)
            rows.append(
                {
                    "suite": suite.id,
                    **{name: getattr(m, name) for name in WHERE},
                    "metric": metric,
                    "value": value,
                    "n": n,
                    "n_ok": m.clouds - len({failure.cloud for failure in m.failures}),
                    "clouds": m.clouds,
                    "reason": "; ".join(dict.fromkeys(f.reason for f in m.failures)),
                    "paper": paper.get(key, math.nan),
                    "elsewhere_cores": m.elsewhere_cores,
                    "device": m.device,
                    "cpu": machine["cpu"],
                    "cores": machine["cores"],
                }
            )
    return pd.DataFrame(rows)


def speed_table(
    measurements: Sequence[Measurement],
    suite: SpeedSuite,
    machine: Mapping[str, Any],
    paper: Paper,
) -> Table:
    """Return the table of all statistics.

    Readers see a grid for each condition that compares costs with the claim of the paper, and then
    a grid of all times for each condition and number of threads.

    machine  the model of the processor (`cpu`), and how many `cores` could be used
    """
    rows, batch = speed_rows(measurements, suite, machine, paper), measurements[0].views
    noisy = {
        (m.method, m.condition, m.threads)
        for m in measurements
        if (m.elsewhere_cores or 0.0) > suite.quiet_cores
    }
    value = rows.set_index([*WHERE, "metric"])["value"]

    def layout(_: pd.DataFrame) -> Iterator[Block]:
        devices = ", ".join(ordered(rows["device"]))
        yield (
            f"On {markdown.cell(machine['cpu'])}, {machine['cores']} cores; device "
            f"{markdown.cell(devices)}. Each method alone in a fresh process, its libraries on the "
            f"threads named. Medians over clouds (here {measurements[0].clouds}) and rounds "
            f"(at least {suite.least_rounds}, after {suite.warm_ups} not counted). 2x: an image "
            f"costs half of what it does with {markdown.cell(suite.baselines[0])}."
        )
        yield "## The claim"
        if paper:
            yield (
                "The paper gives one number for each approach, on an NVIDIA GTX 1060, and does not "
                "say how many images a reconstruction was shared by. pc2pix@paper has the paper's "
                "width, four times that of the bundled pc2pix, and an untrained generator: the "
                "time does not depend on the weights."
            )
        for condition in ordered(rows["condition"]):
            yield f"An image at {markdown.cell(condition)}, its cloud's preparation included, ms:"
            yield _claim(value, condition, batch, suite, noisy, paper)
        for (condition, threads), chosen in rows.groupby(_SETTING, sort=False):
            yield f"## {markdown.cell(str(condition))}, {_threads(threads)}"
            yield from _times_of(chosen, batch, noisy)
        if noisy:
            yield (
                f"\\* Something else kept more than {suite.quiet_cores:g} of the cores busy "
                "meanwhile; take these times again on a quiet machine."
            )
        yield "\n".join(
            f"* {markdown.cell(m.method)}, {markdown.cell(m.condition)}, {_threads(m.threads)}, "
            f"{markdown.cell(failure.cloud)}: failed, {markdown.cell(failure.reason)}"
            for m in measurements
            for failure in m.failures
        )

    return Table("speed", "Speed: what an image costs", rows, layout, digits=".6g")


def _claim(
    value: pd.Series,
    condition: str,
    batch: int,
    suite: SpeedSuite,
    noisy: set[tuple[str, str, int]],
    paper: Paper,
) -> Grid:
    """Return the grid of what an image costs under a condition, beside the paper's values.

    It has a row for each method, and a column for each number of images and of threads.
    """
    threads = ordered(value.index.get_level_values("threads"))
    across = [(views, count) for views in ordered((1, batch)) for count in threads]
    heads = (
        f"{'alone' if views == 1 else f'one of {views}'}, {_threads(count)}"
        for views, count in across
    )

    def image(method: str, views: int, count: int) -> str:
        """Return the cost of one of `views` images with `count` threads, as the grid shows it."""
        where = method, condition, count
        cost = value.get((*where, f"picture-of-{views}-ms"))
        if cost is None or not math.isfinite(cost):
            return "-" if cost is None else "failed"
        faster = value.get((*where, f"picture-of-{views}-speedup"))
        times = _times(None if method == suite.baselines[0] else faster)
        return _number(cost) + times + _mark(where, noisy)

    lines = []
    for method in ordered(value.index.get_level_values("method")):
        ours, faster = (
            paper.get((_PAPER_CLASS, metric, condition, method))
            for metric in ("picture-ms", "picture-speedup")
        )
        published = Cell("-")
        if ours is not None:
            published = Cell(f"{ours:g}{_times(faster)}", special=ITALIC)
        costs_of_method = [image(method, views, count) for views, count in across]
        lines.append([method, published, *costs_of_method])
    return grid(["method", "as published", *heads], lines)


def _times_of(rows: pd.DataFrame, batch: int, noisy: set[tuple[str, str, int]]) -> Iterator[Block]:
    """Yield the times and the memory of one condition and number of threads."""
    lines = []
    for method, of_method in rows.groupby("method", sort=False):
        first = of_method.iloc[0]
        at = dict(zip(of_method["metric"], map(_number, of_method["value"]), strict=True))
        where = (str(method), first["condition"], first["threads"])
        failed = ""
        if first["n_ok"] < first["clouds"]:
            failed = f"{first['n_ok']}/{first['clouds']} clouds"
        lines.append(
            [
                f"{method}{_mark(where, noisy)}",
                at["prepare-ms"],
                at["draw-1-ms"],
                at[f"draw-{batch}-ms"],
                at["picture-of-1-core-ms"],
                at[f"picture-of-{batch}-core-ms"],
                f"{at['peak-mib']} ({at['idle-mib']})",
                failed,
            ]
        )
    yield (
        f"Milliseconds: a cloud prepared; a view drawn alone, and one of {batch} drawn in a call; "
        "core-ms is processor time of an image, all threads together. Memory, MiB, at most; in "
        "brackets what the process had before the method was loaded."
    )
    heads = ["method", "prepare", "draw 1", f"of {batch}", "core-ms: of 1", f"of {batch}"]
    yield grid([*heads, "memory", ""], lines)


def amortised_rows(measurements: Sequence[Measurement], suite: SpeedSuite) -> pd.DataFrame:
    """Return the cost of an image by the number of views of its cloud, a row for each.

    Methods without a cost have no rows.
    """
    rows = []
    for m in measurements:
        values = summarise(m)
        wall, core = (costs(values, unit, m.views, suite.amortised) for unit in _UNITS)
        if np.isfinite([wall, core]).all():
            where = suite.id, m.method, m.condition, m.threads
            rows += [(*where, *row) for row in zip(suite.amortised, wall, core, strict=True)]
    return pd.DataFrame(rows, columns=["suite", *WHERE, "views", "wall_ms", "core_ms"])


def amortised_table(rows: pd.DataFrame, suite: SpeedSuite, batch: int) -> Table:
    """Return the table of the cost of an image by the number of views of its cloud.

    batch  the most views that are drawn in one call
    """

    def layout(_: pd.DataFrame) -> Iterator[Block]:
        yield (
            f"Milliseconds an image: prepare / views + draw, in calls of up to {batch} views; in "
            "bold the cheapest that looks at the cloud alone."
        )
        for (condition, threads), chosen in rows.groupby(_SETTING, sort=False):
            yield f"## {markdown.cell(str(condition))}, {_threads(threads)}"
            wide = chosen.pivot(index="method", columns="views", values="wall_ms")
            rivals = [method for method in wide.index if not find_method(method).role]
            cheapest = wide.loc[rivals].min()
            lines = []
            for method in ordered(chosen["method"]):
                cells = []
                for views, cost in wide.loc[method].items():
                    is_cheapest = method in rivals and cost == cheapest[views]
                    cells.append(Cell(_number(cost), special=BOLD if is_cheapest else None))
                lines.append([method, *cells])
            yield grid(["method", *map(str, wide.columns)], lines)

    title = "What an image costs, by the number of views of a cloud"
    return Table("amortised", title, rows, layout, digits=".6g")


def amortised_figure(rows: pd.DataFrame) -> Figure:
    """Return the figure of what an image costs by the number of views of its cloud.

    It has a row of panels for each condition and a column for each number of threads; both axes are
    logarithmic.
    """
    rows = rows.rename(columns={"views": "x", "wall_ms": "value"})
    shown = [
        SweepPanel(
            of_panel,
            title=f"{condition}, {threads} thread{'s' if threads > 1 else ''}",
            x_label="images of one cloud",
            y_label="milliseconds an image (lower is better)",
            ticks={views: f"{views}" for views in ordered(rows["x"])},
            x_scale="log",
            y_scale="log",
        )
        for (condition, threads), of_panel in grouped(rows, ["condition", "threads"])
    ]
    styles, columns = method_styles(ordered(rows["method"])), rows["threads"].nunique()
    return sweep_figure(shown, styles, columns=columns, panel_in=3.5, sharex=True, sharey=True)


def _mark(where: tuple[str, str, int], noisy: set[tuple[str, str, int]]) -> str:
    """Return the mark of a time that was taken while something else ran; "" for other times."""
    return " *" if where in noisy else ""


def _threads(count: Any) -> str:
    return f"{count} thread" if count == 1 else f"{count} threads"


def _times(faster: float | None) -> str:
    """Return how many times cheaper an image is, as in " (2.5x)"; "" where that is unknown."""
    return "" if faster is None else f" ({_number(faster)}x)"


def _number(value: float) -> str:
    """Return a number with three significant digits, or as a whole number from 100 on.

    A dash stands for NaN.
    """
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"
