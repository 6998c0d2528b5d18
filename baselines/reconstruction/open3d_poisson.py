"""Screened Poisson reconstruction as in Open3D's tutorials; it needs the extra [open3d].

Points far from their neighbours are removed as outliers. Normals are estimated from 30 neighbours,
and their signs made to agree along the graph of tangent planes (Hoppe et al. 1992). After Poisson
reconstruction at depth 8 the vertices with the lowest density of points, a twentieth of all, are
removed. The numbers are those of Open3D's tutorials where these give any; none is tuned to the
clouds of this project.
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

# A point is an outlier where its mean distance to its OUTLIER_NEIGHBOURS nearest points exceeds the
# cloud's mean of that distance by more than OUTLIER_DEVIATIONS standard deviations.
OUTLIER_NEIGHBOURS, OUTLIER_DEVIATIONS = 20, 2.0
NORMAL_NEIGHBOURS = 30  # nearest points that a normal is estimated from
_LEAST_POINTS = NORMAL_NEIGHBOURS + 1  # smallest number of different points of a cloud
MOST_POINTS = 100_000  # points that are used; of a larger cloud a random subset
_LOWEST_DENSITY = 0.05  # share of the vertices, those of lowest density, that is removed
REMEDY = "install it with \"pip install 'pc2pix-bench[open3d]'\", or leave out open3d-poisson"


@dataclass(frozen=True)
class Open3dPoisson(DrawsReconstruction):
    """The screened Poisson reconstruction of Open3D.

    depth  number of levels of the octree
    """

    depth: int = 8

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Reconstruct the surface on one thread; `rng` is not used.

        The order of the points does not matter. Points that are no nearer than the camera are left
        out.

        Raises MissingDependency where Open3D cannot be loaded. Raises StageFailure at the stage
        `input`, for fewer than 31 different points in sight and for a non-finite one; at `normals`,
        for points on a line or in a plane, for which Open3D finds no graph of tangent planes; and
        at `poisson`, where no face comes out.
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
    """Return the module of the library Open3D.

    Raises MissingDependency where it cannot be loaded.
    """
    try:
        return importlib.import_module("open3d")
    except (ImportError, OSError) as error:  # its wheel needs libusb and libGL from the system
        raise MissingDependency(f"Open3D does not load ({error}): {REMEDY}") from error
