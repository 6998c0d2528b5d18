"""Runs on a cluster of two nodes, which are processes of this machine."""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest
from harness_objects import Killed, Tetrahedron

from bench.records.run_folder import read_manifest
from bench.running.environment import environment
from bench.running.isolation import submit_all
from bench.running.ray import RayPool, connected

from ..builders import (
    assert_equal_runs,
    make_job,
    make_protocol,
    stored_keys,
    true_images,
)
from ..conftest import start_run

pytestmark = [pytest.mark.slow, pytest.mark.ray]

pytest.importorskip("ray", reason="the extra [ray] is not installed")

TELLING_NOTHING = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0"}


@pytest.fixture
def cluster(monkeypatch):
    """A head that does no jobs. Workers find the tests' objects."""
    from ray.cluster_utils import Cluster

    for name, value in TELLING_NOTHING.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]), prepend=os.pathsep)
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    yield made
    made.shutdown()


def start(arguments, directory, *more):
    return start_run((*arguments, *more), directory, **TELLING_NOTHING)


def end(process):
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    return out, err


def test_two_nodes_make_the_tables_that_one_machine_makes(cluster, finished, arguments, tmp_path):
    for _ in range(2):
        cluster.add_node(num_cpus=1)
    _, err = end(start(arguments, tmp_path / "run", "--ray", cluster.address))
    assert "21 jobs done, 0 from before, 0 failed" in err
    assert_equal_runs(tmp_path / "run", finished[0])
    message = read_manifest(tmp_path / "run")
    assert (message["workers"], message["cluster"]["nodes"]) == (2, 3)
    _, err = end(start(arguments, tmp_path / "run", "--workers", "1"))  # without the cluster
    assert "0 jobs done, 21 from before" in err


def test_a_node_is_lost_in_the_middle(cluster, finished, arguments, tmp_path):
    lost = cluster.add_node(num_cpus=1)
    cluster.add_node(num_cpus=1)
    directory = tmp_path / "run"
    process = start(arguments, directory, "--ray", cluster.address)
    while len(stored_keys(directory)) < 4:  # 3 ground truths, and an item
        assert process.poll() is None
        time.sleep(0.01)
    cluster.remove_node(lost, allow_graceful=False)
    end(process)
    assert len(stored_keys(directory)) == 21
    assert_equal_runs(directory, finished[0])


def test_no_cluster_answers(arguments, tmp_path):
    process = start(arguments, tmp_path / "run", "--ray", "127.0.0.1:1")
    _, err = process.communicate(timeout=120)
    assert process.returncode == 2
    assert err.startswith("bench: --ray 127.0.0.1:1: no cluster answers")
    assert "ray start --head" in err
    assert not (tmp_path / "run").exists()


def test_a_node_with_a_gpu_makes_the_same_tables(cluster, finished, arguments, tmp_path):
    """The GPU is only said to be there: the network draws on the CPU."""
    cluster.add_node(num_cpus=2, num_gpus=1)
    _, err = end(start(arguments, tmp_path / "run", "--ray", cluster.address))
    assert "21 jobs done, 0 from before, 0 failed" in err
    assert_equal_runs(tmp_path / "run", finished[0])
    assert read_manifest(tmp_path / "run")["cluster"]["gpus"] == 1


def test_a_job_takes_a_quarter_of_a_gpu_and_a_lost_process_costs_one_job(cluster):
    cluster.add_node(num_cpus=1, num_gpus=1)
    method = "splat-net@chair"
    objects = (Tetrahedron("1"), Killed("2"), Tetrahedron("3"))
    jobs = [make_job(obj, method, reference=true_images(obj)) for obj in objects]
    protocol = make_protocol(methods=(method,), device="auto", environment=environment())
    with connected(cluster.address, 1) as found, closing(RayPool(found, protocol)) as pool:
        import ray

        with ThreadPoolExecutor() as thread:
            results = thread.submit(lambda: list(submit_all(jobs, pool)))
            left = {1.0}
            while not results.done():
                left.add(ray.available_resources().get("GPU", 0.0))
                time.sleep(0.05)
        reasons = {result.key: result.reason for result in results.result()}
    assert left == {1.0, 0.75}
    expected = ("", "crash: the worker died (SIGKILL)", "")
    assert reasons == dict(zip([job.key for job in jobs], expected, strict=True))
