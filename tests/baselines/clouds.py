"""Clouds that several baselines are tested on."""

from __future__ import annotations

import math

import numpy as np

from data_prep.clouds.sampling import sample_surface
from data_prep.scene import PointCloud
from data_prep.shapes.chair.chairs import chair

RADIUS = 0.7


def lattice_sphere(count: int = 2048) -> np.ndarray:
    """Fibonacci's lattice [count, 3]: as even as points on a sphere can be."""
    index = np.arange(count) + 0.5
    y, angle = 1 - 2 * index / count, math.pi * (1 + math.sqrt(5)) * index
    ring = np.sqrt(1 - y * y)
    return RADIUS * np.stack([ring * np.cos(angle), y, ring * np.sin(angle)], axis=1)


def chair_cloud(count: int = 2048) -> PointCloud:
    """Return the cloud of a chair, with the mesh behind it."""
    rng = np.random.default_rng(3)
    return sample_surface(chair(rng), rng, count)


def faces_of_edges(faces: np.ndarray) -> np.ndarray:
    """Return how many of faces [F, 3] each edge has: all 2 where a surface is closed."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]
