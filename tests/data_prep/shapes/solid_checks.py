"""Objects drawn at random by family, checks that every class has to pass, measures of solids."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence

import numpy as np
import trimesh

from data_prep.shapes.catalogue import FAMILIES, NOVEL_FAMILIES
from data_prep.shapes.shape_class import Drawn
from data_prep.shapes.solids import Part

GREY = (120, 121, 122)
# A few hundred float64 operations on numbers of order 1, each off by 2**-53: 1e-12 is a hundred
# times the worst case, and still far below any wrong formula.
EXACT = 1e-12


NOVEL = {f"novel {name}": families for name, families in NOVEL_FAMILIES.items()}


@functools.cache
def of_each_family(name: str, seed: int = 4, count: int = 2) -> dict[str, list[Drawn]]:
    """Return that many objects of each family of a class; read only."""
    rng = np.random.default_rng(seed)
    return {
        family: [Drawn(family, tuple(build(rng))) for _ in range(count)]
        for family, (_, build) in (FAMILIES | NOVEL)[name].items()
    }


def unsound(parts: Sequence[Part]) -> list[int]:
    """Parts that are not closed, whose faces do not all turn the same way, or that face inwards."""
    judged = [trimesh.Trimesh(part.vertices, part.faces, process=False) for part in parts]
    return [
        number
        for number, mesh in enumerate(judged)
        if not (mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0)
    ]


def afloat(parts: Sequence[Part]) -> list[int]:
    """Parts that no chain of parts sunk into each other joins to the first.

    Touching is not enough: what touches in floats has a gap in another view.
    """
    probed = [probes(part) for part in parts]
    chains = np.arange(len(parts))  # parts of one number are known to be joined
    pairs = itertools.permutations(range(len(parts)), 2)
    for i, j in sorted(pairs, key=lambda ij: len(probed[ij[0]]) * len(parts[ij[1]].faces)):
        if chains[i] == chains[j]:
            continue
        low, high = parts[j].vertices.min(axis=0), parts[j].vertices.max(axis=0)
        near = probed[i][((probed[i] > low) & (probed[i] < high)).all(axis=1)]
        # In small pieces: most often one of the first points is inside.
        pieces = (near[k : k + 32] for k in range(0, len(near), 32))
        if any((winding(piece, parts[j]) > 0.5).any() for piece in pieces):
            chains[chains == chains[i]] = chains[j]
    return np.flatnonzero(chains != chains[0]).tolist()


def shared_planes(parts: Sequence[Part], size: float) -> list[tuple[int, int]]:
    """Pairs of parts with overlapping faces of different colours in one plane: these flicker.

    A depth buffer of 24 bits with its near plane at 0.2 tells 4**2 / (0.2 * 2**24) = 5e-6 apart at
    an object of radius 1; 2e-5 keeps clear of that. `size` is the object's radius. Faces meet
    where the boxes around them do, in two directions by over 0.3 % of it.
    """
    slack = 2e-5 * size
    planes = []
    for part in parts:
        corners = part.vertices[part.faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        offset = (normal * corners[:, 0]).sum(axis=1)
        planes.append((part.color, normal, offset, corners.min(axis=1), corners.max(axis=1)))
    found = []
    for (a, one), (b, other) in itertools.combinations(enumerate(planes), 2):
        if one[0] == other[0]:
            continue
        same = (one[1] @ other[1].T > 1 - 1e-5) & (np.abs(one[2][:, None] - other[2][None]) < slack)
        i, j = np.nonzero(same)
        shared = np.minimum(one[4][i], other[4][j]) - np.maximum(one[3][i], other[3][j])
        if (np.sort(shared, axis=1) > (-slack, 0.003 * size, 0.003 * size)).all(axis=1).any():
            found.append((a, b))
    return found


def box_of(parts: Sequence[Part]) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest coordinates, each [3]."""
    vertices = np.concatenate([part.vertices for part in parts])
    return vertices.min(axis=0), vertices.max(axis=0)


def radius(parts: Sequence[Part]) -> float:
    """Half of the diagonal of the box around all parts."""
    low, high = box_of(parts)
    return float(np.linalg.norm(high - low)) / 2


def volume(part: Part) -> float:
    """By trimesh, an independent judge; negative where the part is inside out."""
    return float(trimesh.Trimesh(part.vertices, part.faces, process=False).volume)


def winding(points: np.ndarray, part: Part) -> np.ndarray:
    """Winding number of a closed part about points (Van Oosterom & Strackee 1983): 1 inside."""
    a, b, c = (part.vertices[None, part.faces[:, i]] - points[:, None] for i in range(3))
    la, lb, lc = (np.linalg.norm(side, axis=2) for side in (a, b, c))
    triple = (a * np.cross(b, c)).sum(2)
    rest = la * lb * lc + (a * b).sum(2) * lc + (b * c).sum(2) * la + (a * c).sum(2) * lb
    return (2 * np.arctan2(triple, rest)).sum(1) / (4 * np.pi)


def probes(part: Part) -> np.ndarray:
    """Vertices, middles of edges and of faces: an end sunk into another part has one inside it."""
    corners = part.vertices[part.faces]
    edges = (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3) / 2
    return np.concatenate([part.vertices, edges, corners.mean(axis=1)])
