"""Values with fewer digits than their metric have a mark, wherever tables are shown."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd
import pytest
from report_parser import parse

from bench.analysis.frontier import FRONTIER
from bench.analysis.scored_run import read_run
from bench.catalogue.suites import TableSpec
from bench.report.build import read_page
from bench.report.headline import compact_table
from bench.report.page import rendered
from bench.report.run_figures import quality_frame
from bench.tables.build import make_outputs
from bench.tables.differences import comparison_lines, difference_cell
from bench.tables.frontier import frontier_table
from bench.tables.grid import BEST, FEWER, Grid
from bench.tables.quality import (
    all_methods,
    best_printed,
    is_worse,
)
from bench.tables.terminal import STAR, grid_lines

from ..builders import value_frame, value_row, value_table, write_run
from ..differences import make_difference, make_differences

NAN = float("nan")
SPEC = TableSpec("images", "t", "T")


def row(method="surface-apss", value=0.7764, **changes):
    changes = {"n_ok": 480, "n": 480, "ci_low": 0.751, "ci_high": 0.8024} | changes
    return value_row(method, value, **changes)


ROWS = (row(), row("splat", 0.7771), row("pc2pix", 0.6))


def grid_of(rows):
    (made,) = [block for block in all_methods(value_frame(rows)) if isinstance(block, Grid)]
    return made


def test_markdown_has_fewer_digits_a_mark_and_its_meaning():
    lines = value_table(*ROWS).to_markdown().splitlines()
    assert "| surface-apss | ≈0.78 [0.75, 0.80] 480/480 |" in lines
    # The paper's SR is the best reconstruction here, and stands there by both names.
    assert "| best-reconstruction | ≈0.78 [0.75, 0.80] 480/480 |" in lines
    assert "| splat | 0.777 [0.751, 0.802] 480/480 |" in lines
    assert "| pc2pix | 0.600 [0.751, 0.802] 480/480 |" in lines
    assert lines.count(f"* {FEWER}") == 1
    assert lines.index(f"* {FEWER}") > lines.index("| pc2pix | 0.600 [0.751, 0.802] 480/480 |")


def test_without_such_a_value_there_is_no_mark():
    text = value_table(*ROWS[1:]).to_markdown()
    assert "≈" not in text


def test_csv_keeps_all_digits():
    values = [line["value"] for line in value_table(*ROWS).to_rows()]
    assert values == [0.7764, 0.7764, 0.7771, 0.6]


def test_a_value_with_blank_images_has_the_same_digits():
    failed = row(n_ok=479, failures_as_blank=0.7712)
    assert grid_of([failed]).lines[0].cells[0].blank == "0.77"


def test_the_best_are_compared_in_the_digits_that_both_have():
    apss, splat, pc2pix = ROWS
    assert not is_worse(apss, splat)  # 0.78 and 0.78
    assert not is_worse(splat, apss)
    assert is_worse(pc2pix, apss)
    assert is_worse(row("splat", 0.776), row("pc2pix", 0.777))
    assert {method for _, _, method in best_printed(ROWS)} == {"surface-apss", "splat"}
    assert best_printed(ROWS[:1]) == set()  # alone it competes with none
    distances = [r | {"metric": "fd-views"} for r in ROWS[1:]]
    assert {method for _, _, method in best_printed(distances)} == {"pc2pix"}
    marks = {line.name: line.cells[0].special for line in grid_of(ROWS).lines}
    assert marks == {"surface-apss": BEST, "splat": BEST, "pc2pix": None}


def test_a_terminal_says_what_the_mark_means():
    lines = grid_lines([grid_of(ROWS)], 140, 40)
    assert lines[2:5] == [
        "surface-apss    *≈0.78 [.75, .80]",
        "splat         *0.777 [.751, .802]",
        "pc2pix         0.600 [.751, .802]",
    ]
    assert lines[-1] == f"{STAR}; [95 % interval over objects]; {FEWER}"
    assert not any("≈" in line for line in grid_lines([grid_of(ROWS[1:])], 140, 40))


def test_the_page_has_mark_meaning_and_a_number_to_sort_by(tmp_path):
    run = write_run(tmp_path / "run", methods=["splat", "blank"])
    shown = {"tables": [("t", "", [grid_of(ROWS)], True)]}
    shown["headline"] = compact_table(quality_frame(value_frame(ROWS)))
    page = read_page(make_outputs(read_run(run))) | shown
    document = parse(rendered("report.html.jinja", **page))
    headline, table = (document.all("table", class_=f"numbers{k}") for k in (" compact", ""))
    table = table[0]
    (coarse,) = [cell for cell in table.all("td") if "≈" in cell.text]
    assert coarse.attributes["data-value"] == "0.776400"
    (value,) = coarse.all("span", class_="value")
    assert value.text == "≈0.78"
    assert [item.text for item in document.all("li") if "≈" in item.text] == [FEWER]
    (in_headline,) = [span for span in headline[0].all("span", class_="value") if "≈" in span.text]
    assert in_headline.text == "≈0.78"
    key = document.all("p", class_="how")[0].text
    assert f"{FEWER}." in key


def test_the_headline_marks_the_best_in_the_digits_that_both_have():
    made = compact_table(quality_frame(value_frame([*ROWS, row("blank", 0.5)])))
    cells = {method: cells[0] for method, _, cells in made["lines"]}
    assert {method: cell["best"] for method, cell in cells.items()} == {
        "surface-apss": True, "splat": True, "pc2pix": False, "blank": False,
    }  # fmt: skip
    assert made["coarse"]
    assert not compact_table(quality_frame(value_frame(ROWS[1:])))["coarse"]
    # 0.60 against 0.60: so many digits do not show it to be worse than a white image
    coarse = compact_table(
        quality_frame(value_frame([row("surface-apss", 0.5977), row("blank", 0.6)]))
    )
    assert not any(cell["below"] for _, _, cells in coarse["lines"] for cell in cells)


def test_the_papers_layout_has_them_too():
    spec = replace(SPEC, paper_layout=True)
    text = value_table(row(), row("pc2pix", 0.6), spec=spec).to_markdown()
    assert "| ssim | ≈0.78 | 0.600 |" in text
    assert text.count(FEWER) == 2  # of this grid and of all methods


@pytest.mark.parametrize(
    ("method", "text", "printed"),
    [
        ("surface-apss", "≈0.78 to 0.81: +0.04", "≈+.04"),
        ("splat", "0.776 to 0.812: +0.036", "+.036"),
    ],
)
def test_a_difference_is_of_the_digits_of_both_values(method, text, printed):
    """The row of a chosen method has the digits of the method that it is."""
    made = make_difference(
        *("ssim", "2048", 0.0359),
        **{"value_a": 0.7764, "value_b": 0.8123, "ci_low": 0.02, "ci_high": 0.0512},
        **{"method_a": "best-reconstruction", "images_of_a": method},
    )
    assert difference_cell(made).text == text
    lines = comparison_lines(make_differences([made]), 80)
    assert any(line.split() == ["difference", printed] for line in lines)
    assert (f"{FEWER}." in " ".join(lines)) == ("≈" in text)


def test_the_frontier_has_them_too():
    cell = ("2048", "chair", 20, "ssim", "surface-apss")
    row = (*cell, 61.4, 60.0, 62.0, 0.7764, 0.751, 0.8024, 480, 480, "frontier", "")
    text = frontier_table(SPEC, pd.DataFrame([row], columns=FRONTIER), "").to_markdown()
    assert "| surface-apss | 61.4 [60.0, 62.0] | **≈0.78** [0.75, 0.80] | 480/480 |" in text
    assert FEWER in text
