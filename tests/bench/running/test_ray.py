"""Runs on a cluster of two nodes, which are processes of this machine."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from bench.records.folder import read_manifest

from ..builders import (
    assert_equal_runs,
    stored_keys,
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
    """The GPU of one is only said to be there: the network draws on the CPU."""
    for gpus in (0, 1):
        cluster.add_node(num_cpus=1, num_gpus=gpus)
    _, err = end(start(arguments, tmp_path / "run", "--ray", cluster.address))
    assert "21 jobs done, 0 from before, 0 failed" in err
    assert_equal_runs(tmp_path / "run", finished[0])
    message = read_manifest(tmp_path / "run")
    assert message["workers"] == 2
    assert (message["cluster"]["nodes"], message["cluster"]["gpus"]) == (3, 1)
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
