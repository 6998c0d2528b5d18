from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_prep.datasets import MeshFile, ProceduralObject
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.render import render
from data_prep.scene import Mesh, View
from data_prep.training_set import TrainingSet, make_training_set

OBJECTS = tuple(ProceduralObject("chair", "train", i) for i in range(3))
SEED = 4


@pytest.fixture(scope="module")
def made() -> TrainingSet:
    return make_training_set(OBJECTS, views=2, seed=SEED)


def arrays(training_set: TrainingSet) -> list[np.ndarray]:
    fields = ("images", "azimuth_deg", "elevation_deg", "clouds")
    return [getattr(training_set, field) for field in fields]


def test_shapes_and_types(made: TrainingSet) -> None:
    assert [(a.shape, a.dtype) for a in arrays(made)] == [
        ((3, 2, 128, 128, 3), np.uint8),
        ((3, 2), np.float64),
        ((3, 2), np.float64),
        ((3, 2048, 3), np.float32),
    ]


def test_every_picture_shows_its_object_from_its_angles(made: TrainingSet) -> None:
    for i, obj in enumerate(OBJECTS):
        views = [
            View(*angles) for angles in zip(made.azimuth_deg[i], made.elevation_deg[i], strict=True)
        ]
        np.testing.assert_array_equal(made.images[i], render(obj.load(), views))
        assert (made.images[i] < 255).any(axis=(1, 2, 3)).all()


def test_cloud_and_pictures_are_those_that_an_object_gives_apart(made: TrainingSet) -> None:
    for i, obj in enumerate(OBJECTS):
        key = (SEED, "chair", f"train-000{i}")
        views = obj.views(2, generator("training views", *key))
        assert made.images[i].tobytes() == obj.truth(views).tobytes()
        cloud = obj.cloud(generator("training cloud", *key))
        assert made.clouds[i].tobytes() == cloud.points.tobytes()


def test_a_mesh_is_loaded_once() -> None:
    loaded = []

    class Counted(ProceduralObject):
        def load(self) -> Mesh:
            loaded.append(self.object_id)
            return super().load()

    make_training_set([Counted("chair", "train", i) for i in range(2)], views=2, seed=SEED)
    assert loaded == ["train-0000", "train-0001"]


def test_angles_are_in_range_and_all_different(made: TrainingSet) -> None:
    assert np.abs(made.azimuth_deg).max() <= 180
    assert np.abs(made.elevation_deg).max() <= 40
    for angles in (made.azimuth_deg, made.elevation_deg):
        assert len(np.unique(angles)) == 6


def test_clouds_lie_on_their_objects(made: TrainingSet) -> None:
    for i, obj in enumerate(OBJECTS):
        corners = obj.load().vertices.astype(np.float64)[obj.load().faces]
        for point in made.clouds[i, ::256].astype(np.float64):
            # Rounded to float32 once, in the cloud as in the mesh: 2**-25 a coordinate.
            assert distance(point, corners) < 2 * np.sqrt(3) * 2.0**-25


def distance(point: np.ndarray, corners: np.ndarray) -> float:
    """From a point to the nearest of triangles [F, 3, 3], were it to lie above one of them."""
    a, b, c = corners.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    height = ((point - a) * normal).sum(axis=1)
    foot = point - height[:, None] * normal
    inside = np.ones(len(corners), bool)
    for start, end in ((a, b), (b, c), (c, a)):
        side = (np.cross(end - start, foot - start) * normal).sum(axis=1)
        inside &= side > -1e-7 * np.linalg.norm(end - start, axis=1)
    return float(np.abs(height[inside]).min(initial=np.inf))


def test_neighbours_and_order_do_not_matter(made: TrainingSet) -> None:
    again = make_training_set(OBJECTS[:0:-1], views=2, seed=SEED)
    for one, other in zip(arrays(made), arrays(again), strict=True):
        assert one[:0:-1].tobytes() == other.tobytes()


def test_another_seed_gives_other_points_and_views(made: TrainingSet) -> None:
    other = make_training_set(OBJECTS[:1], views=2, seed=SEED + 1)
    assert not (other.clouds[0] == made.clouds[0]).all(axis=1).any()
    assert not set(other.azimuth_deg[0]) & set(made.azimuth_deg[0])


def test_progress_is_reported_after_each_object() -> None:
    calls = []
    make_training_set(OBJECTS[:2], 1, SEED, on_progress=lambda: calls.append(1))
    assert len(calls) == 2


def test_no_objects() -> None:
    nothing = make_training_set([], views=2, seed=SEED)
    assert [len(a) for a in arrays(nothing)] == [0, 0, 0, 0]


def test_an_object_that_cannot_be_loaded(tmp_path: Path) -> None:
    broken = MeshFile("chair", "gone.ply", tmp_path / "gone.ply")
    with pytest.raises(BadInput, match=r"gone\.ply: no such file"):
        make_training_set([broken], views=1, seed=SEED)
