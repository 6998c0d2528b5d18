"""Point clouds from and to files.

Formats: PLY (x, y and z of the vertices), NPY, text in columns (XYZ, TXT, CSV, PTS), and the
formats of scanners (`files.scans`). Except for scanners, memory is taken for the values in the
file, never for the sizes that it claims.
"""

from __future__ import annotations

import io
import json
import math
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from data_prep.failures import BadInput, CannotWrite
from data_prep.files.atomic_write import write_whole
from data_prep.files.cloud_contents import (
    CloudContents,
    CloudPoints,
    NotACloud,
    axis_columns,
    color_columns,
    colors_of,
)
from data_prep.files.cloud_ply import read_ply
from data_prep.files.cloud_text import PTS_COLOURS, is_number, read_text
from data_prep.files.meshes import SUFFIXES as MESH_SUFFIXES
from data_prep.files.safe_read import MIB, files_below, open_file, read_file, shown
from data_prep.files.scans import SCAN_SUFFIXES, read_scan
from data_prep.scene import Points

MOST_BYTES = 256 * MIB  # 22 million points, which take 1.3 GiB of memory and some seconds

_PROSE = (".txt", ".csv", ".tsv")  # more often than the others something to read


def load_points(path: Path) -> CloudPoints:
    """Read the coordinates of the points in a file.

    PLY    ascii or binary, either byte order; other properties and elements are ignored
    NPY    an array of real numbers of shape [N, 3], or [N, 6], or a table with fields x, y and z
    text   x, y and z of a line before the numbers that names the columns, also in a comment, or the
           first three; separated by white space, commas, semicolons, tabs or bars; # begins a
           comment, // and % do at the start of a line; XYZ, TXT, CSV, TSV, ASC, XYZN and XYZRGB
    PTS    as text; lines of a single whole number, the counts of its parts, are ignored
    LAS, LAZ, E57, PCD  see `data_prep.files.scans`; large ones are thinned out

    Parameters
    ----------
    path : Path
        File whose suffix names its format.

    Returns
    -------
    float64 array [N, 3]
        Coordinates in the order and units of the file. N may be 0 and values may be NaN or
        infinite: the caller judges the cloud.

    Raises
    ------
    BadInput
        If the file cannot be read; names file, value and remedy.
    """
    return read_cloud(path).points


@np.errstate(over="ignore", invalid="ignore")  # odd NaNs, and values beyond float64
def read_cloud(path: Path, with_colors: bool = False) -> CloudContents:
    """Return the points of a file as `load_points` does, and a description of the rest.

    Colours are read where `with_colors` asks for them: the properties red, green and blue of a PLY;
    columns that a text names so, or the last three of six (of a PTS: of six or seven); the last
    three of an array [N, 6]. Raises BadInput for values that are no colours, too.
    """
    check_cloud_name(path)
    try:
        if path.suffix.lower() in SCAN_SUFFIXES:
            return read_scan(path, with_colors=with_colors)
        return _READERS[path.suffix.lower()](read_file(path, MOST_BYTES), with_colors)
    except NotACloud as problem:
        raise BadInput(f"{path}: {problem}") from problem.__cause__


def clouds_below(
    root: Path, suffixes: Sequence[str] | None = None
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Return the files of clouds below a folder, and the names of what is left out.

    Texts without coordinates (README.txt, labels.csv) are left out. Raises BadInput as
    `files_below`.
    """
    files, others = files_below(root, suffixes or CLOUD_SUFFIXES)
    clouds = tuple(path for path in files if path.suffix.lower() not in _PROSE or _has_rows(path))
    prose = (str(path.relative_to(root)) for path in files if path not in set(clouds))
    return clouds, tuple(sorted((*others, *prose)))


def _has_rows(path: Path) -> bool:
    """Return whether a text has, near its beginning, a line of three numbers, or nothing at all."""
    try:
        with open_file(path, MOST_BYTES) as file:
            start = file.read(MIB)
    except BadInput:  # its reader says why
        return True
    text = start.decode(json.detect_encoding(start[:4]), "replace")
    fields = (re.split(r'[\s;,"]+', line.strip('\t ;,"')) for line in text.splitlines())
    return not start or any(sum(map(is_number, row)) >= max(3, len(row) / 2) for row in fields)


def check_cloud_name(path: Path) -> None:
    """Raise BadInput for the name of a file in another format."""
    if path.suffix.lower() in CLOUD_SUFFIXES:
        return
    if path.suffix.lower() in MESH_SUFFIXES:
        raise BadInput(
            f"{path}: {path.suffix} is a mesh, not a point cloud; save points of its surface "
            '(docs/rendering.md, "Files"), and give that file'
        )
    name = path.suffix or "a name without a suffix"
    raise BadInput(
        f"{path}: {name} is not supported as a point cloud; use one of " + ", ".join(CLOUD_SUFFIXES)
    )


def save_ply(points: Points, path: Path) -> None:
    """Write points as binary PLY, bit for bit, whole or not at all.

    Parameters
    ----------
    points : float32 array [N, 3]
        Coordinates.
    path : Path
        File to write; missing folders are made.

    Raises
    ------
    ValueError
        If the points have another dtype or shape.
    CannotWrite
        If the disk refuses.
    """
    if points.dtype.kind + str(points.itemsize) != "f4" or points.shape[1:] != (3,):
        raise ValueError(f"expected float32 [N, 3], got {points.dtype} {list(points.shape)}")
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        "property float x\nproperty float y\nproperty float z\nend_header\n"
    )
    try:
        write_whole(path, header.encode() + points.astype("<f4").tobytes())
    except OSError as error:
        raise CannotWrite(
            f"{path}: cannot be written ({error.strerror}); make room, or give another path"
        ) from error


def _read_npy(data: bytes, with_colors: bool = False) -> CloudContents:
    """Return the rows of an array; nothing is unpickled, an array of objects is refused."""
    # Not by numpy.load, which takes memory for as many rows as the header claims; workers fill the
    # memory they take (`isolation.WORKER_ENVIRONMENT`), so that a claim would cost it all.
    file = io.BytesIO(data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of headers written by Python 2
            version = np.lib.format.read_magic(file)
            read_header = {
                (1, 0): np.lib.format.read_array_header_1_0,
                (2, 0): np.lib.format.read_array_header_2_0,
            }[version]  # 3.0 is for tables with fancy names
            shape, by_columns, dtype = read_header(file)
    except Exception as error:  # numpy lets through any error of its parsers
        raise NotACloud("not a readable NPY file; write it with numpy.save") from error
    given = dtype.names or ()
    names = [name.lower() for name in given]
    axes, kinds, fits = axis_columns(names), dtype.kind, shape[1:] in ((3,), (6,))
    fields = [given[i] for i in axes + color_columns(names)] if axes else []
    if axes:
        kinds, fits = "".join(dtype[field].kind for field in fields), len(shape) == 1
    if not set(kinds) <= set("fiu") or dtype.hasobject or not fits or shape[0] < 0:
        raise NotACloud(
            f"an array of {shown(str(dtype))} of shape {shown(str(shape))}; save real numbers of "
            "shape [N, 3], or [N, 6] with colours, or a table with x, y and z"
        )
    have, need = len(data) - file.tell(), math.prod(shape) * dtype.itemsize
    if have != need:
        raise NotACloud(
            f"the header claims {shape[0]} points, {need} bytes, and {have} follow; the file is "
            "damaged, fetch it again"
        )
    values = np.frombuffer(data, dtype, math.prod(shape), file.tell())
    rows = values.reshape(shape, order="F" if by_columns else "C")
    if axes:
        rows = np.stack([rows[field].astype(np.float64) for field in fields], axis=1)
    columns, has_colors = len(names) or shape[1], rows.shape[1] == 6
    unused = (f"{columns - 3} of its {columns} columns",) if columns > 3 else ()
    whole = set(kinds[-3:]) <= set("iu")
    colors = colors_of(rows[:, 3:], whole) if has_colors and with_colors else None
    return CloudContents(
        np.array(rows[:, :3], np.float64), unused, has_colors=has_colors, colors=colors
    )


_READERS: Mapping[str, Callable[[bytes, bool], CloudContents]] = {
    ".ply": read_ply,
    ".npy": _read_npy,
    **dict.fromkeys((".xyz", ".txt", ".csv", ".tsv", ".asc", ".xyzrgb"), read_text),
    ".xyzn": partial(read_text, unnamed={}),  # normals
    ".pts": partial(read_text, unnamed=PTS_COLOURS, parts=True),
}
CLOUD_SUFFIXES = (*_READERS, *SCAN_SUFFIXES)
