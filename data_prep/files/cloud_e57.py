"""Clouds in E57, the exchange format of terrestrial scanners, by the library pye57.

`pye57.E57.read_scan` takes one byte for a colour and fails where a file has more, so that its
buffers are made here.
"""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_prep.files.cloud_contents import (
    NotACloud,
    ScanPoints,
    check_claim,
    colors_of,
    column_index,
)
from data_prep.scene import NEUTRAL_GREY

_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_CHANNELS = ("colorRed", "colorGreen", "colorBlue")


def read_e57(
    path: Path, most_points: int, with_colors: bool = False, column: str = ""
) -> ScanPoints:
    """Return the points of all scans, each placed by its pose, without those marked as invalid.

    A scan without colours, in a file where others have some, becomes grey.

    column  the name of a field whose numbers are returned, NaN in scans without it; "" for none

    Raises NotACloud for a file that claims more than `most_points`, or whose points have neither
    Cartesian nor spherical coordinates, ImportError where pye57 is not installed, and whatever the
    library raises for a damaged file.
    """
    import pye57

    with closing(pye57.E57(str(path))) as e57:
        headers = [e57.get_header(i) for i in range(e57.scan_count)]
        check_claim(sum(header.point_count for header in headers), most_points)
        have_colors = [set(_CHANNELS) <= set(header.point_fields) for header in headers]
        has_colors = any(have_colors)
        names = tuple(dict.fromkeys(name for h in headers for name in h.point_fields))
        field = names[column_index(names, column)] if column else ""
        width = 6 if with_colors and has_colors else 3
        scans = [_scan(e57, header, width, field) for header in headers if header.point_count]
    table = np.concatenate([np.empty((0, width + bool(field))), *scans])
    notes: tuple[str, ...] = ()
    if width > 3 and not all(have_colors):
        notes = (
            f"{have_colors.count(False)} of {len(headers)} scans have no colours, and are grey",
        )
    return ScanPoints(table, has_colors, len(table), notes=notes, columns=names)


def _scan(e57: Any, header: Any, width: int, field: str) -> NDArray[np.float64]:
    """Return the valid points of a scan, [N, 3], with colours as bytes [N, 6], or a field [N, 4].

    width  3, or 6 with colours
    field  the name of the field, or "" for none
    """
    from pye57.utils import convert_spherical_to_cartesian

    fields = set(header.point_fields)
    axes, invalid = _CARTESIAN, "cartesianInvalidState"
    if not set(axes) <= fields:
        axes, invalid = _SPHERICAL, "sphericalInvalidState"
    if not set(axes) <= fields:
        raise NotACloud("a scan without coordinates; export it with Cartesian ones")
    types: dict[str, type] = dict.fromkeys(axes, np.float64)
    if invalid in fields:
        types[invalid] = np.int8
    if width > 3 and set(_CHANNELS) <= fields:
        types |= dict.fromkeys(_CHANNELS, np.float32)  # which holds 16 bits, and fractions
    if field in fields:
        types.setdefault(field, np.float64)
    values = _read(e57, header, types)
    points = np.stack([values[axis] for axis in axes], axis=1)
    if axes == _SPHERICAL:
        points = convert_spherical_to_cartesian(points)
    if header.has_pose():
        points = e57.to_global(points, header.rotation, header.translation)
    valid = values[invalid] == 0 if invalid in values else np.ones(len(points), bool)
    if field:
        missing = np.full(len(points), np.nan)
        points = np.column_stack([points, values.get(field, missing).astype(np.float64)])
    if width == 3:
        return points[valid]
    colors = np.full((len(points), 3), NEUTRAL_GREY, np.float64)
    if _CHANNELS[0] in values:
        channels = np.stack([values[channel] for channel in _CHANNELS], axis=1)
        colors[valid] = _colors(channels[valid], header)
    return np.concatenate([points, colors], axis=1)[valid]


def _read(e57: Any, header: Any, types: dict[str, type]) -> dict[str, NDArray[Any]]:
    """Return the values of some fields of a scan, each as an array of its type."""
    import pye57

    library: Any = pye57.libe57
    count = header.point_count
    arrays, buffers = {}, library.VectorSourceDestBuffer()
    for name, kind in types.items():
        arrays[name] = np.empty(count, kind)
        # The last two: numbers may be converted to the type, and scaled.
        buffers.append(
            library.SourceDestBuffer(e57.image_file, name, arrays[name], count, True, True)
        )
    header.points.reader(buffers).read()
    return arrays


def _colors(channels: NDArray[np.float32], header: Any) -> NDArray[np.uint8]:
    """Return the colours [N, 3] of a scan as bytes, by the limits that it states.

    Limits that the values exceed are not believed; then the largest value tells their range.
    """
    limits = [_largest(header, channel) for channel in _CHANNELS]
    if all(limits) and (channels <= limits).all():
        return colors_of(channels * (255 / np.array(limits)), whole=True)
    return colors_of(channels, whole=bool((channels == np.floor(channels)).all()))


def _largest(header: Any, channel: str) -> float:
    """Return the largest value that a channel may have, 0 if the file does not state it."""
    import pye57

    library: Any = pye57.libe57
    if not header.node.isDefined(f"colorLimits/{channel}Maximum"):
        return 0.0
    limit = float(header.node["colorLimits"][f"{channel}Maximum"].value())
    stored = library.StructureNode(header.points.prototype())[channel]
    return min(limit, float(stored.maximum()))
