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


def test_it_says_what_it_could_show(tmp_path, monkeypatch):
    """Student's quantiles for 11 degrees of freedom, 2.200985 and 0.875530, times the error.

    The line below each metric has the best method and the next; the CSV all methods against the
    best. The ceiling and the floor do not compete.
    """
    monkeypatch.setenv("COLUMNS", "100")
    objects = [f"chair/{i:02d}" for i in range(12)]
    methods = ["splat", "alpha-wrap", "poisson", "true-mesh", "blank"]
    directory = write_run(
        tmp_path / "run", objects=objects, methods=methods, conditions=["2048", "noise-0.10"]
    )
    table = headline(read_scored(directory))
    records = pd.read_parquet(directory / "records.parquet")
    written = pd.read_csv(directory / "tables" / "headline.csv")
    lines = [line for line in shown(table) if line.startswith("could show")]
    printed = [number for line in lines for number in line.split()[2:]]
    expected = []
    for metric, sign in (("ssim-object", -1), ("lpips", 1)):
        for condition in ("2048", "noise-0.10"):
            cell = records[records["condition"] == condition]
            means = cell.groupby(["method", "object"])[metric.replace("-", "_")].mean().unstack(0)
            best, second, last = sorted(
                ("splat", "alpha-wrap", "poisson"), key=lambda name: sign * means[name].mean()
            )
            of_cell = written[(written["metric"] == metric) & (written["condition"] == condition)]
            resolution = of_cell.set_index("method")["resolution"]
            for method, other in ((best, second), (second, best), (last, best), ("blank", best)):
                error = (means[method] - means[other]).std(ddof=1) / 12**0.5
                least = (2.200985 + 0.875530) * error
                assert resolution[method] == pytest.approx(least, abs=2e-6)
            assert resolution["best-reconstruction"] in set(resolution[["alpha-wrap", "poisson"]])
            expected.append(f"{resolution[best]:.3f}")
    assert printed == expected
    markdown = table.to_markdown()
    assert "`could show`: the smallest difference between the best method and the next" in markdown
    assert markdown.count("| could show | ") == 2
    few = write_run(tmp_path / "few", objects=objects[:7], methods=methods, conditions=["2048"])
    assert "could show" not in headline(read_scored(few)).to_markdown()
    assert pd.read_csv(few / "tables" / "headline.csv")["resolution"].isna().all()
