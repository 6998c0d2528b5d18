"""A small training of every network, by the functions that the commands call."""

from __future__ import annotations

import atexit
import functools
import json
import os
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from baselines.fused_net import weights as fused_net
from baselines.fused_net.config import FusedNetConfig
from baselines.fused_net.data import FusedSet
from baselines.fused_net.train import FusedNetTrainer
from baselines.fused_net.weights import MESHES
from baselines.occupancy_net import weights as occupancy_net
from baselines.occupancy_net.config import OccupancyNetConfig
from baselines.occupancy_net.network import OccupancyConfig
from baselines.occupancy_net.train import OccupancyNetTrainer
from baselines.splat_net import weights as splat_net
from baselines.splat_net.config import SplatNetConfig
from baselines.splat_net.network import NetworkConfig
from baselines.splat_net.train import SplatNetTrainer
from baselines.upsampler import weights as upsampler
from baselines.upsampler.config import UpsamplerTrainingConfig
from baselines.upsampler.data import UpsamplerSet, joined
from baselines.upsampler.network import UpsamplerConfig
from baselines.upsampler.surroundings import surroundings
from baselines.upsampler.train import UpsamplerTrainer
from bench.judges.judge import JudgeNetwork, load_judge_network
from bench.judges.views import Labels, ViewsNetwork, load_views_network
from data_prep.datasets.occupancy_set import OccupancySet
from data_prep.datasets.training_set import SurfaceSet, TrainingSet
from learning import checkpoint, training_loop
from learning.configuration import Cadence
from learning.tensor_files import write_atomically
from learning.trainer import NetworkTrainer
from learning.training_loop import seeded
from pc2pix import weights as pc2pix
from pc2pix.model import ModelConfig, build_encoder
from pc2pix.train_autoencoder import AutoencoderTrainer
from pc2pix.train_decoder import DecoderTrainer
from pc2pix.train_gan import GanTrainer
from pc2pix.training_configs import AutoencoderConfig, DecoderConfig, GanConfig
from pc2pix.training_data import AutoencoderData, GanData

CADENCE = Cadence(log=1, sheet=4, checkpoint=2)
TINY = ModelConfig(width=0.0625, latent_dim=4)
PAIRED = ModelConfig(width=0.0625, latent_dim=4, encoder="pointnet", azimuth="sine-cosine")
SMALL = NetworkConfig(widths=(4, 6, 8, 10, 12))
SMALL_FUSED = replace(SMALL, inputs=replace(SMALL.inputs, meshes=MESHES))
SMALL_UPSAMPLER = UpsamplerConfig(width=6, rounds=1)
SMALL_OCCUPANCY = OccupancyConfig(resolution=8, widths=(4, 6), hidden=5, blocks=1)


def make_clouds(count=3, points=2048):
    rng = np.random.default_rng(0)
    return rng.uniform(-0.5, 0.5, (count, points, 3)).astype(np.float32)


def make_set(objects=3, views=2):
    rng = np.random.default_rng(1)
    return TrainingSet(
        images=rng.integers(0, 256, (objects, views, 128, 128, 3), dtype=np.uint8),
        azimuth_deg=rng.uniform(-180, 180, (objects, views)),
        elevation_deg=rng.uniform(-40, 40, (objects, views)),
        clouds=make_clouds(objects),
    )


def make_surfaces(objects=3, views=2):
    """Clouds, angles and images at random: nothing of one is in another."""
    coverage, grey = np.random.default_rng(2).integers(
        0, 256, (2, objects, views, 128, 128), dtype=np.uint8
    )
    return SurfaceSet(make_set(objects, views), coverage, grey)


def autoencoder_parts(_):
    return AutoencoderData(make_clouds(points=2100)), {"model": TINY, "batch": 2}, {}


def gan_parts(_, model=TINY):
    seen = make_set()
    data = GanData(seen.images, seen.azimuth_deg, seen.elevation_deg, seen.clouds)
    return (data, seeded(0, lambda: build_encoder(model))), {"model": model, "batch": 2}, {}


def decoder_parts(out_dir):
    path = out_dir.with_suffix(".safetensors")
    path.write_bytes(whole("pc2pix"))
    weights = pc2pix.load_weights(path)
    fields = {"weights": weights.sha256, "model": TINY, "batch": 2}
    return AutoencoderData(make_clouds(points=2100)), fields, {"weights": weights}


def splat_net_parts(_):
    return make_surfaces(), {"network": SMALL, "batch": 4, "cool_down": 2}, {}


def make_fused(objects=3, views=2):
    """Objects with whole clouds but for the first, of 512 points; images and maps at random."""
    shape = (objects, views, 10, 128, 128)
    maps = np.random.default_rng(5).integers(0, 253, shape, dtype=np.uint8)
    counts, noise = np.full(objects, 2048), np.linspace(0, 0.1, objects, dtype=np.float32)
    counts[0] = 512
    return FusedSet(make_surfaces(objects, views), counts, noise, maps)


def fused_net_parts(_):
    return make_fused(), {"network": SMALL_FUSED, "batch": 4, "cool_down": 2}, {}


def make_occupancy(objects=3, queries=60):
    """Clouds, and places at random that are inside where x > 0."""
    places = np.random.default_rng(4).uniform(-1, 1, (objects, queries, 3)).astype(np.float32)
    return OccupancySet(make_clouds(objects), places, places[..., 0] > 0)


def occupancy_net_parts(_):
    return make_occupancy(), {"network": SMALL_OCCUPANCY, "batch": 2, "cool_down": 2}, {}


def make_upsampler(objects=3, places=40):
    """Clouds of 20 points and more at random; places, and targets above them by half a unit."""
    rng = np.random.default_rng(6)
    clouds = [
        surroundings(rng.uniform(-1, 1, (20 + i, 3)).astype(np.float32))[0] for i in range(objects)
    ]
    first = torch.tensor([0, *(len(cloud.points) for cloud in clouds)]).cumsum(0)
    nearest = torch.from_numpy(rng.integers(20, size=(objects, places)))
    spots = torch.stack([cloud.points[i] for cloud, i in zip(clouds, nearest, strict=True)])
    up = torch.tensor([0.0, 0.5, 0.0])
    return UpsamplerSet(
        joined(clouds), first, spots, nearest, spots + up, (2 * up).expand_as(spots)
    )


def upsampler_parts(_):
    return make_upsampler(), {"network": SMALL_UPSAMPLER, "batch": 2, "cool_down": 2}, {}


@dataclass(frozen=True)
class Training:
    """A small training: it goes on where one has been in the folder.

    parts    of a folder: what is learned from, fields of the configuration, further arguments
    sheet    size of its image in pixels; None where it has none
    """

    trainer: type[NetworkTrainer]
    config: type[Any]
    parts: Callable[[Path], tuple[Any, dict[str, Any], dict[str, Any]]]
    changes: dict[str, Any] = field(default_factory=dict)
    sheet: tuple[int, int] | None = (3 * 128, 2 * 128)

    @property
    def kind(self):
        return self.trainer.kind

    def __call__(self, out_dir, steps, on_progress=lambda report: None, limit=None, **changes):
        learned, fields, further = self.parts(out_dir)
        stated = {"steps": steps, "cadence": CADENCE} | fields | self.changes | changes
        config = self.config(**stated)
        return training_loop.train(
            self.trainer, learned, config, out_dir, on_progress=on_progress, limit=limit, **further
        )


TRAININGS = {
    "autoencoder": Training(AutoencoderTrainer, AutoencoderConfig, autoencoder_parts),
    "gan": Training(GanTrainer, GanConfig, gan_parts, {"augment": True}),
    "gan-paired": Training(
        GanTrainer, GanConfig, partial(gan_parts, model=PAIRED),
        {"objective": "paired", "warm_up": 1},
    ),
    "decoder": Training(DecoderTrainer, DecoderConfig, decoder_parts),
    "splat-net": Training(
        SplatNetTrainer, SplatNetConfig, splat_net_parts, {"objective": "l1-patch", "warm_up": 1},
        (3 * 128, 3 * 128),
    ),
    "fused-net": Training(
        FusedNetTrainer, FusedNetConfig, fused_net_parts, sheet=(2 * 128, 3 * 128)
    ),
    "occupancy-net": Training(OccupancyNetTrainer, OccupancyNetConfig, occupancy_net_parts),
    "upsampler": Training(
        UpsamplerTrainer, UpsamplerTrainingConfig, upsampler_parts, sheet=None
    ),
}  # fmt: skip


@functools.cache
def trained(name):
    """Return the checkpoint of one step, made once a process."""
    folder = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, folder)
    path = TRAININGS[name](folder / "run", 1)
    if name == "gan":  # whose codes of so few clouds are all alike: then no other could be drawn
        state, step, config = checkpoint.load(path, name)
        plain = {"code_mean": torch.zeros(4), "code_std": torch.ones(4)}
        checkpoint.save(path, name, step, config, state | plain)
    return path


def load_decoder(path):
    """Load `path`, which may be anything, from where a decoder has to stand."""
    weights = path.with_name("of-decoder.safetensors")
    weights.write_bytes(whole("pc2pix"))
    pc2pix.decoder_path(weights).unlink(missing_ok=True)
    if os.path.lexists(path):
        path.rename(pc2pix.decoder_path(weights))
    return pc2pix.load_decoder(weights, pc2pix.load_weights(weights))


@dataclass(frozen=True)
class Kind:
    """Weights of one kind.

    training  that they are exported of; "" for networks that measure, which have no such file
    write     writes a file that is whole, of a checkpoint and to a path
    tensor    the name of one; it has one dimension
    model     the key of the header that says how the network looks; "" if there is none
    reported  how a refusal begins after the path of the file; "" if each has a text of its own
    """

    training: str
    write: Any
    load: Any
    tensor: str
    model: str = ""
    reported: str = ""


def write_judge(_, path):
    write_atomically(path, JudgeNetwork().state_dict(), {})


LABELS = Labels(("car",), ("car/van",), ("ladder",))


def write_views(_, path, labels=LABELS):
    network = ViewsNetwork(labels)
    write_atomically(path, network.state_dict(), {"labels": json.dumps(asdict(labels))})


KINDS = {
    "pc2pix": Kind("gan", pc2pix.export, pc2pix.load_weights, "code_mean", "model"),
    "decoder": Kind("decoder", pc2pix.export_decoder, load_decoder, "layers.0.bias", "model"),
    "splat-net": Kind(
        "splat-net", partial(splat_net.export, head="colour"), splat_net.load_weights, "last.bias",
        "network",
    ),
    "fused-net": Kind(
        "fused-net", partial(splat_net.export, head="colour", package="baselines.fused_net"),
        fused_net.load_weights, "last.bias", "network",
    ),
    "occupancy-net": Kind(
        "occupancy-net", occupancy_net.export, occupancy_net.load_weights, "answer.bias", "network"
    ),
    "upsampler": Kind(
        "upsampler", upsampler.export, upsampler.load_weights, "answer.bias", "network"
    ),
    "judge": Kind(
        "", write_judge, load_judge_network, "view.bias",
        reported="not the weights of the judge network (",
    ),
    "views": Kind(
        "", write_views, load_views_network, "heads.view.bias", "labels",
        "not the weights of fd-views (",
    ),
}  # fmt: skip


@functools.cache
def whole(name):
    """Return the content of a file that its loader takes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "w.safetensors"
        kind = KINDS[name]
        kind.write(trained(kind.training) if kind.training else None, path)
        return path.read_bytes()
