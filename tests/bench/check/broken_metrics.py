"""Metrics that keep the contract, and metrics that break one point of it each.

They are tested by their names, as `module:NAME`; `FAULTS` says what has to be found.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bench.catalogue.plugins import ImageMetric, SetMetric


def difference(truth, drawn):
    """Mean absolute difference."""
    return np.abs(truth.astype(float) - drawn).mean(axis=(1, 2, 3))


def colours(images):
    """Features: the mean colour of each image."""
    return images.mean(axis=(1, 2))


def decibels(truth, drawn):
    """PSNR, which identical images have none of."""
    with np.errstate(divide="ignore"):
        return 20 * np.log10(255 / np.sqrt(difference(truth, drawn)))


def _darken(truth, drawn):
    values = difference(truth, drawn)
    drawn //= 2
    return values


def image_metric(score, **fields):
    """A metric of images; lower is better."""
    return replace(ImageMetric("made", score, 1, False, "made up"), **fields)


def set_metric(features):
    """A metric of sets of images."""
    return SetMetric("made", features, 1, "made up")


PLUGINS = {
    "GOOD": image_metric(difference),
    "GOOD_SET": set_metric(colours),
    "NO_AXIS": image_metric(lambda t, d: difference(t, d).mean()),
    "INFINITE": image_metric(decibels, higher_is_better=True),
    "WRONG_DIRECTION": image_metric(difference, higher_is_better=True),
    "CONSTANT": image_metric(lambda t, d: np.ones(len(d))),
    "NO_TRUTH": image_metric(lambda t, d: colours(d).mean(axis=1)),
    "ALIKE": image_metric(lambda t, d: difference(t, d) // 300 + colours(t).mean(axis=1)),
    "UNSEEDED": image_metric(
        lambda t, d: difference(t, d) + np.random.default_rng().random(len(d))
    ),
    "OF_THE_OTHERS": image_metric(lambda t, d: difference(t, d) / len(d)),
    "EIGHT_AT_MOST": image_metric(lambda t, d: difference(t, d)[:8]),
    "CHANGES_IMAGES": image_metric(_darken),
    "VERSION_IS_TEXT": image_metric(difference, version="1.0"),
    "NO_FEATURES": set_metric(lambda images: np.empty((len(images), 0))),
    "CONSTANT_FEATURES": set_metric(lambda images: np.ones((len(images), 4))),
    "FEATURES_NOT_FINITE": set_metric(lambda images: colours(images) + np.nan),
}
globals().update(PLUGINS)
FUNCTION = difference

# By name: the finding that tells the fault, what it says, and whether it blocks a run.
FAULTS = {
    "NO_AXIS": ("images", "gives the shape [] for 3 images, expected [3]", True),
    "INFINITE": ("identical images", "the first inf; 'bench score' would end there", True),
    "WRONG_DIRECTION": ("identical images", "identical images have 0, others", True),
    "CONSTANT": ("identical images", "every image has the same value", True),
    "NO_TRUTH": ("identical images", "the values do not depend on the true images", True),
    "ALIKE": ("identical images", "the same value as those of another object", True),
    "UNSEEDED": ("repeatable", "other values the second time", True),
    "OF_THE_OTHERS": ("batches", "another value alone than among others", True),
    "EIGHT_AT_MOST": ("batches", "gives the shape [8] for 20 images", True),
    "CHANGES_IMAGES": ("images", "changes the images that it is given; work on a copy", True),
    "VERSION_IS_TEXT": ("identity", "version is '1.0', expected a whole number", True),
    "NO_FEATURES": ("images", "gives the shape [3, 0] for 3 images, expected [3, d]", True),
    "CONSTANT_FEATURES": ("features", "images of two objects have the same features", True),
    "FEATURES_NOT_FINITE": ("images", "values are not finite", True),
    "FUNCTION": ("import", "FUNCTION is a function; expected a Method, ImageMetric", True),
}
