"""`bench plan`: what a run costs before it starts, or what is left of it, and what would save."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from bench.catalogue.lookup import family_of, find
from bench.catalogue.methods import FLOOR, METHODS, find_method, known_method
from bench.catalogue.suites import ALL_SUITES, Suite
from bench.commands.options import RUN_OPTIONS, names, options_from_dataclass
from bench.records.record import GROUND_TRUTH
from bench.running.options import Options
from bench.running.pilot import (
    Amount,
    Pilot,
    Sample,
    core_s,
    estimate,
    loading_s,
    measure,
    peak_mib,
    ssim_deviations,
)
from bench.running.pilot import Cell as FrontierPoint
from bench.running.protocol import Protocol, find_methods, protocol_of
from bench.running.status import RunStatus, refuse_small, run_status
from bench.tables.grid import BOLD, Block, Cell, grid, number
from bench.tables.markdown import cell, code, document
from bench.tables.table import Table, columns
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole

LIMITS = (10, 25, 50, 100, 250, 500, 1000)  # of which the three largest that limit anything
NO_VALUE = "-"


def forecast(
    options: Options, objects: int, also: tuple[str, ...] = (), samples: Path | None = None
) -> str:
    """The plan of a run, in Markdown.

    objects  to measure
    also     methods to measure that the run does not have: what would they save?
    samples  where to keep what was measured, as CSV with the fields of `Sample`; None: nowhere

    Raises BadInput as the run would, for the suites that are not made of items, and as
    `bench.running.pilot.measure`.
    """
    suite = find(options.suite, ALL_SUITES, "suite")
    if not isinstance(suite, Suite):
        raise refuse_small(suite.id, "bench plan")
    for method in also:
        find_method(method)
    if samples is not None and not samples.absolute().parent.is_dir():
        raise BadInput(f"--samples {samples}: its folder is not there; make it first")
    run = run_status(options, protocol_of(suite, options)[0])
    protocol = run.protocol
    if not any(run.left.values()):
        return f"{run.directory}: nothing is left to do; the run would make its tables."
    methods = tuple(dict.fromkeys((*protocol.methods, *also)))
    pilot = measure(replace(protocol, methods=find_methods(methods)), objects, run.workers)
    if samples is not None:
        names_of_fields = (field.name for field in fields(Sample))
        table = Table("samples", "", columns(*names_of_fields, digits=""), pilot.samples)
        write_whole(samples, table.to_csv().encode())
    return document(plan_of(run, pilot, also)).removesuffix("\n")


def plan_of(run: RunStatus, pilot: Pilot, also: tuple[str, ...] = ()) -> Iterator[Block]:
    """Headline, a table by method, wall time and memory, and what would save."""
    protocol, left = run.protocol, run.jobs_left
    total = core_s(pilot, left, run.workers)
    items = sum(run.left.values()) - run.left[GROUND_TRUTH, ""]
    there = len(run.plan.method_jobs) - items
    measured = {(s.class_name, s.object_id) for s in pilot.samples}
    workers = "one worker" if run.workers == 1 else f"{run.workers} workers"
    shard = f", shard {protocol.shard}" if protocol.shard else ""
    yield f"# Plan of {cell(protocol.suite.id)} on {cell(protocol.dataset)}{shard}"
    yield (
        f"{len(protocol.objects):,} objects x {protocol.views} views x "
        f"{len(protocol.conditions)} conditions x {len(protocol.methods)} methods: "
        f"{items:,} items to do"
        + (f", {there:,} there in {code(str(run.directory))}" if there else "")
        + f". Measured just now on {len(measured)} objects with {workers}; [95 % intervals]."
    )
    on_gpu = _on_gpu(protocol)
    starting = loading_s(pilot, left, run.workers)
    yield grid(
        ["method", "jobs", "core-s a job", "core-hours", "GPU-hours", "disk, MB", "worker, MiB"],
        [
            *(
                _line(method, pilot, _only(left, (method,)), method in on_gpu)
                for method in (GROUND_TRUTH, *protocol.methods)
            ),
            ["start and loading", "", "", _digits(starting / 3600), NO_VALUE, "", ""],
            [
                Cell("all", special=BOLD),
                f"{sum(left.values()) - left[GROUND_TRUTH, '']:,}",
                "",
                _hours(total),
                _gpu_hours(pilot, _only(left, on_gpu)) if on_gpu else NO_VALUE,
                _megabytes(pilot, left),
                _mebibytes(pilot, left),
            ],
        ],
    )
    busy = min(run.workers, sum(left.values()))
    wall, low, high = (_span(seconds / busy) for seconds in total)
    yield (
        f"With {workers}: **{wall}**"
        + (f" [{low}, {high}]" if math.isfinite(total.low) else "")
        + ", tables and figures at its end not included; "
        f"memory {run.workers} x {_mebibytes(pilot, left)} MiB at most."
    )
    if failed := sum(bool(s.reason) for s in pilot.samples if (s.method, s.condition) in left):
        yield f"{failed} of the pilot's items failed; they are counted as they were."
    if savings := list(_savings(run, pilot, also, total.value)):
        yield "## What would save"
        yield grid(
            ["instead", "core-hours", "saved", "share", "at what price"],
            ([what, *_saved(seconds, total.value), price] for what, seconds, price in savings),
        )
    kinds = {_kind(method) for method in protocol.methods}
    related = [m.id for m in METHODS if m.id not in protocol.methods and _kind(m.id) in kinds]
    if related and not also:
        yield (
            "What a cheaper method of the same kind would save: `--also` with some of "
            f"{code(','.join(related))}."
        )


def _line(
    method: str, pilot: Pilot, left: Mapping[FrontierPoint, int], on_gpu: bool
) -> list[str | Cell]:
    items, seconds = sum(left.values()), estimate(pilot, left)
    return [
        method,
        f"{items:,}",
        _digits(seconds.value / items) if items else NO_VALUE,
        _hours(seconds),
        _gpu_hours(pilot, left) if on_gpu else NO_VALUE,
        _megabytes(pilot, left),
        _mebibytes(pilot, left),
    ]


def _hours(seconds: Amount) -> Cell:
    return number(seconds, lambda value: _digits(value / 3600))


def _gpu_hours(pilot: Pilot, left: Mapping[FrontierPoint, int]) -> str:
    return _digits(estimate(pilot, left, "method_s").value / 3600)


def _megabytes(pilot: Pilot, left: Mapping[FrontierPoint, int]) -> str:
    value = estimate(pilot, left, "size_b").value
    return f"{value / 1e6:,.0f}" if math.isfinite(value) else NO_VALUE


def _mebibytes(pilot: Pilot, left: Mapping[FrontierPoint, int]) -> str:
    value = peak_mib(pilot, left)
    return f"{value:,.0f}" if math.isfinite(value) else NO_VALUE


def _saved(seconds: float, whole: float) -> list[str]:
    share = f"{(whole - seconds) / whole:.0%}" if whole > 0 else NO_VALUE
    return [_digits(seconds / 3600), _digits((whole - seconds) / 3600), share]


def _digits(value: float) -> str:
    """To two or three digits; no exponent."""
    if not math.isfinite(value):
        return NO_VALUE
    if abs(value) >= 100:
        return f"{value:,.0f}"
    digits = 2 if abs(value) < 10 else 3
    return np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")


def _span(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def _only(left: Mapping[FrontierPoint, int], methods: tuple[str, ...]) -> dict[FrontierPoint, int]:
    return {place: items for place, items in left.items() if place[0] in methods}


def _on_gpu(protocol: Protocol) -> tuple[str, ...]:
    """The methods that would draw on a GPU: networks, where there is one and it is not refused."""
    networks = tuple(m for m in protocol.methods if find_method(m).weights_file is not None)
    if not networks or protocol.device == "cpu":
        return ()
    import torch

    return networks if torch.cuda.is_available() else ()


# --- what would save ------------------------------------------------------------------------------


def _savings(
    run: RunStatus, pilot: Pilot, also: tuple[str, ...], whole: float
) -> Iterator[tuple[str, float, str]]:
    """Changes of the run, the seconds of a core that it would take with them, and their price."""
    protocol, left = run.protocol, run.jobs_left
    if protocol.shard is None:  # a limit would distribute the objects of a shard anew
        classes = Counter(obj.class_name for obj in protocol.objects)
        for limit in [n for n in LIMITS if n < max(classes.values())][-3:]:
            objects = sum(min(limit, of_class) for of_class in classes.values())
            first = core_s(pilot, run.left_of_first(limit), run.workers)
            yield f"--limit {limit}", first.value, _certainty(run, pilot, objects)
    costs = {m: estimate(pilot, _only(left, (m,))).value for m in protocol.methods if m != FLOOR}
    if costs:
        expensive = max(costs, key=lambda method: costs[method])
        others = {place: items for place, items in left.items() if place[0] != expensive}
        rest = core_s(pilot, others, run.workers)
        yield f"without {expensive}", rest.value, "the most expensive method"
    optional = [s.optional_s for s in pilot.samples if s.optional_s is not None]
    if optional:
        saved = sum(left.values()) * sum(optional) / len(optional)
        price = "Inception features, taken only where their weights are at hand"
        yield "without fid", whole - saved, price
    for method in protocol.methods:
        for other in also:
            if other in protocol.methods or _kind(other) != _kind(method):
                continue
            swapped = {
                (other if name == method else name, condition): items
                for (name, condition), items in left.items()
            }
            seconds = core_s(pilot, swapped, run.workers).value
            if seconds < whole:
                yield f"{other} for {method}", seconds, _scores(pilot, method, other)


def _certainty(run: RunStatus, pilot: Pilot, objects: int) -> str:
    """How wide the 95 % interval of a mean SSIM over so many objects is, of the least certain."""
    places = [place for place in run.left if place[0] not in (GROUND_TRUTH, FLOOR)]
    deviations = ssim_deviations(pilot, places)
    if not deviations:
        return ""
    method, condition = least = max(deviations, key=lambda place: deviations[place])
    then, now = (
        1.96 * deviations[least] / math.sqrt(count)
        for count in (objects, len(run.protocol.objects))
    )
    return (
        f"mean SSIM of {method} at {condition}, the least certain: about "
        f"±{then:.3f} in place of ±{now:.3f}"
    )


def _scores(pilot: Pilot, method: str, other: str) -> str:
    means = []
    for name in (other, method):
        found = [s.ssim for s in pilot.samples if s.method == name and s.ssim is not None]
        if not found:
            return ""
        means.append(sum(found) / len(found))
    return f"mean SSIM in the pilot {means[0]:.3f} in place of {means[1]:.3f}"


def _kind(method: str) -> str:
    """Return the kind of a method: those of one kind may stand for each other.

    Variants are of their method's kind.
    """
    family = family_of(method)
    known = known_method(family)
    return "reconstruction" if known and known.kind == "reconstruction" else family


@options_from_dataclass(Options, RUN_OPTIONS, leave_out=("fresh", "ray", "budget"))
def plan(
    options: Options,
    pilot: Annotated[
        int, typer.Option(help="Objects measured now, with all methods and conditions.")
    ] = 6,
    also: Annotated[
        str | None,
        typer.Option(
            metavar="METHODS",
            help="Further methods to measure, comma-separated, for what they save. Default: none.",
        ),
    ] = None,
    samples: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="CSV file for the measured times. Default: not kept."),
    ] = None,
) -> None:
    """Estimate time, disk and memory of a run, or of the rest of one, and what saves."""
    print(forecast(options, pilot, names(also) or (), samples))
