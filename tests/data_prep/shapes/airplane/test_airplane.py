from __future__ import annotations

import numpy as np
import pytest

from data_prep.shapes.airplane.parts import Wing
from tests.data_prep.shapes.samples import Families, of_each_family
from tests.data_prep.shapes.sections import box_of, cut, extents, filled, vertices_of

GREY = (120, 121, 122)
EXACT = 1e-12  # see test_solids


@pytest.fixture(scope="module")
def fleet() -> Families:
    """20 airplanes of each family."""
    return of_each_family("airplane", seed=17, count=20)


def test_a_wing_has_its_chords_where_it_says() -> None:
    wing = Wing(0.5, root=0.3, tip=0.1, y=-0.1, z=-0.2, sweep=0.5, dihedral=0.1, kink=0.4)
    assert [wing.chord(x) for x in (0.0, 0.2, 0.35, 0.5)] == pytest.approx([0.3, 0.2, 0.15, 0.1])
    assert wing.at(-0.2, 0.5) == pytest.approx((-0.2, -0.08, 0.0))
    # The trailing edge runs straight across up to the kink.
    trailing = [wing.at(x, 1.0)[2] for x in (0.0, 0.1, 0.2)]
    assert trailing == pytest.approx([0.1, 0.1, 0.1])
    low, high = box_of([wing.part(GREY)])
    assert (low[0], high[0]) == (-0.5, 0.5)
    assert (low[2], high[2]) == pytest.approx((-0.2, 0.15))


def test_noses_point_to_minus_z(fleet: Families) -> None:
    for family in ("airliner", "rear-engine-jet", "fighter", "supersonic"):
        for plane in fleet[family]:
            vertices = vertices_of(plane.parts)
            assert vertices[vertices[:, 1].argmax(), 2] > 0.25, family  # the tip of the fin
    for family in ("propeller", "biplane"):
        for plane in fleet[family]:
            front, rear = (np.ptp(cut(plane.parts[:1], 2, z)[:, 1]) for z in (-0.2, 0.4))
            assert rear < 0.6 * front, family  # bodies taper towards the tail
    for plane in fleet["flying-wing"]:
        wing = plane.parts[0].vertices
        tip = wing[wing[:, 0].argmax()]
        assert tip[2] - wing[:, 2].min() > 0.35


def test_span_over_length_tells_families_apart(fleet: Families) -> None:
    # The wing's span (twice its half span), and the undercarriage or propeller do not add to it.
    expected = {
        "airliner": (0.80, 1.15),
        "rear-engine-jet": (0.75, 1.12),
        "fighter": (0.50, 0.95),
        "propeller": (0.95, 1.45),
        "biplane": (0.85, 1.25),
        "supersonic": (0.38, 0.56),
        "flying-wing": (1.2, 3.2),
    }
    for family, (low, high) in expected.items():
        for plane in fleet[family]:
            x, _, z = extents(plane.parts)
            assert low < x / z < high, family


def test_airliners_have_two_or_four_engines_under_the_wing(fleet: Families) -> None:
    numbers = set()
    for plane in fleet["airliner"]:
        # The dark core of an engine: three rings of eight.
        cores = [part for part in plane.parts if len(part.vertices) == 24]
        places = sorted(float(part.vertices[:, 0].mean()) for part in cores)
        assert np.abs(places) == pytest.approx(np.abs(places[::-1]), abs=EXACT)
        assert min(np.abs(places)) > 0.1
        for core in cores:
            assert max(core.color) <= 70
            wing = cut(plane.parts[1:2], 0, float(core.vertices[:, 0].mean()))
            assert core.vertices[:, 1].mean() < wing[:, 1].min()
            assert core.vertices[:, 2].min() < wing[:, 2].min()
        numbers.add(len(cores))
    assert numbers == {2, 4}


def test_only_the_rear_engined_have_a_t_tail(fleet: Families) -> None:
    for family, widths in (("rear-engine-jet", (0.27, 0.39)), ("airliner", (0.0, 0.02))):
        for plane in fleet[family]:
            vertices = vertices_of(plane.parts)
            top = vertices[vertices[:, 1] > vertices[:, 1].max() - 0.012]
            assert widths[0] <= np.ptp(top[:, 0]) <= widths[1], family


def test_fighters_have_one_fin_or_two_and_narrow_noses(fleet: Families) -> None:
    seen = set()
    for plane in fleet["fighter"]:
        _, high = box_of(plane.parts)
        top = cut(plane.parts, 1, 0.9 * float(high[1]))
        sides = {bool(x > 0) for x in top[:, 0] if abs(x) > 0.02}
        seen.add(len(sides) or 1)
        assert np.ptp(cut(plane.parts[:1], 2, -0.48)[:, 0]) < 0.02
    assert seen == {1, 2}


def test_propellers_turn_in_front(fleet: Families) -> None:
    for plane in fleet["propeller"]:
        blades = [
            p for p in plane.parts if len(p.vertices) == 8 and 0 < np.ptp(p.vertices[:, 2]) < 0.03
        ]
        assert blades
        assert min(p.vertices[:, 2].min() for p in blades) < -0.3
    high = [plane for plane in fleet["propeller"] if plane.parts[1].vertices[:, 1].min() > 0.05]
    assert 0 < len(high) < 20


def test_biplanes_have_one_wing_over_the_other(fleet: Families) -> None:
    for plane in fleet["biplane"]:
        lower, upper = plane.parts[2].vertices, plane.parts[3].vertices
        assert upper[:, 1].min() - lower[:, 1].max() > 0.09
        assert np.ptp(upper[:, 0]) > np.ptp(lower[:, 0]) > 0.8


def test_supersonic_ones_have_no_tailplane(fleet: Families) -> None:
    for plane in fleet["supersonic"]:
        behind = cut(plane.parts, 2, 0.42)
        assert np.ptp(behind[:, 0]) < 0.05
        middle = cut(plane.parts, 2, 0.25)
        assert np.ptp(middle[:, 0]) > 0.25


def test_flying_wings_are_flat_and_dark(fleet: Families) -> None:
    for plane in fleet["flying-wing"]:
        x, y, _ = extents(plane.parts)
        assert y < 0.15 * x
        assert max(max(part.color) for part in plane.parts) < 100


def test_airplanes_fill_little_of_their_box(fleet: Families) -> None:
    for family, planes in fleet.items():
        for plane in planes:
            assert filled(plane.parts) < 0.20, family


def test_civil_bodies_are_lighter_than_military_ones(fleet: Families) -> None:
    civil = [np.mean(p.parts[0].color) for f in ("airliner", "rear-engine-jet") for p in fleet[f]]
    military = [np.mean(p.parts[0].color) for f in ("fighter", "flying-wing") for p in fleet[f]]
    assert min(civil) > 180
    assert max(military) < 180
