"""pc2pix as a method of the benchmark: encode once per cloud, draw all views in one batch."""

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

PARTS = 8
# Standard deviations of the training clouds. Validation clouds stay within 4, noisy ones (sigma
# 0.5) within 14, real objects of other classes within 12; one outlier at 1,000 gives 64 or 940.
_LARGEST_CODE = 50.0
NoisePolicy = Literal["zero", "uniform"]


class Pc2pixRenderer:
    """A `data_prep.scene.Renderer` by encoder and generator.

    Results do not depend on the number of threads, or on the other views of a call, beyond the
    rounding of the precision (float32: some 1e-6). Angles outside the trained -40..40 degrees of
    elevation are passed on as they are: the network extrapolates.

    Parameters
    ----------
    weights : Weights
        Trained networks of `pc2pix.weights.load_weights`; moved to `device`.
    z : {"zero", "uniform"}
        The generator's noise. "zero": the centre of the noise distribution, one image per cloud and
        view whatever the seed, so that a score carries no sampling noise. "uniform": z ~ U(-1, 1)
        from the `rng` given to `draw`, a fresh one per view, as in the original's evaluation.
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
        """Return the whitened code of a cloud.

        For the paper's encoder, any number of points is brought to 2,048 by `pick_points`. PointNet
        takes all there are; of more than it was trained with, the mean code of several parts of the
        cloud is taken (`parts`).

        cloud  points [N, 3] in unit-sphere coordinates
        rng    not used

        Tensor [1, latent_dim]: (code - mean) / std over the training set.

        Raises StageFailure at the stage "encode", for an empty or non-finite cloud, for a code that
        is not finite, and for one beyond _LARGEST_CODE, from which the generator draws a saturated
        pattern whatever the cloud.
        """
        if not len(cloud):
            raise StageFailure("encode", "the cloud is empty")
        if not np.isfinite(cloud.points).all():
            raise StageFailure("encode", "the cloud has non-finite points")
        fed = pick_points(cloud.points)[None] if self.encoder.cloud_size else parts(cloud.points)
        points = torch.tensor(fed, dtype=torch.float32, device=self.device)
        # One part after the other: together they would not fit the cache, and most of the time
        # would go into pages fresh from the operating system.
        codes = torch.cat([self.encoder(part[None]) for part in points])
        code = (codes.mean(dim=0, keepdim=True) - self.code_mean) / self.code_std
        if not code.isfinite().all():
            raise StageFailure("encode", "the code is not finite")
        largest = float(code.abs().max())
        if largest > _LARGEST_CODE:
            raise StageFailure(
                "encode",
                f"the code lies {largest:.3g} standard deviations off ({_LARGEST_CODE:g} at most); "
                "is the cloud in the unit sphere, without outliers?",
            )
        return code

    @exact_inference()
    def draw(
        self, state: Tensor, views: Sequence[View], rng: np.random.Generator | None = None
    ) -> Images:
        """Return images of a cloud, drawn in one batch of exactly these views.

        state  Tensor [1, latent_dim]; code of `prepare`
        views  v cameras; none give an empty array
        rng    source of z = "uniform"; not used for "zero"

        float32 array [V, 128, 128, 3]: images in [0, 1].

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
            raise StageFailure("generate", "the image is not finite")
        return images.cpu().numpy()

    def _noise(self, count: int, rng: np.random.Generator | None) -> Tensor | None:
        if self.z == "zero":
            return None
        if rng is None:
            raise ValueError('draw: z="uniform" needs an rng')
        noise = rng.uniform(-1, 1, (count, NOISE_DIM)).astype(np.float32)
        return torch.from_numpy(noise).to(self.device)


def pick_points(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return exactly 2,048 rows [2048, 3] of a cloud [N, 3], N > 0, in the cloud's order.

    Of more points these are a random subset. Of fewer, output row i is input row floor(i N / 2048):
    where N divides 2,048 every row is repeated the same number of times consecutively, as the
    original does; other numbers come as close to that as they can.
    """
    if len(points) > CLOUD_SIZE:
        return points[random_rows(len(points), CLOUD_SIZE)]
    return points[even_rows(len(points), CLOUD_SIZE)]


def parts(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return PARTS random selections of PLAIN_POINTS of a larger cloud [N, 3]; else the cloud.

    Shape [PARTS, PLAIN_POINTS, 3], or [1, N, 3] for N <= PLAIN_POINTS. The maximum over the points
    grows with their number, under noise above all, and the encoder has seen no more than
    PLAIN_POINTS; several selections use all points nonetheless (SSIM on validation chairs: +0.004
    under the heavier noise, +0.001 without noise). The points are sorted first, and the selections
    depend on their number only: the code does not depend on order.
    """
    if len(points) <= PLAIN_POINTS:
        return points[None]
    ordered = points[np.lexsort(points.T)]
    random = np.random.default_rng(len(points))
    return np.stack([ordered[random.permutation(len(points))[:PLAIN_POINTS]] for _ in range(PARTS)])


def _normalised_angles(views: Sequence[View]) -> list[tuple[float, float]]:
    """Return elevation and azimuth of each view as the generator takes them.

    An azimuth is brought into -180..180 degrees first; both ends stay as they are.
    """
    return [
        (view.elevation_deg / 80 + 0.5, math.remainder(view.azimuth_deg, 360.0) / 360 + 0.5)
        for view in views
    ]
