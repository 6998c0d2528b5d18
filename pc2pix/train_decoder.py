"""Training of a decoder for the frozen encoder of exported weights.

Drawing needs no decoder, and weights are exported without; the one that an encoder was trained with
fits it no longer where the encoder was trained further. So one is fitted afterwards, to see what a
code means as a cloud (the paper's Figures 5 and 6). Chamfer loss as in `pc2pix.train_autoencoder`,
but Adam: nothing here has to follow the original.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from data_prep.scene import CLOUD_SIZE
from learning import training_loop
from learning.clouds import draw_points
from learning.processes import ONE, Processes
from learning.trainer import NetworkTrainer, Part
from pc2pix.losses import chamfer
from pc2pix.model import Decoder, ModelConfig
from pc2pix.train_autoencoder import SHEET_CLOUDS, dots_of
from pc2pix.training_data import AutoencoderData
from pc2pix.weights import DECODER, Weights

KIND = DECODER
_DECAY_STEPS = 500


@dataclass(frozen=True)
class DecoderConfig:
    """The configuration of a decoder's training.

    weights        sha256 of the weights whose encoder it belongs to
    learning_rate  of Adam at first; at step t it is divided by sqrt(1 + t / _DECAY_STEPS), which
                   does not depend on how many steps there will be
    precision      bfloat16 is mixed precision: weights and the loss stay float32
    """

    weights: str
    model: ModelConfig
    steps: int = 3000
    batch: int = 32
    learning_rate: float = 2e-3
    precision: training_loop.Precision = "float32"
    seed: int = 0
    cadence: training_loop.Cadence = training_loop.DEFAULT_CADENCE


def train_decoder(
    data: AutoencoderData,
    weights: Weights,
    config: DecoderConfig,
    out_dir: Path,
    *,
    device: str = "cpu",
    on_progress: training_loop.OnProgress = lambda report: None,
) -> Path:
    """Train to `config.steps`, continuing a run in `out_dir`, and return the checkpoint's path.

    Under `torchrun` all processes train together, each with `config.batch` clouds a step. Raises
    BadInput where `out_dir` holds a run of another configuration, other weights or other data, and
    TrainingDiverged where a loss stops being finite.
    """
    build = functools.partial(_DecoderTrainer, data, weights, config)
    return training_loop.train(build, config, [data.clouds], out_dir, device, on_progress)


class _DecoderTrainer(NetworkTrainer):
    kind = KIND
    config: DecoderConfig

    def __init__(
        self,
        data: AutoencoderData,
        weights: Weights,
        config: DecoderConfig,
        device: torch.device,
        processes: Processes = ONE,
    ) -> None:
        super().__init__(config, device, processes)
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
        which = torch.randint(len(self.clouds), (self.batch,), generator=self.random)
        # another half of the points in another order each time: the code of a shape varies a little
        clouds = draw_points(self.clouds[which], CLOUD_SIZE, self.random)
        codes = self._encode(clouds)
        with self.autocast():
            decoded = self.decoder(codes)
        loss = chamfer(decoded.float(), clouds.to(self.device))
        rate = self.config.learning_rate / math.sqrt(1 + int(self.steps_done) / _DECAY_STEPS)
        self.minimise(loss, self.adam, rate)
        self.steps_done += 1
        return {"chamfer": loss.detach()}

    def parts(self) -> dict[str, Part]:
        return {"decoder": self.decoder, "adam": self.adam, "random": self.random}

    def learning_rates(self, steps: int) -> str:
        return f"{self.config.learning_rate:g} / sqrt(1 + t / {_DECAY_STEPS}) after t steps"

    @torch.no_grad()
    def sheet(self) -> NDArray[np.uint8]:
        """Return two rows: clouds, and the same clouds decoded from their codes."""
        clouds = self.clouds[:SHEET_CLOUDS, :CLOUD_SIZE]
        decoded = self.decoder(self._encode(clouds)).cpu()
        return dots_of(clouds, decoded)
