"""The tables of the documentation are what `results/docs` says."""

from __future__ import annotations

import pytest

from studies.documents import PAGES, REPOSITORY, Unfilled, filled

VALUES = """\
method,condition,class,metric,value,ci_low,ci_high
splat,2048,chair,ssim,0.812345,0.801,0.8234
splat,512,chair,ssim,0.7,,
splat,2048,chair,fd-views,12.34,11,13.06
splat,512,chair,fd-views,,,
"""
VERDICTS = """\
metric,condition,class,method_b,ahead
ssim,2048,all,splat,b
ssim,512,all,splat,a
ssim,512,chair,splat,tie
"""
COSTS = """\
method,condition,cost_ms
splat,2048,7.506
pc2pix,2048,21.333
alpha-wrap,2048,63.011
"""


@pytest.fixture
def numbers(tmp_path):
    (tmp_path / "costs.csv").write_text(COSTS)
    (tmp_path / "values.csv").write_text(VALUES)
    (tmp_path / "verdicts.csv").write_text(VERDICTS)
    (tmp_path / "opposite.csv").write_text(VERDICTS.replace(",b\n", ",a\n"))
    return tmp_path


def page(asked, old="what stood here\n"):
    return f"Before.\n\n<!-- numbers: {asked} -->\n{old}<!-- end -->\n\nAfter.\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (page("gone.csv rows=method:a columns=condition:b"), "x.md:3: .*gone.csv"),
        (page("values.csv rows=method:splat"), "x.md:3: 'columns'"),
        (
            page("values.csv rows=method:splat columns=condition:1024 metric=ssim"),
            "x.md:3: 0 lines with method splat, metric ssim, condition 1024; there has to be one",
        ),
        (
            page("values.csv rows=method:splat columns=condition:512"),
            "x.md:3: 2 lines with method splat, condition 512",
        ),
        (
            page(
                "values.csv rows=method:splat columns=condition:2048 metric=ssim "
                "marks=verdicts.csv,opposite.csv;class:all"
            ),
            "x.md:3: splat is better and worse; there has to be one",
        ),
        (
            page("rows=method:splat column=noise;values.csv;condition:1024"),
            "x.md:3: no line for the column 'noise'",
        ),
        ("\n<!-- numbers: values.csv -->\nno end", "x.md:2: a mark without '<!-- end -->'"),
    ],
)
def test_a_place_that_cannot_be_filled_is_named(numbers, text, message):
    with pytest.raises(Unfilled, match=message):
        filled(text, "x.md", numbers)


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_pages_are_what_the_numbers_say(path):
    """Run python -m studies.documents where this fails."""
    text = path.read_text(encoding="utf-8")
    assert filled(text, str(path.relative_to(REPOSITORY))) == text


def test_a_column_takes_its_rows_from_several_files(numbers):
    (numbers / "others.csv").write_text(
        "method,condition,class,metric,value,ci_low,ci_high\npublished,2048,chair,ssim,0.85,,\n"
    )
    asked = "rows=method:splat,published best=yes column=a;values.csv,others.csv;condition:2048"
    written = filled(page(f"{asked};metric:ssim"), "x.md", numbers)
    assert "| splat | .812 [.801, .823] |\n| published | **.850** |\n" in written


def test_the_best_of_each_column_of_values_is_bold(tmp_path):
    # The two best by ssim differ by less than its digits tell, and costs have no best.
    (tmp_path / "values.csv").write_text(
        "method,metric,value,ci_low,ci_high,cost_ms\n"
        "splat,ssim,0.91202,0.9,0.92,5\n"
        "pc2pix,ssim,0.91198,0.9,0.92,18\n"
        "alpha-wrap,ssim,0.8,0.7,0.9,110\n"
        "splat,lpips,0.3,0.2,0.4,5\n"
        "pc2pix,lpips,0.02,0.01,0.03,18\n"
        "alpha-wrap,lpips,,,,110\n"
    )
    asked = (
        "rows=method:splat,pc2pix,alpha-wrap intervals=no best=yes column=a;values.csv;metric:ssim "
        "column=b;values.csv;metric:lpips column=c;values.csv;metric:ssim;show:cost_ms"
    )
    assert (
        "| splat | **.912** | .300 | 5.0 |\n"
        "| pc2pix | **.912** | **.020** | 18.0 |\n"
        "| alpha-wrap | .800 | – | 110 |\n"
    ) in filled(page(asked), "x.md", tmp_path)
