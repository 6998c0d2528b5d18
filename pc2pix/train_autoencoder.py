"""Training of the point-cloud autoencoder (paper section 3.1 and 4.1).

The loss is the Chamfer distance, minimised by RMSprop at a rate of 1e-4, as in
roatienza/pc2pix@23b7b46d with `--chamfer`. There are three differences. Each step takes the points
of a cloud in a new random order, and of more than 2,048 a new selection: the paper's encoder reads
points as a sequence, and would otherwise learn the one order that it has seen. PointNet, which the
paper does not have, is given fewer points, which saves time. With `augment` the encoder is given
degraded clouds, and the decoder has to reproduce the whole ones.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from data_prep.rendering.dots import draw_dots
from data_prep.scene import CLOUD_SIZE, View
from learning import checkpoint, training_loop
from learning.clouds import degrade, draw_points
from learning.trainer import NetworkTrainer
from pc2pix.augment import DEGRADATION, take_evenly
from pc2pix.losses import chamfer
from pc2pix.model import Decoder, Encoder, ModelConfig, PointNet, build_encoder
from pc2pix.training_configs import AutoencoderConfig
from pc2pix.training_data import AutoencoderData

_KIND = "autoencoder"
SHEET_CLOUDS = 8  # clouds on a sheet of progress, at most
_SHEET_VIEW = View(azimuth_deg=30.0, elevation_deg=20.0)  # that they are drawn from


def load_encoder(path: Path) -> Encoder | PointNet:
    """Return the encoder of a checkpoint of the autoencoder's training, in evaluation mode.

    Raises BadInput for anything but such a checkpoint.
    """
    state, _, config = checkpoint.load(path, _KIND)
    encoder = build_encoder(ModelConfig(**config["model"]))
    encoder.load_state_dict(checkpoint.sub_state(state, "encoder"))
    return encoder.eval()


class AutoencoderTrainer(NetworkTrainer):
    """The trainer of encoder and decoder, on `AutoencoderData`."""

    kind = _KIND
    parts = ("encoder", "decoder", "optimizer", "random")
    kept = ()
    config: AutoencoderConfig

    def __init__(self, data: AutoencoderData, config: AutoencoderConfig, *place: Any) -> None:
        super().__init__(data, config, *place)
        self.batch = config.batch
        self.clouds = torch.from_numpy(data.clouds)
        self.encoder, self.decoder = training_loop.seeded(
            config.seed, lambda: (build_encoder(config.model), Decoder(config.model))
        )
        self.encoder.to(self.device)
        self.decoder.to(self.device)
        # Keras' defaults, as in the original; PyTorch's are 0.99 and 1e-8.
        self.optimizer = torch.optim.RMSprop(
            [*self.encoder.parameters(), *self.decoder.parameters()],
            lr=config.learning_rate,
            alpha=0.9,
            eps=1e-7,
        )

    def _draw_batch(self) -> tuple[Tensor, Tensor]:
        """Return the encoder's input [B, n, 3], and the decoder's target [B, 2048, 3]."""
        which = torch.randint(len(self.clouds), (self.batch,), generator=self.random)
        whole = draw_points(self.clouds[which], CLOUD_SIZE, self.random)
        size = self.encoder.cloud_size
        fed = whole
        if self.config.augment:
            fed, _ = degrade(whole, self.random, DEGRADATION)
        if size is not None:
            fed = take_evenly(fed, size)
        return fed.to(self.device), whole.to(self.device)

    def take_step(self) -> dict[str, Tensor]:
        """Take a step of both networks and return the loss."""
        fed, whole = self._draw_batch()
        self.encoder.train()
        self.decoder.train()
        with self.autocast():
            decoded = self.decoder(self.encoder(fed))
        loss = chamfer(decoded.float(), whole)
        self.minimise(loss, self.optimizer)
        return {"chamfer": loss.detach()}

    def learning_rates(self, steps: int) -> str:
        """Return the constant rate."""
        return f"{self.config.learning_rate:g}"

    @torch.no_grad()
    def sheet(self) -> NDArray[np.uint8]:
        """Return an image with two rows: clouds, and the same clouds decoded from their codes."""
        clouds = self.clouds[:SHEET_CLOUDS, :CLOUD_SIZE]
        self.encoder.eval()
        self.decoder.eval()
        decoded = self.decoder(self.encoder(clouds.to(self.device))).cpu()
        return dots_of(clouds, decoded)


def dots_of(*rows: Tensor) -> NDArray[np.uint8]:
    """Return a sample sheet [128 R, 128 K, 3] of R rows of K clouds [K, N, 3], drawn as dots."""
    sheet = []
    for row in rows:
        images = [draw_dots(cloud.numpy(), [_SHEET_VIEW])[0] for cloud in row]
        sheet.append(np.hstack(images))
    return np.vstack(sheet)
