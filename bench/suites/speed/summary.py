"""Medians of samples, and the cost of V images of one cloud.

A cloud is prepared once and drawn any number of times. Drawing was timed in calls of one view and
of a batch of views; between them the cost of a call is taken to grow evenly, and more views than a
batch are drawn in batches. The costs of one view and of whole batches are as measured:

    total(V) = prepare + one + (V - 1) (all - one) / (batch - 1)    1 <= V <= batch
    total(V) = prepare + V all / batch                              V >= batch

Two straight lines, so that the break-even of two methods is a closed form.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from bench.suites.speed.samples import Measurement, Stage, TimingSample

Cheaper = Literal["always", "never", "up to", "from", "between", "outside"]


@dataclass(frozen=True)
class Cost:
    """The cost of a method, in any one unit.

    prepare     of a cloud
    draw_one    of a call with one view
    draw_batch  of a call with `batch` views, all of them
    batch       at least 1; of 1, `draw_batch` is the same as `draw_one`
    """

    prepare: float
    draw_one: float
    draw_batch: float
    batch: int

    @property
    def further(self) -> float:
        """Return the cost of each view more in a call, up to a batch."""
        if self.batch == 1:
            return self.draw_one
        return (self.draw_batch - self.draw_one) / (self.batch - 1)

    def total(self, views: float) -> float:
        """Return the cost of preparing a cloud and drawing `views` >= 1 images of it."""
        if views >= self.batch:
            return self.prepare + views * self.draw_batch / self.batch
        return self.prepare + self.draw_one + (views - 1) * self.further

    def per_image(self, views: float) -> float:
        """Return the total cost for each of the images."""
        return self.total(views) / views


@dataclass(frozen=True)
class BreakEven:
    """The numbers of views of a cloud for which a method is cheaper than its rival.

    cheaper    "always" and "never" for any number; "up to" or "from" the one in `views`;
               "between" or "outside" the two there
    views      where the totals are equal, ascending; no whole numbers as a rule
    """

    cheaper: Cheaper
    views: tuple[float, ...]


def break_even(cost: Cost, rival: Cost) -> BreakEven:
    """Return where the totals of two costs with the same batch cross, for 1 view and more.

    Where they are equal throughout, neither is cheaper: "never". Raises ValueError where the
    batches differ.
    """
    if cost.batch != rival.batch:
        raise ValueError(f"break_even: batches of {cost.batch} and of {rival.batch} views")
    batch = cost.batch
    at_one = cost.total(1) - rival.total(1)
    at_batch = cost.total(batch) - rival.total(batch)
    growth = (cost.draw_batch - rival.draw_batch) / batch  # a view, beyond the batch
    crossings = []
    if at_one * at_batch < 0:
        crossings.append(1 + (batch - 1) * at_one / (at_one - at_batch))
    if at_batch * growth < 0:
        crossings.append((rival.prepare - cost.prepare) / growth)
    # The first difference that is not 0 decides: a tie at the start says nothing of the rest.
    cheaper_first = next((d < 0 for d in (at_one, at_batch, growth) if d), False)
    kinds: tuple[Cheaper, ...] = (
        ("always", "up to", "outside") if cheaper_first else ("never", "from", "between")
    )
    return BreakEven(kinds[len(crossings)], tuple(crossings))


MS = 1000.0


@dataclass(frozen=True)
class Statistic:
    """A number computed from `n` samples; NaN without any."""

    value: float
    n: int


@dataclass(frozen=True)
class Summary:
    """The medians and costs of a measurement.

    values  by metric, see `summarise`
    wall    medians of seconds by the clock; None where no view was timed
    core    medians of seconds of processor time; None where no view was timed
    """

    measurement: Measurement
    values: Mapping[str, Statistic]
    wall: Cost | None
    core: Cost | None

    @property
    def reason(self) -> str:
        """Return the reasons of failed clouds, each once; empty where none failed."""
        return "; ".join(dict.fromkeys(f.reason for f in self.measurement.failures))

    @property
    def n_ok(self) -> int:
        """Return the number of clouds that were measured to the end."""
        return self.measurement.clouds - len({f.cloud for f in self.measurement.failures})


def summarise(measurement: Measurement) -> Summary:
    """Return medians over clouds and rounds, in milliseconds and MiB.

    cold-load, cold-prepare, cold-draw   the first call in its process; cold-picture is their sum
    prepare, draw-1, draw-V              warm: median, 95th percentile (p95) and median of the
                                         processor time (core); of a call, a view's share
    picture-of-1, picture-of-V           an image where 1 or V are drawn of a cloud, prepared
                                         for them: sums of the medians above
    further-view                         what each view more in a call costs, up to V
    peak-mib, idle-mib                   most memory of the process, and before the method's load
    """
    batch = measurement.views
    values = {
        f"cold-{stage}-ms": _statistic(
            [s for s in measurement.samples if s.round == 0 and s.stage == stage],
            np.median,
            lambda sample: MS * sample.wall_s,
        )
        for stage in ("load", "prepare", "draw")
    }
    together = sum(value.value for value in values.values())
    values["cold-picture-ms"] = Statistic(together, 1 if math.isfinite(together) else 0)
    parts = [("prepare", _warm(measurement, "prepare", 0), 1)]
    parts += [(f"draw-{v}", _warm(measurement, "draw", v), v) for v in dict.fromkeys((1, batch))]
    for name, samples, views in parts:
        share = MS / views
        values |= {
            f"{name}-ms": _statistic(samples, np.median, lambda s, k=share: k * s.wall_s),
            f"{name}-p95-ms": _statistic(
                samples, partial(np.percentile, q=95), lambda s, k=share: k * s.wall_s
            ),
            f"{name}-core-ms": _statistic(samples, np.median, lambda s, k=share: k * s.core_s),
        }
    wall = _cost(measurement, lambda sample: sample.wall_s)
    core = _cost(measurement, lambda sample: sample.core_s)
    costs: dict[str, tuple[int, Callable[[Cost], float]]] = {
        f"picture-of-{views}": (views, partial(Cost.per_image, views=views)) for views in (1, batch)
    }
    costs["further-view"] = batch, lambda cost: cost.further
    for name, (views, of_cost) in costs.items():
        n = values[f"draw-{views}-ms"].n
        for cost, unit in ((wall, "ms"), (core, "core-ms")):
            known = Statistic(MS * of_cost(cost), n) if cost else Statistic(math.nan, 0)
            values[f"{name}-{unit}"] = known
    for name, mib in (("peak-mib", measurement.peak_mib), ("idle-mib", measurement.idle_mib)):
        values[name] = Statistic(math.nan, 0) if mib is None else Statistic(mib, 1)
    return Summary(measurement, values, wall, core)


def speedups(summary: Summary, rival: Summary | None) -> dict[str, Statistic]:
    """Return how many times cheaper an image is than with the rival.

    Empty where one of the two has no cost.
    """
    if rival is None or summary.wall is None or rival.wall is None:
        return {}
    values = {}
    for views in dict.fromkeys((1, summary.wall.batch)):
        ratio = rival.wall.per_image(views) / summary.wall.per_image(views)
        values[f"picture-of-{views}-speedup"] = Statistic(
            ratio, summary.values[f"picture-of-{views}-ms"].n
        )
    return values


def beside(summaries: Iterable[Summary], summary: Summary, method: str) -> Summary | None:
    """Return another method's summary under the same condition, with as many threads."""
    measurement = summary.measurement
    for other in summaries:
        candidate = other.measurement
        if (candidate.method, candidate.condition, candidate.threads) == (
            method,
            measurement.condition,
            measurement.threads,
        ):
            return other
    return None


def _warm(measurement: Measurement, stage: Stage, views: int) -> list[TimingSample]:
    return [s for s in measurement.samples if s.round and (s.stage, s.views) == (stage, views)]


def _statistic(
    samples: Sequence[TimingSample],
    over: Callable[[Any], Any],
    field: Callable[[TimingSample], float],
) -> Statistic:
    return Statistic(
        float(over([field(s) for s in samples])) if samples else math.nan, len(samples)
    )


def _cost(measurement: Measurement, field: Callable[[TimingSample], float]) -> Cost | None:
    batch = measurement.views
    parts: tuple[tuple[Stage, int], ...] = (("prepare", 0), ("draw", 1), ("draw", batch))
    values = [_statistic(_warm(measurement, *part), np.median, field).value for part in parts]
    if not all(map(math.isfinite, values)):
        return None
    prepare, draw_one, all_at_once = values
    return Cost(prepare, draw_one, all_at_once, batch)
