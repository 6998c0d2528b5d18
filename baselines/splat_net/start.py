"""Weights from which a training starts: the colour and the grey file as one network.

A training exports its network twice, each with one head; what is trained has both. Inputs that the
new network does without are cut out of the first layer; those that are new are not used yet. A
wider network draws as the narrower one did: the channels it has more of are random, and no earlier
channel uses them yet.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from baselines.splat_net.network import NetworkConfig, SplatNet
from baselines.splat_net.projection import Inputs
from baselines.splat_net.weights import BUNDLED, load_weights
from data_prep.failures import BadInput
from learning import training_loop

GREY = "-grey"  # stands at the end of the name of the file with that head
HEAD = ("last.weight", "last.bias")


@dataclass(frozen=True, eq=False)
class Start:
    """A network with both heads in evaluation mode, and the checksums of its files."""

    network: SplatNet
    sha256: str


def read_start(name_or_path: str, config: NetworkConfig, seed: int = 0) -> Start:
    """The network `config` with the weights of a bundled name, or of a file and the one beside it.

    name_or_path  "chair" for `chair` and `chair-grey`, "FILE.safetensors" for it and
                  "FILE-grey.safetensors"
    seed          of the channels that `config` has more of

    Raises BadInput as `load_weights`; where the two are not of one training; and where the network
    is wider than `config` at any level.
    """
    colour = load_weights(name_or_path)
    grey = load_weights(_grey_of(name_or_path))
    if (colour.network.config.heads, grey.network.config.heads) != (("colour",), ("grey",)):
        raise _not_one_training(name_or_path, "the heads are not colour and grey")
    state = colour.network.state_dict()
    for key, other in grey.network.state_dict().items():
        own, shared = state[key], other
        if key in HEAD:  # alpha comes before the materials
            state[key], own, shared = torch.cat([own, other[1:]]), own[:1], other[:1]
        if not torch.equal(own, shared):
            raise _not_one_training(name_or_path, f"{key} differs")
    found = colour.network.config
    if (found.body, config.body) != ("splat-net", "splat-net"):
        raise BadInput(
            f"--start {name_or_path}: is of {found.body}, asked for {config.body}; only splat-net "
            "can start from weights, those of splat-net"
        )
    if any(wanted < width for wanted, width in zip(config.widths, found.widths, strict=True)):
        raise BadInput(
            f"--start {name_or_path}: is of widths {found.widths}, asked for {config.widths}; a "
            "network can be made wider, not narrower: use another --network"
        )
    state["first.conv.weight"] = _arranged(state["first.conv.weight"], found.inputs, config.inputs)
    network = training_loop.seeded(seed, lambda: SplatNet(config))
    _fill(network, state)
    return Start(network.eval().requires_grad_(False), f"{colour.sha256} {grey.sha256}")


def _fill(network: SplatNet, narrow: Mapping[str, Tensor]) -> None:
    """Put the weights of a network in place that is no wider; `network` draws as it did.

    The first channels of each layer are those of `narrow`, and do not depend on the others.
    """
    for key, own in network.state_dict().items():  # which are the network's own, not copies
        known = narrow[key]
        if known.dim() == 4:  # kernels [out, in, height, width]
            own[: len(known), known.shape[1] :] = 0
        own[tuple(slice(length) for length in known.shape)] = known


def grey_beside(path: Path) -> Path:
    """The file with the grey head that goes with the one in colour."""
    return path.with_name(f"{path.stem}{GREY}{path.suffix}")


def _grey_of(name_or_path: str) -> str:
    return name_or_path + GREY if name_or_path in BUNDLED else str(grey_beside(Path(name_or_path)))


def _arranged(kernel: Tensor, old: Inputs, new: Inputs) -> Tensor:
    """The first kernel [out, channels of `old`, ...] for the channels of `new`.

    Channels that it has never seen are not used yet: their weights are 0.
    """
    places = {name: place for place, name in enumerate(old.names)}
    made = kernel.new_zeros(kernel.shape[0], new.channels, *kernel.shape[2:])
    for place, name in enumerate(new.names):
        if name in places:
            made[:, place] = kernel[:, places[name]]
    return made


def _not_one_training(name_or_path: str, why: str) -> BadInput:
    return BadInput(
        f"--start {name_or_path}: is not of one training with {_grey_of(name_or_path)}: {why}; "
        "give the file in colour of a training, the one in grey beside it"
    )
