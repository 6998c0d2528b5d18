"""The parts that trainings share: objects, configuration, time limit, and the run of one."""

from __future__ import annotations

import hashlib
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import torch

from bench.training.options import DEFAULT_OBJECTS
from data_prep.datasets.registry import SceneObject, open_dataset
from data_prep.failures import BadInput
from data_prep.progress import log, step_progress
from learning import training_loop
from learning.configuration import TimeLimit
from learning.processes import is_first
from learning.trainer import CooledTrainer, NetworkTrainer
from learning.training_loop import StepReport

Config = TypeVar("Config")
# The kinds of trainings whose batches are counted in images; all others count clouds.
_TRAINED_ON_IMAGES = ("gan", "splat-net", "fused-net")


@contextmanager
def data_in_time(limit: TimeLimit | None, out: Path) -> Iterator[None]:
    """Return a context that raises BadInput where the time is over before the first step.

    Until then the data are being made. That is interrupted as by Ctrl-C, which leaves no
    half-written file. `run_training` ends this watch, as its steps look at the clock themselves.
    """
    if limit is None:
        yield
        return
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    # The alarm repeats every second: a package that is being imported may swallow the exception.
    signal.setitimer(signal.ITIMER_REAL, max(limit.left_s(), 1e-3), 1.0)
    try:
        yield
    except KeyboardInterrupt:
        if limit.left_s() > 0:
            raise
        raise BadInput(
            f"--for {limit.text}: over before the first step, while the data were being made; "
            f"what {out} has is kept; give more time, or fewer --objects"
        ) from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def run_training(
    kind: type[NetworkTrainer],
    learned: Any,
    config: Any,
    options: Any,
    objects: Sequence[SceneObject],
    also: str = "",
    **further: Any,
) -> Path:
    """Train a network and return its checkpoint, with progress on stderr.

    kind     the class of the trainer
    learned  the data that are learned from (see `learning.trainer.NetworkTrainer`)
    objects  the objects that the data were made of; their fingerprints identify the data on any
             machine
    also     the checksum of a file that the data were made with; "" where there is none
    further  further arguments of the trainer

    A line on stderr says where a time limit has ended the training before its last step.
    """
    fingerprints = [obj.fingerprint() for obj in objects]
    made_of = repr((*fingerprints, options.views, also))
    last_report: StepReport | None = None
    if options.limit is not None:
        signal.setitimer(signal.ITIMER_REAL, 0)  # ends `data_in_time`: the steps watch the clock
    with step_progress(kind.kind, quiet=not is_first()) as show:

        def on_progress(report: StepReport) -> None:
            nonlocal last_report
            last_report = report
            show(report)

        checkpoint = training_loop.train(
            kind,
            learned,
            config,
            options.out,
            device=options.device,
            on_progress=on_progress,
            limit=options.limit,
            source=hashlib.sha256(made_of.encode()).hexdigest(),
            **further,
        )
    if last_report is not None and last_report.step < config.steps:
        log(_ended_early(kind, config, options, last_report))
    return checkpoint


def _ended_early(kind: type[NetworkTrainer], config: Any, options: Any, reached: StepReport) -> str:
    """Return a line that says how far a training has come that its time limit has ended."""
    what = "images" if kind.kind in _TRAINED_ON_IMAGES else "clouds"
    pace = f" ({reached.images_per_s:.1f}/s)" if reached.images_per_s else ""
    seen = f"{reached.images:,} {what}{pace}"
    said = f"{kind.kind}: --for {options.limit.text} ended it after step {reached.step} of "
    said += f"{reached.steps}, {seen}; the same command goes on from {options.out}"
    if issubclass(kind, CooledTrainer) and config.cool_down:
        steps = reached.step + config.cool_down
        said += f"; its learning rate falls over the last {config.cool_down} steps, "
        said += "and has not fallen to the end"
        if steps < config.steps:
            said += f": --steps {steps} ends it with the fall from here"
    return said


def open_training_objects(options: Any) -> tuple[SceneObject, ...]:
    """Return the objects to train on, class by class. Raises BadInput where there are none."""
    dataset = open_dataset(options.dataset)
    objects: list[SceneObject] = []
    for name in options.classes or dataset.classes or ("",):  # a folder may have no classes
        objects += dataset.objects(name, options.objects, DEFAULT_OBJECTS, "train")
    if not objects:
        raise BadInput(f"--objects {options.objects}: must be at least 1")
    return tuple(objects)


def check_least(option: str, value: int, least: int) -> None:
    """Raise BadInput where the value of an option is smaller than `least`."""
    if value < least:
        raise BadInput(f"--{option} {value}: must be at least {least}")


def data_processes() -> dict[str, Any]:
    """Return the arguments `workers` and `quiet` of functions that make data.

    There are as many worker processes as PyTorch has threads, as these have nothing to do
    meanwhile. Only the first process of a training shows the progress.
    """
    return {"quiet": not is_first(), "workers": torch.get_num_threads()}


def exported(checkpoint: Path, weights: Path, write: Callable[[Path, Path], str]) -> Path:
    """Write the weights of a checkpoint and return their file.

    Where several processes train together, the first one writes it.
    """
    if is_first():
        write(checkpoint, weights)
    return weights


def configuration(kind: Callable[..., Config], options: Any, **further: Any) -> Config:
    """Return a configuration whose fields come from `further`, and else from the options."""
    names = {field.name for field in fields(kind)}  # type: ignore[arg-type]
    shared = {name: value for name, value in vars(options).items() if name in names}
    return kind(**shared | further)
