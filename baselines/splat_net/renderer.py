"""splat-net as a method of the benchmark: surfels once per cloud, all views in groups."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.splat_net.engine import GROUP, FoldedSplatNet, Precision
from baselines.splat_net.network import SMALLEST
from baselines.splat_net.points2pix import Points2Pix, Points2PixEngine
from baselines.splat_net.projection import Projection, cameras
from baselines.splat_net.surfels import Surfels, find_surfels, stack
from data_prep.failures import StageFailure
from data_prep.scene import IMAGE_SIZE, Images, PointCloud, View
from learning.exact import exact_inference
from learning.weights import NetworkWeights

VIEWS_TOGETHER = 20
_POINTS_TOGETHER = 2**19  # of all these views: a bound on memory for large clouds
Projector = Callable[[Sequence[View]], Projection]


class SplatNetRenderer:
    """A `data_prep.scene.Renderer` by projection and network.

    The order of the points does not matter: the same image, bit for bit. Results do not depend on
    the other views of a call, or the number of threads, beyond the rounding of the precision.

    Parameters
    ----------
    weights : NetworkWeights
        Trained network of `baselines.splat_net.weights.load_weights`; moved to `device`.
    device : str
        PyTorch's name of the device.
    precision : {"float32", "bfloat16"}
        Precision of the network; points and their projection are float32 always. "bfloat16" is
        twice as fast where the processor has it.
    size : int
        Side of the images in pixels, a multiple of 16. The network was trained for 128.

    Raises
    ------
    ValueError
        For another precision or size.
    """

    def __init__(
        self,
        weights: NetworkWeights,
        *,
        device: str = "cpu",
        precision: Precision = "float32",
        size: int = IMAGE_SIZE,
    ) -> None:
        if size < SMALLEST or size % SMALLEST:
            raise ValueError(f"size {size}: expected a multiple of {SMALLEST}")
        self.weights = weights
        self.device = torch.device(device)
        self.network = weights.network.to(self.device)
        self.inputs = self.network.config.inputs
        self.size = size
        self.precision: Precision = precision
        self._at_sizes: dict[int, SplatNetRenderer] = {size: self}
        self.engine: FoldedSplatNet | Points2PixEngine
        if isinstance(self.network, Points2Pix):
            if size != IMAGE_SIZE or precision != "float32":
                raise ValueError(f"points2pix draws {IMAGE_SIZE} pixels in float32")
            self.engine = Points2PixEngine(self.network)
        else:
            self.engine = FoldedSplatNet(self.network, precision, size)

    @exact_inference()
    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Surfels:
        """Return all points with neighbours and normals.

        A single point, or points that all coincide, are drawn like any others.

        Parameters
        ----------
        cloud : PointCloud
            Points [N, 3] in unit-sphere coordinates.
        rng : numpy.random.Generator, optional
            Not used.

        Returns
        -------
        Surfels
            Surfels of one cloud, with a leading dimension of 1.

        Raises
        ------
        StageFailure
            At the stage "input", for an empty or non-finite cloud.
        """
        del rng
        if not len(cloud):
            raise StageFailure("input", "no points")
        bad = int((~np.isfinite(cloud.points)).any(axis=1).sum())
        if bad:
            raise StageFailure("input", f"{bad} of {len(cloud)} points are not finite")
        workers = torch.get_num_threads()
        surfels = stack([find_surfels(cloud.points, workers, surfaces=self.inputs.surfaces)])
        return Surfels(*(value.to(self.device) for value in vars(surfels).values()))

    def draw(
        self, state: Surfels, views: Sequence[View], rng: np.random.Generator | None = None
    ) -> Images:
        """Return images of a cloud.

        Parameters
        ----------
        state : Surfels
            Surfels of `prepare`.
        views : sequence of View
            V cameras; none give an empty array.
        rng : numpy.random.Generator, optional
            Not used.

        Returns
        -------
        float32 array, [V, size, size, 3]
            Images in [0, 1].

        Raises
        ------
        StageFailure
            At the stage "draw", where the network gives NaN or infinity.
        """
        del rng
        return self.draw_projected(self._projector(state), views, views_at_once(len(state)))

    def coverage(
        self, state: Surfels, views: Sequence[View], size: int | None = None
    ) -> NDArray[np.float32]:
        """Return the share of each pixel that the network takes for covered, [V, size, size]."""
        splats = self.at_size(size or self.size)
        most = views_at_once(len(state))
        return splats.projected_coverage(splats._projector(state), views, most)

    def _projector(self, state: Surfels) -> Projector:
        return lambda some: Projection(state, cameras(some).to(self.device), self.inputs, self.size)

    def at_size(self, size: int) -> SplatNetRenderer:
        """Return the renderer of images of a size by the same network."""
        if size not in self._at_sizes:
            self._at_sizes[size] = SplatNetRenderer(
                self.weights, device=str(self.device), precision=self.precision, size=size
            )
        return self._at_sizes[size]

    def draw_projected(self, project: Projector, views: Sequence[View], most: int) -> Images:
        """Return images of what `project` gives for at most `most` of the views at a time."""
        images = np.empty((len(views), self.size, self.size, 3), np.float32)
        return self._filled(images, self.engine, project, views, most)

    def projected_coverage(
        self, project: Projector, views: Sequence[View], most: int
    ) -> NDArray[np.float32]:
        """Return the coverage [V, size, size] of the images of `draw_projected`."""
        shares = np.empty((len(views), self.size, self.size, 1), np.float32)
        return self._filled(shares, self.engine.coverage, project, views, most)[..., 0]

    @exact_inference()
    def _filled(
        self,
        images: NDArray[np.float32],
        engine: Callable[[Tensor, Tensor], Tensor],
        project: Projector,
        views: Sequence[View],
        most: int,
    ) -> NDArray[np.float32]:
        """Fill images [V, size, size, C] with what an engine gives, and return them."""
        for start in range(0, len(views), most):
            seen = project(views[start : start + most])
            some, count = images[start : start + most], len(seen.points)
            groups = -(-count // GROUP)
            for k in range(groups):
                group = slice(k * count // groups, (k + 1) * count // groups)
                channels = seen.channels(group, self.engine.dtype)
                drawn = engine(channels, seen.points[group])
                if not drawn.sum().isfinite():  # of values in 0..1
                    raise StageFailure("draw", "the image is not finite")
                some[group] = drawn.cpu().numpy()
        return images


def views_at_once(points: int) -> int:
    """Return how many views of a cloud of so many points are projected together."""
    return max(1, min(VIEWS_TOGETHER, _POINTS_TOGETHER // points))
