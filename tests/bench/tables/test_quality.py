from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from bench.analysis.intervals import clipped, mean_interval, median_interval
from bench.analysis.run import read_run
from bench.analysis.sets import FeatureDistances
from bench.catalogue.metrics import JUDGE
from bench.catalogue.suites import SUITES, TableSpec
from bench.metrics import frechet_distance
from bench.records.job import GROUND_TRUTH
from bench.tables.build import tables, write_outputs
from bench.tables.quality import detail_table, image_table, recognition_table, set_table

from ..builders import (
    FeaturesAtHand,
    drop_features,
    feature_index,
    frechet_interval,
    make_failed,
    make_record,
    rows_of,
    scored_records,
    to_frame,
    write_all,
    write_run,
    write_run_with_tables,
)

pytestmark = pytest.mark.usefixtures("few_objects")

SUITE = SUITES[0]
SPEC = TableSpec("images", "t", "T")
PAPER_LAYOUT = replace(SPEC, paper_layout=True)
EXACT = 1e-12  # a handful of float64 additions


def cell(table, **chosen):
    """The one row with these values."""
    (row,) = [r for r in rows_of(table) if chosen.items() <= vars(r).items()]
    return row


# splat: a 0.2 0.4, b 0.6 0.8, c and d failed.
WORKED = [
    *(make_record(obj=o, view=v, ssim=s) for o, v, s in [
        ("a", 0, 0.2), ("a", 1, 0.4), ("b", 0, 0.6), ("b", 1, 0.8),
    ]),
    *(make_failed(obj="c", view=v, reason="apss: no faces") for v in (0, 1)),
    *(make_failed(obj="d", view=v, reason="timeout: 120 s") for v in (0, 1)),
    # what a blank image would have scored
    *(make_record("blank", obj=o, view=v, ssim=s) for o, v, s in [
        ("a", 0, 0.05), ("a", 1, 0.05), ("b", 0, 0.05), ("b", 1, 0.05),
        ("c", 0, 0.01), ("c", 1, 0.02), ("d", 0, 0.05), ("d", 1, 0.03),
    ]),
    # and what must not be mistaken for it
    make_record("blank", "512", obj="c", view=0, ssim=0.99),
    make_record("blank", obj="c", view=0, ssim=0.99, class_name="sofa"),
]  # fmt: skip


def worked_table(records=WORKED, published=None):
    run = scored_records(to_frame(records), SUITE)
    return image_table(run, PAPER_LAYOUT, published or {})


def test_a_metric_that_was_not_measured_says_why():
    run = scored_records(to_frame(WORKED), SUITE, skipped={"structure": "skipped: no weights"})
    row = cell(image_table(run, SPEC, {}), method="splat", condition="2048", metric="structure")
    assert (row.note, row.skipped, row.n_ok) == ("skipped: no weights", True, 4)
    assert np.isnan([row.value, row.ci_low, row.failures_as_blank]).all()


def test_a_table_worked_by_hand():
    at = [("chair", "ssim", "2048"), ("chair", "ssim", "512"), ("chair", "contrast", "2048")]
    values = zip((*at, ("sofa", "ssim", "2048")), (0.7, 0.1, 0.2, 0.3), strict=True)
    published = {(*cell, "splat"): value for cell, value in values}
    table = worked_table(published=published)
    row = cell(table, method="splat", condition="2048", metric="ssim")
    assert row.value == pytest.approx((0.2 + 0.4 + 0.6 + 0.8) / 4, abs=EXACT)
    # per object: 0.3 and 0.7
    interval = clipped(mean_interval(np.array([0.3, 0.7])), (-1.0, 1.0))
    assert interval[1] == 1.0  # no SSIM is above, though Student's interval reaches there
    assert (row.ci_low, row.ci_high) == pytest.approx(interval, abs=EXACT)
    assert (row.n_ok, row.n) == (4, 8)
    assert row.failures_as_blank == pytest.approx((2.0 + 0.01 + 0.02 + 0.05 + 0.03) / 8, abs=EXACT)
    assert row.note == "2 x apss: no faces; 2 x timeout: 120 s"
    assert (row.suite, row.class_name, row.paper) == ("chair-robustness", "chair", 0.7)


@pytest.mark.parametrize(("objects", "marks"), [(59, True), (60, False)])
def test_intervals_of_few_objects_on_which_a_method_fails_are_marked(objects, marks):
    records = []
    for i in range(objects):
        obj = f"o{i:02}"
        records.append(make_record("blank", obj=obj, ssim=0.1))
        records.append(make_record("poisson", obj=obj, ssim=0.6 + i / 1000))
        splat = make_record(obj=obj, ssim=0.7 + i / 1000)
        records.append(make_failed(obj=obj) if i % 20 == 7 else splat)
    text = worked_table(records).to_markdown()
    of_method = {
        name: next(line for line in text.splitlines() if line.startswith(f"| {name} |"))
        for name in ("poisson", "splat")
    }
    assert ("†]" in of_method["splat"]) == marks
    assert ("* †: images failed, and objects are few;" in text) == marks
    assert "]" in of_method["poisson"]
    assert "†" not in of_method["poisson"]


def test_a_cell_without_any_image():
    records = [make_failed(obj=o, view=v) for o in "ab" for v in (0, 1)]
    floor = [make_record("blank", obj=o, view=v, ssim=0.25) for o in "ab" for v in (0, 1)]
    row = cell(worked_table(records + floor), method="splat", metric="ssim")
    assert np.isnan([row.value, row.ci_low, row.ci_high]).all()
    assert (row.n_ok, row.n, row.failures_as_blank) == (0, 4, 0.25)
    assert row.note == "4 x timeout: 3 s"


THIN = [  # of b's images one has no thin part, and c has none at all
    *(make_record(m, obj=o, view=v, thin_recall=recall, thin_precision=precision)
      for m, o, v, recall, precision in [
        ("splat", "a", 0, 0.2, None), ("splat", "a", 1, 0.4, 0.5), ("splat", "b", 0, 0.9, 0.7),
        ("splat", "b", 1, None, None), ("splat", "c", 0, None, None),
        ("blank", "d", 0, 0.0, None), ("blank", "e", 0, None, None),
    ]),
    *(make_failed(obj=o, view=0, reason="crash") for o in "de"),
]  # fmt: skip


def test_means_are_over_the_objects_that_have_a_value():
    made = detail_table(scored_records(to_frame(THIN), SUITE), SPEC, {})
    row = cell(made, method="splat", metric="thin-recall")
    assert row.value == pytest.approx(0.6, abs=EXACT)  # a: 0.2 and 0.4; b: 0.9; c has none
    interval = clipped(mean_interval(np.array([0.3, 0.9])), (0.0, 1.0))
    assert (row.ci_low, row.ci_high) == pytest.approx(interval, abs=EXACT)
    assert (row.n_ok, row.n) == (3, 7)
    # of the two failed images one shows no thin part, and the other would recall nothing
    assert row.failures_as_blank == pytest.approx((0.3 + 0.9 + 0.0) / 3, abs=EXACT)
    assert row.note == "2 x crash; 2 x no value: the true object shows no part thinner than 4 px"
    precision = cell(made, method="splat", metric="thin-precision")
    assert precision.value == precision.failures_as_blank == pytest.approx(0.6, abs=EXACT)
    assert (precision.n_ok, precision.n) == (2, 7)
    assert cell(made, method="splat", metric="ssim-object").n_ok == 5
    row = cell(made, method="blank", metric="thin-precision")  # it never has a value
    assert np.isnan([row.value, row.ci_low, row.ci_high, row.failures_as_blank]).all()
    assert (row.n_ok, row.n) == (0, 2)
    assert row.note == "2 x no value: no part thinner than 4 px, or nothing drawn beside one"


def test_a_score_that_must_be_there_is_not_passed_over():
    records = [make_record(obj="a", ssim=None), make_record(obj="b")]
    assert np.isnan(cell(worked_table(records), metric="ssim").value)


def judged(images, seen):
    """Answers by method: `seen(method, object, view)` gives azimuth, elevation and code."""
    rows, values = [], []
    for method, condition in ((GROUND_TRUTH, ""), ("splat", "2048"), ("blank", "2048")):
        for obj, view in images:
            azimuth, elevation, code = seen(method, obj, view)
            turn = np.radians(azimuth)
            rows.append((method, condition, "chair", obj, view))
            values.append([np.sin(turn), np.cos(turn), elevation / 40, *code])
    index = pd.DataFrame(rows, columns=["method", "condition", "class", "object", "view"])
    return FeaturesAtHand(index, np.array(values, np.float32))


def controls(records, answers, skipped=""):
    features = {} if answers is None else {JUDGE: FeatureDistances(answers)}
    run = scored_records(to_frame(records), SUITE, features, {JUDGE: skipped})
    with TemporaryDirectory() as folder:
        write_all(Path(folder), records)
        return recognition_table(replace(run, directory=Path(folder)), SPEC, {})


CODES = {"a": (1.0, 0.0), "b": (0.0, 1.0), "c": (-1.0, 0.0)}
OFF = {("a", 0): 10, ("a", 1): -20, ("b", 0): 5, ("b", 1): 0, ("c", 0): 180, ("c", 1): 30}


def seen(method, obj, view):
    """Truth as it is; splat turned by `OFF`, 2 degrees too high, c taken for b; blank never."""
    azimuth, elevation = (10.0, 5.0) if view == 0 else (-120.0, -30.0)  # those of `make_record`
    if method == GROUND_TRUTH:
        return azimuth, elevation, CODES[obj]
    if method == "blank":
        return 0.0, 0.0, CODES["a"]
    return azimuth + OFF[obj, view], elevation + 2, CODES["b" if obj == "c" else obj]


def judged_records():
    return [make_record(m, obj=o, view=v) for m in ("splat", "blank") for o, v in OFF]


def test_a_control_table_worked_by_hand():
    table = controls(judged_records(), judged(list(OFF), seen))
    azimuth = cell(table, method="splat", metric="azimuth-error-deg")
    # float32 sines: 4e-6 degrees
    assert azimuth.value == pytest.approx(15.0, abs=1e-4)  # of 0 5 10 20 30 180
    names = np.array([obj for obj, _ in OFF])
    interval = median_interval(np.abs(np.array(list(OFF.values()), float)), names)
    assert (azimuth.ci_low, azimuth.ci_high) == pytest.approx(interval, abs=1e-4)
    assert cell(table, method="splat", metric="elevation-error-deg").value == pytest.approx(2.0)
    found = cell(table, method="splat", metric="retrieval")
    assert found.value == found.failures_as_blank == pytest.approx(2 / 3)
    assert (found.ci_low, found.ci_high) == (0.0, 1.0)  # of 1, 1 and 0: Student's is longer
    assert (found.n_ok, found.n, found.note) == (6, 6, "")
    assert cell(table, method="blank", metric="retrieval").value == pytest.approx(1 / 3)
    assert cell(table, method="blank", metric="azimuth-error-deg").value == pytest.approx(65.0)
    assert "(3 of class chair)" in table.remark


def test_an_object_with_more_images_is_found_no_more_often():
    """c, which is never found, has a third image: 2 of 3 objects are found, and 4 of 7 images."""
    images = [*OFF, ("c", 2)]
    records = [make_record(m, obj=o, view=v) for m in ("splat", "blank") for o, v in images]
    answers = judged(images, lambda method, obj, view: seen(method, obj, min(view, 1)))
    found = cell(controls(records, answers), method="splat", metric="retrieval")
    assert found.value == found.failures_as_blank == pytest.approx(2 / 3)
    assert found.n_ok == 7


def test_failed_images_are_judged_as_blank():
    records = judged_records()
    records[:2] = [make_failed(obj="a", view=view, reason="crash") for view in (0, 1)]
    table = controls(records, judged(list(OFF), seen))
    azimuth = cell(table, method="splat", metric="azimuth-error-deg")
    assert azimuth.value == pytest.approx(17.5, abs=1e-4)  # of 0 5 30 180
    # a blank image is seen from 0 degrees, 10 and 120 off: of 0 5 10 30 120 180
    assert azimuth.failures_as_blank == pytest.approx(20.0, abs=1e-4)
    found = cell(table, method="splat", metric="retrieval")
    assert (found.value, found.failures_as_blank) == (0.5, 4 / 6)  # the blank ones are taken for a
    assert (found.n_ok, found.n, found.note) == (4, 6, "2 x crash")


@pytest.mark.parametrize(
    ("images", "why"),
    [
        ([("a", 0), ("a", 1)], "1 object: there is nothing to tell it from; run at least 2"),
        ([("a", 0), ("b", 0)], "1 view an object: none is left to know it by; run at least 2"),
    ],
)
def test_too_few_to_find_anything(images, why):
    table = controls([make_record(obj=o, view=v) for o, v in images], judged(images, seen))
    row = cell(table, method="splat", metric="retrieval")
    assert np.isnan([row.value, row.ci_low, row.failures_as_blank]).all()
    assert row.note == why
    assert np.isfinite(cell(table, method="splat", metric="azimuth-error-deg").value)
    assert f"* splat: {why}" in table.to_markdown().splitlines()


IMAGES = [(obj, view) for obj in "abcd" for view in (0, 1)]
RNG = np.random.default_rng(3)
FEATURES = {
    method: RNG.normal(i, 1 + i, (len(IMAGES), 3)).astype(np.float32)
    for i, method in enumerate((GROUND_TRUTH, "splat", "blank"))
}


def features(without=()):
    """Features of ground truth, splat and blank; those of splat `without` some images."""
    index = feature_index(("splat", "blank"), {"chair": "abcd"})
    values = np.concatenate([*FEATURES.values()])
    of_splat = {("splat", image) for image in without}
    lost = [(row.method, (row.object, row.view)) in of_splat for row in index.itertuples()]
    kept = np.random.default_rng(4).permutation(np.flatnonzero(~np.array(lost)))
    return FeaturesAtHand(index.iloc[kept], values[kept])


def distances(without=()):
    records = [
        make_failed(method, obj=obj, view=view, reason="crash")
        if method == "splat" and (obj, view) in without
        else make_record(method, obj=obj, view=view)
        for method in ("splat", "blank")
        for obj, view in IMAGES
    ]
    taken = {"fd-views": FeatureDistances(features(without))}
    taken["fd-views-grey"] = taken["fd-views"]
    skipped = {"fid": "skipped: weights"}
    return set_table(scored_records(to_frame(records), SUITE, taken, skipped), SPEC, {})


@pytest.mark.parametrize("without", [(), (("b", 0), ("b", 1), ("d", 0), ("d", 1))])
def test_missing_images_are_left_out_of_both_sets_or_blank(without):
    row = cell(distances(without), method="splat", metric="fd-views")
    kept = [i for i, image in enumerate(IMAGES) if image not in without]
    x, y, blank = FEATURES["splat"], FEATURES[GROUND_TRUTH], FEATURES["blank"]
    assert row.value == pytest.approx(frechet_distance(x[kept], y[kept]), rel=EXACT)
    objects = np.repeat(list("abcd"), 2)[kept]
    interval = frechet_interval(x[kept], y[kept], objects, objects)
    assert (row.ci_low, row.ci_high) == pytest.approx(interval, rel=EXACT)
    filled = np.where(np.isin(np.arange(len(IMAGES)), kept)[:, None], x, blank)
    assert row.failures_as_blank == pytest.approx(frechet_distance(filled, y), rel=EXACT)
    note = f"{len(without)} x crash" if without else ""
    assert (row.n_ok, row.n, row.note) == (len(kept), 8, note)


def test_distances_without_the_bias_of_few_objects_stand_below():
    table = distances()
    row = cell(table, method="splat", metric="fd-views")
    x, y, objects = FEATURES["splat"], FEATURES[GROUND_TRUTH], np.repeat(list("abcd"), 2)
    without = [frechet_distance(x[objects != o], y[objects != o]) for o in "abcd"]
    assert row.debiased == pytest.approx(4 * row.value - 3 * np.mean(without), rel=EXACT)
    lines = table.to_markdown().splitlines()
    of_splat = lines[lines.index("## fd-views, debiased, chair") :]
    shown = next(line for line in of_splat if line.startswith("| splat |"))
    assert shown == f"| splat | {row.debiased:.1f} 8/8 |"
    assert all(np.isnan(r.debiased) for r in rows_of(table) if r.metric == "fid")


@pytest.mark.parametrize("there", [0, 1])
def test_fewer_than_two_images_have_no_distance(there):
    row = cell(distances(IMAGES[there:]), method="splat", metric="fd-views")
    assert np.isnan([row.value, row.ci_low, row.ci_high, row.failures_as_blank]).all()
    assert (row.n_ok, row.n, row.note) == (there, 8, "fewer than two images")


def test_markdown_of_names_from_a_file_system():
    """A class, a method and a reason that would each break out of their place."""
    odd = {"class_name": "x\n# y|z", "method": "pc2pix@`<b>`\x1b[2J.safetensors"}
    failed = make_failed(**odd, reason="no *faces*\n* other: [a](b)\u202e")
    run = scored_records(to_frame([failed]), SUITE, objectives={odd["method"]: "a`b"})
    table = image_table(run, SPEC, {})
    lines = table.to_markdown().split("\n")
    assert all(line.isprintable() for line in lines)
    assert "## ssim, x\\\\n\\# y\\|z" in lines
    method = "pc2pix@\\`\\<b\\>\\`\\\\x1b\\[2J.safetensors"
    assert f"| {method} | - 0/1 |" in lines
    reason = r"no \*faces\*\\n\* other: \[a\](b)\\u202e"
    assert f"* {method} at 2048: 1 x {reason}" in lines
    assert "``" in next(line for line in lines if ": trained with" in line)


def test_tables_are_reproduced_to_the_byte(tmp_path):
    run = write_run_with_tables(tmp_path)
    names = ("headline", "table3_ssim", "table4_fid", "table_control", "table_detail")
    before = {path.name: path.read_bytes() for path in (run / "tables").iterdir()}
    assert set(before) == {f"{name}.{kind}" for name in names for kind in ("csv", "md")}
    shutil.rmtree(run / "tables")
    write_outputs(read_run(run))
    assert {path.name: path.read_bytes() for path in (run / "tables").iterdir()} == before
    drop_features(run, "fd-views")
    row = cell(tables(read_run(run))[1], method="splat", condition="512", metric="fd-views")
    assert row.note == "skipped: no features in this run"


def test_tables_are_made_with_one_thread(tmp_path):
    """The features are read while tables are made, by as many threads as these have."""
    run = read_run(write_run(tmp_path))
    threads = []

    class Watched(FeatureDistances):
        def images(self, *cell):
            threads.extend(library["num_threads"] for library in threadpool_info())
            return super().images(*cell)

    watched = Watched(run.features["fd-views"])
    with threadpool_limits(2):
        tables(replace(run, features=run.features | {"fd-views": watched}))
    assert set(threads) == {1}
