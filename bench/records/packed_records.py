"""The records of a job as compressed bytes, which may come from anywhere."""

from __future__ import annotations

import json
import zlib
from collections.abc import Sequence
from typing import Any

from bench.records.job import MOST_TEXT
from bench.records.record import TYPES, Record
from data_prep.failures import BadInput
from data_prep.files.safe_read import MIB

_FIELDS = tuple(Record.__dataclass_fields__)
MOST_BYTES = 256 * MIB  # of the records of a job with the most views
MOST_NUMBER = 1e300  # greater ones overflow in sums


def pack_records(records: Sequence[Record]) -> bytes:
    """Return the records of a job as compressed JSON: a list of values for each field."""
    columns = {name: [getattr(record, name) for record in records] for name in _FIELDS}
    return zlib.compress(json.dumps(columns, ensure_ascii=False).encode(), 1)


def unpack_columns(data: bytes) -> dict[str, list[Any]]:
    """Return the values of each field that `pack_records` has packed.

    Raises BadInput for other bytes.
    """
    try:
        unpacking = zlib.decompressobj()
        text = unpacking.decompress(data, MOST_BYTES)
        if not unpacking.eof:
            raise ValueError("cut short, or endless")
        columns = json.loads(text)
        if tuple(columns) != _FIELDS:
            raise ValueError(f"fields {', '.join(columns)}")
        for name, values in columns.items():
            if len(values) != len(columns["view"]) or not all(_fits(name, v) for v in values):
                raise ValueError(f"{name} of another type")
        if b"\\ud" in text.lower():  # perhaps a lone surrogate, which no file takes
            json.dumps(columns, ensure_ascii=False).encode()
    except (ValueError, TypeError, RecursionError, zlib.error) as error:
        raise BadInput(f"records that cannot be read ({error}); start the run again") from error
    for name in ("reason", "notes"):
        columns[name] = [text[:MOST_TEXT] for text in columns[name]]
    return columns


def _fits(name: str, value: object) -> bool:
    """Return whether a field of a record can have a value."""
    if name not in TYPES:
        return isinstance(value, str)
    if value is None:
        return name != "view"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < (2**31 if name == "view" else MOST_NUMBER)
