"""splat-net as a method of the benchmark.

A cloud is prepared once, as surfels; views are projected, and drawn by the network, in groups.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.splat_net.engine import GROUP, FoldedSplatNet, Precision
from baselines.splat_net.network import SMALLEST
from baselines.splat_net.points2pix import Points2Pix, Points2PixEngine
from baselines.splat_net.projection import Projection, cameras, lenses
from baselines.splat_net.surfels import Surfels, find_surfels, stack
from data_prep.clouds.sampling import at_most
from data_prep.clouds.sorting import different_points
from data_prep.failures import StageFailure
from data_prep.scene import IMAGE_SIZE, AnyView, Images, PointCloud
from learning.exact import exact_inference
from learning.weights import NetworkWeights

VIEWS_TOGETHER = 20  # views of a cloud that are projected at a time, at most
_POINTS_TOGETHER = 2**19  # points in all of these views, at most: it bounds the memory
# Points that are shown to the network; of a larger cloud a random subset. With 8,192 of 131,072
# points LPIPS of four real meshes is .059, with all of them .077: it has seen 2,048 at most.
MOST_POINTS = 8192
Projector = Callable[[Sequence[AnyView]], Projection]  # what the network sees from some views


@dataclass(frozen=True, eq=False)
class ShownSurfels(Surfels):
    """The surfels of a cloud that the network is shown, with notes for the user."""

    notes: tuple[str, ...]


class SplatNetRenderer:
    """A `data_prep.scene.Renderer` that projects the points and lets the network draw.

    The order of the points does not change an image by a bit. The other views of a call and the
    number of threads change it by no more than rounding errors of the precision.

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
            raise ValueError(f"size {size}: give a multiple of {SMALLEST} pixels")
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
                raise ValueError(
                    f"size {size}, precision {precision}: points2pix draws only {IMAGE_SIZE} "
                    "pixels in float32; leave both out"
                )
            self.engine = Points2PixEngine(self.network)
        else:
            self.engine = FoldedSplatNet(self.network, precision)

    @exact_inference()
    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> ShownSurfels:
        """Return the points of a cloud as surfels, with the normals of their neighbourhoods.

        Single points, and points that all coincide, are allowed.

        Parameters
        ----------
        cloud : PointCloud
            Points [N, 3] in unit-sphere coordinates.
        rng : numpy.random.Generator, optional
            Not used.

        Returns
        -------
        ShownSurfels
            Surfels of one cloud, with a leading dimension of 1: of all its points, or of a random
            subset of MOST_POINTS of the different ones.

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
        points, notes = cloud.points, ()
        if len(points) > MOST_POINTS:
            points, notes = at_most(MOST_POINTS, different_points(points))
        surfels = stack([find_surfels(points, workers, surfaces=self.inputs.surfaces)])
        tensors = {name: value.to(self.device) for name, value in vars(surfels).items()}
        return ShownSurfels(**tensors, notes=notes)

    def draw(
        self, state: Surfels, views: Sequence[AnyView], rng: np.random.Generator | None = None
    ) -> Images:
        """Return images of a cloud.

        Parameters
        ----------
        state : Surfels
            Surfels of `prepare`.
        views : sequence of View or Camera
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
        self, state: Surfels, views: Sequence[AnyView], size: int | None = None
    ) -> NDArray[np.float32]:
        """Return the predicted coverage of each pixel, float32 [V, size, size] in 0..1.

        size  of the images in pixels; None for that of the renderer
        """
        splats = self.at_size(size or self.size)
        most = views_at_once(len(state))
        return splats.projected_coverage(splats._projector(state), views, most)

    def _projector(self, state: Surfels) -> Projector:
        """Return the function that projects surfels into some views."""

        def project(some: Sequence[AnyView]) -> Projection:
            at, lens = cameras(some).to(self.device), lenses(some).to(self.device)
            return Projection(state, at, self.inputs, self.size, lenses=lens)

        return project

    def at_size(self, size: int) -> SplatNetRenderer:
        """Return a renderer of the same network for images of another size, and keep it."""
        if size not in self._at_sizes:
            self._at_sizes[size] = SplatNetRenderer(
                self.weights, device=str(self.device), precision=self.precision, size=size
            )
        return self._at_sizes[size]

    def draw_projected(self, project: Projector, views: Sequence[AnyView], most: int) -> Images:
        """Return images of views, float32 [V, size, size, 3].

        project  is called with at most `most` of the views at a time
        """
        images = np.empty((len(views), self.size, self.size, 3), np.float32)
        return self._filled(images, self.engine, project, views, most)

    def projected_coverage(
        self, project: Projector, views: Sequence[AnyView], most: int
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
        views: Sequence[AnyView],
        most: int,
    ) -> NDArray[np.float32]:
        """Fill images [V, size, size, C] with what the engine draws, and return them.

        Raises StageFailure("draw", ...) where the engine gives NaN or infinity.
        """
        for start in range(0, len(views), most):
            seen = project(views[start : start + most])
            some, count = images[start : start + most], len(seen.points)
            groups = math.ceil(count / GROUP)
            for k in range(groups):  # of nearly the same size
                group = slice(k * count // groups, (k + 1) * count // groups)
                channels = seen.channels(group, self.engine.dtype)
                drawn = engine(channels, seen.points[group])
                if not drawn.sum().isfinite():  # a sum of values in 0..1 cannot overflow
                    raise StageFailure("draw", "the network gives an image that is not finite")
                some[group] = drawn.cpu().numpy()
        return images


def views_at_once(points: int) -> int:
    """Return how many views of a cloud with so many points are projected at a time."""
    return max(1, min(VIEWS_TOGETHER, _POINTS_TOGETHER // points))
