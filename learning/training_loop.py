"""The loop of all trainings: steps, logging, sheets of images, checkpoints, and resuming.

A training writes all its files into one directory. When it is started again there, it continues
from its checkpoint. On a CPU in float32, with the same numbers of threads and of processes, the
result is the same, bit for bit, as without the interruption.
"""

from __future__ import annotations

import dataclasses
import json
import math
import sys
import time
from collections import deque
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from data_prep.failures import BadInput, MissingDependency
from data_prep.progress import log
from learning import checkpoint, loss_log
from learning.configuration import Cadence, TimeLimit
from learning.divergence import TrainingDiverged
from learning.processes import Processes, connect, local_rank
from learning.tensor_files import understanding_header
from learning.trainer import NetworkTrainer

_Built = TypeVar("_Built")
_RATE_WINDOW_S = 60.0  # seconds over which the speed of a training is measured
# A training with a time limit keeps this share of it, and so many seconds more, for the start and
# the end of the process.
_MARGIN, _MARGIN_S = 0.01, 2.0
# Parts of the configuration that a continued training may have other values of.
_MAY_CHANGE_ON_RESUME = ("steps", "cadence", "source")
# The checkpoint of the last step before the learning rate falls. It is kept, because a training
# that is made longer afterwards has to continue from it.
FULL_RATE = "checkpoint-full-rate.safetensors"
_RANDOM = "random"  # name of the random generator's state in the state of a trainer


@dataclass(frozen=True)
class StepReport:
    """The progress of a training after `step` of `steps` steps.

    losses        of the step, as means over the processes
    images        number of images in all steps so far, also those before the training was continued
    images_per_s  images of all processes in a second, over the last minute, in which sheets and
                  checkpoints were also written; None until two steps have been timed
    seconds_left  for the other steps at that speed; None likewise
    """

    step: int
    steps: int
    losses: Mapping[str, float]
    images: int
    images_per_s: float | None
    seconds_left: float | None

    def __str__(self) -> str:
        """Return the report as "step 120/2000, chamfer 0.0312, 98.1 images/s, 0:10:12 left"."""
        parts = [f"step {self.step}/{self.steps}"]
        parts += [f"{name} {value:.4g}" for name, value in self.losses.items()]
        if self.images_per_s is not None and self.seconds_left is not None:
            minutes, seconds = divmod(round(self.seconds_left), 60)
            hours, minutes = divmod(minutes, 60)
            parts.append(f"{self.images_per_s:.1f} images/s")
            parts.append(f"{hours}:{minutes:02}:{seconds:02} left")
        return ", ".join(parts)


_OnProgress = Callable[[StepReport], None]


@contextmanager
def denormals_flushed() -> Generator[None]:
    """Let the processor treat denormal numbers as zeros within the block.

    Such numbers make training on a CPU up to seven times as slow. The setting is one of the calling
    thread, and of threads that it starts within the block; it is restored at the end.
    """
    # PyTorch can change the setting but not tell it. Half of the least normal number is denormal.
    before = sys.float_info.min / 2 == 0.0
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(before)


@denormals_flushed()
def train(
    kind: Callable[..., NetworkTrainer],
    learned: Any,
    config: Any,
    out_dir: Path,
    *,
    device: str = "cpu",
    on_progress: _OnProgress = lambda report: None,
    limit: TimeLimit | None = None,
    source: str = "",
    **further: Any,
) -> Path:
    """Train for `config.steps` steps, and return the path of the checkpoint.

    Where `out_dir` has a checkpoint, training continues from it. Under `torchrun` all processes
    train together, each with `config.batch` images in a step.

    kind         class of the trainer; it is called with `learned`, `config`, the device, the
                 processes, and `further` as keyword arguments
    learned      what is learned from (see `NetworkTrainer`)
    device       "cpu", "cuda", or "auto" for a GPU where there is one
    on_progress  called with a report after each step that is logged
    limit, source
                 see `run`

    Raises as `prepare_device`, `learning.processes.connect` and `run` do.
    """
    torch_device = prepare_device(device)
    # Let cuDNN find its fastest kernels by trying: this pays because shapes hardly ever change.
    torch.backends.cudnn.benchmark = torch_device.type == "cuda"
    trainer = kind(learned, config, torch_device, connect(torch_device), **further)
    return run(trainer, out_dir, on_progress, limit, source)


def run(
    trainer: NetworkTrainer,
    out_dir: Path,
    on_progress: _OnProgress,
    limit: TimeLimit | None = None,
    source: str = "",
) -> Path:
    """Train for the steps of the configuration, and return the path of the checkpoint.

    Training continues from a checkpoint in `out_dir`, if there is one. The number of steps may have
    changed since; the result is then that of a training which had this number from the beginning.
    Where the checkpoint's last steps depended on the old number, because the learning rate fell in
    them, training continues from the checkpoint that was kept from before (FULL_RATE).

    Where there are several processes, all of them call this, and the first one writes and reports.

    limit   a time after which training ends before its last step. It ends early enough that what
            is written at the end could be written twice; a checkpoint after the first step shows
            how long that takes
    source  name of what the data were made from. Another driver or processor makes data that differ
            in some bits; with the same source a training continues on them all the same. With ""
            it continues only on data with the same bits

    Raises BadInput where the checkpoint belongs to another configuration, other data or another
    number of processes; where it has more steps; and where its last steps depended on the old
    number of steps and no earlier checkpoint was kept. Raises TrainingDiverged where a loss or a
    weight is NaN or infinite.
    """
    config, processes = trainer.config, trainer.processes
    path, losses_csv = out_dir / checkpoint.FILE_NAME, out_dir / loss_log.FILE_NAME
    for file in (path, losses_csv):
        if file.exists() and not file.is_file():  # reading a pipe would wait without end
            raise BadInput(f"{file}: no regular file; remove it, or use another output directory")
    # Through JSON, which makes lists of tuples, so that it can be compared with a checkpoint's.
    stated = dataclasses.asdict(config) | {"data": trainer.fingerprint(), "source": source}
    identity = json.loads(json.dumps(stated))
    first = _resume(trainer, identity, path) if path.is_file() else 0
    if processes.average({"first": first})["first"] != first:
        raise BadInput(
            f"{path}: not all processes find the same checkpoint there (process {processes.rank}: "
            f"step {first}); train in a folder that all of them share"
        )
    cadence: Cadence = config.cadence
    writes = processes.rank == 0
    independent = trainer.independent_steps(config.steps)
    rows = loss_log.LossLog(losses_csv, first) if writes else None
    rate = _Rate(first)
    last_saved = first if path.is_file() else None
    ending = _Ending(limit, processes)

    def stopped(step: int, what: str) -> str:
        if last_saved is None:
            return f"step {step}: {what}; no checkpoint yet"
        return f"step {step}: {what}; last good checkpoint: step {last_saved}, {path}"

    def diverged(step: int, what: str) -> TrainingDiverged:
        return TrainingDiverged(stopped(step, what))

    unread: list[dict[str, Tensor]] = []
    for step in range(first + 1, config.steps + 1):
        try:
            unread.append(trainer.take_step())
        except torch.OutOfMemoryError as error:
            remedy = "give a smaller --batch and another --out, or use a GPU with more memory"
            raise BadInput(f"{stopped(step, 'the GPU has no memory left')}; {remedy}") from error
        rate.add(step)
        last = step == config.steps or ending.is_due()
        rehearses = limit is not None and step == first + 1
        logs = step % cadence.log == 0 or last or rehearses
        falls_next = step == independent and step < config.steps
        saves = step % cadence.checkpoint == 0 or last or falls_next or rehearses
        losses: dict[str, float] = {}
        if logs or saves:
            for number, losses in enumerate(_read(unread, processes), step - len(unread) + 1):
                for name, value in losses.items():
                    if not math.isfinite(value):
                        raise diverged(number, f"{name} is {value}")
            unread.clear()
        if logs and rows:
            # A row is written before the checkpoint of the same step, so that a checkpoint never
            # has a step that is not logged.
            rows.add(step, losses)
            images = trainer.batch * processes.count
            speed = rate.steps_per_s()
            report = StepReport(
                step=step,
                steps=config.steps,
                losses=losses,
                images=step * images,
                images_per_s=speed * images if speed else None,
                seconds_left=(config.steps - step) / speed if speed else None,
            )
            on_progress(report)
        if saves:
            state = _whole_state(trainer)
            bad = not checkpoint.all_finite(state.values())
            if processes.average({"bad": float(bad)})["bad"] > 0:
                raise diverged(step, "a weight is NaN or infinite")
            if writes:
                described = {**identity, "learning_rates": trainer.learning_rates(step)}
                if falls_next:
                    kept = out_dir / FULL_RATE
                    checkpoint.save(kept, trainer.kind, step, described, state)
                checkpoint.save(path, trainer.kind, step, described, state)
            last_saved = step
        if writes and (step % cadence.sheet == 0 or last or rehearses):
            image = trainer.sheet()
            if image is not None:
                _write_png(out_dir / "sheets" / f"step-{step:06d}.png", image)
        if last:
            break
        ending.note(saved=saves)
    # All processes wait for each other here: none goes on before the checkpoint is written.
    processes.average({"done": 1.0})
    return path


def _read(unread: list[dict[str, Tensor]], processes: Processes) -> list[dict[str, float]]:
    """Return the losses of each step as means over the processes.

    They are read from the device in one transfer.
    """
    table = torch.stack([torch.stack(list(losses.values())) for losses in unread])
    means = processes.average(dict(enumerate(table.flatten().tolist())))
    rows = np.reshape(list(means.values()), table.shape).tolist()
    return [dict(zip(unread[0], row, strict=True)) for row in rows]


def _resume(trainer: NetworkTrainer, identity: Mapping[str, Any], path: Path) -> int:
    """Restore the trainer from a checkpoint, and return the number of steps that it has taken.

    It is the one at `path`, or the one that was kept from before the learning rate fell.
    """
    state, step, planned = _load(trainer, identity, path)
    steps = identity["steps"]
    # The first steps that trainings of both lengths have in common.
    independent = [trainer.independent_steps(planned), trainer.independent_steps(steps)]
    common = min((count for count in independent if count is not None), default=step)
    if steps != planned and step > common:
        problem = (
            f"{path}: step {step} of a training of {planned} steps; one of {steps} has another "
            f"learning rate from step {common + 1} on, and no checkpoint from before that is "
            f"there; use {planned} steps or another output directory"
        )
        kept = path.with_name(FULL_RATE)
        if kept.is_file():
            state, step, _ = _load(trainer, identity, kept)
        if step > common:
            raise BadInput(problem)
    if step > steps:
        raise BadInput(
            f"{path}: has {step} steps already, and {steps} are asked for; give --steps {step} or "
            "more, or another output directory"
        )
    try:
        trainer.restore(state)
    except (KeyError, RuntimeError) as error:
        reason = (str(error).splitlines() or [""])[-1].strip()
        raise BadInput(
            f"{path}: does not fit the networks of this version ({reason}); use the version that "
            "wrote it, or another output directory"
        ) from error
    return step


def _load(
    trainer: NetworkTrainer, identity: Mapping[str, Any], path: Path
) -> tuple[dict[str, Tensor], int, int]:
    """Return the state of this process, the steps taken and the steps planned of a checkpoint.

    Raises BadInput where the checkpoint is not of this training.
    """
    state, step, config = checkpoint.load(path, trainer.kind)
    processes = trainer.processes
    same_source = identity["source"] and config.get("source") == identity["source"]
    for key in identity.keys() - set(_MAY_CHANGE_ON_RESUME):
        if config.get(key) != identity[key] and not (key == "data" and same_source):
            raise BadInput(
                f"{path}: trained with {key} = {config.get(key)!r}, asked for {identity[key]!r}; "
                "use the same value or another output directory"
            )
    if same_source and config["data"] != identity["data"] and processes.rank == 0:
        log(
            f"{path}: the data are of the same objects as those that it was trained on, but some "
            "bits differ (another processor or driver made them); training continues, and its "
            "result will differ a little"
        )
    count = 1 + sum(key.startswith(f"{_RANDOM}-") for key in state)
    if count != processes.count:
        raise BadInput(
            f"{path}: trained by {count} process(es), this is a run of {processes.count}; start "
            f"{count} (torchrun --nproc_per_node {count}) or use another output directory"
        )
    if processes.rank > 0:
        state[_RANDOM] = state[_random_of(processes.rank)]
    with understanding_header(path, "choose another output directory"):
        return state, step, int(config["steps"])


def _whole_state(trainer: NetworkTrainer) -> dict[str, Tensor]:
    """Return the trainer's state and the random states of the other processes."""
    state = trainer.state()
    if trainer.processes.count > 1:
        _, *others = trainer.processes.gather(state[_RANDOM])
        state |= {_random_of(rank): other for rank, other in enumerate(others, start=1)}
    return state


def _random_of(rank: int) -> str:
    """Return the name of the random state of a process after the first in a checkpoint."""
    return f"{_RANDOM}-{rank}"


def seeded(seed: int, build: Callable[[], _Built]) -> _Built:
    """Return the result of `build`, which is called with PyTorch's global generator seeded.

    The state of the generator is restored afterwards.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return build()


def prepare_device(
    device: str, gpu_available: Callable[[], bool] = torch.cuda.is_available
) -> torch.device:
    """Return the device of this process.

    device         "cpu", "cuda", or "auto" for a GPU where there is one. Where several processes
                   train on a machine, each has a GPU of its own
    gpu_available  tells whether there is a GPU

    Raises MissingDependency for "cuda" where there is no usable GPU.
    """
    has_gpu = gpu_available()
    if device == "auto":
        device = "cuda" if has_gpu else "cpu"
    if device == "cuda" and not has_gpu:
        raise MissingDependency(
            f"--device cuda: PyTorch {torch.__version__} finds no usable GPU; use --device cpu, or "
            "install a build of PyTorch and a driver that go together"
        )
    rank = local_rank()
    if device == "cuda" and rank is not None:
        return torch.device(device, rank)
    return torch.device(device)


class _Ending:
    """The decision when a training with a time limit ends, by how long steps and writing took.

    steps_s    seconds of the last steps. One step in ten waits for the GPU, so that single ones
               tell little
    writing_s  seconds that writing a checkpoint and what goes with it took, at most
    """

    def __init__(self, limit: TimeLimit | None, processes: Processes) -> None:
        self.limit, self.processes = limit, processes
        self.steps_s: deque[float] = deque(maxlen=20)
        self.writing_s = 0.0
        self.began = self.done = limit.clock() if limit else 0.0

    def is_due(self) -> bool:
        """Return whether the step that was just taken is the last, the same for all processes."""
        if self.limit is None:
            return False
        self.done = self.limit.clock()
        self.steps_s.append(self.done - self.began)
        # Time for one more step, for writing after it and at the end, and some to spare.
        margin = _MARGIN * self.limit.seconds + _MARGIN_S
        reserve = max(self.steps_s) + 3 * self.writing_s + margin
        due = {"due": float(self.limit.left_s() < reserve)}
        return self.processes.average(due)["due"] > 0

    def note(self, *, saved: bool) -> None:
        """Note the time that was taken since the step; `saved` tells whether for a checkpoint."""
        if self.limit is not None:
            self.began = self.limit.clock()
            if saved:
                self.writing_s = max(self.writing_s, self.began - self.done)


class _Rate:
    """The speed of a training over the last minute.

    marks  seconds and numbers of steps, the oldest first
    """

    def __init__(self, step: int) -> None:
        self.marks = deque([(time.perf_counter(), step)])

    def add(self, step: int) -> None:
        """Note that a step has just ended."""
        now = time.perf_counter()
        self.marks.append((now, step))
        while len(self.marks) > 2 and self.marks[1][0] < now - _RATE_WINDOW_S:
            self.marks.popleft()

    def steps_per_s(self) -> float | None:
        """Return the steps in a second; None before two steps have ended."""
        (first_s, first_step), (last_s, last_step) = self.marks[0], self.marks[-1]
        if last_step - first_step < 2 or last_s <= first_s:
            return None
        return (last_step - first_step) / (last_s - first_s)


def _write_png(path: Path, image: NDArray[np.uint8]) -> None:
    from PIL import Image

    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(image).save(path)
