from __future__ import annotations

import numpy as np

from bench.records.frames import read_job_sums

from ..builders import make_failed, make_record, write_all


def test_jobs_have_the_sums_of_their_views_one_after_the_other(tmp_path):
    """From Python 3.12 on `sum` gives 1.0 for ten times 0.1; undefined scores do not count."""
    scores = [None, *[0.1] * 10]
    drawn = [make_record(view=v, ssim_object=x, ssim=-0.0) for v, x in enumerate(scores)]
    lost = [make_failed(obj="b", view=v, reason="apss: no faces", prepare_s=2.0) for v in (1, 0)]
    write_all(tmp_path, [*lost, *drawn, make_record("blank", notes="n")], row_group=1)
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
