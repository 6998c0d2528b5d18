from __future__ import annotations

import math

import numpy as np
import pytest

from data_prep.shapes.fronts import dial, frame, panel
from tests.data_prep.shapes.sections import volume

GREY = (120, 121, 122)
# A few hundred float64 operations on numbers of order 1: see test_solids.
EXACT = 1e-12


def test_panel_is_a_box_with_width_height_and_thickness_along_x_y_and_z() -> None:
    part = panel((1, 2, 3), (0.8, 0.5, 0.1), GREY)
    assert volume(part) == pytest.approx(0.8 * 0.5 * 0.1, rel=EXACT)
    np.testing.assert_allclose(part.vertices.min(axis=0), (0.6, 1.75, 2.95), rtol=EXACT)
    np.testing.assert_allclose(part.vertices.max(axis=0), (1.4, 2.25, 3.05), rtol=EXACT)


def test_panel_with_round_corners() -> None:
    # A parabola in two chords cuts r^2 (1/6 + 1/12) off each of the four: see test_solids.
    part = panel((0, 0, 0), (0.8, 0.5, 0.1), GREY, corner=0.1)
    assert volume(part) == pytest.approx((0.4 - 4 * 0.01 * (1 / 6 + 1 / 12)) * 0.1, rel=EXACT)


def test_panel_bevels_front_and_back() -> None:
    part = panel((0, 0, 0), (0.8, 0.5, 0.1), GREY, bevel=0.02)
    front = part.vertices[part.vertices[:, 2] < -0.0499]
    np.testing.assert_allclose(np.ptp(front, axis=0), (0.76, 0.46, 0), atol=EXACT)
    # Simpson's rule is exact for the frusta, whose section is quadratic in the depth.
    frustum = 0.02 / 6 * (0.4 + 4 * 0.78 * 0.48 + 0.76 * 0.46)
    assert volume(part) == pytest.approx(0.4 * 0.06 + 2 * frustum, rel=EXACT)


def test_frame_has_an_opening() -> None:
    part = frame((0, 1, 0), (0.8, 0.5, 0.1), 0.05, GREY)
    assert volume(part) == pytest.approx((0.8 * 0.5 - 0.7 * 0.4) * 0.1, rel=EXACT)
    y = part.vertices[:, 1]
    np.testing.assert_allclose(np.unique(y.round(9)), (0.75, 0.8, 1.2, 1.25))


def test_dial_grows_towards_the_front() -> None:
    part = dial((1, 2, 3), [(0.4, -0.1), (0.2, 0.3)], GREY, sides=12)
    near, far = part.vertices[:, 2].min(), part.vertices[:, 2].max()
    assert (near, far) == pytest.approx((2.7, 3.1))
    tip = part.vertices[part.vertices[:, 2] < 2.9]
    radius = np.linalg.norm(tip[:, :2] - (1, 2), axis=1)
    np.testing.assert_allclose(radius, 0.2, rtol=EXACT)
    section = 12 / 2 * math.sin(2 * math.pi / 12)
    assert volume(part) == pytest.approx(section * 0.4 / 3 * (0.16 + 0.08 + 0.04), rel=1e-9)
