"""Trained weights as files: how a file is written, and how it is checked.

What is bundled stands in `learning.weights.FILES`. PyTorch is imported by what handles tensors
only.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from learning.weights import FILES, NetworkWeights, average_of

if TYPE_CHECKING:
    from baselines.upsampler.network import UpsamplerConfig

PACKAGE = "baselines.upsampler"
_MOST = 1024  # of any size of a network


def export(checkpoint_path: Path, path: Path) -> str:
    """Write a checkpoint's averaged network, and return the sha256.

    Raises BadInput as `learning.weights.WeightFiles.export`.
    """
    return FILES[PACKAGE].export(checkpoint_path, path, average_of)


def load_weights(name_or_path: str | Path = "all") -> NetworkWeights:
    """Return the weights of a bundled name or a path.

    Raises BadInput as `learning.weights.WeightFiles.find` and `load`.
    """
    from baselines.upsampler.network import Upsampler

    files = FILES[PACKAGE]
    return files.load(files.find(name_or_path), lambda fields, _: _config(fields), Upsampler)


def _config(fields: Mapping[str, Any]) -> UpsamplerConfig:
    """Return the configuration from JSON.

    Raises TypeError or ValueError where a number is none that a network can have.
    """
    from baselines.upsampler.network import UpsamplerConfig

    config = UpsamplerConfig(**fields)
    sizes = (config.width, config.rounds)
    if not all(type(n) is int and 0 < n <= _MOST for n in sizes):  # True is an int, too
        raise ValueError(f"sizes {sizes}")
    return config
