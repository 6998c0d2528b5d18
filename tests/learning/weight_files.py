"""Whole files of untrained weights, one of each kind, made once a process; and their loaders."""

from __future__ import annotations

import functools
import json
import os
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from baselines.occupancy_net import weights as occupancy_net
from baselines.occupancy_net.network import OccupancyConfig, OccupancyNet
from baselines.splat_net import weights as splat_net
from baselines.splat_net.network import NetworkConfig, SplatNet
from bench.judges.judge import JudgeNetwork, load_judge_network
from bench.judges.views import Labels, ViewsNetwork, load_views_network, to_file
from learning.weights import file_sha256, without_counters, write_atomically
from pc2pix import weights as pc2pix
from pc2pix.model import Decoder, Encoder, Generator, ModelConfig

TINY = {"width": 0.0625, "latent_dim": 4}


def write_pc2pix(path: Path) -> None:
    torch.manual_seed(0)
    tensors = {"code_mean": torch.zeros(4), "code_std": torch.ones(4)}
    for name, kind in (("encoder", Encoder), ("generator", Generator)):
        state = without_counters(kind(ModelConfig(**TINY)).state_dict())
        tensors |= {f"{name}.{key}": value for key, value in state.items()}
    header = {"format": pc2pix.FORMAT, "encoder": pc2pix.ENCODER_NAMES["paper"]}
    header |= {"model": json.dumps(TINY), "training": "{}"}
    write_atomically(path, tensors, header)


def write_decoder(path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        weights = Path(folder) / "w.safetensors"
        weights.write_bytes(whole("pc2pix"))
        header = {"format": pc2pix.DECODER_FORMAT, "weights": file_sha256(weights)}
    header |= {"model": json.dumps(TINY), "training": "{}"}
    write_atomically(path, Decoder(ModelConfig(**TINY)).state_dict(), header)


def load_decoder(path: Path) -> Any:
    """Load `path`, which may be anything, from where a decoder has to stand."""
    weights = path.with_name("of-decoder.safetensors")
    weights.write_bytes(whole("pc2pix"))
    pc2pix.decoder_path(weights).unlink(missing_ok=True)
    if os.path.lexists(path):
        path.rename(pc2pix.decoder_path(weights))
    return pc2pix.load_decoder(weights, pc2pix.load_weights(weights))


def write_splat_net(path: Path) -> None:
    config = NetworkConfig(widths=(4, 6, 8, 10, 12), heads=("colour",))
    header = {"format": splat_net.FORMAT, "network": json.dumps(asdict(config)), "training": "{}"}
    write_atomically(path, without_counters(SplatNet(config).state_dict()), header)


def write_occupancy_net(path: Path) -> None:
    config = OccupancyConfig(resolution=8, widths=(4, 6), hidden=5, blocks=1)
    header = {"format": occupancy_net.FORMAT, "network": json.dumps(asdict(config))}
    write_atomically(path, OccupancyNet(config).state_dict(), header | {"training": "{}"})


def write_views(path: Path) -> None:
    path.write_bytes(to_file(ViewsNetwork(Labels(("car",), ("car/van",), ("ladder",)))))


@dataclass(frozen=True)
class Kind:
    """Weights of one kind.

    tensor    the name of one; it has one dimension
    model     the key of the header that says how the network looks; "" if there is none
    reported  how a refusal begins after the path of the file; "" if each has a text of its own
    """

    write: Callable[[Path], None]
    load: Callable[[Path], Any]
    tensor: str
    model: str = ""
    reported: str = ""


KINDS = {
    "pc2pix": Kind(write_pc2pix, pc2pix.load_weights, "code_mean", "model"),
    "decoder": Kind(write_decoder, load_decoder, "layers.0.bias", "model"),
    "splat-net": Kind(write_splat_net, splat_net.load_weights, "last.bias", "network"),
    "occupancy-net": Kind(
        write_occupancy_net, occupancy_net.load_weights, "answer.bias", "network"
    ),
    "judge": Kind(
        lambda path: write_atomically(path, JudgeNetwork().state_dict(), {}),
        load_judge_network,
        "view.bias",
        reported="not the weights of the judge network (",
    ),
    "views": Kind(
        write_views,
        load_views_network,
        "heads.view.bias",
        "labels",
        "not the weights of fd-views (",
    ),
}


@functools.cache
def whole(name: str) -> bytes:
    """A file that its loader takes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "w.safetensors"
        KINDS[name].write(path)
        return path.read_bytes()
