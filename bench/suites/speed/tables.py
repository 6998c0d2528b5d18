"""The tables of the suite `speed` as scripts read them: rows of plain values. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from typing import Any

from bench.catalogue.suites import SpeedSuite
from bench.suites.speed.samples import Measurement, Sample
from bench.suites.speed.speed_costs import break_even
from bench.suites.speed.summary import MS, Summary, beside, speedups
from bench.tables.tidy_csv import csv_text

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
