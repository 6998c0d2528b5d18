from __future__ import annotations

import math
from dataclasses import replace

from bench.analysis.comparison import NAN
from bench.analysis.scores import QualityRow
from bench.catalogue.suites import TableSpec
from bench.report.build import table_group
from bench.tables.quality import quality_table


def row(method, value, condition="2048", class_name="chair", metric="ssim", **changes):
    values = {
        "ci_low": value - 0.1, "ci_high": value + 0.1, "n_ok": 4, "n": 4, "paper": NAN,
        "failures_as_blank": value, "note": "",
    }  # fmt: skip
    return QualityRow("s", method, condition, class_name, metric, value, **(values | changes))


def tables_of(*rows):
    return table_group(quality_table(TableSpec("images", "t", "T"), rows)).tables


def marks(table):
    return {line.name: [cell.mark for cell in line.cells] for line in table.lines}


def test_the_best_is_of_those_that_compete():
    rows = [
        row("splat-net", 0.5004), row("poisson", 0.4996), row("pc2pix", 0.4),
        row("true-mesh", 1.0), row("true-mesh@grey", 0.95), row("constant", 0.9),
    ]  # fmt: skip
    (table,) = tables_of(*rows)
    best = ["splat-net", "poisson"]  # the same as printed: 0.500
    assert marks(table) == {r.method: ["best" if r.method in best else ""] for r in rows}
    assert table.higher
    (lower,) = tables_of(*(row(r.method, r.value, metric="fd-views") for r in rows))
    assert [name for name, mark in marks(lower).items() if mark == ["best"]] == ["pc2pix"]
    (alone,) = tables_of(row("splat-net", 0.5), row("blank", 0.4))
    assert marks(alone) == {"splat-net": [""], "blank": [""]}


def test_outcomes_of_a_line_are_those_of_its_images():
    cases = {
        "points2pix": ({}, ("ok",)),
        "surface-apss": ({"n_ok": 3, "note": "1 x timeout: 3 s"}, ("failed", "ok")),
        "pc2pix@acgan": ({"n_ok": 0, "note": "4 x timeout: 3 s"}, ("failed",)),
        "pc2pix": ({"note": "skipped: weights"}, ("skipped",)),
        "splat-net": ({"n_ok": 3, "note": "1 x no value: why"}, ("ok",)),  # its images are there
    }
    (table,) = tables_of(*(row(method, 0.5, **changes) for method, (changes, _) in cases.items()))
    found = {line.name: line.tags.outcomes for line in table.lines}
    assert found == {method: outcomes for method, (_, outcomes) in cases.items()}
    gaps = {line.name: line.cells[0].gap for line in table.lines}
    assert gaps == dict.fromkeys(cases, "") | {
        "surface-apss": "3 of 4 images; 0.50 with blank ones for the others",
        "pc2pix@acgan": "0 of 4 images; 0.500 with blank ones for the others",
    }


def test_a_reason_is_stated_once_with_where_it_holds():
    rows = [
        row("splat", 0.5, n_ok=3, note="1 x no value: a"),
        row("splat", 0.5, "512", n_ok=3, note="1 x no value: a"),
        row("poisson", 0.5),
        row("poisson", 0.5, "512", n_ok=3, note="1 x no value: a"),
        row("pc2pix", 0.5),
        row("pc2pix", 0.5, "512", n_ok=2, note="2 x crash"),
    ]
    (table,) = tables_of(*rows)
    assert table.notes == ("pc2pix at 512: 2 x crash", "splat, poisson: 1 x no value: a")


def test_several_classes_are_lines_and_methods_columns():
    rows = [
        row(method, 0.25 if class_name == "lamp" else 0.75, condition, class_name)
        for class_name in ("chair", "lamp", "average")
        for condition in ("2048", "512")
        for method in ("splat-net", "poisson")
    ]
    rows[0] = replace(rows[0], n_ok=2, note="2 x crash")
    first, second = tables_of(*rows)
    assert first.caption == "ssim, at 2048 (higher is better)"
    assert [name for name, _ in first.columns] == ["splat-net", "poisson"]
    assert [(line.name, line.tags.class_name) for line in first.lines] == [
        (name, name) for name in ("chair", "lamp", "average")
    ]
    assert [cell.text for cell in first.lines[1].cells] == ["0.250", "0.250"]
    assert first.notes == ("splat-net at chair: 2 x crash",)
    assert (first.unfolded, second.unfolded) == (True, False)
    assert second.tags.condition == "512"


def test_what_was_skipped_is_folded_and_remarks_are_plain():
    skipped = row("splat", math.nan, metric="fid", note="skipped: weights", paper=94.0)
    there = row("splat", 3.0, metric="fd-views")
    group = table_group(
        quality_table(TableSpec("images", "t", "T"), (skipped, there), r"`fid` of **a\_b**")
    )
    assert [table.unfolded for table in group.tables] == [False, True]
    cell = group.tables[0].lines[0].cells[0]
    assert (cell.text, cell.value, cell.paper) == ("skipped", None, "94")
    assert group.tables[0].notes == ("skipped: weights",)
    assert [table.void for table in group.tables] == [True, False]
    assert group.remark == "fid of a_b"
    whole = table_group(
        quality_table(TableSpec("images", "t", "T"), (skipped, there)), folded=False
    )
    assert [table.unfolded for table in whole.tables] == [True, True]
