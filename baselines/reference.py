"""The ceiling and the floor: methods that show both ends of every metric's scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_prep.datasets.objects import grey
from data_prep.failures import StageFailure
from data_prep.rendering.images import blank, to_float
from data_prep.rendering.opengl import render
from data_prep.scene import Images, Mesh, PointCloud, View


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


@dataclass(frozen=True)
class Blank:
    """A method that draws white images for any cloud."""

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> None:
        """Do nothing: the image does not depend on the cloud."""
        del cloud, rng

    def draw(
        self, state: None, views: Sequence[View], rng: np.random.Generator | None = None
    ) -> Images:
        """Return a white image for each view."""
        del state, rng
        return to_float(blank(len(views)))
