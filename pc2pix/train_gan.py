"""Training of the rendering GAN (paper section 3.2): alternating steps of Eq. 6 and Eq. 7.

Two ways, by objective. The paper's: codes of a frozen encoder, and nothing ties a drawn image to
the real one of the same cloud and view but the heads of the discriminator. Ours (`paired`): every
step draws the clouds and views of its real images, mirrored at random, with a reconstruction
term; the encoder is trained with the rest; the first `warm_up` steps leave the discriminator out.

The paper's objective can start from weights; then the first `warm_up` steps train the discriminator
alone, so that a fresh one does not spoil the generator.

Departures from roatienza/pc2pix@23b7b46d, each for a reason:
- Codes are whitened over the training set. Raw codes have a standard deviation of about 0.1 beside
  z ~ U(-1, 1); mean and deviation travel with the weights. Those of a frozen encoder are rotated to
  their principal axes first, in its last layer: else nearly all numbers say the same.
- Fake conditions use codes of training clouds only. The script that wrote the original's code file
  ran over train and test shapes, so test codes conditioned its training.
- Fake images of the discriminator's step are made with BatchNorm's batch statistics, as in the
  generator's own step, so that both steps see one distribution; the original used the moving
  statistics there.
- An exponential moving average of generator and encoder (weights and BN statistics; decay
  `ema_decay`, shorter at the start) makes the sample sheets and is what gets exported.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from data_prep.failures import BadInput
from learning import training_loop
from learning.clouds import degrade, draw_points
from learning.trainer import NetworkTrainer, averaged, update
from pc2pix.augment import DEGRADATION, PLAIN_POINTS, Scene, mirror, take_evenly
from pc2pix.autoencoder import decorrelated
from pc2pix.losses import (
    OBJECTIVES,
    Conditioning,
    LossTerms,
    discriminator_loss,
    generator_loss,
    reconstruction_error,
)
from pc2pix.model import (
    NOISE_DIM,
    Discriminator,
    DiscriminatorOutput,
    Encoder,
    Generator,
    PointNet,
    channels_last,
    take_scaled_codes,
)
from pc2pix.training_configs import GanConfig
from pc2pix.training_data import GanData
from pc2pix.weights import Weights

_SHEET_IMAGES = 8
_ENCODE_BATCH = 32
_WARM_UP_RATE = 4.0  # times the learning rate: a regression bears more than a game of two
# A number of the code that never varies, or hardly beside the others, is centred, not blown up.
_MIN_CODE_STD = 1e-6
_MIN_CODE_SHARE = 1e-3


@torch.no_grad()
def encode_clouds(
    encoder: Encoder | PointNet, clouds: NDArray[np.float32], device: torch.device
) -> Tensor:
    """Return codes float32 [N, latent_dim], on the CPU, of clouds [N, 2048, 3]."""
    encoder.to(device).eval()
    batches = torch.from_numpy(clouds).split(_ENCODE_BATCH)
    return torch.cat([encoder(batch.to(device)).cpu() for batch in batches])


class GanTrainer(NetworkTrainer):
    """The trainer of generator and discriminator, on `GanData` and an encoder.

    The encoder is frozen, or with `paired` where training starts; it is stored in the checkpoint,
    which is all that export needs. `start` has the generator that belongs to it.

    Raises BadInput where encoder and configuration do not go together.
    """

    kind = "gan"
    parts = (
        "drawing", "discriminator", "average", "generator_adam", "discriminator_adam", "random",
    )  # fmt: skip
    kept = ("code_mean", "code_std", "steps_done")  # the codes' statistics, for the export
    config: GanConfig

    def __init__(
        self,
        learned: tuple[GanData, Encoder | PointNet],
        config: GanConfig,
        *place: Any,
        start: Weights | None = None,
    ) -> None:
        super().__init__(learned, config, *place)
        (data, encoder), device = learned, self.device
        if replace(encoder.config, azimuth=config.model.azimuth) != config.model:
            raise BadInput(
                f"encoder: its configuration is {encoder.config}, the GAN's {config.model}; "
                "train both with the same width and latent_dim"
            )
        self.batch = config.batch
        self.objective = OBJECTIVES[config.objective]
        self.paired = self.objective.reconstruction_weight > 0
        self.clouds = torch.from_numpy(data.clouds)
        self.images = torch.from_numpy(data.images).to(device)
        angles = np.stack([data.elevation_deg / 80 + 0.5, data.azimuth_deg / 360 + 0.5])
        self.elevation01, self.azimuth01 = torch.from_numpy(angles.astype(np.float32))  # [N, V]
        self.encoder = encoder.to(device)
        codes = encode_clouds(encoder, data.clouds, device)
        if start is None and not self.paired:
            self.encoder = decorrelated(encoder, codes)
            codes = encode_clouds(self.encoder, data.clouds, device)
        self.code_mean = codes.mean(dim=0)
        std = codes.std(dim=0, correction=0)
        self.code_std = std.clamp(min=max(_MIN_CODE_SHARE * float(std.max()), _MIN_CODE_STD))
        self.codes = (codes - self.code_mean) / self.code_std  # [N, d], of the encoder as given
        generator, discriminator = training_loop.seeded(
            config.seed, lambda: (Generator(config.model), Discriminator(config.model))
        )
        self.generator, self.discriminator = generator.to(device), discriminator.to(device)
        channels_last(self.generator)
        channels_last(self.discriminator)
        if start is not None:
            self.generator.load_state_dict(start.generator.state_dict())
            # its encoder may have been trained on since its codes were whitened
            shift = (self.code_mean - start.code_mean) / start.code_std
            take_scaled_codes(self.generator, self.code_std / start.code_std, shift)
        elif self.paired:
            # z starts unheard: reconstruction would have to unlearn it, number by number
            torch.nn.init.zeros_(self.generator.dense.weight[:, :NOISE_DIM])
        self.encoder.requires_grad_(self.paired)
        self.drawing = torch.nn.ModuleDict({"generator": self.generator, "encoder": self.encoder})
        self.average = averaged(self.drawing)
        betas = (0.5, 0.999)
        self.generator_adam = torch.optim.Adam(
            [p for p in self.drawing.parameters() if p.requires_grad],
            lr=config.generator_lr,
            betas=betas,
            fused=True,
        )
        self.discriminator_adam = torch.optim.Adam(
            self.discriminator.parameters(), lr=config.discriminator_lr, betas=betas, fused=True
        )

    def _images(self, objects: Tensor, views: Tensor) -> Tensor:
        """Return real images [B, 3, 128, 128] in [-1, 1], channels last."""
        nhwc = self.images[self._sent(objects), self._sent(views)]
        return nhwc.permute(0, 3, 1, 2).float() / 127.5 - 1

    def _draw_real(self) -> tuple[Tensor, Conditioning]:
        n, v = self.azimuth01.shape
        objects = torch.randint(n, (self.batch,), generator=self.random)
        views = torch.randint(v, (self.batch,), generator=self.random)
        return self._images(objects, views), self._condition_of(objects, views)

    def _condition_of(self, objects: Tensor, views: Tensor) -> Conditioning:
        elevation = self.elevation01[objects, views, None]
        azimuth = self.azimuth01[objects, views, None]
        parts = (self._codes(objects), elevation, azimuth)
        return Conditioning(*(self._sent(part) for part in parts))

    def _sent(self, tensor: Tensor) -> Tensor:
        # without waiting for the device, which would be idle until the next work comes
        return tensor.to(self.device, non_blocking=True)

    @torch.no_grad()
    def _codes(self, objects: Tensor) -> Tensor:
        """Return codes [B, d] of the frozen encoder."""
        if not self.config.augment:
            return self.codes[objects]
        return self._whiten(self.encoder(self._points(objects).to(self.device)))

    def _draw_fake(self) -> tuple[Tensor, Conditioning]:
        """Return noise [B, 128], and a training cloud's code seen from anywhere."""
        noise = torch.rand(self.batch, NOISE_DIM, generator=self.random) * 2 - 1
        objects = torch.randint(len(self.codes), (self.batch,), generator=self.random)
        elevation, azimuth = torch.rand(2, self.batch, 1, generator=self.random)
        parts = (self._codes(objects), elevation, azimuth)
        return self._sent(noise), Conditioning(*(self._sent(part) for part in parts))

    def take_step(self) -> dict[str, Tensor]:
        """Take a step of both networks, or in the warm-up of one, and return the losses."""
        self.generator.train()
        self.discriminator.train()
        losses = self._take_paired_step() if self.paired else self._take_papers_step()
        self.steps_done += 1
        update(self.average, self.drawing, self.config.ema_decay, int(self.steps_done))
        return losses

    def _take_papers_step(self) -> dict[str, Tensor]:
        real_images, real = self._draw_real()
        noise, fake = self._draw_fake()
        with self.autocast(), torch.no_grad():
            fake_images = self.generator(noise, *fake)
        on_discriminator = self._train_discriminator(real_images, real, fake_images, fake)
        if self.steps_done < self.config.warm_up:
            return on_discriminator | _absent("g", self.device)
        noise, fake = self._draw_fake()
        with self.autocast():
            fake_images = self.generator(noise, *fake)
        terms = self._judge_drawn(fake_images, fake)
        self._train_generator(terms["g_total"])
        return on_discriminator | _detached(terms)

    def _take_paired_step(self) -> dict[str, Tensor]:
        scene = self._draw_scene()
        self.encoder.train()
        noise = torch.rand(self.batch, NOISE_DIM, generator=self.random) * 2 - 1
        angles = scene.elevation01.to(self.device), scene.azimuth01.to(self.device)
        with self.autocast():
            code = self._whiten(self.encoder(scene.points.to(self.device)).float())
            drawn = self.generator(noise.to(self.device), code, *angles)
        error = reconstruction_error(drawn, scene.images)
        total = self.objective.reconstruction_weight * error
        if self.steps_done < self.config.warm_up:
            self._train_generator(total)
            return {"reconstruction": error.detach()} | _absent("dg", self.device)
        condition = Conditioning(code.detach(), *angles)
        on_discriminator = self._train_discriminator(
            scene.images, condition, drawn.detach(), condition
        )
        terms = self._judge_drawn(drawn, condition)
        self._train_generator(total + terms["g_total"])
        return {"reconstruction": error.detach()} | on_discriminator | _detached(terms)

    def _draw_scene(self) -> Scene:
        n, v = self.azimuth01.shape
        objects = torch.randint(n, (self.batch,), generator=self.random)
        views = torch.randint(v, (self.batch,), generator=self.random)
        scene = Scene(
            self._points(objects),
            self._images(objects, views),
            self.elevation01[objects, views, None],
            self.azimuth01[objects, views, None],
        )
        return mirror(scene, torch.rand(self.batch, generator=self.random) < 0.5)

    def _points(self, objects: Tensor) -> Tensor:
        """Return the encoder's input [B, n, 3]."""
        clouds, size = self.clouds[objects], self.encoder.cloud_size
        if self.config.augment:
            points, _ = degrade(clouds, self.random, DEGRADATION)
        else:
            points = draw_points(clouds, size or PLAIN_POINTS, self.random)
        return points if size is None else take_evenly(points, size)

    def _whiten(self, codes: Tensor) -> Tensor:
        mean, std = self.code_mean.to(codes.device), self.code_std.to(codes.device)
        return (codes - mean) / std

    def _train_discriminator(
        self, real_images: Tensor, real: Conditioning, fake_images: Tensor, fake: Conditioning
    ) -> dict[str, Tensor]:
        with self.autocast():
            # one batch of both halves, as in the original: u moves once
            judged = self.discriminator(torch.cat([real_images, fake_images.float()]))
        halves = zip(*(t.float().chunk(2) for t in judged), strict=True)
        on_real, on_fake = (DiscriminatorOutput(*half) for half in halves)
        terms = discriminator_loss(on_real, on_fake, real, fake, self.objective)
        self.minimise(terms.total, self.discriminator_adam)
        return _detached({f"d_{name}": value for name, value in terms._asdict().items()})

    def _judge_drawn(self, drawn: Tensor, condition: Conditioning) -> dict[str, Tensor]:
        """Return the terms of Eq. 7 for drawn images."""
        # gradients pass through the discriminator, but its own would be thrown away
        self.discriminator.requires_grad_(False)
        with self.autocast():
            judged = self.discriminator(drawn)
        self.discriminator.requires_grad_(True)
        judged = DiscriminatorOutput(*(t.float() for t in judged))
        terms = generator_loss(judged, condition, self.objective)
        return {f"g_{name}": value for name, value in terms._asdict().items()}

    def _train_generator(self, total: Tensor) -> None:
        warm = self.steps_done < self.config.warm_up
        rate = self.config.generator_lr * (_WARM_UP_RATE if warm else 1.0)
        self.minimise(total, self.generator_adam, rate)

    def learning_rates(self, steps: int) -> str:
        """Return the rates of both networks in words."""
        config = self.config
        rate, warm = config.generator_lr, min(config.warm_up, steps)
        warm_rate = _WARM_UP_RATE * rate if self.paired else 0.0
        generator = [f"generator {warm_rate:g} up to step {warm}"] if warm else []
        if steps > warm:
            generator.append(f"{'then' if warm else 'generator'} {rate:g}")
            generator.append(f"discriminator {config.discriminator_lr:g}")
        return ", ".join(generator)

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Restore what `state` has returned, and the codes of the encoder in it.

        On another machine the axes of the codes may point the other way (`decorrelated`).
        """
        super().restore(state)
        if not self.paired:
            codes = encode_clouds(self.encoder, self.clouds.numpy(), self.device)
            self.codes = (codes - self.code_mean) / self.code_std

    @torch.no_grad()
    def sheet(self) -> NDArray[np.uint8]:
        """Return two rows: real images, and the averaged generator's of the same (z = 0)."""
        count = min(_SHEET_IMAGES, len(self.codes))
        objects = torch.arange(count) * len(self.codes) // count
        views = torch.arange(count) % self.azimuth01.shape[1]
        noise = torch.zeros(count, NOISE_DIM, device=self.device)
        points, size = self.clouds[objects], self.encoder.cloud_size
        points = points if size is None else take_evenly(points, size)
        code = self._whiten(self.average["encoder"](points.to(self.device)))
        angles = self.elevation01[objects, views, None], self.azimuth01[objects, views, None]
        inputs = (noise, code, *(a.to(self.device) for a in angles))
        fake = self.average["generator"](*inputs)
        rows = torch.stack([self._images(objects, views), fake])  # [2, B, 3, H, W]
        rows = rows.permute(0, 3, 1, 4, 2).flatten(2, 3).flatten(0, 1)  # [2 H, B W, 3]
        return ((rows + 1) * 127.5).round().clamp(0, 255).byte().cpu().numpy()


def _absent(networks: str, device: torch.device) -> dict[str, Tensor]:
    """Return zeros for the terms of networks ("d", "g") that a step leaves out.

    So losses.csv has the same columns from the first step to the last.
    """
    zero = torch.zeros((), device=device)
    return {f"{who}_{term}": zero for who in networks for term in LossTerms._fields}


def _detached(terms: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name: value.detach() for name, value in terms.items()}
