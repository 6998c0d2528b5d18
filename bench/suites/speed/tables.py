"""The tables of the suite `speed`. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields

from bench.catalogue.methods import FLOORS, find_method
from bench.catalogue.suites import SpeedSuite
from bench.suites.speed.samples import Measurement, Sample
from bench.suites.speed.summary import MS, Summary, beside, break_even, speedups
from bench.tables import markdown
from bench.tables.table import (
    BOLD,
    ITALIC,
    Block,
    Cell,
    Grid,
    Table,
    columns,
    columns_of,
    grid,
    ordered,
    pivot,
)

PAPER_CLASS = "all"  # the paper gives one number for its 13 classes
Paper = Mapping[tuple[str, str, str, str], float]  # by class, metric, condition and method


@dataclass(frozen=True)
class Machine:
    """Where times were taken: model of the processor, and cores that were to be had."""

    cpu: str
    cores: int


@dataclass(frozen=True)
class SpeedRow:
    """A number with all that it was taken under. `n` counts samples, `n_ok` and `clouds` clouds.

    paper  the same as published, on an NVIDIA GTX 1060
    """

    suite: str
    method: str
    condition: str
    threads: int
    metric: str
    value: float
    n: int
    n_ok: int
    clouds: int
    reason: str
    paper: float
    elsewhere_cores: float
    device: str
    cpu: str
    cores: int


@dataclass(frozen=True)
class AmortisedRow:
    """Milliseconds a picture, by the clock and of cores, where `views` are drawn of a cloud."""

    suite: str
    method: str
    condition: str
    threads: int
    views: int
    wall_ms: float
    core_ms: float


@dataclass(frozen=True)
class BreakEvenRow:
    """For how many views of a cloud a method is cheaper than a rival; see `Cost`."""

    suite: str
    method: str
    rival: str
    condition: str
    threads: int
    cheaper: str
    views: float
    views_2: float


@dataclass(frozen=True)
class TimedSample:
    """A timed call with the measurement that it belongs to."""

    measurement: Measurement
    sample: Sample


def speed_rows(
    summaries: Sequence[Summary],
    suite: SpeedSuite,
    machine: Machine,
    paper: Paper,
) -> list[SpeedRow]:
    """All numbers, a row each; the paper's stand beside those of a picture among V of a cloud."""
    rows = []
    for summary in summaries:
        of = summary.measurement
        rival = beside(summaries, summary, suite.rivals[0])
        for metric, found in (dict(summary.values) | speedups(summary, rival)).items():
            published = metric.replace(f"picture-of-{of.views}-", "picture-")
            rows.append(
                SpeedRow(
                    suite=suite.id,
                    method=of.method,
                    condition=of.condition,
                    threads=of.threads,
                    metric=metric,
                    value=found.value,
                    n=found.n,
                    n_ok=summary.n_ok,
                    clouds=of.clouds,
                    reason=summary.reason,
                    paper=paper.get((PAPER_CLASS, published, of.condition, of.method), math.nan),
                    elsewhere_cores=math.nan if of.elsewhere_cores is None else of.elsewhere_cores,
                    device=of.device,
                    cpu=machine.cpu,
                    cores=machine.cores,
                )
            )
    return rows


def amortised_rows(summaries: Sequence[Summary], suite: SpeedSuite) -> list[AmortisedRow]:
    """The cost of a picture against the number of views; methods without a cost have no rows."""
    return [
        AmortisedRow(
            suite.id,
            summary.measurement.method,
            summary.measurement.condition,
            summary.measurement.threads,
            views,
            MS * summary.wall.per_picture(views),
            MS * summary.core.per_picture(views),
        )
        for summary in summaries
        if summary.wall and summary.core
        for views in suite.amortised
    ]


def break_even_rows(summaries: Sequence[Summary], suite: SpeedSuite) -> list[BreakEvenRow]:
    """Each method against each of the suite's rivals, by the clock, where both have a cost."""
    rows = []
    for summary in summaries:
        for name in suite.rivals:
            rival = beside(summaries, summary, name)
            if rival is None or rival is summary or not (rival.wall and summary.wall):
                continue
            found = break_even(summary.wall, rival.wall)
            of = summary.measurement
            first, second = (*found.views, math.nan, math.nan)[:2]
            where = (suite.id, of.method, name, of.condition, of.threads)
            rows.append(BreakEvenRow(*where, found.cheaper, first, second))
    return rows


def samples_table(measurements: Iterable[Measurement]) -> Table[TimedSample]:
    """Every timed call behind the tables, a row each, for scripts."""
    made = (
        *columns(*((name, f"measurement.{name}") for name in ("method", "condition", "threads"))),
        *columns(*((one.name, f"sample.{one.name}") for one in fields(Sample)), digits=".6g"),
    )
    rows = tuple(TimedSample(m, sample) for m in measurements for sample in m.samples)
    return Table("speed_samples", "", made, rows)


def speed_table(
    summaries: Sequence[Summary], suite: SpeedSuite, machine: Machine, paper: Paper
) -> Table[SpeedRow]:
    """All numbers; for people the claim of the paper, then all times: a pair of grids for each
    condition and number of threads."""

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

    rows = tuple(speed_rows(summaries, suite, machine, paper))
    return Table("speed", "Speed: what a picture costs", columns_of(SpeedRow, ".6g"), rows, layout)


def _circumstances_in_words(
    summaries: Sequence[Summary], suite: SpeedSuite, machine: Machine
) -> str:
    devices = ", ".join(ordered(s.measurement.device for s in summaries))
    return (
        f"On {markdown.cell(machine.cpu)}, {machine.cores} cores; device {markdown.cell(devices)}. "
        "Each method alone in a fresh process, its libraries on the threads named. Medians over "
        f"clouds (here {summaries[0].measurement.clouds}) and rounds (at least "
        f"{suite.least_rounds}, after {suite.warm_ups} not counted), the 95th percentile in "
        "brackets. 2x: a picture costs half of what it does with "
        f"{markdown.cell(suite.rivals[0])}."
    )


def _claim(summaries: Sequence[Summary], suite: SpeedSuite, paper: Paper) -> Iterator[Block]:
    """A grid for each condition: methods down, pictures of a cloud by number of threads across."""
    yield "## The claim"
    if paper:
        yield (
            "The paper gives one number for each road, on an NVIDIA GTX 1060, and does not say how "
            "many pictures a reconstruction was shared by. pc2pix@paper has the paper's width: it "
            "is made of the bundled pc2pix, which has a quarter of it, when it is loaded."
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
                _picture(ours.get(threads), views, suite, summaries) for views, threads in across
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


def _picture(
    summary: Summary | None, views: int, suite: SpeedSuite, summaries: Sequence[Summary]
) -> str:
    if summary is None or summary.wall is None:
        return "failed" if summary else "-"
    rival = beside(summaries, summary, suite.rivals[0])
    faster = speedups(summary, rival).get(f"picture-of-{views}-speedup")
    own = summary is rival
    return (
        _number(MS * summary.wall.per_picture(views))
        + _times(None if own or faster is None else faster.value)
        + _mark(summary, suite)
    )


def _times_of(chosen: Sequence[Summary], suite: SpeedSuite) -> Iterator[Block]:
    """Of one condition and number of threads: warm times, then cold ones and memory."""
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
    values, of = summary.values, summary.measurement
    cells = [
        f"{_number(values[f'{name}-ms'].value)} ({_number(values[f'{name}-p95-ms'].value)})"
        for name in ("prepare", "draw-1", f"draw-{of.views}")
    ]
    cells += [_number(values[f"picture-of-{views}-core-ms"].value) for views in (1, of.views)]
    count = f"{summary.n_ok}/{of.clouds} clouds" if summary.n_ok < of.clouds else ""
    return [of.method + _mark(summary, suite), *cells, count]


def _cold(summary: Summary) -> list[str]:
    values = summary.values
    cells = [
        _number(values[f"cold-{name}-ms"].value) for name in ("load", "prepare", "draw", "picture")
    ]
    memory = f"{_number(values['peak-mib'].value)} ({_number(values['idle-mib'].value)})"
    return [summary.measurement.method, *cells, memory]


def _failures(summaries: Sequence[Summary]) -> list[str]:
    return [
        f"* {markdown.cell(of.method)}, {markdown.cell(of.condition)}, {_threads(of.threads)}, "
        f"{markdown.cell(failure.cloud)}: failed, {markdown.cell(failure.reason)}"
        for of in (summary.measurement for summary in summaries)
        for failure in of.failures
    ]


def amortised_table(summaries: Sequence[Summary], suite: SpeedSuite) -> Table[AmortisedRow]:
    """Cost per picture by number of views; for people also the break-even counts."""
    batch, pairs = summaries[0].measurement.views, break_even_rows(summaries, suite)

    def layout(rows: Sequence[AmortisedRow]) -> Iterator[Block]:
        yield (
            f"Milliseconds a picture: prepare / views + draw, in calls of up to {batch} views; in "
            "bold the cheapest that looks at the cloud alone."
        )
        for condition, threads in ordered(map(_circumstance, summaries)):
            here = [r for r in rows if (r.condition, r.threads) == (condition, threads)]
            equal = [r for r in pairs if (r.condition, r.threads) == (condition, threads)]
            yield f"## {markdown.cell(condition)}, {_threads(threads)}"
            yield _per_picture(here, suite)
            if equal:
                yield "For how many views of a cloud a method is cheaper than"
                yield _break_even(equal, suite)

    title = "What a picture costs, by the number of views of a cloud"
    rows = tuple(amortised_rows(summaries, suite))
    return Table("amortised", title, columns_of(AmortisedRow, ".6g"), rows, layout)


def break_even_table(summaries: Sequence[Summary], suite: SpeedSuite) -> Table[BreakEvenRow]:
    """Each method against each rival, for scripts."""
    rows = tuple(break_even_rows(summaries, suite))
    return Table("break_even", "", columns_of(BreakEvenRow, ".6g"), rows)


def _per_picture(rows: Sequence[AmortisedRow], suite: SpeedSuite) -> Grid:
    cheapest = {
        views: min((r.wall_ms for r in rows if r.views == views and _rival(r.method)), default=None)
        for views in suite.amortised
    }

    def cell(row: AmortisedRow) -> Cell:
        first = _rival(row.method) and row.wall_ms == cheapest[row.views]
        return Cell(_number(row.wall_ms), special=BOLD if first else None)

    return pivot(rows, "method", "views", cell, columns=suite.amortised, corner="method")


def _rival(method: str) -> bool:
    """Whether it looks at the cloud alone."""
    return method not in FLOORS and not find_method(method).sees_mesh


def _break_even(rows: Sequence[BreakEvenRow], suite: SpeedSuite) -> Grid:
    there = {row.rival for row in rows}
    return pivot(
        rows,
        "method",
        "rival",
        lambda row: Cell(verdict(row)),
        columns=[name for name in suite.rivals if name in there],
        corner="method",
    )


def verdict(row: BreakEvenRow) -> str:
    """The break-even in whole views: "any", "none", "1 to 12", "13 and more"."""
    until = math.ceil(row.views) - 1 if math.isfinite(row.views) else 0  # the last below
    after = math.floor(row.views) + 1 if math.isfinite(row.views) else 0  # the first above
    match row.cheaper:
        case "always":
            return "any"
        case "never":
            return "none"
        case "up to":
            return _range(1, until)
        case "from":
            return f"{after} and more"
        case "between":
            return _range(after, math.ceil(row.views_2) - 1)
        case _:
            return f"{_range(1, until)}, {math.floor(row.views_2) + 1} and more"


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
    """Three digits, more where they stand before the point; a dash for NaN."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"
