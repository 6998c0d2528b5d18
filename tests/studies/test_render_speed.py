"""The renderer against pyrender's own, which draws the same bytes, and the parts of its time."""

from __future__ import annotations

import numpy as np
import pytest

from data_prep.clouds.sampling import random_views
from data_prep.datasets.registry import ProceduralObject
from data_prep.rendering.opengl import SHEET_VIEWS, render
from data_prep.scene import Mesh, View
from studies.plain_pyrender import render_plainly
from studies.render_speed import in_turns, parts_of, renderers, sphere

RNG = np.random.default_rng(8)
VIEWS = (View(0, 0), View(180, 90), View(-90, -90), *random_views(9, RNG))


def soup(spread: float, colours: int) -> Mesh:
    """Facets that cross each other, partly without extent or out of the camera's range."""
    corners = RNG.normal(scale=spread, size=(300, 3))
    faces = RNG.integers(0, 300, (400, 3))
    return Mesh(corners, faces, RNG.integers(0, 256, (colours, 3))[np.arange(400) % colours])


@pytest.mark.parametrize(
    "mesh",
    [
        *(ProceduralObject("chair", "test", i).load() for i in range(6)),
        sphere(4),
        *(soup(spread, colours) for spread in (0.4, 1.0, 4.0) for colours in (1, 2, 400)),
    ],
    ids=lambda mesh: f"{len(mesh.faces)}-faces",
)
def test_bytes_are_those_of_pyrender(mesh):
    np.testing.assert_array_equal(render(mesh, VIEWS), render_plainly(mesh, VIEWS), strict=True)


@pytest.mark.parametrize(
    "act",
    [
        lambda: render_plainly(soup(1.0, 400), VIEWS[:2]),
        lambda: parts_of(sphere(3), random_views(SHEET_VIEWS, RNG)),
    ],
    ids=["another-context", "parts"],
)
def test_the_renderer_stays_as_it_was(act):
    mesh = sphere(3)
    before = render(mesh, VIEWS)
    act()
    np.testing.assert_array_equal(render(mesh, VIEWS), before)


class FakePool:
    """Takes a second more at each call."""

    def __init__(self, name: str, calls: list[str]) -> None:
        self.name, self.calls = name, calls

    def apply(self, function: object, given: tuple[int, int, int]) -> float:
        self.calls.append(f"{self.name}{given}")
        return float(len(self.calls))


def test_every_renderer_takes_its_turn_and_the_first_round_does_not_count():
    calls: list[str] = []
    seconds = in_turns([FakePool("a", calls), FakePool("b", calls)], 4, 20, rounds=2)  # type: ignore[list-item]
    assert calls == ["a(0, 4, 20)", "b(1, 4, 20)"] * 3
    assert seconds == [[3.0, 5.0], [4.0, 6.0]]


def test_all_renderers_draw_the_same_sphere():
    ball, views = sphere(3), random_views(3, RNG)
    ours, plain, rays = (np.asarray(draw(ball, views), np.float64) for draw in renderers())
    np.testing.assert_array_equal(ours, plain)
    assert np.abs(rays - ours).mean() < 0.1  # 0.02 % of the pixels differ, see test_rays
