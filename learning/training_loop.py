"""The loop of all trainings: resuming, logging, sample sheets, checkpoints, stopping on NaN.

A run lives in one directory: `checkpoint.safetensors`, `losses.csv` and its image `losses.png`,
`sheets/step-*.png`. It continues from its checkpoint whenever it is started again; on a CPU in
float32 the continued run is bit for bit the uninterrupted one (same number of threads, and of
processes).
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
from learning.divergence import DivergenceDetector, TrainingDiverged
from learning.processes import Processes, connect, local_rank
from learning.trainer import NetworkTrainer
from learning.weights import understanding_header

_Built = TypeVar("_Built")
_RATE_WINDOW_S = 60.0
_MARGIN, _MARGIN_S = 0.01, 2.0  # of a time limit, and s: the start and the end of the process
_MAY_CHANGE_ON_RESUME = ("steps", "cadence", "source")
FULL_RATE = "checkpoint-full-rate.safetensors"  # of the last step before the learning rate falls
_RANDOM = "random"  # where a trainer's state holds the state of its random generator


@dataclass(frozen=True)
class StepReport:
    """The progress after `step` of `steps` steps.

    losses        means over the processes
    images        of all steps, those before a resume included
    images_per_s  of all processes, over the last minute, sheets and checkpoints included
    seconds_left  at that rate; both are None until a second step has been timed
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
    """Count denormal numbers as zeros inside.

    They slow training on a CPU by up to seven times. This is a setting of the calling thread,
    restored at the end, and of threads that start meanwhile.
    """
    before = sys.float_info.min / 2 == 0.0  # PyTorch sets it, but has no function that returns it
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
    """Train to `config.steps`, continuing a run in `out_dir`, and return the checkpoint's path.

    Under `torchrun` all processes train together, each with `config.batch` images a step.

    kind     the class of the trainer, which takes `learned`, `config`, device, processes, `further`
    learned  what is learned from (see `NetworkTrainer`)

    Raises as `prepare_device`, `learning.processes.connect` and `run`.
    """
    torch_device = prepare_device(device)
    torch.backends.cudnn.benchmark = torch_device.type == "cuda"  # shapes hardly change
    trainer = kind(learned, config, torch_device, connect(torch_device), **further)
    return run(trainer, out_dir, on_progress, limit, source)


def run(
    trainer: NetworkTrainer,
    out_dir: Path,
    on_progress: _OnProgress,
    limit: TimeLimit | None = None,
    source: str = "",
) -> Path:
    """Train to the steps of the configuration and return the path of the checkpoint.

    Continues from a checkpoint in `out_dir`. Where the number of steps has changed, the result is
    that of a training of that length from the beginning: a checkpoint whose last steps depend on
    the old length is replaced by the one that was kept from before them (FULL_RATE).

    limit   ends a training before its last step, early enough to write what the end writes, twice
            over; how long that takes is seen after the first step, which has a checkpoint for it
    source  names what the data were made of: data of the same source are continued on though other
            drivers or processors have made other bits of them; "": equal bits only

    Raises BadInput where the checkpoint belongs to another configuration, other data or another
    number of processes, has more steps, or is past the steps that both lengths have in common and
    no earlier one was kept; TrainingDiverged on NaN, infinity or a loss that explodes. Of several
    processes all call this, and the first one writes and reports.
    """
    config, processes = trainer.config, trainer.processes
    path, losses_csv = out_dir / checkpoint.FILE_NAME, out_dir / loss_log.FILE_NAME
    for file in (path, losses_csv):
        if file.exists() and not file.is_file():  # a pipe would be waited for
            raise BadInput(f"{file}: no regular file; remove it, or use another output directory")
    # as a checkpoint gives it back: in JSON tuples are lists
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
    detector = DivergenceDetector(loss_log.read_losses(losses_csv, first)[1])
    rows = loss_log.LossLog(losses_csv, first) if writes else None
    rate = _Rate(first)
    last_saved = first if path.is_file() else None
    ending = _Ending(limit, processes)

    def stopped(step: int, what: str) -> str:
        good = f"last good checkpoint: step {last_saved}, {path}"
        return f"step {step}: {what}; {good if last_saved is not None else 'no checkpoint yet'}"

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
        if logs:
            # before the checkpoint of the same step: then every step of a checkpoint is logged
            if rows:
                rows.add(step, losses)
                images = trainer.batch * processes.count
                speed = rate.steps_per_s()
                left = config.steps - step
                pace = (speed * images, left / speed) if speed else (None, None)
                on_progress(StepReport(step, config.steps, losses, step * images, *pace))
            if problem := detector.add(losses):
                raise diverged(step, problem)
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
            loss_log.write_loss_curves(losses_csv, out_dir / "losses.png", step)
        if last:
            break
        ending.note(saved=saves)
    processes.average({"done": 1.0})  # nobody goes on before the checkpoint is there for all
    return path


def _read(unread: list[dict[str, Tensor]], processes: Processes) -> list[dict[str, float]]:
    """Return the losses of each step, as means over the processes, in one transfer."""
    table = torch.stack([torch.stack([*losses.values()]) for losses in unread])
    means = processes.average(dict(enumerate(table.flatten().tolist())))
    rows = np.reshape(list(means.values()), table.shape).tolist()
    return [dict(zip(unread[0], row, strict=True)) for row in rows]


def _resume(trainer: NetworkTrainer, identity: Mapping[str, Any], path: Path) -> int:
    """Restore the trainer from `path` or its kept copy, and return the steps it has taken."""
    state, step, planned = _load(trainer, identity, path)
    steps = identity["steps"]
    independent = [trainer.independent_steps(length) for length in (planned, steps)]
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
    """Return this process's state, the steps taken and the steps planned, of a checkpoint.

    Raises BadInput where it is not of this training.
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
            f"{path}: the data are of the same objects but not bit for bit what it was trained on "
            "(another processor or driver); going on, not exactly as there"
        )
    count = 1 + sum(key.startswith(f"{_RANDOM}-") for key in state)
    if count != processes.count:
        raise BadInput(
            f"{path}: trained by {count} process(es), this is a run of {processes.count}; start "
            f"as many (torchrun --nproc_per_node {count}) or use another output directory"
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
    return f"{_RANDOM}-{rank}"


def seeded(seed: int, build: Callable[[], _Built]) -> _Built:
    """Return the result of `build`, called with PyTorch's global generator seeded.

    The generator is restored afterwards.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return build()


def prepare_device(
    device: str, gpu_available: Callable[[], bool] = torch.cuda.is_available
) -> torch.device:
    """Return the device; "auto" is the GPU where there is one, another for each process.

    Raises MissingDependency for a GPU where there is none.
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
    return torch.device(device) if device != "cuda" or rank is None else torch.device(device, rank)


class _Ending:
    """The end of a training that keeps a time limit, foreseen by what was slow so far."""

    def __init__(self, limit: TimeLimit | None, processes: Processes) -> None:
        self.limit, self.processes = limit, processes
        self.steps_s: deque[float] = deque(maxlen=20)  # a GPU is waited for in one step of ten
        self.writing_s = 0.0
        self.began = self.done = limit.clock() if limit else 0.0

    def is_due(self) -> bool:
        """Return whether the step that was just taken is the last; all processes say the same."""
        if self.limit is None:
            return False
        self.done = self.limit.clock()
        self.steps_s.append(self.done - self.began)
        reserve = max(self.steps_s) + 3 * self.writing_s + _MARGIN * self.limit.seconds + _MARGIN_S
        due = {"due": float(self.limit.left_s() < reserve)}
        return self.processes.average(due)["due"] > 0

    def note(self, *, saved: bool) -> None:
        """Take the time of what was written since the step."""
        if self.limit is not None:
            self.began = self.limit.clock()
            if saved:
                self.writing_s = max(self.writing_s, self.began - self.done)


class _Rate:
    """The speed of a training over the last minute."""

    def __init__(self, step: int) -> None:
        self.marks = deque([(time.perf_counter(), step)])

    def add(self, step: int) -> None:
        now = time.perf_counter()
        self.marks.append((now, step))
        while len(self.marks) > 2 and self.marks[1][0] < now - _RATE_WINDOW_S:
            self.marks.popleft()

    def steps_per_s(self) -> float | None:
        (t0, s0), (t1, s1) = self.marks[0], self.marks[-1]
        return (s1 - s0) / (t1 - t0) if s1 - s0 >= 2 and t1 > t0 else None


def _write_png(path: Path, image: NDArray[np.uint8]) -> None:
    from PIL import Image

    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(image).save(path)
