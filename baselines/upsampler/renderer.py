"""upsampled-wrap as a method of the benchmark: an alpha wrap, laid onto the learned surface.

The network moves the points of the cloud, and new points around them, onto the surface. All of
these are wrapped, as `alpha-wrap` wraps the points of a cloud. The wrap decides which parts are
connected, but its faces are coarse. So they are divided until half of their edges are at most 1.7
pixels long, or 3.4 under noise, and their corners are moved onto the surface. At last corners move
a little more, so that the normals of faces become those that the network predicts: flat sides
become flat, and creases sharp.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray

from baselines.reconstruction.alpha_wrap import BALL, wrapped
from baselines.reconstruction.denoised import MOST_POINTS
from baselines.reconstruction.stages import (
    FOOTPRINT,
    DrawsReconstruction,
    Reconstruction,
    in_grey,
    used_points,
)
from baselines.reconstruction.surface import NORMAL_NEIGHBOURS
from baselines.upsampler.projection import LearnedSurface
from data_prep.arrays import Floats
from data_prep.scene import Mesh, PointCloud
from learning.exact import exact_inference
from learning.weights import NetworkWeights

# Points that are wrapped, for each one of the cloud: so many that there are _WRAPPED, but within
# these bounds. On validation objects of 2,048 points, 8 gave no better images than 4.
_FEWEST, _MOST = 4, 8
_WRAPPED = 8192
# The number of points from which on the carving ball has BALL spacings. In smaller clouds it is as
# large as in a cloud of so many points, but never below one spacing: a ball that grows with the
# spacing fills shelves and the space between legs. LPIPS of 13 validation objects with 1,024 and
# 512 points is .101 and .136; with a ball of BALL spacings .125 and .151.
_USUAL = 2048
# Distance of the wrap from the points, in scene units: a quarter of a pixel. It is the smallest
# that `wrapped` takes, because corners are moved onto the surface afterwards.
_OFFSET = FOOTPRINT / 4
# Footprints: faces are divided until half of the edges are at most so long; the second of a noisy
# cloud, whose finer faces show its noise. LPIPS of clean validation objects would be .005 higher
# with the second, and that of objects with noise of 0.05 .007 higher with the first.
_FACE, _FACE_OF_NOISE = 1.7, 3.4
_MOST_DIVISIONS = 3  # times that faces are divided; each time has four times as many
_ROUNDS = 10  # rounds in which corners move to fit the normals; more rounds change nothing


class UpsampledWrapRenderer(DrawsReconstruction):
    """A `data_prep.scene.Renderer` of the surface that the network predicts for a cloud.

    weights  trained network of `baselines.upsampler.weights.load_weights`; moved to `device`
    device   PyTorch's name of the device
    """

    def __init__(self, weights: NetworkWeights, *, device: str = "cpu") -> None:
        self.weights = weights
        self.network = weights.network.to(torch.device(device))

    @exact_inference()
    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Return the surface of a cloud; `rng` is not used, nor does the points' order matter.

        Raises StageFailure at the stage `input` (fewer than 11 different points are nearer than the
        camera, or one is not finite), `up-sampling` (the network gives a place that is not finite,
        or one far away) or `alpha-wrap` (MeshLab refuses, or gives no face).
        """
        del rng
        points, notes = used_points(cloud, NORMAL_NEIGHBOURS + 1, MOST_POINTS, "surfaces")
        surface = LearnedSurface(self.network, points)
        dense = surface.upsampled(min(max(_WRAPPED // len(points), _FEWEST), _MOST))
        ball = max(1.0, BALL * min(1.0, math.sqrt(len(points) / _USUAL))) * surface.spacing
        wrap = wrapped(dense.points, ball, _OFFSET)
        return Reconstruction(laid_onto(surface, wrap.mesh), (*notes, *surface.notes, *wrap.notes))


def laid_onto(surface: LearnedSurface, mesh: Mesh) -> Mesh:
    """Return a mesh whose faces are divided and laid onto a surface, in grey.

    mesh  closed, and near the surface
    """
    from trimesh.remesh import subdivide

    longest = _FACE_OF_NOISE if surface.smoothed else _FACE
    vertices, faces = mesh.vertices.astype(np.float64), mesh.faces
    for _ in range(_MOST_DIVISIONS):
        edges = np.linalg.norm(vertices[faces] - vertices[np.roll(faces, 1, axis=1)], axis=2)
        if np.median(edges) <= longest * FOOTPRINT:
            break
        vertices, faces = subdivide(vertices, faces)[:2]
    vertices = surface.project(vertices).points.astype(np.float64)
    normals = surface.project(vertices[faces].mean(axis=1)).normals
    return in_grey(turned_faces(vertices, faces, normals.astype(np.float64)), faces)


def turned_faces(vertices: Floats, faces: NDArray[np.integer], normals: Floats) -> Floats:
    """Return vertices [V, 3] moved so that faces get given normals.

    In each round every face has a plane through its middle, at right angles to the given normal. A
    vertex moves by the mean of the steps that would take it onto the planes of its faces (Sun et
    al., Fast and effective feature-preserving mesh denoising, IEEE TVCG 13(5), 2007). A mesh that
    has these normals stays as it is.

    vertices  [V, 3]
    faces     [F, 3]
    normals   [F, 3], unit vectors, whose signs do not matter
    """
    count = len(vertices)
    uses = np.bincount(faces.ravel(), minlength=count).clip(1)[:, None]
    for _ in range(_ROUNDS):
        corners = vertices[faces]
        height = ((corners.mean(axis=1)[:, None] - corners) * normals[:, None]).sum(axis=2)
        moves = (height[..., None] * normals[:, None]).reshape(-1, 3)
        sums = [np.bincount(faces.ravel(), move, count) for move in moves.T]
        vertices = vertices + np.stack(sums, axis=1) / uses
    return vertices
