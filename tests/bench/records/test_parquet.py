from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from harness_objects import Tetrahedron

from bench.records.parquet import JobRow, read_features, read_records, write_features, write_records
from bench.records.record import COLUMNS, SCHEMA_VERSION, to_frame
from data_prep.failures import BadInput

from ..builders import make_failed, make_job, make_record, write_all, write_artifact

CONTRACT = [
    "suite",
    "method",
    "condition",
    "class",
    "object",
    "view",
    "outcome",
    "reason",
    "ssim",
    "luminance",
    "contrast",
    "structure",
    "prepare_s",
    "draw_s",
]


def test_contract_columns(tmp_path):
    write_all(tmp_path, [make_record()])
    frame = pd.read_parquet(tmp_path / "records.parquet")  # as other people's scripts read it
    assert set(CONTRACT) <= set(frame.columns)
    assert frame.iloc[0][CONTRACT].to_dict() == {
        "suite": "chair-robustness",
        "method": "splat",
        "condition": "2048",
        "class": "chair",
        "object": "a",
        "view": 0,
        "outcome": "ok",
        "reason": "",
        "ssim": 0.5,
        "luminance": 0.9,
        "contrast": 0.8,
        "structure": 0.7,
        "prepare_s": 0.25,
        "draw_s": 0.125,
    }


def test_failures_have_no_scores_and_are_not_dropped(tmp_path):
    write_all(tmp_path, [make_failed(reason="apss: no faces"), make_record(obj="b")])
    frame = read_records(tmp_path)
    assert frame["outcome"].tolist() == ["failed", "ok"]
    assert frame["reason"].tolist() == ["apss: no faces", ""]
    assert frame["ssim"].dtype == np.float64
    assert frame["ssim"].isna().tolist() == [True, False]
    assert frame["prepare_s"].isna().tolist() == [True, False]


def test_the_order_of_the_work_does_not_matter(tmp_path):
    records = [
        make_record(method, condition, obj, view)
        for method in ("splat", "blank")
        for condition in ("2048", "1024")
        for obj in ("b", "a")
        for view in (1, 0)
    ]
    write_all(tmp_path, records)
    one, two = read_records(tmp_path), to_frame(records[::-1])
    pd.testing.assert_frame_equal(one, two)
    first = one.iloc[0][["method", "condition", "object", "view"]].tolist()
    assert first == ["blank", "1024", "a", 0]


def test_what_is_written_is_what_is_read(tmp_path):
    records = [make_record(ssim=1 / 3, notes="3 faces"), make_failed(obj="b")]
    write_all(tmp_path, records)
    pd.testing.assert_frame_equal(read_records(tmp_path), to_frame(records))
    assert [path.name for path in tmp_path.iterdir()] == ["records.parquet"]


def test_no_records(tmp_path):
    with pytest.raises(BadInput, match=r"no records\.parquet; the run is not finished"):
        read_records(tmp_path)


@pytest.mark.parametrize("harm", [lambda data: data[:-10], lambda data: b"", lambda data: b"PAR1"])
def test_damaged_records(tmp_path, harm):
    write_all(tmp_path, [make_record()])
    path = tmp_path / "records.parquet"
    path.write_bytes(harm(path.read_bytes()))
    with pytest.raises(BadInput) as error:
        read_records(tmp_path)
    assert str(error.value).startswith(f"{path}: not readable (")
    assert "\n" not in str(error.value)


def test_newer_records_are_refused(tmp_path):
    path = tmp_path / "records.parquet"
    table = pa.table({name: [1.0] for name in COLUMNS})
    for schema, refused in ((SCHEMA_VERSION + 1, True), (SCHEMA_VERSION, False)):
        pq.write_table(
            table.replace_schema_metadata({b"pc2pix_bench_schema": str(schema).encode()}), path
        )
        if refused:
            with pytest.raises(BadInput, match=f"schema {schema} is newer than {SCHEMA_VERSION}"):
                read_records(tmp_path)
        else:
            assert len(read_records(tmp_path)) == 1


def test_records_without_a_column_are_refused(tmp_path):
    table = pa.table({name: [1.0] for name in COLUMNS}).drop_columns(["condition"])
    schema = {b"pc2pix_bench_schema": str(SCHEMA_VERSION).encode()}
    pq.write_table(table.replace_schema_metadata(schema), tmp_path / "records.parquet")
    with pytest.raises(BadInput, match=r"records.parquet: no column condition; start the run"):
        read_records(tmp_path)


def test_a_schema_that_is_no_number_is_refused(tmp_path):
    table = pa.table({"ssim": [1.0]}).replace_schema_metadata({b"pc2pix_bench_schema": b"two"})
    pq.write_table(table, tmp_path / "records.parquet")
    with pytest.raises(BadInput, match="its schema is no number"):
        read_records(tmp_path)


def test_older_records_are_refused(tmp_path):
    path = tmp_path / "records.parquet"
    table = pa.table({"ssim": [1.0]}).replace_schema_metadata({b"pc2pix_bench_schema": b"1"})
    pq.write_table(table, path)
    with pytest.raises(BadInput, match=r"schema 1 is older than \d; start the run again"):
        read_records(tmp_path)


def test_written_records_carry_the_schema(tmp_path):
    write_all(tmp_path, [make_record()])
    metadata = pq.read_schema(tmp_path / "records.parquet").metadata
    assert metadata[b"pc2pix_bench_schema"] == str(SCHEMA_VERSION).encode()


def test_features_go_and_come_back(tmp_path):
    rng = np.random.default_rng(0)
    jobs, expected = [], {}
    for i in range(70):  # several row groups
        job = make_job(tmp_path / "artifacts", method=f"m{i % 2}")
        job = replace(job, artifact=job.artifact.with_name(f"{i}.npz"))
        job = replace(job, object=replace(job.object, object_id=f"o{i:02d}"))
        values = rng.random((2, 5), np.float32)
        write_artifact(job, images=np.zeros(1), metric=values)
        jobs.append(job)
        expected |= {(job.method, job.object.object_id, v): values[v] for v in range(2)}
    write_features(tmp_path, "metric", [job.made for job in jobs])
    found = read_features(tmp_path, "metric")
    for method in ("m0", "m1"):
        images = found.images(method, "2048", "chair")
        assert len(images) == 70
        assert images == sorted(images)
        values = found.of(method, "2048", "chair", images)
        assert values.dtype == np.float32
        assert np.array_equal(values, [expected[method, *image] for image in images])
        backwards = found.of(method, "2048", "chair", images[::-1])
        assert np.array_equal(backwards, values[::-1])
    assert found.images("m0", "512", "chair") == []


def feature_jobs(tmp_path, objects, methods=("m0", "m1"), conditions=("2048",)):
    """Artifacts, object by object as a run makes them, and their features by job."""
    rng = np.random.default_rng(0)
    jobs, expected = [], {}
    for i in range(objects):
        for method in methods:
            for condition in conditions:
                job = make_job(tmp_path / "artifacts", Tetrahedron(f"o{i:03d}"), method, condition)
                values = rng.random((2, 5), np.float32)
                write_artifact(job, images=np.zeros(1), metric=values)
                jobs.append(job)
                expected |= {(job.item, v): values[v] for v in range(2)}
    return jobs, expected


def test_only_the_row_groups_that_are_asked_for_are_read(tmp_path, monkeypatch):
    """40 objects of each method are three row groups; others are none of a question's business."""
    jobs, expected = feature_jobs(tmp_path, 40)
    write_features(tmp_path, "metric", [job.made for job in jobs])
    read = []
    original = pq.ParquetFile.read_row_group

    def counted(self, group, columns, **named):
        read.append((group, columns[3:]))
        return original(self, group, columns, **named)

    monkeypatch.setattr(pq.ParquetFile, "read_row_group", counted)
    found = read_features(tmp_path, "metric")
    assert read == []
    images = found.images("m1", "2048", "chair")
    assert read == [(group, ["object", "view"]) for group in (3, 4, 5)]
    read.clear()
    some = [p for p in images if "o016" <= p[0] < "o030"]
    values = found.of("m1", "2048", "chair", some)
    item = jobs[1].item
    wanted = [expected[item._replace(object_id=obj), view] for obj, view in some]
    assert np.array_equal(values, wanted)
    assert read == [(4, ["object", "view", "features"])]
    assert found.images("m2", "2048", "chair") == []
    assert len(read) == 1


def test_features_in_any_order_are_read(tmp_path):
    """Files of earlier versions: object by object, cells mixed within a row group."""
    conditions = ("2048", "512")
    jobs, expected = feature_jobs(tmp_path, 10, conditions=conditions)
    write_features(tmp_path, "metric", [job.made for job in jobs])
    path = tmp_path / "features" / "metric.parquet"
    table = pq.read_table(path)
    order = np.random.default_rng(1).permutation(len(table))
    pq.write_table(table.take(order), path, row_group_size=7)
    found = read_features(tmp_path, "metric")
    for job in jobs[:4]:
        images = found.images(*job.item[:3])
        assert images == [(f"o{i:03d}", view) for i in range(10) for view in range(2)]
        wanted = [expected[job.item._replace(object_id=obj), view] for obj, view in images]
        assert np.array_equal(found.of(*job.item[:3], images), wanted)


def test_images_without_features_are_named(tmp_path):
    jobs, _ = feature_jobs(tmp_path, 2)
    write_features(tmp_path, "metric", [job.made for job in jobs])
    found = read_features(tmp_path, "metric")
    with pytest.raises(KeyError, match="o005"):
        found.of("m0", "2048", "chair", [("o000", 0), ("o005", 1)])
    with pytest.raises(KeyError):
        found.of("m2", "2048", "chair", [("o000", 0)])
    assert found.of("m0", "2048", "chair", []).shape == (0, 5)
    twice = found.of("m0", "2048", "chair", [("o001", 0), ("o000", 0), ("o001", 0)])
    assert np.array_equal(twice[0], twice[2])


def test_features_without_a_column_are_refused(tmp_path):
    jobs, _ = feature_jobs(tmp_path, 1)
    write_features(tmp_path, "metric", [job.made for job in jobs])
    path = tmp_path / "features" / "metric.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["view"]), path)
    with pytest.raises(BadInput, match=r"metric.parquet: no column view; start the run again"):
        read_features(tmp_path, "metric")


@pytest.mark.parametrize("size", [1, 3, 1000])
def test_records_are_written_some_at_a_time(tmp_path, monkeypatch, size):
    monkeypatch.setattr("bench.records.parquet._ROW_GROUP", size)
    records = [make_record(m, obj=obj, view=v) for obj in "ba" for m in "yx" for v in range(2)]
    records.append(make_failed("x", obj="c"))
    write_all(tmp_path, records)
    pd.testing.assert_frame_equal(read_records(tmp_path), to_frame(records))
    groups = pq.ParquetFile(tmp_path / "records.parquet").num_row_groups
    assert groups == -(-9 // size)


def test_interrupted_records_leave_the_old_ones(tmp_path):
    write_all(tmp_path, [make_record()])
    old = (tmp_path / "records.parquet").read_bytes()
    jobs = [JobRow(str(i), make_job(tmp_path, Tetrahedron(str(i))).item, None) for i in range(3)]

    def stopped(row):
        if row.key == "2":
            raise KeyboardInterrupt
        return [make_record(obj=row.item.object_id)]

    with pytest.raises(KeyboardInterrupt):
        write_records(tmp_path, jobs, stopped)
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [old]


def test_features_of_no_jobs(tmp_path):
    write_features(tmp_path, "metric", [])
    assert list(tmp_path.iterdir()) == []


def test_interrupted_features_leave_the_old_ones(tmp_path):
    jobs = []
    for i in range(17):  # one more than a row group
        job = make_job(tmp_path / "artifacts")
        job = replace(job, artifact=job.artifact.with_name(f"{i}.npz"))
        write_artifact(job, images=np.zeros(1), metric=np.full((2, 5), i, np.float32))
        jobs.append(job)
    write_features(tmp_path, "metric", [job.made for job in jobs[:1]])
    (path,) = (tmp_path / "features").iterdir()
    old = path.read_bytes()
    jobs[-1].artifact.unlink()
    with pytest.raises(FileNotFoundError):
        write_features(tmp_path, "metric", [job.made for job in jobs])
    assert path.read_bytes() == old
    assert list(path.parent.iterdir()) == [path]


def test_features_that_were_not_taken(tmp_path):
    assert read_features(tmp_path, "fid") is None


def test_damaged_features(tmp_path):
    path = tmp_path / "features" / "fid.parquet"
    path.parent.mkdir()
    path.write_bytes(b"PAR1")
    with pytest.raises(BadInput, match="not readable"):
        read_features(tmp_path, "fid")
