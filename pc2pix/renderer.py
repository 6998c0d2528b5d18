"""pc2pix as a method of the benchmark: a cloud is encoded once, and all views are one batch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from data_prep.clouds.sampling import even_rows, random_rows
from data_prep.failures import StageFailure
from data_prep.scene import CLOUD_SIZE, IMAGE_SIZE, Images, PointCloud, View
from learning.exact import exact_inference
from pc2pix.augment import PLAIN_POINTS
from pc2pix.engine import FoldedGenerator, Precision
from pc2pix.model import NOISE_DIM
from pc2pix.weights import Weights

PARTS = 8  # selections of points of a large cloud, whose codes are averaged
# Largest absolute number of a whitened code, in standard deviations of the training clouds' codes.
# Codes of validation clouds stay within 4, those of very noisy ones (a standard deviation of 0.5)
# within 14, those of real objects of other classes within 12. A single outlier at a distance of
# 1,000 gives 64 or 940, depending on the weights.
_LARGEST_CODE = 50.0
NoisePolicy = Literal["zero", "uniform"]


class Pc2pixRenderer:
    """A `data_prep.scene.Renderer` that encodes a cloud and lets the generator draw it.

    The number of threads and the other views of a call change an image by no more than rounding
    errors of the precision (some 1e-6 in float32). The networks were trained with elevations of
    -40..40 degrees; others are passed on to the generator, which extrapolates.

    Parameters
    ----------
    weights : Weights
        Trained networks of `pc2pix.weights.load_weights`; moved to `device`.
    z : {"zero", "uniform"}
        The generator's noise. "zero" is the centre of its distribution: a cloud and a view have one
        image, and scores do not depend on random numbers. "uniform" draws a new z from U(-1, 1)
        for each view, with the `rng` given to `draw`, as the original does in evaluation.
    device : str
        PyTorch's name of the device.
    precision : {"float32", "bfloat16"}
        Precision of the generator (`pc2pix.engine.FoldedGenerator`); the encoder always computes in
        float32. "bfloat16" is twice as fast where the processor has it.

    Raises
    ------
    ValueError
        For another precision.
    """

    def __init__(
        self,
        weights: Weights,
        *,
        z: NoisePolicy = "zero",
        device: str = "cpu",
        precision: Precision = "float32",
    ) -> None:
        self.weights = weights
        self.z: NoisePolicy = z
        self.device = torch.device(device)
        self.encoder = weights.encoder.to(self.device)
        self.generator = FoldedGenerator(weights.generator.to(self.device), precision)
        self.code_mean = weights.code_mean.to(self.device)
        self.code_std = weights.code_std.to(self.device)

    @exact_inference()
    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Tensor:
        """Return the whitened code of a cloud, (code - mean) / std over the training set.

        The paper's encoder takes 2,048 points, which `pick_points` selects or repeats. PointNet
        takes any number; of a cloud with more than it was trained with, codes of several selections
        are averaged (`parts`).

        cloud  points [N, 3] in unit-sphere coordinates
        rng    not used

        The result is [1, latent_dim].

        Raises StageFailure at the stage "encode", for an empty or non-finite cloud, for a code that
        is not finite, and for a number in it beyond _LARGEST_CODE. For such a code the generator
        draws a meaningless pattern that does not depend on the cloud.
        """
        if not len(cloud):
            raise StageFailure("encode", "the cloud is empty")
        if not np.isfinite(cloud.points).all():
            raise StageFailure("encode", "the cloud has non-finite points")
        fed = pick_points(cloud.points)[None] if self.encoder.cloud_size else parts(cloud.points)
        points = torch.tensor(fed, dtype=torch.float32, device=self.device)
        # The parts are encoded one by one: together they would not fit into a processor's cache,
        # and most of the time would be spent on getting memory from the operating system.
        codes = torch.cat([self.encoder(part[None]) for part in points])
        code = (codes.mean(dim=0, keepdim=True) - self.code_mean) / self.code_std
        if not code.isfinite().all():
            raise StageFailure("encode", "the code is not finite")
        largest = float(code.abs().max())
        if largest > _LARGEST_CODE:
            raise StageFailure(
                "encode",
                f"the code lies {largest:.3g} standard deviations off ({_LARGEST_CODE:g} at most); "
                "scale the cloud to the unit sphere, and remove outliers",
            )
        return code

    @exact_inference()
    def draw(
        self, state: Tensor, views: Sequence[View], rng: np.random.Generator | None = None
    ) -> Images:
        """Return images of a cloud, float32 [V, 128, 128, 3] in [0, 1].

        state  [1, latent_dim], the code of `prepare`
        views  V cameras; none give an empty array
        rng    draws the noise where z is "uniform"; not used for "zero"

        Raises ValueError where z is "uniform" and `rng` is missing. Raises StageFailure at the
        stage "generate", where the network gives NaN or infinity.
        """
        if not views:
            return np.empty((0, IMAGE_SIZE, IMAGE_SIZE, 3), dtype=np.float32)
        angles = _normalised_angles(views)
        elevation01, azimuth01 = torch.tensor(angles, device=self.device).split(1, dim=1)
        noise = self._noise(len(views), rng)
        images = self.generator(state, elevation01, azimuth01, noise)
        if not images.isfinite().all():
            raise StageFailure("generate", "the network gives an image that is not finite")
        return images.cpu().numpy()

    def _noise(self, count: int, rng: np.random.Generator | None) -> Tensor | None:
        """Return the noise of `count` images, [count, NOISE_DIM], or None for zeros."""
        if self.z == "zero":
            return None
        if rng is None:
            raise ValueError('draw: z="uniform" needs an rng; give a numpy.random.Generator')
        noise = rng.uniform(-1, 1, (count, NOISE_DIM)).astype(np.float32)
        return torch.from_numpy(noise).to(self.device)


def pick_points(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return 2,048 points of a cloud, [2048, 3], in the cloud's order.

    points  [N, 3], N > 0. Of more than 2,048 a random subset is taken. Fewer are repeated evenly,
            each point several times in a row, as in the original: row i is floor(i N / 2048)
    """
    if len(points) > CLOUD_SIZE:
        return points[random_rows(len(points), CLOUD_SIZE)]
    return points[even_rows(len(points), CLOUD_SIZE)]


def parts(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the selections of a cloud's points that PointNet encodes.

    points  [N, 3]. For N up to PLAIN_POINTS the result is the cloud, [1, N, 3]. Otherwise it has
            PARTS random selections, [PARTS, PLAIN_POINTS, 3]

    PointNet takes the maximum of features over the points. This grows with their number, most of
    all under noise, and in training there were no more than PLAIN_POINTS. With several selections
    nearly all points are used nonetheless; it raises SSIM on validation chairs by 0.004 under the
    stronger noise, and by 0.001 without noise. The points are sorted, and the random numbers depend
    on their number only, so that the order of the points does not change the code.
    """
    if len(points) <= PLAIN_POINTS:
        return points[None]
    ordered = points[np.lexsort(points.T)]
    random = np.random.default_rng(len(points))
    selections = []
    for _ in range(PARTS):
        chosen = random.permutation(len(points))[:PLAIN_POINTS]
        selections.append(ordered[chosen])
    return np.stack(selections)


def _normalised_angles(views: Sequence[View]) -> list[tuple[float, float]]:
    """Return elevation and azimuth of each view, normalised as the generator takes them.

    Azimuths are brought into -180..180 degrees first; -180 and 180 themselves stay as they are.
    """
    normalised = []
    for view in views:
        azimuth_deg = math.remainder(view.azimuth_deg, 360.0)
        normalised.append((view.elevation_deg / 80 + 0.5, azimuth_deg / 360 + 0.5))
    return normalised
