"""The options of `bench run`, and the checks and defaults that need nothing else."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unicodedata import category, normalize

from bench.catalogue.loaders import GPU, chosen_device
from bench.catalogue.suites import Suite, Truth
from bench.records.folder import COLOURED
from bench.running.environment import cores
from data_prep.datasets.registry import Dataset
from data_prep.failures import BadInput

LOCAL = "local"  # address of a Ray cluster that a run starts on this machine
# More objects of a class than published datasets have (ShapeNet: 8,509 tables). Procedural classes
# have no end, and the plan of an object takes 3 ms and 70 kB.
_MOST_OBJECTS = 10_000
# A job draws all views of an object at once; so many in float32 are half of what a worker may have.
_MOST_VIEWS = 10_000
RUNS = Path("results/runs")
# Options that say what is measured, and not how or where.
REPEATED = (
    *("suite", "dataset", "truth", "methods", "conditions", "metrics", "limit", "views", "device"),
    "seed",
    "inception_weights",
)


@dataclass(frozen=True)
class Options:
    """The options of the command line; None means the choice of the suite or of the dataset."""

    suite: str
    dataset: str = "procedural"
    methods: tuple[str, ...] | None = None
    conditions: tuple[str, ...] | None = None
    limit: int | None = None
    budget: float | None = None  # seconds
    views: int | None = None
    workers: int | None = None
    device: str = "auto"
    seed: int | None = None
    out: Path | None = None
    fresh: bool = False
    ray: str | None = None
    inception_weights: str | None = None
    truth: Truth | None = None
    metrics: tuple[str, ...] | None = None  # beside those of the suite
    adds: bool = False  # the methods to those of the run in the folder: 'bench add'

    @property
    def request(self) -> dict[str, Any]:
        """Return the given options that say what is measured, as `--config` reads them."""
        given = {name: getattr(self, name) for name in REPEATED}
        given = {name: value for name, value in given.items() if value is not None}
        return {k: list(v) if isinstance(v, tuple) else v for k, v in given.items()}

    @property
    def directory(self) -> Path:
        """Return the run's folder."""
        truth = None if self.truth == COLOURED else self.truth
        return self.out or RUNS / default_name(self.suite, self.dataset, truth)


def refuse(suite: str, options: Iterable[tuple[str, object, str]]) -> None:
    """Refuse the first of these options that was given; each has a name, a value and a reason."""
    for name, value, why in options:
        if value is not None:
            option = name.replace("_", "-")
            raise BadInput(f"--{option}: has no meaning for the suite {suite}, {why}; leave it")


def refuse_values(options: Options) -> None:
    """Refuse no or too many objects and views, and `--device cuda` without a GPU here."""
    for name, value, most, remedy in (
        ("limit", options.limit, _MOST_OBJECTS, ", or leave it for all objects of a folder"),
        ("views", options.views, _MOST_VIEWS, ""),
    ):
        if value is not None and value < 1:
            raise BadInput(f"--{name} {value}: must be at least 1")
        if value is not None and value > most:
            raise BadInput(f"--{name} {value}: too many; give at most {most}{remedy}")
    if options.device == GPU and options.ray in (None, LOCAL):  # other nodes have GPUs of theirs
        chosen_device(options.device)


def device_of(options: Options, find_device: Callable[[str], str] | None = None) -> str:
    """Return the device of a run: "cuda" for "auto" where this machine draws and has a GPU.

    For a cluster "auto" stays, whose nodes decide where methods draw. `find_device` stands in for
    `bench.catalogue.loaders.chosen_device`, which is asked where there is a driver.
    """
    if options.device != "auto" or options.ray not in (None, LOCAL):
        return options.device
    if find_device is None:
        try:  # PyTorch knows better, but takes seconds to import, which the main process saves
            ctypes.CDLL("libcuda.so.1")
        except OSError:
            return "auto"
    return GPU if (find_device or chosen_device)(options.device).startswith(GPU) else "auto"


def seed_of(dataset: Dataset, options: Options) -> int:
    """Return the seed of a run. Raises BadInput for another than that of an exported dataset."""
    if dataset.seed is None:
        return options.seed or 0
    if options.seed not in (None, dataset.seed):
        raise BadInput(
            f"--seed {options.seed}: {dataset.id} was exported with --seed {dataset.seed}, which "
            "decides its clouds and views; leave --seed, or export it again with yours"
        )
    return dataset.seed


def workers_of(suite: Suite, options: Options) -> int:
    """Return how many worker processes: as requested, else a core each; one to compare times."""
    if suite.timed:
        more = options.workers if options.workers != 1 else None
        refuse(suite.id, [("workers", more, "whose times are taken with nothing beside them")])
        return 1
    return options.workers or cores()


def default_name(suite: str, dataset: str, truth: Truth | None = None) -> str:
    """Return the name of the folder of a run of a suite, or of the run `suite`, on a dataset."""
    kind, _, location = dataset.partition(":")
    parts = [suite, kind, Path(location).resolve().name] if location else [suite, kind]
    if truth is not None:
        parts.append(f"truth-{truth}")
    return file_name(*parts)


def file_name(*parts: str) -> str:
    """Join the parts to one file name; a hyphen stands for each run of unsuitable characters."""
    kept = (
        char if char.isalnum() or char in "._-" or category(char).startswith("M") else "/"
        for char in normalize("NFC", "-".join(parts))
    )
    return re.sub("/+", "-", "".join(kept))
