"""Training of the rendering GAN (section 3.2 of the paper): steps of Eq. 6 and Eq. 7 in turn.

There are two ways to train, by objective. With the paper's objectives the encoder does not change,
and a drawn image is compared with real ones only by what the discriminator tells of it. With the
objective `paired`, which the paper does not have, each step draws the clouds and views of its real
images, mirrored at random, and a term of the loss compares both. The encoder is trained, too, and
in the first `warm_up` steps the discriminator has no part.

With the paper's objectives training can start from weights. The first `warm_up` steps then train
only the discriminator, because an untrained one would spoil the generator.

Differences from roatienza/pc2pix@23b7b46d, with their reasons:
- Codes are whitened over the training set, because raw codes have a standard deviation of only
  about 0.1, where the noise z is uniform in (-1, 1). Mean and deviation are exported with the
  weights. Codes of an encoder that is not trained are first rotated to their principal axes,
  because nearly all of their numbers tell the same.
- Drawn images have codes of training clouds only. The script that wrote the original's file of
  codes also ran over test shapes, so that their codes were used in training.
- The images for the discriminator's step are drawn with BatchNorm's batch statistics, as those for
  the generator's step are, so that both steps see the same distribution. The original used the
  moving statistics for the former.
- Sheets of images and exported weights are those of an exponential moving average of generator and
  encoder (weights and BN statistics). Its decay is `ema_decay`, and less at the start.
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

_SHEET_IMAGES = 8  # objects on a sheet of progress, at most
_ENCODE_BATCH = 32  # clouds that are encoded at a time
# Factor on the generator's learning rate during the warm-up with reconstruction alone, which stays
# stable at higher rates than training against a discriminator.
_WARM_UP_RATE = 4.0
# A number of the code is divided by its standard deviation, but at least by _MIN_CODE_STD and by
# _MIN_CODE_SHARE of the largest deviation: one that hardly varies is not blown up.
_MIN_CODE_STD = 1e-6
_MIN_CODE_SHARE = 1e-3


@torch.no_grad()
def encode_clouds(
    encoder: Encoder | PointNet, clouds: NDArray[np.float32], device: torch.device
) -> Tensor:
    """Return the codes of clouds [N, 2048, 3], float32 [N, latent_dim], on the CPU."""
    encoder.to(device).eval()
    batches = torch.from_numpy(clouds).split(_ENCODE_BATCH)
    return torch.cat([encoder(batch.to(device)).cpu() for batch in batches])


class GanTrainer(NetworkTrainer):
    """The trainer of generator and discriminator, on `GanData` and an encoder.

    The encoder is trained with the objective `paired`, and else stays as it is. It is stored in the
    checkpoints, so that these have all that is exported.

    start  weights whose generator training starts from, and whose encoder is the given one

    Raises BadInput where the encoder has another configuration than the generator.
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
        # Whitened codes of all clouds, [N, d], by the encoder as it is now.
        self.codes = (codes - self.code_mean) / self.code_std
        generator, discriminator = training_loop.seeded(
            config.seed, lambda: (Generator(config.model), Discriminator(config.model))
        )
        self.generator, self.discriminator = generator.to(device), discriminator.to(device)
        channels_last(self.generator)
        channels_last(self.discriminator)
        if start is not None:
            self.generator.load_state_dict(start.generator.state_dict())
            # Mean and deviation of its encoder's codes may have changed since they were computed,
            # where the encoder was trained further. The generator is adapted to the new ones.
            shift = (self.code_mean - start.code_mean) / start.code_std
            take_scaled_codes(self.generator, self.code_std / start.code_std, shift)
        elif self.paired:
            # At first z has no influence on the image: otherwise reconstruction would have to
            # unlearn it, number by number.
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
        """Return random real images [B, 3, 128, 128], and what they show."""
        n, v = self.azimuth01.shape
        objects = torch.randint(n, (self.batch,), generator=self.random)
        views = torch.randint(v, (self.batch,), generator=self.random)
        return self._images(objects, views), self._condition_of(objects, views)

    def _condition_of(self, objects: Tensor, views: Tensor) -> Conditioning:
        """Return what the images of objects [B] from views [B] show."""
        return Conditioning(
            code=self._sent(self._codes(objects)),
            elevation01=self._sent(self.elevation01[objects, views, None]),
            azimuth01=self._sent(self.azimuth01[objects, views, None]),
        )

    def _sent(self, tensor: Tensor) -> Tensor:
        """Return a tensor on the device, without waiting for the device to finish its work."""
        return tensor.to(self.device, non_blocking=True)

    @torch.no_grad()
    def _codes(self, objects: Tensor) -> Tensor:
        """Return whitened codes [B, d] of objects [B], by an encoder that is not trained."""
        if not self.config.augment:
            return self.codes[objects]
        return self._whiten(self.encoder(self._points(objects).to(self.device)))

    def _draw_fake(self) -> tuple[Tensor, Conditioning]:
        """Return noise [B, 128], and what is to be drawn: random training clouds and views."""
        noise = torch.rand(self.batch, NOISE_DIM, generator=self.random) * 2 - 1
        objects = torch.randint(len(self.codes), (self.batch,), generator=self.random)
        elevation, azimuth = torch.rand(2, self.batch, 1, generator=self.random)
        condition = Conditioning(
            code=self._sent(self._codes(objects)),
            elevation01=self._sent(elevation),
            azimuth01=self._sent(azimuth),
        )
        return self._sent(noise), condition

    def take_step(self) -> dict[str, Tensor]:
        """Take a step of both networks, or of one in the warm-up, and return the losses."""
        self.generator.train()
        self.discriminator.train()
        losses = self._take_paired_step() if self.paired else self._take_papers_step()
        self.steps_done += 1
        update(self.average, self.drawing, self.config.ema_decay, int(self.steps_done))
        return losses

    def _take_papers_step(self) -> dict[str, Tensor]:
        """Take a step of an objective of the paper, and return the losses."""
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
        """Take a step of the objective `paired`, and return the losses."""
        scene = self._draw_scene()
        self.encoder.train()
        noise = torch.rand(self.batch, NOISE_DIM, generator=self.random) * 2 - 1
        elevation = scene.elevation01.to(self.device)
        azimuth = scene.azimuth01.to(self.device)
        with self.autocast():
            code = self._whiten(self.encoder(scene.points.to(self.device)).float())
            drawn = self.generator(noise.to(self.device), code, elevation, azimuth)
        error = reconstruction_error(drawn, scene.images)
        total = self.objective.reconstruction_weight * error
        if self.steps_done < self.config.warm_up:
            self._train_generator(total)
            return {"reconstruction": error.detach()} | _absent("dg", self.device)
        condition = Conditioning(code=code.detach(), elevation01=elevation, azimuth01=azimuth)
        on_discriminator = self._train_discriminator(
            scene.images, condition, drawn.detach(), condition
        )
        terms = self._judge_drawn(drawn, condition)
        self._train_generator(total + terms["g_total"])
        return {"reconstruction": error.detach()} | on_discriminator | _detached(terms)

    def _draw_scene(self) -> Scene:
        """Return random clouds with their real images from random views, half of them mirrored."""
        n, v = self.azimuth01.shape
        objects = torch.randint(n, (self.batch,), generator=self.random)
        views = torch.randint(v, (self.batch,), generator=self.random)
        scene = Scene(
            points=self._points(objects),
            images=self._images(objects, views),
            elevation01=self.elevation01[objects, views, None],
            azimuth01=self.azimuth01[objects, views, None],
        )
        return mirror(scene, torch.rand(self.batch, generator=self.random) < 0.5)

    def _points(self, objects: Tensor) -> Tensor:
        """Return what the encoder is given of the clouds of objects [B], [B, n, 3]."""
        clouds, size = self.clouds[objects], self.encoder.cloud_size
        if self.config.augment:
            points, _ = degrade(clouds, self.random, DEGRADATION)
        else:
            points = draw_points(clouds, size or PLAIN_POINTS, self.random)
        return points if size is None else take_evenly(points, size)

    def _whiten(self, codes: Tensor) -> Tensor:
        """Return codes of the encoder as the generator takes them, both [B, d]."""
        mean, std = self.code_mean.to(codes.device), self.code_std.to(codes.device)
        return (codes - mean) / std

    def _train_discriminator(
        self, real_images: Tensor, real: Conditioning, fake_images: Tensor, fake: Conditioning
    ) -> dict[str, Tensor]:
        """Take a step of the discriminator, and return the terms of Eq. 6 by name."""
        with self.autocast():
            # Real and drawn images are one batch, as in the original, so that spectral
            # normalisation is updated once.
            judged = self.discriminator(torch.cat([real_images, fake_images.float()]))
        halves = [answers.float().chunk(2) for answers in judged]
        on_real = DiscriminatorOutput(*(first for first, _ in halves))
        on_fake = DiscriminatorOutput(*(second for _, second in halves))
        terms = discriminator_loss(on_real, on_fake, real, fake, self.objective)
        self.minimise(terms.total, self.discriminator_adam)
        return _detached({f"d_{name}": value for name, value in terms._asdict().items()})

    def _judge_drawn(self, drawn: Tensor, condition: Conditioning) -> dict[str, Tensor]:
        """Return the terms of Eq. 7 for drawn images by name."""
        # Gradients have to pass through the discriminator to the image; those of its own weights
        # are not needed.
        self.discriminator.requires_grad_(False)
        with self.autocast():
            judged = self.discriminator(drawn)
        self.discriminator.requires_grad_(True)
        judged = DiscriminatorOutput(*(answers.float() for answers in judged))
        terms = generator_loss(judged, condition, self.objective)
        return {f"g_{name}": value for name, value in terms._asdict().items()}

    def _train_generator(self, total: Tensor) -> None:
        """Take a step of the generator, and of an encoder that is trained, by a loss."""
        rate = self.config.generator_lr
        if self.steps_done < self.config.warm_up:
            rate = rate * _WARM_UP_RATE
        self.minimise(total, self.generator_adam, rate)

    def learning_rates(self, steps: int) -> str:
        """Return the learning rates of both networks in the first `steps` steps, in words."""
        config = self.config
        rate, warm = config.generator_lr, min(config.warm_up, steps)
        parts = []
        if warm:
            warm_rate = _WARM_UP_RATE * rate if self.paired else 0.0
            parts.append(f"generator {warm_rate:g} up to step {warm}")
        if steps > warm:
            parts.append(f"then {rate:g}" if warm else f"generator {rate:g}")
            parts.append(f"discriminator {config.discriminator_lr:g}")
        return ", ".join(parts)

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Put the tensors that `state` has returned back in place, and encode the clouds anew.

        The encoder of the checkpoint may have other axes than the one made here: on another machine
        `decorrelated` may give axes of the opposite sign.
        """
        super().restore(state)
        if not self.paired:
            codes = encode_clouds(self.encoder, self.clouds.numpy(), self.device)
            self.codes = (codes - self.code_mean) / self.code_std

    @torch.no_grad()
    def sheet(self) -> NDArray[np.uint8]:
        """Return an image with two rows: real images, and those of the averaged generator.

        The latter are of the same clouds and views, with noise z of 0.
        """
        count = min(_SHEET_IMAGES, len(self.codes))
        objects = torch.arange(count) * len(self.codes) // count
        views = torch.arange(count) % self.azimuth01.shape[1]
        noise = torch.zeros(count, NOISE_DIM, device=self.device)
        points, size = self.clouds[objects], self.encoder.cloud_size
        points = points if size is None else take_evenly(points, size)
        code = self._whiten(self.average["encoder"](points.to(self.device)))
        elevation = self.elevation01[objects, views, None].to(self.device)
        azimuth = self.azimuth01[objects, views, None].to(self.device)
        fake = self.average["generator"](noise, code, elevation, azimuth)
        rows = torch.stack([self._images(objects, views), fake])  # [2, B, 3, H, W]
        rows = rows.permute(0, 3, 1, 4, 2).flatten(2, 3).flatten(0, 1)  # [2 H, B W, 3]
        return ((rows + 1) * 127.5).round().clamp(0, 255).byte().cpu().numpy()


def _absent(networks: str, device: torch.device) -> dict[str, Tensor]:
    """Return zeros for the losses of networks that a step does not train.

    networks  letters of their names: "d" for the discriminator, "g" for the generator, "dg" for
              both

    With these, all steps have the same columns in losses.csv.
    """
    zero = torch.zeros((), device=device)
    return {f"{network}_{term}": zero for network in networks for term in LossTerms._fields}


def _detached(terms: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Return losses by name, detached from their gradients."""
    return {name: value.detach() for name, value in terms.items()}
