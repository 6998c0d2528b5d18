"""Any mesh to the unit sphere, where all shapes of the project live (see `data_prep.scene`)."""

from __future__ import annotations

import numpy as np

from data_prep.failures import BadInput
from data_prep.scene import Mesh


def normalise(mesh: Mesh) -> Mesh:
    """The same faces and colours, centred and scaled to the unit sphere.

    Afterwards the bounding box of the vertices that faces use is centred at the origin, and the
    farthest of those vertices lies at radius 1 (float64 arithmetic, rounded to float32 once).
    Vertices that no face uses move along but do not count.

    Raises BadInput where there are no faces, where a vertex is not finite, and where all used
    vertices coincide.
    """
    if len(mesh.faces) == 0:
        raise BadInput("the mesh has no faces (0); give a surface, not a bare cloud of points")
    vertices = mesh.vertices.astype(np.float64)
    broken = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(broken):
        raise BadInput(
            f"the mesh has {len(broken)} non-finite vertices of {len(vertices)} "
            f"(the first is vertex {broken[0]}); repair or remove them"
        )
    used = vertices[np.unique(mesh.faces)]
    centre = (used.min(axis=0) + used.max(axis=0)) / 2
    radius = np.sqrt(((used - centre) ** 2).sum(axis=1).max())
    if radius == 0.0:
        raise BadInput(
            f"all {len(used)} vertices used by faces are equal, at {used[0].tolist()}; "
            "a shape needs an extent"
        )
    scaled = ((vertices - centre) / radius).astype(np.float32)
    return Mesh(scaled, mesh.faces, mesh.face_colors)
