"""Screened Poisson as in Open3D's tutorials; needs the extra [open3d].

Outliers are removed by their distance to their neighbours, normals are those of 30 neighbours and
made to agree along the tangent plane graph (Hoppe et al. 1992), Poisson reconstruction goes to
depth 8, and what the points support least is trimmed: the twentieth of the vertices with the lowest
density. The numbers are those of Open3D's tutorials, where they give any; nothing is chosen for our
clouds.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.reconstruction.stages import (
    DrawsReconstruction,
    Reconstruction,
    finite_part,
    in_grey,
    used_points,
)
from data_prep.failures import MissingDependency, StageFailure
from data_prep.scene import PointCloud

OUTLIER_NEIGHBOURS, OUTLIER_DEVIATIONS = 20, 2.0
NORMAL_NEIGHBOURS = 30
_LEAST_POINTS = NORMAL_NEIGHBOURS + 1
MOST_POINTS = 100_000
_LOWEST_DENSITY = 0.05
REMEDY = "install it with \"pip install 'pc2pix-bench[open3d]'\", or leave out open3d-poisson"


@dataclass(frozen=True)
class Open3dPoisson(DrawsReconstruction):
    """The screened Poisson method of Open3D; `depth` is the number of levels of the octree."""

    depth: int = 8

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Reconstruct the surface on one thread; no randomness.

        The order of the points does not matter; those as far away as the camera are left out.

        Raises MissingDependency without Open3D. Raises StageFailure: `input` (fewer than 31
        different points in sight, or a non-finite one), `normals` (points on a line or in a plane,
        whose tangent planes have no graph) or `poisson` (no faces).
        """
        del rng
        library = open3d()
        points, notes = used_points(cloud, _LEAST_POINTS, MOST_POINTS, "tangent planes")
        geometry = library.geometry
        whole = geometry.PointCloud(library.utility.Vector3dVector(points.astype(np.float64)))
        inner, _ = whole.remove_statistical_outlier(OUTLIER_NEIGHBOURS, OUTLIER_DEVIATIONS)
        inner.estimate_normals(geometry.KDTreeSearchParamKNN(NORMAL_NEIGHBOURS))
        try:
            inner.orient_normals_consistent_tangent_plane(NORMAL_NEIGHBOURS)
        except RuntimeError as error:
            raise StageFailure("normals", " ".join(str(error).split())) from error
        try:
            mesh, density = geometry.TriangleMesh.create_from_point_cloud_poisson(
                inner, depth=self.depth, n_threads=1
            )
        except RuntimeError as error:
            raise StageFailure("poisson", " ".join(str(error).split())) from error
        support = np.asarray(density)
        if len(support) == 0:
            raise StageFailure("poisson", "no faces")
        mesh.remove_vertices_by_mask(support < np.quantile(support, _LOWEST_DENSITY))
        faces = np.asarray(mesh.triangles)
        if len(faces) == 0:
            raise StageFailure("poisson", "no faces")
        result = finite_part("poisson", in_grey(np.asarray(mesh.vertices), faces))
        outliers = len(points) - len(inner.points)
        removed = f"outliers: {outliers} of {len(points)} points removed"
        return Reconstruction(result.mesh, (removed, *notes, *result.notes))


def open3d() -> Any:
    """Return the library Open3D.

    Raises MissingDependency where it cannot be loaded.
    """
    try:
        return importlib.import_module("open3d")
    except (ImportError, OSError) as error:  # its wheel needs libusb and libGL from the system
        raise MissingDependency(f"Open3D does not load ({error}): {REMEDY}") from error
