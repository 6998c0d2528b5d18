"""The contract of a metric of another package: finite values that depend on the images alone."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.plugins import ImageMetric, SetMetric
from bench.check.contract.findings import ContractViolation, checked_identity
from bench.check.contract.methods import TURN, VIEWS
from bench.check.contract.session import CheckStep, Passed
from bench.check.contract.targets import find_target
from data_prep.datasets.registry import ProceduralObject
from data_prep.scene import UInt8Images

BATCHES = (1, 3)  # numbers of images in a call whose values are compared with those of one call


def _metric(name: str) -> ImageMetric | SetMetric:
    metric = find_target(name)
    assert isinstance(metric, (ImageMetric, SetMetric))
    return metric


@cache
def _true_images(index: int) -> UInt8Images:
    """Return true images of a chair, 20 views, in a read-only array."""
    images = ProceduralObject("chair", "validation", index).truth(TURN)
    images.flags.writeable = False
    return images


def _values(name: str, truth: UInt8Images, drawn: UInt8Images) -> NDArray[np.float64]:
    """Return a metric's values, or its features, of copies of images, after checking them."""
    metric, truth, drawn = _metric(name), truth.copy(), drawn.copy()
    before = truth.copy(), drawn.copy()
    if isinstance(metric, ImageMetric):
        values = np.asarray(metric.score(truth, drawn), np.float64)
        expected, is_expected = f"[{len(drawn)}]", values.shape == (len(drawn),)
    else:
        values = np.asarray(metric.features(drawn), np.float64)
        expected = f"[{len(drawn)}, d] with d of 1 or more"
        is_expected = values.ndim == 2 and len(values) == len(drawn) and values.shape[1] > 0
    if not is_expected:
        raise ContractViolation(
            f"gives the shape {list(values.shape)} for {len(drawn)} images, expected {expected}"
        )
    if not np.isfinite(values).all():
        raise ContractViolation(
            f"{int((~np.isfinite(values)).sum())} of {values.size} values are not finite, the "
            f"first {values[~np.isfinite(values)][0]}; 'bench score' would end there"
        )
    if not all(map(np.array_equal, before, (truth, drawn))):
        raise ContractViolation("changes the images that it is given; work on a copy")
    return values


def check_identity(name: str) -> Passed:
    """Check the version of a metric, and whether higher values are better."""
    metric = _metric(name)
    checked_identity(metric.version)
    if isinstance(metric, ImageMetric) and type(metric.higher_is_better) is not bool:
        raise ContractViolation(f"higher_is_better is {metric.higher_is_better!r}, expected a bool")
    return Passed(f"version {metric.version}")


def use(name: str, number: int) -> NDArray[np.float64]:
    """Return the values of one chair's images, where another chair's are taken as the true ones."""
    return _values(name, _true_images(number % 2), _true_images(1 - number % 2))


def check_images(name: str) -> Passed:
    """Measure three images, and check shape and range of the values."""
    values = _values(name, _true_images(0)[: len(VIEWS)], _true_images(1)[: len(VIEWS)])
    return Passed(f"{list(values.shape)}, finite")


def _check_white(name: str) -> Passed:
    """Measure white images, which stand in for failed ones."""
    white = np.full_like(_true_images(0), 255)
    values = _values(name, _true_images(0), white)
    _values(name, white, white)
    if values.shape[1:] != _values(name, white[:1], _true_images(1)[:1]).shape[1:]:
        raise ContractViolation("features of white images have another length")
    return Passed(f"mean {values.mean():.4g}")


def check_batches(name: str) -> Passed:
    """Measure 20 images one by one, in threes and together, and compare the values."""
    truth, drawn = _true_images(0), _true_images(1)
    whole = _values(name, truth, drawn)
    for count in BATCHES:
        parts = [slice(i, i + count) for i in range(0, len(truth), count)]
        values = np.concatenate([_values(name, truth[part], drawn[part]) for part in parts])
        if values.shape != whole.shape or not np.allclose(values, whole, rtol=1e-5, atol=1e-8):
            images = "1 image" if count == 1 else f"{count} images"
            raise ContractViolation(
                f"other values for {images} a call than for 20: an image has another value alone "
                "than among others"
            )
    return Passed("the same alone and among others")


def check_scores(name: str) -> Passed:
    """Check that a metric rates the true images better than images of another object."""
    metric, truth, other = _metric(name), _true_images(0), _true_images(1)
    assert isinstance(metric, ImageMetric)
    same, off = _values(name, truth, truth), _values(name, truth, other)
    # Whether the values stay the same when the true images are others.
    ignores_truth = np.array_equal(off, _values(name, other, other)) and np.array_equal(
        same, _values(name, other, truth)
    )
    if ignores_truth and np.array_equal(same, off):
        raise ContractViolation("every image has the same value")
    if ignores_truth:
        raise ContractViolation("the values do not depend on the true images")
    if np.array_equal(same, off):
        raise ContractViolation("identical images have the same value as those of another object")
    if (same.mean() > off.mean()) != metric.higher_is_better:
        better = "higher" if metric.higher_is_better else "lower"
        raise ContractViolation(
            f"identical images have {same.mean():.4g}, others {off.mean():.4g}, but the metric "
            f"states that {better} is better; correct higher_is_better"
        )
    return Passed(f"identical images {same.mean():.4g}, another object {off.mean():.4g}")


def check_features(name: str) -> Passed:
    """Check that features depend on the image."""
    features = _values(name, _true_images(0), _true_images(0))
    if np.array_equal(features, _values(name, _true_images(0), _true_images(1))):
        raise ContractViolation("images of two objects have the same features")
    if (features == features[:1]).all():
        raise ContractViolation("all images of an object have the same features")
    return Passed(f"{features.shape[1]} features that depend on the image")


_OF_BOTH = (
    CheckStep("images", check_images),
    CheckStep("white images", _check_white),
    CheckStep("batches", check_batches),
)
OF_IMAGES = (*_OF_BOTH, CheckStep("identical images", check_scores))
OF_SETS = (*_OF_BOTH, CheckStep("features", check_features))
