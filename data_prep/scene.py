"""The shared types of the project and the conventions of all its parts.

Conventions
-----------
Coordinates   Right-handed, +Y up, the front of an object towards -Z. A shape is centred (centre of
              its bounding box at the origin) and scaled so that its farthest vertex has radius 1:
              the *unit sphere*. Clouds and noise levels are in these units.
Camera        Looks at the origin from distance 4 with a field of view of 30.84 degrees (58 mm lens
              on a 32 mm sensor, roatienza/pc2pix@23b7b46d), so that the unit sphere just fits. The
              geometry is in `data_prep.rendering.camera`. Users may give other cameras (`Camera`).
Azimuth       0 degrees: the camera stands on -Z and sees the front. At +90 degrees the camera
              stands on +X (clockwise as seen from above).
Elevation     0 degrees: the camera stands in the XZ plane. It grows upwards: +90 is the zenith.
Images        128 x 128 x 3, row 0 on top, white background. float32 in [0, 1] in memory, uint8 on
              disk and in metrics. The data range is never guessed from the data.
Randomness    Always an argument (`numpy.random.Generator`), never global.

This module needs NumPy only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

IMAGE_SIZE = 128
CLOUD_SIZE = 2048
NEUTRAL_GREY = (180, 180, 180)  # of meshes without colours, and of reconstructions

Points = NDArray[np.float32]  # [N, 3]
Images = NDArray[np.float32]  # [V, IMAGE_SIZE, IMAGE_SIZE, 3], in [0, 1]
UInt8Images = NDArray[np.uint8]  # [..., IMAGE_SIZE, IMAGE_SIZE, 3]


def _read_only(values: ArrayLike, dtype: type, columns: int, name: str) -> NDArray[Any]:
    given = np.asarray(values)
    with np.errstate(invalid="ignore"):
        array = np.array(given, dtype=dtype, order="C")
    if np.issubdtype(dtype, np.integer) and not np.array_equal(array, given):
        limits = np.iinfo(dtype)  # a silent cast would wrap or cut
        raise ValueError(f"{name}: expected whole numbers in {limits.min}..{limits.max}")
    if array.ndim != 2 or array.shape[1] != columns:
        raise ValueError(f"{name}: expected shape [N, {columns}], got {list(array.shape)}")
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False)
class Mesh:
    """A shape with flat face colours.

    A mesh without faces is a legal value; functions that cannot use it say so.

    Attributes
    ----------
    vertices : float32 array [V, 3]
        Unit-sphere coordinates (`data_prep.clouds.normalise.normalise`).
    faces : int32 array [F, 3]
        Indices into `vertices`, anticlockwise seen from outside.
    face_colors : uint8 array [F, 3]
        sRGB colours, 0..255.

    Raises
    ------
    ValueError
        If an array has another shape or an index points outside `vertices`.
    """

    vertices: Points
    faces: NDArray[np.int32]
    face_colors: NDArray[np.uint8]

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", _read_only(self.vertices, np.float32, 3, "vertices"))
        object.__setattr__(self, "faces", _read_only(self.faces, np.int32, 3, "faces"))
        colors = _read_only(self.face_colors, np.uint8, 3, "face_colors")
        object.__setattr__(self, "face_colors", colors)
        if len(self.face_colors) != len(self.faces):
            raise ValueError(
                f"face_colors: {len(self.face_colors)} rows for {len(self.faces)} faces"
            )
        if self.faces.size and not 0 <= self.faces.min() <= self.faces.max() < len(self.vertices):
            raise ValueError(f"faces: an index lies outside 0..{len(self.vertices) - 1}")


def in_one_colour(mesh: Mesh, color: tuple[int, int, int]) -> Mesh:
    """Return the mesh with all faces in one colour, red, green and blue of 0..255."""
    colors = np.broadcast_to(np.array(color, np.uint8), mesh.face_colors.shape)
    return Mesh(mesh.vertices, mesh.faces, colors)


@dataclass(frozen=True)
class View:
    """A camera position, in degrees.

    Attributes
    ----------
    azimuth_deg : float
        Any finite angle in degrees (it is periodic); -180..180 in datasets.
    elevation_deg : float
        Angle in degrees, -90..90; -40..40 in datasets.

    Raises
    ------
    ValueError
        If an angle is no finite number or the elevation lies outside -90..90.
    """

    azimuth_deg: float
    elevation_deg: float

    def __post_init__(self) -> None:
        for name, angle in (
            ("azimuth_deg", self.azimuth_deg),
            ("elevation_deg", self.elevation_deg),
        ):
            if isinstance(angle, bool) or not isinstance(angle, Real):
                raise ValueError(f"{name} must be a number of degrees, got {angle!r:.40}")
        try:
            finite = math.isfinite(self.azimuth_deg)
        except OverflowError:  # a whole number beyond float64
            raise ValueError("azimuth_deg must be finite, got more than 308 digits") from None
        if not finite:
            raise ValueError(f"azimuth_deg must be finite, got {self.azimuth_deg}")
        if not -90.0 <= self.elevation_deg <= 90.0:
            raise ValueError(f"elevation_deg must lie in -90..90, got {self.elevation_deg}")


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera anywhere, in place of a `View`.

    Pixels are those of an image of IMAGE_SIZE, counted from its upper left corner; in an image of
    another size lengths grow with its side.

    Attributes
    ----------
    pose : float64 array [4, 4]
        From camera to unit-sphere coordinates, a rotation and a move. As in OpenGL, the camera
        looks along its -Z axis, and its +Y axis points up.
    focal_px : tuple of float
        Focal lengths along columns and rows; pixels are square, or nearly so.
    centre_px : tuple of float
        Column and row at which the axis of the camera meets the image.
    """

    pose: NDArray[np.float64]
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", _read_only(self.pose, np.float64, 4, "pose"))


AnyView = View | Camera


@dataclass(frozen=True)
class CloudOrigin:
    """The place of a cloud in a run: the object, the condition and all views drawn of it."""

    condition: str
    class_name: str
    object_id: str
    views: tuple[View, ...]


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points on (or near) a surface, in unit-sphere coordinates.

    Attributes
    ----------
    points : float32 array [N, 3]
        Coordinates. N may be 0 and values may be non-finite: each method judges its clouds.
    source : Mesh or None
        Mesh that the points were sampled from, where known. Only the reference method `true-mesh`
        may use it; the harness hides it from every other method.
    origin : CloudOrigin or None
        Place of the cloud in a run. Only methods that are entered by images may use it; the harness
        hides it from every other method.
    colors : uint8 array [N, 3] or None
        sRGB colours of the points, 0..255, where known: those of a user's file. Clouds of a suite
        have none but where its question is clouds with colours.

    Raises
    ------
    ValueError
        If `points` or `colors` have another shape, or colours are no bytes.
    """

    points: Points
    source: Mesh | None = None
    origin: CloudOrigin | None = None
    colors: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", _read_only(self.points, np.float32, 3, "points"))
        if self.colors is None:
            return
        object.__setattr__(self, "colors", _read_only(self.colors, np.uint8, 3, "colors"))
        if len(self.colors) != len(self.points):
            raise ValueError(f"colors: {len(self.colors)} rows for {len(self.points)} points")

    def __len__(self) -> int:
        return len(self.points)

    def take(self, rows: NDArray[np.integer] | slice) -> PointCloud:
        """Return the cloud of some rows, in their order, with their colours."""
        colors = None if self.colors is None else self.colors[rows]
        return replace(self, points=self.points[rows], colors=colors)


class Renderer(Protocol):
    """The interface of every method: two functions, timed apart.

    `prepare` runs once per cloud, `draw` once per set of views. Both get their randomness as an
    argument; a deterministic method ignores it. A method that cannot go on raises
    `data_prep.failures.StageFailure`, which names the stage.
    """

    def prepare(self, cloud: PointCloud, rng: np.random.Generator) -> Any:
        """Prepare a cloud.

        Parameters
        ----------
        cloud : PointCloud
            Cloud to render.
        rng : numpy.random.Generator
            Source of randomness.

        Returns
        -------
        object
            State of any type, for `draw`.

        Raises
        ------
        StageFailure
            If the method cannot use the cloud.
        """
        ...

    def draw(self, state: Any, views: Sequence[View], rng: np.random.Generator) -> Images:
        """Render a prepared cloud.

        Parameters
        ----------
        state : object
            Result of `prepare`.
        views : sequence of View
            V camera positions.
        rng : numpy.random.Generator
            Source of randomness.

        Returns
        -------
        float32 array [V, IMAGE_SIZE, IMAGE_SIZE, 3]
            Images in [0, 1] on a white background.

        Raises
        ------
        StageFailure
            If the method cannot render the cloud.
        """
        ...
