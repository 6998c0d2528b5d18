"""The arrays that the trainings of pc2pix learn from, with checks of their shapes and values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput
from data_prep.scene import CLOUD_SIZE, IMAGE_SIZE


@dataclass(frozen=True, eq=False)
class AutoencoderData:
    """The clouds that autoencoder and decoder learn from.

    clouds  float32 [N, M, 3], M at least 2048, in unit-sphere coordinates

    Raises BadInput for other shapes, and for values that are not finite.
    """

    clouds: NDArray[np.float32]

    def __post_init__(self) -> None:
        check_clouds(self.clouds)
        if self.clouds.shape[1] < CLOUD_SIZE:
            raise BadInput(
                f"clouds: {self.clouds.shape[1]} points each, training needs {CLOUD_SIZE} or more; "
                "sample more points"
            )


def check_clouds(clouds: NDArray[np.float32]) -> None:
    """Raise BadInput unless `clouds` is float32 [N, M, 3], N > 0, and finite."""
    if clouds.ndim != 3 or clouds.shape[2] != 3 or clouds.dtype != np.float32 or not len(clouds):
        raise BadInput(
            f"clouds: expected float32 [N, M, 3] with N > 0, got {clouds.dtype} "
            f"{list(clouds.shape)}; stack the training clouds"
        )
    if not np.isfinite(clouds).all():
        bad = int((~np.isfinite(clouds).all(axis=(1, 2))).argmax())
        raise BadInput(f"clouds: cloud {bad} is not finite; remove it from the training set")


@dataclass(frozen=True, eq=False)
class GanData:
    """The images of N objects from V views each that the GAN learns from, and their clouds.

    images         uint8 [N, V, 128, 128, 3], on white
    azimuth_deg    float [N, V], -180..180
    elevation_deg  float [N, V], -40..40
    clouds         float32 [N, 2048, 3], in unit-sphere coordinates

    Raises BadInput where a shape is wrong or a value is outside of its range.
    """

    images: NDArray[np.uint8]
    azimuth_deg: NDArray[np.floating]
    elevation_deg: NDArray[np.floating]
    clouds: NDArray[np.float32]

    def __post_init__(self) -> None:
        check_clouds(self.clouds)
        shape = self.images.shape
        n, v = self.azimuth_deg.shape
        if self.images.dtype != np.uint8 or shape != (n, v, IMAGE_SIZE, IMAGE_SIZE, 3):
            raise BadInput(
                f"images: expected uint8 [{n}, {v}, {IMAGE_SIZE}, {IMAGE_SIZE}, 3] to go with the "
                f"angles, got {self.images.dtype} {list(shape)}; stack images by object and view"
            )
        if self.elevation_deg.shape != (n, v) or self.clouds.shape != (n, CLOUD_SIZE, 3):
            raise BadInput(
                f"elevation_deg {list(self.elevation_deg.shape)} or clouds "
                f"{list(self.clouds.shape)} do not go with {n} objects of {v} views; "
                f"expected [{n}, {v}] and [{n}, {CLOUD_SIZE}, 3]"
            )
        for name, angle, limit in (
            ("azimuth_deg", self.azimuth_deg, 180.0),
            ("elevation_deg", self.elevation_deg, 40.0),
        ):
            if not (np.abs(angle) <= limit).all():
                raise BadInput(
                    f"{name}: values {angle.min()}..{angle.max()} leave -{limit:g}..{limit:g}; "
                    "wrap or drop those views"
                )
