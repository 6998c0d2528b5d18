"""Trained weights as files: how a file is written, and how it is checked.

A file holds the averaged network with one head and nothing else; kernels are float16, everything of
one dimension float32. The safetensors header says how it was made.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch

from baselines.splat_net.network import PLANES, Material, NetworkConfig, SplatNet
from baselines.splat_net.projection import Inputs
from baselines.splat_net.train import KIND
from baselines.splat_net.weight_files import find_weights
from data_prep.failures import BadInput
from learning import checkpoint, weight_tensors
from learning.weight_files import file_sha256

FORMAT = "splat-net-weights-2"  # of the first, networks had a code of the whole cloud
REMEDY = "write the file again with baselines.splat_net.weights.export"
MOST_WIDTH = 4096
MOST_WINDOW = 63


@dataclass(frozen=True, eq=False)
class Weights:
    """A network in float32 and evaluation mode, on the CPU.

    card    how it was trained: objective, steps, seed, ...
    sha256  of the file
    """

    network: SplatNet
    card: Mapping[str, Any]
    sha256: str


def export(checkpoint_path: Path, path: Path, head: Material) -> str:
    """Write the weights of a checkpoint with one of its heads, atomically; the file's sha256.

    Raises BadInput where the checkpoint is of something else or has no such head, or a weight does
    not fit float16.
    """
    state, step, config = checkpoint.load(checkpoint_path, KIND)
    network = network_config(config["network"])
    if head not in network.heads:
        raise BadInput(f"{checkpoint_path}: has heads {network.heads}, not {head!r}")
    tensors = weight_tensors.without_counters(checkpoint.sub_state(state, "average"))
    first = 1 + sum(PLANES[h] for h in network.heads[: network.heads.index(head)])
    rows = [0, *range(first, first + PLANES[head])]
    tensors |= {key: tensors[key][rows] for key in ("last.weight", "last.bias")}
    stored = checkpoint.halved(tensors, checkpoint_path, "export an earlier checkpoint")
    header = {
        "format": FORMAT,
        "network": json.dumps(asdict(replace(network, heads=(head,)))),
        "training": checkpoint.training_header(config, step, ["network"]),
    }
    checkpoint.write_atomically(path, stored, header)
    return file_sha256(path)


def load_weights(name_or_path: str | Path = "chair") -> Weights:
    """Weights by bundled name or by path.

    Raises BadInput as `find_weights`, and where the file is no safetensors file or of another
    format, or tensors are missing, superfluous, of the wrong shape or not finite.
    """
    path = find_weights(name_or_path)
    tensors, header = checkpoint.read_weights(path, FORMAT, REMEDY)
    with checkpoint.understanding_header(path, REMEDY):
        config = network_config(json.loads(header["network"]))
        card = {**json.loads(header["training"])}
        if len(config.heads) != 1:
            raise ValueError(f"heads {config.heads}, expected one")
    with torch.device("meta"):  # shapes without memory: the file has yet to prove its size
        expected = weight_tensors.shapes(SplatNet(config))
    weight_tensors.check(path, tensors, expected, REMEDY)
    network = SplatNet(config)
    weight_tensors.fill(network, tensors)
    return Weights(network, {"network": asdict(config), **card}, file_sha256(path))


def network_config(found: Mapping[str, Any]) -> NetworkConfig:
    """From JSON. Raises TypeError or ValueError where a number is none that anybody has trained."""
    inputs = Inputs(**{**found["inputs"], "windows": tuple(found["inputs"]["windows"])})
    config = NetworkConfig(
        **{
            **found,
            "inputs": inputs,
            "widths": tuple(found["widths"]),
            "heads": tuple(found["heads"]),
        }
    )
    if not all(type(n) is int and n <= MOST_WIDTH for n in config.widths):  # True is an int, too
        raise ValueError(f"widths {config.widths}")
    flags = (inputs.normals, inputs.density, inputs.flattened, inputs.far)
    if not all(isinstance(flag, bool) for flag in flags):
        raise ValueError(f"inputs {inputs}, expected true or false")
    odd = {w for w in inputs.windows if type(w) is int and w % 2 and 0 < w <= MOST_WINDOW}
    if not odd or list(inputs.windows) != sorted(odd):
        raise ValueError(f"windows {inputs.windows}, expected odd numbers that rise")
    if not config.heads or not set(config.heads) <= set(PLANES):
        raise ValueError(f"heads {config.heads}")
    return config
