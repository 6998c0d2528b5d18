"""What both trainings share: resuming, logging, sample sheets, checkpoints, stopping on NaN.

A run lives in one directory: `checkpoint.safetensors`, `losses.csv`, `sheets/step-*.png`. It
continues from its checkpoint whenever it is started again; on a CPU in float32 the continued run
is bit for bit the uninterrupted one (same number of threads).
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from data_prep.failures import BadInput
from pc2pix import checkpoint

Precision = Literal["float32", "bfloat16"]
Built = TypeVar("Built")
RATE_WINDOW_S = 60.0
MAY_CHANGE_ON_RESUME = ("steps", "cadence")


@dataclass(frozen=True)
class Cadence:
    """Every how many steps something is written."""

    log: int = 10
    sheet: int = 500
    checkpoint: int = 500


DEFAULT_CADENCE = Cadence()


@dataclass(frozen=True)
class StepReport:
    """Progress after `step` of `steps` steps.

    images_per_s  over the last minute of this process, sheets and checkpoints included
    seconds_left  at that rate; both are None until a second step has been timed
    """

    step: int
    steps: int
    losses: Mapping[str, float]
    images_per_s: float | None
    seconds_left: float | None


OnProgress = Callable[[StepReport], None]


class TrainingDiverged(RuntimeError):
    """A loss or a weight became NaN or infinite."""


class Trainer(Protocol):
    """One kind of training, as the loop sees it."""

    kind: str
    batch: int

    def take_step(self) -> dict[str, float]:
        """One step of optimisation; the losses by name."""
        ...

    def state(self) -> dict[str, Tensor]:
        """Everything that the next step depends on."""
        ...

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """The inverse of `state`."""
        ...

    def sheet(self) -> NDArray[np.uint8]:
        """A picture [H, W, 3] of how far training has come. Must not change the state."""
        ...


def run(
    trainer: Trainer,
    config: Any,
    data_hash: str,
    out_dir: Path,
    on_progress: OnProgress,
) -> Path:
    """Train to `config.steps` and return the path of the checkpoint.

    Continues from a checkpoint in `out_dir`. Raises BadInput where that belongs to another
    configuration or other data, TrainingDiverged on NaN or infinity.
    """
    path = out_dir / checkpoint.FILE_NAME
    identity = {**dataclasses.asdict(config), "data": data_hash}
    first = _resume(trainer, identity, path) if path.is_file() else 0
    cadence: Cadence = config.cadence
    log = _LossLog(out_dir / "losses.csv", first)
    rate = _Rate(first)
    last_saved = first if path.is_file() else None

    def diverged(step: int, what: str) -> TrainingDiverged:
        good = f"last good checkpoint: step {last_saved}, {path}"
        return TrainingDiverged(
            f"step {step}: {what}; {good if last_saved is not None else 'no checkpoint yet'}"
        )

    for step in range(first + 1, config.steps + 1):
        losses = trainer.take_step()
        for name, value in losses.items():
            if not math.isfinite(value):
                raise diverged(step, f"{name} is {value}")
        rate.add(step)
        last = step == config.steps
        if step % cadence.log == 0 or last:
            # before the checkpoint of the same step: then every step of a checkpoint is logged
            log.add(step, losses)
            on_progress(_report(step, config.steps, losses, rate.steps_per_s(), trainer.batch))
        if step % cadence.checkpoint == 0 or last:
            state = trainer.state()
            if not checkpoint.all_finite(state.values()):
                raise diverged(step, "a weight is NaN or infinite")
            checkpoint.save(path, trainer.kind, step, identity, state)
            last_saved = step
        if step % cadence.sheet == 0 or last:
            _write_png(out_dir / "sheets" / f"step-{step:06d}.png", trainer.sheet())
    return path


def _report(
    step: int, steps: int, losses: Mapping[str, float], steps_per_s: float | None, batch: int
) -> StepReport:
    if steps_per_s is None:
        return StepReport(step, steps, losses, images_per_s=None, seconds_left=None)
    return StepReport(
        step,
        steps,
        losses,
        images_per_s=steps_per_s * batch,
        seconds_left=(steps - step) / steps_per_s,
    )


def _resume(trainer: Trainer, identity: Mapping[str, Any], path: Path) -> int:
    state, step, found = checkpoint.load(path, trainer.kind)
    for key in identity.keys() - set(MAY_CHANGE_ON_RESUME):
        if found.get(key) != identity[key]:
            raise BadInput(
                f"{path}: trained with {key} = {found.get(key)!r}, asked for {identity[key]!r}; "
                "use the same value or another output directory"
            )
    trainer.restore(state)
    return step


def hash_arrays(*arrays: NDArray[Any]) -> str:
    """A fingerprint of training data, so that a run is not continued on other data."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def seeded(seed: int, build: Callable[[], Built]) -> Built:
    """The result of `build` with PyTorch's global generator seeded, and restored afterwards."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return build()


def prepare_device(device: str) -> torch.device:
    """The device, with denormals flushed: they slow GAN training on a CPU by up to seven times."""
    torch.set_flush_denormal(True)
    return torch.device(device)


class _LossLog:
    """`losses.csv`. Rows after `step` belong to a run that was cut off, and go."""

    def __init__(self, path: Path, step: int) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path = path
        lines = path.read_text().splitlines() if path.is_file() and step > 0 else []
        # a row that was cut short is later than the checkpoint, for rows are written before it
        kept = lines[:1] + [line for line in lines[1:] if int(line.partition(",")[0] or 0) <= step]
        temporary = path.with_suffix(".csv.new")
        temporary.write_text("".join(f"{line}\n" for line in kept))
        temporary.replace(path)
        self.has_header = bool(kept)

    def add(self, step: int, losses: Mapping[str, float]) -> None:
        with self.path.open("a") as file:
            if not self.has_header:
                file.write(",".join(["step", *losses]) + "\n")
                self.has_header = True
            file.write(",".join([str(step), *(f"{v:.6g}" for v in losses.values())]) + "\n")


class _Rate:
    def __init__(self, step: int) -> None:
        self.marks = deque([(time.perf_counter(), step)])

    def add(self, step: int) -> None:
        now = time.perf_counter()
        self.marks.append((now, step))
        while len(self.marks) > 2 and self.marks[1][0] < now - RATE_WINDOW_S:
            self.marks.popleft()

    def steps_per_s(self) -> float | None:
        (t0, s0), (t1, s1) = self.marks[0], self.marks[-1]
        return (s1 - s0) / (t1 - t0) if s1 - s0 >= 2 and t1 > t0 else None


def _write_png(path: Path, picture: NDArray[np.uint8]) -> None:
    from PIL import Image

    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(picture).save(path)
