"""Receipts: their size and form, their digests, and which files are refused."""

from __future__ import annotations

import json
import re
import sqlite3
import zlib
from contextlib import closing
from hashlib import sha256

import numpy as np
import pytest

from bench.receipts.digests import PARTS, deal, digest_records
from bench.receipts.receipt import (
    MOST_BYTES,
    condensed,
    make_receipt,
    options_of,
    read_receipt,
    to_text,
    weights_of,
)
from bench.records.run_folder import read_manifest

from ..builders import make_record, refusal, write_all
from .runs import alter_manifest, execute, receipt_of, write_receipt


def test_a_receipt_is_small_and_always_the_same(finished, tmp_path):
    text = to_text(make_receipt(finished[0]))
    assert text == to_text(make_receipt(finished[0]))
    assert len(text.encode()) <= MOST_BYTES
    assert text == json.dumps(json.loads(text), sort_keys=True, indent=1) + "\n"
    path = receipt_of(finished[0], tmp_path / "receipt.json")
    assert read_receipt(path) == json.loads(text)


def test_it_says_how_to_make_the_run_again(finished):
    request = make_receipt(finished[0])["request"]
    manifest = read_manifest(finished[0])
    assert request == manifest["request"]
    options = options_of(request)
    assert (options.limit, options.views, options.seed) == (3, 2, 0)
    assert options.methods == tuple(manifest["methods"])


def test_checksums_of_tables_and_weights(finished, tiny_weights):
    receipt = make_receipt(finished[0])
    tables = {path.name: path.read_bytes() for path in finished[0].glob("tables/*.csv")}
    assert receipt["tables"] == {name: sha256(t).hexdigest() for name, t in tables.items()}
    method = f"pc2pix@{tiny_weights}"
    assert receipt["weights"] == {method: sha256(tiny_weights.read_bytes()).hexdigest()}
    assert receipt["metrics"].keys() == read_manifest(finished[0])["feature_identity"].keys()


def test_weights_of_several_networks_have_one_checksum():
    first, second = "a" * 64, "b" * 64
    both = sha256(f"{first} {second}".encode()).hexdigest()
    identities = {"x": f"torch 2, weights {first}", "y": f"{first}; {second}", "z": "scipy 1"}
    assert weights_of(identities) == {"x": first, "y": both}


def test_the_digest_of_all_jobs_by_another_way(finished):
    """The other way reads the database and the bytes of arrays without the package's functions."""
    folder, times = finished[0], ("prepare_s", "draw_s", "condition")
    with closing(sqlite3.connect(folder / "run.sqlite")) as connection:
        rows = connection.execute(
            "SELECT method, condition, class, object, key, reason, records, data FROM listed "
            "JOIN jobs USING (key) JOIN artifacts USING (id)"
        ).fetchall()
    assert len(rows) == 3 * (1 + 4 * 2)
    leaves = {}
    for *name, key, reason, packed, artifact in rows:
        columns = json.loads(zlib.decompress(packed))
        kept = [values for field, values in columns.items() if field not in times]
        records = [list(values) for values in zip(*kept, strict=True)]
        arrays = {}
        (folder.parent / "artifact.npz").write_bytes(artifact)
        with np.load(folder.parent / "artifact.npz") as stored:
            for array in sorted(stored):
                head = f"{stored[array].dtype.str} {stored[array].shape}".encode()
                arrays[array] = sha256(head + stored[array].tobytes()).hexdigest()
        contents = sha256(json.dumps([reason, records, arrays]).encode()).hexdigest()
        leaf = sha256(json.dumps([*name, key, contents]).encode()).hexdigest()
        leaves.setdefault(name[3], []).append(leaf)
    parts = [sha256("".join(sorted(leaves[obj])).encode()).hexdigest() for obj in sorted(leaves)]
    assert (
        make_receipt(folder)["jobs"]
        == {
            "count": 3 * (1 + 2 + 2 + 1 + 1),  # blank and true-mesh see no cloud
            "parts": "".join(part[:16] for part in parts),
            "sha256": sha256("".join(parts).encode()).hexdigest(),
        }
    )


def test_the_digest_of_records_is_of_all_columns_but_times(tmp_path):
    def digest(**changes):
        write_all(tmp_path, [make_record(**changes), make_record(view=1)])
        return digest_records(tmp_path)

    first = digest()
    assert digest(prepare_s=0.5, draw_s=None) == first
    scores = {"ssim": 0.5000001, "lpips": None, "notes": "x", "azimuth_deg": 10.5, "thin_recall": 0}
    others = {digest(**{name: value}) for name, value in scores.items()}
    assert len(others | {first}) == 1 + len(scores)


@pytest.mark.parametrize("count", [1, 3, PARTS, PARTS + 1, 5 * PARTS + 7])
def test_objects_are_dealt_to_parts_of_about_equal_size(count):
    objects = [f"chair/{number}" for number in range(count)]
    parts = deal(objects)
    assert len(parts) == min(PARTS, count)
    assert sorted(obj for part in parts for obj in part) == sorted(objects)
    assert {len(part) for part in parts} <= {count // len(parts), -(-count // len(parts))}


def test_every_change_of_one_byte_is_recognised(finished, tmp_path):
    path = receipt_of(finished[0], tmp_path / "receipt.json")
    data, rng = path.read_bytes(), np.random.default_rng(0)
    for place in range(len(data)):
        other = bytearray(data)
        other[place] ^= int(rng.integers(1, 256))
        path.write_bytes(other)
        assert re.search("no receipt|garbled", refusal(read_receipt, path))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": 2}, "of format 2, this version reads 1"),
        ({"protocol": 1}, "of protocol 1, this version has protocol 2"),
        ({"schema": 3}, "of schema 3, this version has 4"),
        ({"records": 5}, "its entries are not those of a receipt"),
        ({"request": []}, "its entries are not those of a receipt"),
        ({"more": "x"}, "its entries are not those of a receipt"),
    ],
)
def test_a_receipt_of_another_kind_is_refused(finished, tmp_path, changes, message):
    path = write_receipt(tmp_path / "receipt.json", make_receipt(finished[0]) | changes)
    assert message in refusal(read_receipt, path)


@pytest.mark.parametrize(
    ("name", "value"),
    [("methods", "blank"), ("methods", [1]), ("views", True), ("seed", 0.5), ("out", "elsewhere")],
)
def test_a_request_of_other_types_is_refused(finished, tmp_path, name, value):
    receipt = make_receipt(finished[0])
    receipt["request"][name] = value
    path = write_receipt(tmp_path / "receipt.json", receipt)
    assert "not those of a receipt" in refusal(read_receipt, path)


def test_a_receipt_of_another_major_version_is_refused(finished, tmp_path):
    receipt = make_receipt(finished[0])
    receipt["code"]["version"] = "99.0.0"
    path = write_receipt(tmp_path / "receipt.json", receipt)
    assert "of pc2pix-bench 99.0.0, this is " in refusal(read_receipt, path)


def test_many_tables_have_one_digest(copied):
    for number in range(60):
        (copied / "tables" / f"metric_{number}.csv").write_text(f"{number}\n")
    receipt = make_receipt(copied)
    assert len(to_text(receipt)) <= MOST_BYTES
    sums = {p.name: sha256(p.read_bytes()).hexdigest() for p in copied.glob("tables/*.csv")}
    assert receipt["tables"] == condensed(sums)


def test_a_run_without_receipt_is_refused_in_a_line(copied, tmp_path):
    assert "no such folder" in refusal(make_receipt, tmp_path / "none")
    execute(copied, ("UPDATE artifacts SET data = zeroblob(9) WHERE id = 2",))
    assert "missing or altered" in refusal(make_receipt, copied)
    alter_manifest(copied, objects=["chair/test-0002", "chair/test-0001"])
    assert "are not the 2 that its request chooses now" in refusal(make_receipt, copied)
    alter_manifest(copied, code=None)
    assert "no code in its manifest" in refusal(make_receipt, copied)
