"""One row a job: its sums are those of its records, however they come."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bench.analysis.run import full_frame, read_run
from bench.analysis.values import image_rows
from bench.catalogue.metrics import column
from bench.records.frames import job_frame
from data_prep.failures import BadInput

from ..builders import (
    make_failed,
    make_manifest,
    make_record,
    names_of,
    results_of,
    rows_of,
    scored_records,
    to_frame,
    write_all,
)

METRICS = ("ssim-object", "lpips")
METHODS, CONDITIONS = ["splat", "blank"], ["2048", "512"]
EXACT = 1e-14  # sums of up to 6 numbers up to 1, in two orders: 6 roundings of 6 * 2^-53


def records_of(obj, rng, class_name="chair"):
    """Records of an object of three views: splat fails on o4, and an image has no ssim-object."""
    records = []
    for condition in CONDITIONS:
        for method in METHODS:
            for view in range(3):
                scores = dict(zip(("ssim_object", "lpips"), rng.random(2).tolist(), strict=True))
                made = make_record(method, condition, obj, view, class_name=class_name, **scores)
                if (method, obj) == ("splat", "o4"):
                    made = make_failed("splat", condition, obj, view, class_name=class_name)
                if (method, view, obj) == ("splat", 2, "o1"):
                    made = replace(made, ssim_object=None)
                records.append(made)
    return records


@pytest.fixture(scope="module")
def records():
    rng = np.random.default_rng(0)
    objects = [records_of(f"o{i}", rng) for i in range(9)]
    objects += [records_of(f"o{i}", rng, "car") for i in range(3)]
    return [record for of_object in objects for record in of_object]


def test_a_stored_run_and_objects_one_by_one_give_the_same_to_the_bit(tmp_path, records):
    manifest = names_of(to_frame(records)) | {"methods": METHODS, "conditions": CONDITIONS}
    write_all(tmp_path, records)
    run = read_run(tmp_path, make_manifest(**manifest))
    order = np.random.default_rng(1).permutation(len(records) // 12)
    parts = [job_frame(results_of(to_frame(records[12 * i : 12 * i + 12]))) for i in order]
    going_on = full_frame(pd.concat(parts), manifest)
    pd.testing.assert_frame_equal(going_on, run.jobs[going_on.columns], check_exact=True)
    assert run.objects_of == {"car": 3, "chair": 9}


def test_sums_are_those_of_all_records(records):
    """Another way to the same: pandas' own means, with a blank record for each failed one."""
    frame = to_frame(records)
    run = scored_records(frame)
    keys = ["condition", "class", "object", "view"]
    blank = frame[frame["method"] == "blank"].set_index(keys)
    for cell in run.image_sets:
        at = (frame[["method", "condition", "class"]] == list(cell)).all(axis=1)
        of_cell = frame[at]
        ok = of_cell["outcome"] == "ok"
        assert run.images(cell) == (ok.sum(), len(of_cell))
        filled = of_cell.copy()
        lost = pd.MultiIndex.from_frame(of_cell.loc[~ok, keys])
        names = [column(metric) for metric in METRICS]
        filled.loc[~ok, names] = blank.loc[lost, names].to_numpy()
        for metric in METRICS:
            for blanks, some in ((False, of_cell.assign(ok=ok)), (True, filled)):
                expected = some.groupby("object")[column(metric)].mean()
                assert run.objects(cell).tolist() == expected.index.tolist()
                actual = run.per_object(cell, metric, blanks)
                assert actual == pytest.approx(expected.to_numpy(), rel=0, abs=EXACT, nan_ok=True)
            rows = rows_of(image_rows(run, [metric]))
            (row,) = [r for r in rows if (r.method, r.condition, r.class_name) == cell]
            scores = of_cell.loc[ok, ["object", column(metric)]].dropna()
            means, means_filled = (
                some.groupby("object")[column(metric)].mean().mean() for some in (scores, filled)
            )
            assert row.value == pytest.approx(means, abs=1e-13)  # of up to 27 numbers
            assert row.failures_as_blank == pytest.approx(means_filled, abs=1e-13)
            assert row.n_ok == len(scores)
            assert row.note.startswith(f"{(~ok).sum()} x timeout: 3 s" if (~ok).any() else "")
    assert image_rows(run, METRICS)["failed"].any()


def test_equal_images_have_equal_sums(tmp_path):
    """Otherwise methods that draw the same would differ by rounding, and be told apart by it."""
    scores = np.random.default_rng(2).random(20).tolist()
    records = [
        make_record(method, obj=obj, view=view, ssim=score)
        for method in ("blank", "splat", "poisson")
        for obj in "abc"
        for view, score in enumerate(scores)
    ]
    write_all(tmp_path, records)
    run = read_run(tmp_path, make_manifest(**names_of(to_frame(records))))
    assert run.jobs["ssim_sum"].nunique() == 1
    assert run.jobs["ssim_count"].tolist() == 9 * [20]


@pytest.mark.parametrize(
    ("changed", "named"),
    [({"method": "mine"}, "mine"), ({"condition": "64"}, "64"), ({"object": "z"}, "chair z")],
)
def test_records_that_the_manifest_does_not_have_are_named(tmp_path, changed, named):
    write_all(tmp_path, [make_record(), replace(make_record(), **changed)])
    manifest = make_manifest(objects=["chair/a"])
    with pytest.raises(BadInput, match=f"{named}.*, which the manifest does not have; start"):
        read_run(tmp_path, manifest)
