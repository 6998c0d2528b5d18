"""Parts that the builders of several families are made of, against closed forms.

What one family alone uses is pinned with it: see test_pinned.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from data_prep.shapes.fronts import dial, panel
from data_prep.shapes.furniture import beam, cushion, run
from data_prep.shapes.hulls import AEROFOIL, blade, disc, mirrored, pair
from data_prep.shapes.solids import Part, box, rectangle
from data_prep.shapes.telephone.parts import key_color
from tests.data_prep.shapes.solid_checks import EXACT, GREY, box_of, polygon_area, volume


def prismatoid(height: float, *areas: float) -> float:
    """Volume between two sections, given both and the one half-way."""
    low, middle, high = areas
    return height / 6 * (low + 4 * middle + high)


def has_box(part: Part, low: tuple, high: tuple) -> None:
    np.testing.assert_allclose(box_of([part]), (low, high), rtol=0, atol=EXACT)


def test_panel_is_a_box_with_width_height_and_thickness_along_x_y_and_z() -> None:
    part = panel((1, 2, 3), (0.8, 0.5, 0.1), GREY)
    assert volume(part) == pytest.approx(0.8 * 0.5 * 0.1, rel=EXACT)
    has_box(part, (0.6, 1.75, 2.95), (1.4, 2.25, 3.05))
    # A parabola in two chords cuts r^2 (1/6 + 1/12) off each of four round corners: test_solids.
    part = panel((0, 0, 0), (0.8, 0.5, 0.1), GREY, corner=0.1)
    assert volume(part) == pytest.approx((0.4 - 4 * 0.01 * (1 / 6 + 1 / 12)) * 0.1, rel=EXACT)
    part = panel((0, 0, 0), (0.8, 0.5, 0.1), GREY, bevel=0.02)  # off front and back
    frustum = prismatoid(0.02, 0.4, 0.78 * 0.48, 0.76 * 0.46)
    assert volume(part) == pytest.approx(0.4 * 0.06 + 2 * frustum, rel=EXACT)


def test_dial_grows_towards_the_front() -> None:
    part = dial((1, 2, 3), [(0.4, -0.1), (0.2, 0.3)], GREY, sides=12)
    depth = part.vertices[:, 2]
    assert (depth.min(), depth.max()) == pytest.approx((2.7, 3.1))
    radius = np.linalg.norm(part.vertices[depth < 2.9, :2] - (1, 2), axis=1)
    np.testing.assert_allclose(radius, 0.2, rtol=EXACT)
    expected = polygon_area(12, 1) * 0.4 / 3 * (0.16 + 0.08 + 0.04)
    assert volume(part) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("axis", [0, 2])
def test_a_run_is_its_section_times_its_length(axis: int) -> None:
    bar = run(rectangle(0.2, 0.3), (-1.0, 0.5, 2.0), GREY, at=(5.0, 7.0), axis=axis)
    assert volume(bar) == pytest.approx(0.2 * 0.3 * 3.0, abs=EXACT)
    assert (bar.vertices[:, axis] == 0.5).sum() == 4  # a ring of vertices at each station
    # The section's first axis lies across the bar, its second one points up.
    low, high = np.array([4.9, 6.85, 4.9]), np.array([5.1, 7.15, 5.1])
    low[axis], high[axis] = -1.0, 2.0
    has_box(bar, tuple(low), tuple(high))


def test_a_beam_has_level_width_and_upright_height() -> None:
    bar = beam((0, 0, 0), (3, 1, 4), 0.2, 0.1, GREY)
    assert volume(bar) == pytest.approx(0.2 * 0.1 * 5.0, abs=EXACT)  # 5: its length seen from above
    assert np.ptp(bar.vertices[:, 1]) == pytest.approx(1.1, abs=EXACT)


def test_a_cushion_fills_its_size_but_for_edges_and_corners() -> None:
    soft, corner = 0.06, 0.1
    part = cushion((1, 2, 3), (0.8, 0.2, 0.6), GREY, soft=soft, corner=corner)
    has_box(part, (0.6, 1.9, 2.7), (1.4, 2.1, 3.3))

    def area(inset: float) -> float:  # four right triangles are cut off
        return (0.8 - 2 * inset) * (0.6 - 2 * inset) * (1 - 2 * corner**2)

    # Up from the lower side: soft * (0, 1 - sqrt(1/2), 1), drawn in by the same in reverse.
    step = (1 - math.sqrt(0.5)) * soft
    slices = [(step, soft, step), (soft - step, step, 0.0)]
    ends = sum(prismatoid(h, area(a), area((a + b) / 2), area(b)) for h, a, b in slices)
    assert volume(part) == pytest.approx(2 * ends + (0.2 - 2 * soft) * area(0), abs=EXACT)


def test_a_blade_of_one_chord_is_an_aerofoil_times_its_span() -> None:
    x, y = AEROFOIL.T
    area = abs(float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())) / 2
    wing = blade([(-1, 0, 0.2, 0.5, 0.1), (2, 0, 0.3, 0.5, 0.1)], GREY)
    fin = blade([(0, -1, 0.2, 0.5, 0.1), (0, 2, 0.3, 0.5, 0.1)], GREY, upright=True)
    for part, extent in ((wing, (3.0, 0.1, 0.6)), (fin, (0.1, 3.0, 0.6))):
        assert volume(part) == pytest.approx(area * 0.5 * 0.1 * 3, abs=EXACT)
        assert np.ptp(part.vertices, axis=0) == pytest.approx(extent, abs=EXACT)


def test_a_disc_turns_about_x() -> None:
    wheel = disc((1, 2, 3), 0.5, 0.2, GREY, sides=14)
    assert volume(wheel) == pytest.approx(polygon_area(14, 0.5) * 0.2, abs=EXACT)
    assert wheel.vertices.mean(axis=0) == pytest.approx((1, 2, 3), abs=EXACT)
    # A bevel turns the ends into frustums between radius 0.4 and 0.5.
    bevelled = disc((1, 2, 3), 0.5, 0.2, GREY, bevel=0.05, sides=14)
    end = prismatoid(0.05, 0.45**2, 0.475**2, 0.5**2)
    assert volume(bevelled) == pytest.approx(
        polygon_area(14, 1) * (0.5**2 * 0.1 + 2 * end), abs=EXACT
    )


def test_a_mirror_image_faces_outwards() -> None:
    part = box((1, 2, 3), (0.2, 0.4, 0.6), GREY)
    image = mirrored(part)
    assert volume(image) == pytest.approx(volume(part), abs=EXACT)
    assert image.vertices.mean(axis=0) == pytest.approx((-1, 2, 3), abs=EXACT)
    assert [p.vertices[0, 0] for p in pair(part)] == [part.vertices[0, 0], -part.vertices[0, 0]]


def test_keys_differ_in_colour_from_the_body() -> None:
    rng = np.random.default_rng(1)
    for grey in range(12, 231, 6):
        # Dark: at most 51 * 1.1 + 6; light: at least 152 * 0.9 - 6, about 110.
        assert abs(sum(key_color(rng, (grey, grey, grey))) / 3 - grey) > 18
