"""The ceiling and the floor: ordinary methods that show both ends of every metric's scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_prep.datasets.grey import unpainted
from data_prep.failures import StageFailure
from data_prep.rendering.images import blank, to_float
from data_prep.rendering.opengl import render
from data_prep.scene import Images, Mesh, PointCloud, View


@dataclass(frozen=True)
class TrueMesh:
    """Renders the mesh that the cloud was sampled from: the ground truth, bit for bit.

    painted  whether in its colours, else in neutral grey: what drawing without colour can reach
    """

    painted: bool = True

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Mesh:
        """The cloud's source as it is drawn.

        Raises StageFailure("input", ...) for a cloud without one.
        """
        del rng
        if cloud.source is None:
            raise StageFailure("input", "the cloud's mesh is not known")
        return cloud.source if self.painted else unpainted(cloud.source)

    def draw(
        self, state: Mesh, views: Sequence[View], rng: np.random.Generator | None = None
    ) -> Images:
        """Render the mesh."""
        del rng
        return to_float(render(state, views))


@dataclass(frozen=True)
class Blank:
    """White images, whatever the cloud."""

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> None:
        """Nothing to prepare."""
        del cloud, rng

    def draw(
        self, state: None, views: Sequence[View], rng: np.random.Generator | None = None
    ) -> Images:
        """White images."""
        del state, rng
        return to_float(blank(len(views)))
