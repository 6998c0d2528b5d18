from __future__ import annotations

import contextlib
import json
import math
import os
from dataclasses import dataclass, field

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from data_prep.failures import BadInput
from learning import checkpoint, training_loop
from learning.configuration import Cadence
from learning.divergence import TrainingDiverged
from learning.trainer import CooledTrainer, NetworkTrainer, hash_arrays

CADENCE = Cadence(log=1, sheet=100, checkpoint=2)


@dataclass(frozen=True)
class Part:
    widths: tuple[int, ...] = (1, 2)


@dataclass(frozen=True)
class Config:
    """A configuration with a tuple, in a dataclass within: JSON has no word for it."""

    steps: int
    part: Part = field(default_factory=Part)
    rate: float = 0.1
    seed: int = 0
    cadence: Cadence = CADENCE


class Counter(NetworkTrainer):
    """A training whose state is how many steps it has taken."""

    kind = "counter"
    batch = 1
    parts = ("random",)

    def __init__(self, config, losses=None, data=0):
        super().__init__(np.array(data), config)
        self.losses = losses or {}

    def take_step(self):
        self.steps_done += 1
        return {"loss": torch.tensor(self.losses.get(int(self.steps_done), 1.0))}

    def learning_rates(self, steps):
        return "none"

    def sheet(self):
        return np.full((4, 4, 3), 255, np.uint8)


class Annealed(Counter):
    """A training whose state has the sum of its rates, which fall over the last three steps."""

    kept = ("steps_done", "total")

    def __init__(self, config):
        super().__init__(config)
        self.total = torch.zeros((), dtype=torch.float64)

    def take_step(self):
        self.total += min(1.0, (self.config.steps - int(self.steps_done)) / 3)
        super().take_step()
        return {"loss": self.total.clone()}

    def independent_steps(self, steps):
        return max(0, steps - 3)


def start(out_dir, config, trainer=None, source="", **more):
    trainer = trainer or Counter(config, **more)
    reports = []
    path = training_loop.run(trainer, out_dir, reports.append, source=source)
    return [report.step for report in reports], checkpoint.load(path, "counter")


def test_a_run_goes_on_where_it_was_and_is_not_given_for_a_shorter_one(tmp_path):
    """The configuration has tuples, which JSON gives back as lists."""
    assert start(tmp_path, Config(steps=3))[0] == [1, 2, 3]
    steps, (state, step, _) = start(tmp_path, Config(steps=5))
    assert (steps, step, int(state["steps_done"])) == ([4, 5], 5, 5)
    assert start(tmp_path, Config(steps=6, cadence=Cadence(1, 9, 9)))[0] == [6]
    with pytest.raises(BadInput, match=r"has 6 steps already, and 5 are asked for; give --steps 6"):
        start(tmp_path, Config(steps=5))
    assert start(tmp_path, Config(steps=6))[0] == []


def anneal(out_dir, steps, cadence=CADENCE):
    config = Config(steps=steps, cadence=cadence)
    return start(out_dir, config, Annealed(config))


class Stopped(Exception):
    pass


@pytest.mark.parametrize(
    ("length", "stopped"),
    # on both sides of the last step that is the same in both lengths; to the end: 8
    [(5, 2), (5, 3), (7, 5), (7, 8), (8, 6), (9, 5), (9, 6), (9, 8)],
)
def test_a_run_of_another_length_is_one_of_that_length_from_the_beginning(
    tmp_path, length, stopped
):
    """Planned for 8 steps, where the rate falls after the fifth, and stopped after any of them."""
    _, (expected, *_) = anneal(tmp_path / "whole", length)
    cut = tmp_path / "cut"

    def stop(report):
        if report.step == stopped + 1:
            raise Stopped

    config = Config(steps=8, cadence=Cadence(log=1, sheet=100, checkpoint=1))
    with contextlib.suppress(Stopped):
        training_loop.run(Annealed(config), cut, stop)
    if length < 8 and stopped > length - 3:
        before = (cut / checkpoint.FILE_NAME).read_bytes()
        message = (
            f"step {stopped} of a training of 8 steps; one of {length} has another learning rate "
        )
        message += f"from step {length - 2} on, and no checkpoint .* use 8 steps or another output"
        with pytest.raises(BadInput, match=message):
            anneal(cut, length)
        assert (cut / checkpoint.FILE_NAME).read_bytes() == before
        return
    steps, (actual, step, _) = anneal(cut, length)
    assert step == length
    assert actual["total"] == expected["total"]
    assert length == 8 or steps[0] == min(stopped, 5) + 1
    assert (cut / "losses.csv").read_text() == (tmp_path / "whole" / "losses.csv").read_text()
    if stopped == 8 < length:  # where nothing from before the rate fell is kept, it is only ended
        anneal(tmp_path / "bare", 8)
        (tmp_path / "bare" / training_loop.FULL_RATE).unlink()
        with pytest.raises(BadInput, match="step 8 of a training of 8 steps; one of 9 has another"):
            anneal(tmp_path / "bare", 9)
        assert anneal(tmp_path / "bare", 8)[0] == []


@pytest.mark.parametrize("name", ["checkpoint.safetensors", "losses.csv"])
def test_a_pipe_is_not_waited_for(tmp_path, name):
    os.mkfifo(tmp_path / name)
    with pytest.raises(BadInput, match=f"{name}: no regular file; remove it"):
        start(tmp_path, Config(steps=1))


@pytest.mark.parametrize(
    "changes",
    [
        *({"step": text} for text in ("x", "-1")),
        *({"config": text} for text in ("[", "[]", None, "{}")),
    ],
)
def test_a_checkpoint_whose_header_is_damaged(tmp_path, changes):
    """The last one says nothing about the length of the run."""
    path = tmp_path / checkpoint.FILE_NAME
    start(tmp_path, Config(steps=2))
    tensors, header = checkpoint.read_safetensors(path)
    if changes == {"config": "{}"}:
        config = json.loads(header["config"])
        changes = {"config": json.dumps({k: v for k, v in config.items() if k != "steps"})}
    save_file(tensors, path, {k: v for k, v in (header | changes).items() if v is not None})
    with pytest.raises(BadInput, match="its header cannot be read") as error:
        start(tmp_path, Config(steps=3))
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("config", "data", "message"),
    [
        (Config(steps=5, part=Part(widths=(1, 3))), 0, r"part = .*\[1, 2\].*\[1, 3\]"),
        (Config(steps=5, rate=0.2), 0, r"rate = 0\.1, asked for 0\.2; use the same value or"),
        (Config(steps=5), 1, "data = '[0-9a-f]{64}', asked for '[0-9a-f]{64}'"),
    ],
)
def test_another_run_is_not_continued(tmp_path, config, data, message):
    start(tmp_path, Config(steps=2))
    before = (tmp_path / checkpoint.FILE_NAME).read_bytes()
    with pytest.raises(BadInput, match=message) as error:
        start(tmp_path, config, data=data)
    assert "\n" not in str(error.value)
    assert (tmp_path / checkpoint.FILE_NAME).read_bytes() == before


def test_other_bits_of_the_same_source_are_continued_on_and_said(tmp_path, capsys):
    start(tmp_path, Config(steps=2), source="a")
    assert start(tmp_path, Config(steps=3), source="a", data=1)[0] == [3]
    assert "some bits differ" in capsys.readouterr().err
    assert start(tmp_path, Config(steps=4), source="a", data=1)[0] == [4]
    assert capsys.readouterr().err == ""
    with pytest.raises(BadInput, match="data = "):
        start(tmp_path, Config(steps=5), source="b", data=0)


def test_a_checkpoint_of_other_networks(tmp_path):
    start(tmp_path, Config(steps=2))
    with pytest.raises(BadInput, match=r"safetensors: does not fit the networks .*'total'"):
        start(tmp_path, Config(steps=2), Annealed(Config(steps=2)))


@pytest.mark.parametrize(("step", "good"), [(1, "no checkpoint yet"), (4, "checkpoint: step 2, ")])
def test_a_gpu_without_memory_is_one_line(tmp_path, step, good):
    class Large(Counter):
        def take_step(self):
            if int(self.steps_done) + 1 == step:
                raise torch.OutOfMemoryError("CUDA out of memory.\nTried to allocate 2 GiB")
            return super().take_step()

    with pytest.raises(BadInput, match=f"^step {step}: the GPU has no memory left; .*{good}") as e:
        start(tmp_path, Config(steps=9), Large(Config(steps=9)))
    assert "; give a smaller --batch and another --out" in str(e.value)
    assert "\n" not in str(e.value)


@pytest.mark.parametrize(
    ("cadence", "stopped", "good"),
    [
        (Cadence(log=1, sheet=100, checkpoint=3), 4, "last good checkpoint: step 3, "),
        (Cadence(log=3, sheet=100, checkpoint=100), 6, "no checkpoint yet"),
        (Cadence(log=100, sheet=100, checkpoint=3), 6, "last good checkpoint: step 3, "),
        (Cadence(log=100, sheet=100, checkpoint=100), 9, "no checkpoint yet"),
    ],
)
def test_losses_are_read_when_they_are_logged_or_a_checkpoint_is_written(
    tmp_path, cadence, stopped, good
):
    """The step that is named is the one that was wrong, and nothing after it is saved."""
    value = math.inf if cadence.log > 1 else math.nan
    config = Config(steps=9, cadence=cadence)
    trainer = Counter(config, {4: value})
    with pytest.raises(TrainingDiverged, match=f"^step 4: loss is {value}; {good}"):
        start(tmp_path, config, trainer)
    assert trainer.steps_done == stopped
    path = tmp_path / checkpoint.FILE_NAME
    assert not path.exists() or checkpoint.load(path, "counter")[1] == 3


def test_seeding_leaves_the_global_generator_alone():
    torch.manual_seed(5)
    before = torch.random.get_rng_state()
    first, second = (training_loop.seeded(7, lambda: torch.rand(3)) for _ in range(2))
    assert torch.equal(first, second)
    assert torch.equal(torch.random.get_rng_state(), before)
    assert not torch.equal(training_loop.seeded(8, lambda: torch.rand(3)), first)


def test_fingerprints_of_data():
    a = np.arange(6, dtype=np.float32)
    known = hash_arrays(a, a)
    assert hash_arrays(a.copy(), a) == known
    different = [(a,), (a, a, a), (a, a + 1), (a.reshape(2, 3), a), (a.astype(np.int32), a)]
    assert len({known, *(hash_arrays(*d) for d in different)}) == 6
    wide = np.arange(12, dtype=np.float32)[::2]
    assert hash_arrays(wide) == hash_arrays(wide.copy())


@dataclass(frozen=True)
class Cooled:
    """A configuration whose rate falls over the last `cool_down` steps."""

    steps: int
    cool_down: int
    learning_rate: float = 0.8
    seed: int = 0


def test_the_rate_falls_in_equal_steps_and_the_last_step_has_one():
    """Of 4 steps of cooling down the first has the whole rate, the last a quarter: none has 0."""
    trainer = CooledTrainer(None, Cooled(steps=8, cool_down=4))
    rates = [trainer.rate(done) for done in range(8)]
    assert rates == pytest.approx([0.8] * 5 + [0.6, 0.4, 0.2])
    assert trainer.learning_rates(8) == "0.8 up to step 5, then falling linearly to 0.2 at step 8"
    assert trainer.learning_rates(5) == "0.8"
    short = CooledTrainer(None, Cooled(steps=2, cool_down=4))
    expected = "falling linearly from 0.4 at step 1 to 0.2 at step 2"
    assert short.learning_rates(2) == expected
    constant = CooledTrainer(None, Cooled(steps=3, cool_down=0))
    assert [constant.rate(done) for done in range(3)] == [0.8] * 3
