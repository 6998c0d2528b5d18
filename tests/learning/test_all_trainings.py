"""What every training has in common, whichever network it trains."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import torch

from baselines.splat_net.network import NetworkConfig
from baselines.splat_net.train import SplatNetConfig, train_splat_net
from data_prep.training_set import SurfaceSet, TrainingSet
from learning import checkpoint, training_loop
from learning.training_loop import Cadence, seeded
from pc2pix.model import ModelConfig, build_encoder
from pc2pix.train_autoencoder import AutoencoderConfig, AutoencoderData, train_autoencoder
from pc2pix.train_decoder import DecoderConfig, train_decoder
from pc2pix.train_gan import GanConfig, GanData, train_gan
from pc2pix.weights import export, load_weights

CADENCE = Cadence(log=1, sheet=4, checkpoint=2)
TINY = ModelConfig(width=0.0625, latent_dim=4)
PAIRED = ModelConfig(width=0.0625, latent_dim=4, encoder="pointnet", azimuth="sine-cosine")
SMALL = NetworkConfig(widths=(4, 6, 8, 10, 12))


@pytest.fixture(autouse=True)
def one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


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
    path = out_dir.parent / "weights.safetensors"
    if not path.exists():
        export(start_gan(out_dir.parent / "gan", on_progress=ignore, steps=1), path)
    weights = load_weights(path)
    defaults = {"weights": weights.sha256, "model": TINY, "batch": 2, "cadence": CADENCE}
    data = AutoencoderData(make_clouds(points=2100))
    config = DecoderConfig(**defaults | changes)
    return train_decoder(data, weights, config, out_dir, on_progress=on_progress)


def start_splat_net(out_dir, on_progress, **changes):
    defaults = {"network": SMALL, "batch": 4, "cool_down": 2, "cadence": CADENCE}
    rng = np.random.default_rng(2)
    coverage, grey = rng.integers(0, 256, (2, 3, 2, 128, 128), dtype=np.uint8)
    data = SurfaceSet(make_set(), coverage, grey)
    config = SplatNetConfig(**defaults | changes)
    return train_splat_net(data, config, out_dir, on_progress=on_progress)


def ignore(report):
    pass


@dataclass(frozen=True)
class Training:
    """A small training: `start` goes on where one has been in the folder."""

    start: Any
    kind: str
    changes: dict[str, Any]

    def __call__(self, out_dir, steps, on_progress=ignore, **changes):
        return self.start(out_dir, on_progress, steps=steps, **self.changes | changes)


TRAININGS = {
    "autoencoder": Training(start_autoencoder, "autoencoder", {}),
    "gan": Training(start_gan, "gan", {}),
    "gan-augmented": Training(start_gan, "gan", {"augment": True}),
    "gan-paired": Training(
        start_gan, "gan", {"model": PAIRED, "objective": "paired", "warm_up": 1}
    ),
    "decoder": Training(start_decoder, "decoder", {}),
    "splat-net": Training(start_splat_net, "splat-net", {}),
    "splat-net-patch": Training(
        start_splat_net, "splat-net", {"objective": "l1-patch", "warm_up": 1}
    ),
}


@pytest.fixture(params=TRAININGS)
def train(request):
    return TRAININGS[request.param]


def test_losses_are_not_read_by_a_step(train, tmp_path, monkeypatch):
    """To read a number means to wait for the device; the loop does, and only for what it logs."""
    steps = []

    def run(trainer, *rest):
        steps.extend(trainer.take_step() for _ in range(2))

    train(tmp_path / "x", 1)  # a decoder needs a whole training before it
    monkeypatch.setattr(training_loop, "run", run)
    train(tmp_path / "y", 2)
    for losses in steps:
        assert list(losses) == list(steps[0])
        for loss in losses.values():
            assert isinstance(loss, torch.Tensor)
            assert loss.shape == ()
            assert not loss.requires_grad


def states_are_equal(one, other, kind):
    (state, step, _), (found, found_step, _) = (checkpoint.load(p, kind) for p in (one, other))
    assert step == found_step
    assert state.keys() == found.keys()
    return all(torch.equal(state[key], found[key]) for key in state)


def test_a_lengthened_run_is_one_of_that_length_from_the_beginning(train, tmp_path):
    """Bit for bit, though it had ended, and its learning rate with it."""
    whole = train(tmp_path / "whole", 6)
    train(tmp_path / "cut", 4)
    cut = train(tmp_path / "cut", 6)
    assert states_are_equal(whole, cut, train.kind)
    logs = [(tmp_path / name / "losses.csv").read_text() for name in ("whole", "cut")]
    assert logs[0] == logs[1]
    assert [row.split(",")[0] for row in logs[0].splitlines()] == ["step", *"123456"]


@pytest.mark.parametrize("flushed", [False, True])
def test_denormal_numbers_are_flushed_inside_only(train, tmp_path, flushed):
    seen = []
    torch.set_flush_denormal(flushed)
    try:
        train(tmp_path / "x", 1, lambda report: seen.append(sys.float_info.min / 2))
        assert seen == [0.0]
        assert (sys.float_info.min / 2 == 0.0) == flushed
    finally:
        torch.set_flush_denormal(False)
