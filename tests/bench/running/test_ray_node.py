"""What a node of a cluster does with a job, and when it refuses. Needs no Ray."""

from __future__ import annotations

import os
import pickle
import re
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from harness_objects import Killed, Refusing, Tetrahedron

from bench.catalogue.suites import Limits
from bench.running.ray import Node, mismatch, requirements
from bench.running.work import run_job
from data_prep.failures import MissingDependency

from ..builders import make_job, make_protocol, make_truth, true_images

LIMITS = Limits(60.0, 8.0)


MACHINE = {"gl": "llvmpipe", "numpy": "2"}


@pytest.fixture(autouse=True)
def back():
    """Return to the current folder, which a node changes."""
    here = Path.cwd()
    yield
    os.chdir(here)


def mismatch_of(requirements):
    return mismatch(requirements, lambda: MACHINE)


def changed(asked, **values):
    return replace(asked, values={**asked.values, **values})


@pytest.fixture
def asked(tmp_path):
    weights = tmp_path / "views.safetensors"
    weights.write_bytes(b"weights")
    protocol = make_protocol(
        methods=("splat-net@chair", "blank"),
        features=(("fd-views", str(weights)),),
        environment=MACHINE,
    )
    return requirements(protocol)


@contextmanager
def node(asked):
    """A node with a process of its own."""
    made = Node(asked, LIMITS, lambda: MACHINE)
    with closing(made._pool):
        yield made


def test_a_machine_meets_its_own_requirements_which_are_plain_values(asked):
    assert mismatch_of(asked) == ""
    assert pickle.loads(pickle.dumps(asked)) == asked


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"environment": {"gl": "other"}}, "environment: gl is llvmpipe, not other"),
        ({"versions": {"torch": "0.1"}}, r"versions: torch is 2\..*, not 0\.1; make it"),
        ({"versions": {"unheard-of": "1"}}, "versions: unheard-of is None, not 1"),
        ({"code": {"bench": "abc"}}, r"code: bench is [0-9a-f]{16}, not abc"),
        ({"methods": {"splat-net@chair": "x"}}, "methods: splat-net@chair is .*, not x"),
        ({"methods": {"pc2pix@/none.safetensors": "x"}}, "methods: .*none.safetensors: no"),
        ({"weights": {"/none": "x"}}, "weights: /none is no such file"),
    ],
)
def test_what_differs_is_named(asked, change, message):
    assert re.search(message, mismatch_of(changed(asked, **change)))


def test_weights_that_were_exchanged_and_a_machine_without_opengl(asked):
    (path,) = asked.values["weights"]
    Path(path).write_bytes(b"other")
    assert "weights: " in mismatch_of(asked)

    def environment():
        raise MissingDependency("no OpenGL context: install libegl1")

    assert mismatch(asked, environment) == "no OpenGL context: install libegl1"


def test_a_job_gives_what_it_gives_at_home(asked, tmp_path):
    job = make_job(method="blank", reference=true_images())
    at_home = run_job(job)
    with node(asked) as made:
        results = [made.run_job(job, job.object.fingerprint()) for _ in range(2)]
    for found in results:
        assert (found.views, found.arrays) == (at_home.views, at_home.arrays)


def test_a_job_that_fails_or_dies_is_a_result(asked, tmp_path):
    expected = {
        Refusing: "input: no such shape; draw one",
        Killed: "crash: the worker died (SIGKILL)",
        Tetrahedron: "",
    }
    with node(asked) as made:
        for number, (kind, reason) in enumerate(expected.items()):
            truth = make_truth(kind(str(number)))
            result = made.run_job(truth, truth.object.fingerprint())
            assert (result.reason, result.unusable) == (reason, None)
            assert (result.arrays == {}) == bool(reason)


def test_another_dataset_on_a_node_ends_the_run(asked, tmp_path):
    job = make_truth()
    with node(asked) as made:
        result = made.run_job(job, "another")
    assert result.arrays == {}
    assert "chair/a is not what it is in the run (tetrahedron a, not another)" in result.unusable
    assert "put the same dataset into the same folder on all nodes" in result.unusable


def test_a_node_that_does_not_match_does_nothing(asked, tmp_path):
    job = make_truth()
    with node(changed(asked, versions={"torch": "0.1"})) as made:
        result = made.run_job(job, job.object.fingerprint())
    assert result.unusable.startswith("node ")
    assert "torch is" in result.unusable


def test_relative_paths_start_where_the_run_was_started(asked, tmp_path):
    for folder in (tmp_path, tmp_path / "none"):
        with node(replace(asked, folder=str(folder))):
            assert Path.cwd() == tmp_path
