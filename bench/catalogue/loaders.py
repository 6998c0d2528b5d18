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

GPU = "cuda"  # PyTorch's name of a GPU
BUNDLED = "chair"  # the name of the weights of pc2pix that its default variant draws with
# Checksums by which the grey variants of networks are known. Keys are the first 12 digits of the
# checksum of a file of weights that now holds a network for colours and one for grey. The values
# are the checksums of the files that the grey networks had for themselves in earlier versions. The
# tensors are the same, so that images drawn with the earlier files need not be drawn again.
_GREY_FILES = {
    "6331efaaab8a": "0445cfb77209b1c073dd734f0fe6b3307884d28faf3f498a5d50375f5c589416",
}


@dataclass(frozen=True)
class _NetworkPackage:
    """A package of this project with a network whose weights are in files.

    package    the package's import name. It has a function `load` and a module `weights`
    libraries  the installed packages whose versions its images depend on
    version    increase this number by hand with a change of the code that changes its images
    command    the command that trains the network
    beside     other such packages, whose meshes are an input of this network. Their weights are
               those called "all", which were trained on all classes
    """

    package: str
    libraries: tuple[str, ...]
    version: int
    command: str
    beside: tuple[_NetworkPackage, ...] = ()

    def load(self, weights: str, device: str) -> Renderer:
        """Return the renderer with weights, given by a bundled name or as the path of a file."""
        package = importlib.import_module(self.package)
        return package.load(weights, device=chosen_device(device))

    def file(self, weights: str) -> Path:
        """Return the file of the weights of a bundled name, after verifying its checksum."""
        from learning.weights import FILES

        return FILES[self.package].find(weights)

    def identity(self, weights: str) -> str:
        """Return a text of what images with bundled weights depend on beside the package's code.

        It has the versions of the libraries and the checksum of the weights.
        """
        from data_prep.files.checksums import file_sha256

        sha256 = file_sha256(self.file(weights))
        kept = _GREY_FILES.get(sha256[:12], sha256) if weights.endswith("-grey") else sha256
        return self._identity(kept)

    def file_identity(self, path: str) -> str:
        """Return the text of `identity` for a file of weights that the user has given.

        Raises BadInput for a file that has no weights of this network.
        """
        # The whole file is loaded, not only its checksum taken, so that unusable weights are
        # refused once, before the run starts, and not in each of its jobs.
        weights = importlib.import_module(f"{self.package}.weights")
        return self._identity(weights.load_weights(path).sha256)

    def _identity(self, sha256: str) -> str:
        text = f"{versions(*self.libraries)}, weights {sha256}"
        for other in self.beside:
            name = other.package.rpartition(".")[2].replace("_", "-")
            text += f"; {name} {other.version}: {other.identity('all')}"
        return text


PC2PIX = _NetworkPackage(
    package="pc2pix", libraries=("torch",), version=5, command="bench train gan"
)
SPLAT_NET = _NetworkPackage(
    package="baselines.splat_net",
    libraries=("torch", "scipy"),
    version=3,
    command="bench train splat-net",
)
OCCUPANCY_NET = _NetworkPackage(
    package="baselines.occupancy_net",
    libraries=("embreex", "scikit-image", "torch"),
    version=3,
    command="bench train occupancy-net",
)
# This network and fused-net also depend on the estimate of noise in baselines.reconstruction:
# increase their versions with a change of the code that changes it, too.
UPSAMPLER = _NetworkPackage(
    package="baselines.upsampler",
    libraries=("embreex", "pymeshlab", "scipy", "torch", "trimesh"),
    version=2,
    command="bench train upsampler",
)
FUSED_NET = _NetworkPackage(
    package="baselines.fused_net",
    libraries=("embreex", "pymeshlab", "scikit-image", "scipy", "torch"),
    version=9,
    command="bench train fused-net",
    beside=(OCCUPANCY_NET, UPSAMPLER),
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
    """Return PyTorch's name of a device: "auto" becomes "cuda" where there is a GPU, else "cpu".

    Raises MissingDependency where "cuda" is wanted and there is no GPU.
    """
    from learning.training_loop import prepare_device  # here, because it imports torch

    return str(prepare_device(device))


def renderer(class_path: str, device: str, **fields: float) -> Renderer:
    """Return an instance of a renderer without a network, such as `reference:TrueMesh`.

    class_path  the class as MODULE:NAME, the module named from the package `baselines` on
    fields      keyword arguments of the class
    """
    del device  # such a renderer draws on the CPU, whatever device is asked for
    module, _, name = class_path.partition(":")
    return getattr(importlib.import_module(f"baselines.{module}"), name)(**fields)


def constant(device: str) -> Renderer:
    """Return the renderer of the method `constant`, which always draws the same bundled image."""
    del device  # nothing is computed
    from baselines.reference import CONSTANT_IMAGE, Constant
    from data_prep.rendering.images import read_image

    image, _ = read_image(CONSTANT_IMAGE)
    return Constant(image)


def constant_identity() -> str:
    """Return a text with the checksum of the bundled image of the method `constant`."""
    from baselines.reference import CONSTANT_IMAGE
    from data_prep.rendering.images import read_image

    # The checksum is taken of the pixels: the same pixels can be stored in different PNG files.
    image, _ = read_image(CONSTANT_IMAGE)
    return f"picture {sha256(image.tobytes()).hexdigest()}"


def open3d_identity(version: Callable[[str], str] = installed_version) -> str:
    """Return the versions of Open3D and of the other libraries that the images depend on.

    Open3D is installed as the package open3d-cpu, or as open3d, which is larger because it contains
    CUDA. The method runs on the CPU with both. Raises MissingDependency where neither is installed,
    so that a run is refused before it starts.
    """
    from baselines.reconstruction.open3d_poisson import REMEDY

    for package in ("open3d-cpu", "open3d"):
        try:
            return f"{versions('embreex')}, open3d {version(package)}, {versions('scipy')}"
        except PackageNotFoundError:
            continue
    raise MissingDependency(f"Open3D is not installed: {REMEDY}")


def versions(*packages: str) -> str:
    """Return a text with the versions of installed packages, such as "scipy 1.14.1, torch 2.5.1".

    It is empty where no packages are given.
    """
    return ", ".join(f"{package} {installed_version(package)}" for package in packages)
