"""Every table of a tiny run of each suite, and what compare prints, as kept files.

The scores, features and times are made up by the names of their jobs; nothing is drawn. Where a
change moves a table on purpose, `PC2PIX_KEEP=1 pytest tests/bench/tables/test_all_tables.py` writes
the files again, and their difference is read and committed with the change.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.records.folder import open_folder, write_manifest
from bench.suites.latent.codes import PATH_METRICS, PATHS
from bench.suites.latent.run import VALUES, latent_table, means
from bench.suites.speed.measure import SPEED, Measurement, TimingSample
from bench.suites.speed.tables import amortised_rows, amortised_table, samples_table, speed_table
from bench.suites.stability.outcomes import COLUMNS, matrix
from bench.tables import differences, paper
from bench.tables.paper import published
from bench.tables.table import Table, table_files

from ..builders import (
    EXTRACTORS,
    SCORES,
    make_failed,
    make_job,
    make_manifest,
    make_record,
    make_result,
    make_truth,
    result_of,
)
from ..harness_objects import Tetrahedron

KEPT = Path(__file__).parents[1] / "data" / "tables"
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")
FLOAT = re.compile(r"-?\d+\.\d{7,}(?:e-?\d+)?")  # is no rounded one
# Files keep nine digits, so that a number is off by up to 5e-9 of itself there. A machine's linear
# algebra moves a Fréchet distance of these features by less than 1e-12 of itself.
SAME = 1e-8
LATE = "timeout: 3 s"
BROKEN = "input: broken: points are not finite"
METHODS = ("surface-apss", "alpha-wrap", "pc2pix", "wrecked", "blank")
SWEEP = ("2048", "512", "noise-0.05", "noise-0.10", "broken")
RUNS = {
    "chair-robustness": {"conditions": SWEEP},
    "chair-robustness-truth-grey": {"conditions": SWEEP, "truth": "grey"},
    "speed-accuracy": {
        "methods": ("surface-apss@resolution=50", "surface-apss", "pc2pix", "wrecked", "blank"),
        "conditions": ("2048", "512", "broken"),
    },
    "thirteen-classes": {
        "methods": ("surface-apss", "pc2pix@all", "splat-net@grey", "wrecked", "blank"),
        "conditions": ("2048", "broken"),
        "classes": ("airplane", "chair"),
    },
    "beyond-training": {"conditions": (*SWEEP, "256", "outliers-0.05", "density-3")},
}
# Imported before `few_objects` alters the fewest objects with an interval, which they name.
SAID_BY = (differences, paper)
SAYS = {  # by name: the arguments after the command
    "compare-methods": ("compare", "RUN", "--methods", "pc2pix,surface-apss"),
}


def kept(name, text):
    """Compare a text with the file of that name, or write it."""
    path = KEPT / name
    if os.environ.get("PC2PIX_KEEP"):
        path.parent.mkdir(exist_ok=True)
        rounded = FLOAT.sub(lambda number: f"{float(number[0]):.9g}", text)
        path.write_text(rounded, encoding="utf-8")
    expected = path.read_text(encoding="utf-8")
    numbers = iter(NUMBER.findall(expected))

    def expected_where_same(number):
        other = next(numbers, "nan")
        same = math.isclose(float(number[0]), float(other), rel_tol=SAME)
        return other if same and FLOAT.fullmatch(number[0]) else number[0]

    assert NUMBER.sub(expected_where_same, text) == expected


def as_text(files):
    return "\n".join(f"=== {name}\n{files[name].rstrip()}\n" for name in sorted(files))


def tiny_run(directory, run_id, seed=0):
    """Two objects a class; `wrecked` always fails, and every method that sees a broken cloud."""
    asked = {"methods": METHODS, "classes": ("chair",)} | RUNS[run_id]
    truth = {"truth": asked["truth"]} if "truth" in asked else {}
    manifest = make_manifest(
        suite=run_id.removesuffix("-truth-grey"),
        methods=[*asked["methods"]],
        conditions=[*asked["conditions"]],
        objects=[f"{name}/{obj}" for name in asked["classes"] for obj in ("a", "b")],
        **truth,
    )
    write_manifest(directory, manifest)
    results, jobs = [], []
    for name in manifest["objects"]:
        class_name, _, object_id = name.partition("/")
        obj = Tetrahedron(object_id, class_name)
        true = np.random.default_rng([*name.encode()]).random((2, 4), np.float32)
        jobs.append(make_truth(obj))
        results.append(make_result(jobs[-1], **dict.fromkeys(EXTRACTORS, true)))
        for method in manifest["methods"]:
            for condition in manifest["conditions"]:
                cell = (method, condition, object_id)
                common = {"class_name": class_name, "suite": manifest["suite"]}
                # A white image has the same scores in both runs and under each condition.
                drawn = (
                    f"blank {name}" if method == "blank" else f"{seed} {method} {condition} {name}"
                )
                rng = np.random.default_rng([*drawn.encode()])
                times = {"prepare_s": rng.random(), "draw_s": rng.random() / 10}
                job = make_job(obj, method, condition)
                jobs.append(job)
                failed = method == "wrecked" or (condition == "broken" and method != "blank")
                if failed:
                    reason = LATE if method == "wrecked" else BROKEN
                    lost = [make_failed(*cell, view, reason, **common) for view in (0, 1)]
                    results.append(result_of(job.key, lost))
                    continue
                records = [
                    make_record(
                        *cell, view, **{score: rng.random() for score in SCORES}, **common, **times
                    )
                    for view in (0, 1)
                ]
                features = true + rng.random((2, 4), np.float32)
                results.append(make_result(job, records, 0, **dict.fromkeys(EXTRACTORS, features)))
    # Objects of one name have the same features, whatever their class.
    arrays = {job.name[:2] + job.name[3:]: r.arrays for job, r in zip(jobs, results, strict=True)}
    with open_folder(directory) as store:
        for job, result in zip(jobs, results, strict=True):
            store.append(replace(result, arrays=arrays[job.name[:2] + job.name[3:]]))
        store.list_jobs((job.key, job.name) for job in jobs)
    return directory


@pytest.mark.usefixtures("few_objects")
@pytest.mark.parametrize("run_id", RUNS)
def test_tables_of_suites(outputs_of, run_id):
    outputs = outputs_of(run_id)
    kept(f"{run_id}.txt", as_text(table_files([*outputs.tables, *outputs.further])))


@pytest.mark.usefixtures("few_objects")
@pytest.mark.parametrize("name", SAYS)
def test_what_commands_say_of_one_run(tmp_path, command, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    tiny_run(Path("run"), "chair-robustness")
    status, out, _ = command(*(text.replace("RUN", "run") for text in SAYS[name]))
    kept(f"{name}.txt", f"exit {status}\n{out}")


@pytest.mark.usefixtures("few_objects")
def test_what_compare_says_of_two_runs(tmp_path, command, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for folder, seed in (("old", 0), ("new", 1)):
        tiny_run(Path(folder), "chair-robustness", seed)
    for form in ("text", "csv"):
        status, out, _ = command("compare", "old", "new", "--format", form)
        kept(f"compare-runs.{form}", f"exit {status}\n{out}")


def test_tables_of_latent():
    rng = np.random.default_rng(0)
    rows = [
        ("pc2pix", path, "all", f"pair {i}", metric, rng.random())
        for path in PATHS
        for metric in PATH_METRICS
        for i in range(8)
    ]
    values = pd.DataFrame(rows, columns=VALUES)
    tables = [
        latent_table("latent", "Paths", "Remark.", PATH_METRICS, PATHS, means("latent", values)),
        Table("latent_values", "", values, digits=".6g"),
    ]
    kept("latent.txt", as_text(table_files(tables)))


def test_tables_of_speed():
    suite = replace(SPEED, methods=("surface-apss", "splat"), baselines=("surface-apss",))
    measured = []
    for key, (method, factor) in enumerate((("surface-apss", 1.0), ("splat", 0.01))):
        rng = np.random.default_rng(key)
        stages = [("prepare", 0), ("draw", 1), ("draw", 20)]
        samples = tuple(
            TimingSample(f"chair/{obj}", call, stage, views, *(factor * rng.random(2)))
            for obj in ("a", "b")
            for call in range(4)
            for stage, views in stages
        )
        sizes = {"threads": 1, "views": 20, "clouds": 2, "device": "cpu", "failures": ()}
        memory = {"idle_mib": 50.0, "peak_mib": 75.0, "elsewhere_cores": 0.0}
        measured.append(Measurement(f"{key}", method, "2048", samples=samples, **sizes, **memory))
    machine = {"cpu": "some cpu", "cores": 2}
    tables = [
        speed_table(measured, suite, machine, published("speed")),
        amortised_table(amortised_rows(measured, suite), suite, 20),
        samples_table(measured),
    ]
    kept("speed.txt", as_text(table_files(tables)))


def test_tables_of_stability():
    outcomes = [
        ("one-point", "points", "splat", "images", "images", "holds"),
        ("one-point", "points", "pc2pix", "images", "fails: no points", "unexpected"),
        ("turned", "views", "splat", "agrees", "0.01, at most 1", "holds"),
        ("turned", "views", "pc2pix", "fails", "fails: too few", "refused"),
    ]
    table = matrix("Remark.", pd.DataFrame(outcomes, columns=COLUMNS))
    kept("stability.txt", as_text(table_files([table])))
