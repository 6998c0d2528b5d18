"""Tables and methods that are chosen to be printed."""

from __future__ import annotations

import re

import pytest

from ..tables.test_all_tables import tiny_run


def test_a_choice_is_printed_and_the_folder_stays_whole(tmp_path, command):
    run = tiny_run(tmp_path / "run", "chair-robustness")
    choice = ("--tables", "table3_ssim,headline", "--methods", "blank,surface-apss")
    out = command("table", run, *choice, "--format", "latex")[1]
    assert re.findall(r"label\{tab:(\w+)-1\}", out) == ["table3_ssim", "headline"]
    names = re.findall(r"^(\S+|\\quad paper) & .*\\\\$", out, re.M)
    lines = ["method", "blank", "surface-apss"]
    assert names == 4 * [*lines, r"\quad paper"] + 2 * lines
    out = command("table", run, *choice)[1]  # in Markdown
    assert "| blank |" in out
    assert "best-classical" not in out
    assert "\n| pc2pix |" in (run / "tables" / "table3_ssim.md").read_text()


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        (("--tables", "table3"), "unknown table of RUN 'table3': did you mean 'table3_ssim'? "),
        (("--methods", "pc2pxi"), "unknown method of these tables 'pc2pxi': did you mean 'pc2pix'"),
    ],
)
def test_an_unknown_choice_is_refused(tmp_path, refused, choice, message):
    run = tiny_run(tmp_path / "run", "chair-robustness")
    assert refused("table", run, *choice).startswith(message.replace("RUN", str(run)))
