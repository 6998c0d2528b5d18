from __future__ import annotations

import numpy as np
import pytest

from studies.feature_neighbours import neighbourhoods


def test_views_of_an_object_are_each_others_neighbours():
    """Eight objects of five views, far from each other: four neighbours are of the object."""
    rng = np.random.default_rng(0)
    objects = np.repeat(np.arange(8), 5)
    features = 100.0 * objects[:, None] + rng.uniform(0, 1, (40, 2))
    near, far = neighbourhoods(features, objects, (4, 8))
    assert (near.own_object, near.between_halves) == (1, 0)
    assert far.own_object == pytest.approx(0.5)
    assert far.between_halves > 0.4
