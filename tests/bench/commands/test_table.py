"""Tables and methods that are chosen to be printed."""

from __future__ import annotations

import re

import pytest

from ..tables.test_all_tables import tiny_run


def test_a_choice_is_printed_and_the_folder_stays_whole(tmp_path, command):
    run = tiny_run(tmp_path / "run", "chair-robustness")
    command("table", run)
    before = {path.name: path.read_bytes() for path in (run / "tables").iterdir()}
    choice = ("--tables", "table3_ssim,headline", "--methods", "blank,surface-apss")
    status, out, _ = command("table", run, *choice, "--format", "latex")
    assert status == 0
    assert re.findall(r"label\{tab:(\w+)-1\}", out) == ["table3_ssim", "headline"]
    names = re.findall(r"^(\S+|\\quad paper) & .*\\\\$", out, re.M)
    assert names == 4 * ["method", "blank", "surface-apss", r"\quad paper"] + 2 * [
        *("method", "blank", "surface-apss")
    ]
    shown = command("table", run, *choice)[1]  # in Markdown
    assert "| blank |" in shown
    assert "best-classical" not in shown
    assert command("table", run, *choice, "--format", "csv")[1].count("\nchair-robustness,") == 60
    assert {path.name: path.read_bytes() for path in (run / "tables").iterdir()} == before


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        (
            ("--tables", "table3"),
            "unknown table of RUN 'table3': did you mean 'table3_ssim'? there",
        ),
        (("--methods", "pc2pxi"), "unknown method of RUN 'pc2pxi': did you mean 'pc2pix'? there "),
        (
            ("--tables", "headline", "--methods", "best-learned-3d"),
            "RUN: these tables have no rows of best-learned-3d",
        ),
    ],
)
def test_a_choice_of_nothing_is_refused(tmp_path, refused, choice, message):
    run = tiny_run(tmp_path / "run", "chair-robustness")
    assert refused("table", run, *choice).startswith(message.replace("RUN", str(run)))
