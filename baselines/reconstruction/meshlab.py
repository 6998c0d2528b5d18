"""The MeshLab filters of the benchmark, with their names and parameters.

pymeshlab renames filters and parameter types now and then (2022.2, 2023.12); this module is the
only one that knows them. Arrays go in and out; files never do.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_prep.arrays import Floats
from data_prep.failures import MissingDependency
from data_prep.rendering.opengl import REMEDY
from data_prep.scene import Mesh, Points

# Side of MeshLab's grid for marching cubes over the longest side of the points' box: the grid
# extends beyond the box by a tenth at each end.
GRID_MARGIN = 1.2


class MeshLab:
    """One mesh in a MeshLab document of its own; each method but the last three changes it.

    points  [V, 3], vertices of the mesh
    faces   [F, 3], indices of vertices; None for points alone

    Parameters of filters that are not arguments have the values of the paper's script
    (ball-pivoting-close-holes-mc-rotate.mlx of roatienza/pc2pix@23b7b46d). The constructor raises
    MissingDependency where pymeshlab cannot be loaded, and every method RuntimeError where MeshLab
    refuses.
    """

    def __init__(
        self,
        points: Points | Floats,
        faces: NDArray[np.integer] | None = None,
    ) -> None:
        try:
            import pymeshlab
        except ImportError as error:  # its wheel needs libGL and libOpenGL from the system
            raise MissingDependency(f"pymeshlab does not load ({error}): {REMEDY}") from error

        self._types: Any = pymeshlab  # its names come from a compiled module
        self._meshes = self._types.MeshSet(verbose=False)
        arrays: dict[str, NDArray[Any]] = {"vertex_matrix": points.astype(np.float64)}
        if faces is not None:
            arrays["face_matrix"] = faces.astype(np.int32)
        self._meshes.add_mesh(self._types.Mesh(**arrays))

    def _apply(self, name: str, **parameters: Any) -> None:
        try:
            self._meshes.apply_filter(name, **parameters)
        except self._types.PyMeshLabException as error:
            raise RuntimeError(" ".join(str(error).split())) from error

    def estimate_normals(self, neighbours: int) -> None:
        """Estimate the normal of each point from its `neighbours` nearest points.

        Signs are made to agree between neighbours; all normals may point inwards.
        """
        self._apply("compute_normal_for_point_clouds", k=neighbours, flipflag=False)

    def ball_pivoting(self, radius_percent: float | None = None) -> None:
        """Make faces by pivoting a ball around the points.

        radius_percent  radius of the ball, in percent of the diagonal of the points' box; None
                        leaves it to MeshLab, as the paper's script does: it then depends on the box
                        and the number of points

        Points nearer to each other than 20 % of the radius are merged, and the ball does not roll
        over edges at which faces would meet at more than 90 degrees.
        """
        self._apply(
            "generate_surface_reconstruction_ball_pivoting",
            ballradius=self._types.PercentageValue(0 if radius_percent is None else radius_percent),
            clustering=20,
            creasethr=90,
            deletefaces=False,
        )

    def close_holes(self, max_edges: int) -> None:
        """Fill holes of fewer than `max_edges` edges, without triangles that intersect others.

        Whether triangles intersect is sometimes decided by a rounding error.
        """
        self._apply(
            "meshing_close_holes",
            maxholesize=max_edges,
            selected=False,
            newfaceselected=True,
            selfintersection=True,
        )

    def marching_cubes_apss(
        self, resolution: int, accuracy: float = 1e-4, accurate_normals: bool = True
    ) -> None:
        """Mesh the algebraic point set surface (APSS) on a grid and project the mesh onto it.

        resolution        number of cells along a side of the grid. The side is GRID_MARGIN times
                          the longest side of the box of all points, also of those that no face uses
        accuracy          step length, relative to the mean spacing of the points, below which a
                          projection ends. MeshLab 2025.7 reads that spacing from memory that it has
                          not written. At 0 a projection always takes 15 steps, so that results
                          repeat
        accurate_normals  whether the normals of vertices are exact; they change no vertex and no
                          face
        """
        self._apply(
            "generate_marching_cubes_apss",
            filterscale=2.0,
            projectionaccuracy=accuracy,
            maxprojectioniters=15,
            sphericalparameter=1.0,
            accuratenormal=accurate_normals,
            resolution=resolution,
        )

    def screened_poisson(self, depth: int) -> None:
        """Reconstruct a surface from oriented normals by screened Poisson reconstruction.

        depth  number of levels of the octree

        Points without a normal are left out; after `close_holes` these are the ones that no face
        uses. It runs on one thread, because with more the mesh differs from run to run.
        """
        self._apply(
            "generate_surface_reconstruction_screened_poisson",
            depth=depth,
            pointweight=4.0,  # weight of points relative to normals: MeshLab's default
            preclean=True,
            threads=1,
        )

    def alpha_wrap(self, radius: float, offset: float) -> None:
        """Replace the faces by a closed surface around them (alpha wrap, Portaneri et al. 2022).

        radius  of the ball that carves the surface from outside, in the units of the points
        offset  distance of the surface from the faces, in the same units

        The mesh must have a face, and two vertices that differ: otherwise CGAL ends the process.
        """
        self._apply(
            "generate_alpha_wrap",
            alpha=self._types.PureValue(radius),
            offset=self._types.PureValue(offset),
        )

    @property
    def face_count(self) -> int:
        """Return the number of faces of the current mesh."""
        return self._meshes.current_mesh().face_number()

    def normals(self) -> NDArray[np.float64]:
        """Return the vertex normals [V, 3] of the current mesh."""
        return self._meshes.current_mesh().vertex_normal_matrix()

    def mesh(self, color: tuple[int, int, int]) -> Mesh:
        """Return the current mesh in one colour, 0..255; some vertices may be non-finite."""
        current = self._meshes.current_mesh()
        faces = current.face_matrix()
        colors = np.tile(np.array(color, np.uint8), (len(faces), 1))
        return Mesh(current.vertex_matrix(), faces, colors)
