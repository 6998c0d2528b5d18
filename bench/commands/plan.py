"""`bench plan`: what a run costs before it starts, or what is left of it, and what would save."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Annotated

import typer

from bench.catalogue.lookup import find
from bench.catalogue.methods import FLOOR, METHODS, find_method
from bench.catalogue.suites import ALL_SUITES, Suite
from bench.commands.options import RUN_OPTIONS, names, takes
from bench.records.record import GROUND_TRUTH
from bench.running.pilot import (
    Amount,
    Cell,
    Cost,
    Estimate,
    Measurements,
    Pilot,
    Sample,
    estimate,
    half_width,
    measure,
    widest,
)
from bench.running.protocol import Options, Protocol, protocol_of
from bench.running.run import Prospect, look_ahead, refuse_small
from bench.tables.markdown import cell, code, document
from bench.tables.table import BOLD, Block, grid
from bench.tables.table import Cell as TableCell
from data_prep.failures import BadInput
from data_prep.whole_files import write_whole

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
    return document(_blocks(found)).removesuffix("\n")


def _blocks(found: Forecast) -> Iterator[Block]:
    total, wall = found.estimate.total, found.estimate.wall_s
    part = f", shard {found.shard}" if found.shard else ""
    methods = [method for method in found.estimate.methods if method != GROUND_TRUTH]
    yield f"# Plan of {cell(found.suite)} on {cell(found.dataset)}{part}"
    yield (
        f"{found.objects:,} objects x {found.views} views x {found.conditions} conditions x "
        f"{len(methods)} methods: {total.items:,} items to do"
        + (f", {found.there:,} there in {code(found.folder)}" if found.there else "")
        + f". Measured just now on {found.measured} objects with {_workers(found.workers)}; "
        "[95 % intervals]."
    )
    yield grid(
        [
            *("method", "items", "core-s an item", "core-hours", "GPU-hours", "disk, MB"),
            "worker, MiB",
        ],
        [
            *(
                _line(method, cost, cost.method_s if method in found.on_gpu else None)
                for method, cost in found.estimate.methods.items()
            ),
            ["start of workers", "", "", _number(found.starting_s / 3600), NO_VALUE, "", ""],
            _line(TableCell("all", special=BOLD), total, _gpu_s(found)),
        ],
    )
    yield (
        f"With {_workers(found.workers)}: **{_span(wall.value)}**"
        + (f" [{_span(wall.low)}, {_span(wall.high)}]" if math.isfinite(wall.low) else "")
        + ", tables and figures at its end not included; "
        f"memory {found.workers} x {total.peak_mib:,.0f} MiB at most."
    )
    if total.failed:
        yield f"{total.failed} of the pilot's items failed; they are counted as they were."
    if found.savings:
        yield "## What would save"
        yield grid(
            ["instead", "core-hours", "saved", "share", "at what price"],
            (_saving_line(saving, total.core_s.value) for saving in found.savings),
        )
    if found.to_measure:
        yield (
            "What a cheaper method of the same kind would save: `--also` with some of "
            f"{code(','.join(found.to_measure))}."
        )


def _line(name: str | TableCell, cost: Cost, gpu_s: float | None) -> list[str | TableCell]:
    each = cost.core_s.value / cost.items if cost.items else math.nan
    return [
        name,
        f"{cost.items:,}",
        _number(each) if isinstance(name, str) else "",
        _hours(cost.core_s),
        NO_VALUE if gpu_s is None else _number(gpu_s / 3600),
        f"{cost.size_b / 1e6:,.0f}",
        f"{cost.peak_mib:,.0f}" if math.isfinite(cost.peak_mib) else NO_VALUE,
    ]


def _gpu_s(found: Forecast) -> float | None:
    if not found.on_gpu:
        return None
    return sum(found.estimate.methods[method].method_s for method in found.on_gpu)


def _saving_line(saving: Saving, whole_s: float) -> list[str]:
    share = f"{saving.saved_s / whole_s:.0%}" if whole_s > 0 else NO_VALUE
    hours = (_number(seconds / 3600) for seconds in (saving.core_s, saving.saved_s))
    return [saving.what, *hours, share, saving.note]


def _hours(seconds: Amount) -> TableCell:
    value, low, high = (_number(s / 3600) for s in (seconds.value, seconds.low, seconds.high))
    return TableCell(value, interval=(low, high) if math.isfinite(seconds.low) else None)


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


LIMITS = (10, 25, 50, 100, 250, 500, 1000)  # of which the three largest that limit anything
RECONSTRUCTIONS = ("surface-apss", "surface-fit", "surface-bpa", "poisson", "alpha-shape")


@dataclass(frozen=True)
class Wish:
    """Beside what `bench run` takes.

    pilot    objects to measure
    also     methods to measure that the run does not have: what would they save?
    samples  where to keep what was measured, as CSV with the fields of `Sample`; None: nowhere
    """

    pilot: int
    also: tuple[str, ...] = ()
    samples: Path | None = None


def forecast(options: Options, wish: Wish) -> str:
    """The plan of a run, in Markdown.

    Raises BadInput as the run would, for the suites that are not made of items, and as
    `bench.running.pilot.measure`.
    """
    suite = find(options.suite, ALL_SUITES, "suite")
    if not isinstance(suite, Suite):
        raise refuse_small(suite.id, "bench plan")
    for method in wish.also:
        find_method(method)
    if wish.samples is not None and not wish.samples.absolute().parent.is_dir():
        raise BadInput(f"--samples {wish.samples}: its folder is not there; make it first")
    protocol, _ = protocol_of(suite, options)
    prospect = look_ahead(options, protocol)
    if not any(prospect.left.values()):
        return f"{prospect.directory}: nothing is left to do; the run would make its tables."
    methods = tuple(dict.fromkeys((*protocol.methods, *wish.also)))
    found = measure(replace(protocol, methods=methods), wish.pilot, prospect.workers)
    if wish.samples is not None:
        write_samples(wish.samples, found.pilot)
    return to_markdown(_forecast(prospect, found, wish.also))


def write_samples(path: Path, pilot: Pilot) -> None:
    """The pilot's samples as CSV, whole or not at all. Raises OSError where there is no place."""
    text = io.StringIO()
    table = csv.DictWriter(text, [field.name for field in fields(Sample)], lineterminator="\n")
    table.writeheader()
    table.writerows(asdict(sample) for sample in pilot.samples)
    write_whole(path, text.getvalue().encode())


def _forecast(prospect: Prospect, found: Measurements, also: tuple[str, ...]) -> Forecast:
    protocol, left, pilot = prospect.protocol, prospect.left, found.pilot
    whole = estimate(pilot, left, prospect.workers)
    objects = {(s.class_name, s.object_id) for s in pilot.samples}
    return Forecast(
        suite=protocol.suite.id,
        dataset=protocol.dataset,
        shard=str(protocol.shard) if protocol.shard else None,
        folder=str(prospect.directory),
        objects=len(protocol.objects),
        conditions=len(protocol.conditions),
        views=protocol.views,
        there=len(prospect.todo.items) - whole.total.items,
        workers=prospect.workers,
        measured=len(objects),
        estimate=whole,
        starting_s=whole.total.core_s.value
        - sum(c.core_s.value for c in whole.methods.values() if c.items),
        on_gpu=_on_gpu(protocol),
        savings=(
            *_limits(prospect, pilot, whole),
            *_leave_out_dearest(prospect, pilot, whole),
            *_optional(prospect, found, whole),
            *_cheaper(prospect, pilot, whole, also),
        ),
        to_measure=() if also else _kin_to_measure(protocol.methods),
    )


def _on_gpu(protocol: Protocol) -> frozenset[str]:
    """The methods that would draw on a GPU: networks, where there is one and it is not refused."""
    networks = frozenset(m for m in protocol.methods if find_method(m).weights_file is not None)
    if not networks or protocol.device == "cpu":
        return frozenset()
    import torch

    return networks if torch.cuda.is_available() else frozenset()


def _limits(prospect: Prospect, pilot: Pilot, whole: Estimate) -> list[Saving]:
    """Fewer objects. Of a shard nothing: a limit would deal its objects anew."""
    protocol = prospect.protocol
    if protocol.shard is not None:
        return []
    classes = Counter(obj.class_name for obj in protocol.objects)
    savings = []
    for limit in [n for n in LIMITS if n < max(classes.values())][-3:]:
        objects = sum(min(limit, of_class) for of_class in classes.values())
        part = estimate(pilot, prospect.left_of_first(limit), prospect.workers)
        savings.append(_saving(f"--limit {limit}", whole, part, _width(pilot, prospect, objects)))
    return savings


def _width(pilot: Pilot, prospect: Prospect, objects: int) -> str:
    cells = [cell for cell in prospect.left if cell[0] not in (GROUND_TRUTH, FLOOR)]
    cell = widest(pilot, cells)
    if cell is None:
        return ""
    now = half_width(pilot, cell, len(prospect.protocol.objects))
    return (
        f"mean SSIM of {cell[0]} at {cell[1]}, the least certain: about "
        f"±{half_width(pilot, cell, objects):.3f} in place of ±{now:.3f}"
    )


def _leave_out_dearest(prospect: Prospect, pilot: Pilot, whole: Estimate) -> list[Saving]:
    costs = {m: c.core_s.value for m, c in whole.methods.items() if m not in (GROUND_TRUTH, FLOOR)}
    if not costs:
        return []
    dearest = max(costs, key=lambda method: costs[method])
    part = estimate(pilot, _without(prospect.left, dearest), prospect.workers)
    return [_saving(f"without {dearest}", whole, part, "the dearest method")]


def _optional(prospect: Prospect, found: Measurements, whole: Estimate) -> list[Saving]:
    if found.optional_s is None:
        return []
    seconds = found.optional_s * sum(prospect.left.values())
    return [
        Saving(
            "without fid",
            whole.total.core_s.value - seconds,
            seconds,
            "Inception features, taken only where their weights are at hand",
        )
    ]


def _cheaper(
    prospect: Prospect, pilot: Pilot, whole: Estimate, also: tuple[str, ...]
) -> list[Saving]:
    """What was measured beside the run, in place of what it has of the same kind and is dearer."""
    savings = []
    for method in prospect.protocol.methods:
        for other in also:
            if other in prospect.protocol.methods or _kind(other) != _kind(method):
                continue
            left = {
                (other if name == method else name, condition): items
                for (name, condition), items in prospect.left.items()
            }
            part = estimate(pilot, left, prospect.workers)
            if part.total.core_s.value < whole.total.core_s.value:
                savings.append(
                    _saving(f"{other} for {method}", whole, part, _scores(pilot, method, other))
                )
    return savings


def _scores(pilot: Pilot, method: str, other: str) -> str:
    means = []
    for name in (other, method):
        found = [s.ssim for s in pilot.samples if s.method == name and s.ssim is not None]
        if not found:
            return ""
        means.append(sum(found) / len(found))
    return f"mean SSIM in the pilot {means[0]:.3f} in place of {means[1]:.3f}"


def _kin_to_measure(methods: tuple[str, ...]) -> tuple[str, ...]:
    """What there is of the kinds that the run has, and it does not have."""
    kinds = {_kind(method) for method in methods}
    return tuple(m.id for m in METHODS if m.id not in methods and _kind(m.id) in kinds)


def _kind(method: str) -> str:
    """Methods of one kind may stand for each other; variants are of their method's kind."""
    base = method.partition("@")[0]
    return "reconstruction" if base in RECONSTRUCTIONS else base


def _without(left: dict[Cell, int], method: str) -> dict[Cell, int]:
    return {cell: items for cell, items in left.items() if cell[0] != method}


def _saving(what: str, whole: Estimate, part: Estimate, note: str) -> Saving:
    costs = part.total.core_s.value
    return Saving(what, costs, whole.total.core_s.value - costs, note)


@takes(Options, RUN_OPTIONS, leave_out=("fresh", "ray"))
def plan(
    options: Options,
    pilot: Annotated[
        int, typer.Option(help="Objects that are measured now, with all methods and conditions.")
    ] = 6,
    also: Annotated[
        str | None,
        typer.Option(metavar="METHODS", help="Further methods to measure, for what they save."),
    ] = None,
    samples: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Keep what was measured, as CSV.")
    ] = None,
) -> None:
    """What a run costs, or what is left of one: time, disk, memory; and what saves."""
    print(forecast(options, Wish(pilot, names(also) or (), samples)))
