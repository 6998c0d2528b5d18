"""Images by the cameras of a file: where points appear by every method, and their files."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from PIL import Image

import bench
from bench.catalogue.methods import METHODS
from data_prep.failures import BadInput
from data_prep.files.clouds import save_ply
from data_prep.randomness import generator

# Eight corners of a box far from the origin, in the units of a file, each in its own colour. Two
# points that lie close together stand for each, so that their discs are small.
AT = np.array([500, -20, 10000])
CORNERS = AT + np.stack(np.meshgrid([-3, 3], [-1.5, 1.5], [-2, 2]), -1).reshape(-1, 3)
COLOURS = 60 * np.stack(np.meshgrid([1, 3], [1, 3], [0, 2]), -1).reshape(-1, 3)
POINTS = np.concatenate([CORNERS - 0.05, CORNERS + 0.05])


def looking(eye, at, roll_deg=0.0):
    """Return a pose from world to camera, with +X right, +Y down and +Z ahead, as Open3D has it."""
    ahead = np.subtract(at, eye) / np.linalg.norm(np.subtract(at, eye))
    right = np.cross(ahead, [0.0, 1.0, 0.1])
    right /= np.linalg.norm(right)
    turn, angle = np.eye(3), np.radians(roll_deg)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    pose = np.eye(4)
    pose[:3, :3] = turn @ [right, np.cross(ahead, right), ahead]
    pose[:3, 3] = -pose[:3, :3] @ eye
    return pose


def open3d(pose, focal, centre, size):
    """Return the contents of a file of Open3D, whose centre counts from a pixel's middle."""
    matrix = [focal, 0, 0, 0, focal, 0, *centre, 1]
    intrinsic = {"width": size[0], "height": size[1], "intrinsic_matrix": matrix}
    return {"extrinsic": pose.T.ravel().tolist(), "intrinsic": intrinsic}


def pixels_by_hand(points, pose, focal, centre):
    """Return columns and rows [N, 2] of points by K [R|t], as Open3D counts them."""
    local = points @ pose[:3, :3].T + pose[:3, 3]
    return focal * local[:, :2] / local[:, 2:] + centre


@pytest.mark.parametrize(
    ("eye", "roll", "focal", "centre", "size"),
    [
        ((508, -11, 10025), 0, 900, (319.5, 239.5), (640, 480)),
        ((520, -13, 9990), 30, 900, (180, 300), (400, 500)),  # far off the middle, and higher
        ((505, -14, 10006), -170, 200, (260, 120), (512, 256)),  # 2.5 radii away
        ((600, 300, 10700), 5, 14000, (100.25, 60), (200, 130)),  # a long lens
    ],
)
def test_points_appear_where_a_pinhole_shows_them(eye, roll, focal, centre, size):
    pose = looking(eye, AT, roll)
    camera = open3d(pose, focal, centre, size)
    colors = np.tile(COLOURS, (2, 1))
    image = bench.draw_cloud(POINTS, method="splat", colors=colors, camera=camera)
    assert image.shape == (size[1], size[0], 3)
    seen = []
    for colour in COLOURS:
        rows, columns = np.nonzero((image == colour).all(axis=-1))
        assert len(rows) > 20
        seen.append((columns.mean(), rows.mean()))
    # Pairs of discs have 4 pixels across or more: their pixels place them to 1/4 pixel.
    np.testing.assert_allclose(seen, pixels_by_hand(CORNERS, pose, focal, centre), atol=0.25)


BALL = generator("test").normal(size=(1500, 3))
BALL = 7 * BALL / np.linalg.norm(BALL, axis=1)[:, None] + [30, 0, -50]
SLOW = ("surface-apss", "upsampled-wrap", "fused-net")  # over two seconds
DRAWING = [
    pytest.param(m.id, marks=[pytest.mark.slow] if m.id in SLOW else [])
    for m in METHODS
    if m.sees_cloud and m.family != "pc2pix" and m.kind != "reference"
]


@pytest.mark.filterwarnings("ignore:.*:UserWarning")
@pytest.mark.parametrize("method", DRAWING)
def test_every_method_draws_by_a_camera(method):
    if method == "open3d-poisson":
        pytest.importorskip("open3d")
    eye, middle, focal, centre = [45, 12, -75], [30, 0, -50], 200, (140, 110)
    pose = looking(eye, [40, 3, -50], 20)  # past the ball, whose image is no circle then
    image = bench.draw_cloud(BALL, method=method, camera=open3d(pose, focal, centre, (320, 200)))
    assert image.shape == (200, 320, 3)
    # The pixels whose rays pass the middle of the ball at less than its radius, 7.
    rows, columns = np.mgrid[:200, :320]
    local = np.stack([(columns - centre[0]) / focal, (rows - centre[1]) / focal], -1)
    rays = np.concatenate([local, np.ones((200, 320, 1))], -1) @ pose[:3, :3]
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    ball = np.linalg.norm(np.cross(rays, np.subtract(middle, eye)), axis=-1) < 7
    drawn = image.min(axis=-1) < 195
    for pixels in (rows, columns):
        assert pixels[drawn].mean() == pytest.approx(pixels[ball].mean(), abs=1)
    # Discs and ball pivoting leave holes, of a fifth of the ball.
    assert (drawn & ball).sum() > 0.75 * (drawn | ball).sum()


def test_a_near_camera_sees_a_part():
    pose = looking([30.0, 0, -40], [33, 0, -43])  # 1.4 radii from the middle
    camera = open3d(pose, 200, (31.5, 31.5), (64, 64))
    image = bench.draw_cloud(BALL, method="alpha-wrap", camera=camera)
    local = BALL @ pose[:3, :3].T + pose[:3, 3]
    seen = pixels_by_hand(BALL, pose, 200, (31.5, 31.5))[local[:, 2] > 0].round().astype(int)
    seen = seen[((seen >= 0) & (seen < 64)).all(axis=1)]
    assert len(seen) > 10
    assert (image[seen[:, 1], seen[:, 0]].max(axis=-1) < 255).mean() > 0.9
    assert 100 < (image.min(axis=-1) == 255).sum() < 64 * 64 - 100


def test_images_of_a_file_of_cameras(command, tmp_path):
    cloud, cameras = tmp_path / "ball.ply", tmp_path / "transforms.json"
    save_ply(BALL.astype(np.float32), cloud)
    frames = []
    for name, eye in (("front", [30, 0, -90]), ("left", [-10, 0, -50])):
        pose = np.linalg.inv(looking(eye, [30, 0, -50])) @ np.diag([1, -1, -1, 1])
        frames.append({"file_path": f"{name}.jpg", "transform_matrix": pose.tolist()})
    cameras.write_text(json.dumps({"fl_x": 50, "w": 30, "h": 20, "frames": frames}))
    options = ("--method", "splat", "--camera", cameras, "-o", tmp_path / "x.png")
    status, out, _ = command("render", cloud, *options, "--background", "transparent")
    images = [tmp_path / "x-front.png", tmp_path / "x-left.png"]
    assert (status, out.split()) == (0, list(map(str, images)))
    for path in images:
        with Image.open(path) as image:
            opacity = np.asarray(image)[..., 3]
        assert opacity.shape == (20, 30)
        assert (opacity[10, 15], opacity[0, 0]) == (255, 0)


def test_the_camera_turns_with_the_cloud():
    pose = looking([500, -3, 10025], AT)
    camera = open3d(pose, 900, (200, 200), (400, 400))
    expected = bench.draw_cloud(POINTS, method="splat", camera=camera)
    turned = bench.draw_cloud(POINTS, method="splat", camera=camera, up="z", front="x")
    assert (turned != expected).mean() < 0.001  # a rounding error may move the edge of a disc


def of_ball(eye, at):
    """Return a camera of 30 x 30 pixels."""
    return open3d(looking(eye, at), 50, (15, 15), (30, 30))


BESIDE = of_ball([30, 0, -90], [100, 0, -90])
REFUSED = [
    ({"camera": BESIDE}, "the camera of the dict shows none of the points; give it in the coord"),
    ({"camera": of_ball([30, 0, -90], [30, 0, -99])}, "looks away from the cloud"),
    (
        {"camera": of_ball([30, 0, -58], [30, 0, -50])},
        "stands inside of the cloud, 1 from a point that it sees; move",
    ),
    ({"camera": of_ball([30, 0, 9e3], [30, 0, 0])}, "stands 1.29e+03 radii of the cloud away"),
    ({"camera": {"parameters": [BESIDE] * 2}}, "2 cameras; give a dict with one of them"),
    ({"camera": "gone.json"}, "gone.json: no such file"),
    ({"camera": {}, "size": 128}, "size: a camera has its own; leave out size, or the camera"),
    ({"camera": {}, "azimuth_deg": 1}, "angles: a camera has its own"),
    ({"camera": {}, "return_maps": True}, "return_maps: a camera has its own"),
    ({"camera": BESIDE, "method": "pc2pix"}, "method 'pc2pix' knows a camera by azimuth and"),
]


@pytest.mark.parametrize(("options", "problem"), REFUSED, ids=[case[1] for case in REFUSED])
def test_what_no_camera_can_show_is_refused(options, problem):
    with pytest.raises(BadInput, match=re.escape(problem)):
        bench.draw_cloud(BALL, **{"method": "splat"} | options)
