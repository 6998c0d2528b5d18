"""Shapes for training that vary more than their classes, and those with relief."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np
import pytest

from data_prep.datasets.occupancy_set import draw_queries, labels
from data_prep.datasets.procedural import ReliefObject, WidenedObject
from data_prep.datasets.registry import ProceduralObject, open_dataset
from data_prep.scene import NEUTRAL_GREY
from data_prep.shapes import augmentation, carving, free_forms, relief
from data_prep.shapes.augmentation import Degenerate, deformed, varied_parts
from data_prep.shapes.catalogue import CLASSES
from data_prep.shapes.deformations import Deformation, draw_deformation
from data_prep.shapes.solids import Part, box, hoop, join, lathe
from tests.data_prep.shapes.solid_checks import EXACT, GREY, unsound, volume

NOTHING = Deformation(np.ones(3), 0.0, 0.0, 0.0, 0.0, np.zeros((4, 4, 4, 3)))
POINTS = np.random.default_rng(0).uniform(-0.9, 0.9, (50, 3))
CUBE = box((0, 0, 0), (2, 2, 2), GREY)


@pytest.mark.parametrize("kind", ["widened", "relief"])
def test_the_datasets_have_them_in_the_train_split_alone(kind):
    dataset = open_dataset(f"procedural:{kind}")
    first, second = dataset.objects("chair", 2, 9, "train")
    assert first.object_id == f"{kind}-00000"
    assert second.fingerprint() == f"procedural-1/chair/{kind}-00001"
    assert first.load().vertices.tobytes() != second.load().vertices.tobytes()
    other = (ProceduralObject("chair", "validation", 0),)
    assert dataset.objects("chair", 1, 9, "validation") == other


@pytest.fixture(scope="module")
def drawn():
    """Return (mesh, kind) of 6 objects with relief of each class."""
    return [
        relief.draw_relief(shapes, ReliefObject(name, i).random_numbers())
        for name, shapes in CLASSES.items()
        for i in range(6)
    ]


def test_objects_with_relief_are_small_grey_light_and_dark_and_have_an_inside(drawn):
    sizes = [len(mesh.faces) for mesh, _ in drawn]
    assert max(sizes) <= relief.MOST_FACES
    assert np.mean(sizes) < 2500
    for mesh, _ in drawn:
        assert np.linalg.norm(mesh.vertices, axis=1).max() == pytest.approx(1.0, abs=1e-6)
    # 78 objects, five standard errors
    free = np.mean([kind == "free" for _, kind in drawn])
    assert abs(free - 0.3) < 5 * np.sqrt(0.3 * 0.7 / 78)
    first = np.array([mesh.face_colors[0] for mesh, _ in drawn])
    single = np.array([len(np.unique(mesh.face_colors, axis=0)) == 1 for mesh, _ in drawn])
    luma = first @ (0.299, 0.587, 0.114) / 255
    # A fifth of the widened shapes is painted by its class, so fewer than two fifths are grey.
    assert 0.25 < (single & (first == NEUTRAL_GREY).all(axis=1)).mean() < 0.5
    for extreme in (luma > 0.75, luma < 0.35):
        assert (single & extreme).mean() > 0.04
    for mesh, kind in drawn[::6]:  # labels raises where a hundredth of the places are in doubt
        places = draw_queries(mesh, 500, np.random.default_rng(0))
        assert 0.05 < labels(mesh, places, kind).mean() < 0.7


PINNED = {
    "widened": "7febdbaa3865f66276448d2119e9418cc844df8a98cc3cfc3c1e793624fa580c",
    "relief": "a1f7ca25c96505334db598bdb017094e1cd95d0a4ab8536c025e16fda8f1b14a",
}


@pytest.mark.parametrize(
    ("kind", "of_class"), [("widened", WidenedObject), ("relief", ReliefObject)]
)
def test_they_stay_as_they_are(kind, of_class):
    """Cards of trained weights name them. Rounded, for other processors' last digits."""
    digest = hashlib.sha256()
    for name in CLASSES:
        mesh = of_class(name, 0).load()
        digest.update((np.round(mesh.vertices.astype(np.float64), 4) + 0.0).tobytes())
        digest.update(mesh.faces.astype(np.int32).tobytes() + mesh.face_colors.tobytes())
    assert digest.hexdigest() == PINNED[kind]


FORMS = {
    **{form.__name__: lambda rng, form=form: form(rng, GREY) for form in free_forms.FORMS},
    "combined": free_forms.free_form,
    "exchanged": augmentation.exchanged_chair,
    **{
        name: lambda rng, name=name: carving.carve_some(varied_parts(CLASSES[name], rng), rng)
        for name in CLASSES
    },
}


@pytest.mark.parametrize("name", FORMS)
def test_forms_are_closed_and_look_outwards_deformed_too(name):
    rng = np.random.default_rng(3)
    for _ in range(3 if name in CLASSES else 12):
        parts = FORMS[name](rng)
        assert unsound(parts) == []
        if name == "exchanged":
            assert np.isfinite(join(parts).vertices).all()
        if name == "combined":
            try:
                parts = deformed(parts, draw_deformation(rng), relief.split_long_edges)
            except Degenerate:
                continue
            assert unsound(parts) == []


def test_deformations_by_their_formulas():
    assert NOTHING(POINTS) == pytest.approx(POINTS, abs=EXACT)
    # differences over 2e-4 of numbers that are rounded to 1e-16: 1e-12 each, some 1e-11 in all
    assert NOTHING.smallest_stretch(POINTS) == pytest.approx(1.0, abs=1e-10)
    x, y, z = POINTS.T
    scaled = replace(NOTHING, scale=np.array([2.0, 0.5, 3.0]))(POINTS)
    assert scaled == pytest.approx(POINTS * (2.0, 0.5, 3.0), abs=EXACT)
    tapered = replace(NOTHING, taper=0.3)(POINTS)
    assert tapered == pytest.approx(np.stack([x * (1 + 0.3 * y), y, z * (1 + 0.3 * y)], 1))
    twisted = replace(NOTHING, twist=0.4)(POINTS)
    turn = np.arctan2(twisted[:, 2], twisted[:, 0]) - np.arctan2(z, x)
    assert np.angle(np.exp(1j * (turn - 0.4 * y))) == pytest.approx(np.zeros(50), abs=EXACT)
    axis = np.stack([np.zeros(201), np.linspace(-1, 1, 201), np.zeros(201)], axis=1)
    bent = replace(NOTHING, bend=0.5, bend_yaw=1.0)(axis)
    # on a circle of radius 2 about the point that the axis bends towards
    across = np.hypot(bent[:, 0], bent[:, 2])
    assert (2 - across) ** 2 + bent[:, 1] ** 2 == pytest.approx(np.full(201, 4.0))
    # Bernstein polynomials reproduce what is linear in the control points.
    places = np.linspace(-1, 1, 4)
    grid = np.stack(np.meshgrid(places, places, places, indexing="ij"), axis=-1)
    moved = replace(NOTHING, offsets=0.2 * grid + (0.1, -0.2, 0.3))(POINTS)
    assert moved == pytest.approx(1.2 * POINTS + (0.1, -0.2, 0.3), abs=EXACT)


def test_what_folds_or_becomes_flat_is_rejected():
    mirror = np.zeros((4, 4, 4, 3))
    mirror[..., 0] = -2.0 * np.linspace(-1, 1, 4)[:, None, None]  # x becomes -x
    folds = {
        # x and z change sign where 1 + 2 y does: the determinant (1 + 2 y)^2 is 0 at -1/2
        0.0: (replace(NOTHING, taper=2.0), np.array([[0.1, -0.5, 0.1], [0.1, 0.5, 0.1]])),
        -1.0: (replace(NOTHING, offsets=mirror), POINTS),
    }
    for least, (deformation, points) in folds.items():
        assert deformation.smallest_stretch(points) == pytest.approx(least, abs=1e-9)
        with pytest.raises(Degenerate, match="folded"):
            deformed([CUBE], deformation)
    with pytest.raises(Degenerate, match="flat"):
        deformed([CUBE], replace(NOTHING, scale=np.array([1.0, 0.03, 1.0])))
    (made,) = deformed([CUBE], replace(NOTHING, scale=np.array([1.0, 0.1, 1.0])))
    assert volume(made) == pytest.approx(8 * 0.1)


def test_long_parts_are_bent_in_small_faces_and_become_thicker_and_not_longer():
    rod = lathe([(0.02, 0.0), (0.02, 1.0)], GREY)
    (bent,) = deformed([rod], replace(NOTHING, bend=0.4))
    edges = bent.vertices[bent.faces] - bent.vertices[np.roll(bent.faces, 1, axis=1)]
    # stretched by a bend of 0.4 by less than 1.1
    assert np.linalg.norm(edges, axis=2).max() < 1.1 * augmentation.EDGE
    thick, same = augmentation.thickened([rod, CUBE], 1.5)
    assert same is CUBE
    assert np.ptp(thick.vertices[:, 1]) == pytest.approx(1.0, abs=1e-9)
    assert volume(thick) == pytest.approx(1.5**2 * volume(rod), rel=1e-9)


def test_carving_keeps_most_of_a_cube_and_all_of_a_wire_and_knows_the_rings_of_a_loft():
    rng = np.random.default_rng(5)
    cube, wire = (box((0, 0, 0), size, GREY) for size in ((1, 1, 1), (1e-4, 1, 1e-4)))
    volumes = [volume(carving.carved(cube, rng)[0]) for _ in range(100)]
    assert carving.LEAST_KEPT < min(volumes) < max(volumes) <= 1 + 1e-9
    assert np.std(volumes) > 0.02
    assert carving.carved(wire, rng) == [wire]
    vase = lathe([(0.2, 0.0), (0.5, 0.4), (0.3, 1.0)], GREY, sides=7)
    rings = carving.rings_of(vase)
    assert rings is not None
    assert rings.shape == (3, 7, 3)
    assert rings[:, 0, 1] == pytest.approx([0.0, 0.4, 1.0])
    turned_round = Part(vase.vertices, vase.faces[::-1].copy(), GREY)
    for other in (hoop((0, 0, 0), 1.0, 0.2, GREY), turned_round):
        assert carving.rings_of(other) is None


def test_edges_are_split_and_the_solid_stays_closed():
    plank = box((0, 0, 0), (3.0, 0.02, 0.5), GREY)
    made = Part(*relief.split_long_edges(plank.vertices, plank.faces, 0.3), GREY)
    assert unsound([made]) == []
    assert volume(made) == pytest.approx(0.03, rel=1e-9)
    edges = made.vertices[made.faces] - made.vertices[np.roll(made.faces, 1, axis=1)]
    assert 0.15 <= np.linalg.norm(edges, axis=2).max() <= 0.3


def test_the_fast_deformation_is_the_deformation():
    for seed in range(6):
        deformation = draw_deformation(np.random.default_rng(seed))
        fast = relief._FastDeformation(**vars(deformation))
        assert fast(POINTS) == pytest.approx(deformation(POINTS), abs=EXACT)
