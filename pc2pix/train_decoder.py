"""Training of a decoder for the encoder of exported weights, which does not change.

A decoder shows what a code means as a cloud (the paper's Figures 5 and 6). Drawing images does not
need it, so weights are exported without. The decoder that an encoder was trained with does not fit
where the encoder was trained further with the generator. So a new one is trained afterwards. The
loss is the Chamfer distance as in `pc2pix.train_autoencoder`, and the optimiser Adam, because
nothing here has to follow the original.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from data_prep.scene import CLOUD_SIZE
from learning import training_loop
from learning.clouds import draw_points
from learning.trainer import NetworkTrainer
from pc2pix.losses import chamfer
from pc2pix.model import Decoder
from pc2pix.train_autoencoder import SHEET_CLOUDS, dots_of
from pc2pix.training_configs import DecoderConfig
from pc2pix.training_data import AutoencoderData
from pc2pix.weights import DECODER, Weights

_DECAY_STEPS = 500  # at step t the learning rate is divided by sqrt(1 + t / _DECAY_STEPS)


class DecoderTrainer(NetworkTrainer):
    """The trainer of a decoder, on `AutoencoderData`; `weights` has the encoder that it is for."""

    kind = DECODER
    parts = ("decoder", "adam", "random")
    config: DecoderConfig

    def __init__(
        self, data: AutoencoderData, config: DecoderConfig, *place: Any, weights: Weights
    ) -> None:
        super().__init__(data, config, *place)
        device = self.device
        self.batch = config.batch
        self.clouds = torch.from_numpy(data.clouds)
        self.encoder = weights.encoder.to(device)
        self.mean, self.std = weights.code_mean.to(device), weights.code_std.to(device)
        self.decoder = training_loop.seeded(config.seed, lambda: Decoder(config.model)).to(device)
        self.adam = torch.optim.Adam(self.decoder.parameters(), lr=config.learning_rate)

    @torch.no_grad()
    def _encode(self, clouds: Tensor) -> Tensor:
        """Return whitened codes [B, d] of clouds [B, 2048, 3], in float32."""
        return (self.encoder(clouds.to(self.device)) - self.mean) / self.std

    def take_step(self) -> dict[str, Tensor]:
        """Take a step of the decoder and return the loss."""
        which = torch.randint(len(self.clouds), (self.batch,), generator=self.random)
        # Other points in another order each time, so that the decoder sees how much the code of a
        # shape varies.
        clouds = draw_points(self.clouds[which], CLOUD_SIZE, self.random)
        codes = self._encode(clouds)
        with self.autocast():
            decoded = self.decoder(codes)
        loss = chamfer(decoded.float(), clouds.to(self.device))
        rate = self.config.learning_rate / math.sqrt(1 + int(self.steps_done) / _DECAY_STEPS)
        self.minimise(loss, self.adam, rate)
        self.steps_done += 1
        return {"chamfer": loss.detach()}

    def learning_rates(self, steps: int) -> str:
        """Return the learning rates as a formula, the same for any number of steps."""
        return f"{self.config.learning_rate:g} / sqrt(1 + t / {_DECAY_STEPS}) after t steps"

    @torch.no_grad()
    def sheet(self) -> NDArray[np.uint8]:
        """Return an image with two rows: clouds, and the same clouds decoded from their codes."""
        clouds = self.clouds[:SHEET_CLOUDS, :CLOUD_SIZE]
        decoded = self.decoder(self._encode(clouds)).cpu()
        return dots_of(clouds, decoded)
