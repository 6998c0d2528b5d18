from __future__ import annotations

import pytest

from bench.analysis.run import read_run
from bench.catalogue.metrics import higher_is_better
from bench.records.frames import read_records
from bench.tables.differences import _ordinal, standing_lines
from bench.tables.quality import headline

from .test_all_tables import tiny_run


def lines_of(directory, method):
    run = read_run(directory)
    return list(standing_lines(run, headline(run), method, [method], 100))


@pytest.mark.usefixtures("few_objects")
def test_a_method_is_shown_with_what_it_has(tmp_path):
    """A condition without an image of it has no part in its place, and no value."""
    run = tiny_run(tmp_path / "run", "chair-robustness")
    lines = lines_of(run, "pc2pix")
    text = " ".join(lines)
    has = "2048, 512, noise-0.05, noise-0.10"
    assert f"pc2pix has 4 of 5 conditions: {has}. Places and comparisons here" in text
    records = read_records(run, ["method", "condition", "ssim_object", "lpips"])
    means = records[records["condition"] != "broken"].groupby("method").mean(numeric_only=True)
    means.loc["wrecked"] = means.loc["blank"]  # it always fails
    for metric in ("ssim-object", "lpips"):
        values = means[metric.replace("-", "_")].drop("blank")
        place = int(values.rank(ascending=not higher_is_better(metric))["pc2pix"])
        (line,) = (line for line in lines if line.startswith(f"{metric}  ") and " of " in line)
        assert line.endswith(f"-  {_ordinal(place)} of 4")
    assert "broken" not in "".join(lines[lines.index("") + 8 :])  # nor in comparisons
    assert lines_of(run, "wrecked") == ["", "wrecked has no image: there is nothing to compare."]


def test_places_in_words():
    words = " ".join(map(_ordinal, (1, 2, 3, 4, 11, 12, 13, 21, 101, 111)))
    assert words == "1st 2nd 3rd 4th 11th 12th 13th 21st 101st 111th"
