"""Distances of many objects, whose features are read in parts."""

from __future__ import annotations

import numpy as np
import pytest

from bench.analysis.sets import FEATURES_AT_ONCE, FeatureDistances
from bench.metrics.frechet import (
    EXACT_OBJECTS,
    JackknifeMoments,
    centred_to_frechet,
    left_out_distances,
)
from bench.records.job import GROUND_TRUTH

from ..builders import left_out_kernel_distances

VIEWS, WIDTH = 70, 4
OBJECTS = [f"o{i:03d}" for i in range(EXACT_OBJECTS + 5)]
IMAGES = [(obj, view) for obj in OBJECTS for view in range(VIEWS)]
ROUNDING = 1e-12  # of the traces, as tests/bench/metrics/test_frechet.py derives it


class CountedFeatures:
    """Features in memory that keep which they were asked for, and the largest number of rows."""

    def __init__(self, values):
        self.values, self.most, self.asked = values, 0, []

    def images(self, method, condition, class_name):
        return sorted(self.values.get(method, {}))

    def of(self, method, condition, class_name, images):
        self.most = max(self.most, len(images))
        self.asked.append((method, condition))
        return np.array([self.values[method][image] for image in images], np.float32)


def values_of(seed, scale, images):
    drawn = np.random.default_rng(seed).normal(scale=scale, size=(len(images), WIDTH))
    return dict(zip(images, drawn.astype(np.float32), strict=True))


def test_many_objects_are_read_in_parts_and_failed_images_are_blank_ones():
    lost = {("o007", 3), *((("o064"), view) for view in range(VIEWS))}
    values = {
        GROUND_TRUTH: values_of(0, 1.0, IMAGES),
        "splat": values_of(1, 1.5, [image for image in IMAGES if image not in lost]),
        "blank": values_of(2, 0.1, IMAGES),
    }
    features = CountedFeatures(values)
    distance = FeatureDistances(features).distance(("splat", "2048", "chair"), IMAGES)
    assert features.most == FEATURES_AT_ONCE < len(IMAGES)
    filled = np.array([(values["splat"] | values["blank"] | values["splat"])[i] for i in IMAGES])
    true = np.array([values[GROUND_TRUTH][image] for image in IMAGES])
    objects = np.array([obj for obj, _ in IMAGES])
    sets = JackknifeMoments(filled, objects), JackknifeMoments(true, objects)
    close = ROUNDING * sum((side.whole.factor**2).sum() for side in sets)
    expected = centred_to_frechet(*(side.whole for side in sets))
    assert distance.value == pytest.approx(expected, rel=0, abs=close)
    assert len(distance.leave_one_out) == 22  # three of 65 objects together, or two
    assert distance.leave_one_out == pytest.approx(left_out_distances(*sets), rel=0, abs=close)


def test_kernel_distances_of_other_images_take_other_true_ones():
    images = [(obj, view) for obj in "abc" for view in range(4)]
    values = {GROUND_TRUTH: values_of(0, 1.0, images), "splat": values_of(1, 1.5, images)}
    distances = FeatureDistances(CountedFeatures(values))
    for shown in (images, images[:8], images[4:], images):
        drawn, true = (np.array([values[m][i] for i in shown]) for m in ("splat", GROUND_TRUTH))
        objects = np.array([obj for obj, _ in shown])
        expected = left_out_kernel_distances(drawn, true, objects, objects)
        distance = distances.distance(("splat", "2048", "chair"), shown, kernel=True)
        assert distance.value == expected[0]
        assert distance.leave_one_out.tolist() == expected[1].tolist()
