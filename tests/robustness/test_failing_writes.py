from __future__ import annotations

import errno
import subprocess
import sys
from pathlib import Path

import pytest

from tests.robustness.failing_writes import Writes, failing

ROOT = Path(__file__).parents[2]


def test_writes_are_counted_and_the_one_that_is_to_fail_does(tmp_path):
    folder = tmp_path / "run"
    with failing(Writes(folder)) as none, failing(counted := Writes(folder)):
        folder.mkdir()
        (folder / "file").write_bytes(b"1234")
        (tmp_path / "elsewhere").write_bytes(b"")
    assert none is None
    assert counted.count == 3  # the folder, the file, its bytes
    with failing(Writes(folder, 2, "ENOSPC")), pytest.raises(OSError) as error:
        (folder / "file").write_bytes(b"1234")
    assert error.value.errno == errno.ENOSPC
    assert (folder / "file").read_bytes() == b"12"  # a disk takes what it has room for


@pytest.mark.slow
@pytest.mark.opengl
def test_a_run_can_go_on_after_any_write_has_failed():
    """Some writes here; all of them in a run of the program."""
    command = [sys.executable, "-m", "tests.robustness.failing_writes", "--every", "50"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.endswith("writes failed in 3 ways each: 0 wrong\n")
