"""What the report shows of tables and of failures. Pure."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pandas as pd

from bench.report.page import Failure, FailureGroup, TableGroup
from bench.tables.table import Table, Tags

MOST_LISTED = 200  # failures listed for one reason
_MARKUP = re.compile(r"`|\*\*|\\(.)")  # what remarks have, and escapes


def table_group(table: Table[Any], folded: bool = True) -> TableGroup:
    """The grids of a table; `folded`: all but the first that has values."""
    grids = table.grids()
    first = next((i for i, grid in enumerate(grids) if grid.valued), 0)
    return TableGroup(
        table.title,
        _MARKUP.sub(r"\1", table.remark),
        tuple(replace(g, unfolded=not folded or i == first) for i, g in enumerate(grids)),
    )


def failure_groups(records: pd.DataFrame) -> tuple[FailureGroup, ...]:
    """Pictures that are not there, by reason, the most frequent first.

    Each listed is one method on one cloud, with the views that it lacks.
    """
    failed = records[records["outcome"] != "ok"]
    groups = []
    for (outcome, reason), of_reason in failed.groupby(["outcome", "reason"], sort=True):  # type: ignore[misc]
        items = of_reason.groupby(["method", "condition", "class", "object"], sort=False)
        listed = [
            Failure(
                f"{method}/{condition}/{class_name}/{obj}",
                _views(group["view"].tolist()),
                Tags(str(method), str(condition), str(class_name), (str(outcome),)),
            )
            for (method, condition, class_name, obj), group in items  # type: ignore[misc]
        ]
        count = f"{len(of_reason)} pictures of {len(listed)} clouds"
        kept = tuple(listed[:MOST_LISTED])
        group = FailureGroup(str(reason), count, kept, len(listed) - len(kept))
        groups.append((-len(of_reason), group))
    return tuple(group for _, group in sorted(groups, key=lambda pair: pair[0]))


def _views(views: Sequence[int]) -> str:
    if len(views) > 1 and list(views) == list(range(views[0], views[0] + len(views))):
        return f"views {views[0]} to {views[-1]}"
    return f"view{'s' * (len(views) > 1)} {', '.join(map(str, views))}"
