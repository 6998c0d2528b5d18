from __future__ import annotations

from hashlib import sha256

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bench.records.seal import SEAL, check_seal, seal

TABLE = pa.table({"a": ["x", "y"], "b": [1.5, None]})


@pytest.fixture
def path(tmp_path):
    pq.write_table(TABLE, tmp_path / "a.parquet")
    return tmp_path / "a.parquet"


def test_a_seal_is_the_checksum_of_everything_else_and_passed_over_by_arrow(path):
    written = path.read_bytes()
    footer = int.from_bytes(written[-8:-4], "little") + 8
    seal(path)
    expected = SEAL + sha256(written).digest()
    assert path.read_bytes() == written[:-footer] + expected + written[-footer:]
    check_seal(path)
    assert pq.read_table(path).equals(TABLE)


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (lambda data: data[:4] + b"x" + data[5:], "do not have its checksum"),
        (lambda data: data[:-30] + b"x" + data[-29:], "do not have its checksum"),
        (lambda data: data[:-8] + b"\1\0\0\0PAR1", "no checksum before its footer"),
        (lambda data: data[:-7] + b"\xff\xff\xffPAR1", "no checksum before its footer"),
        (lambda data: data[:-1], "no checksum before its footer"),
        (lambda data: data + b"x", "no checksum before its footer"),
    ],
)
def test_damaged_files_are_refused_without_arrow(path, harm, message):
    seal(path)
    path.write_bytes(harm(path.read_bytes()))
    with pytest.raises(pa.ArrowInvalid, match=message):
        check_seal(path)


def test_files_without_a_seal_are_refused_without_arrow(path):
    data = path.read_bytes()
    for harmed in (data, data[:-20] + data[-19:], b"PAR1", b""):
        path.write_bytes(harmed)
        with pytest.raises(pa.ArrowInvalid, match=r"damaged, or of version 1\.0\.0 or earlier"):
            check_seal(path)
    with pytest.raises(FileNotFoundError):
        check_seal(path.with_name("b.parquet"))
