"""What holds for every class of the procedural set."""

from __future__ import annotations

import numpy as np
import pytest

from data_prep.datasets import ProceduralObject
from data_prep.randomness import generator
from data_prep.scene import Mesh
from data_prep.shapes.catalogue import CLASSES, FAMILIES
from data_prep.shapes.palettes import LIGHTEST
from data_prep.shapes.shape_class import Drawn
from tests.data_prep.shapes.solid_checks import afloat, radius, shared_planes, unsound

PAPER = (
    *("airplane", "bench", "cabinet", "car", "chair", "display", "lamp"),
    *("loudspeaker", "rifle", "sofa", "table", "telephone", "vessel"),
)


@pytest.fixture(params=CLASSES)
def name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def varied(drawn, name: str) -> list[Drawn]:
    """Some of each structural family."""
    return [obj for family in drawn(name).values() for obj in family]


@pytest.fixture
def meshes(meshes_of, name: str) -> list[Mesh]:
    return meshes_of(name)


def test_the_papers_thirteen_in_its_order() -> None:
    assert tuple(CLASSES) == PAPER
    assert all(CLASSES[name].name == name for name in PAPER)


def test_four_families_or_more_whose_weights_add_up_to_one(name: str) -> None:
    weights = {family: weight for family, (weight, _) in FAMILIES[name].items()}
    assert len(weights) >= 4
    assert CLASSES[name].families == tuple(weights)
    # Written with two decimals: exact in hundredths.
    assert sum(round(100 * weight) for weight in weights.values()) == 100
    assert all(weight * 100 == pytest.approx(round(weight * 100)) for weight in weights.values())


def test_one_stream_one_object(name: str) -> None:
    first, again, other = (
        CLASSES[name].draw(np.random.default_rng(seed)).mesh() for seed in (5, 5, 6)
    )
    assert first.vertices.tobytes() == again.vertices.tobytes()
    assert first.faces.tobytes() == again.faces.tobytes()
    assert first.face_colors.tobytes() == again.face_colors.tobytes()
    assert first.vertices.tobytes() != other.vertices.tobytes()


def test_objects_of_the_dataset_are_those_of_the_catalogue(name: str) -> None:
    mesh = ProceduralObject(name, "train", 3).load()
    same = CLASSES[name].draw(generator("procedural", name, "train", 3)).mesh()
    assert mesh.vertices.tobytes() == same.vertices.tobytes()


def test_no_object_comes_twice(meshes: list[Mesh]) -> None:
    assert len({mesh.vertices.tobytes() for mesh in meshes}) == len(meshes)


def test_parts_are_closed_and_outward(varied: list[Drawn]) -> None:
    for obj in varied:
        assert unsound(obj.parts) == [], obj.family


def test_nothing_floats(varied: list[Drawn]) -> None:
    for obj in varied:
        assert afloat(obj.parts) == [], obj.family


def test_no_two_colours_in_one_plane(varied: list[Drawn]) -> None:
    for obj in varied:
        assert shared_planes(obj.parts, radius(obj.parts)) == [], obj.family


def test_normalised(meshes: list[Mesh]) -> None:
    for mesh in meshes:
        vertices = mesh.vertices.astype(np.float64)
        centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        # Half a unit in the last place of 1 in each of three coordinates; see test_normalise.
        rounding = float(np.finfo(np.float32).eps)
        assert np.abs(centre).max() <= rounding
        assert abs(np.linalg.norm(vertices, axis=1).max() - 1) <= rounding


def test_no_finer_than_a_image_shows(meshes: list[Mesh]) -> None:
    for mesh in meshes:
        assert 50 <= len(mesh.faces) <= 4000


def test_colours_leave_the_background_free(meshes: list[Mesh]) -> None:
    for mesh in meshes:
        colors = np.unique(mesh.face_colors, axis=0)
        assert 12 <= colors.min() <= colors.max() <= LIGHTEST
        assert len(colors) <= 12  # a container ship has nine


def test_no_face_without_area(meshes: list[Mesh]) -> None:
    for mesh in meshes:
        corners = mesh.vertices[mesh.faces].astype(np.float64)
        sides = corners[:, 1:] - corners[:, :1]
        area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2
        # A slim face of a thin rod is about 0.005 x 0.01; rounding leaves 1e-7 x 0.01 of none.
        assert area.min() > 1e-8
