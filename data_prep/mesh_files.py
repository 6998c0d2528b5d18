"""Meshes from files: whatever trimesh reads, reduced to what a scene requires.

Formats: PLY, OBJ, OFF, STL, GLB and GLTF. Textures become one colour per face, transparency is
dropped, and several parts in one file become one mesh.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput
from data_prep.normalise import normalise
from data_prep.scene import Mesh

SUFFIXES = (".ply", ".obj", ".off", ".stl", ".glb", ".gltf")
NEUTRAL_GREY = (180, 180, 180)  # for files without colours, and for reconstructions


def load_mesh(path: Path) -> Mesh:
    """The file's mesh, normalised to the unit sphere.

    The file's axes are kept: +Y has to be up and the front has to look towards -Z already. Vertices
    are not merged (trimesh would, and change the surface).

    Raises BadInput, naming the file: missing, not a mesh, no faces, non-finite vertices, no extent.
    """
    import trimesh

    if not path.is_file():
        raise BadInput(f"{path}: no such file")
    try:
        loaded = trimesh.load_scene(path, process=False)
        parts = [g for g in loaded.dump() if isinstance(g, trimesh.Trimesh) and len(g.faces)]
    except Exception as error:  # trimesh raises whatever its parsers raise
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise BadInput(
            f"{path}: not a readable mesh ({reason}); use one of {', '.join(SUFFIXES)}"
        ) from error
    if not parts:
        raise BadInput(f"{path}: the mesh has no faces; a bare point cloud cannot be scored")
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    try:
        mesh = Mesh(
            np.concatenate([part.vertices for part in parts]),
            np.concatenate([part.faces + o for part, o in zip(parts, offsets, strict=True)]),
            np.concatenate([_face_colors(part) for part in parts]),
        )
        return normalise(mesh)
    except ValueError as error:
        raise BadInput(f"{path}: {error}") from error


def _face_colors(part: object) -> NDArray[np.uint8]:
    """uint8 [F, 3] of one trimesh part; neutral grey where the file gives none."""
    count = len(part.faces)  # type: ignore[attr-defined]
    grey = np.broadcast_to(np.array(NEUTRAL_GREY, np.uint8), (count, 3))
    visual = part.visual  # type: ignore[attr-defined]
    if visual.kind is None:
        return grey
    try:
        if visual.kind == "texture":
            visual = visual.to_color()
        colors = np.asarray(visual.face_colors)
    except Exception:  # a broken texture costs the colours, not the object
        return grey
    return colors[:, :3].astype(np.uint8) if colors.shape[:1] == (count,) else grey
