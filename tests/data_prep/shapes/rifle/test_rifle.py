from __future__ import annotations

import math

import numpy as np
import pytest

from data_prep.shapes.rifle.parts import bipod, magazine, pipe, scope, stock
from tests.data_prep.shapes.samples import Families, of_each_family
from tests.data_prep.shapes.sections import extents, volume

GREY = (120, 121, 122)
# A few hundred float64 operations on numbers of order 1: see test_solids.
EXACT = 1e-12


@pytest.fixture(scope="module")
def rifles() -> Families:
    return of_each_family("rifle", seed=32, count=30)


def test_a_straight_stock_is_a_prism_without_its_edges() -> None:
    part = stock([(0.1, -0.04, 0.02, 0.05), (-0.3, -0.04, 0.02, 0.05)], GREY)
    # Four triangles with legs of a fifth are missing from the unit square.
    assert abs(volume(part) - 0.92 * 0.06 * 0.05 * 0.4) < EXACT
    assert np.allclose(part.vertices.min(axis=0), (-0.025, -0.04, -0.3))
    assert np.allclose(part.vertices.max(axis=0), (0.025, 0.02, 0.1))


def test_a_pipe_runs_along_z_at_its_place() -> None:
    part = pipe([(0.01, 0.0), (0.02, -0.5)], GREY, x=0.3, y=0.1, sides=8)
    for z, radius in ((0.0, 0.01), (-0.5, 0.02)):
        ring = part.vertices[np.abs(part.vertices[:, 2] - z) < EXACT]
        assert len(ring) == 8
        assert np.allclose(np.linalg.norm(ring[:, :2] - (0.3, 0.1), axis=1), radius)


def test_a_magazine_bends_towards_the_muzzle() -> None:
    for ahead in (0.0, 0.06):
        part = magazine((0.01, -0.07), 0.2, ahead, 0.06, 0.03, GREY)
        end = part.vertices[-4:]
        assert np.allclose(part.vertices[:4].mean(axis=0), (0, 0.01, -0.07))
        assert np.allclose(end.mean(axis=0), (0, -0.19, -0.07 - ahead))
        # Its end leans against level as the end of the parabola leans against upright, or nearly.
        front, rear = end[np.argmin(end[:, 2])], end[np.argmax(end[:, 2])]
        assert abs((front[1] - rear[1]) / 0.06 - 1.2 * ahead / 0.2) < EXACT


def test_a_bipod_stands_astride() -> None:
    _, *legs = bipod(-0.02, -0.4, 0.2, 0.05, GREY)
    feet = np.array([leg.vertices[np.argsort(leg.vertices[:, 1])[:5]].mean(axis=0) for leg in legs])
    assert np.allclose(feet, [(-0.084, -0.22, -0.45), (0.084, -0.22, -0.45)])


def test_a_scope_stands_on_its_feet() -> None:
    parts = scope(0.06, 0.02, 0.05, 0.3, GREY)
    feet = [part.vertices[:, 1].min() for part in parts[1:3]]
    assert np.allclose(feet, 0.02)
    assert np.allclose(
        [parts[0].vertices[:, 2].min(), parts[0].vertices[:, 2].max()], (-0.25, 0.05)
    )


def test_long_along_z_and_slim(rifles: Families) -> None:
    """Length over height: a family's proportions are its silhouette."""
    between = {
        "assault": (2.2, 5.6),
        "bolt-action": (3.4, 8.0),
        "sniper": (2.8, 7.0),
        "shotgun": (3.2, 9.0),
        "submachine": (1.1, 3.9),
        "machine-gun": (2.8, 5.0),
        "bullpup": (1.8, 3.5),
    }
    for family, (low, high) in between.items():
        for gun in rifles[family]:
            x, y, z = extents(gun.parts)
            assert low < z / y < high, family
            assert x < (0.75 if family in ("sniper", "machine-gun") else 0.6) * y, family


def test_the_muzzle_is_towards_minus_z(rifles: Families) -> None:
    """The foremost part of the gun is a barrel: round and thin, on the bore's axis."""
    for family, members in rifles.items():
        for gun in members:
            foremost = min(gun.parts, key=lambda part: part.vertices[:, 2].min()).vertices
            end = foremost[foremost[:, 2] < foremost[:, 2].min() + EXACT]
            x, y, _ = np.ptp(end, axis=0)
            assert max(x, y) < 0.055, family
            assert abs(end[:, 1].mean()) < 0.02, family


def test_which_magazine_is_before_the_grip(rifles: Families) -> None:
    """Assault rifles carry it before the trigger, bullpups behind."""
    for family, side in (("assault", -1.0), ("bullpup", 1.0)):
        for gun in rifles[family]:
            lowest = gun.parts[int(np.argmin([part.vertices[:, 1].min() for part in gun.parts]))]
            assert side * lowest.vertices[:, 2].mean() > 0.05, family


def test_half_of_a_long_gun_is_a_rod(rifles: Families) -> None:
    """The longest part less than 4 cm thick, which is the barrel, over the whole length."""
    for family in ("bolt-action", "sniper", "shotgun"):
        for gun in rifles[family]:
            sizes = [extents([part]) for part in gun.parts]
            barrel = max(z for x, y, z in sizes if max(x, y) < 0.04)
            assert barrel > 0.35 * extents(gun.parts)[2], family


def test_dark_or_wooden(rifles: Families) -> None:
    for members in rifles.values():
        for gun in members:
            for part in gun.parts:
                red, _, blue = part.color
                assert red - blue > -18  # nothing is blue
                assert sum(part.color) < 3 * 180
    wooden = [gun.parts[0].color[0] - gun.parts[0].color[2] > 35 for gun in rifles["bolt-action"]]
    p = 0.88
    assert abs(np.mean(wooden) - p) < 4 * math.sqrt(p * (1 - p) / len(wooden))
