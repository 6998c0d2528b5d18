"""Which of the paper's orderings in Table 5 a run reproduces: SR or pc2pix, class by class.

The paper has PC2PIX ahead in 11 of 13 classes and on average, SR in rifle and lamp, by FID. Here
the two are paired object by object, so that a lead has an interval, and an ordering that the
objects cannot decide is called undecided.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import pandas as pd

from bench.analysis.comparison import (
    NAN,
    Comparison,
    Estimate,
    better_by,
    class_mean_difference,
    compare,
    decimals,
)
from bench.analysis.distances import FeatureDistances
from bench.analysis.intervals import FEWEST
from bench.catalogue.methods import FLOOR
from bench.catalogue.metrics import column, is_mean
from bench.catalogue.suites import Suite
from bench.tables import markdown
from bench.tables.classes import AVERAGE, NETWORK, SURFACE, network_of, objects_of
from bench.tables.quality import Published
from bench.tables.table import (
    Annotation,
    Block,
    Cell,
    Grid,
    Table,
    Tags,
    columns,
    constant,
    grid,
    number,
    ordered,
    pivot,
)

PAPER_NETWORK = "pc2pix@all"
PAPER_METRIC = "fid"
Verdict = Literal["reproduced", "opposite", "undecided", "no value"]
VERDICTS: tuple[Verdict, ...] = ("reproduced", "opposite", "undecided", "no value")
MARKS = {
    "reproduced": Annotation("reproduced", "**{value}{interval}**"),
    "opposite": Annotation("opposite", "{value}{interval} *opposite*", against=True),
}


@dataclass(frozen=True)
class Ordering:
    """SR against the network in one class by one metric.

    surface, network  their values, failed images scored as blank ones
    method      the network: what stands for the paper's PC2PIX
    lead        how much better the network is, paired over objects: over 0 if it is
    paper_lead  the same by FID as the paper printed it; NaN where it has no such class
    objects     how many the class has
    """

    condition: str
    class_name: str
    metric: str
    surface: float
    network: float
    difference: Estimate
    paper_difference: float
    objects: int
    method: str

    @property
    def verdict(self) -> Verdict:
        """Reproduced or opposite where the interval of the lead is on one side of 0."""
        low, high = self.difference.low, self.difference.high
        if not (math.isfinite(self.difference.value) and math.isfinite(self.paper_difference)):
            return "no value"
        if low > 0 or high < 0:
            return "reproduced" if (low > 0) == (self.paper_difference > 0) else "opposite"
        return "undecided"


def orderings_table(suite: str, network: str, rows: Sequence[Ordering]) -> Table[Ordering]:
    """The orderings of a run. `network` is the method that stands for the paper's PC2PIX."""
    made = (
        constant("suite", suite),
        *columns("condition", ("class", "class_name"), "metric", "method", "surface", "network"),
        *columns(
            ("lead", "difference.value"),
            ("ci_low", "difference.low"),
            ("ci_high", "difference.high"),
        ),
        *columns(("paper_lead", "paper_difference"), "verdict", "objects"),
    )
    title = "Which of the paper's orderings hold"
    remark = _REMARK.format(network=network, surface=SURFACE)
    layout = partial(_layout, network)
    return Table("table5_orderings", title, made, tuple(rows), layout, remark)


def _layout(network: str, rows: Sequence[Ordering]) -> Iterator[Block]:
    """For each condition how many orderings hold by each metric, then the leads."""
    yield _legend(network)
    for condition in ordered(row.condition for row in rows):
        of_condition = [row for row in rows if row.condition == condition]
        yield f"## {markdown.cell(condition)}"
        yield _counts(of_condition)
        yield _leads(of_condition)


def orderings(
    records: pd.DataFrame,
    features: Mapping[str, FeatureDistances],
    suite: Suite,
    published: Published,
) -> Table[Ordering] | None:
    """The orderings by all metrics of Table 5 that both sides have; None where a side is lacking.

    Kernel distances are left out: they say what the Fréchet distance on the same features says.
    """
    methods = records["method"].unique().tolist()
    network = network_of(methods)
    if network is None or SURFACE not in methods:
        return None
    there = [m for m in suite.class_metrics if m in features]
    there += [m for m in suite.class_metrics if is_mean(m) and column(m) in records]
    pair = records[records["method"].isin([SURFACE, network, FLOOR])]
    counts = objects_of(records)
    compared = compare(pair, features, there)
    made = [
        row
        for condition in ordered(c.condition for c in compared)
        for metric in there
        for row in _of_metric(
            [c for c in compared if c.condition == condition], metric, network, counts, published
        )
    ]
    return orderings_table(suite.id, network, made)


def _of_metric(
    compared: Sequence[Comparison],
    metric: str,
    network: str,
    counts: Mapping[str, int],
    published: Published,
) -> list[Ordering]:
    """A row for each class, and the average over them."""
    own, other = ([c.qualities[metric][m] for c in compared] for m in (network, SURFACE))
    rows = [
        Ordering(
            c.condition,
            c.class_name,
            metric,
            b.estimate.value,
            a.estimate.value,
            better_by(a, b),
            paper_difference(published, c.class_name),
            counts[c.class_name],
            network,
        )
        for c, a, b in zip(compared, own, other, strict=True)
    ]
    average = Ordering(
        compared[0].condition,
        AVERAGE,
        metric,
        _mean([row.surface for row in rows]),
        _mean([row.network for row in rows]),
        class_mean_difference(own, other)[0]._replace(
            value=_mean([row.difference.value for row in rows])
        ),
        paper_difference(published, AVERAGE),
        sum(counts.values()),
        network,
    )
    return [*rows, average]


def paper_difference(published: Published, class_name: str) -> float:
    """By how much the paper's PC2PIX is ahead of its SR, in FID; NaN where it has no such class."""
    cell = (class_name, PAPER_METRIC, "2048")
    surface, network = (published.get((*cell, m), NAN) for m in (SURFACE, PAPER_NETWORK))
    return surface - network


def _counts(rows: Sequence[Ordering]) -> Grid:
    """In how many classes the paper's ordering holds: a line for each metric."""
    lines = []
    for metric in ordered(row.metric for row in rows):
        of_metric = [row for row in rows if row.metric == metric]
        classes = [row for row in of_metric if row.class_name != AVERAGE]
        counts = [sum(row.verdict == verdict for row in classes) for verdict in VERDICTS]
        same = sum(row.difference.value * row.paper_difference > 0 for row in classes)
        (average,) = (row.verdict for row in of_metric if row.class_name == AVERAGE)
        lines.append([metric, *map(str, (*counts, same, average))])
    condition = rows[0].condition
    return grid(
        ["classes", *VERDICTS, "same sign", "on average"],
        lines,
        caption=f"classes at {condition}",
        tags=Tags(condition=condition),
    )


def _leads(rows: Sequence[Ordering]) -> Grid:
    """Classes down, metrics across."""
    condition = rows[0].condition
    made = pivot(
        rows,
        "class_name",
        "metric",
        _cell,
        corner="class",
        before={
            "objects": lambda row: Cell(str(row.objects), row.objects),
            "paper (FID)": lambda row: number((row.paper_difference, NAN, NAN), "{:+.1f}".format),
        },
        caption=f"lead at {condition}",
        tags=Tags(condition=condition),
    )
    # The average is of all classes: no choice of one hides it.
    lines = (replace(x, tags=Tags()) if x.name == AVERAGE else x for x in made.lines)
    return replace(made, lines=tuple(lines))


def _cell(row: Ordering) -> Cell:
    show = f"{{:+.{decimals(row.metric)}f}}".format
    return number(row.difference, show, special=MARKS.get(row.verdict))


_REMARK = (
    "How much better {network} is than {surface}: over 0 if it is, with its 95 % interval, paired "
    "over objects; failed pictures are scored as blank ones. The paper orders by FID, which is not "
    "on the scale of the others. “reproduced” is the paper's ordering, “opposite” the other one, "
    "both with an interval that leaves 0 out; the rest is undecided by so many objects."
)


def _legend(network: str) -> str:
    return (
        f"How much better {markdown.code(network)} is than `{SURFACE}`, over 0 if it is, [95 % "
        "interval, paired over objects], failed pictures scored as blank ones. The paper orders "
        f"by FID: {NETWORK} is ahead in 11 of 13 classes and on average, SR in rifle and lamp. "
        "**Bold**: that ordering, and the interval does not hold 0; *opposite*: the other one, "
        f"the same; neither: undecided by so many objects, or no interval below {FEWEST}."
    )


def _mean(values: Sequence[float]) -> float:
    finite = [value for value in values if math.isfinite(value)]
    return sum(finite) / len(finite) if finite else NAN
