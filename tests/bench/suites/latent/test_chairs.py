from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bench.suites.latent.chairs import CHANGES, choose_pairs, choose_triples, specified_chairs
from bench.suites.latent.run import LATENT
from data_prep.datasets.registry import ProceduralObject
from data_prep.failures import BadInput


@pytest.fixture(scope="module")
def chairs():
    return specified_chairs("test", LATENT.pool)


def rng(seed=0):
    return np.random.default_rng(seed)


def test_pairs_differ_in_family_and_share_no_chair(chairs):
    pairs = choose_pairs(chairs[: 2 * LATENT.pairs], rng())
    assert len(pairs) == LATENT.pairs >= 50
    assert all(pair.start.spec.family != pair.end.spec.family for pair in pairs)
    used = [chair.id for pair in pairs for chair in (pair.start, pair.end)]
    assert sorted(used) == [f"test-{i:04d}" for i in range(2 * LATENT.pairs)]
    families = {frozenset((p.start.spec.family, p.end.spec.family)) for p in pairs[: LATENT.shown]}
    assert len(families) > 2
    assert pairs == choose_pairs(chairs[: 2 * LATENT.pairs], rng())
    assert pairs != choose_pairs(chairs[: 2 * LATENT.pairs], rng(1))


def test_triples_have_an_answer(chairs):
    triples = choose_triples(chairs, LATENT.triples, rng())
    assert len(triples) == LATENT.triples >= 50
    used = [chair.id for triple in triples for chair in (triple.b, triple.c)]
    assert len(set(used)) == 2 * len(triples)
    known = {chair.id: chair.spec for chair in chairs}
    dataset = (ProceduralObject("chair", "test", 7).load(), chairs[7].load())
    assert np.array_equal(dataset[0].vertices, dataset[1].vertices)
    changes = {change.id: change for change in CHANGES}
    for number, triple in enumerate(triples):
        assert triple.change == CHANGES[number % len(CHANGES)].id
        change = changes[triple.change]
        for before, after in ((triple.b, triple.a), (triple.c, triple.d)):
            assert known[before.id] == before.spec
            assert change.fits(before.spec)
            assert after.spec == change.apply(before.spec) != before.spec
            assert not change.fits(after.spec)  # it has what the change gives
            assert after.id == f"{before.id}+{triple.change}"


FIELDS = {
    "arms": {"arms"},
    "pedestal": {"family", "base", "leg_m", "apron"},
    "slats": {"back", "bars"},
}


def test_a_change_alters_these_fields_and_the_mesh(chairs):
    triples = choose_triples(chairs, 12, rng())
    assert {t.change for t in triples} == {c.id for c in CHANGES} == FIELDS.keys()
    for triple in triples:
        before, after = (dataclasses.asdict(chair.spec) for chair in (triple.c, triple.d))
        assert {name for name in before if before[name] != after[name]} <= FIELDS[triple.change]
        meshes = triple.c.load(), triple.d.load()
        assert meshes[0].vertices.shape != meshes[1].vertices.shape
        # whole and normalised, as every chair
        assert np.linalg.norm(meshes[1].vertices, axis=1).max() == pytest.approx(1, abs=1e-6)


def test_too_few_chairs(chairs):
    with pytest.raises(ValueError, match="3 chairs cannot be paired"):
        choose_pairs(chairs[:3], rng())
    with pytest.raises(BadInput, match=r"9 triples: no two chairs are left for the change 'arms'"):
        choose_triples(chairs[:1], 9, rng())
