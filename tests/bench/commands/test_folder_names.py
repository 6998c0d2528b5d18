"""Folders whose names are not UTF-8: a command works there, or says in one line why it does not."""

from __future__ import annotations

import json
import shlex
import shutil
import sys
from pathlib import Path

import pytest

from bench.check.golden import bless
from bench.running.environment import machine_info

from ..builders import write_run

NAME = b"\xff\xfe".decode(errors="surrogateescape")
SHOWN = r"\udcff\udcfe"
WORKS = {  # command lines with N for the folder's name, and their exit status
    "table N": 0,
    "report N": 0,
    "check N --bless golden.json": 0,
    "check N --golden own.json": 0,
    "check N --golden own.json --format json": 0,
    "compare run N --metric ssim": 0,
    "compare N run --metric ssim --format json": 0,
    "compare N run --metric ssim --format text --out N/x": 0,
    "compare N --methods splat,blank --metric ssim --format latex": 0,
    "score N --metrics flip": 0,
    "new method mine --out N/mine": 0,
}
REFUSED = {
    "check run --bless N": f"{SHOWN}: a folder; give the name of a file, such as golden.json",
    "check run --golden N": f"{SHOWN}: a folder; give a file",
    "check N --claims": f"{SHOWN}: no claim of the paper can be tested: ",
    "check N/none": f"{SHOWN}/none: no such folder; give a run's folder",
    "report run N --out site": f"{SHOWN}: a copy of the run in run; give one of the two",
    "add splat N": f"{SHOWN}/manifest.json: holds no options of a run; ",
    "data inspect N": f"'{SHOWN}': not the name of a folder (",
    "data export --limit 1 --out N": f"{SHOWN}: is there already; give a new folder with --out",
    "run --suite chair-robustness --dry-run --out N": f"{SHOWN}: holds a run of views 2, not 20; ",
    "run --suite chair-robustness --dry-run --dataset folder:N": f"'{SHOWN}': not the name of a fo",
    "run --config N": f"{SHOWN}: a folder; give a file",
    "test folder:N": f"'{SHOWN}': not the name of a folder (",
}


@pytest.fixture
def typed(tmp_path, seed_folder, no_machine, monkeypatch):
    """Return a function from a command line to its words, where two such runs lie."""
    monkeypatch.chdir(tmp_path)
    for name in ("run", NAME):
        shutil.copytree(seed_folder / "run", name)
    shutil.copy(seed_folder / "own.json", ".")
    return lambda line: [word.replace("N", NAME) for word in shlex.split(line)]


@pytest.fixture(scope="module")
def seed_folder(tmp_path_factory):
    """Return a folder with a run, and golden values of it in a file."""
    folder = tmp_path_factory.mktemp("seed")
    bless(write_run(folder / "run", methods=["splat", "blank"]), folder / "own.json")
    return folder


@pytest.mark.parametrize(("line", "status"), WORKS.items())
def test_a_folder_whose_name_is_not_utf8_is_a_folder(typed, command, line, status):
    ended, out, _ = command(*typed(line))
    assert ended == status
    out.encode()  # what is printed is UTF-8


@pytest.mark.parametrize(("line", "says"), REFUSED.items())
def test_or_one_line_says_why_not(typed, refused, line, says):
    assert refused(*typed(line)).startswith(says)


def test_the_command_of_a_manifest_is_utf8(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["bench", "run", "--out", NAME, "ü"])
    told = machine_info()
    assert told["command"] == ["bench", "run", "--out", SHOWN, "ü"]
    assert json.dumps(told, ensure_ascii=False).encode()


def test_a_comparison_names_the_folder_by_escapes(typed, command):
    command(*typed("compare run N --metric ssim --methods splat"))
    (made,) = Path(NAME, "comparisons").iterdir()
    header, first, *_ = (made / "differences.csv").read_text().splitlines()
    row = dict(zip(header.split(","), first.split(","), strict=True))
    assert (row["run_a"], row["run_b"]) == ("run", SHOWN)
