"""Training objects that are turned at random."""

from __future__ import annotations

import numpy as np
import pytest

from bench.training.images import _some_turned
from data_prep.datasets.objects import TurnedObject
from data_prep.datasets.registry import ProceduralObject

OBJECTS = [ProceduralObject("chair", "train", i) for i in range(8)]


def test_a_turned_object_is_rotated_about_the_origin_and_always_alike() -> None:
    mesh, turned = OBJECTS[0].load(), TurnedObject(OBJECTS[0]).load()
    # The best linear map between the vertices is a rotation: no other shape, and no mirror image.
    turn = np.linalg.lstsq(mesh.vertices, turned.vertices, rcond=None)[0]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-5)  # float32 of some 1e3 rows
    assert np.linalg.det(turn) == pytest.approx(1, abs=1e-5)
    assert np.abs(turn - np.eye(3)).max() > 0.1
    np.testing.assert_array_equal(turned.faces, mesh.faces)
    np.testing.assert_array_equal(TurnedObject(OBJECTS[0]).load().vertices, turned.vertices)
    other = TurnedObject(OBJECTS[1]).load().vertices
    assert other.shape != turned.vertices.shape or np.abs(other - turned.vertices).max() > 0.1


@pytest.mark.parametrize(("share", "count"), [(0, 0), (0.25, 2), (0.5, 4), (1, 8)])
def test_so_large_a_share_is_turned(share: float, count: int) -> None:
    some = _some_turned(OBJECTS, share)
    assert [obj.object_id for obj in some] == [obj.object_id for obj in OBJECTS]
    assert sum(isinstance(obj, TurnedObject) for obj in some) == count
