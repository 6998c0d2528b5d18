"""The plan of a run as Markdown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from bench.records.record import GROUND_TRUTH
from bench.running.estimate import Amount, Cost, Estimate
from bench.tables.markdown import cell, code, row

NO_VALUE = "–"


@dataclass(frozen=True)
class Saving:
    """What a change of the run would leave to do and save, in seconds of a core; what it costs."""

    what: str
    core_s: float
    saved_s: float
    note: str


@dataclass(frozen=True)
class Forecast:
    """All that the text says.

    shard       as in --shard; None: the whole
    there       items done before
    measured    objects of the pilot
    starting_s  seconds of all workers until their first job
    on_gpu      methods that would draw on a GPU
    to_measure  methods that could stand for some of the run's
    """

    suite: str
    dataset: str
    shard: str | None
    folder: str
    objects: int
    conditions: int
    views: int
    there: int
    workers: int
    measured: int
    estimate: Estimate
    starting_s: float
    on_gpu: frozenset[str]
    savings: Sequence[Saving]
    to_measure: Sequence[str]


def to_markdown(found: Forecast) -> str:
    """Headline, a table by method, wall time and memory, and what would save."""
    total, wall = found.estimate.total, found.estimate.wall_s
    part = f", shard {found.shard}" if found.shard else ""
    methods = [method for method in found.estimate.methods if method != GROUND_TRUTH]
    lines = [
        f"# Plan of {cell(found.suite)} on {cell(found.dataset)}{part}",
        "",
        f"{found.objects:,} objects x {found.views} views x {found.conditions} conditions x "
        f"{len(methods)} methods: {total.items:,} items to do"
        + (f", {found.there:,} there in {code(found.folder)}" if found.there else "")
        + f". Measured just now on {found.measured} objects with {_workers(found.workers)}; "
        "[95 % intervals].",
        "",
        row(
            [
                "method",
                "items",
                "core-s an item",
                "core-hours",
                "GPU-hours",
                "disk, MB",
                "worker, MiB",
            ]
        ),
        "|---" * 7 + "|",
        *(
            _line(cell(method), cost, method in found.on_gpu)
            for method, cost in found.estimate.methods.items()
        ),
        row(["start of workers", "", "", _number(found.starting_s / 3600), NO_VALUE, "", ""]),
        _line("**all**", total, False, _gpu_s(found)),
        "",
        f"With {_workers(found.workers)}: **{_span(wall.value)}**"
        + (f" [{_span(wall.low)}, {_span(wall.high)}]" if math.isfinite(wall.low) else "")
        + ", tables and figures at its end not included; "
        f"memory {found.workers} x {total.peak_mib:,.0f} MiB at most.",
    ]
    if total.failed:
        lines += ["", f"{total.failed} of the pilot's items failed; they are counted as they were."]
    if found.savings:
        lines += [
            "",
            "## What would save",
            "",
            row(["instead", "core-hours", "saved", "share", "at what price"]),
            "|---" * 5 + "|",
            *(_saving(saving, total.core_s.value) for saving in found.savings),
        ]
    if found.to_measure:
        lines += [
            "",
            "What a cheaper method of the same kind would save: `--also` with some of "
            f"{code(','.join(found.to_measure))}.",
        ]
    return "\n".join(lines)


def _line(name: str, cost: Cost, on_gpu: bool, gpu_s: float | None = None) -> str:
    gpu_s = cost.method_s if on_gpu else gpu_s
    each = cost.core_s.value / cost.items if cost.items else math.nan
    return row(
        [
            name,
            f"{cost.items:,}",
            _number(each) if name != "**all**" else "",
            _hours(cost.core_s),
            NO_VALUE if gpu_s is None else _number(gpu_s / 3600),
            f"{cost.size_b / 1e6:,.0f}",
            f"{cost.peak_mib:,.0f}" if math.isfinite(cost.peak_mib) else NO_VALUE,
        ]
    )


def _gpu_s(found: Forecast) -> float | None:
    if not found.on_gpu:
        return None
    return sum(found.estimate.methods[method].method_s for method in found.on_gpu)


def _saving(saving: Saving, whole_s: float) -> str:
    share = f"{saving.saved_s / whole_s:.0%}" if whole_s > 0 else NO_VALUE
    hours = [_number(seconds / 3600) for seconds in (saving.core_s, saving.saved_s)]
    return row([cell(saving.what), *hours, share, cell(saving.note)])


def _hours(seconds: Amount) -> str:
    value, low, high = (_number(s / 3600) for s in (seconds.value, seconds.low, seconds.high))
    return f"{value} [{low}, {high}]" if math.isfinite(seconds.low) else value


def _number(value: float) -> str:
    """To two or three digits; no exponent."""
    if not math.isfinite(value):
        return NO_VALUE
    if abs(value) >= 100:
        return f"{value:,.0f}"
    return f"{value:.2g}" if abs(value) < 10 else f"{value:.3g}"


def _span(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def _workers(count: int) -> str:
    return "one worker" if count == 1 else f"{count} workers"
