"""Trained weights as files: how a file is written, and how it is checked.

A file holds the averaged network with one head, or with grey and the albedo that makes colours of
it, and nothing else. What is bundled stands in `learning.weights.FILES`. PyTorch is imported by
what handles tensors only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from data_prep.failures import BadInput
from learning.weights import FILES, NetworkWeights, sub_state

if TYPE_CHECKING:
    from torch import Tensor

    from baselines.splat_net.network import Material, NetworkConfig

PACKAGE = "baselines.splat_net"
_MOST_WIDTH = 4096
_MOST_WINDOW = 63
_MOST_MESHES, _MOST_NAME = 8, 60


def export(checkpoint_path: Path, path: Path, head: Material, package: str = PACKAGE) -> str:
    """Write a checkpoint's weights for the image of one head; return the sha256.

    For the albedo the file has the shading, too: the head "grey".

    Raises BadInput where the checkpoint has no such head, and as
    `learning.weights.WeightFiles.export`.
    """
    from baselines.splat_net.network import PLANES

    def select(
        state: dict[str, Tensor], config: dict[str, Any]
    ) -> tuple[dict[str, Tensor], dict[str, Any]]:
        network = _config(config["network"])
        if head not in network.heads:
            raise BadInput(
                f"{checkpoint_path}: has no head {head!r}; give one of {', '.join(network.heads)}"
            )
        tensors = sub_state(state, "average")
        heads: tuple[Material, ...] = ("grey", "albedo") if head == "albedo" else (head,)
        first = 1 + sum(PLANES[h] for h in network.heads[: network.heads.index(heads[0])])
        rows = [0, *range(first, first + PLANES[heads[0]])]
        tensors |= {key: tensors[key][rows] for key in ("last.weight", "last.bias")}
        if head != "albedo":
            _drop_albedo(tensors)
        return tensors, {"network": asdict(replace(network, heads=heads))}

    return FILES[package].export(checkpoint_path, path, select)


def load_weights(name_or_path: str | Path = "all") -> NetworkWeights:
    """Return the weights of a bundled name or a path.

    Raises BadInput as `learning.weights.WeightFiles.find` and `load`, and for a network that sees
    meshes.
    """
    path = FILES[PACKAGE].find(name_or_path)
    weights = read_file(path, in_grey=str(name_or_path) in FILES[PACKAGE].files)
    if weights.network.config.inputs.meshes:
        raise BadInput(f"{path}: the network sees meshes; use it as fused-net@{path}")
    return weights


def read_file(path: Path, in_grey: bool = False) -> NetworkWeights:
    """Return the weights of a file, without its albedo if `in_grey`.

    Raises BadInput as `learning.weights.WeightFiles.load`.
    """
    from baselines.splat_net.points2pix import build

    def configure(fields: Mapping[str, Any], tensors: dict[str, Tensor]) -> NetworkConfig:
        config = _config(fields)
        if len(config.heads) != 1 and config.heads != ("grey", "albedo"):
            raise ValueError(f"heads {config.heads}, expected one, or grey and albedo")
        if not in_grey or len(config.heads) == 1:
            return config
        _drop_albedo(tensors)
        return replace(config, heads=("grey",))

    return FILES[PACKAGE].load(path, configure, build)


def _drop_albedo(tensors: dict[str, Tensor]) -> None:
    for key in [key for key in tensors if key.startswith("albedo.")]:
        del tensors[key]


def _config(fields: Mapping[str, Any]) -> NetworkConfig:
    """Return the configuration from JSON.

    Raises TypeError or ValueError where a number is none that anybody has trained.
    """
    from baselines.splat_net.network import BODIES, PLANES, NetworkConfig
    from baselines.splat_net.projection import Inputs

    given = fields["inputs"]
    meshes = tuple(given.get("meshes", ()))  # files of before there were any have none
    inputs = Inputs(**{**given, "windows": tuple(given["windows"]), "meshes": meshes})
    tuples = {name: tuple(fields[name]) for name in ("widths", "heads")}  # lists in JSON
    config = NetworkConfig(**{**fields, **tuples, "inputs": inputs})
    if not all(type(n) is int and n <= _MOST_WIDTH for n in config.widths):  # True is an int, too
        raise ValueError(f"widths {config.widths}")
    flags = (inputs.normals, inputs.density, inputs.flattened, inputs.far, inputs.noise)
    if not all(isinstance(flag, bool) for flag in flags):
        raise ValueError(f"inputs {inputs}, expected true or false")
    odd = {w for w in inputs.windows if type(w) is int and w % 2 and 0 < w <= _MOST_WINDOW}
    if not odd or list(inputs.windows) != sorted(odd):
        raise ValueError(f"windows {inputs.windows}, expected odd numbers that rise")
    named = {name for name in meshes if isinstance(name, str) and len(name) <= _MOST_NAME}
    if len(named) != len(meshes) or len(meshes) > _MOST_MESHES:
        raise ValueError(f"meshes {meshes}, expected different names")
    if not config.heads or not set(config.heads) <= set(PLANES):
        raise ValueError(f"heads {config.heads}")
    if config.body not in BODIES:
        raise ValueError(f"body {config.body}")
    return config
