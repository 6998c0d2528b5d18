"""What an object has to look like by the name of its class and of its structural family."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from data_prep.shapes.car.spec import PAINT_WEIGHTS, PROPORTIONS, draw_car
from data_prep.shapes.catalogue import CLASSES, FAMILIES
from data_prep.shapes.palettes import CAR_PAINTS
from data_prep.shapes.solids import Part
from tests.data_prep.shapes.sections import (
    box_of,
    cut,
    extents,
    filled,
    holds,
    vertices_of,
    volume,
)

Parts = Sequence[Part]


# --- the front is towards -Z ---------------------------------------------------------------------


def rises_behind(parts: Parts) -> bool:
    """Backs of seats, and the fin of an airplane."""
    vertices = vertices_of(parts)
    low, high = box_of(parts)
    highest = vertices[vertices[:, 1] > low[1] + 0.9 * (high - low)[1]]
    return highest[:, 2].mean() > (low[2] + high[2]) / 2


def tapers_behind(parts: Parts) -> bool:
    front, rear = (np.ptp(cut(parts[:1], 2, z)[:, 1]) for z in (-0.2, 0.4))
    return rear < 0.6 * front


def largest_is_behind(parts: Parts) -> bool:
    """Fronts, handles, screens and drivers stand before the body."""
    body = max(parts, key=volume).vertices[:, 2]
    low, high = box_of(parts)
    return body.min() - low[2] > high[2] - body.max()


def head_lights_are_in_front(parts: Parts) -> bool:
    red = [p for p in parts[10:] if p.color[0] - max(p.color[1:]) > 90]
    others = {parts[0].color, *(p.color for p in red)}
    white = [p for p in parts[10:] if min(p.color) > 170 and p.color not in others]
    front = max(p.vertices[:, 2].mean() for p in white)
    return front < 0 < max(p.vertices[:, 2].mean() for p in red)


def details_stand_out_in_front(parts: Parts) -> bool:
    """A screen, or keys, before the body."""
    body, *details = (part.vertices[:, 2].min() for part in parts)
    return min(details) < body


def muzzle_is_in_front(parts: Parts) -> bool:
    """The foremost part is a barrel: thin, on the bore's axis."""
    foremost = min(parts, key=lambda part: part.vertices[:, 2].min()).vertices
    end = foremost[foremost[:, 2] < foremost[:, 2].min() + 1e-12]
    return np.ptp(end[:, :2], axis=0).max() < 0.055 and abs(end[:, 1].mean()) < 0.02


def narrow_in_front(parts: Parts) -> bool:
    bow, stern = (np.ptp(cut(parts[:1], 2, z)[:, 0]) for z in (-0.47, 0.47))
    return bow < 0.75 * stern


def narrow_behind(parts: Parts) -> bool:
    bow, stern = (np.ptp(cut(parts[:1], 2, z)[:, 0]) for z in (-0.44, 0.44))
    return stern < 0.6 * bow


def rear_is_flat(parts: Parts) -> bool:
    """Against a wall, or the back of a box."""
    return vertices_of(parts)[:, 2].max() <= parts[0].vertices[:, 2].max() + 1e-12


FRONT: dict[str, dict[Callable[[Parts], bool], Sequence[str]]] = {
    "airplane": {
        rises_behind: ("airliner", "rear-engine-jet", "fighter", "supersonic"),
        tapers_behind: ("propeller", "biplane"),
    },
    "bench": {rises_behind: ("park", "settle", "pew", "row")},
    "cabinet": {largest_is_behind: ("chest", "wardrobe", "hutch")},
    "car": {head_lights_are_in_front: CLASSES["car"].families},
    "chair": {rises_behind: tuple(set(CLASSES["chair"].families) - {"stool", "bar-stool"})},
    "display": {details_stand_out_in_front: ("television", "tube-monitor", "pair", "sign")},
    "lamp": {rear_is_flat: ("sconce",)},
    "loudspeaker": {rear_is_flat: ("bookshelf", "soundbar")},
    "rifle": {muzzle_is_in_front: CLASSES["rifle"].families},
    "sofa": {rises_behind: ("box-arm", "rolled-arm", "sectional", "open-frame", "curved")},
    "telephone": {details_stand_out_in_front: ("smartphone", "keypad")},
    "vessel": {
        narrow_in_front: tuple(set(CLASSES["vessel"].families) - {"submarine"}),
        narrow_behind: ("submarine",),
    },
}


@pytest.mark.parametrize("name", FRONT)
def test_the_front_is_towards_minus_z(drawn, name: str) -> None:
    for looks_forward, families in FRONT[name].items():
        for family in families:
            for obj in drawn(name)[family]:
                assert looks_forward(obj.parts), (looks_forward.__name__, family)


# --- where it stands, and its proportions --------------------------------------------------------

ON_THE_GROUND = {
    "bench": 1e-12,
    "car": 1e-12,  # tyres stand on it
    "chair": 0.02,  # metres; runners are 2-3 cm thick
    "sofa": 1e-12,
    "table": 1e-12,
}


@pytest.mark.parametrize("name", ON_THE_GROUND)
def test_it_stands_on_the_ground(drawn, name: str) -> None:
    for family, objects in drawn(name).items():
        for obj in objects:
            lowest = box_of(obj.parts)[0][1]
            # A wheel of 14 sides misses its circle by 1 - cos(pi / 14) = 2.5 % of the radius.
            slack = 0.026 * 0.5 if name == "car" else ON_THE_GROUND[name]
            assert -ON_THE_GROUND[name] <= lowest <= slack, family


def test_hulls_float_in_the_water(drawn) -> None:
    for family, vessels in drawn("vessel").items():
        for vessel in vessels:
            low, high = box_of(vessel.parts)
            assert low[1] < -0.02, family
            assert high[1] > 0.05, family


ANY = (0.0, np.inf)
# Class and family: width over height, depth over height.
SHAPES = {
    ("telephone", "smartphone"): ((0.44, 0.80), (0.06, 0.16)),
    ("telephone", "keypad"): ((0.28, 0.65), (0.09, 0.27)),
    ("telephone", "flip"): ((0.24, 0.34), (0.09, 0.36)),
    ("telephone", "cordless"): ((0.28, 0.65), (0.30, 0.62)),
    ("telephone", "desk"): ((1.2, 3.0), (1.4, 3.1)),
    ("telephone", "classic"): ((0.95, 1.7), (0.85, 1.5)),
    ("rifle", "assault"): ((0.0, 0.6), (2.2, 5.6)),
    ("rifle", "bolt-action"): ((0.0, 0.6), (3.4, 8.0)),
    ("rifle", "sniper"): ((0.0, 0.75), (2.8, 7.0)),
    ("rifle", "shotgun"): ((0.0, 0.6), (3.2, 9.0)),
    ("rifle", "submachine"): ((0.0, 0.6), (1.1, 3.9)),
    ("rifle", "machine-gun"): ((0.0, 0.75), (2.8, 5.0)),
    ("rifle", "bullpup"): ((0.0, 0.6), (1.8, 3.5)),
    ("cabinet", "sideboard"): ((1.15, np.inf), ANY),
    ("cabinet", "wardrobe"): (ANY, (0.0, 0.5)),
    ("display", "television"): ((1.15, 2.0), (0.0, 0.9)),
    ("loudspeaker", "tower"): ((0.0, 1 / 2.2), (0.0, 1 / 1.5)),
    ("loudspeaker", "bookshelf"): ((1 / 2.1, np.inf), ANY),
    ("loudspeaker", "soundbar"): ((4.0, np.inf), ANY),
    ("lamp", "post"): ((0.0, 1.0), (0.0, 1.0)),
}


@pytest.mark.parametrize(("name", "family"), SHAPES)
def test_proportions(drawn, name: str, family: str) -> None:
    wide, deep = SHAPES[name, family]
    for obj in drawn(name)[family]:
        x, y, z = extents(obj.parts)
        assert wide[0] < x / y < wide[1]
        assert deep[0] < z / y < deep[1]


def test_span_over_length_distinguishes_airplanes(drawn) -> None:
    expected = {
        "airliner": (0.80, 1.15), "rear-engine-jet": (0.75, 1.12), "fighter": (0.50, 0.95),
        "propeller": (0.95, 1.45), "biplane": (0.85, 1.25), "supersonic": (0.38, 0.56),
        "flying-wing": (1.2, 3.2),
    }  # fmt: skip
    for family, (low, high) in expected.items():
        for plane in drawn("airplane")[family]:
            x, y, z = extents(plane.parts)
            assert low < x / z < high, family
            assert filled(plane.parts) < 0.20, family
            assert family != "flying-wing" or y < 0.15 * x


# --- structure -----------------------------------------------------------------------------------


def standing(parts: Parts) -> list[Part]:
    return [part for part in parts if part.vertices[:, 1].min() < 1e-9]


def middle_height(parts: Parts) -> np.ndarray:
    """|x| and |z| [n, 2] of the cut at half height, as shares of the first part's half extents."""
    reach = np.abs(parts[0].vertices).max(axis=0)
    return np.abs(cut(parts, 1, 0.5 * float(box_of(parts)[1][1]))[:, ::2]) / reach[::2]


def has_a_bed(parts: Parts) -> bool:
    low, high = box_of(parts)
    section = cut(parts, 2, float(low[2] + 0.85 * (high[2] - low[2])))
    inside = section[np.abs(section[:, 0]) < 0.5 * high[0]]
    walls = section[np.abs(section[:, 0]) > 0.75 * high[0]]
    return inside[:, 1].max() < walls[:, 1].max() - 0.05


def is_open_above(parts: Parts) -> bool:
    hull = parts[0]
    top = float(cut([hull], 2, 0.0)[:, 1].max())
    floor = float(box_of([hull])[0][1]) + 0.008
    return not holds([hull], (0.0, top - 0.03, 0.0)) and holds([hull], (0.0, floor, 0.0))


def has_one_wing_over_the_other(parts: Parts) -> bool:
    lower, upper = parts[2].vertices, parts[3].vertices
    return upper[:, 1].min() - lower[:, 1].max() > 0.09


def leaves_the_knees_free(parts: Parts) -> bool:
    _, y, z = np.abs(parts[0].vertices).max(axis=0)
    return not holds(parts, (0.0, 0.5 * y, -0.6 * z))


def narrows_to_the_rear(parts: Parts) -> bool:
    low, high = parts[0].vertices[:, 2].min(), parts[0].vertices[:, 2].max()
    front, rear = (cut(parts[:1], 2, low + s * (high - low)) for s in (0.12, 0.93))
    return np.ptp(rear[:, 0]) < 0.85 * np.ptp(front[:, 0])


def is_a_box_to_the_end(parts: Parts) -> bool:
    low, high = box_of(parts)
    return cut(parts, 2, low[2] + 0.96 * (high - low)[2])[:, 1].max() > 0.85 * high[1]


def hangs(parts: Parts) -> bool:
    return parts[0].vertices[:, 1].max() == vertices_of(parts)[:, 1].max()


STRUCTURE: dict[tuple[str, str], Callable[[Parts], bool]] = {
    ("airplane", "biplane"): has_one_wing_over_the_other,
    ("bench", "settle"): lambda parts: len(standing(parts)) == 4,
    ("bench", "plank"): lambda parts: 0.40 <= box_of(parts)[1][1] <= 0.48,
    ("car", "pickup"): has_a_bed,
    ("car", "van"): is_a_box_to_the_end,
    ("car", "sedan"): lambda parts: not is_a_box_to_the_end(parts),
    ("display", "tube-monitor"): narrows_to_the_rear,
    ("lamp", "pendant"): hangs,
    ("lamp", "chandelier"): lambda parts: hangs(parts) and filled(parts) < 0.05,
    ("table", "four-leg"): lambda p: len(standing(p)) == 4 and middle_height(p).min() > 0.3,
    ("table", "pedestal"): lambda parts: middle_height(parts)[:, 1].max() < 0.4,
    ("table", "panel"): lambda parts: middle_height(parts)[:, 0].max() > 0.85,
    ("table", "desk"): leaves_the_knees_free,
    ("vessel", "open-boat"): is_open_above,
    ("vessel", "tall-ship"): lambda parts: box_of(parts)[0][2] < -0.7,  # the bowsprit
}


@pytest.mark.parametrize(("name", "family"), STRUCTURE)
def test_structure(drawn, name: str, family: str) -> None:
    for obj in drawn(name)[family]:
        assert STRUCTURE[name, family](obj.parts)


def test_families_are_those_of_the_catalogue() -> None:
    for name, family in [*SHAPES, *STRUCTURE]:
        assert family in FAMILIES[name]


# --- cars: the one class that is drawn from a table of measures -----------------------------------


def test_the_measures_of_cars_stay_in_their_ranges() -> None:
    assert tuple(PROPORTIONS) == tuple(PAINT_WEIGHTS) == CLASSES["car"].families
    rng = np.random.default_rng(2)
    for family, given in PROPORTIONS.items():
        assert set(PAINT_WEIGHTS[family]) <= set(CAR_PAINTS)
        for _ in range(5):
            car, cabin = draw_car(rng, family)
            for value, (low, high) in (
                (car.length, given.length),
                (2 * car.half, given.width),
                (car.height, given.height),
                (car.wheel, given.wheel),
                (car.clearance, given.clearance),
            ):
                assert low <= value <= high
            assert car.clearance < car.arch_top < car.belt < cabin.high, family
            assert cabin.foot[0] < cabin.roof[0] < cabin.roof[1] < cabin.foot[1], family
