"""`bench list`: suites, methods, conditions, metrics and datasets by their ids.

It answers at once: no package that is slow to import is loaded, nor a plug-in.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import typer

from bench.catalogue.chosen import (
    BEST_RECONSTRUCTION,
    CHOSEN,
    MeasuredMethod,
    cost_of,
    measured_methods,
)
from bench.catalogue.conditions import condition_ids
from bench.catalogue.lookup import unknown
from bench.catalogue.method import IMAGES, Method
from bench.catalogue.methods import COST_VARIANTS, METHODS, PARAMETERS, RECOMMENDED, plugin_ids
from bench.catalogue.metrics import (
    CONTROL_METRICS,
    FURTHER_METRICS,
    IMAGE_METRICS,
    KERNEL_METRICS,
    METRICS,
    RECOGNITION_METRICS,
    SET_METRICS,
)
from bench.catalogue.plugins import metric_ids, plugin_problem
from bench.catalogue.suites import ALL_SUITES, ROBUSTNESS
from bench.tables.wrap import line_width, wrapped
from data_prep.clouds.conditions import CONDITIONS
from data_prep.plugins import DATASETS, entry_point_names

KINDS = {  # of methods, with the heads of their sections
    "network": "networks",
    "reconstruction": "reconstructions",
    "splat": "projections",
    "reference": "reference methods",
}
NAME, FACT = 25, 10  # columns of a name, of a fact about it
NARROWEST_TEXT = 36  # columns: beside its name a text of fewer is hard to read
BELOW = " " * 4
OWN_DATASETS = (
    ("procedural", "parametric shapes, without a download (the default); test split"),
    ("procedural:validation", "parametric shapes, the split for making choices"),
    ("procedural:sealed", "parametric shapes, the split for final numbers: choose nothing by it"),
    ("procedural:novel-families", "chairs of structures that no other split has"),
    ("procedural:widened", "for training: shapes that vary more than their classes do"),
    ("procedural:relief", "for training: widened shapes with relief, and free closed forms"),
    ("folder:PATH", "your meshes; sub-folders are classes"),
    ("shapenet:PATH", "ShapeNetCore v1 or v2, split by all.csv if it has that file"),
    ("modelnet:PATH", "ModelNet10 or 40, split by folders or by lists"),
    ("exported:PATH", "a folder of 'bench data export': clouds, views and true images"),
    ("paper:PATH", "clouds, 20 images of each and their cameras, as the paper's code has them"),
)
SECTIONS = ("suites", "methods", "variants", "conditions", "metrics", "datasets")


def list_all(
    section: Annotated[
        str | None,
        typer.Argument(
            metavar="[SECTION]", help=f"One of {', '.join(SECTIONS)}. Default: all of them."
        ),
    ] = None,
) -> None:
    """List suites, methods and their variants, conditions, metrics and datasets."""
    if section is not None and section not in SECTIONS:
        raise unknown(section, SECTIONS, "section", see="bench list --help")
    width = line_width()
    for title in SECTIONS if section is None else (section,):
        print(f"{title}:")
        for line in section_lines(title, width):
            print(line)


def section_lines(title: str, width: int = 0) -> Iterator[str]:
    """Yield the lines of a section, wrapped to `width` columns; 0: a line for each entry."""
    if title == "methods":
        yield from _methods(width, measured_methods())
    elif title == "metrics":
        yield from _metrics(width)
    else:
        for name, about in _plain_entries(title):
            yield from _lines(_Entry(name, about), width)


def _plain_entries(title: str) -> list[tuple[str, str]]:
    if title == "suites":
        return [(suite.id, suite.about) for suite in ALL_SUITES]
    if title == "variants":
        ranges = (
            (f"{p.method}@{p.name}=", f"{p.low:g} to {p.high:g}: {p.about}") for p in PARAMETERS
        )
        return [*ranges, *((method.id, method.source) for method in COST_VARIANTS)]
    if title == "conditions":
        others = [(id_, _of_package("condition", id_)) for id_ in condition_ids()]
        return [*((condition.id, condition.source) for condition in CONDITIONS), *others]
    others = ((f"{id_}:PATH", _of_package("dataset", id_)) for id_ in entry_point_names(DATASETS))
    return [*OWN_DATASETS, *others]


def _methods(width: int, costs: Mapping[str, MeasuredMethod]) -> Iterator[str]:
    """Yield the methods by kind, with what they were trained on, their colours and their cost."""
    conditions, methods = [c.id for c in CONDITIONS], [m.id for m in METHODS]
    chosen = sorted({*CHOSEN[BEST_RECONSTRUCTION].by_condition(conditions, methods).values()})
    heads = ("trained on", "colour", *["one view"] * bool(costs))
    yield from _heads(heads, width)
    for kind, head in KINDS.items():
        yield from wrapped(head, width, " ", " ")
        for method in (method for method in METHODS if method.kind == kind):
            facts = [method.trained_on or "unknown", method.color or "unknown"]
            facts += [_cost(method, costs)] * bool(costs)
            star = method.id == RECOMMENDED or method.id in chosen
            entry = _Entry(method.id, method.source, tuple(zip(heads, facts, strict=True)), star)
            yield from _lines(entry, width)
    if others := plugin_ids():
        yield from wrapped("of other packages", width, " ", " ")
        for id_ in others:
            yield from _lines(_Entry(id_, _of_package("method", id_)), width)
    yield from wrapped(
        f"* recommended: {RECOMMENDED} for objects of any kind; '{BEST_RECONSTRUCTION}' is one of "
        f"{', '.join(chosen)}, by condition",
        width,
    )
    yield from wrapped(
        f"{IMAGES}TREE: a method that was run elsewhere, by its images of an export "
        "(docs/entering.md)",
        width,
    )
    if costs:
        yield from wrapped(
            "one view: of a new cloud of 2048 points, by results/costs.csv; ~: as "
            "another of its family, of the same size",
            width,
        )


def _cost(method: Method, costs: Mapping[str, MeasuredMethod]) -> str:
    cost = cost_of(method.id, costs)
    if cost is None:
        return "-"
    ms = cost.one_view_ms
    number = f"{ms:.0f}" if ms >= 100 else f"{ms:.3g}"
    return "~" * (method.id not in costs) + f"{number} ms"


def _metrics(width: int) -> Iterator[str]:
    """Yield the metrics by what they are taken of, and which way is better."""
    sections = {
        "of an image": IMAGE_METRICS,
        "of an image, on request: 'bench run --metrics' and 'bench score'": FURTHER_METRICS,
        "of a set of images": SET_METRICS + KERNEL_METRICS,
        "of a judge": RECOGNITION_METRICS + CONTROL_METRICS,
    }
    yield from _heads(("better",), width)
    for head, metrics in sections.items():
        yield from wrapped(head, width, " ", " ")
        for metric in (METRICS[name] for name in metrics):
            better = ("better", "higher" if metric.higher else "lower")
            star = metric.id in ROBUSTNESS.headline
            yield from _lines(_Entry(metric.id, metric.about, (better,), star), width)
    if others := metric_ids():
        yield from wrapped("of other packages", width, " ", " ")
        for id_ in others:
            yield from _lines(_Entry(id_, _of_package("metric", id_, "; see 'bench score'")), width)
    yield from wrapped("* of the headline table, 'bench compare' and 'bench recommend'", width)


@dataclass(frozen=True)
class _Entry:
    """A name with a text about it, facts with their heads, and whether it has a star."""

    name: str
    about: str
    facts: tuple[tuple[str, str], ...] = ()
    star: bool = False


def _lines(entry: _Entry, width: int) -> list[str]:
    """Return an entry on one line, its text below where it has no room beside, or all stacked."""
    start = f"{'*' if entry.star else ' '} {entry.name:<{NAME}} "
    columns = start + "".join(f"{text:<{FACT}}  " for _, text in entry.facts)
    if not width:
        return [columns + entry.about]
    if width >= len(columns) + NARROWEST_TEXT:
        return wrapped(entry.about, width, columns, " " * len(columns))
    if width >= len(columns) and entry.facts:
        return [columns.rstrip(), *wrapped(entry.about, width, BELOW, BELOW)]
    facts = "; ".join(f"{head} {text}" for head, text in entry.facts)
    return [
        *wrapped(entry.name, width, start[:2], BELOW),
        *wrapped(facts, width, BELOW, BELOW),
        *wrapped(entry.about, width, BELOW, BELOW),
    ]


def _heads(heads: Sequence[str], width: int) -> list[str]:
    """Return the line of heads above the facts of entries; none where these are stacked."""
    line = " " * (NAME + 3) + "".join(f"{head:<{FACT}}  " for head in heads)
    return [line.rstrip()] if not width or width >= len(line) else []


def _of_package(kind: str, id_: str, use: str = "") -> str:
    problem = plugin_problem(kind, id_)
    return f"refused: {problem}" if problem else f"of another installed package{use}"
