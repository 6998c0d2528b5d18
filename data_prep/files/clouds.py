"""Point clouds from and to files.

Formats: PLY (x, y and z of the vertices), NPY, text in columns (XYZ, TXT, CSV, PTS), and the
formats of scanners. Except for scanners, memory is taken for the values in the file, never for the
sizes that it claims.

Scans are read by the libraries of the extra `clouds`, but for PCD that is not compressed:

    LAS, LAZ  laspy with lazrs, piece by piece
    E57       pye57 (`cloud_e57.py`)
    PCD       python-neo-lzf, for the blocks of compressed ones (`cloud_pcd.py`)

Of scans of more than two million points as many are read, chosen at random, and a note says so.
The libraries are not written for untrusted files: they belong into a worker with limits, as in
`bench render`.
"""

from __future__ import annotations

import io
import json
import math
import os
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from data_prep.clouds.sampling import random_rows
from data_prep.failures import BadInput, MissingDependency
from data_prep.files.atomic_write import write_whole
from data_prep.files.cloud_contents import (
    COLOURS,
    CloudContents,
    CloudPoints,
    NoColumn,
    NotACloud,
    ScanPoints,
    axis_columns,
    check_claim,
    color_columns,
    column_index,
    contents_of,
)
from data_prep.files.cloud_e57 import read_e57
from data_prep.files.cloud_pcd import read_pcd
from data_prep.files.cloud_ply import read_ply
from data_prep.files.cloud_text import MINUS, PTS_COLOURS, is_number, read_text
from data_prep.files.file_kinds import START_BYTES, mismatch
from data_prep.files.meshes import SUFFIXES as MESH_SUFFIXES
from data_prep.files.safe_read import MIB, files_below, open_file, read_file, reason_of, shown
from data_prep.scene import Points

# The largest PLY, NPY or text: 22 million points, which take 1.3 GiB of memory and some seconds.
MOST_BYTES = 256 * MIB
_MOST_SCAN_BYTES = 2048 * MIB  # the largest LAS or LAZ, which are read piece by piece
_MOST_BYTES_AT_ONCE = 512 * MIB  # the largest E57 or PCD, which are read at once
_RECORD_HEADER_BYTES = 54  # the size of the header of a variable-length record in a LAS

# Suffixes of texts that may as well be a README or a list: only those with rows of numbers are
# taken for clouds where a folder is searched.
_PROSE = (".txt", ".csv", ".tsv")


def load_points(path: Path) -> CloudPoints:
    """Read the coordinates of the points in a file.

    PLY    ascii or binary, either byte order; other properties and elements are ignored
    NPY    an array of real numbers of shape [N, 3], or [N, 6], or a table with fields x, y and z
    text   x, y and z of a line before the numbers that names the columns, also in a comment, or the
           first three; separated by white space, commas, semicolons, tabs or bars; # begins a
           comment, // and % do at the start of a line; XYZ, TXT, CSV, TSV, ASC, XYZN and XYZRGB
    PTS    as text; lines of a single whole number, the counts of its parts, are ignored
    LAS, LAZ, E57, PCD  those of scanners; of large ones a random subset

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


@np.errstate(over="ignore", invalid="ignore")  # files may hold odd NaNs and very large values
def read_cloud(path: Path, with_colors: bool = False, column: str = "") -> CloudContents:
    """Return the points of a file as `load_points` does, and a description of the rest.

    Colours are read where `with_colors` asks for them: the properties red, green and blue of a PLY;
    columns that a text names so, or the last three of six (of a PTS: of six or seven); the last
    three of an array [N, 6]. Raises BadInput for values that are no colours, too.

    The numbers of a `column` are read in their place where it is named: a property of the vertices
    of a PLY, a named column of a text, a field of a table or of a scan. Raises NoColumn where no
    column has this name, with those that there are.
    """
    check_cloud_name(path)
    try:
        if path.suffix.lower() in _SCANS:
            return read_scan(path, with_colors=with_colors, column=column)
        data = read_file(path, MOST_BYTES)
        _check_kind(data[:START_BYTES], path)
        return _READERS[path.suffix.lower()](data, with_colors, column=column)
    except NotACloud as problem:
        raise BadInput(f"{path}: {problem}") from problem.__cause__


def clouds_below(
    root: Path, suffixes: Sequence[str] | None = None
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Return the files of clouds below a folder, and the names of all other files.

    Texts without coordinates (README.txt, labels.csv) are among the others. Raises BadInput as
    `files_below` does.
    """
    files, others = files_below(root, suffixes or CLOUD_SUFFIXES)
    clouds = tuple(path for path in files if path.suffix.lower() not in _PROSE or _has_rows(path))
    prose = (str(path.relative_to(root)) for path in files if path not in set(clouds))
    return clouds, tuple(sorted((*others, *prose)))


def _has_rows(path: Path) -> bool:
    """Return whether a text has a line of three numbers near its beginning, or is empty."""
    try:
        with open_file(path, MOST_BYTES) as file:
            start = file.read(MIB)
    except BadInput:  # counts as a cloud, whose reader then says what is wrong
        return True
    text = start.decode(json.detect_encoding(start[:4]), "replace").replace(MINUS, "-")
    fields = (re.split(r'[\s;,"]+', line.strip('\t ;,"')) for line in text.splitlines())
    if not start:
        return True
    for row in fields:
        numbers = sum(map(is_number, row))
        if numbers >= 3 and numbers >= len(row) / 2:
            return True
    return False


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


def _check_kind(start: bytes, path: Path) -> None:
    """Raise BadInput where the first bytes of a file are those of something else."""
    if problem := mismatch(start, path.suffix):
        raise BadInput(f"{path}: {problem}")


def save_ply(points: Points, path: Path) -> None:
    """Write points as binary PLY, whole or not at all.

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
    is_float32 = points.dtype.kind == "f" and points.itemsize == 4  # in either byte order
    if not is_float32 or points.shape[1:] != (3,):
        raise ValueError(f"expected float32 [N, 3], got {points.dtype} {list(points.shape)}")
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        "property float x\nproperty float y\nproperty float z\nend_header\n"
    )
    data = header.encode() + points.astype("<f4").tobytes()
    write_whole(path, data, remedy="make room, or give another path")


def _read_npy(data: bytes, with_colors: bool = False, column: str = "") -> CloudContents:
    """Return the rows of an array; nothing is unpickled, and an array of objects is refused."""
    # numpy.load is not used, as it allocates memory for as many rows as the header claims. Workers
    # fill memory that they allocate (`bench.running.pool.WORKER_ENVIRONMENT`), so that a false
    # claim would use up all memory.
    file = io.BytesIO(data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # NumPy warns of headers that Python 2 has written
            version = np.lib.format.read_magic(file)
            read_header = {
                (1, 0): np.lib.format.read_array_header_1_0,
                (2, 0): np.lib.format.read_array_header_2_0,
            }[version]  # version 3.0 is for tables with names that are not ASCII
            shape, by_columns, dtype = read_header(file)
    except Exception as error:  # the parser of NumPy may raise any exception
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
    if has_colors and not axes and (rows[:, 3:] < 0).any():
        has_colors, rows = False, rows[:, :3]  # normals, as no line names the columns
    unused = (f"{columns - 3} of its {columns} columns",) if columns > 3 else ()
    whole = set(kinds[-3:]) <= set("iu")
    table = np.array(rows if with_colors else rows[:, :3])  # a copy, which frees the file's bytes
    if column:
        field = given[column_index(given, column)]
        if dtype[field].kind not in "fiu":
            raise NotACloud(f"column {shown(field)} holds no real numbers; give another one")
        table = np.column_stack([table, values[field].astype(np.float64)])
    return contents_of(table, has_colors, whole, unused=unused, columns=given)


@dataclass(frozen=True)
class ScanLimits:
    """Limits of what is read of a scan, in points.

    kept               the most points that are kept, chosen at random; even the fastest method,
                       splat, takes seconds for so many
    claimed            the most points that the header of an E57 or PCD may claim: 1.5 GiB
    claimed_in_pieces  the most points that the header of a LAS may claim: 2 GiB at two bytes each
    piece              the points of a LAS that are read at a time
    """

    kept: int = 2**21
    claimed: int = 2**26
    claimed_in_pieces: int = 10**9
    piece: int = 2**20


def read_scan(
    path: Path, limits: ScanLimits = ScanLimits(), with_colors: bool = False, column: str = ""
) -> CloudContents:
    """Return the points of a scan in the file's order and units, with their colours if wanted.

    Of more than `limits.kept` points a random subset is returned, and a note says how many there
    are.

    Raises BadInput, which names the file, where it is missing, no regular file, too large or not
    readable, and MissingDependency, which names the extra, where the library is not installed.
    """
    most_bytes, read = _SCANS[path.suffix.lower()]
    try:
        with open_file(path, most_bytes) as file:
            _check_kind(file.read(START_BYTES), path)
            file.seek(0)
            scan = read(file, path, limits, with_colors, column)
    except ImportError as error:
        raise MissingDependency(
            f"{path}: reading {path.suffix.lower()} needs {error.name}; "
            "install it with: pip install 'pc2pix-bench[clouds]'"
        ) from error
    except NotACloud as problem:
        raise BadInput(f"{path}: {problem}") from problem.__cause__
    except (BadInput, NoColumn):
        raise
    except BaseException as error:  # the parsers of the libraries may raise any exception
        # A panic of lazrs, which is written in Rust, is no Exception, and has no other name.
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        kind = path.suffix[1:].upper()
        raise BadInput(
            f"{path}: not a readable {kind} file ({reason_of(error)}); fetch it again"
        ) from error
    notes = scan.notes
    if len(scan.table) < scan.in_file:
        read_of_them = f"{len(scan.table)} of them, chosen at random, are read"
        notes += (f"a scan of {scan.in_file} points: {read_of_them}",)
    unused = (COLOURS,) if scan.has_colors else ()
    return contents_of(
        scan.table, scan.has_colors, scan.whole, unused=unused, notes=notes, columns=scan.columns
    )


def _read_las(
    file: io.BufferedReader, path: Path, limits: ScanLimits, with_colors: bool, column: str
) -> ScanPoints:
    import laspy

    # laspy takes memory for as many variable-length records as the header says.
    claimed = int.from_bytes(file.read(104)[100:], "little")
    size = os.fstat(file.fileno()).st_size
    if claimed * _RECORD_HEADER_BYTES > size:
        raise ValueError(f"{claimed} records in {size} bytes")
    file.seek(0)
    with laspy.LasReader(file, closefd=False, read_evlrs=False) as las:
        has_colors = "red" in las.header.point_format.dimension_names
        columns = ["x", "y", "z"]
        if with_colors and has_colors:
            columns += ["red", "green", "blue"]
        names = tuple(las.header.point_format.dimension_names)
        if column:
            columns.append(names[column_index(names, column)])
        count, seen = las.header.point_count, 0
        check_claim(count, limits.claimed_in_pieces)
        rows = random_rows(count, limits.kept)
        kept = [np.empty((0, len(columns)))]
        for piece in las.chunk_iterator(limits.piece):
            points = np.stack([np.asarray(piece[name]) for name in columns], axis=1)
            first, last = np.searchsorted(rows, (seen, seen + len(points)))
            kept.append(points[rows[first:last] - seen])
            seen += len(points)
    _check_count(count, seen)
    return ScanPoints(np.concatenate(kept), has_colors, count, columns=names)


def _read_e57(
    file: io.BufferedReader, path: Path, limits: ScanLimits, with_colors: bool, column: str
) -> ScanPoints:
    scan = read_e57(path, limits.claimed, with_colors, column)
    return scan._replace(table=scan.table[random_rows(scan.in_file, limits.kept)])


def _read_pcd(
    file: io.BufferedReader, path: Path, limits: ScanLimits, with_colors: bool, column: str
) -> ScanPoints:
    scan = read_pcd(file.read(), limits.claimed, with_colors, column)
    return scan._replace(table=scan.table[random_rows(scan.in_file, limits.kept)])


def _check_count(claimed: int, count: int) -> None:
    if count != claimed:
        raise NotACloud(
            f"{claimed} points in the header, {count} in the file; it is cut short, fetch it again"
        )


_SCANS: Mapping[
    str, tuple[int, Callable[[io.BufferedReader, Path, ScanLimits, bool, str], Any]]
] = {
    ".las": (_MOST_SCAN_BYTES, _read_las),
    ".laz": (_MOST_SCAN_BYTES, _read_las),
    ".e57": (_MOST_BYTES_AT_ONCE, _read_e57),
    ".pcd": (_MOST_BYTES_AT_ONCE, _read_pcd),
}
_READERS: Mapping[str, Callable[..., CloudContents]] = {
    ".ply": read_ply,
    ".npy": _read_npy,
    **dict.fromkeys((".xyz", ".txt", ".csv", ".tsv", ".asc", ".xyzrgb"), read_text),
    ".xyzn": partial(read_text, unnamed={}),  # its last three columns are normals, no colours
    ".pts": partial(read_text, unnamed=PTS_COLOURS, parts=True),
}
CLOUD_SUFFIXES = (*_READERS, *_SCANS)
