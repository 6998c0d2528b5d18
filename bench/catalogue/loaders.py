"""Loaders of the methods of the benchmark, and the versions that their images depend on.

Heavy packages are imported when a function is called, in the worker that needs them.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from hashlib import sha256
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed_version
from typing import TYPE_CHECKING

from data_prep.failures import MissingDependency

if TYPE_CHECKING:
    from pathlib import Path

    from data_prep.scene import Renderer

GPU = "cuda"
BUNDLED = "chair"
# By the first digits of the checksum of a file in colours, the checksum of the file that earlier
# versions had for its grey part: the same tensors, so that what was drawn with them is kept.
_GREY_FILES = {
    "6331efaaab8a": "0445cfb77209b1c073dd734f0fe6b3307884d28faf3f498a5d50375f5c589416",
    "43900479f408": "d81ce265948ae583db8aec0a6d9d075a6602b1bcde7ab1db21b5685c17b6010c",
    "e5be7a567f23": "bb4d03c1b3594fee5d69278ea889ffa4bc84b923a1a3cfbe0906c02088cc6b0a",
}


@dataclass(frozen=True)
class _NetworkPackage:
    """A package of this project that has a network with files of weights.

    package    its name; it has `load`, and a module `weights`
    libraries  that its images depend on
    version    raised by hand when a change alters its images
    command    trains it
    beside     the package whose meshes its network sees, with the weights of all classes
    """

    package: str
    libraries: tuple[str, ...]
    version: int
    command: str
    beside: _NetworkPackage | None = None

    def load(self, weights: str, device: str) -> Renderer:
        """Return the renderer with a bundled name or file of weights."""
        package = importlib.import_module(self.package)
        return package.load(weights, device=chosen_device(device))

    def file(self, weights: str) -> Path:
        """Return the file of a bundled name, its checksum verified."""
        from learning.weights import FILES

        return FILES[self.package].find(weights)

    def identity(self, weights: str) -> str:
        """Return the versions of the libraries, and the checksum of bundled weights."""
        from data_prep.files.checksums import file_sha256

        sha256 = file_sha256(self.file(weights))
        kept = _GREY_FILES.get(sha256[:12], sha256) if weights.endswith("-grey") else sha256
        return self._identity(kept)

    def file_identity(self, path: str) -> str:
        """Return the same for a file of weights. Raises BadInput for a file that is none."""
        # Loaded in full: a bad file is to be refused before the run, not in each of its jobs.
        weights = importlib.import_module(f"{self.package}.weights")
        return self._identity(weights.load_weights(path).sha256)

    def _identity(self, sha256: str) -> str:
        text = f"{versions(*self.libraries)}, weights {sha256}"
        if (other := self.beside) is not None:
            name = other.package.rpartition(".")[2].replace("_", "-")
            text += f"; {name} {other.version}: {other.identity('all')}"
        return text


PC2PIX = _NetworkPackage("pc2pix", ("torch",), 5, "bench train gan")
SPLAT_NET = _NetworkPackage("baselines.splat_net", ("torch", "scipy"), 2, "bench train splat-net")
OCCUPANCY_NET = _NetworkPackage(
    "baselines.occupancy_net",
    ("embreex", "scikit-image", "torch"),
    3,
    "bench train occupancy-net",
)
UPSAMPLER = _NetworkPackage(
    "baselines.upsampler",
    ("embreex", "pymeshlab", "scipy", "torch", "trimesh"),
    1,
    "bench train upsampler",
)


# A change of the meshes of denoised-wrap, which it sees too, raises its version.
FUSED_NET = _NetworkPackage(
    "baselines.fused_net",
    ("embreex", "pymeshlab", "scikit-image", "scipy", "torch"),
    6,
    "bench train fused-net",
    beside=OCCUPANCY_NET,
)


def paper_width(device: str) -> Renderer:
    """Return the bundled pc2pix with an untrained generator of the paper's width, for its cost.

    Its images show nothing. The time that it takes does not depend on the weights.
    """
    from learning.training_loop import seeded
    from pc2pix.model import PAPER, Generator
    from pc2pix.renderer import Pc2pixRenderer
    from pc2pix.weights import load_weights

    weights = load_weights(BUNDLED)
    config = replace(weights.generator.config, width=PAPER.width)
    generator = seeded(0, lambda: Generator(config)).eval().requires_grad_(False)
    return Pc2pixRenderer(replace(weights, generator=generator), device=chosen_device(device))


def chosen_device(device: str) -> str:
    """Return PyTorch's name of a device; "auto" is the GPU where there is one.

    Raises MissingDependency for a GPU where there is none.
    """
    from learning.training_loop import prepare_device  # imports torch

    return str(prepare_device(device))


def renderer(class_path: str, device: str, **fields: float) -> Renderer:
    """Return an instance of a class below `baselines`, given as MODULE:NAME, that learns nothing.

    It draws on the processor, whatever the device.
    """
    del device
    module, _, name = class_path.partition(":")
    return getattr(importlib.import_module(f"baselines.{module}"), name)(**fields)


def constant(device: str) -> Renderer:
    """Return the renderer of the bundled image."""
    del device
    from baselines.reference import CONSTANT_IMAGE, Constant
    from data_prep.rendering.images import read_image

    image, _ = read_image(CONSTANT_IMAGE)
    return Constant(image)


def constant_identity() -> str:
    """Return the checksum of the bundled image."""
    from baselines.reference import CONSTANT_IMAGE
    from data_prep.rendering.images import read_image

    # Of its pixels, not of its file, which another PNG writer may pack differently.
    image, _ = read_image(CONSTANT_IMAGE)
    return f"picture {sha256(image.tobytes()).hexdigest()}"


def open3d_identity(version: Callable[[str], str] = installed_version) -> str:
    """Return the versions of Open3D and of what else the images depend on.

    Open3D is the package open3d-cpu, or open3d, which is larger by CUDA: the method uses neither's
    GPU. Raises MissingDependency, before any work is begun, where none is installed.
    """
    from baselines.reconstruction.open3d_poisson import REMEDY

    for package in ("open3d-cpu", "open3d"):
        try:
            return f"{versions('embreex')}, open3d {version(package)}, {versions('scipy')}"
        except PackageNotFoundError:
            continue
    raise MissingDependency(f"Open3D is not installed: {REMEDY}")


def versions(*packages: str) -> str:
    """Return installed packages with their versions as text; empty for none."""
    return ", ".join(f"{package} {installed_version(package)}" for package in packages)
