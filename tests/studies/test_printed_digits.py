"""Values of the documentation have the digits that survive rounding."""

from __future__ import annotations

import csv
import math

import pytest

from bench.analysis.significant_digits import ObjectDeviation, RoundingErrors
from bench.tables.grid import FEWER
from studies.documents import NUMBERS, filled, moved_values
from studies.printed_digits import line_precision, with_objects

NAN = math.nan
APSS = ObjectDeviation(0.0156, 24)  # of ssim at 2,048 points: .0082 over 24 chairs
ERRORS = RoundingErrors({
    ("surface-apss", "2048", "ssim"): APSS,
    ("alpha-wrap", "2048", "ssim"): ObjectDeviation(0.25, 24),
})  # fmt: skip
VALUES = """\
suite,method,condition,class,metric,value,ci_low,ci_high,n_ok,n,note
chair-robustness,surface-apss,2048,chair,ssim,0.776400,0.751000,0.802400,480,480,
chair-robustness,splat,2048,chair,ssim,0.777100,0.751000,0.802400,480,480,
chair-robustness,best-reconstruction,2048,chair,ssim,0.812300,,,480,480,alpha-wrap; 1 x crash
"""
DIFFERENCES = """\
metric,condition,class,method_a,method_b,value_a,value_b,difference,ci_low,ci_high,ahead,objects
ssim,2048,chair,surface-apss,splat,0.776400,0.812300,0.035900,0.020000,0.051200,b,24
ssim,2048,chair,pc2pix,splat,0.776400,0.812300,0.035900,0.020000,0.051200,b,24
"""


@pytest.fixture
def numbers(tmp_path):
    (tmp_path / "values.csv").write_text(VALUES)
    (tmp_path / "differences.csv").write_text(DIFFERENCES)
    return tmp_path


def page(asked, old=""):
    return f"<!-- numbers: {asked} -->\n{old}<!-- end -->\n"


def test_a_value_that_rounding_moves_is_marked_and_the_page_says_so_once(numbers):
    asked = "values.csv rows=method:surface-apss,splat,best-reconstruction columns=condition:2048"
    text = filled(page(asked) + page(f"{asked} intervals=no"), "x.md", numbers, ERRORS)
    assert text.splitlines() == [
        f"<!-- numbers: {asked} -->",
        "| method | 2,048 points |",
        "|---|---:|",
        "| surface-apss | ≈.78 [.75, .80] |",
        "| splat | .777 [.751, .802] |",
        "| best-reconstruction | ≈.8 |",  # as alpha-wrap, which its note names
        "",
        f"{FEWER}. <!-- end -->",
        f"<!-- numbers: {asked} intervals=no -->",
        "| method | 2,048 points |",
        "|---|---:|",
        "| surface-apss | ≈.78 |",
        "| splat | .777 |",
        "| best-reconstruction | ≈.8 |",
        "<!-- end -->",
    ]
    assert moved_values(text) == 4
    assert filled(text, "x.md", numbers, ERRORS) == text
    plain = filled(text, "x.md", numbers, RoundingErrors({}))
    assert moved_values(plain) == 0
    assert "≈" not in plain


def test_a_difference_has_the_digits_of_its_coarser_side(numbers):
    asked = "differences.csv rows=method_a:surface-apss,pc2pix columns=condition:2048"
    lines = filled(page(asked), "x.md", numbers, ERRORS).splitlines()
    assert "| surface-apss | better ≈+.04 [+.02, +.05] |" in lines
    assert "| pc2pix | better +.036 [+.020, +.051] |" in lines


def line(class_name, n, **changes):
    return {
        "suite": "thirteen-classes", "method": "surface-apss", "condition": "2048",
        "class": class_name, "metric": "ssim", "value": "0.7764", "n": str(n), **changes,
    }  # fmt: skip


def objects(lines, name="new.csv"):
    return [row.get("objects") for row in with_objects(lines, name)]


def test_objects_follow_from_images_and_views():
    assert objects([line("car", 200)]) == ["20"]  # 10 views, as the suite has
    assert objects([line("car", 200, suite="chair-robustness")]) == ["10"]
    assert objects([line("car", 200)], "real-meshes-grey.csv") == ["50"]  # of 4 views
    of_views = [line("car", 240, views="20", suite=""), line("car", 240, views="1", suite="")]
    assert objects(of_views) == ["12", "12"]  # costs of a cloud with 20 views and with 1
    assert objects([{"method": "pc2pix", "cost_ms": "3"}]) == [None]
    assert objects([line("car", 200, objects="7")]) == ["7"]


def test_an_average_counts_as_the_objects_that_would_move_as_much():
    *_, alone = objects([line("average", 400)])
    assert alone == "40"
    *_, alike = objects([line("car", 200), line("sofa", 200), line("average", 400)])
    assert alike == "40"
    # Its variance is that of the classes' means over 4: (1/10 + 1/40) / 4 = 1/32.
    *_, unlike = objects([line("car", 100), line("sofa", 400), line("average", 500)])
    assert unlike == "32"


def test_a_line_without_objects_or_method_has_all_digits():
    known = {"method": "surface-apss", "condition": "2048", "metric": "ssim", "value": "0.7764"}
    assert line_precision({**known, "objects": "24"}, ERRORS) == (2, APSS.half_width(24))
    assert line_precision(known, ERRORS) == (3, None)
    for lacking in ("method", "condition", "objects"):
        assert line_precision({**known, "objects": "24", lacking: ""}, ERRORS) == (3, None)


def test_every_file_with_images_has_whole_numbers_of_objects():
    """A run with other views than its suite, which VIEWS lacks, is noticed by a fraction."""
    for path in sorted(NUMBERS.glob("*.csv")):
        with path.open(encoding="utf-8", newline="") as file:
            lines = with_objects(csv.DictReader(file), path.name)
        for row in lines:
            if row.get("n") and row.get("class", "average") != "average":
                assert float(row["objects"]).is_integer(), f"{path.name}: {row}"
