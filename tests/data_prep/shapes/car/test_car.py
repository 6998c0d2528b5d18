from __future__ import annotations

import numpy as np
import pytest

from data_prep.shapes.car.spec import PAINT_WEIGHTS, PROPORTIONS, draw_car
from data_prep.shapes.catalogue import CLASSES
from data_prep.shapes.palettes import CAR_PAINTS
from data_prep.shapes.shape_class import Drawn
from data_prep.shapes.solids import Color
from tests.data_prep.shapes.samples import Families, of_each_family
from tests.data_prep.shapes.sections import box_of, cut, extents, holds


@pytest.fixture(scope="module")
def cars() -> Families:
    return of_each_family("car", seed=23, count=20)


def role(color: Color) -> str:
    """What a colour stands for that is not the body's, nor that of tyres and hubs."""
    red, green, blue = color
    if red - max(green, blue) > 90:
        return "tail light"
    if min(color) > 170:
        return "head light"
    return "glass" if blue - red > 5 and max(color) < 120 else "leather"


def top_at(car: Drawn, share: float) -> float:
    """Height of the car at a share of its length from the nose, in its own heights."""
    low, high = box_of(car.parts)
    heights = cut(car.parts, 2, float(low[2] + share * (high[2] - low[2])))[:, 1]
    return float(heights.max() / high[1])


def test_every_family_has_its_tables() -> None:
    assert tuple(PROPORTIONS) == tuple(PAINT_WEIGHTS) == CLASSES["car"].families
    for weights in PAINT_WEIGHTS.values():
        assert set(weights) <= set(CAR_PAINTS)
        assert sum(weights.values()) == pytest.approx(1.0)


def test_one_body_colour_black_tyres_tinted_windows(cars: Families) -> None:
    for family, objects in cars.items():
        for car in objects:
            body, tyre, hub = (car.parts[k].color for k in (0, 2, 4))
            assert max(tyre) <= 45
            assert max(hub) - min(hub) <= 25
            others = {part.color for part in car.parts} - {body, tyre, hub}
            # Leather of a convertible may look like glass or like a tail light.
            assert len(others) == (4 if family == "convertible" else 3), (family, others)
            assert {role(color) for color in others} - {"leather"} == {
                *("glass", "head light", "tail light")
            }, (family, others)


def test_the_measures_stay_in_their_ranges() -> None:
    rng = np.random.default_rng(2)
    for family, given in PROPORTIONS.items():
        for _ in range(30):
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
            assert max(car.glass) < 120
            assert max(car.tyre) <= 45


def test_four_wheels_stand_on_the_road(cars: Families) -> None:
    for objects in cars.values():
        for car in objects[:10]:
            wheels = car.parts[2:10:4] + car.parts[3:10:4]
            centres = np.array([wheel.vertices.mean(axis=0) for wheel in wheels])
            assert np.sort(np.sign(centres[:, 0])).tolist() == [-1, -1, 1, 1]
            assert len(np.unique(centres[:, 2].round(9))) == 2
            for wheel in wheels:
                radius = np.ptp(wheel.vertices[:, 2]) / 2
                # A wheel of 14 sides misses its circle by 1 - cos(pi / 14) = 2.5 %.
                assert 0 <= wheel.vertices[:, 1].min() <= 0.026 * radius
            assert box_of(car.parts)[0][1] >= 0
            assert centres[:, 2].min() < 0 < centres[:, 2].max()


def test_the_arches_are_cut_out_of_the_body(cars: Families) -> None:
    for objects in cars.values():
        car = objects[0]
        tyre = car.parts[2].vertices
        centre = tyre.mean(axis=0)
        side = 0.97 * float(car.parts[0].vertices[:, 0].max())
        assert not holds(car.parts[:1], (side, float(centre[1]), float(centre[2])))
        assert holds(car.parts[:1], (side, float(centre[1]), 0.0))


def test_the_front_is_towards_minus_z(cars: Families) -> None:
    for objects in cars.values():
        for car in objects:
            places = {}
            for part in car.parts[10:]:
                if part.color not in (car.parts[0].color, car.parts[2].color):
                    places.setdefault(role(part.color), []).append(part.vertices[:, 2].mean())
            assert max(places["head light"]) < 0 < min(places["tail light"])


def test_profiles_tell_families_apart(cars: Families) -> None:
    """Heights of the car's upper side at 12 %, 50 %, 78 % and 96 % of its length."""
    profile = {
        family: np.array([[top_at(car, s) for s in (0.12, 0.5, 0.78, 0.96)] for car in objects])
        for family, objects in cars.items()
    }
    for family in ("sedan", "coupe", "suv", "hatchback", "van"):
        assert profile[family][:, 1].min() > 0.9, family  # under the roof
        assert profile[family][:, 0].max() < 0.86, family  # over the hood
    assert profile["sedan"][:, 3].max() < 0.75  # a boot
    assert profile["van"][:, 3].min() > 0.85  # a box to the end
    assert profile["suv"][:, 2].min() > 0.85
    assert profile["pickup"][:, 2:].max() < 0.85  # a bed
    # Behind its windscreen a convertible has nothing but seats.
    assert profile["convertible"][:, 2:].max() < 0.95
    assert profile["hatchback"][:, 2].mean() > profile["sedan"][:, 2].mean() + 0.05


def test_length_over_height_tells_families_apart(cars: Families) -> None:
    ratio = {}
    for family, objects in cars.items():
        sizes = np.array([extents(car.parts) for car in objects])
        ratio[family] = (sizes[:, 2] / sizes[:, 1]).mean()
    order = ["van", "suv", "sedan", "coupe"]
    assert sorted(order, key=ratio.__getitem__) == order


def test_a_pickup_has_an_open_bed(cars: Families) -> None:
    for car in cars["pickup"]:
        low, high = box_of(car.parts)
        z = float(low[2] + 0.85 * (high[2] - low[2]))
        section = cut(car.parts, 2, z)
        inside = section[np.abs(section[:, 0]) < 0.5 * high[0]]
        walls = section[np.abs(section[:, 0]) > 0.75 * high[0]]
        assert inside[:, 1].max() < walls[:, 1].max() - 0.05
