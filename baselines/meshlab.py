"""The MeshLab filters of the benchmark: names and parameters, and nothing else.

pymeshlab renames filters and parameter types now and then (2022.2, 2023.12); this module is the
only one that knows them. Arrays go in and out; files never do.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import MissingDependency
from data_prep.render import REMEDY
from data_prep.scene import Mesh, Points


class MeshLab:
    """One mesh in a MeshLab document of its own, changed in place by each filter.

    The parameters that are not arguments are the original script's
    (ball-pivoting-close-holes-mc-rotate.mlx, roatienza/pc2pix@23b7b46d). Each method raises
    RuntimeError where MeshLab refuses. The constructor raises MissingDependency where pymeshlab
    cannot be loaded.
    """

    def __init__(self, points: Points) -> None:
        try:
            import pymeshlab
        except ImportError as error:  # its wheel needs libGL and libOpenGL from the system
            raise MissingDependency(f"pymeshlab does not load ({error}): {REMEDY}") from error

        self._types: Any = pymeshlab  # its names come from a compiled module
        self._meshes = self._types.MeshSet(verbose=False)
        self._meshes.add_mesh(self._types.Mesh(vertex_matrix=points.astype(np.float64)))

    def _apply(self, name: str, **parameters: Any) -> None:
        try:
            self._meshes.apply_filter(name, **parameters)
        except self._types.PyMeshLabException as error:
            raise RuntimeError(" ".join(str(error).split())) from error

    def estimate_normals(self, neighbours: int) -> None:
        """Normals from the `neighbours` nearest points; their signs are not made to agree."""
        self._apply("compute_normal_for_point_clouds", k=neighbours, flipflag=False)

    def ball_pivoting(self) -> None:
        """Radius chosen by MeshLab, clustering 20 %, crease angle 90 degrees."""
        self._apply(
            "generate_surface_reconstruction_ball_pivoting",
            ballradius=self._types.PercentageValue(0),
            clustering=20,
            creasethr=90,
            deletefaces=False,
        )

    def close_holes(self, max_edges: int) -> None:
        """Fill holes of fewer than `max_edges` edges without letting faces intersect."""
        self._apply(
            "meshing_close_holes",
            maxholesize=max_edges,
            selected=False,
            newfaceselected=True,
            selfintersection=True,
        )

    def marching_cubes_apss(self, resolution: int) -> None:
        """Algebraic point set surface, meshed on a grid of `resolution` cells a side."""
        self._apply(
            "generate_marching_cubes_apss",
            filterscale=2.0,
            projectionaccuracy=1e-4,
            maxprojectioniters=15,
            sphericalparameter=1.0,
            accuratenormal=True,
            resolution=resolution,
        )

    @property
    def face_count(self) -> int:
        """Faces of the current mesh."""
        return self._meshes.current_mesh().face_number()

    def normals(self) -> NDArray[np.float64]:
        """Vertex normals [V, 3] of the current mesh."""
        return self._meshes.current_mesh().vertex_normal_matrix()

    def mesh(self, color: tuple[int, int, int]) -> Mesh:
        """The current mesh in one colour. Its vertices may be non-finite."""
        current = self._meshes.current_mesh()
        faces = current.face_matrix()
        return Mesh(
            current.vertex_matrix(), faces, np.tile(np.array(color, np.uint8), (len(faces), 1))
        )
