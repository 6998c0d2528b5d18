from __future__ import annotations

import numpy as np
import pytest

from learning.training_loop import Cadence, seeded
from pc2pix.model import Encoder, ModelConfig
from pc2pix.train_gan import GanConfig, GanData, train_gan
from pc2pix.weights import export

TINY = ModelConfig(width=0.0625, latent_dim=4)


def make_clouds(count, points=2048):
    rng = np.random.default_rng(0)
    return rng.uniform(-0.5, 0.5, (count, points, 3)).astype(np.float32)


@pytest.fixture(scope="session")
def gan_data():
    rng = np.random.default_rng(1)
    return GanData(
        images=rng.integers(0, 256, (3, 2, 128, 128, 3), dtype=np.uint8),
        azimuth_deg=rng.uniform(-180, 180, (3, 2)),
        elevation_deg=rng.uniform(-40, 40, (3, 2)),
        clouds=make_clouds(3),
    )


@pytest.fixture(scope="session")
def gan_checkpoint(gan_data, tmp_path_factory):
    config = GanConfig(model=TINY, steps=2, batch=2, cadence=Cadence(1, 2, 2))
    encoder = seeded(0, lambda: Encoder(TINY))
    return train_gan(gan_data, encoder, config, tmp_path_factory.mktemp("gan"))


@pytest.fixture(scope="session")
def weights_file(gan_checkpoint, tmp_path_factory):
    path = tmp_path_factory.mktemp("weights") / "tiny.safetensors"
    export(gan_checkpoint, path)
    return path
