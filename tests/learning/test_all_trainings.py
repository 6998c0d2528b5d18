"""Properties of every training, whichever network it trains."""

from __future__ import annotations

import math
import shutil
import sys

import pytest
import torch
from PIL import Image

from data_prep.failures import BadInput
from learning import checkpoint
from learning.configuration import TimeLimit

from .trainings import TRAININGS


class Killed(Exception):
    pass


def kill_at(step):
    def on_progress(report):
        if report.step == step:
            raise Killed

    return on_progress


def require_equal(first, other, kind, steps):
    """Checkpoints and logs of two runs, bit for bit."""
    (state, step, _), (actual, second_step, _) = (checkpoint.load(p, kind) for p in (first, other))
    assert step == second_step == steps
    assert state.keys() == actual.keys()
    assert all(torch.equal(state[key], actual[key]) for key in state)
    logs = [(path.parent / "losses.csv").read_text() for path in (first, other)]
    assert logs[0] == logs[1]
    rows = [row.split(",")[0] for row in logs[0].splitlines()]
    assert rows == ["step", *map(str, range(1, steps + 1))]


QUICK = ("autoencoder", "splat-net")
EACH = [
    pytest.param(name, marks=[] if name in QUICK else pytest.mark.slow, id=name)
    for name in TRAININGS
]


@pytest.mark.parametrize("name", EACH)
def test_a_killed_run_resumes_bit_for_bit_and_may_be_lengthened(name, tmp_path):
    """Planned for 5 steps and killed, ended, then lengthened to 6: as one of 6 from the beginning,
    though its learning rate had fallen. Nothing else may change."""
    train, cut, folder = TRAININGS[name], tmp_path / "cut", tmp_path / "whole"
    # killed after step 3 is logged: the checkpoint is that of step 2, the row of step 3 must go
    with pytest.raises(Killed):
        train(cut, 5, kill_at(3))
    path = cut / checkpoint.FILE_NAME
    # splat-net writes one more before its rate falls, after step 3; it is killed before that
    assert checkpoint.load(path, train.kind)[1] == 2
    assert train(cut, 5) == path
    before = path.read_bytes()
    assert train(cut, 5, kill_at(1)) == path
    assert path.read_bytes() == before, "a finished run is not trained again"
    with pytest.raises(BadInput, match=r"seed = 0, asked for 1; use"):
        train(cut, 6, seed=1)
    reports, flushed = [], set()

    def on_progress(report):
        reports.append(report)
        flushed.add(sys.float_info.min / 2 == 0.0)

    whole = train(folder, 6, on_progress)
    train(cut, 6)
    require_equal(whole, path, train.kind, 6)
    assert [report.step for report in reports] == list(range(1, 7))
    assert reports[0].images_per_s is None
    assert reports[-1].images_per_s > 0
    assert reports[-1].seconds_left == 0
    assert flushed == {True}
    assert sys.float_info.min / 2 > 0.0, "denormal numbers are flushed inside only"
    sheets = sorted((folder / "sheets").glob("*"))
    expected = ["step-000004.png", "step-000006.png"] if train.sheet else []
    assert [sheet.name for sheet in sheets] == expected
    for sheet in sheets:
        with Image.open(sheet) as image:
            assert image.size == train.sheet
    assert not list(folder.glob(".*"))


@pytest.mark.parametrize("name", [case for case in EACH if TRAININGS[case.id].sheet])
def test_what_a_time_limit_ended_goes_on_elsewhere_bit_for_bit(name, tmp_path):
    """A step's report takes 10 s, and thrice that is kept for the end: of 60 s four steps are left.

    The first has a checkpoint and a sheet, which show how long they take."""
    train, folder, now = TRAININGS[name], tmp_path / "here", [0.0]

    def on_progress(report):
        now[0] += 10.0
        assert (folder / checkpoint.FILE_NAME).exists() == (report.step > 1)

    path = train(folder, 6, on_progress, TimeLimit(60.0, "1m", lambda: now[0]))
    assert checkpoint.load(path, train.kind)[1] == 4
    sheets = sorted(sheet.name for sheet in (folder / "sheets").glob("*"))
    assert sheets == ["step-000001.png", "step-000004.png"]
    moved = shutil.copytree(folder, tmp_path / "elsewhere")
    require_equal(train(tmp_path / "whole", 6), train(moved, 6), train.kind, 6)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in TRAININGS if TRAININGS[name].sheet])
def test_bfloat16_trains(name, tmp_path):
    TRAININGS[name](tmp_path / "x", 1, precision="bfloat16")
    last = (tmp_path / "x" / "losses.csv").read_text().splitlines()[-1]
    assert all(math.isfinite(float(value)) for value in last.split(","))
