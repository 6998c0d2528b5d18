"""A small training of every network, by the functions that the commands call."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from baselines.fused_net.data import FusedSet
from baselines.fused_net.train import FusedNetConfig, train_fused_net
from baselines.occupancy_net.network import OccupancyConfig
from baselines.occupancy_net.train import OccupancyNetConfig, train_occupancy_net
from baselines.splat_net.network import NetworkConfig
from baselines.splat_net.train import SplatNetConfig, train_splat_net
from bench.judges.views import Labels
from bench.training import judge as train_judge
from bench.training import views as train_views
from data_prep.datasets.occupancy_set import OccupancySet
from data_prep.datasets.training_set import SurfaceSet, TrainingSet
from learning import training_loop
from learning.training_loop import Cadence, seeded
from pc2pix.model import ModelConfig, build_encoder
from pc2pix.train_autoencoder import AutoencoderConfig, train_autoencoder
from pc2pix.train_decoder import DecoderConfig, train_decoder
from pc2pix.train_gan import GanConfig, train_gan
from pc2pix.training_data import AutoencoderData, GanData
from pc2pix.weights import load_weights

from .weight_files import whole

CADENCE = Cadence(log=1, sheet=4, checkpoint=2)
TINY = ModelConfig(width=0.0625, latent_dim=4)
PAIRED = ModelConfig(width=0.0625, latent_dim=4, encoder="pointnet", azimuth="sine-cosine")
SMALL = NetworkConfig(widths=(4, 6, 8, 10, 12))
SMALL_FUSED = replace(SMALL, inputs=replace(SMALL.inputs, meshes=("denoised-wrap",)))
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


def start_autoencoder(out_dir, on_progress, **changes):
    config = AutoencoderConfig(**{"model": TINY, "batch": 2, "cadence": CADENCE} | changes)
    data = AutoencoderData(make_clouds(points=2100))
    return train_autoencoder(data, config, out_dir, on_progress=on_progress)


def start_gan(out_dir, on_progress, **changes):
    config = GanConfig(**{"model": TINY, "batch": 2, "cadence": CADENCE} | changes)
    seen = make_set()
    data = GanData(seen.images, seen.azimuth_deg, seen.elevation_deg, seen.clouds)
    encoder = seeded(0, lambda: build_encoder(config.model))
    return train_gan(data, encoder, config, out_dir, on_progress=on_progress)


def start_decoder(out_dir, on_progress, **changes):
    path = out_dir.with_suffix(".safetensors")
    path.write_bytes(whole("pc2pix"))
    weights = load_weights(path)
    defaults = {"weights": weights.sha256, "model": TINY, "batch": 2, "cadence": CADENCE}
    data = AutoencoderData(make_clouds(points=2100))
    config = DecoderConfig(**defaults | changes)
    return train_decoder(data, weights, config, out_dir, on_progress=on_progress)


def start_splat_net(out_dir, on_progress, **changes):
    defaults = {"network": SMALL, "batch": 4, "cool_down": 2, "cadence": CADENCE}
    config = SplatNetConfig(**defaults | changes)
    return train_splat_net(make_surfaces(), config, out_dir, on_progress=on_progress)


def make_fused(objects=3, views=2):
    """Objects with whole clouds but for the first, of 512 points; images and maps at random."""
    shape = (objects, views, 5, 128, 128)
    maps = np.random.default_rng(5).integers(0, 253, shape, dtype=np.uint8)
    counts, noise = np.full(objects, 2048), np.linspace(0, 0.1, objects, dtype=np.float32)
    counts[0] = 512
    return FusedSet(make_surfaces(objects, views), counts, noise, maps)


def start_fused_net(out_dir, on_progress, **changes):
    defaults = {"network": SMALL_FUSED, "batch": 4, "cool_down": 2, "cadence": CADENCE}
    config = FusedNetConfig(**defaults | changes)
    return train_fused_net(make_fused(), config, out_dir, on_progress=on_progress)


def make_occupancy(objects=3, queries=60):
    """Clouds, and places at random that are inside where x > 0."""
    places = np.random.default_rng(4).uniform(-1, 1, (objects, queries, 3)).astype(np.float32)
    return OccupancySet(make_clouds(objects), places, places[..., 0] > 0)


def start_occupancy_net(out_dir, on_progress, **changes):
    defaults = {"network": SMALL_OCCUPANCY, "batch": 2, "cool_down": 2, "cadence": CADENCE}
    config = OccupancyNetConfig(**defaults | changes)
    return train_occupancy_net(make_occupancy(), config, out_dir, on_progress=on_progress)


def start_judge(out_dir, on_progress, **changes):
    config = train_judge.JudgeConfig(**{"seed": 0, "cadence": CADENCE} | changes)
    rng = np.random.default_rng(3)
    painted, neutral = rng.integers(0, 256, (2, 4, 2, 128, 128), dtype=np.uint8)
    angles = rng.uniform(-40, 40, (2, 4, 2))
    data = train_judge.JudgeData(painted, neutral, *angles, make_clouds(4))
    with training_loop.denormals_flushed():
        trainer = train_judge._JudgeTrainer(data, data, config, objects=3)
        return training_loop.run(trainer, config, "data", out_dir, on_progress)


def start_views(out_dir, on_progress, **changes):
    config = train_views.JudgeConfig(**{"seed": 0, "cadence": CADENCE} | changes)
    labels = Labels(("lamp", "car"), ("lamp/desk", "car/van"), ("ladder",))
    images = torch.from_numpy(make_set(objects=5).images).flatten(0, 1)
    answers = {name: torch.arange(10) % 2 for name in ("class", "family")}
    answers |= {"back": torch.full((10,), train_views.NO_LABEL), "view": torch.zeros(10, 3)}
    with training_loop.denormals_flushed():
        # an epoch is of two batches and a half
        trainer = train_views._ViewsTrainer(labels, images, answers, config, batch=4)
        return training_loop.run(trainer, config, "data", out_dir, on_progress)


def ignore(report):
    pass


@dataclass(frozen=True)
class Training:
    """A small training: `start` goes on where one has been in the folder.

    sheet    size of its image in pixels; None where it has none
    lengthens  whether one of more steps begins in the same way
    """

    start: Any
    kind: str
    changes: dict[str, Any]
    sheet: tuple[int, int] | None = (3 * 128, 2 * 128)
    lengthens: bool = True

    def __call__(self, out_dir, steps, on_progress=ignore, **changes):
        return self.start(out_dir, on_progress, steps=steps, **self.changes | changes)


TRAININGS = {
    "autoencoder": Training(start_autoencoder, "autoencoder", {}),
    "gan": Training(start_gan, "gan", {"augment": True}),
    "gan-paired": Training(
        start_gan, "gan", {"model": PAIRED, "objective": "paired", "warm_up": 1}
    ),
    "decoder": Training(start_decoder, "decoder", {}),
    "splat-net": Training(
        start_splat_net, "splat-net", {"objective": "l1-patch", "warm_up": 1}, (3 * 128, 3 * 128)
    ),
    "fused-net": Training(start_fused_net, "fused-net", {}, (2 * 128, 3 * 128)),
    "occupancy-net": Training(start_occupancy_net, "occupancy-net", {}, (3 * 128, 2 * 128)),
    "judge": Training(start_judge, "judge", {}, sheet=None, lengthens=False),
    "views": Training(start_views, "views", {}, sheet=None, lengthens=False),
}
