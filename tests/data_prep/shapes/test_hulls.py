from __future__ import annotations

import math

import numpy as np
import pytest

from data_prep.shapes.hulls import AEROFOIL, blade, disc, mirrored, pair, spindle
from data_prep.shapes.solids import box
from tests.data_prep.shapes.sections import volume

GREY = (120, 121, 122)
# A few hundred float64 operations on numbers of order 1: see test_solids.
EXACT = 1e-12


def polygon_area(sides: int) -> float:
    """Of the regular polygon in the unit circle."""
    return sides / 2 * math.sin(2 * math.pi / sides)


def test_a_spindle_of_one_section_is_an_elliptical_prism() -> None:
    part = spindle([(-1, 0.3, 0.2, 0.5), (2, 0.3, 0.2, 0.5)], GREY, x=4.0, sides=10)
    assert volume(part) == pytest.approx(polygon_area(10) * 0.2 * 0.5 * 3, abs=EXACT)
    assert part.vertices.mean(axis=0) == pytest.approx((4.0, 0.3, 0.5), abs=EXACT)


def test_a_blade_of_one_chord_is_an_aerofoil_times_its_span() -> None:
    x, y = AEROFOIL.T
    area = abs(float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())) / 2
    wing = blade([(-1, 0, 0.2, 0.5, 0.1), (2, 0, 0.3, 0.5, 0.1)], GREY)
    assert volume(wing) == pytest.approx(area * 0.5 * 0.1 * 3, abs=EXACT)
    fin = blade([(0, -1, 0.2, 0.5, 0.1), (0, 2, 0.3, 0.5, 0.1)], GREY, upright=True)
    assert volume(fin) == pytest.approx(volume(wing), abs=EXACT)
    assert np.ptp(fin.vertices, axis=0) == pytest.approx((0.1, 3.0, 0.6), abs=EXACT)
    assert np.ptp(wing.vertices, axis=0) == pytest.approx((3.0, 0.1, 0.6), abs=EXACT)


def test_a_disc_turns_about_x() -> None:
    wheel = disc((1, 2, 3), 0.5, 0.2, GREY, sides=14)
    assert volume(wheel) == pytest.approx(polygon_area(14) * 0.5**2 * 0.2, abs=EXACT)
    assert wheel.vertices.mean(axis=0) == pytest.approx((1, 2, 3), abs=EXACT)
    # A bevel turns the ends into frustums between radius 0.4 and 0.5.
    bevelled = disc((1, 2, 3), 0.5, 0.2, GREY, bevel=0.05, sides=14)
    frustum = 0.05 / 3 * (0.45**2 + 0.45 * 0.5 + 0.5**2)
    expected = polygon_area(14) * (0.5**2 * 0.1 + 2 * frustum)
    assert volume(bevelled) == pytest.approx(expected, abs=EXACT)


def test_a_mirror_image_faces_outwards() -> None:
    part = box((1, 2, 3), (0.2, 0.4, 0.6), GREY)
    image = mirrored(part)
    assert volume(image) == pytest.approx(volume(part), abs=EXACT)
    assert image.vertices.mean(axis=0) == pytest.approx((-1, 2, 3), abs=EXACT)
    assert [p.vertices[0, 0] for p in pair(part)] == [part.vertices[0, 0], -part.vertices[0, 0]]
