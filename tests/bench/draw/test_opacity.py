"""The fourth channel of `background="transparent"`: what the renderers themselves cover."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import minimum_filter

import bench
from bench.catalogue.methods import find_method
from bench.draw.cloud import Drawing, Failed, draw_in_process
from data_prep.clouds.normalise import normalise
from data_prep.clouds.sampling import sample_surface
from data_prep.randomness import generator
from data_prep.rendering.mesh import mesh_coverage
from data_prep.rendering.raycast import surface_maps
from data_prep.scene import NEUTRAL_GREY, View
from data_prep.shapes.solids import box, join
from tests.baselines.clouds import lattice_sphere

# A unit sphere from 4 away, of a focal length of 232 px: tan(asin(1 / 4)) * 232.
OUTLINE_PX = 59.9
FRONT = (View(20, 10),)
TELL = (  # the methods that tell their coverage, at sizes that they draw
    *(("denoised-wrap", 200), ("occupancy-net", 128), ("upsampled-wrap", 200)),
    *(("splat", 200), ("splat-fill", 200), ("splat-net@grey", 128)),
    *(("points2pix", 128), ("fused-net@grey", 256), ("fused-net", 128)),
)


def over_white(rgba: np.ndarray) -> np.ndarray:
    image = Image.fromarray(rgba)
    page = Image.new("RGBA", image.size, "white")
    return np.asarray(Image.alpha_composite(page, image).convert("RGB")).astype(int)


@pytest.mark.filterwarnings("ignore:splat-net@grey draws 128 x 128 pixels; resampled")
@pytest.mark.parametrize(("method", "size"), [*TELL, ("splat-net@grey", 300)])
def test_a_sphere_is_opaque_and_over_white_the_same_picture(method: str, size: int) -> None:
    points = lattice_sphere()
    opaque = bench.draw_cloud(points, method=method, size=size)
    rgba = bench.draw_cloud(points, method=method, size=size, background="transparent")
    assert np.abs(over_white(rgba) - opaque).max() <= 1
    row, column = (np.mgrid[:size, :size] + 0.5) * 128 / size
    inside = np.hypot(row - 64, column - 64) < 0.9 * OUTLINE_PX
    # Networks are sure of it to some per cent.
    assert rgba[..., 3][inside].min() >= 0.9 * 255
    drawer = find_method(method)
    if drawer.color == "none" and drawer.drawn_at(size) == size:  # grey would be seen, and is not
        assert rgba[..., 3][(opaque == 255).all(axis=2)].max() <= 0.1 * 255


@pytest.mark.filterwarnings("ignore:splat-net@grey draws 128 x 128 pixels; resampled")
@pytest.mark.parametrize(("method", "size"), [("alpha-wrap", 200), ("splat-net@grey", 300)])
def test_a_coloured_sphere_is_over_white_the_same_picture(method: str, size: int) -> None:
    points = lattice_sphere()
    options = {"method": method, "size": size, "colors": 250 * (points > 0)}
    opaque = bench.draw_cloud(points, **options)
    rgba = bench.draw_cloud(points, **options, background="transparent")
    assert np.abs(over_white(rgba) - opaque).max() <= 1
    grey = bench.draw_cloud(points, **options, background="transparent", colour="grey")
    # What is within 8 levels of nothing or all is rounded, here at the larger size.
    assert np.abs(rgba[..., 3].astype(int) - grey[..., 3]).max() <= 8


@pytest.fixture(scope="module")
def lamp_post():
    """Return a mesh: a post of a thirtieth of its height on a plate, with an arm."""
    parts = [
        box((0, 0, 0), (0.06, 1.8, 0.06), NEUTRAL_GREY),
        box((0, -0.9, 0), (0.4, 0.06, 0.4), NEUTRAL_GREY),
        box((0.2, 0.9, 0), (0.46, 0.06, 0.12), NEUTRAL_GREY),
    ]
    return normalise(join(parts))


@pytest.mark.parametrize("method", ["denoised-wrap", "splat-net@grey", "fused-net@grey"])
def test_a_lamp_post_is_opaque(lamp_post, method: str) -> None:
    """Its post is four pixels wide: wherever all pixels around one are covered, so is that one."""
    cloud = sample_surface(lamp_post, generator("opacity"))
    drawn = draw_in_process(cloud, Drawing(method, FRONT, background="transparent"))
    assert not isinstance(drawn, Failed)
    inside = minimum_filter(mesh_coverage(lamp_post, FRONT), (1, 3, 3)) == 1
    assert inside.sum() > 200
    assert (drawn[..., 3][inside] >= 0.9 * 255).mean() > 0.99


def test_a_white_object_on_white_is_opaque(command, tmp_path) -> None:
    path, white, grey = (tmp_path / name for name in ("cloud.xyz", "white.png", "grey.png"))
    np.savetxt(path, np.hstack([lattice_sphere(), np.full((2048, 3), 254)]))
    clear = ("--background", "transparent", "--colour", "file", "-o", white)
    assert command("render", path, "--method", "splat", *clear)[0] == 0
    assert command("render", path, "--method", "splat", "-o", grey)[0] == 0
    painted = (np.asarray(Image.open(grey)) < 255).any(axis=2)
    assert np.array_equal(np.asarray(Image.open(white))[..., 3], 255 * painted)


def test_a_method_that_does_not_tell_its_opacity_says_that_it_is_guessed(lamp_post) -> None:
    cloud = sample_surface(lamp_post, generator("opacity"))
    guess = "^pc2pix@all: tells no opacity; it is guessed from how dark a pixel is$"
    with pytest.warns(UserWarning, match=guess):
        bench.draw_cloud(cloud.points, method="pc2pix@all", background="transparent")


def test_the_coverage_of_a_mesh_is_that_of_its_rays(lamp_post) -> None:
    """OpenGL draws few faces; its samples lie where rays are cast, and a pixel has 8 bits."""
    drawn, cast = mesh_coverage(lamp_post, FRONT, 200), surface_maps(lamp_post, FRONT, 200)[:, 0]
    assert drawn.shape == (1, 200, 200)
    assert np.abs(drawn - cast).max() <= 0.25 + 1 / 255  # a sample on an edge may go either way
    assert (np.abs(drawn - cast) > 1 / 255).mean() < 1e-3
