from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from harness_objects import Tetrahedron

from bench.records.parquet import (
    read_batches,
    read_features,
    read_records,
    write_features,
    write_records,
)
from bench.records.record import COLUMNS, SCHEMA_VERSION
from bench.records.run_folder import open_folder
from bench.records.seal import SEAL, seal
from bench.records.store import pack_records, unpack_columns
from data_prep.failures import BadInput

from ..builders import make_failed, make_job, make_record, make_result, to_frame, write_all

SCHEMA_KEY = b"pc2pix_bench_schema"


def test_contract_columns_and_schema(tmp_path):
    write_all(tmp_path, [make_record()])
    path = tmp_path / "records.parquet"
    cell = {"suite": "chair-robustness", "method": "splat", "condition": "2048", "class": "chair"}
    image = {"object": "a", "view": 0, "outcome": "ok", "reason": ""}
    scores = {"ssim": 0.5, "luminance": 0.9, "contrast": 0.8, "structure": 0.7}
    contract = cell | image | scores | {"prepare_s": 0.25, "draw_s": 0.125}
    (row,) = pd.read_parquet(path).to_dict("records")  # as other people's scripts read it
    assert contract.items() <= row.items()
    assert pq.read_schema(path).metadata[SCHEMA_KEY] == str(SCHEMA_VERSION).encode()


@pytest.mark.parametrize(("size", "groups"), [(1, 9), (3, 5), (1000, 1)])
def test_what_is_written_some_at_a_time_is_read_in_one_order(tmp_path, size, groups):
    """The order of the work does not matter; a job is never divided."""
    records = [
        make_record(method, condition, obj, view, ssim=1 / 3)
        for method in ("splat", "blank")
        for condition in ("2048", "1024")
        for obj in ("b", "a")
        for view in (1, 0)
    ]
    records.append(make_failed("splat", obj="c", reason="apss: no faces"))
    write_all(tmp_path, records, row_group=size)
    found = read_records(tmp_path)
    pd.testing.assert_frame_equal(found, to_frame(records[::-1]))
    first = found.iloc[0][["method", "condition", "object", "view"]].tolist()
    assert first == ["blank", "1024", "a", 0]
    assert pq.ParquetFile(tmp_path / "records.parquet").num_row_groups == groups
    failed = found.iloc[-1]  # it is not dropped, and has no scores
    assert (failed["outcome"], failed["reason"]) == ("failed", "apss: no faces")
    assert found["ssim"].dtype == np.float64
    assert found["ssim"].isna().sum() == found["prepare_s"].isna().sum() == 1
    assert [path.name for path in tmp_path.iterdir()] == ["records.parquet"]


@pytest.mark.parametrize("size", [1, 3, 1000])
def test_batches_are_the_records_part_by_part(tmp_path, size):
    """Text comes as categories; `only` leaves what another reader would filter."""
    records = [
        make_record(method, condition, obj, view, ssim=view / 7)
        for method in ("splat", "blank")
        for condition in ("2048", "1024")
        for obj in ("b", "a")
        for view in (1, 0)
    ]
    write_all(tmp_path, records, row_group=size)
    columns = ["object", "view", "ssim"]
    whole = read_records(tmp_path)
    parts = list(read_batches(tmp_path, columns))
    assert len(parts) == {1: 8, 3: 4, 1000: 1}[size]
    assert all(isinstance(part["object"].dtype, pd.CategoricalDtype) for part in parts)
    together = pd.concat(part.astype({"object": "str"}) for part in parts)
    pd.testing.assert_frame_equal(together.reset_index(drop=True), whole[columns])
    expected = whole[(whole["method"] == "blank") & (whole["condition"] == "1024")][columns]
    found = read_records(tmp_path, columns, method="blank", condition="1024")
    pd.testing.assert_frame_equal(found, expected.reset_index(drop=True))
    assert read_records(tmp_path, columns, method="a").to_dict("list") == {n: [] for n in columns}
    assert list(read_batches(tmp_path, columns, method="zzz")) == []


@pytest.mark.parametrize("harm", [lambda data: data[:-10], lambda data: b"", lambda data: b"PAR1"])
def test_missing_or_damaged_records(tmp_path, harm):
    with pytest.raises(BadInput, match=r"no records\.parquet; the run is not finished"):
        read_records(tmp_path)
    write_all(tmp_path, [make_record()])
    path = tmp_path / "records.parquet"
    path.write_bytes(harm(path.read_bytes()))
    with pytest.raises(BadInput) as error:
        read_records(tmp_path)
    assert str(error.value).startswith(f"{path}: not readable (")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("schema", "columns", "message"),
    [
        (SCHEMA_VERSION + 1, COLUMNS, rf"schema \d is newer than {SCHEMA_VERSION}; update"),
        (1, ["ssim"], r"of version 1\.0\.0 or earlier \(schema 1, now \d\); start the run again"),
        ("two", ["ssim"], "its schema is no number"),
        (SCHEMA_VERSION, [n for n in COLUMNS if n != "view"], "no column view; start the run"),
    ],
)
def test_records_of_another_schema_are_refused(tmp_path, schema, columns, message):
    def write(version, names):
        table = pa.table({name: [1.0] for name in names})
        table = table.replace_schema_metadata({SCHEMA_KEY: str(version).encode()})
        pq.write_table(table, tmp_path / "records.parquet")
        seal(tmp_path / "records.parquet")

    write(SCHEMA_VERSION, COLUMNS)
    assert len(read_records(tmp_path)) == 1
    write(schema, columns)
    with pytest.raises(BadInput, match=rf"records.parquet: {message}"):
        read_records(tmp_path)


def test_interrupted_records_leave_the_old_ones(tmp_path):
    write_all(tmp_path, [make_record()])
    old = (tmp_path / "records.parquet").read_bytes()

    def stopped():
        for name in "ab":
            record = make_record(obj=name)
            yield make_job(Tetrahedron(name)).name, unpack_columns(pack_records([record]))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_records(tmp_path, stopped(), row_group=1)
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [old]


def features(tmp_path, objects, methods=("m0", "m1"), conditions=("2048",)):
    """Jobs with their artifacts, object by object as a run makes them; values by item and view;
    and the file of their features, with a row group for 16 jobs."""
    rng = np.random.default_rng(0)
    jobs, expected = [], {}
    with open_folder(tmp_path) as store:
        for i in range(objects):
            for method in methods:
                for condition in conditions:
                    job = make_job(Tetrahedron(f"o{i:03d}"), method, condition)
                    job = replace(job, key=f"{i} {method} {condition}")
                    values = rng.random((2, 5), np.float32)
                    store.append(make_result(job, images=np.zeros(1), metric=values))
                    jobs.append(job)
                    expected |= {(job.name, v): values[v] for v in range(2)}
        store.list_jobs((job.key, job.name) for job in jobs)
        write_features(tmp_path, store, ["metric"], jobs_per_group=16)
    return jobs, expected, tmp_path / "features" / "metric.parquet"


def wanted(expected, job, images):
    return [expected[job.name._replace(object_id=obj), view] for obj, view in images]


def spoil(path, groups):
    """Overwrite the data of some row groups and seal the file anew; the footer stays."""
    footer, data = pq.read_metadata(path), bytearray(path.read_bytes())
    for group in groups:
        for number in range(footer.num_columns):
            column = footer.row_group(group).column(number)
            start = column.dictionary_page_offset or column.data_page_offset
            data[start : start + column.total_compressed_size] = b"x" * column.total_compressed_size
    at = data.rindex(SEAL)
    path.write_bytes(data[:at] + data[at + len(SEAL) + 32 :])
    seal(path)


def test_only_the_row_groups_that_are_asked_for_are_read(tmp_path):
    """40 objects of each method are three row groups; others are not even looked at."""
    jobs, expected, path = features(tmp_path, 40)
    spoil(path, (0, 1, 2))
    stored = read_features(tmp_path, "metric")
    assert stored is not None
    images = stored.images("m1", "2048", "chair")
    assert images == [(f"o{i:03d}", view) for i in range(40) for view in range(2)]
    backwards = stored.of("m1", "2048", "chair", images[::-1])
    assert np.array_equal(backwards, wanted(expected, jobs[1], images[::-1]))
    assert stored.images("m2", "2048", "chair") == stored.images("m0", "512", "chair") == []
    with pytest.raises(BadInput, match=r"metric.parquet: not readable .*; start the run again"):
        stored.images("m0", "2048", "chair")
    spoil(path, (3, 5))
    some = [p for p in images if "o016" <= p[0] < "o030"][::-1]
    values = stored.of("m1", "2048", "chair", some)
    assert values.dtype == np.float32
    assert np.array_equal(values, wanted(expected, jobs[1], some))


def test_features_in_the_order_of_earlier_versions_are_refused(tmp_path):
    """Object by object, cells mixed within a row group."""
    _, _, path = features(tmp_path, 10, conditions=("2048", "512"))
    table = pq.read_table(path)
    order = np.random.default_rng(1).permutation(len(table))
    pq.write_table(table.take(order), path, row_group_size=7)
    seal(path)
    message = "several methods, conditions or classes lie together, as in version 1.0.0 or earlier"
    with pytest.raises(BadInput, match=message):
        read_features(tmp_path, "metric")


def test_files_without_a_seal_are_of_an_earlier_version(tmp_path):
    write_all(tmp_path, [make_record()])
    path = tmp_path / "records.parquet"
    pq.write_table(pq.read_table(path), path)
    with pytest.raises(BadInput) as error:
        read_records(tmp_path)
    assert str(error.value) == (
        f"{path}: not readable (no checksum before its footer: damaged, or of version 1.0.0 or "
        "earlier); start the run again"
    )


def test_images_without_features_are_named(tmp_path):
    features(tmp_path, 2)
    found = read_features(tmp_path, "metric")
    assert found is not None
    with pytest.raises(BadInput, match="o005"):
        found.of("m0", "2048", "chair", [("o000", 0), ("o005", 1)])
    with pytest.raises(BadInput):
        found.of("m2", "2048", "chair", [("o000", 0)])
    assert found.of("m0", "2048", "chair", []).shape == (0, 5)
    twice = found.of("m0", "2048", "chair", [("o001", 0), ("o000", 0), ("o001", 0)])
    assert np.array_equal(twice[0], twice[2])


def test_features_that_cannot_be_used_are_refused(tmp_path):
    _, _, path = features(tmp_path, 1)
    pq.write_table(pq.read_table(path).drop_columns(["view"]), path)
    seal(path)
    with pytest.raises(BadInput, match=r"metric.parquet: no column view; start the run again"):
        read_features(tmp_path, "metric")
    path.write_bytes(b"PAR1")
    with pytest.raises(BadInput, match=r"metric.parquet: not readable"):
        read_features(tmp_path, "metric")


def test_features_without_a_column_are_refused(tmp_path):
    columns = {name: ["a"] for name in ("method", "condition", "class", "object")}
    table = pa.table({**columns, "view": [0], "features": pa.array([[]], pa.list_(pa.float32()))})
    (tmp_path / "features").mkdir()
    pq.write_table(table, tmp_path / "features" / "fd-views.parquet")
    seal(tmp_path / "features" / "fd-views.parquet")
    with pytest.raises(BadInput, match=r"fd-views\.parquet: features of no fixed number; start"):
        read_features(tmp_path, "fd-views")


def test_without_features_there_is_no_file(tmp_path):
    with open_folder(tmp_path) as store:
        write_features(tmp_path, store, ["metric"])
    assert not (tmp_path / "features").exists()
    assert read_features(tmp_path, "metric") is None


def test_interrupted_features_leave_the_old_ones(tmp_path):
    jobs, _, path = features(tmp_path, 17, methods=("m0",))  # one more than a row group
    old = path.read_bytes()
    with open_folder(tmp_path) as store:
        store.append(make_result(jobs[-1], images=np.zeros(1)))
        with pytest.raises(BadInput, match=f"the features of job {jobs[-1].key} are missing"):
            write_features(tmp_path, store, ["metric"], jobs_per_group=16)
    assert path.read_bytes() == old
    assert list(path.parent.iterdir()) == [path]
