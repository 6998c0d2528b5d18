"""The rows of the tables of the suite `speed`, as pure functions of summaries."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from bench.suites.speed.samples import Measurement, TimingSample
from bench.suites.speed.suite import SpeedSuite
from bench.suites.speed.summary import (
    MS,
    BreakEven,
    Statistic,
    Summary,
    beside,
    break_even,
    speedups,
)

PAPER_CLASS = "all"  # the paper gives one number for its 13 classes
Paper = Mapping[tuple[str, str, str, str], float]  # by class, metric, condition and method


@dataclass(frozen=True)
class SpeedRow:
    """A statistic of a measurement, and its published counterpart on an NVIDIA GTX 1060."""

    summary: Summary
    metric: str
    statistic: Statistic
    paper: float


@dataclass(frozen=True)
class AmortisedRow:
    """The milliseconds an image, by the clock and of cores, where `views` are drawn of a cloud."""

    summary: Summary
    views: int
    wall_ms: float
    core_ms: float


@dataclass(frozen=True)
class BreakEvenRow:
    """The break-even of a method with a rival, in views of a cloud."""

    summary: Summary
    rival: str
    break_even: BreakEven

    @property
    def ends(self) -> tuple[float, float]:
        """Return the two numbers of views with equal costs; NaN for fewer."""
        first, second, *_ = (*self.break_even.views, math.nan, math.nan)
        return first, second


class SampleRow(NamedTuple):
    """A timed call with the measurement that it belongs to."""

    measurement: Measurement
    sample: TimingSample


def speed_rows(summaries: Sequence[Summary], suite: SpeedSuite, paper: Paper) -> list[SpeedRow]:
    """Return a row for each statistic, with the paper's value beside that of an image among V."""
    rows = []
    for summary in summaries:
        measurement = summary.measurement
        rival = beside(summaries, summary, suite.baselines[0])
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
    """Return each method against each baseline of the suite, by the clock, if both have a cost."""
    rows = []
    for summary in summaries:
        for name in suite.baselines:
            rival = beside(summaries, summary, name)
            if rival is None or rival is summary or not (rival.wall and summary.wall):
                continue
            rows.append(BreakEvenRow(summary, name, break_even(summary.wall, rival.wall)))
    return rows
