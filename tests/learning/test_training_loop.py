from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
import torch

from data_prep.failures import BadInput
from learning import checkpoint, training_loop
from learning.divergence import TrainingDiverged
from learning.training_loop import Cadence

CADENCE = Cadence(log=1, sheet=100, checkpoint=2)


@dataclass(frozen=True)
class Part:
    widths: tuple[int, ...] = (1, 2)


@dataclass(frozen=True)
class Config:
    """With what JSON has no word for: a tuple, in a dataclass within."""

    steps: int
    part: Part = field(default_factory=Part)
    rate: float = 0.1
    cadence: Cadence = CADENCE


class Counter:
    """A training whose state is how many steps it has taken."""

    kind = "counter"
    batch = 1

    def __init__(self, losses=None):
        self.count = torch.zeros((), dtype=torch.int64)
        self.losses = losses or {}

    def take_step(self):
        self.count += 1
        return {"loss": torch.tensor(self.losses.get(int(self.count), 1.0))}

    def state(self):
        return {"count": self.count.clone(), training_loop.RANDOM: torch.Generator().get_state()}

    def restore(self, state):
        self.count = state["count"].clone()

    def sheet(self):
        return np.full((4, 4, 3), 255, np.uint8)


def start(out_dir, config, trainer=None, data="data"):
    trainer = trainer or Counter()
    reports = []
    path = training_loop.run(trainer, config, data, out_dir, reports.append)
    return [report.step for report in reports], checkpoint.load(path, "counter")


def test_a_run_goes_on_where_it_was(tmp_path):
    """Also where its configuration has tuples, which JSON gives back as lists."""
    steps, _ = start(tmp_path, Config(steps=3))
    assert steps == [1, 2, 3]
    steps, (state, step, _) = start(tmp_path, Config(steps=5))
    assert steps == [4, 5]
    assert step == 5
    assert state["count"] == 5
    assert start(tmp_path, Config(steps=5))[0] == []
    assert start(tmp_path, Config(steps=6, cadence=Cadence(1, 9, 9)))[0] == [6]


@pytest.mark.parametrize(
    ("config", "data", "told"),
    [
        (Config(steps=5, part=Part(widths=(1, 3))), "data", r"part = .*\[1, 2\].*\[1, 3\]"),
        (Config(steps=5, rate=0.2), "data", r"rate = 0\.1, asked for 0\.2; use the same value or"),
        (Config(steps=5), "others", "data = 'data', asked for 'others'"),
    ],
)
def test_another_run_is_not_continued(tmp_path, config, data, told):
    start(tmp_path, Config(steps=2))
    before = (tmp_path / checkpoint.FILE_NAME).read_bytes()
    with pytest.raises(BadInput, match=told) as error:
        start(tmp_path, config, data=data)
    assert "\n" not in str(error.value)
    assert (tmp_path / checkpoint.FILE_NAME).read_bytes() == before


def test_a_loss_that_is_no_number_stops_the_run(tmp_path):
    trainer = Counter({4: math.nan})
    with pytest.raises(TrainingDiverged, match=r"step 4: loss is nan; last good .*: step 2, "):
        start(tmp_path, Config(steps=9), trainer)
    assert checkpoint.load(tmp_path / checkpoint.FILE_NAME, "counter")[1] == 2


@pytest.mark.parametrize(
    ("cadence", "stopped", "good"),
    [
        (Cadence(log=3, sheet=100, checkpoint=100), 6, "no checkpoint yet"),
        (Cadence(log=100, sheet=100, checkpoint=5), 5, "no checkpoint yet"),
        (Cadence(log=100, sheet=100, checkpoint=3), 6, "last good checkpoint: step 3, "),
        (Cadence(log=100, sheet=100, checkpoint=100), 9, "no checkpoint yet"),
    ],
)
def test_losses_are_read_when_they_are_logged_or_a_checkpoint_is_written(
    tmp_path, cadence, stopped, good
):
    """The step that is named is the one that was wrong, and nothing after it is saved."""
    trainer = Counter({4: math.inf})
    with pytest.raises(TrainingDiverged, match=f"^step 4: loss is inf; {good}"):
        start(tmp_path, Config(steps=9, cadence=cadence), trainer)
    assert trainer.count == stopped
    path = tmp_path / checkpoint.FILE_NAME
    assert not path.exists() or checkpoint.load(path, "counter")[1] == 3


def test_seeding_leaves_the_global_generator_alone():
    torch.manual_seed(5)
    before = torch.random.get_rng_state()
    one, two = (training_loop.seeded(7, lambda: torch.rand(3)) for _ in range(2))
    assert torch.equal(one, two)
    assert torch.equal(torch.random.get_rng_state(), before)
    assert not torch.equal(training_loop.seeded(8, lambda: torch.rand(3)), one)


def test_fingerprints_of_data():
    a = np.arange(6, dtype=np.float32)
    known = training_loop.hash_arrays(a, a)
    assert training_loop.hash_arrays(a.copy(), a) == known
    different = [(a,), (a, a, a), (a, a + 1), (a.reshape(2, 3), a), (a.astype(np.int32), a)]
    assert len({known, *(training_loop.hash_arrays(*d) for d in different)}) == 6
    wide = np.arange(12, dtype=np.float32)[::2]
    assert training_loop.hash_arrays(wide) == training_loop.hash_arrays(wide.copy())
