"""The format of a line of the journal: the checksum of its JSON, the JSON, a line feed."""

from __future__ import annotations

import json
from dataclasses import asdict
from hashlib import sha256

from bench.records.job import Result
from bench.records.record import Record

_FIELDS = Record.__dataclass_fields__.keys()


def to_line(result: Result) -> bytes:
    """Return a result as a line of the journal: the checksum of its JSON, the JSON, a line feed."""
    body = json.dumps(
        {
            "key": result.key,
            "artifact_sha256": result.artifact_sha256,
            "records": [asdict(record) for record in result.records],
        },
        ensure_ascii=False,
    ).encode()
    return sha256(body).hexdigest().encode() + b" " + body + b"\n"


def counts(line: bytes) -> bool:
    """Return whether the checksum of a line fits."""
    checksum, _, body = line.removesuffix(b"\n").partition(b" ")
    return sha256(body).hexdigest().encode() == checksum


def to_result(line: bytes) -> Result | None:
    """Return the result in a line that counts; None for a line of another schema."""
    values = json.loads(line.partition(b" ")[2])
    # The key of a line of another schema is no job's any more: keys depend on the schema.
    if any(record.keys() != _FIELDS for record in values["records"]):
        return None
    records = tuple(Record(**record) for record in values["records"])
    sha = values["artifact_sha256"]
    reason = records[0].reason if records and sha is None else ""
    return Result(values["key"], records, sha, reason)
