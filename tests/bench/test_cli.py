"""The command line: its output and its exit status."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from bench.catalogue.suites import Limits
from bench.cli import _interrupt_handler, main
from bench.running.pool import run_tasks
from data_prep.failures import BadInput
from learning.divergence import TrainingDiverged

from .builders import drop_features
from .conftest import BENCH


def test_simple_questions_load_no_heavy_package():
    """Both are asked in one process."""
    code = """if True:
        import sys
        from bench.cli import main
        for question in ("--help", "list"):
            try:
                main([question])
            except SystemExit:
                heavy = {"torch", "numpy", "pandas", "scipy", "matplotlib", "rich"}
                print(*(heavy & set(sys.modules)), file=sys.stderr)
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "\n\n"
    assert "chair" in done.stdout


def test_table_makes_the_same_bytes_again_from_the_store(finished, copied, command):
    shutil.rmtree(copied / "tables")
    (copied / "records.parquet").unlink()  # which is for scripts alone
    full = ("table", copied, "--format", "md")
    once, twice = command(*full), command(*full)
    assert once == twice
    assert once[0] == 0
    assert once[2] == ""
    for name in ("headline", "table3_ssim", "table4_fid", "table_detail", "table_control"):
        for kind in ("csv", "md"):
            path = f"tables/{name}.{kind}"
            assert (copied / path).read_bytes() == (finished[0] / path).read_bytes()
        assert ((copied / f"tables/{name}.md").read_text() in once[1]) == (name != "headline")
    drop_features(copied, "fd-views")
    assert "skipped: no features in this run" in command("table", copied, "--format", "md")[1]


def test_tables_for_scripts(finished, copied, command):
    """CSV has all values under one header, JSON has them unrounded."""
    status, text, err = command("table", copied, "--format", "csv")
    assert (status, err) == (0, "")
    found = pd.read_csv(io.StringIO(text))
    names = ("table3_ssim", "table4_fid", "table_detail", "table_control")
    files = [pd.read_csv(finished[0] / "tables" / f"{name}.csv") for name in names]
    pd.testing.assert_frame_equal(found, pd.concat(files, ignore_index=True), check_dtype=False)
    made = json.loads(command("table", copied, "--format", "json")[1])
    assert [table["name"] for table in made] == [*names]
    rows = [row for table in made for row in table["rows"]]
    assert len(rows) == len(found)
    for row, value in zip(rows, found["value"], strict=True):
        assert row["value"] is None if np.isnan(value) else abs(row["value"] - value) < 1e-6


def test_nobody_reads_the_output():
    """`bench list | true` prints no traceback, and ends as if killed by SIGPIPE."""
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write) as closed:
        done = subprocess.run([*BENCH, "list"], stdout=closed, stderr=subprocess.PIPE, check=False)
    assert (done.returncode, done.stderr) == (141, b"")


def test_a_terminal_that_cannot_show_a_character(tmp_path):
    """The image is written, and no traceback follows."""
    (tmp_path / "Stühle – 3.xyz").write_text("0 0 0\n1 0 0\n0 1 0\n0 0 1\n" * 20)
    done = subprocess.run(
        [*BENCH, "render", "Stühle – 3.xyz", "--method", "splat"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONIOENCODING": "latin-1"},
        capture_output=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, b"St\xfchle \\u2013 3.png\n"), done.stderr
    assert (tmp_path / "Stühle – 3.png").exists()


def test_a_current_folder_that_is_gone(tmp_path):
    script = f"rmdir {tmp_path} && exec {sys.executable} -c '{BENCH[-1]}' render /a.xyz"
    done = subprocess.run(["sh", "-c", script], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == "bench: the current folder is gone; change to another, with cd\n"


def test_what_other_systems_lack_is_told_in_a_line(monkeypatch, capsys):
    monkeypatch.setattr(sys, "platform", "darwin")
    with pytest.raises(BadInput, match="worker processes need Linux, and this is darwin; use WSL"):
        next(run_tasks(range(3), abs, 1, Limits(60.0, 8.0)))
    monkeypatch.setattr(sys, "platform", "win32")
    with pytest.raises(SystemExit, match="2"):
        main(["list"])
    assert (
        capsys.readouterr().err
        == "bench: Windows is not supported; use WSL 2 or Docker (docs/platforms.md)\n"
    )


def test_a_script_without_a_main_guard_is_told_so(tmp_path):
    """Its workers load it again, and say no word of their own about that."""
    calls = "from bench.running.pool import run_tasks\nfrom bench.catalogue.suites import Limits\n"
    calls += "print(*run_tasks(range(3), abs, 2, Limits(60.0, 8.0)))\n"
    script = tmp_path / "script.py"
    script.write_text(calls)
    done = subprocess.run([sys.executable, script], capture_output=True, text=True)
    assert "An attempt has been made to start a new process" not in done.stderr
    assert 'call it below if __name__ == "__main__":' in done.stderr.splitlines()[-1]
    head, call = calls.rsplit("print", 1)
    script.write_text(f'{head}if __name__ == "__main__":\n    print{call}')
    done = subprocess.run([sys.executable, script], capture_output=True, text=True)
    assert (done.returncode, sorted(done.stdout)) == (0, sorted("(0, 0) (1, 1) (2, 2)\n"))


@pytest.mark.slow
def test_figures_need_no_backend_that_a_notebook_names(copied):
    """`!bench report DIR` in a notebook whose packages are not those of `bench`."""
    (copied / "report.html").unlink()
    command, environment = [*BENCH, "report", copied], os.environ | {"MPLBACKEND": "nonsense"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (copied / "report.html").exists()


def test_an_impatient_user_interrupts_once():
    clock = [100.0]
    handle = _interrupt_handler(lambda: clock[0])
    with pytest.raises(KeyboardInterrupt):
        handle(signal.SIGINT, None)
    clock[0] += 0.5
    handle(signal.SIGINT, None)
    clock[0] += 0.6
    with pytest.raises(KeyboardInterrupt):
        handle(signal.SIGINT, None)


@pytest.mark.parametrize(
    ("error", "status", "says"),
    [
        (SystemExit(0), 1, "an installed package has called exit(0); 'bench test NAME' with its "),
        (OSError(28, "No space left"), 2, "[Errno 28] No space left; fix this, and the same com"),
        (TrainingDiverged("step 3: nan"), 1, "step 3: nan; a lower learning rate may help"),
        (BadInput("a\x1b[2J: wrong"), 2, "a\\x1b[2J: wrong"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_an_error_in_a_command_is_one_line_and_an_exit_status(
    command, monkeypatch, error, status, says
):
    def fail(kind):
        raise error

    monkeypatch.setattr("bench.commands.listing.announced", fail)
    ended, _, err = command("list", "conditions")
    assert (ended, err.count("\n")) == (status, 1)
    assert err.startswith(f"bench: {says}")
