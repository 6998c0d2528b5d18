"""The first screen of a report: the headline table beside the answer, whatever a run lacks."""

from __future__ import annotations

import re
from dataclasses import replace

from builders import make_failed, read_all, value_frame, value_row, write_all, write_run
from report_parser import parse

from bench.analysis.compare import NAN
from bench.analysis.run import read_run
from bench.report.answer import compact_table
from bench.report.build import read_page
from bench.report.page import rendered
from bench.report.run_figures import quality_frame
from bench.tables.build import make_outputs
from bench.tables.quality import in_headline_order


def row(method, metric, condition, value, **changes):
    return value_row(method, value, condition, metric, **({"n_ok": 4, "n": 4} | changes))


VALUES = {
    ("true-mesh", "ssim-object"): 1.0, ("true-mesh", "lpips"): 0.0,
    ("splat", "ssim-object"): 0.2, ("splat", "lpips"): 0.3,
    ("pc2pix", "ssim-object"): 0.6, ("pc2pix", "lpips"): 0.2,
    ("blank", "ssim-object"): 0.3, ("blank", "lpips"): 0.6,
}  # fmt: skip


def table_of(*rows):
    return compact_table(quality_frame(in_headline_order(value_frame(rows))), {})


def test_the_best_stand_first_and_reference_methods_last():
    conditions = ("2048", "noise-0.10")
    made = table_of(*(row(*at, c, v) for c in conditions for at, v in VALUES.items()))
    assert made is not None
    assert made["caption"] == "Best first by ssim-object, mean over 2 conditions"
    assert made["metrics"] == [("ssim-object", True, 2), ("lpips", False, 2)]
    assert [(kind, name.short) for _, _, kind, name in made["columns"]] == [
        *(("", "2,048"), ("noise", "10 %"), ("", "2,048"), ("noise", "10 %")),
    ]
    roles = {"pc2pix": "", "splat": "", "true-mesh": "ceiling", "blank": "floor"}
    assert [(method, role) for method, role, _ in made["lines"]] == [*roles.items()]
    cells = {method: cells for method, _, cells in made["lines"]}
    assert [cell["text"] for cell in cells["pc2pix"]] == ["0.600", "0.600", "0.200", "0.200"]
    assert {m: [cell["best"] for cell in of_line] for m, of_line in cells.items()} == {
        m: [m == "pc2pix"] * 4 for m in cells
    }
    assert {m: [cell["below"] for cell in of_line] for m, of_line in cells.items()} == {
        m: [m == "splat"] * 2 + [False] * 2 for m in cells
    }


def test_a_failed_image_and_a_missing_value_are_named():
    made = table_of(
        row("splat", "lpips", "2048", 0.5, n_ok=1, failures_as_blank=0.55, note="3 x crash"),
        row("pc2pix", "lpips", "2048", NAN, n_ok=0, note="4 x crash"),
        row("blank", "lpips", "512", 0.6),
    )
    assert made is not None
    cells = {method: cells for method, _, cells in made["lines"]}
    assert cells["splat"][0]["text"] == "0.500*"
    assert cells["splat"][0]["about"] == (
        "splat, lpips, 2,048 points; 1 of 4 images, the others scored as blank ones"
    )
    assert [cells["pc2pix"][0][name] for name in ("text", "about")] == ["–", "4 x crash"]
    assert [cells["splat"][1][name] for name in ("text", "about")] == ["–", "not measured"]
    assert made["failed"]


def page_of(directory):
    page = read_page(make_outputs(read_run(directory)))
    return page, parse(rendered("report.html.jinja", **page))


def test_a_run_whose_images_all_failed_says_so(tmp_path):
    run = write_run(tmp_path / "run", methods=["splat", "pc2pix", "blank"])
    write_all(run, [make_failed(r.method, r.condition, r.object, r.view) for r in read_all(run)])
    page, document = page_of(run)
    assert page["answer"][0].term == "No answer"
    assert page["headline"] is None
    assert page["first"] == page["costs"] == []
    jobs = document.one("p", class_="jobs is-missing").text
    assert jobs.endswith(" failed")
    assert not jobs.endswith(" 0 failed")


def test_a_run_without_a_headline_metric_is_judged_by_the_other(tmp_path):
    run = write_run(tmp_path / "run", methods=["splat", "pc2pix", "blank"])
    write_all(run, [replace(r, lpips=None) for r in read_all(run)])
    page, document = page_of(run)
    titles = re.findall(r">([a-z-]+) \((?:higher|lower) is better\)<", page["first"][0])
    assert titles == ["ssim-object"]
    assert page["headline"] is not None
    assert {metric for metric, *_ in page["headline"]["columns"]} == {"ssim-object"}
    texts = [text for line in page["answer"] for _, text in line.entries]
    assert texts
    assert not any("lpips" in text for text in texts)
    assert document.one("section", id="answer")


def test_without_a_value_there_is_no_headline():
    assert table_of() is None
    assert table_of(row("splat", "lpips", "2048", NAN, note="skipped: weights")) is None
