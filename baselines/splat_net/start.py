"""The weights that a training starts from, where it starts from trained ones.

A training with a colour for each pixel exports two files, one with the head "colour" and one with
"grey"; they are put together again here, because training needs both heads. What the files lack is
learned anew: the grey for the bundled `chair`, which has colours alone, or the albedo, for a
network with one colour for the image. Input channels that the new network does not have are cut out
of the first layer. Those that only the new network has begin with weights of 0.
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

GREY = "-grey"  # end of the name, before the suffix, of the file with the head "grey"
HEAD = ("last.weight", "last.bias")  # tensors with a row for each plane: alpha, and the heads'
_GREY_ROWS = [0, 4]  # rows of alpha and grey; between them are the three of "colour"


@dataclass(frozen=True, eq=False)
class Start:
    """A network with both heads in evaluation mode, and the checksums of its files."""

    network: SplatNet
    sha256: str


def read_start(name_or_path: str, config: NetworkConfig, seed: int = 0) -> Start:
    """Return a network of `config` with trained weights.

    name_or_path  a bundled name, or the path "FILE.safetensors"; for a file with a colour for each
                  pixel "FILE-grey.safetensors" is read, too
    config        of the network; it must have the widths of the trained one
    seed          of the random weights of what the files lack

    Raises BadInput as `learning.weights.WeightFiles.find` and `read_file` do; where the two files
    are not of one training; and where the trained network has other widths or another body.
    """
    files = FILES[PACKAGE]
    colour = read_file(files.find(name_or_path))
    if colour.network.config.heads == COLOUR_HEADS["image"]:
        state, sha256 = colour.network.state_dict(), colour.sha256
        if "colour" in config.heads:
            raise BadInput(
                f"--start {name_or_path}: these weights have one colour for the whole image; leave "
                "--colours out"
            )
    elif name_or_path in files.bundled:
        state, sha256 = colour.network.state_dict(), colour.sha256
        if "colour" not in config.heads:
            state |= {key: state[key][:1] for key in HEAD}  # the first row is alpha
    else:
        grey = read_file(files.find(grey_beside(Path(name_or_path))))
        state, sha256 = _both(name_or_path, colour, grey), f"{colour.sha256} {grey.sha256}"
        if "colour" not in config.heads:
            state |= {key: state[key][_GREY_ROWS] for key in HEAD}
    read = colour.network.config
    if (read.body, config.body) != ("splat-net", "splat-net"):
        raise BadInput(
            f"--start {name_or_path}: these are weights of {read.body}, to train {config.body}; "
            "only splat-net can start from weights, and only from those of splat-net"
        )
    if read.widths != config.widths:
        raise BadInput(
            f"--start {name_or_path}: these weights have the widths {read.widths}, and the network "
            f"to train {config.widths}; give weights of these widths"
        )
    state["first.conv.weight"] = _arranged(state["first.conv.weight"], read.inputs, config.inputs)
    network = training_loop.seeded(seed, lambda: SplatNet(config))
    _fill(network, state)
    return Start(network.eval().requires_grad_(False), sha256)


def _both(name_or_path: str, colour: NetworkWeights, grey: NetworkWeights) -> dict[str, Tensor]:
    """Return the state of a network with both heads.

    Raises BadInput where the two files are not of one training.
    """
    if (colour.network.config.heads, grey.network.config.heads) != (("colour",), ("grey",)):
        raise _not_one_training(name_or_path, "the heads are not colour and grey")
    state = colour.network.state_dict()
    for key, of_grey in grey.network.state_dict().items():
        of_colour = state[key]
        if key in HEAD:
            # Row 0 is alpha, which both files have; the rows after it are those of the heads.
            state[key] = torch.cat([of_colour, of_grey[1:]])
            of_colour, of_grey = of_colour[:1], of_grey[:1]
        if not torch.equal(of_colour, of_grey):
            raise _not_one_training(name_or_path, f"{key} differs")
    return dict(state)


def _fill(network: SplatNet, state: Mapping[str, Tensor]) -> None:
    """Put the weights of `state` into a network; those that it lacks stay as they are.

    Tensors of `state` may have fewer rows than those of the network, for fewer planes.
    """
    for key, target in network.state_dict().items():  # the tensors themselves, no copies
        if key in state:
            known = state[key]
            known_part = tuple(slice(length) for length in known.shape)
            target[known_part] = known


def grey_beside(path: Path) -> Path:
    """Return the path of the file with the head "grey" that belongs to one with "colour"."""
    return path.with_name(f"{path.stem}{GREY}{path.suffix}")


def _arranged(kernel: Tensor, old: Inputs, new: Inputs) -> Tensor:
    """Return the kernel of the first layer, [out, channels of `new`, ...], for other inputs.

    kernel  [out, channels of `old`, ...]

    Channels are matched by name. The weights of those that `old` has not are 0.
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
        f"{why}; give the file in colour of a training, with its file in grey in the same folder"
    )
