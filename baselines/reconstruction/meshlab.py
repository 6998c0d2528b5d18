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

GRID_MARGIN = 1.2  # MeshLab's grid exceeds the box by a tenth at each end


class MeshLab:
    """One mesh in a MeshLab document of its own, changed in place by each filter.

    The parameters that are not arguments are the original script's
    (ball-pivoting-close-holes-mc-rotate.mlx, roatienza/pc2pix@23b7b46d). Each method raises
    RuntimeError where MeshLab refuses. The constructor raises MissingDependency where pymeshlab
    cannot be loaded.
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
        """Estimate normals from the `neighbours` nearest points.

        Their signs are made to agree from neighbour to neighbour; which side is outside stays open.
        """
        self._apply("compute_normal_for_point_clouds", k=neighbours, flipflag=False)

    def ball_pivoting(self, radius_percent: float | None = None) -> None:
        """Pivot a ball whose radius is in percent of the box's diagonal.

        None leaves the radius to MeshLab, as the script does, which takes it from the box and the
        number of points. Clustering is 20 %, the crease angle 90 degrees.
        """
        self._apply(
            "generate_surface_reconstruction_ball_pivoting",
            ballradius=self._types.PercentageValue(0 if radius_percent is None else radius_percent),
            clustering=20,
            creasethr=90,
            deletefaces=False,
        )

    def close_holes(self, max_edges: int) -> None:
        """Fill holes of fewer than `max_edges` edges, avoiding triangles that intersect others.

        A rounding error may decide about that.
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
        """Mesh the algebraic point set surface on a grid and project the mesh onto it.

        A cell is GRID_MARGIN times the longest side of the points' box (of all points, also of
        those that no face uses) over `resolution`.

        accuracy          where a projection ends before 15 steps, relative to the mean spacing of
                          the points. MeshLab 2025.7 takes that spacing from memory it has not
                          written; at 0 there are always 15 steps, and the mesh depends on no memory
        accurate_normals  of the vertices; they change no vertex and no face
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
        """Reconstruct by screened Poisson on an octree of `depth` levels, from oriented normals.

        On one thread: with more, the mesh changes from run to run. Points without a normal (those
        that no face uses, after `close_holes`) are left out.
        """
        self._apply(
            "generate_surface_reconstruction_screened_poisson",
            depth=depth,
            pointweight=4.0,  # of the points against the normals: MeshLab's own
            preclean=True,
            threads=1,
        )

    def alpha_wrap(self, radius: float, offset: float) -> None:
        """Wrap the faces by a closed surface at the distance `offset` (Portaneri et al. 2022).

        It is carved from outside by a ball of `radius`; both are in the units of the points. The
        mesh must have faces, and two different vertices: on points alone CGAL ends the process.
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
        """Return the current mesh in one colour. Its vertices may be non-finite."""
        current = self._meshes.current_mesh()
        faces = current.face_matrix()
        return Mesh(
            current.vertex_matrix(), faces, np.tile(np.array(color, np.uint8), (len(faces), 1))
        )
