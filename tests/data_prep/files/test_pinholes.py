"""Files of cameras: both formats against numbers written down by hand, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

from data_prep.failures import BadInput
from data_prep.files.pinholes import read_pinholes

SIDES = range(16, 2049)
# A camera at (1, 2, 3) that looks along -Z with +Y up: in the axes of OpenGL it is not turned.
POSE = [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
OPEN3D = {
    "class_name": "PinholeCameraParameters",
    # World to camera with +Y down and +Z ahead, column by column: x - 1, 2 - y, 3 - z.
    "extrinsic": [1.0, 0, 0, 0, 0, -1.0, 0, 0, 0, 0, -1.0, 0, -1.0, 2.0, 3.0, 1.0],
    "intrinsic": {
        "height": 480,
        "intrinsic_matrix": [500.0, 0, 0, 0, 501.0, 0, 300.0, 239.5, 1.0],
        "width": 640,
    },
    "version_major": 1,
    "version_minor": 0,
}
TRANSFORMS = {
    "camera_model": "OPENCV",
    "fl_x": 500.0,
    "fl_y": 501.0,
    "cx": 300.5,
    "cy": 240.0,
    "w": 640,
    "h": 480.0,
    "k1": 0.0,
    "frames": [
        {"file_path": "./images/b.jpg", "transform_matrix": POSE},
        {"file_path": "images/a.jpg", "transform_matrix": POSE, "fl_x": 510, "fl_y": 510},
    ],
}
NERF = {"camera_angle_x": 0.6911112070083618, "w": 800, "h": 600}  # of its synthetic scenes


@pytest.fixture
def read(tmp_path):
    def write_and_read(contents):
        path = tmp_path / "c.json"
        path.write_text(contents if isinstance(contents, str) else json.dumps(contents))
        return read_pinholes(path, SIDES)

    return write_and_read


@pytest.mark.parametrize("contents", [OPEN3D, TRANSFORMS], ids=["open3d", "transforms"])
def test_a_camera_in_both_formats(read, contents):
    cameras = read(contents)
    assert (cameras.width, cameras.height) == (640, 480)
    np.testing.assert_allclose(cameras.poses[0], POSE, rtol=0, atol=1e-12)
    # Open3D counts columns from the centre of the first pixel, COLMAP from its left edge.
    np.testing.assert_allclose(cameras.centres_px[0], [300.5, 240.0])
    np.testing.assert_allclose(cameras.focal_px[0], [500, 501])


def test_several_cameras_and_their_names(read):
    frames = read(TRANSFORMS)
    assert frames.names == ("b", "a")
    np.testing.assert_allclose(frames.focal_px, [[500, 501], [510, 510]])
    assert read({"parameters": [OPEN3D] * 11}).names[::10] == ("01", "11")
    same = [{"transform_matrix": POSE, "file_path": f"{folder}/0.png"} for folder in "ab"]
    nerf = read({**NERF, "frames": same})
    assert nerf.names == ("1", "2")
    np.testing.assert_allclose(nerf.focal_px, 1111.1110311937682)  # as NeRF's own loader has it
    np.testing.assert_allclose(nerf.centres_px, [[400, 300]] * 2)


def test_cameras_in_other_axes(read):
    turned = read(OPEN3D).turned("z", None)  # (x, y, z) becomes (-x, z, y)
    assert turned.poses[0, :3].tolist() == [[-1, 0, 0, -1], [0, 0, 1, 3], [0, 1, 0, 2]]


def changed(contents, keys, value):
    contents = json.loads(json.dumps(contents))  # a copy of each part
    inner = contents
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    return contents


OF_FRAME = ("frames", 1, "transform_matrix")
TURNED = [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
SKEW = [500.0, 0, 0, 1.0, 501.0, 0, 300.0, 239.5, 1.0]
REFUSED = {
    "{": "not JSON; give one of Open3D",
    "[1]": "no camera with a pose; give one of Open3D",
    '{"fl_x": 1, "frames": []}': "no camera with a pose",
    '{"parameters": [1]}': "no 'intrinsic'",
}
CHANGED = [
    (OPEN3D, ("extrinsic",), POSE[0], "'extrinsic' has to be 4 x 4 finite numbers; write"),
    (
        OPEN3D,
        ("extrinsic",),
        np.ravel(POSE).tolist(),
        "the last row of 'extrinsic' is 1 2 3 1, not 0 0 0 1; ",
    ),
    (OPEN3D, ("intrinsic", "width"), 3000, "3000 x 480 pixels; give 16 to 2048, and scale"),
    (OPEN3D, ("intrinsic", "height"), 15, "640 x 15 pixels; give 16 to 2048, and scale"),
    (OPEN3D, ("intrinsic", "height"), 480.5, "'height' is 480.5; give a whole number of pixels"),
    (OPEN3D, ("intrinsic", "intrinsic_matrix"), SKEW, "is no pinhole's, or has a skew; give fx 0 "),
    (TRANSFORMS, ("k1",), 0.01, "camera 1: no pinhole, k1 is 0.01; undistort its images"),
    (TRANSFORMS, ("is_fisheye",), True, "no pinhole, is_fisheye; undistort"),
    (TRANSFORMS, ("camera_model",), "OPENCV_FISHEYE", "no pinhole, 'OPENCV_FISHEYE'; undistort"),
    (TRANSFORMS, ("fl_y",), 600, "focal lengths of 500 and 600 pixels; give square pixels"),
    (TRANSFORMS, ("fl_x",), float("nan"), "'fl_x' is nan; give a finite number"),
    (TRANSFORMS, ("cx",), "300", "'cx' is '300'; give a number"),
    (TRANSFORMS, ("w",), None, "camera 1: no 'w'; add it"),
    (TRANSFORMS, ("frames", 1, "w"), 641, "camera 2 has 641 x 480 pixels, the first 640 x 480; "),
    (TRANSFORMS, (*OF_FRAME, 0, 0), 1.01, "camera 2: 'transform_matrix' is no rotation and move "),
    (TRANSFORMS, (*OF_FRAME, 0, 0), -1, "is no rotation and move (a mirror); leave out scales"),
    (TRANSFORMS, ("frames", 0), {}, "camera 1: no 'transform_matrix'; give one of Open3D"),
    ({**NERF, "frames": [{"transform_matrix": TURNED}]}, ("camera_angle_x",), 3.5, "give an angle"),
]


@pytest.mark.parametrize("case", [*REFUSED.items(), *CHANGED], ids=lambda case: case[-1][:40])
def test_what_is_no_camera_is_refused(read, case):
    *contents, problem = case
    with pytest.raises(BadInput, match=r"c\.json: ") as refused:
        read(contents[0] if len(contents) == 1 else changed(*contents))
    assert problem in str(refused.value)
    assert "\n" not in str(refused.value)
