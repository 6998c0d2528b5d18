"""The tables of the suite `speed`, as pure functions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

from bench.catalogue.methods import find_method
from bench.catalogue.suites import SpeedSuite
from bench.suites.speed.samples import Measurement, Sample
from bench.suites.speed.summary import (
    MS,
    BreakEven,
    Summary,
    Value,
    beside,
    break_even,
    speedups,
)
from bench.tables import markdown
from bench.tables.table import (
    BOLD,
    ITALIC,
    Block,
    Cell,
    Column,
    Grid,
    Table,
    columns,
    constant,
    grid,
    ordered,
    pivot,
)

PAPER_CLASS = "all"  # the paper gives one number for its 13 classes
Paper = Mapping[tuple[str, str, str, str], float]  # by class, metric, condition and method
WHERE = ("method", "condition", "threads")  # what a measurement is of
METHOD = "summary.measurement.method"


@dataclass(frozen=True)
class SpeedRow:
    """A number of a measurement, and its published counterpart on an NVIDIA GTX 1060."""

    summary: Summary
    metric: str
    found: Value
    paper: float


@dataclass(frozen=True)
class AmortisedRow:
    """Milliseconds an image, by the clock and of cores, where `views` are drawn of a cloud."""

    summary: Summary
    views: int
    wall_ms: float
    core_ms: float


@dataclass(frozen=True)
class BreakEvenRow:
    """The break-even of a method with a rival, in views of a cloud."""

    summary: Summary
    rival: str
    found: BreakEven

    @property
    def ends(self) -> tuple[float, float]:
        """The numbers of views with equal costs, of which there are up to two; else NaN."""
        first, second, *_ = (*self.found.views, math.nan, math.nan)
        return first, second


class TimedSample(NamedTuple):
    """A timed call with the measurement that it belongs to."""

    measurement: Measurement
    sample: Sample


def _columns(suite: SpeedSuite, *further: Column) -> tuple[Column, ...]:
    """Return the columns of rows that have a summary: suite, measurement, and further ones."""
    where = columns(*((name, f"summary.measurement.{name}") for name in WHERE))
    return (constant("suite", suite.id), *where, *further)


def speed_rows(summaries: Sequence[Summary], suite: SpeedSuite, paper: Paper) -> list[SpeedRow]:
    """Return all numbers, a row each, with the paper's beside those of an image among V."""
    rows = []
    for summary in summaries:
        measurement = summary.measurement
        rival = beside(summaries, summary, suite.rivals[0])
        for metric, value in (dict(summary.values) | speedups(summary, rival)).items():
            published = metric.replace(f"picture-of-{measurement.views}-", "picture-")
            key = (PAPER_CLASS, published, measurement.condition, measurement.method)
            rows.append(SpeedRow(summary, metric, value, paper.get(key, math.nan)))
    return rows


def amortised_rows(summaries: Sequence[Summary], suite: SpeedSuite) -> list[AmortisedRow]:
    """Return an image's cost against the number of views; none for methods without a cost."""
    return [
        AmortisedRow(
            summary,
            views,
            MS * summary.wall.per_image(views),
            MS * summary.core.per_image(views),
        )
        for summary in summaries
        if summary.wall and summary.core
        for views in suite.amortised
    ]


def break_even_rows(summaries: Sequence[Summary], suite: SpeedSuite) -> list[BreakEvenRow]:
    """Return each method against each of the suite's rivals, by the clock, if both have a cost."""
    rows = []
    for summary in summaries:
        for name in suite.rivals:
            rival = beside(summaries, summary, name)
            if rival is None or rival is summary or not (rival.wall and summary.wall):
                continue
            rows.append(BreakEvenRow(summary, name, break_even(summary.wall, rival.wall)))
    return rows


def samples_table(measurements: Iterable[Measurement]) -> Table[TimedSample]:
    """Return every timed call behind the tables, a row each, for scripts."""
    layout = (
        *columns(*((name, f"measurement.{name}") for name in WHERE)),
        *columns(
            *(
                (sample_field.name, f"sample.{sample_field.name}")
                for sample_field in fields(Sample)
            ),
            digits=".6g",
        ),
    )
    rows = tuple(TimedSample(m, sample) for m in measurements for sample in m.samples)
    return Table("speed_samples", "", layout, rows)


def speed_table(
    summaries: Sequence[Summary], suite: SpeedSuite, machine: Mapping[str, Any], paper: Paper
) -> Table[SpeedRow]:
    """Return all numbers; for people the claim of the paper, then all times.

    The times are a pair of grids for each condition and number of threads.

    machine  model of the processor (`cpu`), and `cores` that were available
    """

    def layout(rows: Sequence[SpeedRow]) -> Iterator[Block]:
        yield _circumstances_in_words(summaries, suite, machine)
        yield from _claim(summaries, suite, paper)
        for condition, threads in ordered(map(_circumstance, summaries)):
            yield f"## {markdown.cell(condition)}, {_threads(threads)}"
            chosen = [s for s in summaries if _circumstance(s) == (condition, threads)]
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
        *columns("metric", ("value", "found.value"), ("n", "found.n"), digits=".6g"),
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
    return Table("speed", "Speed: what a picture costs", table_columns, rows, layout)


def _circumstances_in_words(
    summaries: Sequence[Summary], suite: SpeedSuite, machine: Mapping[str, Any]
) -> str:
    devices = ", ".join(ordered(s.measurement.device for s in summaries))
    return (
        f"On {markdown.cell(machine['cpu'])}, {machine['cores']} cores; device "
        f"{markdown.cell(devices)}. Each method alone in a fresh process, its libraries on the "
        f"threads named. Medians over clouds (here {summaries[0].measurement.clouds}) and rounds "
        f"(at least {suite.least_rounds}, after {suite.warm_ups} not counted), the 95th percentile "
        "in brackets. 2x: a picture costs half of what it does with "
        f"{markdown.cell(suite.rivals[0])}."
    )


def _claim(summaries: Sequence[Summary], suite: SpeedSuite, paper: Paper) -> Iterator[Block]:
    """Yield a grid for each condition: methods down, images of a cloud by threads across."""
    yield "## The claim"
    if paper:
        yield (
            "The paper gives one number for each approach, on an NVIDIA GTX 1060, and does not "
            "say how many pictures a reconstruction was shared by. pc2pix@paper has the paper's "
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
            lines.append([method, _published(paper, condition, method), *cells])
        yield f"A picture at {markdown.cell(condition)}, its cloud's preparation included, ms:"
        yield grid(["method", "as published", *heads], lines)


def _published(paper: Paper, condition: str, method: str) -> Cell:
    value, faster = (
        paper.get((PAPER_CLASS, metric, condition, method))
        for metric in ("picture-ms", "picture-speedup")
    )
    return Cell("-") if value is None else Cell(f"{value:g}{_times(faster)}", special=ITALIC)


def _image(
    summary: Summary | None, views: int, suite: SpeedSuite, summaries: Sequence[Summary]
) -> str:
    if summary is None or summary.wall is None:
        return "failed" if summary else "-"
    rival = beside(summaries, summary, suite.rivals[0])
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
        "core-ms is processor time of a picture, all threads together."
    )
    yield grid(
        ["method", "prepare", "draw 1", f"of {batch}", "core-ms: of 1", f"of {batch}", ""],
        (_warm(summary, suite) for summary in chosen),
    )
    yield (
        "Cold, ms: imports and weights; the first cloud; the first view. Memory, MiB, at most; in "
        "brackets what the process had before the method was loaded."
    )
    yield grid(["method", "load", "prepare", "draw", "first picture", "memory"], map(_cold, chosen))


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
            f"Milliseconds a picture: prepare / views + draw, in calls of up to {batch} views; in "
            "bold the cheapest that looks at the cloud alone."
        )
        for condition, threads in ordered(map(_circumstance, summaries)):
            here = [r for r in rows if _circumstance(r.summary) == (condition, threads)]
            equal = [r for r in pairs if _circumstance(r.summary) == (condition, threads)]
            yield f"## {markdown.cell(condition)}, {_threads(threads)}"
            yield _per_image(here, suite)
            if equal:
                yield "For how many views of a cloud a method is cheaper than"
                yield _break_even(equal, suite)

    title = "What a picture costs, by the number of views of a cloud"
    table_columns = _columns(suite, *columns("views", "wall_ms", "core_ms", digits=".6g"))
    return Table("amortised", title, table_columns, tuple(amortised_rows(summaries, suite)), layout)


def break_even_table(summaries: Sequence[Summary], suite: SpeedSuite) -> Table[BreakEvenRow]:
    """Return each method against each rival, for scripts."""
    table_columns = (
        constant("suite", suite.id),
        *columns(("method", METHOD), "rival", ("condition", "summary.measurement.condition")),
        *columns(("threads", "summary.measurement.threads"), ("cheaper", "found.cheaper")),
        Column("views", lambda row: row.ends[0], ".6g"),
        Column("views_2", lambda row: row.ends[1], ".6g"),
    )
    return Table("break_even", "", table_columns, tuple(break_even_rows(summaries, suite)))


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
    """Return whether its method looks at the cloud alone."""
    return not find_method(row.summary.measurement.method).role


def _break_even(rows: Sequence[BreakEvenRow], suite: SpeedSuite) -> Grid:
    compared = {row.rival for row in rows}
    rivals = [name for name in suite.rivals if name in compared]

    def cell(row: BreakEvenRow) -> Cell:
        return Cell(verdict(row.found))

    return pivot(rows, METHOD, "rival", cell, columns=rivals, corner="method")


def verdict(found: BreakEven) -> str:
    """Return the break-even in whole views: "any", "none", "1 to 12", "13 and more"."""
    below = [math.ceil(views) - 1 for views in found.views]
    above = [math.floor(views) + 1 for views in found.views]
    match found.cheaper:
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


def _circumstance(summary: Summary) -> tuple[str, int]:
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
