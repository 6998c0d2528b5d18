"""Sums by object are those of all records, however they come."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bench.analysis.object_sums import ObjectSums, sum_records
from bench.analysis.scores import mean_rows
from bench.catalogue.metrics import column
from data_prep.failures import BadInput

from ..builders import make_failed, make_record, names_of, to_frame, write_all

METRICS = ("ssim-object", "lpips")
METHODS, CONDITIONS = ["splat", "blank"], ["2048", "512"]
VIEWS = range(3)
EXACT = 1e-14  # sums of up to 6 numbers up to 1, in two orders: 6 roundings of 6 * 2^-53


def records_of(obj, rng, class_name="chair"):
    """Records of an object: one view of splat fails, another has no ssim-object."""
    records = []
    for condition in CONDITIONS:
        for method in METHODS:
            for view in VIEWS:
                scores = dict(zip(("ssim_object", "lpips"), rng.random(2).tolist(), strict=True))
                made = make_record(method, condition, obj, view, class_name=class_name, **scores)
                if (method, view) == ("splat", int(obj[1:]) % 4):
                    made = make_failed("splat", condition, obj, view, class_name=class_name)
                if (method, view, obj) == ("splat", 2, "o4"):
                    made = replace(made, ssim_object=None)
                records.append(made)
    return records


@pytest.fixture(scope="module")
def objects():
    rng = np.random.default_rng(0)
    chairs = [records_of(f"o{i}", rng) for i in range(9)]
    return chairs + [records_of(f"o{i}", rng, "car") for i in range(3)]


@pytest.fixture(scope="module")
def frame(objects):
    return to_frame([record for records in objects for record in records])


def written(directory, objects, size):
    """The sums of a file with parts of `size` records."""
    write_all(directory, [record for records in objects for record in records], row_group=size)
    names = names_of(to_frame([record for records in objects for record in records]))
    return sum_records(directory, names | {"methods": METHODS, "conditions": CONDITIONS})


def values_of(sums):
    """All numbers and names that tables take of the sums."""
    return {
        (cell, metric, blanks): (
            sums.images(cell),
            sums.reasons.get(cell),
            sums.objects(cell[2]).tolist(),
            *map(np.ndarray.tolist, sums.numbers(cell)),
            repr(sums.per_object(cell, metric, blanks).tolist()),
            repr(sums.totals(cell, metric, blanks)),
        )
        for cell in sums.cells
        for metric in METRICS
        for blanks in (False, True)
    }


def test_parts_of_a_file_and_objects_one_by_one_give_the_same_to_the_bit(tmp_path, objects):
    whole = values_of(written(tmp_path, objects, 1000))
    assert len(whole) == 2 * 2 * 2 * 2 * 2
    for size in (1, 7):  # a job is never divided, and a part has one or three of them
        assert values_of(written(tmp_path, objects, size)) == whole
    names = [f"{records[0].class_name}/{records[0].object}" for records in objects]
    running = ObjectSums(METHODS, CONDITIONS, names, METRICS)
    for i in np.random.default_rng(1).permutation(len(objects)):
        running.add_object(objects[i])
    assert values_of(running) == whole
    assert running.objects_of == {"car": 3, "chair": 9}


def test_sums_are_those_of_all_records(tmp_path, objects, frame):
    """Another way to the same: pandas' own means, with a blank record for each failed one."""
    sums = written(tmp_path, objects, 7)
    keys = ["condition", "class", "object", "view"]
    blank = frame[frame["method"] == "blank"].set_index(keys)
    for cell in sums.cells:
        at = (frame[["method", "condition", "class"]] == list(cell)).all(axis=1)
        records = frame[at]
        ok = records["outcome"] == "ok"
        assert sums.images(cell) == (ok.sum(), len(records))
        filled = records.copy()
        lost = pd.MultiIndex.from_frame(records.loc[~ok, keys])
        names = [column(metric) for metric in METRICS]
        filled.loc[~ok, names] = blank.loc[lost, names].to_numpy()
        for metric in METRICS:
            for blanks, some in ((False, records[ok]), (True, filled)):
                expected = some.groupby("object")[column(metric)].mean()
                assert sums.objects(cell[2]).tolist() == expected.index.tolist()
                actual = sums.per_object(cell, metric, blanks)
                assert actual == pytest.approx(expected.to_numpy(), rel=0, abs=EXACT, nan_ok=True)
            rows = [sampled.row for sampled in mean_rows("s", sums, [metric], {})]
            (row,) = [r for r in rows if (r.method, r.condition, r.class_name) == cell]
            scores = records.loc[ok, column(metric)].dropna()
            assert row.value == pytest.approx(scores.mean(), abs=1e-13)  # of up to 27 numbers
            assert row.failures_as_blank == pytest.approx(filled[column(metric)].mean(), abs=1e-13)
            assert row.n_ok == len(scores)
            reasons = f"{(~ok).sum()} x timeout: 3 s" if (~ok).any() else ""
            assert row.note.startswith(reasons)
    assert any(row.row.failed for row in mean_rows("s", sums, METRICS, {}))


def test_equal_images_have_equal_sums_wherever_a_part_ends(tmp_path):
    """Otherwise methods that draw the same would differ by rounding, and be told apart by it."""
    scores = np.random.default_rng(2).random(20).tolist()
    records = [
        make_record(method, obj=obj, view=view, ssim=score)
        for method in ("blank", "splat", "poisson")
        for obj in "abc"
        for view, score in enumerate(scores)
    ]
    write_all(tmp_path, records, row_group=50)
    sums = sum_records(tmp_path, names_of(to_frame(records)))
    means = {sums.per_object(cell, "ssim").tobytes() for cell in sums.cells}
    assert len(means) == 1
    assert len({float(np.frombuffer(next(iter(means)))[i]) for i in range(3)}) == 1


@pytest.mark.parametrize(
    ("changed", "named"),
    [({"method": "mine"}, "mine"), ({"condition": "64"}, "64"), ({"object": "z"}, "'z'")],
)
def test_records_that_the_manifest_does_not_have_are_named(tmp_path, changed, named):
    write_all(tmp_path, [make_record(), replace(make_record(), **changed)])
    names = {"methods": METHODS, "conditions": CONDITIONS, "objects": ["chair/a"]}
    with pytest.raises(BadInput, match=f"{named}.*, which the manifest does not have; start"):
        sum_records(tmp_path, names)
