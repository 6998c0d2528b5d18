"""The method that `bench render` and `bench.draw_cloud` draw with."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import bench
from bench.catalogue.chosen import (
    best_within,
    measured_methods,
    times_by_points,
    times_dearer,
)
from bench.catalogue.methods import RECOMMENDED, RECOMMENDED_IN_COLOUR
from bench.commands.render import RenderOptions, views_of
from bench.draw.choice import methods_to_draw, notes_on_methods, within_budget
from data_prep.failures import BadInput
from data_prep.files.clouds import save_ply
from data_prep.randomness import generator


@pytest.fixture(scope="module")
def points():
    normal = generator("test").normal(size=(600, 3))
    return (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(np.float32)


@pytest.fixture
def cloud(points, tmp_path):
    path = tmp_path / "cloud.ply"
    save_ply(points, path)
    return path


def test_a_turntable_goes_round_from_the_azimuth():
    options = RenderOptions(azimuth=(30.0,), elevation=(-10.0,), frames=4)
    views = views_of(options, Path("turn.gif"))
    assert [view.azimuth_deg for view in views] == [30, 120, 210, 300]
    assert {view.elevation_deg for view in views} == {-10}
    still = RenderOptions(azimuth=(30.0,), elevation=(-10.0,))
    assert views_of(still, Path("still.png")) == views[:1]
    several = RenderOptions(azimuth=(0.0, 90.0, 0.0), elevation=(10.0, -5.0))
    for name in ("still.jpg", "still.webp"):
        assert [(v.azimuth_deg, v.elevation_deg) for v in views_of(several, Path(name))] == [
            *((0, 10), (90, 10), (0, -5), (90, -5))
        ]


def test_what_draws_where_no_method_is_named():
    assert methods_to_draw(()) == (RECOMMENDED,)
    assert methods_to_draw((), in_colour=True) == (RECOMMENDED_IN_COLOUR,)
    assert methods_to_draw((), budget_ms=1000) == ("fused-net@grey",)
    assert methods_to_draw(("splat", "blank", "splat")) == ("splat", "blank")


@pytest.mark.slow
def test_the_command_says_which_method_the_budget_chose(command, cloud, tmp_path):
    out, again = tmp_path / "out.png", tmp_path / "again.png"
    status, printed, err = command("render", cloud, "--budget", "50ms", "-o", out)
    assert (status, printed) == (0, f"{out}\n")
    cost = measured_methods()["splat-net@grey"]  # its digits change with each measurement
    assert err == (
        f"note: {cloud}: budget 50ms: splat-net@grey, of the measured methods within it the best "
        f"on real meshes (score {cost.score:.3f}); {cost.one_view_ms:.3g} ms for one image of "
        "2,048 points, where it was measured\n"
    )
    assert command("render", cloud, "--method", "splat-net@grey", "-o", again)[0] == 0
    assert again.read_bytes() == out.read_bytes()


def test_the_number_of_points_of_each_file_decides(command, points, cloud, tmp_path):
    """The time in which splat draws 600 points is not enough for 20,000."""
    many = tmp_path / "many.ply"
    scales = np.linspace(0.9, 1, 40, dtype=np.float32)[:, None, None]
    save_ply((scales * points).reshape(-1, 3)[:20_000], many)
    out = tmp_path / "images"
    status, _, err = command("render", cloud, many, "--budget", "7ms", "-o", out)
    assert status == 1
    few, none, count = [line for line in err.splitlines() if "budget" in line or "clouds" in line]
    assert few.startswith(f"note: {cloud}: budget 7ms: splat, of the measured methods within it ")
    dearer = times_dearer(times_by_points()["splat"], 20_000)
    least = math.ceil(10 * dearer * measured_methods()["splat"].one_view_ms) / 10
    assert none == (
        f"bench: {many}: budget 7ms: the cheapest method is splat with {least:g} ms for one image "
        f"of 20,000 points; give at least {least:g}ms"
    )
    assert count == "bench: 1 of 2 clouds have no image"


@pytest.mark.parametrize(("points", "said"), [(1, "2,048"), (5000, "5,000"), (10**6, "1,000,000")])
def test_a_note_tells_the_cost_at_that_number_of_points(points, said):
    method, note = within_budget(1e6, points)
    cost_ms = best_within(1e6, points).one_view_ms
    assert note.startswith(f"budget 1e+06ms: {method}, ")
    end = " (extrapolated from 262,144 points)" if points > 262_144 else ""
    assert note.endswith(
        f"; {cost_ms:.3g} ms for one image of {said} points, where it was measured{end}"
    )


def test_points_within_a_budget(points):
    with pytest.warns(UserWarning, match="^budget 50ms: splat-net@grey, of the measured methods"):
        image = bench.draw_cloud(points, budget_ms=50)
    assert np.array_equal(image, bench.draw_cloud(points, method="splat-net@grey"))
    with pytest.raises(BadInput, match=r"budget 0\.1ms: the cheapest method is "):
        bench.turntable(points, budget_ms=0.1)
    with pytest.raises(TypeError, match="draw_cloud: no option budget; there are azimuth_deg, "):
        bench.draw_cloud(points, budget=50)  # type: ignore[call-arg]


def test_colours_are_drawn_without_the_hint_at_a_budget_which_excludes_them(command, cloud):
    status, _, err = command("render", cloud, "--colour", "invented")
    assert (status, err) == (0, f"drawn by {RECOMMENDED_IN_COLOUR}; 'bench list' has others\n")


@pytest.mark.slow
def test_points_in_grey_or_in_colour(points):
    grey, coloured = bench.draw_cloud(points), bench.draw_cloud(points, colour="invented")
    assert (grey == grey[..., :1]).all()
    assert not (coloured == coloured[..., :1]).all()
    assert np.array_equal(coloured, bench.draw_cloud(points, method=RECOMMENDED_IN_COLOUR))


def test_a_method_of_chairs_says_so(points):
    assert notes_on_methods(("splat", RECOMMENDED)) == ()
    line = "was trained on chairs and may draw a chair whatever the cloud is; for other objects "
    assert notes_on_methods(("splat", "pc2pix")) == (f"pc2pix {line}leave out the method",)
    (both,) = notes_on_methods(("pc2pix", "pc2pix@acgan"))
    assert both.startswith("pc2pix, pc2pix@acgan were trained on chairs and may ")
    with pytest.warns(UserWarning, match=f"^pc2pix@acgan {line}leave out the method$"):
        bench.draw_cloud(points, method="pc2pix@acgan")
