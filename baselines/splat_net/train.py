"""Training of splat-net: it draws degraded clouds, and the images are compared with true ones.

Each step takes several views of each of a few clouds, because finding the neighbours of a cloud's
points takes as long as drawing an image, and has to be done only once for all views. The learning
rate is constant, and falls to 0 over the last `cool_down` steps. Points are projected in float32,
whatever the precision of the network.
"""

from __future__ import annotations

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
from baselines.splat_net.surfels import Surfels, find_surfels, stack
from data_prep.datasets.training_set import SurfaceSet
from data_prep.failures import BadInput
from data_prep.scene import View
from learning import training_loop
from learning.clouds import MAX_NOISE, degrade
from learning.trainer import CooledTrainer, take_statistics

# The input of the network: channels [B, C, S, S], and points [B, 3, N] in the camera's frame.
Seen = tuple[Tensor, Tensor]
SHEET_CLOUDS = 8  # objects on a sheet of progress, at most


class SplatNetTrainer(CooledTrainer):
    """The trainer of splat-net, on a `SurfaceSet`.

    start     a network of `config.network` with the weights that training starts from; None for
              random ones
    features  makes the deep features of images that some objectives compare

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
                f"the training images have {views} views of an object, and a step needs at least "
                f"{VIEWS_TOGETHER}; render more"
            )
        self.features = features
        self.objective = OBJECTIVES[config.objective]
        # With one colour for the whole image, the image in colour teaches the network only this
        # colour, and the grey image teaches it everything else.
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
        self.shown = torch.arange(count) * len(self.clouds) // count  # objects on the sheets

    def surfaces(self) -> SurfaceSet:
        """Return the set of images and clouds that is learned from."""
        return self.learned

    def take_step(self) -> dict[str, Tensor]:
        """Take a step of the network and of its judge; return the terms of the loss by name."""
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
            # Of one view of each cloud: the features of all would take longer than the network.
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
        _, images = composite(output, self.config.network.heads)
        if self.one_colour:
            grey, colour = images
        else:
            colour, grey = images
        return colour, grey

    def _judge(self, drawn: Tensor, real: Tensor) -> tuple[Tensor, Tensor]:
        """Take a step of the judge; return its error, and how false it finds drawn images, [B].

        During the warm-up the latter is 0, because a judge that has not learned yet would only
        mislead the network.
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
        """Return the network's input of B views, the true images, and the noise of clouds [B].

        The noise is its standard deviation, in unit-sphere units.
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
        seen, truth = self._scene(points, objects, order[:, :VIEWS_TOGETHER], mirrored)
        return seen, truth, noise.repeat_interleave(VIEWS_TOGETHER)

    @torch.no_grad()
    def _scene(
        self, points: Tensor, objects: Tensor, views: Tensor, mirrored: Tensor
    ) -> tuple[Seen, Truth]:
        """Return the network's input of K objects from M views each, and the true images.

        points    [K, N, 3]
        objects   [K]: the rows of the training set that the clouds are of
        views     [K, M]: the numbers of the views
        mirrored  bool [K]: which objects are mirrored left to right. A mirrored shape seen from the
                  opposite azimuth gives the mirrored image, because the light is at the camera
        """
        sign = torch.where(mirrored, -1.0, 1.0)
        ones = torch.ones_like(sign)
        points = points * torch.stack([sign, ones, ones], dim=1)[:, None]
        rows = objects[:, None].expand_as(views).flatten().numpy()
        columns = views.flatten().numpy()
        seen = self.data.seen
        signs = sign.repeat_interleave(views.shape[1])
        azimuths = seen.azimuth_deg[rows, columns] * signs.numpy()
        elevations = seen.elevation_deg[rows, columns]
        looks = [
            View(float(azimuth), float(elevation))
            for azimuth, elevation in zip(azimuths, elevations, strict=True)
        ]
        search = functools.partial(find_surfels, surfaces=self.config.network.inputs.surfaces)
        surfels = stack(list(self.searchers.map(search, points.numpy())))
        repeated = {}  # the surfels of an object, once for each of its views
        for name, value in vars(surfels).items():
            repeated[name] = value.repeat_interleave(views.shape[1], dim=0).to(self.device)
        together = Surfels(**repeated)
        at = cameras(looks).to(self.device)
        flip = (signs < 0).to(self.device)[:, None, None, None]
        maps = self._maps(rows, columns, flip)
        projection = Projection(together, at, self.config.network.inputs, maps=maps)

        def scaled(images_of_all: NDArray[np.uint8]) -> Tensor:
            taken = torch.from_numpy(images_of_all[rows, columns]).to(self.device).float() / 255
            taken = taken.unsqueeze(1) if taken.dim() == 3 else taken.permute(0, 3, 1, 2)
            return torch.where(flip, taken.flip(3), taken)

        truth = Truth(
            colour=scaled(seen.images),
            grey=scaled(self.data.grey),
            coverage=scaled(self.data.coverage),
        )
        return (projection.whole(), projection.points), truth

    def _maps(
        self, objects: NDArray[np.int64], views: NDArray[np.int64], mirrored: Tensor
    ) -> Tensor | None:
        """Return None, as there are no meshes; the trainer of fused-net returns their maps.

        objects   [B]
        views     [B]: a view of each
        mirrored  bool [B, 1, 1, 1]
        """
        del objects, views, mirrored
        return None

    @torch.no_grad()
    def sheet(self) -> NDArray[np.uint8]:
        """Return an image of progress, uint8 [H, W, 3], with a column for each of some objects.

        The rows are the true image, and the averaged network's images in colour and in grey. Clouds
        are whole and without noise.
        """
        objects, count = self.shown, len(self.shown)
        views = (torch.arange(count) % self.data.seen.azimuth_deg.shape[1])[:, None]
        none_mirrored = torch.zeros(count, dtype=torch.bool)
        shown, truth = self._scene(self.clouds[objects], objects, views, none_mirrored)
        output = self.average(*shown)
        colour, grey = self._images(output)
        rows = torch.stack([truth.colour, colour, grey.expand_as(colour)])  # [3, K, 3, S, S]
        rows = rows.permute(0, 3, 1, 4, 2).flatten(2, 3).flatten(0, 1)
        return (rows * 255).round().byte().cpu().numpy()
