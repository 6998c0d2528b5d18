"""The leaderboard of the documentation: from CSV files, in the front page alone."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bench.analysis.compare import milliseconds
from bench.catalogue.chosen import measured_methods
from studies.leaderboard import ResultGroup, board, show

VALUES = {  # ssim-object and lpips
    "splat": (0.4, 0.4),
    "pc2pix": (0.9, 0.1),
    "pc2pix@all": (0.8, 0.2),
    "blank": (0.5, 0.6),
    "pc2pix@mine.safetensors": (1.0, 0.0),
}
KNOWN = ResultGroup("known", "chairs", "known", "2048")
REAL = ResultGroup("real", "meshes", "real", "noise-0.10")
COST = milliseconds(measured_methods()["pc2pix"].one_view_ms)
HEAD = "method,condition,class,metric,value,failures_as_blank\n"


@pytest.fixture
def numbers(tmp_path) -> Path:
    def lines(condition, class_name, values, shift=0.0):
        return "".join(
            f"{method},{condition},{class_name},{metric},{value + shift},\n"
            for method, of_method in values.items()
            for metric, value in zip(("ssim-object", "lpips"), of_method, strict=True)
        )

    (tmp_path / "known.csv").write_text(HEAD + lines("2048", "chair", VALUES))
    compared = "metric,condition,class,method_b,ahead\n"
    (tmp_path / "known-differences.csv").write_text(
        f"{compared}lpips,2048,chair,splat,a\nlpips,noise-0.10,chair,splat,b\n"
    )
    of_classes = {method: of_method for method, of_method in VALUES.items() if "@all" not in method}
    (tmp_path / "real.csv").write_text(
        HEAD
        + lines("noise-0.10", "car", of_classes, -0.1)
        + lines("noise-0.10", "sofa", of_classes, 0.1)
        + lines("2048", "sofa", of_classes, 0.5)
    )
    (tmp_path / "real-differences.csv").write_text(
        f"{compared}lpips,noise-0.10,all,pc2pix,b\nlpips,noise-0.10,car,pc2pix,a\n"
        "ssim-object,noise-0.10,all,pc2pix,tie\nlpips,noise-0.10,all,splat,a\n"
    )
    return tmp_path


def test_rows_hold_what_the_files_hold(numbers):
    found = board(numbers, (KNOWN, REAL))
    assert [(row["place"], row["name"]) for row in found["rows"]] == [
        *((1, "pc2pix"), (2, "pc2pix@all"), (3, "splat"), (None, "blank")),
    ]
    assert [group.name for _, group in found["groups"]] == ["known", "real", ""]
    assert found["groups"][1][1].title == "meshes; noise 10 % of the radius"
    best, variant, splat, blank = (row["cells"] for row in found["rows"])
    assert [cell.text for cell in best] == [".900", ".100", ".900", ".100", "1.0", COST, "chairs"]
    assert [cell.text for cell in variant[:5]] == [".800", ".200", "–", "–", "2.0"]
    assert variant[5].text == COST  # it draws with the network of pc2pix
    assert [cell.text for cell in blank[:2]] == [".500", ".600"]
    assert [cell.caveat for cell in splat[:2]] == ["worse than blank", ""]
    assert [cell.beneath for cell in best[:4]] == ["", "", "not decided", "better"]
    assert [cell.beneath for cell in splat[:4]] == ["", "worse", "", "worse"]


def test_the_best_classical_costs_as_the_method_that_it_is_by_lpips():
    costs = {row["name"]: row["cells"][7].text for row in board()["rows"]}
    measured = milliseconds(measured_methods()["alpha-wrap"].one_view_ms)
    assert costs["best-classical"] == costs["alpha-wrap"] == measured


def test_the_front_page_alone_has_it_at_its_mark():
    section = "\n## Tutorial\n\n* [Tutorial](quickstart.md)\n"
    source = [f"# Title\n\nWords.\n<!-- leaderboard -->\n{section}"]
    show(None, "index", source)
    head, raw, rest = re.split(r"```(?:\{raw\} html\n)?", source[0])
    assert head.strip() == "# Title\n\nWords."
    assert raw.startswith("<style>")
    assert raw.count('<table class="board">') == 1
    assert rest.lstrip() == section.lstrip()
    assert "\n## Tutorial" in rest
    other = ["# Other\n\n## Part\n"]
    show(None, "report", other)
    assert other == ["# Other\n\n## Part\n"]
