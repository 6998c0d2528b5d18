from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from data_prep.shapes.loudspeaker.drivers import dome, draw_drivers, horn, port, woofer
from data_prep.shapes.loudspeaker.living_room import baffle, plan_of
from data_prep.shapes.shape_class import Drawn
from tests.data_prep.shapes.samples import Families, of_each_family
from tests.data_prep.shapes.sections import box_of, cut, extents

BLACK = (30, 31, 32)
DRIVERS = draw_drivers(np.random.default_rng(3), BLACK, 2)


@pytest.fixture(scope="module")
def speakers() -> Families:
    return of_each_family("loudspeaker", seed=31, count=30)


def test_woofer_is_a_ring_around_a_cone_that_deepens() -> None:
    ring, cone, cap = woofer(DRIVERS, (0.1, 0.5, -0.2), 0.08, 0.004)
    for part in (ring, cone, cap):
        middle = (part.vertices.min(axis=0) + part.vertices.max(axis=0)) / 2
        np.testing.assert_allclose(middle[:2], (0.1, 0.5), atol=1e-12)
        assert part.vertices[:, 2].max() > -0.2 > part.vertices[:, 2].min()

    def reach(part_vertices: np.ndarray) -> np.ndarray:
        return np.linalg.norm(part_vertices[:, :2] - (0.1, 0.5), axis=1)

    assert reach(ring.vertices).max() == pytest.approx(0.08)
    assert ring.vertices[:, 2].min() == pytest.approx(-0.2 - 3 * 0.004)
    edge, throat = reach(cone.vertices) > 0.06, reach(cone.vertices) < 0.03
    near = cone.vertices[edge & (cone.vertices[:, 2] < -0.2), 2]
    np.testing.assert_allclose(near, -0.2 - 2.6 * 0.004)
    np.testing.assert_allclose(cone.vertices[throat, 2], -0.2 - 1.8 * 0.004)
    assert max(ring.color) < 60 or min(ring.color) > 120  # rubber, or polished metal


@pytest.mark.parametrize("build", [dome, port])
def test_small_drivers_keep_to_their_circle(build) -> None:
    for part in build(DRIVERS, (0.0, 1.0, 0.0), 0.05, 0.004):
        assert np.linalg.norm(part.vertices[:, :2] - (0, 1), axis=1).max() <= 0.05 + 1e-12


def test_horn_is_let_in() -> None:
    edge, flare, throat = horn(DRIVERS, (0, 0, 0), (0.4, 0.15), 0.004)
    np.testing.assert_allclose(np.ptp(edge.vertices, axis=0), (0.4, 0.15, 0.016))
    fronts = [part.vertices[:, 2].min() for part in (edge, throat, flare)]
    assert fronts == sorted(fronts)
    assert len(set(fronts)) == 3


@pytest.mark.parametrize("height", [0.22, 0.40, 1.10])
@pytest.mark.parametrize("woofers", [1, 2, 4])
def test_drivers_fit_the_baffle_and_not_each_other(height: float, woofers: int) -> None:
    for seed in range(20):
        drivers = draw_drivers(np.random.default_rng(seed), BLACK, woofers)
        plate, *parts = baffle(drivers, (0.2, height, 0.25), 0.05, grille=False)
        outer = []  # the first part of each driver is its ring or plate
        for part in parts:
            low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
            y, reach = (low[1] + high[1]) / 2, (high[1] - low[1]) / 2
            if not any(abs(y - other) < 1e-9 for other, _ in outer):
                outer.append((y, reach))
        assert len(outer) == 1 + woofers + drivers.port
        for (upper, above), (lower, below) in itertools.pairwise(outer):
            assert upper - above > lower + below
        assert outer[0][0] + outer[0][1] < plate.vertices[:, 1].max() + 1e-9
        assert outer[-1][0] - outer[-1][1] > plate.vertices[:, 1].min() - 1e-9


def test_cloth_hides_the_drivers() -> None:
    (cloth,) = baffle(DRIVERS, (0.2, 0.4, 0.25), 0.0, grille=True)
    assert cloth.color == DRIVERS.cloth
    assert cloth.vertices[:, 2].min() < -0.125 < cloth.vertices[:, 2].max()


def test_plans_have_the_baffle_in_front_and_narrow_behind() -> None:
    for kind, rear in (("box", 1.0), ("tapered", 0.64), ("lute", 0.32)):
        plan = plan_of(kind)
        front, back = plan[plan[:, 1] == -0.5], plan[plan[:, 1] == 0.5]
        assert np.ptp(front[:, 0]) == pytest.approx(1.0)
        assert np.ptp(back[:, 0]) == pytest.approx(rear)


def test_towers_are_slender_and_bookshelf_boxes_are_not(
    speakers: Families,
) -> None:
    for obj in speakers["tower"]:
        width, height, depth = extents(obj.parts)
        assert height > 2.2 * width
        assert height > 1.5 * depth
    for obj in speakers["bookshelf"]:
        width, height, depth = extents(obj.parts)
        assert height < 2.1 * width
        assert depth < 2 * width


def test_a_stand_is_thin_below_its_box(speakers: Families) -> None:
    for obj in speakers["stand"]:
        low, high = box_of(obj.parts)
        column = cut(obj.parts, 1, 0.7 * low[1] + 0.3 * high[1])
        box = cut(obj.parts, 1, 0.1 * low[1] + 0.9 * high[1])
        assert np.ptp(column[:, 2]) < 0.5 * np.ptp(box[:, 2])


def test_monitors_lie_level_and_look_up(speakers: Families) -> None:
    wedges = [o for o in speakers["stage"] if len(o.parts[0].vertices) == 8]
    assert len(wedges) >= 5
    for obj in wedges:
        body = obj.parts[0].vertices
        floor = body[body[:, 1] < body[:, 1].min() + 1e-9]
        assert len(floor) == 4
        # The baffle, between the lowest edge in front and the highest: it leans back.
        top = body[body[:, 1] > body[:, 1].max() - 1e-9]
        assert floor[:, 2].min() + 0.1 < top[:, 2].min() < floor[:, 2].max()


def test_tripods_stand_on_three_feet(speakers: Families) -> None:
    tripods = [o for o in speakers["stage"] if extents(o.parts)[1] > 1.2]
    assert len(tripods) >= 5
    for obj in tripods:
        low, high = box_of(obj.parts)
        shins = cut(obj.parts, 1, low[1] + 0.05 * (high[1] - low[1]))
        angle = np.degrees(np.arctan2(shins[:, 2], shins[:, 0])) % 120
        # At 90, 210 and 330 degrees; a leg of radius 0.014 at 0.3 and more is 3 degrees to a side.
        assert np.ptp((angle + 90) % 120) < 8
        assert np.hypot(shins[:, 0], shins[:, 2]).min() > 0.15


def test_satellites_stand_on_a_round_foot(speakers: Families) -> None:
    for obj in speakers["desktop"]:
        lowest = min(obj.parts, key=lambda part: part.vertices[:, 1].min())
        width, _, depth = np.ptp(lowest.vertices, axis=0)
        # Polygons of 16 and 18 sides: across corners over across flats.
        assert width == pytest.approx(depth, rel=1 / math.cos(math.pi / 16) - 1)


def test_cylinders_are_round_and_soundbars_are_long(speakers: Families) -> None:
    for obj in speakers["cylinder"]:
        width, _, depth = extents(obj.parts)
        assert width == pytest.approx(depth, rel=1 / math.cos(math.pi / 20) - 1)
    for obj in speakers["soundbar"]:
        width, height, depth = extents(obj.parts)
        assert width > 4 * max(height, depth)


def test_drivers_are_in_front(speakers: Families) -> None:
    for family in ("bookshelf", "soundbar"):
        for obj in speakers[family]:
            body = obj.parts[0].vertices
            low, high = box_of(obj.parts)
            assert low[2] < body[:, 2].min()
            assert high[2] == pytest.approx(body[:, 2].max())


def test_colours(speakers: Families) -> None:
    """Stages are dark, living rooms mostly of wood or black."""

    def dark(obj: Drawn) -> bool:
        return max(obj.parts[0].color) < 80

    def wooden(obj: Drawn) -> bool:
        red, _, blue = obj.parts[0].color
        return red > 1.3 * blue and red > 80

    assert np.mean([dark(obj) for obj in speakers["stage"]]) > 0.85
    assert 0.25 < np.mean([wooden(obj) for obj in speakers["tower"]]) < 0.6
    assert np.mean([dark(obj) for obj in speakers["soundbar"]]) > 0.6


def test_ports_and_woofers_are_as_many_as_described() -> None:
    described = dataclasses.replace(DRIVERS, port=True)
    with_port = baffle(described, (0.2, 0.9, 0.25), 0.0, grille=False)
    without = baffle(
        dataclasses.replace(described, port=False), (0.2, 0.9, 0.25), 0.0, grille=False
    )
    # A plate, a dome of two parts, two woofers of three each, a port of two.
    assert (len(with_port), len(without)) == (1 + 2 + 6 + 2, 1 + 2 + 6)
