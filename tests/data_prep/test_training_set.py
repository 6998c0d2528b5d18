from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_prep.camera import FOCAL_PX
from data_prep.dataset_folder import BareCloud
from data_prep.datasets import MeshFile, ProceduralObject
from data_prep.failures import BadInput
from data_prep.mesh_files import NEUTRAL_GREY
from data_prep.randomness import generator
from data_prep.render import render
from data_prep.scene import Mesh, View
from data_prep.training_set import TrainingSet, add_surfaces, make_training_set

OBJECTS = tuple(ProceduralObject("chair", "train", i) for i in range(3))
SEED = 4


@pytest.fixture(scope="module")
def made() -> TrainingSet:
    return make_training_set(OBJECTS, views=2, seed=SEED)


def arrays(training_set: TrainingSet) -> list[np.ndarray]:
    fields = ("images", "azimuth_deg", "elevation_deg", "clouds")
    return [getattr(training_set, field) for field in fields]


def test_cloud_and_images_are_those_that_an_object_gives_apart(made: TrainingSet) -> None:
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


class Square(ProceduralObject):
    """A red square across the view from the front, `half` a side to either hand, turned by 45
    degrees about the axis of view or not."""

    half = 0.5
    turned = False

    def load(self) -> Mesh:
        corners = np.array([(-1, -1, 0), (-1, 1, 0), (1, 1, 0), (1, -1, 0)]) * self.half
        if self.turned:
            corners = corners @ np.array([[1, 1, 0], [-1, 1, 0], [0, 0, 1]]) * 0.5**0.5
        faces, red = [(0, 1, 2), (0, 2, 3)], [(200, 0, 0)] * 2
        return Mesh(corners.astype(np.float32), np.array(faces), np.array(red))


class TurnedSquare(Square):
    turned = True


def seen_from(*angles: tuple[float, float]) -> TrainingSet:
    azimuth, elevation = np.array(angles).T[:, None]
    images = np.zeros((1, len(angles), 128, 128, 3), np.uint8)
    return TrainingSet(images, azimuth, elevation, np.zeros((1, 2048, 3), np.float32))


def test_coverage_of_a_square_across_the_view() -> None:
    side = round(FOCAL_PX * 2 * Square.half / 4)
    assert side == 58  # even: its edges are edges of pixels
    for azimuth in (0.0, 180.0):  # from behind as from the front
        surfaces = add_surfaces(seen_from((azimuth, 0.0)), [Square("chair", "train", 0)])
        expected = np.zeros((128, 128), np.uint8)
        expected[64 - side // 2 : 64 + side // 2, 64 - side // 2 : 64 + side // 2] = 255
        np.testing.assert_array_equal(surfaces.coverage[0, 0], expected)
        # head on it has exactly its colour
        grey = np.where(expected > 0, NEUTRAL_GREY[0], 255)
        np.testing.assert_array_equal(surfaces.grey[0, 0], grey)


def test_coverage_of_edges_that_cut_through_pixels() -> None:
    """The sum is the area: the square turned by 45 degrees, and seen from aside."""
    views = seen_from((0.0, 0.0), (60.0, 0.0), (90.0, 0.0))
    (found,) = add_surfaces(views, [TurnedSquare("chair", "train", 0)]).coverage / 255
    area = (FOCAL_PX * 2 * Square.half / 4) ** 2
    # Of a pixel on the edge 4 samples are taken: off by an eighth on average, either way, for each
    # of 4 * 58 of them. Errors of an eighth, added as errors do, and four times that.
    assert abs(found[0].sum() - area) < 4 * (4 * 58) ** 0.5 / 8
    # foreshortened to cos 60, and by perspective: x / (4 + x sin 60 / cos 60) of its two halves
    half = Square.half * 2**0.5
    near, far = (FOCAL_PX * half * 0.5 / (4 + sign * half * 0.75**0.5) for sign in (-1, 1))
    tall = FOCAL_PX * half / 4
    assert abs(found[1].sum() - (near + far) * tall) < 4 * (4 * 58) ** 0.5 / 8
    assert found[2].sum() < 2  # from the side it has no area


def test_grey_is_the_object_in_neutral_grey(made: TrainingSet) -> None:
    calls = []
    surfaces = add_surfaces(made, OBJECTS, on_progress=lambda: calls.append(1))
    assert len(calls) == len(OBJECTS)
    assert surfaces.seen is made
    assert surfaces.coverage.shape == surfaces.grey.shape == (3, 2, 128, 128)
    assert surfaces.coverage.dtype == surfaces.grey.dtype == np.uint8
    for i, obj in enumerate(OBJECTS):
        mesh = obj.load()
        views = [
            View(*angles) for angles in zip(made.azimuth_deg[i], made.elevation_deg[i], strict=True)
        ]
        grey = Mesh(mesh.vertices, mesh.faces, np.full(mesh.face_colors.shape, NEUTRAL_GREY))
        rendered = render(grey, views)
        for channel in range(3):
            np.testing.assert_array_equal(surfaces.grey[i], rendered[..., channel])
        # where there is nothing, all are white; where there is all, none is
        nothing, all_of_it = surfaces.coverage[i] == 0, surfaces.coverage[i] == 255
        assert (made.images[i][nothing] == 255).all()
        assert (surfaces.grey[i][nothing] == 255).all()
        assert (surfaces.grey[i][all_of_it] <= NEUTRAL_GREY[0]).all()
        assert all_of_it.sum() > 100


def test_surfaces_of_what_has_no_mesh(tmp_path: Path) -> None:
    gone = MeshFile("chair", "gone.ply", tmp_path / "gone.ply")
    with pytest.raises(BadInput, match=r"gone\.ply: no such file"):
        add_surfaces(seen_from((0.0, 0.0)), [gone])
    bare = BareCloud("chair", "cloud.ply", tmp_path / "cloud.ply")
    with pytest.raises(BadInput, match=r"cloud\.ply: a bare cloud has no mesh; give a mesh"):
        add_surfaces(seen_from((0.0, 0.0)), [bare])
