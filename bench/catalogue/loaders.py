"""How the methods of the benchmark are loaded, and what their images depend on.

Heavy packages are imported when a function is called, in the worker that needs them.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from data_prep.failures import MissingDependency

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from data_prep.scene import Images, PointCloud, Renderer, View
    from pc2pix.engine import Precision

BUNDLED = "chair"
TO_PAPER_WIDTH = 4  # the bundled networks have a quarter of it


@dataclass(frozen=True)
class Network:
    """A network of this project with files of weights.

    package    has `load`, and a module `weights`
    libraries  what its images depend on
    version    raised by hand when a change alters its images
    command    trains it
    """

    package: str
    libraries: tuple[str, ...]
    version: int
    command: str

    def load(self, weights: str, device: str, precision: Precision = "float32") -> Renderer:
        """Its renderer, with a bundled name or file of weights."""
        package = importlib.import_module(self.package)
        return package.load(weights, device=_chosen(device), precision=precision)

    def file(self, weights: str) -> Path:
        """The file of a bundled name, its checksum verified."""
        return self._weights().find_weights(weights)

    def identity(self, weights: str) -> str:
        """The versions of its libraries, and the checksum of bundled weights."""
        from learning.weights import file_sha256

        return self._identity(file_sha256(self.file(weights)))

    def file_identity(self, path: str) -> str:
        """As above, for a file nobody has vouched for: loaded, to be refused before the run."""
        return self._identity(self._weights().load_weights(path).sha256)

    def _identity(self, sha256: str) -> str:
        return f"{versions(*self.libraries)}, weights {sha256}"

    def _weights(self) -> Any:
        return importlib.import_module(f"{self.package}.weights")


PC2PIX = Network("pc2pix", ("torch",), 4, "bench train gan")
SPLAT_NET = Network("baselines.splat_net", ("torch", "scipy"), 2, "bench train splat-net")


def unfolded(device: str) -> Renderer:
    """The bundled pc2pix without the inference engine."""
    from pc2pix.renderer import Pc2pixRenderer
    from pc2pix.weights import load_weights

    return Pc2pixRenderer(load_weights(BUNDLED), device=_chosen(device), folded=False)


def one_by_one(device: str) -> Renderer:
    """The bundled pc2pix, a call for each view."""
    return OneByOne(PC2PIX.load(BUNDLED, device))


def widened(device: str, precision: Precision = "float32") -> Renderer:
    """The bundled pc2pix at the paper's width: the same images, the paper's cost."""
    from pc2pix.renderer import Pc2pixRenderer
    from pc2pix.weights import load_weights
    from pc2pix.widen import widen

    weights = load_weights(BUNDLED)
    weights = replace(weights, generator=widen(weights.generator, TO_PAPER_WIDTH))
    return Pc2pixRenderer(weights, device=_chosen(device), precision=precision)


def _chosen(device: str) -> str:
    import torch

    if device == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    return device


def renderer(where: str, device: str, **fields: float) -> Renderer:
    """What is not learned: a class, as MODULE:NAME; on the processor whatever the device."""
    del device
    module, _, name = where.partition(":")
    return getattr(importlib.import_module(module), name)(**fields)


def constant(device: str) -> Renderer:
    """The bundled image."""
    del device
    from baselines.constant import Constant, read_image

    return Constant(read_image())


def constant_identity() -> str:
    """The pixels, not the file: another PNG writer may pack them differently."""
    from hashlib import sha256

    from baselines.constant import read_image

    return f"picture {sha256(read_image().tobytes()).hexdigest()}"


def open3d_identity() -> str:
    """Open3D and what else the images depend on.

    Raises MissingDependency, before any work is begun, where Open3D is not installed.
    """
    from importlib.metadata import PackageNotFoundError

    from baselines.reconstruction.open3d_poisson import REMEDY

    try:
        return versions("embreex", "open3d", "scipy")
    except PackageNotFoundError as error:
        raise MissingDependency(f"Open3D is not installed: {REMEDY}") from error


def versions(*packages: str) -> str:
    """Installed packages with their versions; empty for none."""
    from importlib.metadata import version

    return ", ".join(f"{package} {version(package)}" for package in packages)


@dataclass(frozen=True)
class OneByOne:
    """A renderer that is asked for each view in a call of its own."""

    renderer: Renderer

    def prepare(self, cloud: PointCloud, rng: np.random.Generator) -> Any:
        """As the renderer."""
        return self.renderer.prepare(cloud, rng)

    def draw(self, state: Any, views: Sequence[View], rng: np.random.Generator) -> Images:
        """As the renderer, view by view."""
        import numpy as np

        return np.concatenate([self.renderer.draw(state, [view], rng) for view in views])
