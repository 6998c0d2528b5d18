"""Values with fewer digits than their metric have a mark, wherever tables are shown."""

from __future__ import annotations

import pytest

from bench.analysis.compare import is_better
from bench.catalogue.suites import TableSpec
from bench.report.answer import compact_table
from bench.report.run_figures import quality_frame
from bench.tables.differences import comparison_lines, difference_cell
from bench.tables.grid import BEST, FEWER, Grid
from bench.tables.quality import all_methods, best_printed
from bench.tables.terminal import STAR, grid_lines

from ..builders import value_frame, value_row
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


def test_a_value_with_blank_images_has_the_same_digits():
    failed = row(n_ok=479, failures_as_blank=0.7712)
    assert grid_of([failed]).lines[0].cells[0].blank == "0.77"


def test_the_best_are_compared_in_the_digits_that_both_have():
    apss, splat, pc2pix = ROWS
    assert not is_better(splat, apss)  # 0.78 and 0.78
    assert not is_better(apss, splat)
    assert is_better(apss, pc2pix)
    assert is_better(row("pc2pix", 0.777), row("splat", 0.776))
    assert {method for _, _, method in best_printed(ROWS)} == {"surface-apss", "splat"}
    assert best_printed(ROWS[:1]) == set()  # alone it competes with none
    references = (value_row("true-mesh", 1.0), value_row("blank", 0.9))  # no rivals
    without = row("fused-net", 0.9, n_ok=0)  # whose value is that of blank images
    assert best_printed([*ROWS, *references, without]) == best_printed(ROWS)
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


def test_the_headline_marks_the_best_in_the_digits_that_both_have():
    made = compact_table(quality_frame(value_frame([*ROWS, row("blank", 0.5)])), {})
    cells = {method: cells[0] for method, _, cells in made["lines"]}
    assert {method: cell["best"] for method, cell in cells.items()} == {
        "surface-apss": True, "splat": True, "pc2pix": False, "blank": False,
    }  # fmt: skip
    assert made["coarse"]
    assert not compact_table(quality_frame(value_frame(ROWS[1:])), {})["coarse"]
    # 0.60 against 0.60: so many digits do not show it to be worse than a white image
    rows = value_frame([row("surface-apss", 0.5977), row("blank", 0.6)])
    coarse = compact_table(quality_frame(rows), {})
    assert not any(cell["below"] for _, _, cells in coarse["lines"] for cell in cells)


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
        **{"method_a": "best-classical", "images_of_a": method},
    )
    assert difference_cell(made).text == text
    lines = comparison_lines(make_differences([made]), 80)
    assert any(line.split() == ["difference", printed] for line in lines)
    assert (f"{FEWER}." in " ".join(lines)) == ("≈" in text)
