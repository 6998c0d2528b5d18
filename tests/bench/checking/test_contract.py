"""Every broken point of the contract is named, and what keeps it passes."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from bench.catalogue import plugins
from bench.catalogue.plugins import ImageMetric, SetMetric
from bench.checking.contract import datasets, methods, metrics
from data_prep.dataset import Dataset
from data_prep.datasets import ProceduralObject
from tests.bench.checking.broken_methods import METHODS
from tests.robustness.faulty_methods import announce

REPOSITORY = Path(__file__).parents[3]
BROKEN = {  # method: the point, and what is said of it
    "wrong-shape": ("images", "images have the shape (3, 64, 128, 3), expected (3, 128, 128, 3)"),
    "out-of-range": ("images", "expected 0 .. 1"),
    "not-finite": ("images", "9 values are not finite"),
    "unseeded": ("repeatable", "take all randomness from `rng`"),
    "looks-at-other-views": ("views apart", "an image may not depend on the other views"),
    "hangs": ("no points", "timeout: no result within 20 s"),
    "dies": ("one point", "crash: "),
    "raises-anything": ("three points", "KeyError: 'no triangle'; raise StageFailure"),
}


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """The command line where the methods are announced."""
    folder = tmp_path_factory.mktemp("announced")
    module = "tests.bench.checking.broken_methods"
    announce(folder, {id_: f"{module}:{id_.replace('-', '_').upper()}" for id_ in METHODS})
    paths = os.pathsep.join((str(folder), str(REPOSITORY)))

    def run(*arguments):
        return subprocess.run(
            (sys.executable, "-c", "from bench.cli import main; main()", *arguments),
            capture_output=True,
            text=True,
            check=False,
            env=os.environ | {"PYTHONPATH": paths},
            cwd=folder,
        )

    return run


@pytest.mark.slow
def test_a_method_that_keeps_it(bench):
    done = bench("test", "plain")
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert all(line.startswith("ok   ") for line in lines)
    assert len(lines) == 2 + len(methods.CHECKS) + len(methods.EXTREMES)


@pytest.mark.slow
@pytest.mark.parametrize("method", BROKEN)
def test_every_fault_is_named(bench, method):
    point, said = BROKEN[method]
    done = bench("test", method)
    assert (done.returncode, done.stderr) == (1, "")
    failed = {
        subject.removeprefix("FAIL "): text
        for subject, _, text in (line.partition(": ") for line in done.stdout.splitlines())
        if subject.startswith("FAIL ")
    }
    assert said in failed[point]


def test_an_unknown_name(command):
    status, _, errors = command("test", "no-such-method")
    assert status == 2
    assert "unknown method 'no-such-method'" in errors


def failing(findings):
    return {finding.subject: finding.text for finding in findings if not finding.ok}


def mean_difference(truth, drawn):
    return np.abs(truth.astype(float) - drawn).mean(axis=(1, 2, 3))


GOOD = ImageMetric("good", mean_difference, 1, False, "made up")


@pytest.mark.parametrize(
    ("metric", "said"),
    [
        (GOOD, {}),
        (replace(GOOD, higher_is_better=True), {"direction": "0 for identical images"}),
        (replace(GOOD, score=lambda t, d: mean_difference(t, d).mean()), {"images": "shape ()"}),
        (
            replace(GOOD, score=lambda t, d: 1 / mean_difference(t, d)),
            {"direction": "divide by zero|inf"},
        ),
        (
            replace(
                GOOD,
                score=lambda t, d: mean_difference(t, d) + np.random.default_rng().random(len(t)),
            ),
            {"images": "another value the second time"},
        ),
        (
            replace(GOOD, score=lambda t, d: mean_difference(t, d) / max(len(t), 1)),
            {"one by one": "another value alone than among others"},
        ),
        (SetMetric("set", lambda d: d[:, 0, :3].reshape(len(d), 9), 1, "made up"), {}),
        (SetMetric("set", lambda d: d.mean(axis=(1, 2, 3)), 1, ""), {"images": r"shape \(3,\)"}),
    ],
)
def test_metrics(monkeypatch, metric, said):
    monkeypatch.setattr(metrics, "find_metric", lambda _: metric)
    failed = failing(metrics.metric_findings(metric.id))
    assert set(said) <= set(failed)
    assert bool(said) == bool(failed)


@dataclass(frozen=True)
class Odd(ProceduralObject):
    """One of the embedded objects with something wrong about it."""

    fault: str = ""

    @property
    def object_id(self):
        return "same" if self.fault == "ids" else super().object_id

    def fingerprint(self):
        return str(id(self)) if self.fault == "fingerprints" else super().fingerprint()

    def cloud(self, rng, count=2048):
        if self.fault == "clouds":
            rng = np.random.default_rng()
        cloud = super().cloud(rng, count)
        return replace(cloud, points=cloud.points * 7) if self.fault == "scale" else cloud

    def truth(self, views):
        images = super().truth(views)
        return np.full_like(images, 255) if self.fault == "white" else images


@pytest.mark.parametrize(
    ("fault", "point", "said"),
    [
        ("", None, ""),
        ("ids", "identity", "two objects have the same class and id"),
        ("fingerprints", "identity", "other fingerprints"),
        ("clouds", "clouds", "another cloud the second time"),
        ("scale", "clouds", "bring objects to the unit sphere"),
        ("white", "truth", "white images"),
    ],
)
def test_datasets(monkeypatch, fault, point, said):
    def opened(spec):
        objects = tuple(Odd("chair", "test", i, fault) for i in range(2))
        return Dataset(spec, ("chair",), objects)

    monkeypatch.setattr(datasets, "open_dataset", opened)
    failed = failing(datasets.dataset_findings("made:x"))
    assert bool(failed) == bool(point)
    assert said in failed.get(point, "")


def test_the_embedded_dataset_keeps_it():
    assert failing(datasets.dataset_findings("procedural:validation")) == {}
    assert plugins.metric_ids() == ()  # in this environment
