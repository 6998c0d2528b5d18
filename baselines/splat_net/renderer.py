"""splat-net as a method of the benchmark: surfels once per cloud, all views in groups."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from baselines.splat_net.engine import GROUP, FoldedSplatNet, Precision
from baselines.splat_net.network import SMALLEST
from baselines.splat_net.points2pix import Points2Pix, Points2PixEngine
from baselines.splat_net.projection import Projection, cameras
from baselines.splat_net.surfels import Surfels, find_surfels, stack
from baselines.splat_net.weights import SplatNetWeights
from baselines.splat_net.window import Box, in_groups
from data_prep.failures import StageFailure
from data_prep.scene import IMAGE_SIZE, Images, PointCloud, View
from data_prep.stages import NETWORK, stage
from learning.exact import exact_inference

BEYOND = 5  # pixels that a window has around its channels: the network draws 1 or 2 beyond them,
# more where points are few; an image that needs still more is drawn again, whole
WHITE = 1 - 0.5 / 255  # and above: no grey level is lost
VIEWS_TOGETHER = 20
POINTS_TOGETHER = 2**19  # of all these views: a bound on memory for large clouds


class SplatNetRenderer:
    """A `data_prep.scene.Renderer` by projection and network.

    The finest level of the network computes a window around the points only, beyond which the image
    is white. Where something is drawn at a window's edge, the whole image is computed: up to a grey
    level the result is that of whole images. Weights that draw a background cost twice as much.

    The order of the points does not matter: the same image, bit for bit. Results do not depend on
    the other views of a call, or the number of threads, beyond the rounding of the precision.

    Parameters
    ----------
    weights : SplatNetWeights
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
        weights: SplatNetWeights,
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

        def project(some: Sequence[View]) -> Projection:
            return Projection(state, cameras(some).to(self.device), self.inputs, self.size)

        return self.draw_projected(project, views, views_at_once(len(state)))

    @exact_inference()
    def draw_projected(
        self, project: Callable[[Sequence[View]], Projection], views: Sequence[View], most: int
    ) -> Images:
        """Return images of what `project` gives for at most `most` of the views at a time."""
        images = np.ones((len(views), self.size, self.size, 3), np.float32)
        for start in range(0, len(views), most):
            seen = project(views[start : start + most])
            some = images[start : start + most]
            boxes = dict(enumerate(self.boxes(seen)))
            self._draw(seen, boxes, some)
            everything = Box(0, self.size, 0, self.size)
            cut_off = [i for i, box in boxes.items() if _is_cut_off(some[i], box)]
            self._draw(seen, dict.fromkeys(cut_off, everything), some)
        return images

    def boxes(self, seen: Projection) -> list[Box]:
        """Return the part of each image to compute: all of it if a box's edge is drawn on."""
        if isinstance(self.engine, Points2PixEngine):  # which draws in what no point is near
            return [Box(0, self.size, 0, self.size)] * len(seen.points)
        return [box.grown(BEYOND, self.size) for box in seen.boxes()]

    def _draw(self, seen: Projection, boxes: Mapping[int, Box], images: Images) -> None:
        """Draw into `images` the box of each that `boxes` has by its number."""
        for windows in in_groups(boxes, self.size, GROUP):
            channels = seen.channels(windows, self.engine.dtype)
            with stage(NETWORK):
                drawn = self.engine(channels, windows, seen.points)
            if not drawn.sum().isfinite():  # of values in 0..1
                raise StageFailure("draw", "the image is not finite")
            parts = zip(windows.numbers, windows.corners, drawn.cpu().numpy(), strict=True)
            for number, (top, left), part in parts:
                box = boxes[number]
                box.of(images[number])[:] = box.moved(-top, -left).of(part)


def views_at_once(points: int) -> int:
    """Return how many views of a cloud of so many points are projected together."""
    return max(1, min(VIEWS_TOGETHER, POINTS_TOGETHER // points))


def _is_cut_off(image: NDArray[np.float32], box: Box) -> bool:
    """Return whether something is drawn at the box's edge where the image goes on beyond."""
    inside, size = box.of(image), len(image)
    edges = (
        (box.top > 0, inside[0]),
        (box.bottom < size, inside[-1]),
        (box.left > 0, inside[:, 0]),
        (box.right < size, inside[:, -1]),
    )
    return any(goes_on and edge.min() < WHITE for goes_on, edge in edges)
