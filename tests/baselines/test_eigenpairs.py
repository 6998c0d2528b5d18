from __future__ import annotations

import numpy as np
import pytest

from baselines.eigenpairs import smallest_eigenpairs

UPPER = np.triu_indices(3)


def packed(matrices):
    return np.asarray(matrices, np.float64)[:, *UPPER]


def turned(values, rng):
    """Symmetric matrices [n, 3, 3] of eigenvalues [n, 3], and the eigenvectors as columns."""
    vectors, _ = np.linalg.qr(rng.normal(size=(len(values), 3, 3)))
    return (vectors * values[:, None]) @ vectors.mT, vectors


@pytest.mark.parametrize("scale", [1e-300, 1e-60, 1.0, 1e60, 1e300])
def test_against_lapack(scale):
    rng = np.random.default_rng(0)
    gaps = rng.uniform(0.1, 1, (500, 3)).cumsum(axis=1) - 0.5  # also negative, all well apart
    matrices, vectors = turned(gaps, rng)
    actual, across = smallest_eigenpairs(packed(matrices * scale))
    np.testing.assert_allclose(actual / scale, np.linalg.eigvalsh(matrices)[:, 0], atol=1e-13)
    # an error of 1e-15 over a gap of 0.1 turns a vector by 1e-14; its cosine by nothing
    np.testing.assert_allclose(np.abs((across * vectors[..., 0]).sum(axis=1)), 1, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(across, axis=1), 1, atol=1e-15)


@pytest.mark.parametrize(
    "values", [(0, 0, 1), (0, 1, 1), (1, 1, 2), (1, 1 + 1e-9, 2), (0, 1e-9, 1)]
)
def test_equal_eigenvalues(values):
    """Two that are nearly equal are known to the root of float64's last digit, 1e-8."""
    rng = np.random.default_rng(1)
    matrices, _ = turned(np.tile(np.array(values, np.float64), (200, 1)), rng)
    actual, across = smallest_eigenpairs(packed(matrices))
    np.testing.assert_allclose(actual, values[0], rtol=0, atol=3e-8)
    np.testing.assert_allclose(np.linalg.norm(across, axis=1), 1, atol=1e-15)
    # whichever vector it is, it is one of the smallest eigenvalue, as nearly as there are two
    stretch = np.linalg.norm((matrices @ across[..., None])[..., 0] - values[0] * across, axis=1)
    assert stretch.max() < 1e-7


def test_matrices_along_the_axes():
    diagonals = [(0.0, 0.0, 0.0), (5.0, 5.0, 5.0), (3.0, 1.0, 2.0), (0.0, 0.0, 7.0)]
    values, vectors = smallest_eigenpairs(packed([np.diag(row) for row in diagonals]))
    np.testing.assert_allclose(values, [0, 5, 1, 0], rtol=0, atol=1e-7)
    np.testing.assert_array_equal(vectors[:2], [[0, 0, 1]] * 2)
    np.testing.assert_allclose(np.abs(vectors[2]), [0, 1, 0], rtol=0, atol=1e-7)
    assert abs(vectors[3, 2]) < 1e-7


def test_matrices_do_not_know_of_each_other():
    """Matrices of rank 1 and 0 take another way, and only they."""
    rng = np.random.default_rng(2)
    matrices, _ = turned(rng.uniform(0, 1, (20, 3)), rng)
    alone = smallest_eigenpairs(packed(matrices))
    mixed = smallest_eigenpairs(packed([*matrices, np.diag([1.0, 0, 0]), np.zeros((3, 3))]))
    for first, other in zip(alone, mixed, strict=True):
        np.testing.assert_array_equal(first, other[:20])
    assert [actual.shape for actual in smallest_eigenpairs(np.empty((0, 6)))] == [(0,), (0, 3)]
