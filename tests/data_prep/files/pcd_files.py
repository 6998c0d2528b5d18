"""PCD files as PCL, CloudCompare and people write them."""

from __future__ import annotations

import struct
from collections.abc import Mapping

import numpy as np

TYPES = {"f": "F", "i": "I", "u": "U"}


def pcd(
    columns: Mapping[str, np.ndarray],
    encoding: str = "binary",
    header: Mapping[str, str] | None = None,
    packed: bool = True,
) -> bytes:
    """Return a PCD with the columns, each [N] or [N, count].

    header  lines of the header that differ from those of PCL; one without a text is left out
    packed  whether a compressed block is packed; else it is stored as it is
    """
    table = {name: c if c.ndim == 2 else c[:, None] for name, c in columns.items()}
    count = len(next(iter(table.values())))
    lines = {
        "VERSION": "0.7",
        "FIELDS": " ".join(name.rstrip("'") for name in table),
        "SIZE": " ".join(str(column.itemsize) for column in table.values()),
        "TYPE": " ".join(TYPES[column.dtype.kind] for column in table.values()),
        "COUNT": " ".join(str(column.shape[1]) for column in table.values()),
        "WIDTH": str(count),
        "HEIGHT": "1",
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": str(count),
        "DATA": encoding,
    }
    lines |= header or {}
    text = "".join(f"{keyword} {value}\n" for keyword, value in lines.items() if value)
    return f"# .PCD v0.7 - Point Cloud Data file format\n{text}".encode() + _body(
        list(table.values()), encoding, packed
    )


def _body(columns: list[np.ndarray], encoding: str, packed: bool) -> bytes:
    if encoding == "ascii":
        rows = zip(*(column.tolist() for column in columns), strict=True)
        return "".join(" ".join(repr(v) for c in row for v in c) + "\n" for row in rows).encode()
    if encoding == "binary":
        rows = zip(*columns, strict=True)
        return b"".join(values.tobytes() for row in rows for values in row)
    import lzf

    block = b"".join(column.tobytes() for column in columns)
    content = lzf.compress(block) if packed else block
    assert content is not None, "too small to be packed"
    return struct.pack("<II", len(content), len(block)) + content
