from __future__ import annotations

import math

import numpy as np
import pytest

from data_prep.shapes.display.parts import Head, Look, column, curved_head, flat_head, foot
from data_prep.shapes.solids import Part
from tests.data_prep.shapes.samples import Families, of_each_family
from tests.data_prep.shapes.sections import box_of, cut, extents

CASE, BORDER, SCREEN, STAND = (180, 182, 184), (30, 31, 32), (60, 110, 170), (90, 92, 94)
LOOK = Look(CASE, BORDER, SCREEN, STAND)
HEAD = Head(
    width=0.6,
    height=0.4,
    thickness=0.03,
    border=0.02,
    chin=0.05,
    corner=0.01,
    bulge=0.04,
    bulge_share=0.5,
)


@pytest.fixture(scope="module")
def displays() -> Families:
    return of_each_family("display", seed=31, count=30)


def of(parts: list[Part], color: tuple[int, int, int]) -> np.ndarray:
    return np.concatenate([part.vertices for part in parts if part.color == color])


def test_the_screen_is_let_in_and_looks_to_the_front() -> None:
    parts = flat_head(HEAD, LOOK)
    step = HEAD.step
    # A hundredth of the radius, which is half of the diagonal.
    assert step == pytest.approx(0.01 * np.hypot(0.6, 0.4) / 2)
    front = -HEAD.thickness / 2
    assert of(parts, BORDER)[:, 2].min() == pytest.approx(front - 2 * step)
    assert of(parts, SCREEN)[:, 2].min() == pytest.approx(front - step)
    assert of(parts, SCREEN)[:, 2].max() > front
    assert of(parts, CASE)[:, 2].max() == pytest.approx(0.015 + 0.04)


def test_the_border_is_as_wide_as_it_says_and_the_chin_is_below() -> None:
    parts = flat_head(HEAD, LOOK)
    border, screen = of(parts, BORDER), of(parts, SCREEN)
    bevel = 0.4 * HEAD.corner
    hair = 0.2 * HEAD.step + bevel
    assert border[:, 0].max() == pytest.approx(0.3 - hair)
    assert border[:, 1].max() == pytest.approx(0.2 - hair)
    assert border[:, 1].min() == pytest.approx(-0.2 + HEAD.chin + hair)
    # The screen reaches under the border, by 0.4 of it.
    assert border[:, 0].max() - screen[:, 0].max() == pytest.approx(0.6 * HEAD.border)
    above, below = 0.2 - screen[:, 1].max(), screen[:, 1].min() + 0.2
    assert below - above == pytest.approx(HEAD.chin)


def test_a_curved_screen_is_concentric_with_its_case() -> None:
    angle = 0.4
    case, screen, _ = curved_head(HEAD, LOOK, angle)
    centre = -0.3 / math.sin(angle)  # on the z axis, in front
    radius = {
        color: np.unique(np.hypot(part.vertices[:, 0], part.vertices[:, 2] - centre).round(9))
        for color, part in ((CASE, case), (SCREEN, screen))
    }
    assert len(radius[CASE]) == len(radius[SCREEN]) == 2
    np.testing.assert_allclose(np.diff(radius[CASE]), HEAD.thickness, atol=1e-8)
    # Its face is 1.4 layers nearer to the viewer than the case's, its back within the case.
    assert radius[CASE][0] - radius[SCREEN][0] == pytest.approx(1.4 * HEAD.step, abs=1e-8)
    assert radius[CASE][0] < radius[SCREEN][1] < radius[CASE][1]
    # A border's width of the arc is left free at either end, as above and below.
    ends = np.abs(np.arctan2(screen.vertices[:, 0], screen.vertices[:, 2] - centre)).max()
    assert (angle - ends) * 0.3 / math.sin(angle) == pytest.approx(HEAD.border)
    assert screen.vertices[:, 1].max() == pytest.approx(0.2 - HEAD.border)


def test_feet_reach_as_far_as_they_are_high() -> None:
    kinds = set()
    for seed in range(40):
        parts, top = foot(np.random.default_rng(seed), 0.3, 0.2, STAND)
        vertices = np.concatenate([part.vertices for part in parts])
        kinds.add(len(parts))
        assert abs(vertices[:, 1].min()) < 0.01
        assert 0.5 * top < vertices[:, 1].max() < 1.3 * top
        assert 0.28 < np.ptp(vertices[:, 0]) < 0.34
    assert kinds == {1, 3}  # a plate or a disc, and two bars with a hub


def test_columns_stand_between_their_ends() -> None:
    part = column((0.1, 0.5), 0.02, (0.08, 0.03), STAND)
    np.testing.assert_allclose(part.vertices.min(axis=0), (-0.04, 0.1, 0.005), atol=1e-12)
    np.testing.assert_allclose(part.vertices.max(axis=0), (0.04, 0.5, 0.035), atol=1e-12)


def test_monitors_stand_on_a_foot_narrower_than_the_screen(displays: Families) -> None:
    for obj in displays["monitor"]:
        low, high = box_of(obj.parts)
        neck = cut(obj.parts, 1, low[1] + 0.045)
        assert np.ptp(neck[:, 0]) < 0.6 * (high - low)[0]
        assert (high - low)[2] < 0.9 * (high - low).max()


def test_televisions_are_wide_and_flat(displays: Families) -> None:
    for obj in displays["television"]:
        width, height, depth = extents(obj.parts)
        assert 1.15 < width / height < 2.0
        assert depth < 0.45 * width


def test_tubes_narrow_to_the_rear(displays: Families) -> None:
    for obj in displays["tube-monitor"]:
        width, _, depth = extents(obj.parts)
        assert depth > 0.75 * width
        case = obj.parts[0].vertices
        low, high = case[:, 2].min(), case[:, 2].max()
        front = cut(obj.parts[:1], 2, low + 0.12 * (high - low))
        rear = cut(obj.parts[:1], 2, low + 0.93 * (high - low))
        assert np.ptp(rear[:, 0]) < 0.85 * np.ptp(front[:, 0])


def test_dials_are_on_the_viewers_right(displays: Families) -> None:
    for obj in displays["old-television"]:
        middle = (box_of(obj.parts)[0] + box_of(obj.parts)[1])[0] / 2
        dials = [part for part in obj.parts if len(part.vertices) in (24, 36)]
        # Seen from -Z, right is towards -X.
        assert len(dials) >= 2
        assert max(part.vertices[:, 0].max() for part in dials[:2]) < middle


def test_all_in_ones_have_a_chin(displays: Families) -> None:
    for obj in displays["all-in-one"]:
        case, _, screen = (part.vertices[:, 1] for part in obj.parts[:3])
        assert screen.min() - case.min() > 1.5 * (case.max() - screen.max())


def test_pairs_are_equal_and_mirrored(displays: Families) -> None:
    for obj in displays["pair"]:
        half = len(obj.parts)
        left, right = (
            obj.parts[2],
            obj.parts[
                next(
                    k
                    for k in range(3, half)
                    if obj.parts[k].color == obj.parts[2].color
                    and len(obj.parts[k].vertices) == len(obj.parts[2].vertices)
                )
            ],
        )
        assert left.vertices[:, 0].mean() < 0 < right.vertices[:, 0].mean()
        low, high = left.vertices.min(axis=0), left.vertices.max(axis=0)
        np.testing.assert_allclose(right.vertices.min(axis=0)[1:], low[1:], atol=1e-9)
        assert right.vertices[:, 0].max() == pytest.approx(-low[0])
        assert right.vertices[:, 0].min() == pytest.approx(-high[0])
        # Turned towards each other: the outer edges are nearer to the viewer.
        outer = left.vertices[left.vertices[:, 0] < low[0] + 0.02, 2]
        inner = left.vertices[left.vertices[:, 0] > high[0] - 0.02, 2]
        assert outer.mean() < inner.mean()


def test_signs_are_as_tall_as_a_person(displays: Families) -> None:
    for obj in displays["sign"]:
        assert 1.4 < extents(obj.parts)[1] < 2.2


def test_cases_of_living_rooms_are_dark(displays: Families) -> None:
    share = {f: np.mean([max(o.parts[0].color) < 80 for o in objs]) for f, objs in displays.items()}
    # 0.72 by the table; four standard errors.
    tolerance = 4 * np.sqrt(0.72 * 0.28 / len(displays["television"]))
    assert share["television"] == pytest.approx(0.72, abs=tolerance)
    assert share["all-in-one"] < 0.35
    assert share["tube-monitor"] < 0.5
