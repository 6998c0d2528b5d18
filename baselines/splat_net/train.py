"""Training of the network: degraded clouds are projected and drawn, and compared with true images.

Each step takes a few clouds and several views of each: finding neighbours costs as much as drawing
an image, and the views of a cloud share them. The learning rate is constant, then falls to nothing
over the last `cool_down` steps. Projection stays in float32 whatever the precision.
"""

from __future__ import annotations

import dataclasses
import functools
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.splat_net.config import VIEWS_TOGETHER, SplatNetConfig
from baselines.splat_net.losses import (
    COVERAGE_WEIGHT,
    GREY_WEIGHT,
    OBJECTIVES,
    TILT_WEIGHT,
    FeatureMaps,
    PatchJudge,
    Truth,
    coverage_error,
    feature_error,
    judge_error,
    tilt_error,
)
from baselines.splat_net.network import COLOUR_HEADS, composite
from baselines.splat_net.points2pix import Network, build
from baselines.splat_net.projection import Projection, cameras
from baselines.splat_net.surfels import find_surfels, stack
from data_prep.datasets.training_set import SurfaceSet
from data_prep.failures import BadInput
from data_prep.scene import View
from learning import training_loop
from learning.clouds import MAX_NOISE, degrade
from learning.trainer import CooledTrainer, take_statistics

Seen = tuple[Tensor, Tensor]  # channels [B, C, S, S], and points [B, 3, N] as the camera sees them
SHEET_CLOUDS = 8


class SplatNetTrainer(CooledTrainer):
    """The trainer of splat-net, on a `SurfaceSet`; fused-net's draws its batches from other clouds.

    start     a network of `config.network` whose weights training starts from, where
              `config.start` names them
    features  maps that the objective compares, where it compares some

    Raises BadInput where objects have fewer than VIEWS_TOGETHER views.
    """

    kind = "splat-net"
    parts = ("network", "judge", "average", "adam", "judge_adam", "random")
    config: SplatNetConfig

    def __init__(
        self,
        learned: Any,
        config: SplatNetConfig,
        *place: Any,
        start: Network | None = None,
        features: FeatureMaps | None = None,
    ) -> None:
        super().__init__(learned, config, *place)
        self.data = data = self.surfaces()
        views = data.seen.azimuth_deg.shape[1]
        if views < VIEWS_TOGETHER:
            raise BadInput(
                f"{views} views of an object: at least {VIEWS_TOGETHER} are drawn together; render "
                "more"
            )
        self.features = features
        self.objective = OBJECTIVES[config.objective]
        # Then the image in colour teaches the colour alone, and the grey one everything else.
        self.one_colour = config.network.heads == COLOUR_HEADS["image"]
        self.clouds = torch.from_numpy(data.seen.clouds)
        network, judge = training_loop.seeded(
            config.seed,
            lambda: (build(config.network), PatchJudge(self.objective.judged_channels)),
        )
        if start is not None:
            network.load_state_dict(start.state_dict())
        self.judge = judge.to(self.device)
        for part in (network, self.judge):
            part.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.build(network)
        self.judge_adam = torch.optim.Adam(
            self.judge.parameters(), lr=config.judge_lr, betas=(0.5, 0.999), fused=True
        )
        self.searchers = ThreadPoolExecutor(torch.get_num_threads())
        count = min(SHEET_CLOUDS, len(self.clouds))
        self.shown = torch.arange(count) * len(self.clouds) // count  # objects of the sheets

    def surfaces(self) -> SurfaceSet:
        """Return the images of what is learned from."""
        return self.learned

    def take_step(self) -> dict[str, Tensor]:
        """Take a step of the network and of its judge, and return the terms of the loss."""
        self.network.train()
        self.judge.train()
        if self.config.steps - int(self.steps_done) <= self.config.cool_down:
            take_statistics(self.network, self.average)
        seen, truth, noise = self._draw_batch()
        with self.autocast():
            output = self.network(*seen)
        colour, grey = self._images(output)
        terms = {
            "colour": self.objective.image_error(colour, truth.colour, truth.coverage),
            "grey": self.objective.image_error(grey, truth.grey, truth.coverage),
            "coverage": coverage_error(output[:, :1].float(), truth.coverage),
        }
        total = terms["colour"] + COVERAGE_WEIGHT * terms["coverage"]
        total = total + (1.0 if self.one_colour else GREY_WEIGHT) * terms["grey"]
        if self.objective.tilts:
            place = 1 if self.one_colour else -1
            cover = output[:, place, None].float().sigmoid()
            terms["tilt"] = tilt_error(cover, truth.grey, truth.coverage)
            total = total + TILT_WEIGHT * terms["tilt"]
        if self.objective.features:
            assert self.features is not None, "the objective compares features"
            # One view of each cloud: features of all would take longer than the network itself.
            some = slice(None, None, VIEWS_TOGETHER)
            with self.autocast():
                terms["features"] = feature_error(grey[some], truth.grey[some], self.features)
            total = total + self.objective.features * terms["features"]
        if self.objective.patch_weight:
            judged = self.objective.judged
            error, patches = self._judge(judged(colour, grey), judged(truth.colour, truth.grey))
            terms |= {"judge": error, "patches": patches.mean()}
            clean, noisy = self.objective.patch_weight
            weight = clean + (noisy - clean) * noise.to(self.device) / MAX_NOISE
            total = total + (weight * patches).mean()
        self.learn(total)
        return {name: value.detach() for name, value in terms.items()}

    def _images(self, output: Tensor) -> tuple[Tensor, Tensor]:
        """Return the images in colour [B, 3, S, S] and in grey [B, 1, S, S] of an output."""
        first, second = composite(output, self.config.network.heads)[1]
        return (second, first) if self.one_colour else (first, second)

    def _judge(self, drawn: Tensor, real: Tensor) -> tuple[Tensor, Tensor]:
        """Take a step of the judge; return its error, and how false [B] it finds drawn images.

        That is zero in the warm-up: a judge that has learned nothing would only disturb.
        """
        with self.autocast():
            judged = self.judge(torch.cat([real, drawn.detach()])).float()
        error = judge_error(*judged.chunk(2))
        self.minimise(error, self.judge_adam)
        if int(self.steps_done) < self.config.warm_up:
            return error.detach(), torch.zeros(len(drawn), device=drawn.device)
        self.judge.requires_grad_(False)
        with self.autocast():
            patches = -self.judge(drawn).float().mean(dim=(1, 2, 3))
        self.judge.requires_grad_(True)
        return error.detach(), patches

    def _draw_batch(self) -> tuple[Seen, Truth, Tensor]:
        """Return the network's input, the truth, and the noise of the clouds [B], for B views.

        The noise is a standard deviation.
        """
        count, views = self.data.seen.azimuth_deg.shape
        clouds = self.batch // VIEWS_TOGETHER
        objects = torch.randint(count, (clouds,), generator=self.random)
        order = torch.rand(clouds, views, generator=self.random).argsort(dim=1)
        mirrored = torch.rand(clouds, generator=self.random) < 0.5
        points = self.clouds[objects]
        noise = torch.zeros(clouds)
        if self.config.augment:
            points, clean = degrade(points, self.random)
            noise = (points - clean).std(dim=(1, 2))
        scene = self._scene(points, objects, order[:, :VIEWS_TOGETHER], mirrored)
        return *scene, noise.repeat_interleave(VIEWS_TOGETHER)

    @torch.no_grad()
    def _scene(
        self, points: Tensor, objects: Tensor, views: Tensor, mirrored: Tensor
    ) -> tuple[Seen, Truth]:
        """Return the network's input of objects [K] from views [K, M], and the truth.

        A mirrored shape seen from the opposite azimuth gives the mirrored image, for the light
        is at the camera.
        """
        sign = torch.where(mirrored, -1.0, 1.0)
        points = points * torch.stack([sign, *torch.ones(2, len(sign))], dim=1)[:, None]
        rows, columns = objects[:, None].expand_as(views).flatten().numpy(), views.flatten().numpy()
        seen = self.data.seen
        signs = sign.repeat_interleave(views.shape[1])
        looks = [
            View(float(azimuth), float(elevation))
            for azimuth, elevation in zip(
                seen.azimuth_deg[rows, columns] * signs.numpy(),
                seen.elevation_deg[rows, columns],
                strict=True,
            )
        ]
        search = functools.partial(find_surfels, surfaces=self.config.network.inputs.surfaces)
        surfels = stack(list(self.searchers.map(search, points.numpy())))
        together = dataclasses.replace(
            surfels,
            **{
                name: value.repeat_interleave(views.shape[1], dim=0).to(self.device)
                for name, value in vars(surfels).items()
            },
        )
        at = cameras(looks).to(self.device)
        flip = (signs < 0).to(self.device)[:, None, None, None]
        maps = self._maps(rows, columns, flip)
        projection = Projection(together, at, self.config.network.inputs, maps=maps)

        def scaled(images_of_all: NDArray[np.uint8]) -> Tensor:
            taken = torch.from_numpy(images_of_all[rows, columns]).to(self.device).float() / 255
            taken = taken.unsqueeze(1) if taken.dim() == 3 else taken.permute(0, 3, 1, 2)
            return torch.where(flip, taken.flip(3), taken)

        truth = Truth(scaled(seen.images), scaled(self.data.grey), scaled(self.data.coverage))
        return (projection.whole(), projection.points), truth

    def _maps(
        self, objects: NDArray[np.int64], views: NDArray[np.int64], mirrored: Tensor
    ) -> Tensor | None:
        """Return None: a subclass has maps of meshes of B objects from views, some mirrored."""
        del objects, views, mirrored
        return None

    @torch.no_grad()
    def sheet(self) -> NDArray[np.uint8]:
        """Return columns of objects: the truth, and the averaged network's images of 2,048 points.

        The three rows are the truth, the image in colour and the image in grey; the points are
        without noise.
        """
        objects, count = self.shown, len(self.shown)
        views = (torch.arange(count) % self.data.seen.azimuth_deg.shape[1])[:, None]
        nowhere = torch.zeros(count, dtype=torch.bool)
        shown, truth = self._scene(self.clouds[objects], objects, views, nowhere)
        output = self.average(*shown)
        colour, grey = self._images(output)
        rows = torch.stack([truth.colour, colour, grey.expand_as(colour)])  # [3, K, 3, S, S]
        rows = rows.permute(0, 3, 1, 4, 2).flatten(2, 3).flatten(0, 1)
        return (rows * 255).round().byte().cpu().numpy()
