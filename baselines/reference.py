"""The ceiling and the floors: methods that show both ends of every metric's scale.

`Constant` is a second floor, higher than white: the one image with the highest mean SSIM. A method
that scores below it has not shown that it looked at the cloud. The image is `constant.png`, fitted
to procedural training chairs (docs/maintaining.md, "Weights").
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
from data_prep.rendering.opengl import render
from data_prep.scene import Images, Mesh, PointCloud, View

CONSTANT_IMAGE = Path(__file__).with_name("constant.png")


@dataclass(frozen=True)
class TrueMesh:
    """A method that renders the mesh of the cloud: the ground truth, bit for bit.

    coloured  whether the mesh has its own colours; in neutral grey it is the most that a method
              without colour can reach
    """

    coloured: bool = True

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Mesh:
        """Return the cloud's source mesh, in its colours or in grey.

        Raises StageFailure("input", ...) for a cloud without one.
        """
        del rng
        if cloud.source is None:
            raise StageFailure("input", "the cloud's mesh is not known")
        return cloud.source if self.coloured else grey(cloud.source)

    def draw(
        self, state: Mesh, views: Sequence[View], rng: np.random.Generator | None = None
    ) -> Images:
        """Render the mesh."""
        del rng
        return to_float(render(state, views))


@dataclass(frozen=True, eq=False)
class Constant:
    """A method that draws `image`, uint8 [IMAGE_SIZE, IMAGE_SIZE, 3], for any cloud."""

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
    """A method that draws white images for any cloud."""

    def __init__(self) -> None:
        super().__init__(blank(1)[0])
