"""The faulty method as a plug-in of another package, and what its run is judged by."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from bench.catalogue.suites import SUITES
from tests.robustness import faults
from tests.robustness.faults import Found, choose, planned, problems
from tests.robustness.faulty_methods import FAULTS, announce


@pytest.fixture(scope="module")
def jobs():
    return planned(replace(SUITES[0], methods=("splat",)), 3)


def test_each_fault_is_drawn_for_two_items(jobs) -> None:
    faulty = choose(jobs)
    assert sorted(faulty.values()) == sorted([*FAULTS, *FAULTS])
    assert set(faulty) <= {f"{job.condition} {job.object.object_id}" for job in jobs}


def test_problems_are_items_that_failed_otherwise_than_planned(jobs) -> None:
    names = [f"{job.condition} {job.object.object_id}" for job in jobs[:4]]
    faulty = dict(zip(names[:3], ("blank", "nan", "hang"), strict=True))
    failed = {
        names[0]: "draw: 2 of 2 pictures are blank",
        names[1]: "crash: the worker died (SIGSEGV)",
        names[3]: "ValueError: x",
    }
    found = Found(failed, len(jobs), processes=2, seconds=10.0)
    assert problems(jobs, faulty, found) == [
        f"{names[1]}: nan, but 'crash: the worker died (SIGSEGV)'",
        f"{names[2]}: hang, but 'not failed'",
        f"{names[3]}: healthy, but 'ValueError: x'",
    ]
    assert found.lost == 1
    assert found.rate == (len(jobs) - 3) / 10.0


def test_the_method_is_found_by_a_process_that_knows_only_the_path(tmp_path: Path) -> None:
    """As a spawned worker does: the plug-in's entry point names a module of this folder."""
    announce(tmp_path, {faults.ID: f"{faults.__name__}:METHOD"})
    root = Path(__file__).parents[2]
    code = "from bench.catalogue.methods import find_method as f; print(f('faulty-apss').source)"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, (tmp_path, root)))}
    command = (sys.executable, "-c", code)
    found = subprocess.check_output(command, cwd=tmp_path, env=environment, text=True)
    assert found == f"{faults.METHOD.source}\n"
