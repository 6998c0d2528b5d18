"""Trained weights as files: what is bundled, how a file is written, and how it is checked.

A file holds the averaged network with one head, or with grey and the albedo that makes colours of
it, and nothing else; kernels are float16, everything of one dimension float32. The safetensors
header says how it was made. PyTorch is imported by what handles tensors only.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from learning.weights import (
    checked_network,
    find_file,
    halved,
    read_weights,
    sub_state,
    training_header,
    understanding_header,
    without_counters,
    write_atomically,
)

if TYPE_CHECKING:
    from baselines.splat_net.network import Material, NetworkConfig
    from baselines.splat_net.points2pix import Network

FOLDER = Path(__file__).parent / "weights"
_ALL = "6331efaaab8aadc111f7607c5a19b5396e0dfeb114491bc5ea09a236538a6a12"
_TINY = "43900479f408df098f21ac91efb43c9d3689b04c0a24176db579ae83f8462e5f"
BUNDLED: dict[str, str] = {  # name -> sha256 of its file, weights/<name>.safetensors
    "all": _ALL,
    "all-grey": _ALL,
    "all-tiny": _TINY,
    "all-tiny-grey": _TINY,
    "chair": "4fd59c7c06567f4c19360be9c1954f8c2b0a16c017614dd8dfb93f59131a677c",
    "points2pix": "f8efac2fc45c43ec3f550d1e5167c459e63f4e354f4737685e086192a253da96",
}
IN_GREY = {"all-grey": "all", "all-tiny-grey": "all-tiny"}  # by name, whose file has that head, too
KIND = "splat-net"  # of the checkpoints of its training
FORMAT = "splat-net-weights-2"  # of the first, networks had a code of the whole cloud
REMEDY = "write the file again with baselines.splat_net.weights.export"
MOST_WIDTH = 4096
_MOST_WINDOW = 63
MOST_MESHES, MOST_NAME = 8, 60


@dataclass(frozen=True, eq=False)
class SplatNetWeights:
    """A network in float32 and evaluation mode, on the CPU, and its origin.

    card    how it was trained: objective, steps, learning rates, seed, ...
    sha256  of the file
    """

    network: Network
    card: Mapping[str, Any]
    sha256: str


def find_weights(name_or_path: str | Path) -> Path:
    """Return the file of a bundled name, its checksum verified, or the path itself.

    Raises BadInput, naming file, value and remedy, where a name is unknown, a file is missing, or a
    bundled file differs from its checksum.
    """
    return find_file(name_or_path, FOLDER, BUNDLED, IN_GREY)


def export(checkpoint_path: Path, path: Path, head: Material, kind: str = KIND) -> str:
    """Write a checkpoint's weights for the image of one head, atomically; return the sha256.

    For the albedo the file has the shading, too: the head "grey".

    Raises BadInput where the checkpoint is of something else or has no such head, or a weight does
    not fit float16.
    """
    from baselines.splat_net.network import PLANES
    from learning import checkpoint

    state, step, config = checkpoint.load(checkpoint_path, kind)
    network = network_config(config["network"])
    if head not in network.heads:
        raise BadInput(
            f"{checkpoint_path}: has no head {head!r}; give one of {', '.join(network.heads)}"
        )
    tensors = without_counters(sub_state(state, "average"))
    heads: tuple[Material, ...] = ("grey", "albedo") if head == "albedo" else (head,)
    first = 1 + sum(PLANES[h] for h in network.heads[: network.heads.index(heads[0])])
    rows = [0, *range(first, first + PLANES[heads[0]])]
    tensors |= {key: tensors[key][rows] for key in ("last.weight", "last.bias")}
    if head != "albedo":
        tensors = {key: value for key, value in tensors.items() if not key.startswith("albedo.")}
    stored = halved(tensors, checkpoint_path, "export an earlier checkpoint")
    header = {
        "format": FORMAT,
        "network": json.dumps(asdict(replace(network, heads=heads))),
        "training": training_header(config, step, ["network"]),
    }
    write_atomically(path, stored, header)
    return file_sha256(path)


def load_weights(name_or_path: str | Path = "all") -> SplatNetWeights:
    """Return the weights of a bundled name or a path.

    Raises BadInput as `find_weights` and `read_file`, and for a network that sees meshes.
    """
    path = find_weights(name_or_path)
    weights = read_file(path, in_grey=str(name_or_path) in IN_GREY)
    if weights.network.config.inputs.meshes:
        raise BadInput(f"{path}: the network sees meshes; use it as fused-net@{path}")
    return weights


def read_file(path: Path, in_grey: bool = False) -> SplatNetWeights:
    """Return the weights of a file, without its albedo if `in_grey`.

    Raises BadInput where it is no safetensors file or of another format, or tensors are missing,
    superfluous, of the wrong shape or not finite.
    """
    from baselines.splat_net.points2pix import build

    tensors, header = read_weights(path, FORMAT, REMEDY)
    with understanding_header(path, REMEDY):
        config = network_config(json.loads(header["network"]))
        card = {**json.loads(header["training"])}
        if len(config.heads) != 1 and config.heads != ("grey", "albedo"):
            raise ValueError(f"heads {config.heads}, expected one, or grey and albedo")
    if in_grey and config.heads == ("grey", "albedo"):
        config = replace(config, heads=("grey",))
        tensors = {key: value for key, value in tensors.items() if not key.startswith("albedo.")}
    network = checked_network(path, tensors, functools.partial(build, config), REMEDY)
    return SplatNetWeights(network, {"network": asdict(config), **card}, file_sha256(path))


def network_config(fields: Mapping[str, Any]) -> NetworkConfig:
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
    if not all(type(n) is int and n <= MOST_WIDTH for n in config.widths):  # True is an int, too
        raise ValueError(f"widths {config.widths}")
    flags = (inputs.normals, inputs.density, inputs.flattened, inputs.far, inputs.noise)
    if not all(isinstance(flag, bool) for flag in flags):
        raise ValueError(f"inputs {inputs}, expected true or false")
    odd = {w for w in inputs.windows if type(w) is int and w % 2 and 0 < w <= _MOST_WINDOW}
    if not odd or list(inputs.windows) != sorted(odd):
        raise ValueError(f"windows {inputs.windows}, expected odd numbers that rise")
    named = {name for name in meshes if isinstance(name, str) and len(name) <= MOST_NAME}
    if len(named) != len(meshes) or len(meshes) > MOST_MESHES:
        raise ValueError(f"meshes {meshes}, expected different names")
    if not config.heads or not set(config.heads) <= set(PLANES):
        raise ValueError(f"heads {config.heads}")
    if config.body not in BODIES:
        raise ValueError(f"body {config.body}")
    return config
