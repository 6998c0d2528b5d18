from __future__ import annotations

import csv
import sqlite3
from contextlib import closing
from dataclasses import replace

import pandas as pd
import pytest

from bench.analysis.run import read_run
from bench.check.golden import check
from bench.records.folder import read_manifest
from bench.running.options import Options
from bench.suites.stability.cases import CASES
from bench.suites.stability.outcomes import COLUMNS, matrix, read_outcomes, unexpected
from bench.suites.stability.run import run
from bench.tables.build import tables
from data_prep.failures import BadInput

HOLDS = ("shuffled", "metamorphic", "splat", "as plain", "images", "holds")
OPTIONS = Options("stability", methods=("blank", "true-mesh"), workers=2)
STORED = ("job", "blob", "listed")


@pytest.fixture
def finished(tmp_path):
    """A run of two methods."""
    return run(replace(OPTIONS, out=tmp_path / "run"))


@pytest.mark.slow
def test_a_run_leaves_tables_and_figures_and_goes_on(finished, tmp_path):
    out = tmp_path / "run"
    (methods,) = finished.tables
    expected = {(case.id, method) for case in CASES for method in ("blank", "true-mesh")}
    assert {*zip(methods.frame["case"], methods.frame["subject"], strict=True)} == expected
    assert {*methods.frame["kind"]} == {"holds"}
    assert (out / "tables" / "stability_methods.md").stat().st_size > 100
    assert (out / "figures" / "stability_methods.png").stat().st_size > 1000
    assert (out / "figures" / "extremes.png").stat().st_size > 10_000
    with (out / "tables" / "observations.csv").open(newline="") as file:
        assert len(list(csv.DictReader(file))) == 2 * len(CASES)
    manifest = read_manifest(out)
    assert manifest["finished"]
    assert manifest["cases"] == [case.id for case in CASES]

    def files():
        with closing(sqlite3.connect(out / "run.sqlite")) as store:
            rows = [store.execute(f"SELECT * FROM {name}").fetchall() for name in STORED]
        tables = {path: path.read_bytes() for path in (out / "tables").iterdir()}
        return rows, tables

    before = files()
    run(replace(OPTIONS, out=out))
    assert files() == before

    verdict = check(out)
    assert (verdict.compared, verdict.differing) == (2 * len(CASES), ())
    path = out / "tables" / "stability_methods.csv"
    path.write_text(path.read_text().replace(",holds", ",unexpected", 1))
    (regression,) = check(out).differing
    assert regression.startswith("blank, plain: images, 0.0 % not white; stated was: ")
    with pytest.raises(BadInput, match="writes its tables itself"):
        tables(read_run(out))


def test_a_matrix_survives_its_file(tmp_path):
    odd = (*HOLDS[:4], 'a "quoted", line\nbroken | text', "unexpected")
    table = matrix("One chair.", pd.DataFrame([HOLDS, odd], columns=COLUMNS))
    (tmp_path / "stability_methods.csv").write_text(table.to_csv())
    (tmp_path / "observations.csv").write_text("a,b\n1,2\n")  # none of the matrices
    assert [*read_outcomes(tmp_path).itertuples(index=False, name=None)] == [HOLDS, odd]
    (line,) = unexpected(table.frame)
    assert line == f"splat, shuffled: {odd[4]}; stated was: as plain"


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "{header}\na,b,c,d,e,fine\n"])
def test_other_files_are_no_matrices(tmp_path, text):
    header = "case,group,subject,expected,observed,kind"
    (tmp_path / "stability_methods.csv").write_text(text.format(header=header))
    with pytest.raises(BadInput, match=r"stability_methods.csv: not a table of this suite"):
        read_outcomes(tmp_path)
    with pytest.raises(BadInput, match="no tables of the suite"):
        read_outcomes(tmp_path / "elsewhere")
