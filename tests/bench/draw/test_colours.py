"""The colours of points on images that are drawn in grey."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from PIL import Image

import bench
from baselines.neighbourhoods import nearest_distance
from bench.draw.cloud import Drawing, draw_in_process
from bench.running.colours import colours_seen, in_colours
from data_prep.clouds.normalise import normalise_points
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.scene import NEUTRAL_GREY, PointCloud, View
from tests.baselines.clouds import lattice_sphere

FRONT, BACK = View(0, 0), View(180, 0)  # the first camera stands on -Z
RED, BLUE = (200, 40, 20), (10, 60, 220)


def plane(z: float, color: tuple[int, ...], step: float) -> PointCloud:
    """Return points on a square of side 1 across the view, in rows and columns `step` apart."""
    x, y = np.mgrid[-0.5:0.5:step, -0.5:0.5:step].reshape(2, -1)
    return PointCloud(np.stack([x, y, 0 * x + z], 1), colors=np.full((len(x), 3), color))


def together(*clouds: PointCloud) -> PointCloud:
    colors = [cloud.colors for cloud in clouds if cloud.colors is not None]
    points = np.concatenate([cloud.points for cloud in clouds])
    return PointCloud(points, colors=np.concatenate(colors))


def seen(cloud: PointCloud, view: View, size: int = 128) -> np.ndarray:
    """Return the colours that a view sees, in 0 to 255."""
    return 255 * colours_seen(cloud, nearest_distance(cloud.points), view, size)


def two_planes(front_step: float) -> PointCloud:
    return together(plane(-0.4, RED, front_step), plane(0.4, BLUE, 0.02))


ONE_COLOUR = {  # which points, from where, and the one colour of all pixels
    "a plane": (plane(0, RED, 0.02), FRONT, RED),
    "a plane of few points": (plane(0, RED, 0.2), FRONT, RED),
    "a plane along the view": (plane(0, RED, 0.02), View(90, 0), RED),
    "red in front of blue": (two_planes(0.02), FRONT, RED),
    "red in front of blue, two spacings apart": (two_planes(0.04), FRONT, RED),
    "blue, from behind": (two_planes(0.02), BACK, BLUE),
    "one point": (PointCloud([[0.1, 0.2, 0.3]], colors=[RED]), FRONT, RED),
    "points that coincide": (PointCloud([[0.1, 0.2, 0.3]] * 2, colors=[RED, BLUE]), BACK, None),
    "beside the image": (PointCloud([[3, 0, 0], [0, 3, 0]], colors=[RED, BLUE]), FRONT, "grey"),
    "behind the camera": (PointCloud([[0, 0, -5], [0, 0, -6]], colors=[RED, BLUE]), FRONT, "grey"),
    "no point": (PointCloud(np.empty((0, 3)), colors=np.empty((0, 3))), FRONT, "grey"),
}
MEANS = {None: np.add(RED, BLUE) / 2, "grey": NEUTRAL_GREY}


@pytest.mark.parametrize("size", [16, 128, 300])
@pytest.mark.parametrize("case", ONE_COLOUR)
def test_all_of_an_image_has_the_colour_of_the_points_that_are_seen(case: str, size: int) -> None:
    cloud, view, color = ONE_COLOUR[case]
    expected = np.broadcast_to(MEANS.get(color, color), (size, size, 3))
    np.testing.assert_allclose(seen(cloud, view, size), expected, atol=1e-9)


def test_gaps_have_the_colours_around_them_in_any_order_of_the_points() -> None:
    """A colour gives way, where points are 6 pixels apart, to the other over some three of them."""
    cloud = plane(0, RED, 0.1)
    halves = PointCloud(cloud.points, colors=np.where(cloud.points[:, :1] > -0.01, RED, BLUE))
    image = seen(halves, FRONT)
    for columns, color in ((slice(36, 54), RED), (slice(80, 94), BLUE)):  # +X is to the left
        part = image[44:90, columns]
        np.testing.assert_allclose(part, np.broadcast_to(color, part.shape), atol=12)
    assert halves.colors is not None
    order = generator("order").permutation(len(halves))
    mixed = PointCloud(halves.points[order], colors=halves.colors[order])
    np.testing.assert_allclose(seen(mixed, FRONT), image, atol=1e-9)


def test_without_colours_there_is_nothing_to_see() -> None:
    with pytest.raises(ValueError, match="the cloud has no colours"):
        colours_seen(PointCloud([[0, 0, 0]]), 0.1, FRONT, 16)


SHADED = {  # grey level of a pixel, its coverage, and how it looks in RED
    "background": (255, 0, (255, 255, 255)),
    "neutral grey": (NEUTRAL_GREY[0], 1, RED),
    "half lit": (NEUTRAL_GREY[0] // 2, 1, np.divide(RED, 2)),
    "half covered": ((255 + NEUTRAL_GREY[0]) / 2, 0.5, np.add(RED, 255) / 2),
    "black": (0, 1, (0, 0, 0)),
    "half covered by black": (127.5, 0.5, (127.5, 127.5, 127.5)),
    "darker than its coverage": (100, 0.5, (127.5, 127.5, 127.5)),
    "brighter than neutral grey": (255, 1, (255, 57, 28)),
}


@pytest.mark.parametrize("case", SHADED)
def test_a_pixel_is_its_shading_times_the_colour_on_white(case: str) -> None:
    level, share, expected = SHADED[case]
    views, cloud = [FRONT, View(30, 20)], plane(0, RED, 0.05)
    images = np.full((2, 48, 48, 3), round(level), np.uint8)
    before = images.copy()
    painted = in_colours(images, np.full((2, 48, 48), share, np.float32), cloud, views)
    assert painted.dtype == np.uint8
    np.testing.assert_allclose(painted, np.broadcast_to(expected, (2, 48, 48, 3)), atol=1)
    assert np.array_equal(images, before)


SPHERE = lattice_sphere()
HALVES = np.where(SPHERE[:, 1:2] > 0, RED, BLUE).astype(np.uint8)  # red above, blue below
DRAWS_GREY = ("alpha-wrap", "splat-fill")


def draw(method: str, colors: object = HALVES, **options: object) -> np.ndarray:
    return bench.draw_cloud(SPHERE, 0, 0, method=method, colors=colors, **options).astype(int)


@pytest.mark.parametrize("size", [128, 200])
@pytest.mark.parametrize("method", DRAWS_GREY)
def test_a_sphere_of_two_colours(method: str, size: int) -> None:
    grey = bench.draw_cloud(SPHERE, 0, 0, method=method, size=size)
    assert np.array_equal(draw(method, colour="grey", size=size), grey)
    image = draw(method, size=size)
    part = size // 8
    across = slice(size // 2 - part // 2, size // 2 + part // 2)
    for rows, color in ((slice(2 * part, 3 * part), RED), (slice(5 * part, 6 * part), BLUE)):
        shading = grey[rows, across] / NEUTRAL_GREY[0]
        assert np.abs(image[rows, across] - shading * color).max() <= 2
    assert (image[:part, :part] == 255).all()


def test_a_turntable_shows_each_side_in_its_colour_in_batches_of_any_size() -> None:
    sides = np.where(SPHERE[:, 2:] < 0, RED, BLUE)
    frames = bench.turntable(SPHERE, 2, 0, method="splat-fill", colors=sides)
    for frame, (high, _, low) in zip(frames.astype(int), (RED, BLUE), strict=True):
        middle = frame[56:72, 56:72]
        assert (np.sign(middle[..., 0] - middle[..., 2]) == np.sign(high - low)).all()
    cloud = replace(normalise_points(SPHERE), colors=sides)
    one_by_one = draw_in_process(cloud, Drawing("splat-fill", (FRONT, BACK), batch=1))
    assert np.array_equal(one_by_one, frames)


def test_colours_of_arrays_and_tables_are_the_same_in_any_range() -> None:
    image = draw("splat-fill")
    assert np.array_equal(draw("splat-fill", HALVES / 255), image)
    assert np.array_equal(draw("splat-fill", HALVES.tolist(), colour="file"), image)
    names = ["x", "y", "z", "Red", "Green", "Blue"]
    table = pd.DataFrame(np.hstack([SPHERE, HALVES]), columns=names)
    assert np.array_equal(bench.draw_cloud(table, 0, 0, method="splat-fill"), image)
    grey = bench.draw_cloud(table, 0, 0, method="splat-fill", colour="grey")
    assert (grey == grey[..., :1]).all()


WRONG = {  # what is given, and what is said of it
    "too few": (
        {"colors": HALVES[:9]},
        "colors: 9 rows for 2048 points; give a colour for each point",
    ),
    "negative": (
        {"colors": HALVES.astype(int) - 300},
        "colors: have values below 0 or not finite; give 0 to 255, or 0 to 1",
    ),
    "with opacity": (
        {"colors": np.ones((2048, 4))},
        "colors: float64 of shape [2048, 4]; give real numbers [N, 3], of 0 to 255 or of 0 to 1",
    ),
    "names": (
        {"colors": ["red"] * 2048},
        "colors: <U3 of shape [2048]; give real numbers [N, 3], of 0 to 255 or of 0 to 1",
    ),
    "none at all": (
        {"colors": None, "colour": "file"},
        'points: no colours of them; give colors=, or leave out "file"',
    ),
    "a truth value": (
        {"colour": True},
        "colour True: must be auto, file, grey, invented, height or the name of a column",
    ),
    "in colours of its own": (
        {"method": "fused-net", "colour": "grey"},
        "method 'fused-net' makes colours up; give method fused-net@grey, or another one that "
        "draws in grey, or leave out the colour 'grey'",
    ),
    "of a file": (
        {"points": "cloud.ply"},
        "cloud.ply: colors= is for arrays; leave it out, and name the columns of a file in its "
        "first line",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_colours_that_are_refused(case: str) -> None:
    given, said = WRONG[case]
    with pytest.raises(BadInput) as refused:
        bench.draw_cloud(**{"points": SPHERE, "method": "splat-fill", "colors": HALVES} | given)
    assert str(refused.value) == said


def test_invented_colours_are_kept() -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        drawn = draw("splat-net")
    assert [str(warning.message) for warning in caught] == [
        "splat-net: draws in colours of its own; those of the points are not used"
    ]
    assert np.array_equal(drawn, draw("splat-net", None))


def test_options_have_their_names_of_python_where_a_file_is_drawn_from_there(tmp_path) -> None:
    path = tmp_path / "cloud.xyz"
    np.savetxt(path, np.hstack([SPHERE, HALVES]))
    with pytest.warns(UserWarning, match='are a guess, too, which colour="grey" leaves out$'):
        bench.draw_cloud(path, method="splat")
    np.savetxt(path, SPHERE)
    with pytest.raises(BadInput, match=r'array \[N, 6\]; or draw without colour="file"$'):
        bench.draw_cloud(path, method="splat", colour="file")


def test_a_scan_without_any_colour_in_its_columns_is_told(tmp_path) -> None:
    path = tmp_path / "scan.csv"
    for inks, told in ((np.zeros_like(SPHERE), True), (np.eye(len(SPHERE), 3), False)):
        np.savetxt(
            path, np.hstack([SPHERE, inks]), delimiter=",", header="x,y,z,r,g,b", comments=""
        )
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            bench.draw_cloud(path, method="splat")
        said = " ".join(str(warning.message) for warning in caught)
        assert ("all points are black" in said) == told
        assert ('colour="grey" leaves them out' in said) == told


def test_columns_that_are_no_colours_are_left_out_with_a_note(command, refused, tmp_path) -> None:
    path, out = tmp_path / "cloud.csv", tmp_path / "out.png"
    values = np.hstack([SPHERE, np.full_like(SPHERE, -1)])
    np.savetxt(path, values, delimiter=",", header="x,y,z,r,g,b", comments="")
    render = ("render", path, "--method", "splat-fill", "-o", out)
    problem = "its colours have values below 0 or not finite; give 0 to 255, or 0 to 1"
    assert refused(*render, "--colour", "file") == f"{path}: {problem}"
    assert not out.exists()
    unused = (
        f"note: {path}: 3 of its 6 columns are not used; only the coordinates of its points are"
    )
    without = f"note: {path}: drawn without colours: {problem}"
    assert command(*render) == (0, f"{out}\n", f"{unused}\n{without}\n")
    image = np.asarray(Image.open(out))
    assert np.array_equal(image, bench.draw_cloud(SPHERE, method="splat-fill"))
