from __future__ import annotations

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from harness_objects import Tetrahedron

from bench.records.folder import open_folder, open_store
from bench.records.frames import (
    read_features,
    read_job_sums,
    read_records,
    write_records,
)
from bench.records.job import COLUMNS, RECORDS_VERSION
from data_prep.failures import BadInput

from ..builders import (
    make_failed,
    make_job,
    make_record,
    make_result,
    rewrite,
    to_frame,
    write_all,
)


def test_contract_columns_and_schema(tmp_path):
    """The file for other people's scripts."""
    write_all(tmp_path, [make_record()])
    path = tmp_path / "records.parquet"
    cell = {"suite": "chair-robustness", "method": "splat", "condition": "2048", "class": "chair"}
    image = {"object": "a", "view": 0, "outcome": "ok", "reason": ""}
    scores = {"ssim": 0.5, "luminance": 0.9, "contrast": 0.8, "structure": 0.7}
    contract = cell | image | scores | {"prepare_s": 0.25, "draw_s": 0.125}
    (row,) = pd.read_parquet(path).to_dict("records")
    assert contract.items() <= row.items()
    schema = pq.read_schema(path)
    assert tuple(schema.names) == COLUMNS
    assert schema.metadata[b"pc2pix_bench_schema"] == str(RECORDS_VERSION).encode()


@pytest.mark.parametrize("size", [1, 3, 1000])
def test_what_is_read_and_written_some_at_a_time_is_in_one_order(tmp_path, size):
    """The order of the work does not matter; a job is never divided."""
    records = [
        make_record(method, condition, obj, view, ssim=1 / 3)
        for method in ("splat", "blank")
        for condition in ("2048", "1024")
        for obj in ("b", "a")
        for view in (1, 0)
    ]
    records.append(make_failed("splat", obj="c", reason="apss: no faces"))
    write_all(tmp_path, records)
    expected = to_frame(records[::-1])
    found = read_records(tmp_path)
    pd.testing.assert_frame_equal(found, expected)
    assert found.iloc[0][["method", "condition", "object", "view"]].tolist() == [
        *("blank", "1024", "a", 0)
    ]
    failed = found.iloc[-1]  # it is not dropped, and has no scores
    assert (failed["outcome"], failed["reason"]) == ("failed", "apss: no faces")
    assert found["ssim"].isna().sum() == found["prepare_s"].isna().sum() == 1
    (tmp_path / "records.parquet").unlink()
    with open_store(tmp_path) as store:
        write_records(tmp_path, store, size)
    file = pq.ParquetFile(tmp_path / "records.parquet")
    sizes = [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
    assert sizes == {1: [2] * 8 + [1], 3: [4] * 4 + [1], 1000: [17]}[size]
    written = pd.read_parquet(tmp_path / "records.parquet")
    pd.testing.assert_frame_equal(written, expected, check_dtype=False)
    columns = ["object", "view", "ssim"]
    cell = (expected["method"] == "blank") & (expected["condition"] == "1024")
    found = read_records(tmp_path, columns, method="blank", condition="1024")
    pd.testing.assert_frame_equal(found, expected[cell][columns].reset_index(drop=True))
    none = read_records(tmp_path, columns, method="a")
    assert none.to_dict("list") == {name: [] for name in columns}
    assert none.dtypes.equals(found.dtypes)


def test_interrupted_records_leave_the_old_ones(tmp_path, monkeypatch):
    write_all(tmp_path, [make_record(obj=name) for name in "ab"])
    old = (tmp_path / "records.parquet").read_bytes()

    def stopped(*_):
        raise KeyboardInterrupt

    with open_store(tmp_path) as store:
        monkeypatch.setattr(pq.ParquetWriter, "write_table", stopped)
        with pytest.raises(KeyboardInterrupt):
            write_records(tmp_path, store, 1)
    assert (tmp_path / "records.parquet").read_bytes() == old
    assert not [*tmp_path.glob(".*")]


def test_jobs_have_the_sums_of_their_views_one_after_the_other(tmp_path):
    """From Python 3.12 on `sum` gives 1.0 for ten times 0.1; undefined scores do not count."""
    scores = [None, *[0.1] * 10]
    drawn = [make_record(view=v, ssim_object=x, ssim=-0.0) for v, x in enumerate(scores)]
    lost = [make_failed(obj="b", view=v, reason="apss: no faces", prepare_s=2.0) for v in (1, 0)]
    write_all(tmp_path, [*lost, *drawn, make_record("blank", notes="n")])
    jobs = read_job_sums(tmp_path)
    names = jobs[["method", "condition", "class", "object"]].apply("/".join, axis=1)
    assert names.tolist() == ["blank/2048/chair/a", "splat/2048/chair/a", "splat/2048/chair/b"]
    assert jobs["planned"].tolist() == [1, 11, 2]
    assert jobs["drawn"].tolist() == [1, 11, 0]
    assert jobs["reason"].tolist() == ["", "", "apss: no faces"]
    assert jobs["notes"].tolist() == ["n", "", ""]
    assert jobs["prepare_s"].tolist() == [0.25, 0.25, 2.0]
    assert np.array_equal(jobs["draw_s"], [0.125, 0.125, np.nan], equal_nan=True)
    assert jobs["ssim_object_sum"].tolist() == [0.4, 0.9999999999999999, 0.0]
    assert jobs["ssim_object_count"].tolist() == [1, 10, 0]
    assert jobs["draw_s_sum"].tolist() == [0.125, 11 * 0.125, 0.0]
    assert str(jobs["ssim_sum"][1]) == "0.0"
    assert jobs["ssim_count"].dtype == jobs["planned"].dtype == np.int64


def write_features(tmp_path, objects, methods=("m0", "m1")):
    """Jobs object by object, as a run makes them; their features by item and view."""
    rng = np.random.default_rng(0)
    jobs, expected = [], {}
    with open_folder(tmp_path) as store:
        for i in range(objects):
            for method in methods:
                job = make_job(Tetrahedron(f"o{i:03d}"), method)
                values = rng.random((2, 5), np.float32)
                store.append(make_result(job, metric=values))
                jobs.append(job)
                expected |= {(job.name, v): values[v] for v in range(2)}
        store.list_jobs((job.key, job.name) for job in jobs)
    return jobs, expected


def test_features_are_those_of_the_images_asked_for(tmp_path):
    jobs, expected = write_features(tmp_path, 5)
    stored = read_features(tmp_path, "metric")
    assert stored is not None
    images = stored.images("m1", "2048", "chair")
    assert images == [(f"o{i:03d}", view) for i in range(5) for view in range(2)]
    for some in (images, images[::-1], images[3:6], [images[2], images[0], images[2]], []):
        values = stored.of("m1", "2048", "chair", some)
        wanted = [expected[jobs[1].name._replace(object_id=obj), view] for obj, view in some]
        assert values.dtype == np.float32
        assert values.tolist() == np.array(wanted, np.float32).tolist()
    assert stored.images("m2", "2048", "chair") == stored.images("m0", "512", "chair") == []
    assert read_features(tmp_path, "other") is None


def test_only_the_features_that_are_asked_for_are_read(tmp_path):
    """Those of other objects, methods and extractors may be damaged."""
    jobs, _ = write_features(tmp_path, 3)
    for job in (jobs[0], jobs[5]):
        rewrite(tmp_path, job.key, lambda result, arrays: (result, {"metric": np.zeros(3)}))
    stored = read_features(tmp_path, "metric")
    assert stored is not None
    assert stored.of("m0", "2048", "chair", [("o001", 0), ("o002", 1)]).shape == (2, 5)


@pytest.mark.parametrize(
    "values",
    [None, np.zeros((1, 5), np.float32), np.zeros((2, 4), np.float32), np.zeros((2, 5)), "nan"],
    ids=range(5),
)
def test_images_without_features_are_named(tmp_path, values):
    jobs, _ = write_features(tmp_path, 2)
    if isinstance(values, str):
        values = np.array([[0.0] * 5, [np.nan] * 5], np.float32)
    others = {} if values is None else {"metric": values}
    rewrite(tmp_path, jobs[2].key, lambda result, arrays: (result, others))
    stored = read_features(tmp_path, "metric")
    assert stored is not None
    message = r"no features \(metric\) of m0 at 2048 of chair/o001, view [01]; start the run again"
    with pytest.raises(BadInput, match=message):
        stored.of("m0", "2048", "chair", [("o000", 0), ("o001", 1)])
    with pytest.raises(BadInput, match="of m2 at 2048 of chair/o000, view 0"):
        stored.of("m2", "2048", "chair", [("o000", 0)])
