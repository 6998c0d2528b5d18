from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bench.catalogue.methods import find_method
from bench.catalogue.suites import ROUNDING
from bench.records.arithmetic import PLAIN, Arithmetic
from bench.running.options import Options
from bench.running.plan import plan
from bench.running.protocol import protocol_of
from bench.suites.rounding.arithmetics import arithmetics, repeated, stages_of
from bench.suites.rounding.deviations import deviation, image_deviation
from bench.suites.rounding.run import run

SMALL = replace(ROUNDING, repetitions=3, stage_repetitions=2)


def ids(method, condition="2048"):
    return [each.id for each in arithmetics(find_method(method), condition, SMALL)]


def test_stages_follow_the_work():
    assert stages_of(find_method("surface-apss")) == (
        *("input", "normals", "ball-pivoting", "close-holes", "apss", "draw", "metrics"),
    )
    assert stages_of(find_method("splat-net")) == ("input", "network", "metrics")
    assert stages_of(find_method("fused-net@grey")) == ("input", "alpha-wrap", "network", "metrics")
    assert stages_of(find_method("blank")) == ("prepare", "draw", "metrics")


def test_a_network_is_computed_in_formats_and_stage_by_stage():
    assert ids("splat-net") == [
        *("plain", "random-00", "random-01", "random-02"),
        *("down", "up", "toward-zero", "two-threads", "one-view"),
        *("float64", "bfloat16", "float16"),
        *("random-input-00", "random-input-01", "random-network-00", "random-network-01"),
        *("random-metrics-00", "random-metrics-01"),
    ]
    assert ids("splat-net", "512") == ["plain", "random-00", "random-01", "random-02"]
    assert "float64" not in ids("splat")
    assert ids("true-mesh", "512") == []  # as at the first condition


def test_a_repeated_job_has_a_key_and_a_condition_of_its_own(no_machine):
    options = Options("rounding", methods=("splat",), conditions=("noise-0.10",), limit=1, views=1)
    protocol, _ = protocol_of(ROUNDING.base, options)
    job = plan(protocol)[0].method_jobs[0]
    again = repeated(job, Arithmetic("random", ("draw",), 7))
    assert again.condition == "noise-0.10~random-draw-07"
    assert (again.cloud_condition, again.batch, again.is_repeated) == ("noise-0.10", None, True)
    assert not job.is_repeated
    assert repeated(job, Arithmetic("one-view")).batch == 1
    keys = {repeated(job, each).key for each in (PLAIN, Arithmetic("up"), Arithmetic("random"))}
    assert len(keys | {job.key}) == 4


def test_a_deviation_is_the_root_mean_square_over_objects():
    values = np.array([[1.0, 10.0, np.nan], [3.0, 10.0, 1.0], [5.0, 10.0, 1.0]])
    # Variances 4 and 0; the third object has no value in one repetition.
    assert deviation(values) == (math.sqrt(2), 4)
    assert deviation(np.full((5, 2), 0.1 + 0.2)) == (0.0, 8)
    assert deviation(np.full((3, 2), np.nan))[1] == 0


def test_the_deviation_of_an_image_is_that_of_its_repetitions():
    rows = [("chair", "a", view, 0.1 * view + 0.01 * n) for view in (0, 1) for n in (0, 1, 2)]
    images = pd.DataFrame(rows, columns=["class", "object", "view", "ssim"])
    assert image_deviation(images, "ssim") == pytest.approx(0.01, rel=1e-12)


@pytest.mark.slow
def test_a_run_tells_digits_stages_and_formats(tmp_path):
    options = Options(
        "rounding",
        methods=("splat-net@tiny-grey", "splat"),
        conditions=("2048", "512"),
        limit=1,
        views=2,
        workers=2,
        out=tmp_path / "run",
    )
    result = run(options, SMALL)
    deviations, stages, moves = (pd.DataFrame(table.to_rows()) for table in result.tables)
    assert {*deviations["method"]} == {"splat-net@tiny-grey", "splat", "blank"}
    ssim = {
        (row["method"], row["condition"]): row["object_deviation"]
        for row in deviations[deviations["metric"] == "ssim"].to_dict("records")
    }
    # A network's images move by a grey level in few pixels; a splat is drawn at whole pixels.
    assert 0 < ssim["splat-net@tiny-grey", "2048"] < 1e-4
    assert ssim["splat", "512"] < 1e-9
    assert (deviations["degrees"].dropna() <= SMALL.repetitions - 1).all()
    of_network = stages[(stages["method"] == "splat-net@tiny-grey") & (stages["metric"] == "ssim")]
    assert list(of_network["stage"]) == ["all", "input", "network", "metrics"]
    grey = {
        (row["method"], row["arithmetic"]): row["move"]
        for row in moves[moves["metric"] == "grey-levels"].to_dict("records")
    }
    assert grey["splat-net@tiny-grey", "two-threads"] == 0
    formats = [grey["splat-net@tiny-grey", name] for name in ("float64", "float16", "bfloat16")]
    assert formats == sorted(formats)
    assert formats[0] < 0.01 < formats[2]
    assert {move for (method, _), move in grey.items() if method == "blank"} == {0}
    before = (tmp_path / "run" / "tables" / "rounding.csv").read_bytes()
    again = run(options, SMALL)
    assert (tmp_path / "run" / "tables" / "rounding.csv").read_bytes() == before
    assert [table.name for table in again.tables] == [
        "rounding",
        "rounding_stages",
        "rounding_moves",
    ]
