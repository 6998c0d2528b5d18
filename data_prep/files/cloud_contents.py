"""The contents of a cloud's file, as all of its readers return them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

COLOURS = "its colours"  # what notes call the colours of a file
# The names of columns that hold red, green and blue. CloudCompare calls fractions Rf, Gf and Bf.
CHANNELS = (
    ("red", "r", "diffuse_red", "rf"),
    ("green", "g", "diffuse_green", "gf"),
    ("blue", "b", "diffuse_blue", "bf"),
)
_POINT = "(?:p(?:oints?|os(?:ition)?)?|coord(?:inate)?s?)"
# A name with a letter for the axis, such as point_x or x_m.
_OF_AXIS = f"(?:field|utm)?{_POINT}?{{}}(?:coord(?:inate)?|[cmk]?m|ft|utm)?"
# The beginnings of names with which ParaView, R and MATLAB number columns.
_NUMBERED = f"(?:{_POINT}(?:mxyz)?|col(?:umn)?|var|[cfvx])"
# Patterns of the names of x, y and z. The first three that all fit some column are taken.
AXES = (
    ("x", "y", "z"),
    (
        f"{_OF_AXIS.format('x')}|ea?st(?:e|ing)?|rechtswert",
        f"{_OF_AXIS.format('y')}|nor(?:th(?:ing)?|te|d)|hochwert",
        f"{_OF_AXIS.format('z')}|elev(?:ation)?|height|alt(?:itude)?|h(?:oe)?he|cota|quota",  # Höhe
    ),
    (f"{_NUMBERED}0", f"{_NUMBERED}1", f"{_NUMBERED}2"),
    (f"{_NUMBERED}1", f"{_NUMBERED}2", f"{_NUMBERED}3"),
)
_ROUNDING = 1e-3  # how far beyond 0 to 1 a colour may be by the rounding of its writer
_MOST_OF_16_BITS = 65535.0  # the largest value of a colour with 16 bits a channel

CloudPoints = NDArray[np.float64]  # [N, 3]
PointColors = NDArray[np.uint8]  # [N, 3]


@dataclass(frozen=True, eq=False)
class CloudContents:
    """The points of a file and a description of its other contents.

    points       float64 array [N, 3]; coordinates in the order and units of the file
    unused       names of other contents of the file, for notes, such as "its colours"
    lines        the line of each point in a text file, counted from 1; None for other files
    has_colors   whether the file has columns that can be read as colours of its points
    colors       uint8 array [N, 3]: red, green and blue of each point; None where they were not
                 asked for, or where the file has none
    faces        int64 array [F, 3]: the points of each triangle; None for a file without any
    face_colors  uint8 array [F, 3]: the colours of the triangles; None as for `colors`
    notes        lines for the user on what the reader guessed or left out
    values       float64 array [N]: the numbers of each point in the column that was asked for; None
                 where none was
    columns      the names of all columns, where one was asked for
    textures     the names of the pictures that the file refers to
    texture_places  float64 array [F, 3, 2]: the places of the triangles' corners in the picture, to
                 the right and upwards from its lower left corner; None for a file without any
    texture_of_face  int64 array [F]: which of the pictures each triangle has, from 0; None for all
                 the first
    """

    points: CloudPoints
    unused: tuple[str, ...] = ()
    lines: Sequence[int] | None = None
    has_colors: bool = False
    colors: PointColors | None = None
    faces: NDArray[np.int64] | None = None
    face_colors: PointColors | None = None
    notes: tuple[str, ...] = ()
    values: NDArray[np.float64] | None = None
    columns: tuple[str, ...] = ()
    textures: tuple[str, ...] = ()
    texture_places: NDArray[np.float64] | None = None
    texture_of_face: NDArray[np.int64] | None = None

    @property
    def is_mesh(self) -> bool:
        """Return whether the triangles join at least half of the points."""
        faces = self.faces
        return (
            faces is not None and len(faces) > 0 and 2 * len(np.unique(faces)) >= len(self.points)
        )


class ScanPoints(NamedTuple):
    """The points of a scan.

    table       array [N, 3], or [N, 6] with colours, or [N, 4] with a column that was asked for
    has_colors  whether the file has colours
    in_file     the number of points in the file, of which N may be a part
    whole       whether colours are whole numbers in the file
    notes       lines for the user, as those of `CloudContents`
    columns     the names of the columns, where one was asked for
    """

    table: NDArray[np.float64]
    has_colors: bool
    in_file: int
    whole: bool = True
    notes: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()


def contents_of(
    table: NDArray[Any], has_colors: bool, whole: bool = False, **others: Any
) -> CloudContents:
    """Return the contents of a table [N, 3], [N, 6] with colours, or [N, 4] with a column."""
    width = table.shape[1]
    colors = colors_of(table[:, 3:], whole) if width == 6 else None
    values = np.asarray(table[:, 3], np.float64) if width == 4 else None
    points = np.asarray(table[:, :3], np.float64)
    return CloudContents(points, has_colors=has_colors, colors=colors, values=values, **others)


class NotACloud(Exception):
    """Raised for a file that holds no cloud, with the problem and its remedy.

    `read_cloud` adds the name of the file.
    """


class NoColumn(Exception):
    """Raised where no column has the name that was asked for, with the names that there are."""

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__("no such column")
        self.names = tuple(filter(None, names))


def column_index(names: Sequence[str], wanted: str) -> int:
    """Return which column has a name, where only letters and digits count, in any case.

    CloudCompare writes "scalar_" before the names of its columns, which may be left out. Raises
    NoColumn.
    """
    plain = [re.sub(r"[^a-z0-9]", "", name.lower()) for name in names]
    word = re.sub(r"[^a-z0-9]", "", wanted.lower())
    for name in (word, f"scalar{word}"):
        if word and name in plain:
            return plain.index(name)
    raise NoColumn(names)


def check_claim(count: int, most: int) -> None:
    """Raise NotACloud where a file claims more points than `most`, or a negative number."""
    if not 0 <= count <= most:
        raise NotACloud(f"{count} points, at most {most} are read; thin it out")


def axis_columns(names: Sequence[str]) -> tuple[int, ...]:
    """Return the columns of x, y and z by their names; () where one cannot be told for certain.

    Only letters and digits of the names are looked at. Where no columns are named x, y and z, names
    such as `easting` or `points0` are accepted.
    """
    names = [re.sub(r"[^a-z0-9]", "", name.lower()) for name in names]
    for patterns in AXES:
        columns = [[i for i, n in enumerate(names) if re.fullmatch(p, n)] for p in patterns]
        if all(len(column) == 1 for column in columns):
            return tuple(column for (column,) in columns)
    return ()


def color_columns(names: Sequence[str]) -> tuple[int, ...]:
    """Return the columns of red, green and blue by their names; () where one is missing."""
    columns = [
        next((i for i, name in enumerate(names) if name in channel), -1) for channel in CHANNELS
    ]
    return () if -1 in columns else tuple(columns)


def colors_of(values: NDArray[np.number], whole: bool = False) -> PointColors:
    """Return channels [N, 3] of any range as bytes.

    The largest value tells whether the range is 0 to 1, 0 to 255 or 0 to 65535.

    whole  whether the file holds whole numbers; then a largest value of 1 is taken for 1 of 255

    Raises NotACloud for values that are negative, too large or not finite.
    """
    if not np.isfinite(values).all() or values.min(initial=0) < -_ROUNDING:
        raise NotACloud("its colours have values below 0 or not finite; give 0 to 255, or 0 to 1")
    largest = float(values.max(initial=0))
    if not whole:
        values = np.maximum(values, 0)
        if 1 < largest <= 1 + _ROUNDING:
            values, largest = np.minimum(values, 1), 1.0
    if largest > _MOST_OF_16_BITS:
        raise NotACloud(f"its colours have the value {largest:g}; give 0 to 255, or 0 to 1")
    if largest > 255:
        values = values * (255 / _MOST_OF_16_BITS)
    elif largest <= 1 and not whole:
        values = values * 255.0
    return np.floor(values + 0.5).astype(np.uint8)
