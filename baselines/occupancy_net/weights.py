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
    from baselines.occupancy_net.network import OccupancyConfig

PACKAGE = "baselines.occupancy_net"
_MOST = 4096  # of any size of a network


def export(checkpoint_path: Path, path: Path) -> str:
    """Write a checkpoint's averaged network, and return the sha256.

    Raises BadInput as `learning.weights.WeightFiles.export`.
    """
    return FILES[PACKAGE].export(checkpoint_path, path, average_of)


def load_weights(name_or_path: str | Path = "all") -> NetworkWeights:
    """Return the weights of a bundled name or a path.

    Raises BadInput as `learning.weights.WeightFiles.find` and `load`.
    """
    from baselines.occupancy_net.network import OccupancyNet

    files = FILES[PACKAGE]
    return files.load(files.find(name_or_path), lambda fields, _: _config(fields), OccupancyNet)


def _config(fields: Mapping[str, Any]) -> OccupancyConfig:
    """Return the configuration from JSON.

    Raises TypeError or ValueError where a number is none that a network can have.
    """
    from baselines.occupancy_net.network import OccupancyConfig

    config = OccupancyConfig(**{**fields, "widths": tuple(fields["widths"])})
    sizes = (*config.widths, config.resolution, config.rounds, config.hidden, config.blocks)
    if not all(type(n) is int and 0 < n <= _MOST for n in sizes):  # True is an int, too
        raise ValueError(f"sizes {sizes}")
    if config.resolution % 2 ** (len(config.widths) - 1):
        raise ValueError(f"resolution {config.resolution} with {len(config.widths)} levels")
    return config
