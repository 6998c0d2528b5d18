"""The tables of the suite `speed`: rows of plain values, and their Markdown. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from typing import Any

from bench.catalogue.methods import FLOORS, find_method
from bench.catalogue.suites import SpeedSuite
from bench.suites.speed.samples import Measurement, Sample
from bench.suites.speed.summary import MS, Summary, beside, break_even, speedups
from bench.tables import markdown
from bench.tables.table import csv_text

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


def to_csv(kind: type, rows: Iterable[Any]) -> str:
    """Tidy CSV of rows of one dataclass, 6 significant digits, an empty field for NaN."""
    header = [field.name for field in fields(kind)]
    return csv_text(header, ([_field(value) for value in astuple(row)] for row in rows))


def samples_to_csv(measurements: Iterable[Measurement]) -> str:
    """Every timed call behind the tables, a row each."""
    header = ["method", "condition", "threads", *(field.name for field in fields(Sample))]
    return csv_text(
        header,
        (
            [m.method, m.condition, m.threads, *map(_field, astuple(sample))]
            for m in measurements
            for sample in m.samples
        ),
    )


def _field(value: object) -> object:
    if not isinstance(value, float):
        return value
    return f"{value:.6g}" if math.isfinite(value) else ""


def speed_markdown(
    summaries: Sequence[Summary],
    suite: SpeedSuite,
    machine: Machine,
    paper: Paper,
) -> str:
    """The claim of the paper, then all times: a pair of tables for each condition and threads."""
    batch = summaries[0].measurement.views
    devices = ", ".join(dict.fromkeys(s.measurement.device for s in summaries))
    lines = [
        "# Speed: what a picture costs",
        "",
        f"On {markdown.cell(machine.cpu)}, {machine.cores} cores; device {markdown.cell(devices)}. "
        "Each method alone in a fresh process, its libraries on the threads named. Medians over "
        f"clouds (here {summaries[0].measurement.clouds}) and rounds (at least "
        f"{suite.least_rounds}, after {suite.warm_ups} not counted), the 95th percentile in "
        "brackets. 2x: a picture costs half of what it does with "
        f"{markdown.cell(suite.rivals[0])}.",
        "",
        *_claim(summaries, suite, paper),
    ]
    for condition, threads in _circumstances(summaries):
        chosen = [s for s in summaries if _circumstance(s) == (condition, threads)]
        lines += [
            f"## {markdown.cell(condition)}, {_threads(threads)}",
            "",
            f"Warm, ms: a cloud prepared; a view drawn alone, and one of {batch} drawn in a call; "
            "core-ms is processor time of a picture, all threads together.",
            "",
            markdown.row(
                ["method", "prepare", "draw 1", f"of {batch}", "core-ms: of 1", f"of {batch}", ""]
            ),
            "|---" * 7 + "|",
            *(_warm_row(summary, suite) for summary in chosen),
            "",
            "Cold, ms: imports and weights; the first cloud; the first view. Memory, MiB, at most; "
            "in brackets what the process had before the method was loaded.",
            "",
            markdown.row(["method", "load", "prepare", "draw", "first picture", "memory"]),
            "|---" * 6 + "|",
            *(_cold_row(summary) for summary in chosen),
            "",
        ]
    noisy = [s for s in summaries if _noisy(s, suite)]
    if noisy:
        lines += [
            f"\\* Something else kept more than {suite.quiet_cores:g} of the cores busy meanwhile; "
            "take these times again on a quiet machine.",
            "",
        ]
    for summary in summaries:
        of = summary.measurement
        lines += [
            f"* {markdown.cell(of.method)}, {markdown.cell(of.condition)}, {_threads(of.threads)}, "
            f"{markdown.cell(failure.cloud)}: failed, {markdown.cell(failure.reason)}"
            for failure in of.failures
        ]
    return "\n".join([*lines, ""])


def _claim(
    summaries: Sequence[Summary],
    suite: SpeedSuite,
    paper: Paper,
) -> list[str]:
    batch = summaries[0].measurement.views
    lines = ["## The claim", ""]
    if paper:
        lines += [
            "The paper gives one number for each road, on an NVIDIA GTX 1060, and does not say how "
            "many pictures a reconstruction was shared by. pc2pix@paper has the paper's width: it "
            "is made of the bundled pc2pix, which has a quarter of it, when it is loaded.",
            "",
        ]
    for condition in dict.fromkeys(s.measurement.condition for s in summaries):
        counts = list(dict.fromkeys(s.measurement.threads for s in summaries))
        heads = [
            f"{'alone' if views == 1 else f'one of {views}'}, {_threads(threads)}"
            for views in dict.fromkeys((1, batch))
            for threads in counts
        ]
        lines += [
            f"A picture at {markdown.cell(condition)}, its cloud's preparation included, ms:",
            "",
            markdown.row(["method", "as published", *heads]),
            "|---" * (2 + len(heads)) + "|",
        ]
        for method in dict.fromkeys(s.measurement.method for s in summaries):
            ours = {s.measurement.threads: s for s in summaries if _is(s, method, condition)}
            published, faster = (
                paper.get((PAPER_CLASS, metric, condition, method))
                for metric in ("picture-ms", "picture-speedup")
            )
            quoted = "-" if published is None else f"*{published:g}{_times(faster)}*"
            cells = [
                _picture(ours.get(threads), views, suite, summaries)
                for views in dict.fromkeys((1, batch))
                for threads in counts
            ]
            lines.append(markdown.row([markdown.cell(method), quoted, *cells]))
        lines.append("")
    return lines


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


def _warm_row(summary: Summary, suite: SpeedSuite) -> str:
    values, batch = summary.values, summary.measurement.views
    cells = [
        f"{_number(values[f'{name}-ms'].value)} ({_number(values[f'{name}-p95-ms'].value)})"
        for name in ("prepare", "draw-1", f"draw-{batch}")
    ]
    cells += [_number(values[f"picture-of-{views}-core-ms"].value) for views in (1, batch)]
    of = summary.measurement
    count = f"{summary.n_ok}/{of.clouds} clouds" if summary.n_ok < of.clouds else ""
    return markdown.row([markdown.cell(of.method) + _mark(summary, suite), *cells, count])


def _cold_row(summary: Summary) -> str:
    values = summary.values
    cells = [
        _number(values[f"cold-{name}-ms"].value) for name in ("load", "prepare", "draw", "picture")
    ]
    memory = f"{_number(values['peak-mib'].value)} ({_number(values['idle-mib'].value)})"
    return markdown.row([markdown.cell(summary.measurement.method), *cells, memory])


def amortised_markdown(summaries: Sequence[Summary], suite: SpeedSuite) -> str:
    """Cost per picture by number of views, and the break-even counts."""
    batch = summaries[0].measurement.views
    rows, pairs = amortised_rows(summaries, suite), break_even_rows(summaries, suite)
    lines = [
        "# What a picture costs, by the number of views of a cloud",
        "",
        f"Milliseconds a picture: prepare / views + draw, in calls of up to {batch} views; in bold "
        "the cheapest that looks at the cloud alone.",
        "",
    ]
    for condition, threads in _circumstances(summaries):
        here = [r for r in rows if (r.condition, r.threads) == (condition, threads)]
        equal = [r for r in pairs if (r.condition, r.threads) == (condition, threads)]
        lines += [
            f"## {markdown.cell(condition)}, {_threads(threads)}",
            "",
            *_per_picture(here, suite),
            "",
        ]
        if equal:
            lines += [*_break_even(equal, suite), ""]
    return "\n".join(lines)


def _per_picture(rows: Sequence[AmortisedRow], suite: SpeedSuite) -> list[str]:
    at = {(row.method, row.views): row.wall_ms for row in rows}
    methods = list(dict.fromkeys(row.method for row in rows))
    rivals = [m for m in methods if m not in FLOORS and not find_method(m).sees_mesh]
    lines = [
        markdown.row(["method", *map(str, suite.amortised)]),
        "|---" * (1 + len(suite.amortised)) + "|",
    ]
    for method in methods:
        cells = []
        for views in suite.amortised:
            told = _number(at[method, views])
            cheapest = method in rivals and at[method, views] == min(at[m, views] for m in rivals)
            cells.append(f"**{told}**" if cheapest else told)
        lines.append(markdown.row([markdown.cell(method), *cells]))
    return lines


def _break_even(rows: Sequence[BreakEvenRow], suite: SpeedSuite) -> list[str]:
    found = {(row.method, row.rival): verdict(row) for row in rows}
    rivals = [name for name in suite.rivals if any(row.rival == name for row in rows)]
    return [
        "For how many views of a cloud a method is cheaper than",
        "",
        markdown.row(["method", *map(markdown.cell, rivals)]),
        "|---" * (1 + len(rivals)) + "|",
        *(
            markdown.row([markdown.cell(m), *(found.get((m, rival), "-") for rival in rivals)])
            for m in dict.fromkeys(row.method for row in rows)
        ),
    ]


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


def _circumstances(summaries: Iterable[Summary]) -> list[tuple[str, int]]:
    return list(dict.fromkeys(map(_circumstance, summaries)))


def _circumstance(summary: Summary) -> tuple[str, int]:
    return summary.measurement.condition, summary.measurement.threads


def _is(summary: Summary, method: str, condition: str) -> bool:
    of = summary.measurement
    return (of.method, of.condition) == (method, condition)


def _noisy(summary: Summary, suite: SpeedSuite) -> bool:
    return (summary.measurement.elsewhere_cores or 0.0) > suite.quiet_cores


def _mark(summary: Summary, suite: SpeedSuite) -> str:
    return r" \*" if _noisy(summary, suite) else ""


def _threads(count: int) -> str:
    return f"{count} thread" if count == 1 else f"{count} threads"


def _times(faster: float | None) -> str:
    return "" if faster is None else f" ({_number(faster)}x)"


def _number(value: float) -> str:
    """Three digits, more where they stand before the point; a dash for NaN."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"
