"""Clouds in the formats of scanners, read by the libraries of the extra `clouds`.

    LAS, LAZ  laspy with lazrs, piece by piece
    E57       pye57; all scans, each placed by its pose, without points marked as invalid
    PCD       pypcd4; without points of three NaN, which an organised cloud has for no return

Scans of more than MOST_POINTS points are thinned to every k-th, with the smallest k that suffices.
The libraries are not written for untrusted files: they belong into a worker with limits, as in
`bench render`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput, MissingDependency
from data_prep.files.cloud_contents import COLOURS, CloudContents, colors_of
from data_prep.files.safe_read import MIB, open_file, reason_of

MOST_POINTS = 2**21  # kept; splats, the fastest, take seconds for as many
MOST_BYTES = 2048 * MIB  # of LAS and LAZ, which are read piece by piece
_MOST_BYTES_AT_ONCE = 512 * MIB  # of E57 and PCD
_MOST_CLAIMED = 2**26  # points that an E57 or PCD may claim: 1.5 GiB of coordinates
_PIECE = 2**20  # points
_RECORD_HEADER_BYTES = 54  # of a variable-length record in LAS

Table = NDArray[np.float64]  # [N, 3], or [N, 6] with colours


@dataclass(frozen=True)
class ScanLimits:
    """Limits of what is read of a scan: points kept, claimed by a file, and read at a time."""

    kept: int = MOST_POINTS
    claimed: int = _MOST_CLAIMED
    piece: int = _PIECE

    def stride(self, count: int) -> int:
        """Return the step at which so many points are thinned."""
        return max(1, math.ceil(count / self.kept))

    def check_claim(self, path: Path, count: int) -> None:
        """Raise BadInput where a file claims too many points, or fewer than none."""
        if not 0 <= count <= self.claimed:
            raise BadInput(f"{path}: {count} points, at most {self.claimed} are read; thin it out")


def read_scan(
    path: Path, limits: ScanLimits = ScanLimits(), with_colors: bool = False
) -> CloudContents:
    """Return the points in the file's order and units, and their colours if asked for.

    Raises BadInput, naming the file: missing, no regular file, too large, not readable; and
    MissingDependency, naming the extra, where the library is not installed.
    """
    most_bytes, read = _READERS[path.suffix.lower()]
    with open_file(path, most_bytes):
        pass
    try:
        table, has_colors = read(path, limits, with_colors)
    except ImportError as error:
        raise MissingDependency(
            f"{path}: reading {path.suffix.lower()} needs {error.name}; "
            "install it with: pip install 'pc2pix-bench[clouds]'"
        ) from error
    except BadInput:
        raise
    except Exception as error:  # the libraries let through any error of their parsers
        kind = path.suffix[1:].upper()
        raise BadInput(
            f"{path}: not a readable {kind} file ({reason_of(error)}); fetch it again"
        ) from error
    colors = colors_of(table[:, 3:], whole=True) if with_colors and has_colors else None
    unused = (COLOURS,) if has_colors else ()
    return CloudContents(table[:, :3], unused, has_colors=has_colors, colors=colors)


def _read_las(path: Path, limits: ScanLimits, with_colors: bool) -> tuple[Table, bool]:
    import laspy

    with open_file(path, MOST_BYTES) as file:
        _check_records(file)
        with laspy.LasReader(file, closefd=False, read_evlrs=False) as las:
            has_colors = "red" in las.header.point_format.dimension_names
            columns = [*"xyz", *(("red", "green", "blue") if with_colors and has_colors else ())]
            step, seen = limits.stride(las.header.point_count), 0
            kept = [np.empty((0, len(columns)))]
            for piece in las.chunk_iterator(limits.piece):
                points = np.stack([np.asarray(piece[name]) for name in columns], axis=1)
                kept.append(points[-seen % step :: step])
                seen += len(points)
        if seen != las.header.point_count:
            raise _cut_short(path, las.header.point_count, seen)
    return np.concatenate(kept), has_colors


def _check_records(file: BinaryIO) -> None:
    """Raise ValueError where a LAS claims more variable-length records than its bytes hold."""
    # laspy takes memory for as many as the header says, whatever the size of the file.
    head = file.read(104)
    count, size = int.from_bytes(head[100:], "little"), os.fstat(file.fileno()).st_size
    if count * _RECORD_HEADER_BYTES > size:
        raise ValueError(f"{count} records in {size} bytes")
    file.seek(0)


def _read_e57(path: Path, limits: ScanLimits, with_colors: bool) -> tuple[Table, bool]:
    import pye57

    axes = "cartesianX", "cartesianY", "cartesianZ"
    channels = "colorRed", "colorGreen", "colorBlue"
    file = pye57.E57(str(path))
    try:
        headers = [file.get_header(i) for i in range(file.scan_count)]
        limits.check_claim(path, sum(header.point_count for header in headers))
        has_colors = any(channels[0] in header.point_fields for header in headers)
        columns = (*axes, *(channels if with_colors and has_colors else ()))
        scans = [
            file.read_scan(i, colors=len(columns) > 3, ignore_missing_fields=True)
            for i in range(file.scan_count)
        ]
    finally:
        file.close()
    parts = [  # a scan without colours beside others is black
        np.stack([scan.get(name, np.zeros(len(scan[axes[0]]))) for name in columns], axis=1)
        for scan in scans
    ]
    points = np.concatenate([np.empty((0, len(columns))), *parts])
    return points[:: limits.stride(len(points))], has_colors


def _read_pcd(path: Path, limits: ScanLimits, with_colors: bool) -> tuple[Table, bool]:
    from pypcd4.pypcd4 import PointCloud

    claimed = 0
    with open_file(path, _MOST_BYTES_AT_ONCE) as file:
        for line in file:
            if line.startswith(b"POINTS"):
                claimed = int(line.split()[1])
                limits.check_claim(path, claimed)
            if line.startswith(b"DATA"):
                break
        file.seek(0)
        cloud = PointCloud.from_fileobj(file)
    if len(cloud.pc_data) != claimed:  # a binary file is read as far as it goes
        raise _cut_short(path, claimed, len(cloud.pc_data))
    points = cloud.numpy(("x", "y", "z")).astype(np.float64)
    packed = next((name for name in ("rgb", "rgba") if name in cloud.fields), None)
    if packed and with_colors:  # three bytes in the bits of a number of four
        bits = np.ascontiguousarray(cloud.pc_data[packed]).view(np.uint32).reshape(-1)
        channels = (bits[:, None] >> np.array([16, 8, 0], np.uint32)) & 255
        points = np.concatenate([points, channels.astype(np.float64)], axis=1)
    points = points[~np.isnan(points[:, :3]).all(axis=1)]
    return points[:: limits.stride(len(points))], packed is not None


def _cut_short(path: Path, claimed: int, count: int) -> BadInput:
    return BadInput(
        f"{path}: {claimed} points in the header, {count} in the file; it is cut short, fetch it "
        "again"
    )


_READERS: Mapping[str, tuple[int, Callable[[Path, ScanLimits, bool], Any]]] = {
    ".las": (MOST_BYTES, _read_las),
    ".laz": (MOST_BYTES, _read_las),
    ".e57": (_MOST_BYTES_AT_ONCE, _read_e57),
    ".pcd": (_MOST_BYTES_AT_ONCE, _read_pcd),
}
SCAN_SUFFIXES = tuple(_READERS)
