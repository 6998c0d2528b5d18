"""How the methods of the benchmark come into being, and what their pictures depend on.

Heavy packages are imported when a function is called, in the worker that needs them.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from data_prep.scene import Images, PointCloud, Renderer, View
    from pc2pix.engine import Precision

BUNDLED = "chair"
TO_PAPER_WIDTH = 4  # the bundled networks have a quarter of it


def pc2pix_renderer(weights: str, device: str, precision: Precision = "float32") -> Renderer:
    """pc2pix with a bundled name or file of weights."""
    import pc2pix

    return pc2pix.load(weights, device=_chosen(device), precision=precision)


def unfolded(device: str) -> Renderer:
    """The bundled pc2pix without the inference engine."""
    from pc2pix.renderer import Pc2pixRenderer
    from pc2pix.weights import load_weights

    return Pc2pixRenderer(load_weights(BUNDLED), device=_chosen(device), folded=False)


def one_by_one(device: str) -> Renderer:
    """The bundled pc2pix, a call for each view."""
    return OneByOne(pc2pix_renderer(BUNDLED, device))


def widened(device: str, precision: Precision = "float32") -> Renderer:
    """The bundled pc2pix at the paper's width: the same pictures, the paper's cost."""
    from pc2pix.renderer import Pc2pixRenderer
    from pc2pix.weights import load_weights
    from pc2pix.widen import widen

    weights = load_weights(BUNDLED)
    weights = replace(weights, generator=widen(weights.generator, TO_PAPER_WIDTH))
    return Pc2pixRenderer(weights, device=_chosen(device), precision=precision)


def splat_net(weights: str, device: str, precision: Precision = "float32") -> Renderer:
    """splat-net with a bundled name or file of weights."""
    from baselines import splat_net

    return splat_net.load(weights, device=_chosen(device), precision=precision)


def splat_net_identity(weights: str) -> str:
    """The versions of torch and scipy, and the checksum of the weights."""
    from baselines.splat_net.weights import find_weights
    from learning.weights import file_sha256

    return f"{_splat_net_libraries()}, weights {file_sha256(find_weights(weights))}"


def splat_net_file_identity(path: str) -> str:
    """As above, for a file nobody has vouched for: it is loaded, to be refused before the run."""
    from baselines.splat_net.weights import load_weights

    return f"{_splat_net_libraries()}, weights {load_weights(path).sha256}"


def _splat_net_libraries() -> str:
    return f"torch {installed('torch')}, scipy {installed('scipy')}"


def _chosen(device: str) -> str:
    import torch

    if device == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    return device


def pc2pix_identity(weights: str) -> str:
    """The version of torch and the checksum of the weights."""
    from learning.weights import file_sha256
    from pc2pix.weights import find_weights

    return f"torch {installed('torch')}, weights {file_sha256(find_weights(weights))}"


def pc2pix_file_identity(path: str) -> str:
    """As above, for a file nobody has vouched for: it is loaded, to be refused before the run."""
    from pc2pix.weights import load_weights

    return f"torch {installed('torch')}, weights {load_weights(path).sha256}"


def renderer(where: str, device: str, **fields: float) -> Renderer:
    """What is not learned: a class, as MODULE:NAME; on the processor whatever the device."""
    del device
    module, _, name = where.partition(":")
    return getattr(importlib.import_module(module), name)(**fields)


def pymeshlab_identity() -> str:
    """Its version."""
    return f"pymeshlab {installed('pymeshlab')}"


def constant(device: str) -> Renderer:
    """The bundled picture."""
    del device
    from baselines.constant import Constant, read_picture

    return Constant(read_picture())


def constant_identity() -> str:
    """The pixels, not the file: another PNG writer may pack them differently."""
    from hashlib import sha256

    from baselines.constant import read_picture

    return f"picture {sha256(read_picture().tobytes()).hexdigest()}"


def installed(*packages: str) -> str:
    """Versions of installed packages."""
    from importlib.metadata import version

    return ", ".join(version(package) for package in packages)


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
