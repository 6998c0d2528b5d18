from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_prep.datasets.folder import BareCloud
from data_prep.datasets.registry import MeshFile, ProceduralObject
from data_prep.datasets.training_set import (
    TrainingSet,
    add_surfaces,
    training_clouds,
    training_set,
)
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.rendering.camera import FOCAL_PX
from data_prep.rendering.opengl import render
from data_prep.scene import NEUTRAL_GREY, Mesh, View

pytestmark = pytest.mark.opengl

OBJECTS = tuple(ProceduralObject("chair", "train", i) for i in range(3))
SEED = 4


@pytest.fixture(scope="module")
def made() -> TrainingSet:
    return training_set(OBJECTS, 2, seed=SEED, quiet=True)


def test_cloud_and_images_are_those_that_an_object_gives_apart(made: TrainingSet) -> None:
    for i, obj in enumerate(OBJECTS):
        key = (SEED, "chair", f"train-000{i}")
        views = obj.views(2, generator("training views", *key))
        assert made.images[i].tobytes() == obj.truth(views).tobytes()
        cloud = obj.cloud(generator("training cloud", *key))
        assert made.clouds[i].tobytes() == cloud.points.tobytes()


def test_several_processes_make_the_same_data(made: TrainingSet, monkeypatch) -> None:
    """Also where an object of theirs cannot be loaded."""
    monkeypatch.setattr("data_prep.datasets.training_set._FEWEST_A_WORKER", 1)
    several = training_set(OBJECTS, 2, seed=SEED, quiet=True, workers=2)
    for name, array in vars(made).items():
        assert array.tobytes() == getattr(several, name).tobytes()
    gone = MeshFile("chair", "gone.ply", Path("gone.ply"))
    with pytest.raises(BadInput, match="no such file"):
        training_clouds([gone, gone], quiet=True, workers=2)


def test_a_mesh_is_loaded_once_and_the_seed_decides(capsys) -> None:
    calls = []

    class Counted(ProceduralObject):
        def load(self) -> Mesh:
            calls.append(self.object_id)
            return super().load()

    objects = [Counted("chair", "train", i) for i in range(2)]
    made = training_set(objects, 2, seed=SEED + 1)
    assert calls == ["train-0000", "train-0001"]
    assert "rendering" in capsys.readouterr().err
    same = training_set(objects[:1], 2, seed=SEED, quiet=True)
    assert capsys.readouterr().err == ""
    assert not (same.clouds[0] == made.clouds[0]).all(axis=1).any()
    assert not set(same.azimuth_deg[0]) & set(made.azimuth_deg[0])


class Square(ProceduralObject):
    """A red square of side 1 across the view from the front."""

    def load(self) -> Mesh:
        corners = np.array([(-1, -1, 0), (-1, 1, 0), (1, 1, 0), (1, -1, 0)]) / 2
        return Mesh(corners, [(0, 1, 2), (0, 2, 3)], [(200, 0, 0)] * 2)


def seen_from(*angles: tuple[float, float]) -> TrainingSet:
    azimuth, elevation = np.array(angles).T[:, None]
    images = np.zeros((1, len(angles), 128, 128, 3), np.uint8)
    return TrainingSet(images, azimuth, elevation, np.zeros((1, 2048, 3), np.float32))


def test_coverage_of_a_square_across_the_view() -> None:
    side = round(FOCAL_PX / 4)
    assert side == 58  # even: its edges are edges of pixels
    for azimuth in (0.0, 180.0):  # from behind as from the front
        surfaces = add_surfaces(
            seen_from((azimuth, 0.0)), [Square("chair", "train", 0)], quiet=True
        )
        expected = np.zeros((128, 128), np.uint8)
        expected[64 - side // 2 : 64 + side // 2, 64 - side // 2 : 64 + side // 2] = 255
        np.testing.assert_array_equal(surfaces.coverage[0, 0], expected)
        # head on it has exactly its colour
        grey = np.where(expected > 0, NEUTRAL_GREY[0], 255)
        np.testing.assert_array_equal(surfaces.grey[0, 0], grey)


def test_grey_is_the_object_in_neutral_grey(made: TrainingSet) -> None:
    surfaces = add_surfaces(made, OBJECTS, quiet=True)
    assert surfaces.seen is made
    assert surfaces.coverage.shape == surfaces.grey.shape == (3, 2, 128, 128)
    assert surfaces.coverage.dtype == surfaces.grey.dtype == np.uint8
    for i, obj in enumerate(OBJECTS):
        mesh = obj.load()
        views = list(map(View, made.azimuth_deg[i], made.elevation_deg[i]))
        grey = Mesh(mesh.vertices, mesh.faces, np.full(mesh.face_colors.shape, NEUTRAL_GREY))
        assert (render(grey, views) == surfaces.grey[i][..., None]).all()
        # where there is nothing, all are white; where there is all, none is
        nothing, all_of_it = surfaces.coverage[i] == 0, surfaces.coverage[i] == 255
        assert (made.images[i][nothing] == 255).all()
        assert (surfaces.grey[i][nothing] == 255).all()
        assert (surfaces.grey[i][all_of_it] <= NEUTRAL_GREY[0]).all()
        assert all_of_it.sum() > 100


def test_what_has_no_mesh(tmp_path: Path) -> None:
    gone = MeshFile("chair", "gone.ply", tmp_path / "gone.ply")
    bare = BareCloud("chair", "cloud.ply", tmp_path / "cloud.ply")
    for obj, problem in ((gone, "no such file"), (bare, "a bare cloud has no mesh; give a mesh")):
        with pytest.raises(BadInput, match=rf"{obj.object_id}: {problem}"):
            add_surfaces(seen_from((0.0, 0.0)), [obj], quiet=True)
    with pytest.raises(BadInput, match=r"gone\.ply: no such file"):
        training_set([gone], 1, quiet=True)
