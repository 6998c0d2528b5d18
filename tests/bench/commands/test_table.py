"""Tables and methods that are chosen to be printed."""

from __future__ import annotations

import re

from ..tables.test_all_tables import tiny_run


def test_a_choice_is_printed_and_the_folder_stays_whole(tmp_path, command):
    run = tiny_run(tmp_path / "run", "chair-robustness")
    choice = ("--tables", "table3_ssim,headline", "--methods", "surface-apss,blank")
    out = command("table", run, *choice, "--format", "latex")[1]
    assert re.findall(r"label\{tab:(\w+)-1\}", out) == ["table3_ssim", "headline"]
    names = re.findall(r"^(\S+|\\quad paper) & .*\\\\$", out, re.M)
    lines = ["method", "surface-apss", r"\quad paper", "blank"]
    assert names == 4 * lines + 2 * [name for name in lines if "paper" not in name]
    out = command("table", run, *choice)[1]  # in Markdown
    assert "best-classical" not in out
    assert "\n| pc2pix |" in (run / "tables" / "table3_ssim.md").read_text()


def test_an_unknown_choice_is_refused(tmp_path, refused):
    run = tiny_run(tmp_path / "run", "chair-robustness")
    said = f"unknown table of {run} 'table3': did you mean 'table3_ssim'? "
    assert refused("table", run, "--tables", "table3").startswith(said)
    said = f"unknown method of {run} 'pc2pxi': did you mean 'pc2pix'? "
    assert refused("table", run, "--methods", "pc2pxi").startswith(said)
