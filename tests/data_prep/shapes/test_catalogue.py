"""What holds for every class of the procedural set, and for a family that is new in one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from data_prep.clouds.sampling import face_areas
from data_prep.datasets.registry import ProceduralObject
from data_prep.randomness import generator
from data_prep.scene import Mesh
from data_prep.shapes.catalogue import CLASSES, FAMILIES
from data_prep.shapes.palettes import LIGHTEST
from data_prep.shapes.shape_class import Drawn
from data_prep.shapes.solids import Part
from tests.data_prep.shapes.samples import NOVEL, of_each_family
from tests.data_prep.shapes.solid_checks import afloat, box_of, radius, shared_planes, unsound

PAPER = (
    *("airplane", "bench", "cabinet", "car", "chair", "display", "lamp"),
    *("loudspeaker", "rifle", "sofa", "table", "telephone", "vessel"),
)


@pytest.fixture(params=(*CLASSES, *NOVEL))
def name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def objects(name: str) -> list[Drawn]:
    return [obj for family in of_each_family(name).values() for obj in family]


@pytest.fixture
def meshes(objects: list[Drawn]) -> list[Mesh]:
    return [obj.mesh() for obj in objects]


def test_the_papers_thirteen_in_its_order() -> None:
    assert tuple(CLASSES) == PAPER
    assert all(CLASSES[name].name == name for name in PAPER)


def test_four_families_or_more_whose_weights_add_up_to_one(name: str) -> None:
    weights = {family: weight for family, (weight, _) in (FAMILIES | NOVEL)[name].items()}
    assert len(weights) >= 4
    assert name in NOVEL or CLASSES[name].families == tuple(weights)
    # Written with two decimals: exact in hundredths.
    assert sum(round(100 * weight) for weight in weights.values()) == 100
    assert all(weight * 100 == pytest.approx(round(weight * 100)) for weight in weights.values())


@pytest.mark.parametrize("name", CLASSES)
def test_objects_of_the_dataset_are_those_of_the_catalogue(name: str) -> None:
    mesh, other = (ProceduralObject(name, "train", index).load() for index in (3, 4))
    same = CLASSES[name].draw(generator("procedural", name, "train", 3)).mesh()
    assert mesh.vertices.tobytes() == same.vertices.tobytes() != other.vertices.tobytes()


def test_solids_are_closed_and_joined_and_do_not_flicker(objects: list[Drawn]) -> None:
    for obj in objects:
        assert unsound(obj.parts) == [], obj.family
        assert afloat(obj.parts) == [], obj.family
        assert shared_planes(obj.parts, radius(obj.parts)) == [], obj.family


# Metres: runners of chairs are 2 to 3 cm thick; a wheel of 14 sides misses its circle by
# 1 - cos(pi / 14) = 2.5 % of a radius below 0.5.
ON_THE_GROUND = {
    **{"bench": 0.0, "car": 0.013, "chair": 0.02, "novel chair": 0.02, "sofa": 0.0, "table": 0.0},
}


@pytest.mark.parametrize("name", ON_THE_GROUND)
def test_it_stands_on_the_ground(name: str, objects: list[Drawn]) -> None:
    for obj in objects:
        assert abs(box_of(obj.parts)[0][1]) <= ON_THE_GROUND[name] + 1e-12, obj.family


def test_hulls_float_in_the_water() -> None:
    for family, vessels in of_each_family("vessel").items():
        for vessel in vessels:
            low, high = box_of(vessel.parts)
            assert low[1] < -0.02, family
            assert high[1] > 0.05, family


def rises_behind(parts: Sequence[Part]) -> bool:
    """Backs of seats, and the fin of an airplane."""
    vertices = np.concatenate([part.vertices for part in parts])
    low, high = box_of(parts)
    highest = vertices[vertices[:, 1] > low[1] + 0.9 * (high - low)[1]]
    return highest[:, 2].mean() > (low[2] + high[2]) / 2


FRONT = {
    "airplane": ("airliner", "rear-engine-jet", "fighter", "supersonic"),
    "bench": ("park", "settle", "pew", "row"),
    "chair": tuple(set(CLASSES["chair"].families) - {"stool", "bar-stool"}),
    "novel chair": tuple(NOVEL["novel chair"]),
    "sofa": ("box-arm", "rolled-arm", "sectional", "open-frame", "curved"),
}


@pytest.mark.parametrize("name", FRONT)
def test_the_front_is_towards_minus_z(name: str) -> None:
    for family in FRONT[name]:
        for obj in of_each_family(name)[family]:
            assert rises_behind(obj.parts), family


def test_meshes_are_of_size_one_and_as_fine_as_an_image_shows(meshes: list[Mesh]) -> None:
    assert len({mesh.vertices.tobytes() for mesh in meshes}) == len(meshes)
    # Half a unit in the last place of 1 in each of three coordinates; see test_normalise.
    rounding = float(np.finfo(np.float32).eps)
    for mesh in meshes:
        vertices = mesh.vertices.astype(np.float64)
        centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        assert np.abs(centre).max() <= rounding
        assert abs(np.linalg.norm(vertices, axis=1).max() - 1) <= rounding
        assert 50 <= len(mesh.faces) <= 4000
        # A slim face of a thin rod is about 0.005 x 0.01; rounding leaves 1e-7 x 0.01 of none.
        assert face_areas(mesh).min() > 1e-8
        colors = np.unique(mesh.face_colors, axis=0)
        assert 12 <= colors.min() <= colors.max() <= LIGHTEST  # not the background
        assert len(colors) <= 12  # a container ship has nine
