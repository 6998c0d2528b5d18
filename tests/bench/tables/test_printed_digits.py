"""Values that rounding moves have fewer digits and a mark, wherever tables are shown."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from report_parser import parse

from bench.analysis.comparison import Estimate, Quality, pooled
from bench.analysis.frontier import FrontierPoint
from bench.analysis.paired import ComparedPair, PairedDifference, Side
from bench.analysis.run_pairs import Differences
from bench.analysis.scored import read_scored
from bench.analysis.scores import QualityRow, RowWithSamples, with_averages
from bench.analysis.significant_digits import ObjectDeviation, RoundingErrors
from bench.catalogue.suite_types import TRUTHS
from bench.catalogue.suites import SUITES, TableSpec
from bench.report.build import read_page
from bench.report.headline import compact_table
from bench.report.page import TableGroup, html
from bench.tables.build import make_outputs
from bench.tables.classes import table_of_classes
from bench.tables.differences import difference_cell
from bench.tables.frontier import frontier_table
from bench.tables.grid import BEST, FEWER, Grid
from bench.tables.plain import STAR, plain
from bench.tables.quality import (
    all_methods,
    best_printed,
    image_table,
    is_worse,
    quality_table,
)
from bench.tables.verdict import comparison_lines

from ..builders import make_failed, make_record, scored_records, to_frame, write_run

NAN = float("nan")
SPEC = TableSpec("images", "t", "T")
NOTE = (
    "≈ rounding alone moves this value by up to 0.0082 (95 %): fewer digits are shown; the "
    "interval over objects includes it"
)


def row(method="surface-apss", value=0.7764, half=0.0082, **changes):
    made = QualityRow(
        *("chair-robustness", method, "2048", "chair", "ssim", value, 0.751, 0.8024),
        *(480, 480, NAN, value, "", NAN, "nothing", "", half),
    )
    return replace(made, **changes)


ROWS = (row(), row("splat", 0.7771, NAN), row("pc2pix", 0.6, 0.00002))


def grid_of(rows):
    (made,) = [block for block in all_methods(rows) if isinstance(block, Grid)]
    return made


def test_markdown_has_fewer_digits_a_mark_and_its_meaning():
    lines = quality_table(SPEC, ROWS).to_markdown().splitlines()
    assert "| surface-apss | ≈0.78 [0.75, 0.80] 480/480 |" in lines
    assert "| splat | 0.777 [0.751, 0.802] 480/480 |" in lines  # unknown: as before
    assert "| pc2pix | 0.600 [0.751, 0.802] 480/480 |" in lines
    assert lines.count(f"* {NOTE}") == 1
    assert lines.index(f"* {NOTE}") > lines.index("| pc2pix | 0.600 [0.751, 0.802] 480/480 |")


def test_without_a_moved_value_there_is_no_mark():
    text = quality_table(SPEC, ROWS[1:]).to_markdown()
    assert "≈" not in text
    assert "rounding" not in text


def test_csv_keeps_all_digits_and_says_how_many_are_significant():
    table = quality_table(SPEC, ROWS)
    rows = list(csv.DictReader(io.StringIO(table.to_csv())))
    # The paper's SR is the best reconstruction here, and stands there by both names.
    assert [(line["method"], line["value"], line["digits"]) for line in rows] == [
        ("surface-apss", "0.776400", "2"),
        ("best-reconstruction", "0.776400", "2"),
        ("splat", "0.777100", ""),
        ("pc2pix", "0.600000", "4"),
    ]
    assert list(rows[0])[-1] == "digits"
    assert [line["digits"] for line in table.to_rows()] == [2, 2, None, 4]


def test_the_first_digit_stands_there_even_if_it_moves():
    values = {0.7764: "≈0.8", 0.0123: "≈0.01", 0.0004: "≈0.000"}
    for value, text in values.items():
        (cell,) = grid_of([row(value=value, half=0.5)]).lines[0].cells
        assert (cell.text, cell.value, cell.rounding) == (text, value, 0.5)
    (distance,) = grid_of([row(metric="fd-views", value=123.44, half=14.0)]).lines[0].cells
    assert distance.text == "≈123"


def test_a_value_with_blank_images_has_the_same_digits():
    failed = row(n_ok=479, failures_as_blank=0.7712)
    assert grid_of([failed]).lines[0].cells[0].blank == "0.77"


def test_the_best_are_compared_in_the_digits_that_both_have():
    apss, splat, pc2pix = ROWS
    assert not is_worse(apss, splat)  # 0.78 and 0.78
    assert not is_worse(splat, apss)
    assert is_worse(pc2pix, apss)
    assert is_worse(row("splat", 0.776, NAN), row("pc2pix", 0.777, NAN))
    assert {method for _, _, method in best_printed(ROWS)} == {"surface-apss", "splat"}
    assert best_printed(ROWS[:1]) == set()  # alone it competes with none
    distances = [replace(r, metric="fd-views", rounding=NAN) for r in ROWS]
    assert {method for _, _, method in best_printed(distances)} == {"pc2pix"}
    marks = {line.name: line.cells[0].special for line in grid_of(ROWS).lines}
    assert marks == {"surface-apss": BEST, "splat": BEST, "pc2pix": None}


def test_a_terminal_says_what_the_mark_means():
    lines = plain([grid_of(ROWS)], 140, 40)
    assert lines[2:5] == [
        "surface-apss      ≈0.78*  [.75, .80]",
        "splat             0.777*[.751, .802]",
        "pc2pix            0.600 [.751, .802]",
    ]
    assert lines[-1] == f"{STAR}; [95 % interval over objects]; {FEWER}"
    assert not any("≈" in line for line in plain([grid_of(ROWS[1:])], 140, 40))


def test_the_page_has_mark_meaning_and_a_number_to_sort_by(tmp_path):
    run = write_run(tmp_path / "run", methods=["splat", "blank"])
    group = TableGroup("t", "", (grid_of(ROWS),))
    page = read_page(make_outputs(read_scored(run)))
    page = replace(page, tables=(group,), headline=compact_table(ROWS))
    document = parse(html(page))
    headline, table = document.all("table", class_="numbers compact"), document.all("table")
    table = next(t for t in table if "data-group" not in t.attributes and t not in headline)
    (moved,) = [cell for cell in table.all("td") if "≈" in cell.text]
    assert moved.attributes["data-value"] == "0.776400"
    (value,) = moved.all("span", class_="value")
    assert (value.text, value.attributes["title"]) == ("≈0.78", "rounding alone: up to 0.0082")
    assert [item.text for item in document.all("li") if "≈" in item.text] == [NOTE]
    (in_headline,) = [span for span in headline[0].all("span", class_="value") if "≈" in span.text]
    assert in_headline.text == "≈0.78"
    assert in_headline.attributes["title"].endswith("; rounding alone moves it by up to 0.0082")
    key = document.one("p", class_="key").text
    assert "≈: fewer digits, as rounding alone moves the others." in key


def test_the_headline_marks_the_best_in_the_digits_that_both_have():
    made = compact_table([*ROWS, row("blank", 0.5, NAN)])
    cells = {method: cells[0] for method, _, _, cells in made.lines}
    assert {method: cell.best for method, cell in cells.items()} == {
        "surface-apss": True, "splat": True, "pc2pix": False, "blank": False,
    }  # fmt: skip
    assert made.moved
    assert not compact_table(ROWS[1:]).moved
    # 0.60 against 0.60: so many digits do not show it to be worse than a white image
    coarse = compact_table([row("splat", 0.5977), row("blank", 0.6, NAN)])
    assert not any(cell.below for _, _, _, cells in coarse.lines for cell in cells)


def test_an_average_over_classes_moves_less_than_its_classes():
    samples = np.array([0.5, 0.6, 0.7])
    of_classes = [row(class_name=name, half=0.03) for name in ("car", "sofa", "lamp")]
    *_, average = with_averages([RowWithSamples(r, samples) for r in of_classes])
    assert average.class_name == "average"
    assert average.rounding == pytest.approx(0.03 / 3**0.5, rel=1e-12)
    table = table_of_classes(SPEC, [*of_classes, average], "")
    text = table.to_markdown()
    assert text.count("≈0.8 ") == 4
    assert "by up to 0.03 (95 %)" in text


def test_the_papers_layout_has_them_too():
    spec = replace(SPEC, paper_layout=True)
    text = quality_table(spec, (row(), row("pc2pix", 0.6, 0.00002))).to_markdown()
    assert "| ssim | ≈0.78 | 0.600 |" in text
    assert text.count(NOTE) == 2  # of this grid and of all methods


def of_method(method, value, half):
    return Quality("ssim", Estimate(value, value - 0.025, value + 0.025), np.zeros(24), half)


def test_a_difference_is_of_the_digits_of_both_values():
    sides = of_method("surface-apss", 0.7764, 0.0082), of_method("splat", 0.8123, 0.00001)
    names = (Side("run", method) for method in ("surface-apss", "splat"))
    pair = ComparedPair("2048", "chair", *names, *sides, objects=24)
    made = PairedDifference(pair, Estimate(0.0359, 0.02, 0.0512), 0.001, 0.001, "b", None)
    cell = difference_cell(made)
    assert cell.text == "≈0.78 to 0.81: +0.04"
    assert cell.interval == ("+0.02", "+0.05")
    assert cell.rounding == pytest.approx(0.0082, rel=1e-5)  # of both, in quadrature
    known = replace(pair, quality_a=sides[1], quality_b=sides[1])
    assert difference_cell(replace(made, pair=known)).text == "0.812 to 0.812: +0.036"
    lines = comparison_lines(Differences("a", "b", (made,), (), TRUTHS["coloured"]), 80)
    assert any(line.split() == ["difference", "≈+.04"] for line in lines)
    assert "≈: fewer digits, as rounding alone moves the others." in " ".join(lines)


def test_the_frontier_has_them_too():
    cost = Estimate(61.4, 60.0, 62.0)
    quality = Estimate(0.7764, 0.751, 0.8024)
    about = {"n_ok": 480, "n": 480, "verdict": "frontier", "baseline": ""}
    point = FrontierPoint(
        *("2048", "chair", 20, "ssim", "surface-apss", cost, quality), **about, rounding=0.0082
    )
    text = frontier_table(SPEC, (point,), "").to_markdown()
    assert "| surface-apss | 61.4 [60.0, 62.0] | **≈0.78** [0.75, 0.80] | 480/480 |" in text
    assert NOTE in text


def test_rows_of_a_run_without_known_errors_have_none(tmp_path):
    """Its methods are of another package; their tables are as before."""
    records = [make_record("stranger", obj=o) for o in "ab"] + [make_record("blank", obj="a")]
    rows = worked_rows(records)
    stranger = [r for r in rows if r.method == "stranger"]
    assert stranger
    assert all(np.isnan(r.rounding) and r.digits is None for r in stranger)


def worked_rows(records, errors=None):
    run = scored_records(to_frame(records), SUITES[0], errors=errors)
    return image_table(run, SPEC, {}).rows


def test_a_run_takes_its_errors_by_the_objects_of_each_cell():
    """A failed object has no part in the value, nor in how far rounding moves it."""
    measured = ObjectDeviation(0.01, 24)
    errors = RoundingErrors({("splat", "2048", "ssim"): measured})
    records = [make_record(obj=o) for o in "abcd"] + [make_failed(obj="e")]
    records += [make_record("blank", obj=o) for o in "abcde"]
    rows = worked_rows(records, errors)
    (of_splat,) = [r for r in rows if (r.method, r.metric) == ("splat", "ssim")]
    assert of_splat.rounding == measured.half_width(4)
    run = scored_records(to_frame(records), SUITES[0], errors=errors)
    (comparison,) = run.compared(["ssim"])  # where a failed image is scored as a blank one
    assert comparison.qualities["ssim"]["splat"].rounding == measured.half_width(5)
    assert np.isnan(comparison.qualities["ssim"]["blank"].rounding)


def test_objects_of_several_classes_are_pooled_with_their_errors():
    measured = ObjectDeviation(0.01, 24)
    errors = RoundingErrors({("splat", "2048", "ssim"): measured})
    records = [
        make_record(method, obj=f"{name}{i}", class_name=name)
        for method in ("splat", "blank")
        for name, count in (("chair", 2), ("sofa", 3))
        for i in range(count)
    ]
    run = scored_records(to_frame(records), SUITES[0], errors=errors)
    (of_all,) = pooled(run.compared(["ssim"]))
    # as of one class of 5 objects; a handful of float64 operations
    expected = pytest.approx(measured.half_width(5), rel=1e-12)
    assert of_all.qualities["ssim"]["splat"].rounding == expected
