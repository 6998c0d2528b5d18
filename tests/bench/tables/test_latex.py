from __future__ import annotations

import re
import shutil
import subprocess

import pytest

from bench.catalogue.suites import SUITES
from bench.tables.grid import BEST, Cell, grid
from bench.tables.latex import PREAMBLE, document, escaped
from bench.tables.paper import published

from .test_all_tables import RUNS
from .test_markdown import ODD

TABULAR = re.compile(
    r"\\begin\{tabular\}\{(?:@\{\})?(\w+)(?:@\{\})?\}(.*?)\\end\{tabular\}\n", re.S
)
WHOLE = (
    "\\documentclass%s{article}\n\\usepackage{booktabs}\n\\begin{document}\n%s\n\\end{document}\n"
)


def check(text: str, folder) -> None:
    """Assert that braces are balanced, and rows whole, and that all fits where LaTeX is here."""
    code = re.sub(r"(?<!\\)%.*", "", text)
    bare = re.sub(r"\\[{}]", "", code)
    assert bare.count("{") == bare.count("}")
    assert text.isascii()
    for spec, rows in TABULAR.findall(code):
        lines = [row for row in re.split(r" \\\\\n", rows) if row.strip("\n")]
        assert {1 + len(re.findall(r"(?<!\\)&", row)) for row in lines[:-1]} == {len(spec)}
    for style in ("", "[twocolumn]") if shutil.which("pdflatex") else ():
        (folder / "paper.tex").write_text(WHOLE % (style, text), encoding="utf-8")
        command = ("pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex")
        ended = subprocess.run(command, cwd=folder, capture_output=True, check=False)
        assert ended.returncode == 0, ended.stdout[-2000:]
        log = (folder / "paper.log").read_text(encoding="latin-1")
        assert not re.findall(r"Overfull \\hbox|Float too large", log)


def of_shape(suite):
    """Return the grid of a suite's default run: methods and conditions, or classes and methods."""
    columns, names = suite.conditions, suite.methods
    if len(suite.classes) > 1:
        columns, names = suite.methods, suite.classes
    cell = Cell("0.812", 0.812, ("0.795", "0.830"), paper="0.64")
    lines = [[name, *(cell for _ in columns)] for name in names]
    return grid(["method", *columns], lines, caption="ssim (higher is better)")


@pytest.mark.parametrize("suite", SUITES, ids=lambda suite: suite.id)
def test_tables_of_default_runs_fit_with_all_values(tmp_path, suite):
    shape = of_shape(suite)
    text = document("t", "Table 3: SSIM (higher is better); protocol 4", [shape])
    check(PREAMBLE + text, tmp_path)
    cells = len(shape.lines) * len(shape.columns)
    assert text.count(r"\benchvalue{0.812}{0.795}{0.830}") == text.count("& 0.64") == cells
    number = text.count(r"\caption{ssim (higher is better); SSIM; protocol 4")
    assert number == text.count(r"\begin{table")
    assert (number == 1) == (suite.id in ("chair-robustness", "own-meshes"))


def test_a_grid_of_few_lines_is_turned():
    cell = Cell("0.812", 0.812, ("0.795", "0.830"))
    heads = [f"condition-{number}" for number in range(12)]
    text = document("t", "T", [grid(["m", *heads], [["a", *(cell for _ in heads)]], caption="c")])
    assert "\nm & a \\\\\n" in text
    assert "\ncondition-0 & \\benchvalue" in text


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
    text, shown, fid = table.to_latex(), table.to_markdown(), distances.to_latex()
    assert "% fid, chair (lower is better): skipped: " in fid
    assert "surface-apss & - & - & - & - & - \\\\\n\\quad paper & 94.0 & 183.8 & " in fid
    cells = [cell for grid in table.grids() for line in grid.lines for cell in line.cells]
    close = r".*\n\\addlinespace.*\n\\quad paper"  # moved to the line above it
    assert re.search(rf"surface-apss & {close} & 0.70 & ", text)  # as printed, not 0.7
    ours, low, high = re.search(r"^\| pc2pix \| (\S+) \[(\S+), (\S+)\]", shown, re.M).groups()
    paper = published("chair-robustness")["chair", "ssim", "2048", "pc2pix"]
    ends = f"{{{escaped(low)}}}{{{escaped(high)}}}"
    line = f"pc2pix & \\benchvalue{{{ours}}}{ends} & "
    assert line in text.replace(f"\\textbf{{{ours}}}", ours)
    assert re.search(rf"\npc2pix & {close} & {paper:.2f} & ", text)
    assert text.count("\\textbf{") == sum(cell.special is BEST for cell in cells) > 0
    assert "wrecked & - (0/4 images) & " in text
    assert "paper: as published; other data (ShapeNet), other weights" in text


def test_names_show_as_they_are(tmp_path):
    assert escaped("a_b%&#$ ~^\\ {x} --no-x ≈.1 -.5 [-0.1, noise-0.05") == (
        r"a\_b\%\&\#\$ \textasciitilde{}\textasciicircum{}\textbackslash{} \{x\} -{}-no-x "
        r"$\approx$.1 $-$.5 {[}$-$0.1, noise-0.05"
    )
    assert escaped("5 × 椅") == r"5 $\times$ {[}U+6905]"
    rows = "".join(f"{escaped(text)} & x \\\\\n" for text in [*ODD, "*", "[a]", "?`", "Å"])
    check(rf"\begin{{tabular}}{{lr}}{rows}\end{{tabular}}", tmp_path)
