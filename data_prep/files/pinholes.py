"""Pinhole cameras in JSON files, as Open3D and the converters of COLMAP write them.

Open3D writes `PinholeCameraParameters`, and a `PinholeCameraTrajectory` of several: "intrinsic" has
width, height and a matrix, "extrinsic" the pose from world to camera (+X right, +Y down, +Z ahead).
Matrices are lists column by column. The centres of its pixels are whole numbers (cpp/open3d/
visualization/visualizer/ViewControl.cpp: the middle of an image is at width / 2 - 0.5).

`transforms.json` is the format of NeRF, instant-ngp and nerfstudio: fl_x, fl_y, cx, cy, w and h, or
camera_angle_x in radians, for all "frames" or in each of them, whose "transform_matrix" is the pose
from camera to world (+X right, +Y up, +Z back). The middle of an image is at w / 2, as in COLMAP.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_prep.clouds.orientations import upright
from data_prep.failures import BadInput
from data_prep.files.safe_read import MIB, plain_name, read_text, shown

_MOST_BYTES = 16 * MIB  # the largest file: 10,000 frames of a transforms.json have 10 MiB
# The largest difference of focal lengths along columns and rows, as a share. Calibrations find some
# tenths of a percent for square pixels; discs are drawn round.
_SQUARE = 0.05
# The largest error of a pose that counts as a rotation, which files with four digits have.
_RIGID = 1e-3
_SKEW = 1e-6  # the largest skew that counts as none, as a share of the focal length
_DISTORTION = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
_MODELS = ("", "PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "SIMPLE_RADIAL", "RADIAL", "FULL_OPENCV")
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # between the axes of OpenCV and of OpenGL
_KINDS = "give one of Open3D (intrinsic and extrinsic, or parameters) or a transforms.json (frames)"


@dataclass(frozen=True, eq=False)
class Pinholes:
    """The cameras of a file.

    source      what messages name
    width       of the images in pixels
    height      of the images in pixels
    poses       float64 [V, 4, 4], from camera to world; the camera looks along its -Z, +Y is up
    focal_px    float64 [V, 2]: focal lengths along columns and rows
    centres_px  float64 [V, 2]: column and row of the axis, from the upper left corner of the image
    names       of the images
    """

    source: str
    width: int
    height: int
    poses: NDArray[np.float64]
    focal_px: NDArray[np.float64]
    centres_px: NDArray[np.float64]
    names: tuple[str, ...]

    def turned(self, up: str, front: str | None) -> Pinholes:
        """Return the cameras in our axes, as `data_prep.clouds.orientations.upright` does."""
        poses = self.poses.copy()
        columns = poses[:, :3].transpose(0, 2, 1).reshape(-1, 3)
        poses[:, :3] = upright(columns, up, front).reshape(-1, 4, 3).transpose(0, 2, 1)
        return replace(self, poses=poses)


class _Pinhole(NamedTuple):
    width: int
    height: int
    pose: NDArray[np.float64]
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    name: str


class _Problem(Exception):
    """A camera that cannot be used, and the remedy."""


def read_pinholes(path: Path, sides: range) -> Pinholes:
    """Return the cameras of a JSON file.

    sides  the widths and heights in pixels that can be drawn

    Raises BadInput, which names the file, where it holds no pinhole cameras of square pixels, with
    rotations as poses and images of one size.
    """
    try:
        contents = json.loads(read_text(path, _MOST_BYTES))
    except (ValueError, RecursionError) as error:
        if isinstance(error, BadInput):
            raise
        raise BadInput(f"{path}: not JSON; {_KINDS}") from error
    return pinholes_of(contents, str(path), sides)


def pinholes_of(contents: Any, source: str, sides: range) -> Pinholes:
    """Return the cameras that the contents of a file describe. Raises BadInput as `read_pinholes`.

    source  what messages name
    sides   the widths and heights in pixels that can be drawn
    """
    read_one, entries = _entries(contents, source)
    cameras = []
    for number, entry in enumerate(entries, 1):
        try:
            cameras.append(read_one(entry))
        except _Problem as problem:
            where = f"camera {number}: " if len(entries) > 1 else ""
            raise BadInput(f"{source}: {where}{problem}") from None
    first = cameras[0]
    if not (first.width in sides and first.height in sides):
        raise BadInput(
            f"{source}: {first.width} x {first.height} pixels; give {sides[0]} to {sides[-1]}, and "
            "scale focal lengths and centres with them"
        )
    for number, camera in enumerate(cameras, 1):
        if camera[:2] != first[:2]:
            raise BadInput(
                f"{source}: camera {number} has {camera.width} x {camera.height} pixels, the first "
                f"{first.width} x {first.height}; give a file for each size"
            )
    names = tuple(camera.name for camera in cameras)
    if len({*names}) < len(names) or "" in names:
        names = tuple(f"{number:0{len(str(len(names)))}d}" for number in range(1, len(names) + 1))
    return Pinholes(
        source,
        first.width,
        first.height,
        np.stack([camera.pose for camera in cameras]),
        np.array([camera.focal_px for camera in cameras]),
        np.array([camera.centre_px for camera in cameras]),
        names,
    )


def _entries(contents: Any, source: str) -> tuple[Callable[[Any], _Pinhole], list[Any]]:
    """Return the reader of a format, and what it reads for each camera."""
    if isinstance(contents, Mapping):
        if "frames" in contents and isinstance(contents["frames"], list) and contents["frames"]:
            frames = contents["frames"]
            if all(isinstance(frame, Mapping) for frame in frames):
                return _of_frame, [{**contents, **frame} for frame in frames]
        several = contents.get("parameters")
        if isinstance(several, list) and several:
            return _of_open3d, several
        if "intrinsic" in contents and "extrinsic" in contents:
            return _of_open3d, [contents]
    raise BadInput(f"{source}: no camera with a pose; {_KINDS}")


def _of_open3d(entry: Any) -> _Pinhole:
    if not isinstance(entry, Mapping) or not isinstance(entry.get("intrinsic"), Mapping):
        raise _Problem(f"no 'intrinsic'; {_KINDS}")
    intrinsic = entry["intrinsic"]
    width, height = _side(intrinsic, "width"), _side(intrinsic, "height")
    matrix = _matrix(intrinsic, "intrinsic_matrix", 3)
    focal, (column, row) = _focal(matrix[0, 0], matrix[1, 1]), matrix[:2, 2]
    rest = matrix - [[focal[0], 0, column], [0, focal[1], row], [0, 0, 1]]
    if np.abs(rest).max() > _SKEW * focal[0]:
        raise _Problem(
            "'intrinsic_matrix' is no pinhole's, or has a skew; give fx 0 0 0 fy 0 cx cy 1, column "
            "by column"
        )
    pose = (
        np.linalg.inv(_rigid(_matrix(entry, "extrinsic", 4), "extrinsic")).astype(np.float64)
        @ _FLIP
    )
    return _Pinhole(width, height, pose, focal, (column + 0.5, row + 0.5), "")


def _of_frame(frame: Mapping[str, Any]) -> _Pinhole:
    bent = [f"{key} is {frame[key]}" for key in _DISTORTION if _number(frame, key, 0.0) != 0]
    if frame.get("is_fisheye"):
        bent.append("is_fisheye")
    model = frame.get("camera_model", "")
    if model not in _MODELS:
        bent.append(shown(str(model)))
    if bent:
        raise _Problem(
            f"no pinhole, {bent[0]}; undistort its images ('colmap image_undistorter'), and "
            "convert them again"
        )
    width, height = _side(frame, "w"), _side(frame, "h")
    if "fl_x" in frame:
        across = _number(frame, "fl_x")
    else:
        angle = _number(frame, "camera_angle_x")
        if not 0 < angle < math.pi:
            raise _Problem(f"'camera_angle_x' is {angle:g}; give an angle in radians, below 3.14")
        across = width / 2 / math.tan(angle / 2)
    focal = _focal(across, _number(frame, "fl_y", across))
    centre = _number(frame, "cx", width / 2), _number(frame, "cy", height / 2)
    pose = _rigid(_matrix(frame, "transform_matrix", 4), "transform_matrix")
    return _Pinhole(width, height, pose, focal, centre, _name(frame.get("file_path")))


def _name(path: Any) -> str:
    """Return the name of an image without folder and suffix; "" where it is none."""
    try:
        return plain_name(PurePosixPath(path).stem) if isinstance(path, str) else ""
    except ValueError:
        return ""


def _side(entry: Mapping[str, Any], key: str) -> int:
    value = _number(entry, key)
    if value < 1 or value % 1:
        raise _Problem(f"'{key}' is {value:g}; give a whole number of pixels")
    return int(value)


def _number(entry: Mapping[str, Any], key: str, default: float | None = None) -> float:
    value = entry.get(key, default)
    if value is None:
        raise _Problem(f"no '{key}'; add it")
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        raise _Problem(f"'{key}' is {shown(str(value))}; give a number")
    if not math.isfinite(value):
        raise _Problem(f"'{key}' is {value}; give a finite number")
    return float(value)


def _focal(across: float, down: float) -> tuple[float, float]:
    if across <= 0 or not abs(down / across - 1) <= _SQUARE:
        raise _Problem(
            f"focal lengths of {across:g} and {down:g} pixels; give square pixels, whose two are "
            "positive and equal"
        )
    return across, down


def _matrix(entry: Mapping[str, Any], key: str, side: int) -> NDArray[np.float64]:
    """Return a matrix of rows, or of a list column by column, with finite entries."""
    if key not in entry:
        raise _Problem(f"no '{key}'; {_KINDS}")
    try:
        values = np.asarray(entry[key], dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        values = np.empty(0)
    if values.shape == (side * side,):
        values = values.reshape(side, side).T
    if values.shape != (side, side) or not np.isfinite(values).all():
        raise _Problem(f"'{key}' has to be {side} x {side} finite numbers; write it again")
    return values


def _rigid(matrix: NDArray[np.float64], key: str) -> NDArray[np.float64]:
    """Return a pose whose rotation is exact. Raises _Problem where it is none."""
    rotation = matrix[:3, :3]
    off = np.abs(rotation.T @ rotation - np.eye(3)).max()
    if not np.allclose(matrix[3], [0, 0, 0, 1], rtol=0, atol=_RIGID):
        row = " ".join(f"{value:g}" for value in matrix[3])
        raise _Problem(f"the last row of '{key}' is {row}, not 0 0 0 1; transpose it")
    if off > _RIGID or np.linalg.det(rotation) < 0:
        kind = "a mirror" if off <= _RIGID else f"off by {off:.2g}"
        raise _Problem(f"'{key}' is no rotation and move ({kind}); leave out scales and mirrors")
    left, _, right = np.linalg.svd(rotation)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = left @ right, matrix[:3, 3]
    return pose
