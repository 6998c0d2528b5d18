"""The relations of the study `studies.metamorphic`: changes that an image should not show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from data_prep.clouds.conditions import Perturbation, Unchanged
from data_prep.clouds.extremes import Duplicated, LastBit, Mirrored, Shuffled, Turned
from data_prep.scene import PointCloud, UInt8Images, View

YARDSTICK_DEG = 1.0


@dataclass(frozen=True)
class Relation:
    """A change of cloud and camera that should leave the image as it is, or mirror it.

    id          kebab-case
    change      makes the perturbation of the cloud from a random angle in degrees
    camera      makes the changed azimuth from the azimuth and that angle
    mirrored    whether the changed image is the mirror image
    """

    id: str
    change: Callable[[float], Perturbation]
    camera: Callable[[float, float], float] = lambda azimuth, angle: azimuth
    mirrored: bool = False

    def apply(
        self, cloud: PointCloud, view: View, rng: np.random.Generator
    ) -> tuple[PointCloud, View]:
        """Return the changed cloud and view."""
        angle = float(rng.uniform(-180.0, 180.0))
        azimuth = self.camera(view.azimuth_deg, angle)
        return self.change(angle).apply(cloud, rng), replace(view, azimuth_deg=azimuth)

    def restore(self, images: UInt8Images) -> UInt8Images:
        """Return changed images [V, H, W, 3] as they are to be compared with the original."""
        return images[:, :, ::-1] if self.mirrored else images


RELATIONS = (
    Relation("turned", Turned, lambda azimuth, angle: azimuth + angle),
    Relation("shuffled", lambda _: Shuffled()),
    Relation("points-twice", lambda _: Duplicated(2)),
    Relation("mirrored", lambda _: Mirrored(), lambda azimuth, _: -azimuth, mirrored=True),
    Relation("last-bit", lambda _: LastBit()),
    Relation("camera-1-degree", lambda _: Unchanged(), lambda a, _: a + YARDSTICK_DEG),
)
