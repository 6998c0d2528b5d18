"""The headline table: what people see of few objects, and what its CSV has."""

from __future__ import annotations

import pandas as pd
import pytest

from bench.analysis.scored import read_scored
from bench.commands.terminal import shown
from bench.tables.headline import headline

from ..builders import write_run


@pytest.mark.parametrize(("count", "intervals"), [(8, False), (11, False), (12, True)])
def test_intervals_are_shown_from_12_objects_on(tmp_path, monkeypatch, count, intervals):
    """Of 8 objects and more there are intervals: in the CSV, and in the other tables."""
    monkeypatch.setenv("COLUMNS", "100")
    objects = [f"chair/{i:02d}" for i in range(count)]
    directory = write_run(
        tmp_path / "run", objects=objects, methods=["splat", "blank"], conditions=["2048"]
    )
    table = headline(read_scored(directory))
    assert all(low < high for low, high in ((row.ci_low, row.ci_high) for row in table.rows))
    text = "\n".join(shown(table))
    assert "±" not in text
    assert ("[." in text) == ("[95 % interval over objects]" in text) == intervals
    grids = table.to_markdown().partition("## ssim-object")[2]
    assert ("[0." in grids) == intervals
    assert ("Intervals are shown from 12 objects on." in table.to_markdown()) != intervals
    written = pd.read_csv(directory / "tables" / "headline.csv")
    assert written["ci_low"].notna().all()
