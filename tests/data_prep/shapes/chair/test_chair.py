from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from data_prep.scene import Mesh
from data_prep.shapes.catalogue import CLASSES
from data_prep.shapes.chair.chairs import build_chair, chair, chair_parts
from data_prep.shapes.chair.spec import (
    BACK_WEIGHTS,
    BACKS,
    FAMILY_WEIGHTS,
    ChairSpec,
    draw_chair_spec,
)
from data_prep.shapes.palettes import LIGHTEST
from tests.data_prep.shapes.solid_checks import afloat, shared_planes, unsound


@pytest.fixture(scope="module")
def specs() -> list[ChairSpec]:
    rng = np.random.default_rng(2024)
    return [draw_chair_spec(rng) for _ in range(400)]


@pytest.fixture(scope="module")
def varied(specs: list[ChairSpec]) -> list[ChairSpec]:
    """Three chairs of every pair of family and back that can be drawn, as far as drawn."""
    chosen = []
    for family, backs in BACK_WEIGHTS.items():
        for back in backs:
            match = [spec for spec in specs if (spec.family, spec.back) == (family, back)]
            chosen += match[:3]
    return chosen


@pytest.fixture(scope="module")
def meshes(varied: list[ChairSpec]) -> list[Mesh]:
    return [build_chair(spec) for spec in varied]


def test_the_class_draws_the_chairs_that_are_described() -> None:
    for seed in range(8):
        drawn = CLASSES["chair"].draw(np.random.default_rng(seed)).mesh()
        same = chair(np.random.default_rng(seed))
        assert drawn.vertices.tobytes() == same.vertices.tobytes()
        assert drawn.faces.tobytes() == same.faces.tobytes()
        assert drawn.face_colors.tobytes() == same.face_colors.tobytes()


def test_building_uses_no_chance(specs: list[ChairSpec]) -> None:
    spec = specs[0]
    same = dataclasses.replace(spec)
    assert build_chair(spec).vertices.tobytes() == build_chair(same).vertices.tobytes()


def test_everything_is_reachable(specs: list[ChairSpec]) -> None:
    assert {spec.back for spec in specs} == set(BACKS)
    assert {spec.seat for spec in specs} == {"square", "rounded", "round", "trapezoid"}
    assert {spec.base for spec in specs} == {"legs", "star-5", "star-4", "disc"}
    assert {spec.stretchers for spec in specs} == {"none", "sides", "h", "box"}
    for flag in ("posts", "cushion", "arms", "apron", "round_legs"):
        assert {getattr(spec, flag) for spec in specs} == {False, True}


def test_parts_are_closed_and_outward(varied: list[ChairSpec]) -> None:
    for spec in varied:
        assert unsound(chair_parts(spec)) == [], (spec.family, spec.back)


def test_face_counts(meshes: list[Mesh]) -> None:
    counts = [len(mesh.faces) for mesh in meshes]
    assert min(counts) >= 100
    assert max(counts) <= 4000


def test_no_face_twice_and_none_without_area(meshes: list[Mesh]) -> None:
    for mesh in meshes:
        corners = mesh.vertices[mesh.faces].astype(np.float64)
        sides = corners[:, 1:] - corners[:, :1]
        area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2
        # The slimmest faces are fillets of tubes, about 0.01 x 0.01; rounding makes 1e-7 x 0.01.
        assert area.min() > 1e-7
        keys = np.sort(corners.round(5).view([("", np.float64)] * 3)[..., 0], axis=1)
        assert len(np.unique(keys, axis=0)) == len(keys)


def test_the_front_is_towards_minus_z(varied: list[ChairSpec], meshes: list[Mesh]) -> None:
    for spec, mesh in zip(varied, meshes, strict=True):
        if spec.back == "none":
            continue
        height = mesh.vertices[:, 1]
        highest = mesh.vertices[height >= height.min() + 0.8 * np.ptp(height)]
        assert highest[:, 2].mean() > 0, (spec.family, spec.back)


def test_stands_on_the_floor(varied: list[ChairSpec]) -> None:
    for spec in varied:
        lowest = min(part.vertices[:, 1].min() for part in chair_parts(spec))
        assert abs(lowest) < 0.02, (spec.family, lowest)  # metres; runners are 2-3 cm thick


def test_nothing_floats(varied: list[ChairSpec]) -> None:
    for spec in varied[::2]:
        assert afloat(chair_parts(spec)) == [], (spec.family, spec.back)


def test_no_two_colours_in_one_plane(varied: list[ChairSpec]) -> None:
    for spec in varied:
        assert shared_planes(chair_parts(spec), size=1.0) == [], spec  # metres: about the radius


def test_one_to_three_colours_and_none_vanishes(meshes: list[Mesh]) -> None:
    for mesh in meshes:
        colors = np.unique(mesh.face_colors, axis=0)
        assert 1 <= len(colors) <= 3
        assert colors.max() <= LIGHTEST


def test_thin_parts_are_thin(specs: list[ChairSpec]) -> None:
    for spec in specs:
        height = spec.seat_height_m + spec.back_height_m
        if spec.family == "four-leg":
            assert 0.02 < spec.leg_m / height < 0.07
        if spec.back in ("slatted", "spindle", "ladder"):
            assert 0.01 < spec.bar_m / height < 0.04


def test_colour_is_partly_predictable_from_shape(specs: list[ChairSpec]) -> None:
    """Knowing the family removes some, not all, of the variance of the frame's colour."""
    colors = np.array([spec.frame_color for spec in specs], dtype=float)
    families = np.array([spec.family for spec in specs])
    warmth = colors[:, 0] - colors[:, 2]
    within = sum(
        warmth[families == family].var() * (families == family).mean() for family in FAMILY_WEIGHTS
    )
    assert 0.2 < within / warmth.var() < 0.8
    means = {f: colors[families == f].mean(axis=0) for f in FAMILY_WEIGHTS}
    assert np.linalg.norm(means["four-leg"] - means["pedestal"]) > 40
    assert np.linalg.norm(means["cantilever"] - means["pedestal"]) > 40
    for family in FAMILY_WEIGHTS:
        assert colors[families == family].std(axis=0).max() > 15
