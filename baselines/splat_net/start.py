"""Initial weights of a training: the colour and the grey file as one network.

A training exports its network twice, each for one image; the trained network has the heads of both.
A network with one colour for the image starts from any, and learns the colour anew where the file
has none; the bundled `chair` has colours alone, and the grey is learned anew. Inputs that the new
network lacks are cut out of the first layer; new inputs are not used yet.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from baselines.splat_net.network import COLOUR_HEADS, NetworkConfig, SplatNet
from baselines.splat_net.projection import Inputs
from baselines.splat_net.weights import PACKAGE, read_file
from data_prep.failures import BadInput
from learning import training_loop
from learning.weights import FILES, NetworkWeights

GREY = "-grey"  # stands at the end of the name of the file with that head
HEAD = ("last.weight", "last.bias")
_GREY_ROWS = [0, 4]  # of both heads: alpha, and grey after the three planes in colour


@dataclass(frozen=True, eq=False)
class Start:
    """A network with both heads in evaluation mode, and the checksums of its files."""

    network: SplatNet
    sha256: str


def read_start(name_or_path: str, config: NetworkConfig, seed: int = 0) -> Start:
    """Return `config`'s network with the weights of a bundled name or a file, and of its grey.

    Beside a file with a colour for each pixel stands the one with the grey head.

    name_or_path  a bundled name, or "FILE.safetensors" for it and "FILE-grey.safetensors"
    seed          of what `config` has and the files have not

    Raises BadInput as `learning.weights.WeightFiles.find` and `read_file`; where the two are not of
    one training; and where the network is of other widths than `config`.
    """
    files = FILES[PACKAGE]
    colour = read_file(files.find(name_or_path))
    if colour.network.config.heads == COLOUR_HEADS["image"]:
        state, sha256 = colour.network.state_dict(), colour.sha256
        if "colour" in config.heads:
            raise BadInput(
                f"--start {name_or_path}: has one colour for the image; leave --colours out"
            )
    elif name_or_path in files.bundled:
        state, sha256 = colour.network.state_dict(), colour.sha256
        if "colour" not in config.heads:  # what is left is alpha
            state |= {key: state[key][:1] for key in HEAD}
    else:
        grey = read_file(files.find(grey_beside(Path(name_or_path))))
        state, sha256 = _both(name_or_path, colour, grey), f"{colour.sha256} {grey.sha256}"
        if "colour" not in config.heads:
            state |= {key: state[key][_GREY_ROWS] for key in HEAD}
    read = colour.network.config
    if (read.body, config.body) != ("splat-net", "splat-net"):
        raise BadInput(
            f"--start {name_or_path}: is of {read.body}, asked for {config.body}; only splat-net "
            "can start from weights, those of splat-net"
        )
    if read.widths != config.widths:
        raise BadInput(
            f"--start {name_or_path}: is of widths {read.widths}, asked for {config.widths}; give "
            "weights of these widths"
        )
    state["first.conv.weight"] = _arranged(state["first.conv.weight"], read.inputs, config.inputs)
    network = training_loop.seeded(seed, lambda: SplatNet(config))
    _fill(network, state)
    return Start(network.eval().requires_grad_(False), sha256)


def _both(name_or_path: str, colour: NetworkWeights, grey: NetworkWeights) -> dict[str, Tensor]:
    """Return the state with both heads. Raises BadInput where they are not of one training."""
    if (colour.network.config.heads, grey.network.config.heads) != (("colour",), ("grey",)):
        raise _not_one_training(name_or_path, "the heads are not colour and grey")
    state = colour.network.state_dict()
    for key, other in grey.network.state_dict().items():
        colour_part, grey_part = state[key], other
        if key in HEAD:  # alpha comes before the materials
            state[key], colour_part, grey_part = (
                torch.cat([colour_part, other[1:]]),
                colour_part[:1],
                other[:1],
            )
        if not torch.equal(colour_part, grey_part):
            raise _not_one_training(name_or_path, f"{key} differs")
    return dict(state)


def _fill(network: SplatNet, state: Mapping[str, Tensor]) -> None:
    """Put weights into a network; the last planes, and heads, that they lack stay as they are."""
    for key, target in network.state_dict().items():  # the tensors themselves, no copies
        if key in state:
            known = state[key]
            target[tuple(slice(length) for length in known.shape)] = known


def grey_beside(path: Path) -> Path:
    """Return the file with the grey head that goes with the one in colour."""
    return path.with_name(f"{path.stem}{GREY}{path.suffix}")


def _arranged(kernel: Tensor, old: Inputs, new: Inputs) -> Tensor:
    """Return the first kernel [out, channels of `old`, ...] for the channels of `new`.

    Weights of channels that are new are 0: they are not used yet.
    """
    places = {name: place for place, name in enumerate(old.names)}
    arranged = kernel.new_zeros(kernel.shape[0], new.channels, *kernel.shape[2:])
    for place, name in enumerate(new.names):
        if name in places:
            arranged[:, place] = kernel[:, places[name]]
    return arranged


def _not_one_training(name_or_path: str, why: str) -> BadInput:
    return BadInput(
        f"--start {name_or_path}: is not of one training with {grey_beside(Path(name_or_path))}: "
        f"{why}; "
        "give the file in colour of a training, the one in grey beside it"
    )
