"""Methods that misbehave, announced as another package announces its own.

Spawned workers import this module by its name: the folder above has to be on `sys.path`.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from data_prep.plugins import METHODS
from data_prep.scene import Images, PointCloud, Points, Renderer, View


def _hang() -> None:
    while True:
        time.sleep(60)


def _crash() -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def _hog() -> None:
    kept = []
    while True:
        kept.append(np.ones(2**23))  # 64 MiB, touched


def _raise() -> None:
    raise ValueError("12 of 34 parts are missing\nand more of that")


def _with_nan(images: Images) -> Images:
    return np.where(np.arange(images.shape[1])[:, None, None] == 64, np.nan, images)


IN_PREPARE: Mapping[str, Callable[[], None]] = {
    "hang": _hang,
    "segfault": _crash,
    "memory-hog": _hog,
    "exception": _raise,
}
IN_DRAW: Mapping[str, Callable[[Images], Images]] = {
    "wrong-shape": lambda images: images[:, :64],
    "nan": _with_nan,
    "blank": np.ones_like,
}
FAULTS = (*IN_PREPARE, *IN_DRAW)


@dataclass(frozen=True)
class Faulty:
    """A renderer that misbehaves on some clouds.

    `fault_of` says how it does on these points: one of FAULTS, or None for not at all.
    """

    renderer: Renderer
    fault_of: Callable[[Points], str | None]

    def prepare(self, cloud: PointCloud, rng: np.random.Generator) -> Any:
        """Return the renderer's state of the cloud, unless it hangs, dies or raises."""
        fault = self.fault_of(cloud.points)
        if fault is not None and fault in IN_PREPARE:
            IN_PREPARE[fault]()
        return fault, self.renderer.prepare(cloud, rng)

    def draw(self, state: Any, views: Sequence[View], rng: np.random.Generator) -> Images:
        """Return the renderer's images, changed where the fault is one of drawing."""
        fault, inner = state
        images = self.renderer.draw(inner, views, rng)
        return IN_DRAW[fault](images) if fault in IN_DRAW else images


def announce(folder: Path, plugins: Mapping[str, str], group: str = METHODS) -> None:
    """Make a package in `folder` that announces plug-ins, by default methods: id to "module:NAME".

    It is found where `folder` is on `sys.path`, in spawned workers too; `bench.catalogue.methods`
    looks once a process.
    """
    info = folder / "fake-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: fake\nVersion: 1.0\n")
    entries = "".join(f"{id_} = {place}\n" for id_, place in plugins.items())
    (info / "entry_points.txt").write_text(f"[{group}]\n{entries}")
