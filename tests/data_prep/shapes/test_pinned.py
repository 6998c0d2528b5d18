"""The first objects of every class, and those for training, pinned: weights know these shapes.

A change here is a new data set, not a refactoring: PROCEDURAL_VERSION has to rise with it, and its
objects are to be judged first, as commit dd3b60cf does (tests/data_prep/shapes): that solids are
closed, hold together and do not flicker, stand upright and have the volumes of closed forms.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from data_prep.datasets.procedural import ReliefObject, WidenedObject
from data_prep.datasets.registry import ProceduralObject
from data_prep.randomness import generator
from data_prep.scene import Mesh
from data_prep.shapes.augmentation import Degenerate, deformed, exchanged_chair, varied_parts
from data_prep.shapes.carving import carve_some
from data_prep.shapes.catalogue import CLASSES, FAMILIES, NOVEL_FAMILIES
from data_prep.shapes.deformations import Deformation
from data_prep.shapes.free_forms import FORMS, free_form
from data_prep.shapes.shape_class import Drawn
from data_prep.shapes.solids import box, join, loft, rectangle, signed_volume, sweep

OF_A_SPLIT, OF_A_FAMILY = 25, 8
# The last bits of sine, cosine and matrix products depend on the processor, so meshes are not
# equal to the byte on all machines. Families, faces and colours are hashed as they are,
# coordinates as multiples of GRID: these are equal without vector instructions, too, where a third
# of all meshes differs in some last bit. That one of the 1,300,000 coordinates, off by up to
# 1e-15, changes its multiple has a probability of 1.3e6 * 2e-15 / 1e-6 = 0.003.
GRID = 1e-6
PINNED = {
    "airplane": "1d8624a6788032bc1fe14c220295adefafa616895a898db32bb49822799e0e2c",
    "bench": "e70e933d3318d992af2c30f66db7c083e8c40b7865c16b749007eb5cfc90c905",
    "cabinet": "2e8c55269af0461e5d9f7d6e75502027a7a959264cf2f6f5926444cb56fb91c3",
    "car": "8d533974712232a9a40604029169e2b3c911c454850d080a278ba7fba11667f3",
    "chair": "e976286298dda132d39abe51b0ad637b11e503836097263746c8895752562578",
    "display": "9d065a890b88e39e4dd1e5322a4de477aa1cc0b7845f921fbdfe1f097a5ee8e2",
    "lamp": "03f021b6e880e4efd409d0c25e77f197392dda1acaf217c8f73f224212a3659c",
    "loudspeaker": "ed7757b5874a20625a13c308ee5fd3f2df1690df1c7c8420965b9a85b27c25bb",
    "rifle": "6adebb54de0730d6187a79e9ac2a9c635753dfec47560780f364ec654bd49083",
    "sofa": "8eedb621d7766a1dd268834c0c121eea72716c151ae99bd33862762eacf05c20",
    "table": "4a9e934a4a4e0f2f535bd52dc74dfd1d4ecab046b5b754b92b04f5326e9cfed1",
    "telephone": "84be630fb6f71eac8a42e4934d40aaf2ef97834338c8ffb1f156a7348948c661",
    "vessel": "47b3acabd833b288f5ab4837aee6748600c23484a360fd1b7ab116c35b9bbfa6",
    "widened": "af8113f9d5500fc6a33b6c2fa0f4541d4c831aacfe880308ac0f0ac44c6e8200",
    "relief": "cccf2ebdfc7fe6424149893ef1567b9e8714ef8ef1863db32d80bb8e951dd431",
    "parts": "7d01ed8bdbd4c6cbc6b34fe3380bd09e13d392f5c9da936d7c2908bf3b23de89",
}

NOVEL_CHAIRS = "1d1b92fa90b58abfb4cc5cc38a0d7614b8c2cc737d3ed78a62045f12eb839822"
# Families with parts that few of them have, and none of the above.
RARE = {
    ("cabinet", "kitchen"): "928ef1c82bd02af200f0486d81ae7faafd515a941b3d9c424ada016cf4e7847e",
    ("lamp", "sconce"): "7af0888c2aab43248ea8f8afd8f41ec6c99aaf453f5a19e5ee5af964d65450f1",
    ("table", "frame"): "9ee2425c8b33e3f738b83c78c8599fbe261117d96288b122d2c932cf0e1d1c87",
    ("table", "pedestal"): "fce9fc904ef03746007918df11b25d2ac21df047ed0b478ccc501c1a0c43dca1",
}
GREY = (120, 121, 122)
PAPER = (
    *("airplane", "bench", "cabinet", "car", "chair", "display", "lamp"),
    *("loudspeaker", "rifle", "sofa", "table", "telephone", "vessel"),
)


def of_each_family(families: dict) -> list[Drawn]:
    """Return some objects of each family of a class."""
    rng = np.random.default_rng(1)
    return [
        Drawn(family, tuple(build(rng)))
        for family, (_, build) in families.items()
        for _ in range(OF_A_FAMILY)
    ]


def test_the_papers_thirteen_in_its_order() -> None:
    assert tuple(CLASSES) == PAPER
    for name, families in (*FAMILIES.items(), *NOVEL_FAMILIES.items()):
        assert CLASSES[name].name == name
        # Written with two decimals: exact in hundredths.
        assert sum(round(100 * weight) for weight, _ in families.values()) == 100


@pytest.mark.parametrize("name", CLASSES)
def test_objects_are_pinned(name: str) -> None:
    objects = [
        CLASSES[name].draw(generator("procedural", name, split, index))
        for split in ("train", "test")
        for index in range(OF_A_SPLIT)
    ]
    assert digest([*objects, *of_each_family(FAMILIES[name])]) == PINNED[name]
    mesh = ProceduralObject(name, "train", 3).load()  # the dataset has the same
    assert mesh.vertices.tobytes() == objects[3].mesh().vertices.tobytes()


def test_novel_chairs_are_pinned() -> None:
    assert digest(of_each_family(NOVEL_FAMILIES["chair"])) == NOVEL_CHAIRS


@pytest.mark.parametrize(("name", "family"), RARE)
def test_rare_parts_are_pinned(name: str, family: str) -> None:
    _, build = FAMILIES[name][family]
    rng = np.random.default_rng(2)
    objects = [Drawn(family, tuple(build(rng))) for _ in range(24)]
    assert digest(objects) == RARE[name, family]


def digest(objects: list[Drawn]) -> str:
    found = hashlib.sha256()
    for drawn in objects:
        mesh = drawn.mesh()
        places = np.rint(mesh.vertices.astype(np.float64) / GRID)
        found.update(drawn.family.encode())
        found.update(places.astype("<i4").tobytes())
        found.update(mesh.faces.astype("<i4").tobytes())
        found.update(mesh.face_colors.tobytes())
    return found.hexdigest()


def parts_for_training() -> Iterable[Mesh]:
    """Yield free forms, exchanged parts of chairs, and varied parts that are carved."""
    rng = np.random.default_rng(3)
    for _ in range(12):
        yield from (join(form(rng, GREY)) for form in FORMS)
        yield from (join(form(rng)) for form in (free_form, exchanged_chair))
    for shapes in (*CLASSES.values(), *CLASSES.values()):
        yield join(carve_some(varied_parts(shapes, rng), rng))


def of_class(kind: type[WidenedObject | ReliefObject], count: int) -> list[Mesh]:
    return [kind(name, index).load() for index in range(count) for name in CLASSES]


FOR_TRAINING = {
    "widened": lambda: of_class(WidenedObject, 4),
    "relief": lambda: of_class(ReliefObject, 4),
    "parts": parts_for_training,
}


@pytest.mark.parametrize("kind", FOR_TRAINING)
def test_shapes_for_training_are_pinned(kind: str) -> None:
    """Cards of trained weights name them. Rounded, for other processors' last digits."""
    found = hashlib.sha256()
    for mesh in FOR_TRAINING[kind]():
        found.update((np.round(mesh.vertices.astype(np.float64), 4) + 0.0).tobytes())
        found.update(mesh.faces.astype(np.int32).tobytes() + mesh.face_colors.tobytes())
    assert found.hexdigest() == PINNED[kind]


CUBE = box((0, 0, 0), (2, 2, 2), GREY)
NOTHING = Deformation(np.ones(3), 0.0, 0.0, 0.0, 0.0, np.zeros((4, 4, 4, 3)))
MIRROR = np.zeros((4, 4, 4, 3))
MIRROR[..., 0] = -2.0 * np.linspace(-1, 1, 4)[:, None, None]  # x becomes -x
NEAR = np.array([[0.1, -0.5, 0.1], [0.1, 0.5, 0.1]])


def test_what_folds_or_becomes_flat_is_rejected() -> None:
    """No pinned object folds or is flat."""
    for least, change in (
        (0.0, {"taper": 2.0}),  # the determinant (1 + 2 y)^2 is 0 at -1/2
        (-1.0, {"offsets": MIRROR}),
    ):
        deformation = replace(NOTHING, **change)
        assert deformation.smallest_stretch(NEAR) == pytest.approx(least, abs=1e-9)
        with pytest.raises(Degenerate, match="folded"):
            deformed([CUBE], deformation)
    with pytest.raises(Degenerate, match="flat"):
        deformed([CUBE], replace(NOTHING, scale=np.array([1.0, 0.03, 1.0])))
    (thin,) = deformed([CUBE], replace(NOTHING, scale=np.array([1.0, 0.1, 1.0])))
    assert signed_volume(thin.vertices, thin.faces) == pytest.approx(8 * 0.1)


def test_what_encloses_nothing_or_has_no_direction_is_refused() -> None:
    for shape in ((1, 4, 3), (2, 2, 3), (2, 4, 2), (2, 4, 3)):
        with pytest.raises(ValueError, match="rings"):
            loft(np.zeros(shape), GREY)
    for path, problem in (
        ([(0, 0, 0), (0, 1, 0)], "up"),
        ([(0, 0, 0), (1, 0, 0), (0.5, 0, 0)], "turns back on itself at point 1"),
    ):
        with pytest.raises(ValueError, match=problem):
            sweep(path, rectangle(1, 1), GREY)
    sweep([(0, 0, 0), (1, 0, 0), (0.5, 0.5, 0)], rectangle(0.1, 0.1), GREY)
