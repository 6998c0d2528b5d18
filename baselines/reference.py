"""The reference methods: what a perfect method scores, and two that do not look at the cloud.

`TrueMesh` renders the mesh that the cloud was sampled from, `Blank` draws white images. `Constant`
draws one and the same image for every cloud, the one with the highest mean SSIM on the training
set; a method that scores lower has not shown that it looked at the cloud. It is `constant.png`,
fitted to procedural training chairs (docs/maintaining.md, "Weights").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_prep.datasets.objects import grey
from data_prep.failures import StageFailure
from data_prep.rendering.images import blank, to_float
from data_prep.rendering.mesh import mesh_coverage
from data_prep.rendering.opengl import render
from data_prep.scene import IMAGE_SIZE, Images, Mesh, PointCloud, View

CONSTANT_IMAGE = Path(__file__).with_name("constant.png")


@dataclass(frozen=True)
class TrueMesh:
    """A method that renders the mesh that the cloud was sampled from.

    coloured  whether the mesh keeps its colours. Then the images equal the ground truth, bit for
              bit; in neutral grey they are the best that a method without colours can draw
    """

    coloured: bool = True

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Mesh:
        """Return the mesh that the cloud was sampled from, in its colours or in neutral grey.

        Raises StageFailure("input", ...) for a cloud that was not sampled from a mesh.
        """
        del rng
        if cloud.source is None:
            raise StageFailure(
                "input", "the cloud was not sampled from a known mesh; draw objects of a dataset"
            )
        return cloud.source if self.coloured else grey(cloud.source)

    def draw(
        self,
        state: Mesh,
        views: Sequence[View],
        rng: np.random.Generator | None = None,
        size: int = IMAGE_SIZE,
    ) -> Images:
        """Return images of the mesh, float32 [V, size, size, 3] in 0..1."""
        del rng
        return to_float(render(state, views, size))

    def coverage(
        self, state: Mesh, views: Sequence[View], size: int = IMAGE_SIZE
    ) -> NDArray[np.float32]:
        """Return the share of each pixel that the mesh covers, 0..1, [V, size, size]."""
        return mesh_coverage(state, views, size, by=render)


@dataclass(frozen=True, eq=False)
class Constant:
    """A method that draws the same image for every cloud and view.

    image  uint8 [IMAGE_SIZE, IMAGE_SIZE, 3]
    """

    image: NDArray[np.uint8]

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> None:
        """Do nothing: the image does not depend on the cloud."""
        del cloud, rng

    def draw(
        self, state: None, views: Sequence[View], rng: np.random.Generator | None = None
    ) -> Images:
        """Return the image once for each view, float32 [V, IMAGE_SIZE, IMAGE_SIZE, 3]."""
        del state, rng
        return np.repeat(to_float(self.image)[None], len(views), axis=0)


class Blank(Constant):
    """A method that draws a white image for every cloud and view."""

    def __init__(self) -> None:
        super().__init__(blank(1)[0])
