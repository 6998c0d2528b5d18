"""Training shapes with relief: what they are made of, that they are closed, and their sizes."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from data_prep.datasets.occupancy_set import draw_queries, labels
from data_prep.datasets.procedural import ReliefObject, WidenedObject
from data_prep.datasets.registry import ProceduralObject, open_dataset
from data_prep.scene import NEUTRAL_GREY
from data_prep.shapes import carving, free_forms, relief
from data_prep.shapes.augmentation import Degenerate, deformed, varied_parts
from data_prep.shapes.catalogue import CLASSES
from data_prep.shapes.deformations import draw_deformation
from data_prep.shapes.solids import Part, box, hoop, lathe, signed_volume
from tests.data_prep.shapes.solid_checks import EXACT, GREY, unsound, volume


@pytest.fixture(scope="module")
def drawn():
    """Return (mesh, kind) of 12 objects of each class."""
    return [
        relief.draw_relief(shapes, ReliefObject(name, i).random_numbers())
        for name, shapes in CLASSES.items()
        for i in range(12)
    ]


def test_the_dataset_has_relief_in_the_train_split_alone():
    dataset = open_dataset("procedural:relief")
    (first,) = dataset.objects("chair", 1, 9, "train")
    assert (first.object_id, first.fingerprint()) == (
        "relief-00000",
        "procedural-1/chair/relief-00000",
    )
    assert dataset.objects("chair", 1, 9, "validation") == (
        ProceduralObject("chair", "validation", 0),
    )


def test_objects_have_few_faces_and_the_unit_sphere(drawn):
    sizes = [len(mesh.faces) for mesh, _ in drawn]
    assert max(sizes) <= relief.MOST_FACES
    assert np.mean(sizes) < 2500
    for mesh, _ in drawn:
        assert np.linalg.norm(mesh.vertices, axis=1).max() == pytest.approx(1.0, abs=1e-6)
    # 156 objects, five standard errors
    free = np.mean([kind == "free" for _, kind in drawn])
    assert abs(free - 0.3) < 5 * np.sqrt(0.3 * 0.7 / 156)


def test_grey_light_and_dark_objects(drawn):
    first = np.array([mesh.face_colors[0] for mesh, _ in drawn])
    single = np.array([len(np.unique(mesh.face_colors, axis=0)) == 1 for mesh, _ in drawn])
    grey = single & (first == NEUTRAL_GREY).all(axis=1)
    luma = first @ (0.299, 0.587, 0.114) / 255
    # A fifth of the widened shapes is painted by its class, so fewer than two fifths are grey.
    assert 0.25 < grey.mean() < 0.5
    for extreme in (luma > 0.75, luma < 0.35):
        assert (single & extreme).mean() > 0.04


@pytest.mark.parametrize("form", free_forms.FORMS, ids=lambda form: form.__name__)
def test_free_forms_are_closed_and_look_outwards(form):
    rng = np.random.default_rng(2)
    for _ in range(30):
        assert unsound(form(rng, GREY)) == []


def test_combined_and_deformed_forms_are_closed():
    rng = np.random.default_rng(3)
    for _ in range(30):
        parts = free_forms.free_form(rng)
        assert unsound(parts) == []
        try:
            parts = deformed(parts, draw_deformation(rng), relief.split_long_edges)
        except Degenerate:
            continue
        assert unsound(parts) == []


@pytest.mark.parametrize("name", CLASSES)
def test_carved_parts_are_closed(name):
    rng = np.random.default_rng(4)
    for _ in range(3):
        parts = varied_parts(CLASSES[name], rng)
        assert unsound(carving.carve_some(parts, rng)) == []


def test_labels_tell_inside_from_outside(drawn):
    for mesh, kind in drawn[::4]:
        places = draw_queries(mesh, 500, np.random.default_rng(0))
        # labels raises where a hundredth of the places are in doubt
        inside = labels(mesh, places, kind)
        assert 0.05 < inside.mean() < 0.7


def test_rings_are_those_of_the_loft():
    profile = [(0.2, 0.0), (0.5, 0.4), (0.3, 1.0)]
    vase = lathe(profile, GREY, sides=7)
    rings = carving.rings_of(vase)
    assert rings is not None
    assert rings.shape == (3, 7, 3)
    assert rings[:, 0, 1] == pytest.approx([0.0, 0.4, 1.0])
    turned_round = Part(vase.vertices, vase.faces[::-1].copy(), GREY)
    for other in (hoop((0, 0, 0), 1.0, 0.2, GREY), turned_round):
        assert carving.rings_of(other) is None


def test_a_carved_cube_keeps_most_of_itself():
    rng = np.random.default_rng(5)
    cube = box((0, 0, 0), (1, 1, 1), GREY)
    volumes = [volume(carving.carved(cube, rng)[0]) for _ in range(100)]
    assert carving.LEAST_KEPT < min(volumes) < max(volumes) <= 1 + 1e-9
    assert np.std(volumes) > 0.02
    # A wire stays as it is.
    wire = box((0, 0, 0), (1e-4, 1, 1e-4), GREY)
    assert carving.carved(wire, rng) == [wire]


def test_edges_are_split_and_the_solid_stays_closed():
    plank = box((0, 0, 0), (3.0, 0.02, 0.5), GREY)
    vertices, faces = relief.split_long_edges(plank.vertices, plank.faces, 0.3)
    made = Part(vertices, faces, GREY)
    assert unsound([made]) == []
    assert signed_volume(vertices, faces) == pytest.approx(0.03, rel=1e-9)
    edges = vertices[faces] - vertices[np.roll(faces, 1, axis=1)]
    assert 0.15 <= np.linalg.norm(edges, axis=2).max() <= 0.3


def test_the_fast_deformation_is_the_deformation():
    points = np.random.default_rng(6).uniform(-1, 1, (100, 3))
    for seed in range(6):
        deformation = draw_deformation(np.random.default_rng(seed))
        fast = relief._FastDeformation(**vars(deformation))
        assert fast(points) == pytest.approx(deformation(points), abs=EXACT)


def test_widened_shapes_stay_as_they_are():
    """Cards of trained weights name them. Rounded, for other processors' last digits."""
    digest = hashlib.sha256()
    for name in CLASSES:
        mesh = WidenedObject(name, 0).load()
        digest.update((np.round(mesh.vertices.astype(np.float64), 4) + 0.0).tobytes())
        digest.update(mesh.faces.astype(np.int32).tobytes() + mesh.face_colors.tobytes())
    assert digest.hexdigest() == "7febdbaa3865f66276448d2119e9418cc844df8a98cc3cfc3c1e793624fa580c"
