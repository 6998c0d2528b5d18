"""The tables of the suite `speed`, as pure functions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

from bench.catalogue.methods import find_method
from bench.suites.speed.rows import (
    PAPER_CLASS,
    AmortisedRow,
    BreakEvenRow,
    Paper,
    SampleRow,
    SpeedRow,
    amortised_rows,
    break_even_rows,
    speed_rows,
)
from bench.suites.speed.samples import Measurement, TimingSample
from bench.suites.speed.suite import SpeedSuite
from bench.suites.speed.summary import MS, BreakEven, Summary, beside, speedups
from bench.tables import markdown
from bench.tables.grid import BOLD, ITALIC, Block, Cell, Grid, grid, ordered, pivot
from bench.tables.table import Column, Table, columns, constant

WHERE = ("method", "condition", "threads")  # columns that identify a measurement
METHOD = "summary.measurement.method"


def _columns(suite: SpeedSuite, *further: Column) -> tuple[Column, ...]:
    """Return the columns of rows that have a summary: suite, measurement, and further ones."""
    where = columns(*((name, f"summary.measurement.{name}") for name in WHERE))
    return (constant("suite", suite.id), *where, *further)


def samples_table(measurements: Iterable[Measurement]) -> Table[SampleRow]:
    """Return every timed call behind the tables, a row each, for scripts."""
    layout = (
        *columns(*((name, f"measurement.{name}") for name in WHERE)),
        *columns(
            *(
                (sample_field.name, f"sample.{sample_field.name}")
                for sample_field in fields(TimingSample)
            ),
            digits=".6g",
        ),
    )
    rows = tuple(SampleRow(m, sample) for m in measurements for sample in m.samples)
    return Table.of_rows("speed_samples", "", layout, rows)


def speed_table(
    summaries: Sequence[Summary], suite: SpeedSuite, machine: Mapping[str, Any], paper: Paper
) -> Table[SpeedRow]:
    """Return all statistics; for people the claim of the paper, then all times.

    The times are a pair of grids for each condition and number of threads.

    machine  model of the processor (`cpu`), and `cores` that were available
    """

    def layout(rows: Sequence[SpeedRow]) -> Iterator[Block]:
        yield _setting_in_words(summaries, suite, machine)
        yield from _claim(summaries, suite, paper)
        for condition, threads in ordered(map(_setting, summaries)):
            yield f"## {markdown.cell(condition)}, {_threads(threads)}"
            chosen = [s for s in summaries if _setting(s) == (condition, threads)]
            yield from _times_of(chosen, suite)
        if any(_noisy(summary, suite) for summary in summaries):
            yield (
                f"\\* Something else kept more than {suite.quiet_cores:g} of the cores busy "
                "meanwhile; take these times again on a quiet machine."
            )
        yield "\n".join(_failures(summaries))

    measurement = "summary.measurement"
    table_columns = _columns(
        suite,
        *columns("metric", ("value", "statistic.value"), ("n", "statistic.n"), digits=".6g"),
        *columns(
            ("n_ok", "summary.n_ok"),
            ("clouds", f"{measurement}.clouds"),
            ("reason", "summary.reason"),
        ),
        *columns("paper", ("elsewhere_cores", f"{measurement}.elsewhere_cores"), digits=".6g"),
        *columns(("device", f"{measurement}.device")),
        constant("cpu", machine["cpu"]),
        constant("cores", machine["cores"]),
    )
    rows = tuple(speed_rows(summaries, suite, paper))
    return Table.of_rows("speed", "Speed: what an image costs", table_columns, rows, layout)


def _setting_in_words(
    summaries: Sequence[Summary], suite: SpeedSuite, machine: Mapping[str, Any]
) -> str:
    devices = ", ".join(ordered(s.measurement.device for s in summaries))
    return (
        f"On {markdown.cell(machine['cpu'])}, {machine['cores']} cores; device "
        f"{markdown.cell(devices)}. Each method alone in a fresh process, its libraries on the "
        f"threads named. Medians over clouds (here {summaries[0].measurement.clouds}) and rounds "
        f"(at least {suite.least_rounds}, after {suite.warm_ups} not counted), the 95th percentile "
        "in brackets. 2x: an image costs half of what it does with "
        f"{markdown.cell(suite.baselines[0])}."
    )


def _claim(summaries: Sequence[Summary], suite: SpeedSuite, paper: Paper) -> Iterator[Block]:
    """Yield a grid for each condition, with methods down, images of a cloud by threads across."""
    yield "## The claim"
    if paper:
        yield (
            "The paper gives one number for each approach, on an NVIDIA GTX 1060, and does not "
            "say how many images a reconstruction was shared by. pc2pix@paper has the paper's "
            "width: it is made of the bundled pc2pix, which has a quarter of it, when it is loaded."
        )
    counts = ordered((1, summaries[0].measurement.views))
    for condition in ordered(s.measurement.condition for s in summaries):
        of_condition = [s for s in summaries if s.measurement.condition == condition]
        across = [
            (views, threads)
            for views in counts
            for threads in ordered(s.measurement.threads for s in summaries)
        ]
        heads = (
            f"{'alone' if views == 1 else f'one of {views}'}, {_threads(threads)}"
            for views, threads in across
        )
        lines = []
        for method in ordered(s.measurement.method for s in summaries):
            ours = {
                s.measurement.threads: s for s in of_condition if s.measurement.method == method
            }
            cells = (
                _image(ours.get(threads), views, suite, summaries) for views, threads in across
            )
            value, faster = (
                paper.get((PAPER_CLASS, metric, condition, method))
                for metric in ("picture-ms", "picture-speedup")
            )
            published = Cell("-")
            if value is not None:
                published = Cell(f"{value:g}{_times(faster)}", special=ITALIC)
            lines.append([method, published, *cells])
        yield f"An image at {markdown.cell(condition)}, its cloud's preparation included, ms:"
        yield grid(["method", "as published", *heads], lines)


def _image(
    summary: Summary | None, views: int, suite: SpeedSuite, summaries: Sequence[Summary]
) -> str:
    if summary is None or summary.wall is None:
        return "failed" if summary else "-"
    rival = beside(summaries, summary, suite.baselines[0])
    faster = speedups(summary, rival).get(f"picture-of-{views}-speedup")
    is_rival = summary is rival
    return (
        _number(MS * summary.wall.per_image(views))
        + _times(None if is_rival or faster is None else faster.value)
        + _mark(summary, suite)
    )


def _times_of(chosen: Sequence[Summary], suite: SpeedSuite) -> Iterator[Block]:
    """Yield warm times, then cold ones and memory, of one condition and number of threads."""
    batch = chosen[0].measurement.views
    yield (
        f"Warm, ms: a cloud prepared; a view drawn alone, and one of {batch} drawn in a call; "
        "core-ms is processor time of an image, all threads together."
    )
    yield grid(
        ["method", "prepare", "draw 1", f"of {batch}", "core-ms: of 1", f"of {batch}", ""],
        (_warm(summary, suite) for summary in chosen),
    )
    yield (
        "Cold, ms: imports and weights; the first cloud; the first view. Memory, MiB, at most; in "
        "brackets what the process had before the method was loaded."
    )
    yield grid(["method", "load", "prepare", "draw", "first image", "memory"], map(_cold, chosen))


def _warm(summary: Summary, suite: SpeedSuite) -> list[str]:
    values, measurement = summary.values, summary.measurement
    cells = [
        f"{_number(values[f'{name}-ms'].value)} ({_number(values[f'{name}-p95-ms'].value)})"
        for name in ("prepare", "draw-1", f"draw-{measurement.views}")
    ]
    cells += [
        _number(values[f"picture-of-{views}-core-ms"].value) for views in (1, measurement.views)
    ]
    count = (
        f"{summary.n_ok}/{measurement.clouds} clouds" if summary.n_ok < measurement.clouds else ""
    )
    return [measurement.method + _mark(summary, suite), *cells, count]


def _cold(summary: Summary) -> list[str]:
    values = summary.values
    cells = [
        _number(values[f"cold-{name}-ms"].value) for name in ("load", "prepare", "draw", "picture")
    ]
    memory = f"{_number(values['peak-mib'].value)} ({_number(values['idle-mib'].value)})"
    return [summary.measurement.method, *cells, memory]


def _failures(summaries: Sequence[Summary]) -> list[str]:
    return [
        f"* {markdown.cell(timed.method)}, {markdown.cell(timed.condition)}, "
        f"{_threads(timed.threads)}, {markdown.cell(failure.cloud)}: failed, "
        f"{markdown.cell(failure.reason)}"
        for timed in (summary.measurement for summary in summaries)
        for failure in timed.failures
    ]


def amortised_table(summaries: Sequence[Summary], suite: SpeedSuite) -> Table[AmortisedRow]:
    """Return cost per image by number of views; for people also the break-even counts."""
    batch, pairs = summaries[0].measurement.views, break_even_rows(summaries, suite)

    def layout(rows: Sequence[AmortisedRow]) -> Iterator[Block]:
        yield (
            f"Milliseconds an image: prepare / views + draw, in calls of up to {batch} views; in "
            "bold the cheapest that looks at the cloud alone."
        )
        for condition, threads in ordered(map(_setting, summaries)):
            chosen = [r for r in rows if _setting(r.summary) == (condition, threads)]
            equal = [r for r in pairs if _setting(r.summary) == (condition, threads)]
            yield f"## {markdown.cell(condition)}, {_threads(threads)}"
            yield _per_image(chosen, suite)
            if equal:
                yield "For how many views of a cloud a method is cheaper than"
                yield _break_even(equal, suite)

    title = "What an image costs, by the number of views of a cloud"
    table_columns = _columns(suite, *columns("views", "wall_ms", "core_ms", digits=".6g"))
    return Table.of_rows(
        "amortised", title, table_columns, tuple(amortised_rows(summaries, suite)), layout
    )


def break_even_table(summaries: Sequence[Summary], suite: SpeedSuite) -> Table[BreakEvenRow]:
    """Return each method against each rival, for scripts."""
    table_columns = (
        constant("suite", suite.id),
        *columns(("method", METHOD), "rival", ("condition", "summary.measurement.condition")),
        *columns(("threads", "summary.measurement.threads"), ("cheaper", "break_even.cheaper")),
        Column("views", lambda row: row.ends[0], ".6g"),
        Column("views_2", lambda row: row.ends[1], ".6g"),
    )
    return Table.of_rows("break_even", "", table_columns, tuple(break_even_rows(summaries, suite)))


def _per_image(rows: Sequence[AmortisedRow], suite: SpeedSuite) -> Grid:
    cheapest = {
        views: min((r.wall_ms for r in rows if r.views == views and _rival(r)), default=None)
        for views in suite.amortised
    }

    def cell(row: AmortisedRow) -> Cell:
        first = _rival(row) and row.wall_ms == cheapest[row.views]
        return Cell(_number(row.wall_ms), special=BOLD if first else None)

    return pivot(rows, METHOD, "views", cell, columns=suite.amortised, corner="method")


def _rival(row: AmortisedRow) -> bool:
    """Return whether the row's method looks at the cloud alone."""
    return not find_method(row.summary.measurement.method).role


def _break_even(rows: Sequence[BreakEvenRow], suite: SpeedSuite) -> Grid:
    compared = {row.rival for row in rows}
    baselines = [name for name in suite.baselines if name in compared]

    def cell(row: BreakEvenRow) -> Cell:
        return Cell(in_whole_views(row.break_even))

    return pivot(rows, METHOD, "rival", cell, columns=baselines, corner="method")


def in_whole_views(break_even: BreakEven) -> str:
    """Return the break-even in whole views: "any", "none", "1 to 12", "13 and more"."""
    below = [math.ceil(views) - 1 for views in break_even.views]
    above = [math.floor(views) + 1 for views in break_even.views]
    match break_even.cheaper:
        case "always":
            return "any"
        case "never":
            return "none"
        case "up to":
            return _range(1, below[0])
        case "from":
            return f"{above[0]} and more"
        case "between":
            return _range(above[0], below[1])
        case _:
            return f"{_range(1, below[0])}, {above[1]} and more"


def _range(first: int, last: int) -> str:
    if last < first:
        return "none"
    return f"{first} to {last}" if last > first else str(first)


def _setting(summary: Summary) -> tuple[str, int]:
    return summary.measurement.condition, summary.measurement.threads


def _noisy(summary: Summary, suite: SpeedSuite) -> bool:
    return (summary.measurement.elsewhere_cores or 0.0) > suite.quiet_cores


def _mark(summary: Summary, suite: SpeedSuite) -> str:
    return " *" if _noisy(summary, suite) else ""


def _threads(count: int) -> str:
    return f"{count} thread" if count == 1 else f"{count} threads"


def _times(faster: float | None) -> str:
    return "" if faster is None else f" ({_number(faster)}x)"


def _number(value: float) -> str:
    """Return three digits, more where they stand before the point; a dash for NaN."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"
