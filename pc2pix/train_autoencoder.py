"""Training of the point-cloud autoencoder (paper section 3.1 and 4.1).

Chamfer loss, RMSprop 1e-4 as in roatienza/pc2pix@23b7b46d with `--chamfer`. Departures: every
step feeds the points of a cloud in a fresh random order (and, where a cloud has more than 2,048, a
fresh selection), because the paper's encoder reads the points as a sequence and would otherwise
learn the one order it has seen. PointNet, which is ours, is fed fewer points, for speed. With
`augment` the encoder is fed degraded clouds and the decoder held to the whole ones.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from data_prep.rendering.camera import project
from data_prep.scene import CLOUD_SIZE, IMAGE_SIZE, View
from learning import checkpoint, training_loop
from learning.clouds import draw_points
from learning.processes import ONE, Processes
from learning.trainer import NetworkTrainer, Part
from pc2pix.augment import degrade, take_evenly
from pc2pix.losses import chamfer
from pc2pix.model import LITE, Decoder, Encoder, ModelConfig, PointNet, build_encoder
from pc2pix.training_data import AutoencoderData

KIND = "autoencoder"
SHEET_CLOUDS = 8
_SHEET_VIEW = View(azimuth_deg=30.0, elevation_deg=20.0)


@dataclass(frozen=True)
class AutoencoderConfig:
    """The configuration, with the original's defaults but for width and number of steps.

    steps      the original trains 600 passes over each cloud (101,640 steps for its chairs)
    precision  bfloat16 is mixed precision: weights, BN statistics and the loss stay float32
    """

    model: ModelConfig = LITE
    steps: int = 10_000
    batch: int = 32
    learning_rate: float = 1e-4
    augment: bool = False
    precision: training_loop.Precision = "float32"
    seed: int = 0
    cadence: training_loop.Cadence = training_loop.DEFAULT_CADENCE


def train_autoencoder(
    data: AutoencoderData,
    config: AutoencoderConfig,
    out_dir: Path,
    *,
    device: str = "cpu",
    on_progress: training_loop.OnProgress = lambda report: None,
) -> Path:
    """Train to `config.steps`, continuing a run in `out_dir`, and return the checkpoint's path.

    Under `torchrun` all processes train together, each with `config.batch` clouds a step. Raises
    BadInput where `out_dir` holds a run of another configuration or other data, and
    TrainingDiverged where a loss stops being finite or explodes.
    """
    build = functools.partial(_AutoencoderTrainer, data, config)
    return training_loop.train(build, config, [data.clouds], out_dir, device, on_progress)


def load_encoder(path: Path) -> Encoder | PointNet:
    """Return the encoder of an autoencoder checkpoint, in evaluation mode."""
    state, _, config = checkpoint.load(path, KIND)
    encoder = build_encoder(ModelConfig(**config["model"]))
    encoder.load_state_dict(checkpoint.sub_state(state, "encoder"))
    return encoder.eval()


class _AutoencoderTrainer(NetworkTrainer):
    kind = KIND
    kept = ()
    config: AutoencoderConfig

    def __init__(
        self,
        data: AutoencoderData,
        config: AutoencoderConfig,
        device: torch.device,
        processes: Processes = ONE,
    ) -> None:
        super().__init__(config, device, processes)
        self.batch = config.batch
        self.clouds = torch.from_numpy(data.clouds)
        self.encoder, self.decoder = training_loop.seeded(
            config.seed, lambda: (build_encoder(config.model), Decoder(config.model))
        )
        self.encoder.to(device)
        self.decoder.to(device)
        # Keras' RMSprop: rho 0.9 and epsilon 1e-7 (PyTorch's defaults are 0.99 and 1e-8)
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
        fed = degrade(whole, self.random) if self.config.augment else whole
        if size is not None:
            fed = take_evenly(fed, size)
        return fed.to(self.device), whole.to(self.device)

    def take_step(self) -> dict[str, Tensor]:
        fed, whole = self._draw_batch()
        self.encoder.train()
        self.decoder.train()
        with self.autocast():
            decoded = self.decoder(self.encoder(fed))
        loss = chamfer(decoded.float(), whole)
        self.minimise(loss, self.optimizer)
        return {"chamfer": loss.detach()}

    def parts(self) -> dict[str, Part]:
        return {
            "encoder": self.encoder,
            "decoder": self.decoder,
            "optimizer": self.optimizer,
            "random": self.random,
        }

    def learning_rates(self, steps: int) -> str:
        return f"{self.config.learning_rate:g}"

    @torch.no_grad()
    def sheet(self) -> NDArray[np.uint8]:
        """Return two rows: clouds, and the same clouds decoded from their codes."""
        clouds = self.clouds[:SHEET_CLOUDS, :CLOUD_SIZE]
        self.encoder.eval()
        self.decoder.eval()
        decoded = self.decoder(self.encoder(clouds.to(self.device))).cpu()
        return dots_of(clouds, decoded)


def dots_of(*rows: Tensor) -> NDArray[np.uint8]:
    """Return a sample sheet [128 R, 128 K, 3] of R rows of K clouds [K, N, 3]."""
    return np.vstack([np.hstack([dots(cloud.numpy()) for cloud in row]) for row in rows])


def dots(points: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return an image [128, 128, 3] of a cloud [N, 3]: a black pixel for each point."""
    image = np.full((IMAGE_SIZE, IMAGE_SIZE, 3), 255, dtype=np.uint8)
    pixels, _ = project(points, _SHEET_VIEW)
    column, row = np.clip(pixels, 0, IMAGE_SIZE - 1).astype(int).T
    image[row, column] = 0
    return image
