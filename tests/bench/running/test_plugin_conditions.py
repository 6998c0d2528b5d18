"""Conditions of other packages in runs, exports and lists, whether they keep to their contract."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from harness_objects import Tetrahedron

from bench.catalogue.conditions import (
    CONDITIONS,
    MOST_POINTS,
    OUR_CONDITIONS,
    find_condition,
)
from bench.records.folder import CONDITION_IDENTITIES, read_manifest
from bench.running.export import export
from bench.running.options import Options
from bench.running.plan import plan
from bench.running.protocol import Protocol
from bench.running.work import cloud_of, run_job
from data_prep.clouds.conditions import Condition
from data_prep.failures import BadInput, MissingDependency
from data_prep.randomness import generator
from data_prep.scene import PointCloud
from tests.bench.check.broken_conditions import Moved

from .. import plugin_conditions
from ..builders import make_protocol

CLOUD = PointCloud(np.linspace(-0.5, 0.5, 96, dtype=np.float32).reshape(32, 3))
BROKEN = {  # by condition: the reason of its failed records
    "a-no-points": f"gives 0 points, expected 1 to {MOST_POINTS:,}",
    "a-not-finite": "gives 1 points that are not finite",
    "a-an-array": "gives a ndarray, expected a PointCloud",
    "a-two-columns": "ValueError: points: expected shape [N, 3], got [2048, 2]",
    "a-many-points": "gives 204,800 points, expected 1 to 100,000",
    "a-input": "changes the cloud that it is given; work on a copy",
    "a-raises": "ValueError: no room",
    "a-exits": "SystemExit: 0",
}


@pytest.fixture
def package(tmp_path, monkeypatch):
    with plugin_conditions.installed(tmp_path / "site", monkeypatch):
        yield


def planned(conditions, **changes):
    changes = {"objects": (Tetrahedron("a"),), "methods": ("splat", "blank")} | changes
    return plan(make_protocol(conditions=conditions, **changes))


def test_it_is_found_by_its_id_and_its_perturbation_by_that_id(package):
    found = find_condition("good")
    assert (found.id, found.source) == ("good", "made up")
    expected = Moved().apply(CLOUD, generator(3)).points
    np.testing.assert_array_equal(found.perturbation.apply(CLOUD, generator(3)).points, expected)
    assert (
        repr(found.perturbation) == "PluginPerturbation(condition='good', key=\"Moved(fault='')\")"
    )
    assert find_condition("2048") is CONDITIONS[0]


def test_every_id_of_this_project_is_kept():
    assert {condition.id for condition in CONDITIONS} < OUR_CONDITIONS


@pytest.mark.parametrize(("name", "reason"), BROKEN.items())
def test_one_that_breaks_is_a_failure_with_its_reason(package, name, reason):
    """Methods that see no cloud are drawn: their keys do not name the condition."""
    obj = planned((name,), methods=("splat", "true-mesh", "blank"))[0]
    truth = run_job(obj.truth)
    drawn = {
        job.method: run_job(replace(job, reference=truth.arrays["images"]))
        for job in obj.method_jobs
    }
    assert drawn["splat"].reason == f"condition {name}: {reason}"
    assert drawn["splat"].unusable is None  # other jobs go on
    for method in ("true-mesh", "blank"):
        assert drawn[method].has_images


@pytest.mark.parametrize(
    "change", [{"version": 2}, {"identity": lambda: "scans 7"}, {"perturbation": Moved("few")}]
)
def test_a_changed_condition_is_computed_again_and_nothing_else_is(tmp_path, monkeypatch, change):
    """Its jobs of methods that see the cloud: those of the others stay."""
    keys = []
    first = Condition("good", Moved(), "")
    for condition in (first, replace(first, **change)):
        monkeypatch.setitem(vars(plugin_conditions.broken_conditions), "GOOD", condition)
        folder = tmp_path / str(len(keys))
        with plugin_conditions.installed(folder, monkeypatch):
            jobs = planned(("2048", "good"))[0].method_jobs
        keys.append({(job.method, job.condition): job.key for job in jobs})
    assert {cell for cell in keys[0] if keys[0][cell] != keys[1][cell]} == {("splat", "good")}


def test_a_worker_with_another_version_of_the_package_ends_the_run(package, monkeypatch):
    (job, _) = planned(("good",))[0].method_jobs
    changed = replace(plugin_conditions.broken_conditions.GOOD, version=2)
    monkeypatch.setitem(vars(plugin_conditions.broken_conditions), "GOOD", changed)
    for cache in plugin_conditions.CACHES:
        cache.cache_clear()  # as in a process of another machine
    with pytest.raises(MissingDependency, match="install the same version of its package"):
        cloud_of(job)
    assert "is Moved(fault='') version 2 " in run_job(job).unusable


def test_the_manifest_has_the_keys_of_conditions_of_packages_alone(package, no_machine):
    options = Options("chair-robustness", methods=("splat",), limit=1)
    for conditions, entry in (
        (("2048", "good"), {"good": find_condition("good").key}),
        (("2048",), None),
    ):
        protocol = Protocol.from_options(replace(options, conditions=conditions))
        assert protocol.to_manifest({}, 1, 1).get(CONDITION_IDENTITIES) == entry


def test_an_export_has_it_and_names_one_that_breaks(package, no_machine, tmp_path):
    options = Options("chair-robustness", limit=1, views=1, workers=1)
    export(replace(options, conditions=("good",)), tmp_path / "good")
    clouds = pd.read_csv(tmp_path / "good" / "clouds.csv")
    assert list(clouds["condition"]) == ["2048", "good"]
    broken = replace(options, conditions=("good", "a-no-points"))
    with pytest.raises(BadInput, match=r"condition a-no-points: gives 0 points, .*; leave that"):
        export(broken, tmp_path / "broken")
    assert not (tmp_path / "broken").exists()


@pytest.mark.slow
def test_a_run_with_a_broken_one_ends_with_its_tables(package, tmp_path, command):
    """One condition ends its process, another raises; the others are unharmed."""
    names = ("2048", "good", "a-raises", "a-leaves")
    small = ("--limit", "1", "--views", "1", "--workers", "2", "--out", tmp_path / "run")
    run = ("run", "--suite", "chair-robustness", "--methods", "splat")
    status, out, err = command(*run, "--conditions", ",".join(names), *small)
    assert status == 0, err
    records = pd.read_parquet(tmp_path / "run" / "records.parquet")
    splat = records[records["method"] == "splat"].set_index("condition")
    assert splat["outcome"].to_dict() == dict(
        zip(names, ("ok", "ok", "failed", "failed"), strict=True)
    )
    assert splat["reason"]["a-raises"] == "condition a-raises: ValueError: no room"
    assert splat["reason"]["a-leaves"].startswith("crash: ")
    blank = records[records["method"] == "blank"]
    assert (len(blank), {*blank["outcome"]}) == (len(names), {"ok"})
    manifest = read_manifest(tmp_path / "run")
    assert {*manifest[CONDITION_IDENTITIES]} == {*names[1:]}
    status, _, err = command(*run, "--conditions", ",".join(names), *small)
    assert status == 0
    assert "0 jobs done" in out + err or "are there from before" in err
