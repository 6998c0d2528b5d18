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
from bench.catalogue.suites import SUITES, Suite, Truth
from bench.records.folder import COLOURED
from bench.running.environment import cores
from data_prep.datasets.registry import Dataset
from data_prep.failures import BadInput

LOCAL = "local"  # the value of `--ray` that starts a Ray cluster on this machine
# The largest `--limit`, in objects of a class. It is above what published datasets have (ShapeNet
# has 8,509 tables). Without a bound a mistyped number would be planned for hours: procedural
# classes have no end, and the plan of each object takes 3 ms and 70 kB.
_MOST_OBJECTS = 10_000
# The largest `--views`, in images of an object. A job draws all views of an object at once, and ten
# thousand float32 images are half of the memory that a worker may use.
_MOST_VIEWS = 10_000
RUNS = Path("results/runs")  # the folder of all runs without `--out`
# The options that say what is measured; the others say how and where.
REPEATED = (
    "suite",
    "dataset",
    "truth",
    "methods",
    "conditions",
    "metrics",
    "limit",
    "views",
    "device",
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
    budget: float | None = None  # the time limit of the whole run, in seconds
    views: int | None = None
    workers: int | None = None
    device: str = "auto"
    seed: int | None = None
    out: Path | None = None
    fresh: bool = False
    ray: str | None = None
    inception_weights: str | None = None
    truth: Truth | None = None
    metrics: tuple[str, ...] | None = None  # further metrics, beside those of the suite
    # Whether `methods` are added to the run that the folder holds, as 'bench add' does.
    adds: bool = False
    # The checksum that an export of the run's inputs would have, which `bench add` sets. Images
    # drawn of an export with this checksum count as drawn of these inputs.
    export: str | None = None

    @property
    def request(self) -> dict[str, Any]:
        """Return the given options that say what is measured, as `--config` reads them."""
        given: dict[str, Any] = {}
        for name in REPEATED:
            value = getattr(self, name)
            if isinstance(value, tuple):
                given[name] = list(value)
            elif value is not None:
                given[name] = value
        return given

    @property
    def directory(self) -> Path:
        """Return the folder of the run: `out`, or one named after suite, dataset and truth."""
        usual = {suite.id: suite.default_truth for suite in SUITES}.get(self.suite, COLOURED)
        truth = None if self.truth == usual else self.truth
        return self.out or RUNS / default_name(self.suite, self.dataset, truth)


def refuse(suite: str, options: Iterable[tuple[str, object, str]]) -> None:
    """Raise BadInput for the first of these options that was given.

    options  for each option its name, its value (None where it was not given), and the reason why
             it has no meaning for the suite
    """
    for name, value, why in options:
        if value is not None:
            option = name.replace("_", "-")
            raise BadInput(f"--{option}: has no meaning for the suite {suite}, {why}; leave it")


def refuse_values(options: Options) -> None:
    """Raise BadInput for counts out of their range, and for `--device cuda` without a GPU.

    Counts are the numbers of objects and of views. Where the jobs are done on a cluster, its nodes
    may have the GPU.
    """
    for name, value, most, remedy in (
        ("limit", options.limit, _MOST_OBJECTS, ", or leave it for all objects of a folder"),
        ("views", options.views, _MOST_VIEWS, ""),
    ):
        if value is not None and value < 1:
            raise BadInput(f"--{name} {value}: must be at least 1")
        if value is not None and value > most:
            raise BadInput(f"--{name} {value}: too many; give at most {most}{remedy}")
    if options.device == GPU and options.ray in (None, LOCAL):
        chosen_device(options.device)


def device_of(options: Options, find_device: Callable[[str], str] | None = None) -> str:
    """Return the device of a run, "cpu", "cuda" or "auto".

    "auto" becomes "cuda" where this machine does the jobs and has a GPU. On a cluster it stays
    "auto", and each node chooses by its own hardware. Tests pass their own `find_device` in place
    of `bench.catalogue.loaders.chosen_device`, which is called only where a CUDA driver is
    installed.
    """
    if options.device != "auto" or options.ray not in (None, LOCAL):
        return options.device
    if find_device is None:
        # Without a driver PyTorch need not be asked, whose import takes seconds.
        try:
            ctypes.CDLL("libcuda.so.1")
        except OSError:
            return "auto"
    return GPU if (find_device or chosen_device)(options.device).startswith(GPU) else "auto"


def seed_of(dataset: Dataset, options: Options) -> int:
    """Return the seed of a run: that of `--seed`, else that of an exported dataset, else 0.

    Raises BadInput where `--seed` differs from the seed that a dataset was exported with.
    """
    if dataset.seed is None:
        return options.seed or 0
    if options.seed not in (None, dataset.seed):
        raise BadInput(
            f"--seed {options.seed}: {dataset.id} was exported with --seed {dataset.seed}, which "
            "decides its clouds and views; leave --seed, or export it again with yours"
        )
    return dataset.seed


def workers_of(suite: Suite, options: Options) -> int:
    """Return the number of worker processes of a run.

    It is what `--workers` asks for, else the number of cores. A suite that compares times has one
    worker, and any other number is refused (BadInput).
    """
    if suite.timed:
        refused = options.workers if options.workers != 1 else None
        refuse(suite.id, [("workers", refused, "whose times are taken with nothing beside them")])
        return 1
    return options.workers or cores()


def default_name(suite: str, dataset: str, truth: Truth | None = None) -> str:
    """Return the name of a run's folder without `--out`, as in "chair-robustness-procedural".

    suite    the id of the suite, or another name for what is run
    dataset  the id of the dataset; of a path only the last folder is in the name
    truth    the kind of true images, which is in the name where it is given
    """
    kind, _, location = dataset.partition(":")
    parts = [suite, kind, Path(location).resolve().name] if location else [suite, kind]
    if truth is not None:
        parts.append(f"truth-{truth}")
    return file_name(*parts)


def file_name(*parts: str) -> str:
    """Return the parts as one file name, with hyphens between them.

    Letters, digits, dots, underscores and hyphens stay; a hyphen takes the place of any sequence of
    other characters.
    """

    def is_suitable(char: str) -> bool:
        is_mark = category(char).startswith("M")  # an accent or vowel sign of the letter before it
        return char.isalnum() or char in "._-" or is_mark

    joined = normalize("NFC", "-".join(parts))
    # A slash marks unsuitable characters: it is one itself, so none is left in the text.
    marked = "".join(char if is_suitable(char) else "/" for char in joined)
    return re.sub("/+", "-", marked)
