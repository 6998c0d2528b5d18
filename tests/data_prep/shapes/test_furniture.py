from __future__ import annotations

import math

import numpy as np
import pytest

from data_prep.shapes.furniture import back_cushion, beam, cushion, legs, run
from data_prep.shapes.solids import rectangle
from tests.data_prep.shapes.sections import volume

GREY = (120, 120, 120)
EXACT = 1e-12  # a few dozen roundings of float64 at lengths about 1


@pytest.mark.parametrize("axis", [0, 2])
def test_a_run_is_its_section_times_its_length(axis: int) -> None:
    bar = run(rectangle(0.2, 0.3), (-1.0, 2.0), GREY, at=(5.0, 7.0), axis=axis)
    assert volume(bar) == pytest.approx(0.2 * 0.3 * 3.0, abs=EXACT)
    low, high = bar.vertices.min(axis=0), bar.vertices.max(axis=0)
    assert (low[axis], high[axis]) == (-1.0, 2.0)
    # The section's first axis lies across the bar, its second one points up.
    assert (low[2 - axis], high[2 - axis]) == pytest.approx((4.9, 5.1), abs=EXACT)
    assert (low[1], high[1]) == pytest.approx((6.85, 7.15), abs=EXACT)


def test_stations_between_the_ends_of_a_run_change_nothing() -> None:
    plain, divided = (run(rectangle(1, 2), at, GREY) for at in ((0.0, 3.0), (0.0, 1.0, 3.0)))
    assert volume(plain) == pytest.approx(volume(divided), abs=EXACT)
    assert len(divided.vertices) == 12
    assert (divided.vertices[:, 0] == 1.0).sum() == 4


def test_a_bevel_takes_frusta_off_the_ends_of_a_run() -> None:
    width, height, b = 0.4, 0.6, 0.1
    bar = run(rectangle(width, height), (0.0, 2.0), GREY, bevel=b)

    def area(inset: float) -> float:
        return (width - 2 * inset) * (height - 2 * inset)

    end = b / 6 * (area(0) + 4 * area(b / 2) + area(b))  # prismatoid
    assert volume(bar) == pytest.approx(area(0) * (2.0 - 2 * b) + 2 * end, abs=EXACT)


def test_legs_stand_at_four_corners_and_splay() -> None:
    square = rectangle(0.1, 0.1)
    four = legs(1.0, 0.5, 0.8, 0.5 * square, square, GREY, out=0.2, centre=(3.0, 4.0))
    feet = {tuple(leg.vertices[leg.vertices[:, 1] == 0].mean(axis=0).round(9)) for leg in four}
    heads = {tuple(leg.vertices[leg.vertices[:, 1] == 0.8].mean(axis=0).round(9)) for leg in four}
    assert feet == {(x, 0.0, z) for x in (1.8, 4.2) for z in (3.3, 4.7)}
    assert heads == {(x, 0.8, z) for x in (2.0, 4.0) for z in (3.5, 4.5)}
    frustum = 0.8 / 3 * (0.05**2 + 0.05 * 0.1 + 0.1**2)  # a shear keeps the volume
    assert [volume(leg) for leg in four] == pytest.approx([frustum] * 4, abs=EXACT)


def test_a_beam_has_level_width_and_upright_height() -> None:
    bar = beam((0, 0, 0), (3, 1, 4), 0.2, 0.1, GREY)
    assert volume(bar) == pytest.approx(0.2 * 0.1 * 5.0, abs=EXACT)  # 5: its length seen from above
    assert np.ptp(bar.vertices[:, 1]) == pytest.approx(1.1, abs=EXACT)


def test_a_cushion_fills_its_size_but_for_edges_and_corners() -> None:
    size, soft, corner = (0.8, 0.2, 0.6), 0.06, 0.1
    part = cushion((1, 2, 3), size, GREY, soft=soft, corner=corner)
    low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
    assert high - low == pytest.approx(size, abs=EXACT)
    assert (high + low) / 2 == pytest.approx((1, 2, 3), abs=EXACT)

    def area(inset: float) -> float:  # four right triangles are cut off
        return (0.8 - 2 * inset) * (0.6 - 2 * inset) * (1 - 2 * corner**2)

    # Up from the lower side: soft * (0, 1 - sqrt(1/2), 1), drawn in by the same in reverse.
    step = (1 - math.sqrt(0.5)) * soft
    slices = [(step, soft, step), (soft - step, step, 0.0)]
    rim = sum(h / 6 * (area(a) + 4 * area((a + b) / 2) + area(b)) for h, a, b in slices)
    assert volume(part) == pytest.approx(2 * rim + (0.2 - 2 * soft) * area(0), abs=EXACT)


def test_a_back_cushion_leans_to_the_rear_about_its_foot() -> None:
    tilt = 0.3
    part = back_cushion((1, 2, 3), (0.5, 0.4, 0.1), GREY, soft=0.03, tilt_rad=tilt)
    middle = (part.vertices.min(axis=0) + part.vertices.max(axis=0)) / 2
    up = np.array([0.0, math.cos(tilt), math.sin(tilt)])
    assert middle == pytest.approx(np.array([1, 2, 3]) + 0.2 * up, abs=EXACT)
    assert np.ptp(part.vertices @ up) == pytest.approx(0.4, abs=EXACT)
    assert np.ptp(part.vertices[:, 0]) == pytest.approx(0.5, abs=EXACT)
