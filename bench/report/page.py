"""The page of a report: what it shows, as plain values, and how these become one HTML file.

Nothing here knows of runs or files. All text is escaped by the template, so that names and reasons
may hold anything.
"""

from __future__ import annotations

import base64
import hashlib
from dataclasses import dataclass
from functools import cache
from importlib import resources
from itertools import groupby
from typing import TYPE_CHECKING, Any

from bench.tables.grid import ANY, Tags
from bench.tables.grid import Grid as NumberTable
from bench.tables.markdown import visible

if TYPE_CHECKING:
    from jinja2 import Environment


@dataclass(frozen=True)
class TableGroup:
    """Tables under one heading, at first folded or not."""

    title: str
    remark: str
    tables: tuple[NumberTable, ...]
    unfolded: bool = False


@dataclass(frozen=True)
class Svg:
    """The inner part of an SVG of `width` x `height` units; trusted, all text in it is escaped."""

    width: float
    height: float
    inside: str


@dataclass(frozen=True)
class Plot:
    """A figure.

    axis         what is measured, and whether more of it is better
    description  all of it in words, for those who do not see it
    wide         whether it takes the whole width of the page
    """

    title: str
    axis: str
    description: str
    svg: Svg
    wide: bool = False
    tags: Tags = ANY


@dataclass(frozen=True)
class LegendEntry:
    """A method in the legend of a group of plots, with its line and marker."""

    method: str
    symbol: Svg


@dataclass(frozen=True)
class PlotGroup:
    """Plots with one legend; all beyond the first `unfolded` are folded."""

    legend: tuple[LegendEntry, ...]
    plots: tuple[Plot, ...]
    unfolded: int


@dataclass(frozen=True)
class Statement:
    """A line of the answer; `entries` are (methods, text that follows their names)."""

    term: str
    entries: tuple[tuple[tuple[str, ...], str], ...]


@dataclass(frozen=True)
class CompactColumn:
    """A column of the headline table: a metric at a condition, which `words` name in full."""

    metric: str
    kind: str
    short: str
    words: str
    higher: bool
    tags: Tags


@dataclass(frozen=True)
class CompactCell:
    """A value of the headline table.

    about  what the value is, with its interval
    best   whether it is the best of its column, of the methods that compete
    below  whether it is worse than that of a white image
    """

    text: str
    value: float | None
    about: str
    best: bool = False
    below: bool = False


@dataclass(frozen=True)
class CompactTable:
    """The headline table; `lines` are (method, role, tags, cells).

    failed  whether images of any cell failed
    coarse  whether any value has fewer digits than its metric
    """

    columns: tuple[CompactColumn, ...]
    lines: tuple[tuple[str, str, Tags, tuple[CompactCell, ...]], ...]
    failed: bool
    coarse: bool = False

    @property
    def groups(self) -> tuple[tuple[str, bool, int], ...]:
        """Return the metrics with their directions and numbers of columns."""
        groups = groupby(self.columns, key=lambda column: (column.metric, column.higher))
        return tuple((*key, len(list(of_key))) for key, of_key in groups)


@dataclass(frozen=True)
class PageImage:
    """An image as a data URI, with what it shows in words; `uri` is empty where there is none."""

    uri: str
    description: str


@dataclass(frozen=True)
class GridCell:
    """An image of a grid, and what stands beneath it."""

    image: PageImage
    beneath: str = ""
    counted: bool = False


@dataclass(frozen=True)
class Grid:
    """Images of one object from one view: heads are (name, tags)."""

    title: str
    description: str
    corner: str
    columns: tuple[tuple[str, Tags], ...]
    rows: tuple[tuple[str, Tags, tuple[GridCell, ...]], ...]
    tags: Tags


@dataclass(frozen=True)
class Case:
    """A single record with its images: the cloud, the truth, what was drawn."""

    kind: str
    score: str
    name: str
    facts: tuple[tuple[str, str], ...]
    images: tuple[tuple[str, PageImage], ...]
    tags: Tags


@dataclass(frozen=True)
class CaseGroup:
    """The cases of one method; `rows` are (title, tags, cases)."""

    method: str
    summary: str
    rows: tuple[tuple[str, Tags, tuple[Case, ...]], ...]


@dataclass(frozen=True)
class Failure:
    """One method on one cloud that gave no images."""

    name: str
    views: str
    tags: Tags


@dataclass(frozen=True)
class FailureGroup:
    """Failures for the same reason; `more` were not listed."""

    reason: str
    count: str
    failures: tuple[Failure, ...]
    more: int


@dataclass(frozen=True)
class Choice:
    """One of the filters: the data attribute that it goes by, and what can be chosen."""

    key: str
    title: str
    options: tuple[str, ...]


@dataclass(frozen=True)
class Page:
    """All that a report shows.

    head        what was run, in a few words each: objects, methods, time
    quality     metric of the images and cases
    jobs        number of jobs, and how many of them failed
    facts       (term, description) of how it was run
    outcomes    (outcome, number of images)
    shares      (part of the workers' time, 0..1)
    answer      the run in a few lines
    headline    the table beside the answer; None without a value
    first       plots of the headline metrics
    curves      plots of the other metrics, or along families of conditions
    unseen      why images are missing, one sentence each
    skipped     (metric, reason)
    meanings    (title, ((term, description), ...))
    """

    title: str
    about: str
    head: tuple[str, ...]
    quality: str
    jobs: tuple[int, int]
    facts: tuple[tuple[str, str], ...]
    outcomes: tuple[tuple[str, int], ...]
    shares: tuple[tuple[str, float], ...]
    choices: tuple[Choice, ...]
    answer: tuple[Statement, ...]
    headline: CompactTable | None
    first: PlotGroup
    curves: PlotGroup
    curves_title: str
    curves_remark: str
    tables: tuple[TableGroup, ...]
    costs: PlotGroup
    cost_table: NumberTable | None
    cost_remark: str
    grids: tuple[Grid, ...]
    cases: tuple[CaseGroup, ...]
    unseen: tuple[str, ...]
    failures: tuple[FailureGroup, ...]
    failed_images: int
    skipped: tuple[tuple[str, str], ...]
    command: str
    manifest: tuple[str, ...]
    meanings: tuple[tuple[str, tuple[tuple[str, str], ...]], ...]

    @property
    def glossary(self) -> dict[str, tuple[str, str]]:
        """Return the id and the meaning of each term."""
        return {
            term: (f"{title.lower()}-{number}", meaning)
            for title, entries in self.meanings
            for number, (term, meaning) in enumerate(entries)
        }


def html(page: Page) -> str:
    """Return the page as one HTML document that loads nothing; equal values give equal text."""
    return rendered("report.html.jinja", page=page, script=bundled("report.js"))


def rendered(template: str, **values: Any) -> str:
    """Return a template of the assets with these values, the style sheet and its checksum.

    Everything is escaped. `board_style` and `script`, where they are among the values, are trusted,
    and get a checksum.
    """
    from markupsafe import Markup

    inline = {"style": bundled("report.css")}
    inline |= {name: values[name] for name in ("board_style", "script") if name in values}
    for name, text in inline.items():
        values |= {name: Markup(text), f"{name}_hash": _hash(text)}
    return _environment().get_template(template).render(**values) + "\n"


@cache
def _environment() -> Environment:
    """Return the environment of all templates, which keeps those that it has compiled."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined
    from markupsafe import Markup, escape

    def harmless(value: Any) -> Any:
        return visible(value) if isinstance(value, str) and not isinstance(value, Markup) else value

    environment = Environment(
        loader=FunctionLoader(bundled),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=harmless,
    )
    environment.filters["px"] = lambda value: f"{value:.1f}".removesuffix(".0")
    environment.filters["trusted"] = Markup
    environment.filters["unbroken"] = lambda text: Markup(
        str(escape(visible(text))).replace(" %", "&nbsp;%")
    )
    return environment


def bundled(name: str) -> str:
    """Return the text of an asset."""
    return resources.files("bench.report").joinpath("assets", name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    """Return the hash by which a Content-Security-Policy names inline text."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
