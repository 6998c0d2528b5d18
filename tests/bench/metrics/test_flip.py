"""FLIP against its own package, and what a package that is not there says."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError

import numpy as np
import pytest

from bench.metrics.flip import PACKAGE, VERSION, flip, flip_module
from bench.metrics.inception_weights import WeightsUnavailable

from .similarity_images import disc

REMEDY = r"run 'pip install --no-deps flip-evaluator==1\.7'$"


def raises(error):
    def function(name):
        raise error

    return function


def test_is_the_mean_of_the_map_of_its_package():
    """At 67 pixels per degree; the package's own mean is a sum of float32, off by 1e-4 at most."""
    evaluate = pytest.importorskip("flip_evaluator").evaluate
    truth = np.concatenate([disc(), disc(column=80)])
    drawn = np.concatenate([disc(level=120), disc(radius=28)])
    actual = flip(truth, drawn)
    for value, a, b in zip(actual, truth / 255, drawn / 255, strict=True):
        images = a.astype(np.float32), b.astype(np.float32)
        _, mean, settings = evaluate(*images, "LDR", applyMagma=False)
        assert settings["ppd"] == pytest.approx(67.0206, abs=1e-4)
        assert value == pytest.approx(mean, abs=1e-4)
        near, _, _ = evaluate(*images, "LDR", applyMagma=False, parameters={"ppd": 67.0206})
        assert value == pytest.approx(near.mean(dtype=np.float64), abs=1e-5)
    assert ((actual > 0) & (actual < 1)).all()


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"installed": raises(PackageNotFoundError())}, f"the package {PACKAGE} is not installed"),
        ({"installed": lambda name: "1.6"}, f"{PACKAGE} 1.6 is installed, expected 1.7"),
        (
            {"installed": lambda name: VERSION, "load": raises(ImportError("nbflip: no GLIBC"))},
            f"{PACKAGE}: nbflip: no GLIBC",
        ),
    ],
)
def test_without_the_package_it_is_skipped_with_the_remedy(given, says):
    with pytest.raises(WeightsUnavailable, match=f"^{says}; {REMEDY}"):
        flip_module(**given)
