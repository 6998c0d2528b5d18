"""Where one method falls behind another, as a table: families down, metrics across."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from bench.analysis.comparison import decimals
from bench.analysis.crossings import Contest, Crossing
from bench.catalogue.families import Family
from bench.tables import markdown
from bench.tables.table import csv_text, ordered

HEADER = (
    *("suite", "class", "family", "metric", "method", "rival", "condition", "at", "unseen_by"),
    *("value", "rival_value", "lead", "ci_low", "ci_high", "ahead"),
    *("crossing", "crossing_low", "crossing_high"),
)


@dataclass(frozen=True)
class CrossingsTable:
    """All contests of a run."""

    suite: str
    contests: tuple[Contest, ...]
    name: str = "crossings"

    def to_csv(self) -> str:
        """A row for each step of each contest; numbers with 6 decimals, an empty field without one.

        at         the condition's place on the axis of the family
        unseen_by  the networks that were not shown such clouds in training
        crossing   where the curves cross after this step, before the next or at it
        """
        return csv_text(HEADER, (row for c in self.contests for row in _rows(self.suite, c)))

    def to_markdown(self) -> str:
        """Who is ahead at both ends and where that changes; then the lead at every step."""
        lines = ["# Beyond what the networks were trained on", "", _LEGEND, ""]
        classes = ordered(c.class_name for c in self.contests)
        for class_name in classes:
            of_class = [c for c in self.contests if c.class_name == class_name]
            where = f", {class_name}" if len(classes) > 1 else ""
            lines += [f"## {markdown.cell(f'From end to end{where}')}", "", *_summary(of_class), ""]
            for family in dict.fromkeys(c.family for c in of_class):
                of_family = [c for c in of_class if c.family == family]
                lines += [
                    f"## {markdown.cell(family.axis + where)}",
                    "",
                    *([f"In training: {shown_in_training(family)}.", ""] if family.trained else []),
                    *_leads(of_family),
                    "",
                ]
        return "\n".join(lines)


_LEGEND = (
    "How much better the first method is than the second, over 0 if it is, [95 % interval, paired "
    "over objects], failed pictures scored as blank ones. **Bold**: the first is ahead, *italic*: "
    "the second, by an interval without 0. Curves cross where the lead passes through 0, on "
    "straight lines between what was measured (on the logarithm of the number of points and of the "
    "ratio of densities); in brackets as far as its interval holds 0."
)


def shown_in_training(family: Family) -> str:
    """What networks were shown: "splat-net 512 to 2048, pc2pix 256 to 2048"."""
    return ", ".join(
        f"{name} {least:g}" + (f" to {most:g}" if most > least else " only")
        for name, least, most in family.trained
    )


def told_end_to_end(contest: Contest) -> str:
    """Who is ahead at the first and at the last step, and where the curves cross."""
    first, last = contest.ahead[0], contest.ahead[-1]
    ends = first if first == last else f"{first}, then {last}"
    crossings = " and ".join(map(told_crossing, contest.crossings))
    return f"{ends}; {f'crosses at {crossings}' if crossings else 'none within'}"


def told_crossing(crossing: Crossing) -> str:
    """Its place with three digits: "0.137 [0.12, 0.15]"."""
    if not math.isfinite(crossing.low):
        return _place(crossing.at)
    return f"{_place(crossing.at)} [{_place(crossing.low)}, {_place(crossing.high)}]"


def _place(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _rows(suite: str, c: Contest) -> list[list[object]]:
    crossings = {crossing.after: crossing for crossing in c.crossings}
    rows: list[list[object]] = []
    for i, (at, condition) in enumerate(c.family.steps):
        found = crossings.get(i)
        crossing = (found.at, found.low, found.high) if found else (math.nan,) * 3
        rows.append(
            [
                *(suite, c.class_name, c.family.id, c.metric, c.method, c.rival, condition),
                *(f"{at:g}", " ".join(c.family.unseen_by(at))),
                *map(_field, (c.values[i], c.rival_values[i], *c.leads[i])),
                *(c.ahead[i], *map(_field, crossing)),
            ]
        )
    return rows


def _summary(contests: Sequence[Contest]) -> list[str]:
    metrics = ordered(c.metric for c in contests)
    at = {(c.family.id, c.method, c.rival, c.metric): c for c in contests}
    lines = [
        markdown.row(["family", "from", "to", "first", "second", *map(markdown.cell, metrics)]),
        "|---" * (len(metrics) + 5) + "|",
    ]
    for family, method, rival in dict.fromkeys((c.family, c.method, c.rival) for c in contests):
        told = [told_end_to_end(at[family.id, method, rival, metric]) for metric in metrics]
        ends = family.conditions[0], family.conditions[-1]
        lines.append(
            markdown.row(list(map(markdown.cell, (family.id, *ends, method, rival, *told))))
        )
    return lines


def _leads(contests: Sequence[Contest]) -> list[str]:
    """Of one family: contests by metric down, steps across."""
    steps = [f"{value:g}" for value in contests[0].family.values]
    lines = [
        markdown.row(["metric", "first", "second", *steps]),
        "|---" * (len(steps) + 3) + "|",
    ]
    for c in contests:
        leads = [_lead(c, i) for i in range(len(steps))]
        lines.append(markdown.row([*map(markdown.cell, (c.metric, c.method, c.rival)), *leads]))
    return lines


def _lead(c: Contest, step: int) -> str:
    value, low, high = c.leads[step]
    if not math.isfinite(value):
        return "-"
    digits = decimals(c.metric)
    text = f"{value:+.{digits}f}"
    if math.isfinite(low):
        text += f" [{low:+.{digits}f}, {high:+.{digits}f}]"
    marks = {c.method: f"**{text}**", c.rival: f"*{text}*"}
    return marks.get(c.ahead[step], text)


def _field(value: float) -> str:
    return f"{value:.6f}" if math.isfinite(value) else ""
