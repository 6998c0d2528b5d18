"""Metrics that keep the contract, and metrics that break one point of it each.

They are tested by their names, as `module:NAME`; `FAULTS` says what has to be found.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import replace
from functools import partial

import numpy as np

from bench.catalogue.plugins import ImageMetric, SetMetric

_SEEN = []
_KEPT = []


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


def _not_a_number(truth, drawn):
    off = difference(truth, drawn)
    with np.errstate(invalid="ignore"):
        return off / off


def _relative(truth, drawn):
    """To the brightest images so far."""
    _SEEN.append(drawn.mean())
    return difference(truth, drawn) / max(_SEEN)


def _leak(truth, drawn):
    _KEPT.append(np.ones(25 * 2**17))  # 25 MiB
    return difference(truth, drawn)


def _darken(truth, drawn):
    values = difference(truth, drawn)
    drawn //= 2
    return values


def _print(truth, drawn):
    print("measuring", len(drawn))
    return difference(truth, drawn)


def _hang(truth, drawn):
    while True:
        time.sleep(60)


def _end(how, truth, drawn):
    how()


def _interrupt():
    raise KeyboardInterrupt


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
    "NOT_A_NUMBER": image_metric(_not_a_number),
    "WRONG_DIRECTION": image_metric(difference, higher_is_better=True),
    "CONSTANT": image_metric(lambda t, d: np.ones(len(d))),
    "NO_TRUTH": image_metric(lambda t, d: colours(d).mean(axis=1)),
    "ALIKE": image_metric(lambda t, d: difference(t, d) // 300 + colours(t).mean(axis=1)),
    "UNSEEDED": image_metric(
        lambda t, d: difference(t, d) + np.random.default_rng().random(len(d))
    ),
    "OF_THE_OTHERS": image_metric(lambda t, d: difference(t, d) / len(d)),
    "EIGHT_AT_MOST": image_metric(lambda t, d: difference(t, d)[:8]),
    "HASH_ORDER": image_metric(lambda t, d: difference(t, d) * (1 + hash("a string") % 97)),
    "REMEMBERS": image_metric(_relative),
    "CHANGES_IMAGES": image_metric(_darken),
    "LEAKS": image_metric(_leak),
    "PRINTS": image_metric(_print),
    "HANGS": image_metric(_hang),
    "EXITS": image_metric(partial(_end, partial(sys.exit, 0))),
    "LEAVES": image_metric(partial(_end, partial(os._exit, 0))),
    "INTERRUPTS": image_metric(partial(_end, _interrupt)),
    "VERSION_IS_TEXT": image_metric(difference, version="1.0"),
    "NO_FEATURES": set_metric(lambda images: np.empty((len(images), 0))),
    "FLAT_FEATURES": set_metric(lambda images: images.mean(axis=(1, 2, 3))),
    "CONSTANT_FEATURES": set_metric(lambda images: np.ones((len(images), 4))),
    "FEATURES_NOT_FINITE": set_metric(lambda images: colours(images) + np.nan),
}
globals().update(PLUGINS)
FUNCTION = difference

# By name: the finding that tells the fault, and what it says. All of them block a run.
FAULTS = {
    "NO_AXIS": ("images", "gives the shape [] for 3 images, expected [3]"),
    "INFINITE": ("identical images", "the first inf; 'bench score' would end there"),
    "NOT_A_NUMBER": ("identical images", "the first nan; 'bench score' would end there"),
    "WRONG_DIRECTION": ("identical images", "identical images have 0, others"),
    "CONSTANT": ("identical images", "the same for every image"),
    "NO_TRUTH": ("identical images", "the true images change nothing"),
    "ALIKE": ("identical images", "the same value as those of another object"),
    "UNSEEDED": ("images", "other values the second time"),
    "OF_THE_OTHERS": ("batches", "another value alone than among others"),
    "EIGHT_AT_MOST": ("batches", "gives the shape [8] for 20 images"),
    "HASH_ORDER": ("another process", "other values in another process"),
    "REMEMBERS": ("another process", "in another order of images"),
    "CHANGES_IMAGES": ("images", "the images were changed; work on a copy"),
    "LEAKS": ("calls", "25 MiB more with every call"),
    "PRINTS": ("stdout", "commands print their results there"),
    "HANGS": ("first use", "timeout: no result within"),
    "EXITS": ("images", "SystemExit(0)"),
    "LEAVES": ("images", "crash: os._exit(0) was called"),
    "INTERRUPTS": ("images", "KeyboardInterrupt()"),
    "VERSION_IS_TEXT": ("identity", "version is '1.0', expected a whole number"),
    "NO_FEATURES": ("images", "gives the shape [3, 0] for 3 images, expected [3, d]"),
    "FLAT_FEATURES": ("images", "gives the shape [3] for 3 images"),
    "CONSTANT_FEATURES": ("features", "the same features for another object"),
    "FEATURES_NOT_FINITE": ("images", "values are not finite"),
    "FUNCTION": ("import", "FUNCTION is a function; expected a Method, ImageMetric"),
}
