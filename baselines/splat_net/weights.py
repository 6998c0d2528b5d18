"""Trained weights of splat-net as files: how they are written, read and checked.

A file has the averaged network of a training with one head, or with grey and the albedo that makes
colours of it, and nothing else. The names of the bundled files are in `learning.weights.FILES`.
Importing this module does not load PyTorch; writing and reading files does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from data_prep.failures import BadInput
from learning.tensor_files import sub_state
from learning.weights import FILES, NetworkWeights

if TYPE_CHECKING:
    from torch import Tensor

    from baselines.splat_net.network import Material, NetworkConfig

PACKAGE = "baselines.splat_net"
# Bounds of what a file may state, far above all trained networks, so that a damaged or malicious
# file cannot ask for huge memory.
_MOST_WIDTH = 4096  # channels of a level
_MOST_WINDOW = 63  # pixels: side of a window
_MOST_MESHES = 8  # number of meshes
_MOST_NAME = 60  # characters of a mesh's name


def export(checkpoint_path: Path, path: Path, head: Material, package: str = PACKAGE) -> str:
    """Write the weights of a checkpoint that images of one head need; return the file's sha256.

    head     "colour", "grey" or "albedo"; with the albedo, the head "grey" is written, too, because
             it gives the shading
    package  whose checkpoint it is, a key of `learning.weights.FILES`

    Raises BadInput where the checkpoint has no such head, and as
    `learning.weights.WeightFiles.export` does.
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
        # The last convolution has the row of alpha, and then those of each head.
        before = network.heads[: network.heads.index(heads[0])]
        first = 1 + sum(PLANES[other] for other in before)
        rows = [0, *range(first, first + PLANES[heads[0]])]
        tensors |= {key: tensors[key][rows] for key in ("last.weight", "last.bias")}
        if head != "albedo":
            _drop_albedo(tensors)
        return tensors, {"network": asdict(replace(network, heads=heads))}

    return FILES[package].export(checkpoint_path, path, select)


def load_weights(name_or_path: str | Path = "all") -> NetworkWeights:
    """Return the weights of a bundled name, or of a file by its path.

    Raises BadInput as `learning.weights.WeightFiles.find` and `load` do, and for a network that
    sees meshes, which is a fused-net.
    """
    path = FILES[PACKAGE].find(name_or_path)
    weights = read_file(path, in_grey=str(name_or_path) in FILES[PACKAGE].files)
    if weights.network.config.inputs.meshes:
        raise BadInput(f"{path}: the network sees meshes; use it as fused-net@{path}")
    return weights


def read_file(path: Path, in_grey: bool = False) -> NetworkWeights:
    """Return the weights of a file.

    in_grey  whether its albedo is left out, so that images are grey

    Raises BadInput as `learning.weights.WeightFiles.load` does.
    """
    from baselines.splat_net.points2pix import build

    def configure(fields: Mapping[str, Any], tensors: dict[str, Tensor]) -> NetworkConfig:
        config = _config(fields)
        if len(config.heads) != 1 and config.heads != ("grey", "albedo"):
            raise ValueError(f"heads {config.heads}: expected one, or grey and albedo")
        if not in_grey or len(config.heads) == 1:
            return config
        _drop_albedo(tensors)
        return replace(config, heads=("grey",))

    return FILES[PACKAGE].load(path, configure, build)


def _drop_albedo(tensors: dict[str, Tensor]) -> None:
    """Remove the tensors of the head "albedo"."""
    for key in list(tensors):
        if key.startswith("albedo."):
            del tensors[key]


def _config(fields: Mapping[str, Any]) -> NetworkConfig:
    """Return the configuration of a network from the JSON in a file's header.

    Raises TypeError or ValueError where a value is of another type or out of bounds.
    """
    from baselines.splat_net.network import BODIES, PLANES, NetworkConfig
    from baselines.splat_net.projection import Inputs

    given = fields["inputs"]
    meshes = tuple(given.get("meshes", ()))  # files of splat-nets may not have the entry
    inputs = Inputs(**{**given, "windows": tuple(given["windows"]), "meshes": meshes})
    # JSON has lists where the configuration has tuples.
    widths, heads = tuple(fields["widths"]), tuple(fields["heads"])
    config = NetworkConfig(**{**fields, "widths": widths, "heads": heads, "inputs": inputs})
    # `type(...) is int`, because True and False are instances of int, too.
    if not all(type(width) is int and width <= _MOST_WIDTH for width in config.widths):
        raise ValueError(f"widths {config.widths}: expected numbers of at most {_MOST_WIDTH}")
    flags = (inputs.normals, inputs.density, inputs.flattened, inputs.far, inputs.noise)
    if not all(isinstance(flag, bool) for flag in flags):
        raise ValueError(f"inputs {inputs}: expected true or false for each")
    _check_windows(inputs.windows)
    named = {name for name in meshes if isinstance(name, str) and len(name) <= _MOST_NAME}
    if len(named) != len(meshes) or len(meshes) > _MOST_MESHES:
        raise ValueError(f"meshes {meshes}: expected at most {_MOST_MESHES} different names")
    if not config.heads or not set(config.heads) <= set(PLANES):
        raise ValueError(f"heads {config.heads}: expected some of {', '.join(PLANES)}")
    if config.body not in BODIES:
        raise ValueError(f"body {config.body}: expected one of {', '.join(BODIES)}")
    return config


def _check_windows(windows: tuple[Any, ...]) -> None:
    """Raise ValueError unless there are windows, and all are odd, ascending and in bounds."""
    known = all(
        type(window) is int and window % 2 == 1 and 0 < window <= _MOST_WINDOW for window in windows
    )
    if not windows or not known or list(windows) != sorted(set(windows)):
        raise ValueError(
            f"windows {windows}: expected ascending odd numbers of at most {_MOST_WINDOW}"
        )
