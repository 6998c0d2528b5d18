"""`bench list`: what to choose from, or with --all every suite, method, metric and so on by its id.

It answers at once: no package that is slow to import is loaded, nor a plug-in.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Annotated

import typer

from bench.catalogue.chosen import (
    BEST_CLASSICAL,
    CHOSEN,
    MeasuredMethod,
    cost_of,
    measured_methods,
)
from bench.catalogue.conditions import CONDITIONS
from bench.catalogue.methods import (
    CHOOSE_FOR,
    COST_VARIANTS,
    IMAGES_PREFIX,
    METHODS,
    PARAMETERS,
    RECOMMENDED,
    Method,
    find_method,
)
from bench.catalogue.metrics import METRICS
from bench.catalogue.plugins import plugin_problem
from bench.catalogue.suites import ALL_SUITES, ROBUSTNESS, SUITES
from bench.tables.terminal import ANY_WIDTH, line_width
from data_prep.failures import unknown
from data_prep.plugins import announced

_METHOD_KINDS = {  # the headings in the list of methods, by the kind of the methods below them
    "network": "networks",
    "reconstruction": "reconstructions",
    "splat": "projections",
    "reference": "reference methods",
    "": "of other packages",
}
_METRIC_KINDS = {  # the headings in the list of metrics, by the kind of the metrics below them
    "image": "of an image",
    "further": "of an image, on request",
    "set": "of a set of images",
    "kernel": "of a set of images",
    "recognition": "of a judge",
    "control": "of a judge",
    "surface": "of a mesh, by 'bench surface'",
    "": "of other packages",
}
# Columns of the terminal. A text that would have fewer beside its name is hard to read there, and
# stands below the name instead.
_NARROWEST_TEXT = 36
_OWN_DATASETS = (
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
_ONE_VIEW = "one view: of a new cloud of 2048 points, by results/costs.csv"
Entry = tuple[str, ...]  # a row of a section: a name, then facts, and last a text
# A section: the headings of its columns, its rows, and the notes below them.
_Section = tuple[Sequence[str], Sequence[Entry], Sequence[str]]
SECTIONS = ("suites", "methods", "variants", "conditions", "metrics", "datasets")


def list_all(
    section: Annotated[
        str | None,
        typer.Argument(
            metavar="[SECTION]",
            help=f"The section to list whole: {', '.join(SECTIONS)}. Default: of all sections what "
            "there is to choose from.",
        ),
    ] = None,
    everything: Annotated[
        bool,
        typer.Option("--all", help="List every section whole."),
    ] = False,
) -> None:
    """List the methods to choose from, suites, conditions and metrics; with --all everything."""
    if section is not None and section not in SECTIONS:
        raise unknown(section, SECTIONS, "section", see="bench list --help")
    width = line_width()
    if section is None and not everything:
        print("\n".join(_short_lines(width)))
        return
    for title in SECTIONS if section is None else (section,):
        print("\n".join((f"{title}:", *section_lines(title, width))))


def section_lines(title: str, width: int = ANY_WIDTH) -> list[str]:
    """Return the lines of a whole section, each of at most `width` characters.

    title  one of `SECTIONS`
    """
    if title == "methods":
        heads, entries, notes = _methods(measured_methods())
    elif title == "metrics":
        heads, entries, notes = _metrics([*METRICS])
        notes = ("on request: by 'bench run --metrics' and 'bench score'", *notes)
    else:
        plain = [(f"  {name}", about) for name, about in _plain_entries(title)]
        heads, entries, notes = ("", ""), plain, ()
    return _with_notes(heads, entries, notes, width)


def _short_lines(width: int) -> Iterator[str]:
    """Yield the short list: the methods to choose from, and the metrics that suites measure."""
    costs = measured_methods()
    first = [RECOMMENDED, *(id_ for id_ in CHOOSE_FOR if id_ != RECOMMENDED)]
    methods = [(f"  {id_}", _cost(find_method(id_), costs), CHOOSE_FOR[id_]) for id_ in first]
    methods += [(f"  {id_}", "", _of_package("method", id_)) for id_ in announced("method")]
    shown = {metric for suite in SUITES for metric in suite.metrics}
    yield "suites:"
    yield from section_lines("suites", width)
    yield "methods to choose from:"
    yield from _with_notes(("", "one view", ""), methods, (_ONE_VIEW,), width)
    yield "conditions:"
    yield from section_lines("conditions", width)
    yield "metrics:"
    yield from _with_notes(*_metrics([metric for metric in METRICS if metric in shown]), width)
    others = len(METHODS) - len(CHOOSE_FOR)
    yield from textwrap.wrap(
        f"'bench list --all' has {others} more methods, their variants, the metrics on request and "
        "the datasets; 'bench list methods' has all methods",
        width,
    )


def _with_notes(
    heads: Sequence[str], entries: Sequence[Entry], notes: Sequence[str], width: int
) -> list[str]:
    lines = list(_lines(heads, entries, width))
    for note in notes:
        lines += textwrap.wrap(note, width)
    return lines


def _lines(heads: Sequence[str], entries: Sequence[Sequence[str]], width: int) -> Iterator[str]:
    """Yield the lines of a table of entries, each of at most `width` characters.

    Where facts and text have no room beside the name, they stand below it. The library rich would
    lay this out, but its import takes longer than the whole command.
    """
    *fixed, _ = zip(heads, *entries, strict=True)
    widths = [max(map(len, column)) for column in fixed]
    margin = sum(widths) + 2 * len(widths)
    if width < margin + _NARROWEST_TEXT:
        for name, *facts, about in entries:
            told = [f"{head} {fact}" for head, fact in zip(heads[1:], facts, strict=False) if fact]
            yield from textwrap.wrap(name, width)
            text = "; ".join((*told, about)) if about else ""
            yield from textwrap.wrap(text, width, initial_indent="    ", subsequent_indent="    ")
        return
    rows = [heads, *entries] if any(heads) else entries
    for *facts, about in rows:
        start = "".join(f"{fact:<{size}}  " for fact, size in zip(facts, widths, strict=True))
        first, *others = textwrap.wrap(about, width - margin) or [""]
        yield f"{start}{first}".rstrip()
        yield from (" " * margin + line for line in others)


def _plain_entries(title: str) -> list[tuple[str, str]]:
    if title == "suites":
        return [(suite.id, suite.about) for suite in ALL_SUITES]
    if title == "variants":
        variants = [
            (f"{p.method}@{p.name}=", f"{p.low:g} to {p.high:g}: {p.about}") for p in PARAMETERS
        ]
        variants += [(method.id, method.source) for method in COST_VARIANTS]
        return variants
    if title == "conditions":
        conditions = [(condition.id, condition.source) for condition in CONDITIONS]
        conditions += [(id_, _of_package("condition", id_)) for id_ in announced("condition")]
        return conditions
    others = ((f"{id_}:PATH", _of_package("dataset", id_)) for id_ in announced("dataset"))
    return [*_OWN_DATASETS, *others]


def _methods(costs: Mapping[str, MeasuredMethod]) -> _Section:
    """Return the methods by kind, with what they were trained on, their colours and their cost."""
    best = CHOSEN[BEST_CLASSICAL]
    chosen = sorted({*best.best(best.ranking, [m.id for m in METHODS]).values()})
    rows = [
        (m.kind, m.id, m.trained_on or "unknown", m.color or "unknown", _cost(m, costs), m.source)
        for m in METHODS
    ]
    rows += [("", id_, "", "", "", _of_package("method", id_)) for id_ in announced("method")]
    notes = (
        "* to choose from, see 'bench list'",
        f"'{BEST_CLASSICAL}' is one of {', '.join(chosen)}, by metric and condition",
        f"{IMAGES_PREFIX}TREE: a method that was run elsewhere, by its images of an export "
        "(docs/extending.md)",
        f"{_ONE_VIEW}; ~: as another of its family, of the same size",
    )
    heads = ("", "trained on", "colour", "one view", "")
    return heads, _by_kind(rows, _METHOD_KINDS, [*CHOOSE_FOR]), notes


def _cost(method: Method, costs: Mapping[str, MeasuredMethod]) -> str:
    cost = cost_of(method.id, costs)
    if cost is None:
        return "-"
    ms = cost.one_view_ms
    number = f"{ms:.0f}" if ms >= 100 else f"{ms:.3g}"
    # The mark is explained below the list: the cost is that of another method of the family.
    mark = "" if method.id in costs else "~"
    return f"{mark}{number} ms"


def _metrics(names: Sequence[str]) -> _Section:
    """Return the metrics, grouped by what they measure, and whether higher or lower is better."""
    metrics = [METRICS[name] for name in names]
    rows = [(m.kind, m.id, "higher" if m.higher else "lower", m.about) for m in metrics]
    rows += [
        ("", id_, "", _of_package("metric", id_, "; see 'bench score'"))
        for id_ in announced("metric")
    ]
    notes = ("* of the headline table and 'bench compare'",)
    return ("", "better", ""), _by_kind(rows, _METRIC_KINDS, ROBUSTNESS.headline), notes


def _by_kind(
    rows: Sequence[Entry], heads: Mapping[str, str], starred: Sequence[str]
) -> list[Entry]:
    """Return the entries of rows, grouped under the headings of their kinds.

    rows     each with its kind first, then the name, facts and a text; sorted by kind
    heads    the heading by kind
    starred  the names that get an asterisk
    """
    entries: list[Entry] = []
    for head, members in groupby(rows, key=lambda row: heads[row[0]]):
        entries.append((f" {head}", *[""] * len(rows[0][2:])))
        for _, name, *facts in members:
            entries.append((f"{'*' if name in starred else ' '} {name}", *facts))
    return entries


def _of_package(kind: str, id_: str, use: str = "") -> str:
    problem = plugin_problem(kind, id_)
    return f"refused: {problem}" if problem else f"of another installed package{use}"
