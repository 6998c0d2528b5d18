from __future__ import annotations

import re
import shutil
import subprocess

import pytest

from bench.tables.grid import BEST
from bench.tables.latex import PREAMBLE, escaped
from bench.tables.paper import published

from .test_all_tables import RUNS
from .test_markdown import ODD

WHOLE = "\\documentclass{article}\n\\usepackage{booktabs}\n\\begin{document}\n%s\n\\end{document}\n"


def columns(row: str) -> int:
    """Return how many columns a row of a table fills."""
    spans = map(int, re.findall(r"\\multicolumn\{(\d)\}", row))
    return len(re.findall(r"(?<!\\)&", row)) + 1 + sum(span - 1 for span in spans)


def check(text: str, folder) -> None:
    """Assert that braces are balanced and rows whole, and that LaTeX takes it where it is here."""
    code = re.sub(r"(?<!\\)%.*", "", text)
    bare = re.sub(r"\\[{}]", "", code)
    assert bare.count("{") == bare.count("}")
    assert text.isascii()
    for spec, rows in re.findall(r"\\begin\{tabular\}\{(\w+)\}(.*?)\\end\{tabular\}", code, re.S):
        lines = [row for row in re.split(r" \\\\\n", rows) if row.strip("\n")]
        assert {columns(row) for row in lines[:-1]} == {len(spec)}
    if shutil.which("pdflatex"):
        (folder / "paper.tex").write_text(WHOLE % text, encoding="utf-8")
        command = ("pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex")
        ended = subprocess.run(command, cwd=folder, capture_output=True, check=False)
        assert ended.returncode == 0, ended.stdout[-2000:]


@pytest.mark.usefixtures("few_objects")
@pytest.mark.parametrize("run_id", RUNS)
def test_all_tables_of_a_run_compile(tmp_path, outputs_of, run_id):
    outputs = outputs_of(run_id)
    tables = [outputs.headline, *outputs.tables, *outputs.further]
    check(PREAMBLE + "\n".join(table.to_latex() for table in tables), tmp_path)


@pytest.mark.usefixtures("few_objects")
def test_published_values_stand_beside_ours(outputs_of):
    """The interval and the digits, of two objects, are those of the Markdown."""
    outputs = outputs_of("chair-robustness")
    table, distances, *_ = outputs.tables
    assert "% fid, chair (lower is better): skipped: " in distances.to_latex()
    text, shown = table.to_latex(), table.to_markdown()
    cells = [cell for grid in table.grids() for line in grid.lines for cell in line.cells]
    heads = r"& \\multicolumn\{2\}\{c\}\{2048\} & .* & broken \\\\\n\\cmidrule\(lr\)\{2-3\}"
    assert re.search(heads, text)
    assert " & ours & paper & ours & paper" in text
    assert re.search("surface-apss & [^&]* & 0.70 & ", text)  # as printed, not 0.7
    ours, low, high = re.search(r"^\| pc2pix \| (\S+) \[(\S+), (\S+)\]", shown, re.M).groups()
    paper = published("chair-robustness")["chair", "ssim", "2048", "pc2pix"]
    ends = f"\\benchci{{{escaped(low)}}}{{{escaped(high)}}}"
    assert f"pc2pix & {ours}{ends} & {paper:.2f} & " in text.replace(f"\\textbf{{{ours}}}", ours)
    assert text.count("\\textbf{") == sum(cell.special is BEST for cell in cells) > 0
    assert "wrecked & -" in text
    assert "paper: as published; other data (ShapeNet), other weights" in text


def test_names_show_as_they_are(tmp_path):
    assert escaped("a_b%&#$ ~^\\ {x} --no-x ≈.1 -.5 [-0.1, noise-0.05") == (
        r"a\_b\%\&\#\$ \textasciitilde{}\textasciicircum{}\textbackslash{} \{x\} -{}-no-x "
        r"$\approx$.1 $-$.5 {[}$-$0.1, noise-0.05"
    )
    assert escaped("5 × 椅") == r"5 $\times$ {[}U+6905]"
    rows = "".join(f"{escaped(text)} & x \\\\\n" for text in [*ODD, "*", "[a]", "?`", "Å"])
    check(rf"\begin{{tabular}}{{lr}}{rows}\end{{tabular}}", tmp_path)
