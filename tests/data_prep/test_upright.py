from __future__ import annotations

import numpy as np
import pytest

from data_prep.failures import BadInput
from data_prep.orientations import AXES, upright

UNIT = {
    "x": [1, 0, 0], "-x": [-1, 0, 0],
    "y": [0, 1, 0], "-y": [0, -1, 0],
    "z": [0, 0, 1], "-z": [0, 0, -1],
}  # fmt: skip
ALL = [(up, front) for up in AXES for front in AXES if up[-1] != front[-1]]


def test_our_own_axes_change_no_bit():
    points = np.array([[np.nan, -np.inf, -0.0], [1e-310, 2.0, 3.0]])
    assert upright(points).tobytes() == points.tobytes()
    assert upright(points, "y", "-z").tobytes() == points.tobytes()


def test_z_up_as_scans_have_it():
    """East x, north y, up z: one who looks north sees the front, with east on the right.

    At azimuth 0 our camera stands on -Z and sees -X on its right.
    """
    east, north, top = upright(np.eye(3), "z")
    assert east.tolist() == [-1, 0, 0]
    assert north.tolist() == [0, 0, 1]
    assert top.tolist() == [0, 1, 0]


@pytest.mark.parametrize(("up", "front"), ALL)
def test_every_pair_of_axes_is_a_turn(up, front):
    turned = upright(np.eye(3), up, front)
    assert np.linalg.det(turned) == 1  # no mirror
    assert (turned @ turned.T == np.eye(3)).all()
    assert upright(np.array([UNIT[up]], float), up, front).tolist() == [[0, 1, 0]]
    assert upright(np.array([UNIT[front]], float), up, front).tolist() == [[0, 0, -1]]


def test_all_turns_are_different():
    assert len({upright(np.eye(3), *axes).tobytes() for axes in ALL}) == 24


@pytest.mark.parametrize(
    ("up", "front"),
    [("y", "-z"), ("-y", "-z"), ("x", "-z"), ("-x", "-z"), ("z", "-y"), ("-z", "-y")],
)
def test_the_front_where_it_is_not_given(up, front):
    points = np.arange(6.0).reshape(2, 3)
    assert (upright(points, up) == upright(points, up, front)).all()


def test_values_that_are_not_finite_stay_where_they_are():
    points = np.array([[np.inf, 2.0, np.nan]])
    assert np.array_equal(upright(points, "z"), [[-np.inf, np.nan, 2.0]], equal_nan=True)


def test_no_points():
    assert upright(np.empty((0, 3)), "z").shape == (0, 3)


@pytest.mark.parametrize(
    ("axes", "message"),
    [
        (("w",), "up 'w': no axis; give one of x, -x, y, -y, z, -z"),
        (("y", "+z"), "front '+z': no axis; give one of x, -x, y, -y, z, -z"),
        (("z", "-z"), "front '-z': along up, which is 'z'; give one of x, -x, y, -y"),
    ],
)
def test_axes_that_are_none(axes, message):
    with pytest.raises(BadInput) as error:
        upright(np.empty((0, 3)), *axes)
    assert str(error.value) == message
