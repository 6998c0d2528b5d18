"""Trained weights as files: what is bundled, how a file is written, and how it is checked.

A file holds the averaged network; kernels are float16, everything of one dimension float32. The
safetensors header says how it was made. PyTorch is imported by what handles tensors only.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from data_prep.files.checksums import file_sha256
from learning.weights import (
    checked_network,
    find_file,
    halved,
    read_weights,
    sub_state,
    training_header,
    understanding_header,
    write_atomically,
)

if TYPE_CHECKING:
    from baselines.occupancy_net.network import OccupancyConfig, OccupancyNet

FOLDER = Path(__file__).parent / "weights"
BUNDLED: dict[str, str] = {  # name -> sha256 of weights/<name>.safetensors
    "all": "4050b55af22160f2296d15ea2e249b0adc2818d20eb4cb6d660d51d776e3ddb9",
}
KIND = "occupancy-net"  # of the checkpoints of its training
FORMAT = "occupancy-net-weights-1"
REMEDY = "write the file again with baselines.occupancy_net.weights.export"
MOST = 4096  # of any size of a network


@dataclass(frozen=True, eq=False)
class OccupancyWeights:
    """A network in float32 and evaluation mode, on the CPU, and its origin.

    card    how it was trained: steps, learning rates, seed, ...
    sha256  of the file
    """

    network: OccupancyNet
    card: Mapping[str, Any]
    sha256: str


def find_weights(name_or_path: str | Path) -> Path:
    """Return the file of a bundled name, its checksum verified, or the path itself.

    Raises BadInput, naming file, value and remedy, where a name is unknown, a file is missing, or a
    bundled file differs from its checksum.
    """
    return find_file(name_or_path, FOLDER, BUNDLED)


def export(checkpoint_path: Path, path: Path) -> str:
    """Write a checkpoint's weights, atomically, and return the sha256.

    Raises BadInput where the checkpoint is of something else, or a weight does not fit float16.
    """
    from learning import checkpoint

    state, step, config = checkpoint.load(checkpoint_path, KIND)
    stored = halved(sub_state(state, "average"), checkpoint_path, "export an earlier checkpoint")
    header = {
        "format": FORMAT,
        "network": json.dumps(config["network"]),
        "training": training_header(config, step, ["network"]),
    }
    write_atomically(path, stored, header)
    return file_sha256(path)


def load_weights(name_or_path: str | Path = "all") -> OccupancyWeights:
    """Return the weights of a bundled name or a path.

    Raises BadInput as `find_weights`, and where the file is no safetensors file or of another
    format, or tensors are missing, superfluous, of the wrong shape or not finite.
    """
    from baselines.occupancy_net.network import OccupancyNet

    path = find_weights(name_or_path)
    tensors, header = read_weights(path, FORMAT, REMEDY)
    with understanding_header(path, REMEDY):
        config = network_config(json.loads(header["network"]))
        card = {**json.loads(header["training"])}
    network = checked_network(path, tensors, functools.partial(OccupancyNet, config), REMEDY)
    return OccupancyWeights(network, {"network": asdict(config), **card}, file_sha256(path))


def network_config(fields: Mapping[str, Any]) -> OccupancyConfig:
    """Return the configuration from JSON.

    Raises TypeError or ValueError where a number is none that a network can have.
    """
    from baselines.occupancy_net.network import OccupancyConfig

    config = OccupancyConfig(**{**fields, "widths": tuple(fields["widths"])})
    sizes = (*config.widths, config.resolution, config.rounds, config.hidden, config.blocks)
    if not all(type(n) is int and 0 < n <= MOST for n in sizes):  # True is an int, too
        raise ValueError(f"sizes {sizes}")
    if config.resolution % 2 ** (len(config.widths) - 1):
        raise ValueError(f"resolution {config.resolution} with {len(config.widths)} levels")
    return config
