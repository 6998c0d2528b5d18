"""Meshes from files: whatever trimesh reads, reduced to what a scene requires.

Formats: PLY, OBJ, OFF, STL, GLB and GLTF. Textures become one colour per face, transparency is
dropped, and several parts in one file become one mesh.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput
from data_prep.normalise import normalise
from data_prep.sampling import face_areas
from data_prep.scene import Mesh

LOADER_VERSION = 1  # raise when a change here changes a mesh: finished work is then done again
SUFFIXES = (".ply", ".obj", ".off", ".stl", ".glb", ".gltf")
NEUTRAL_GREY = (180, 180, 180)  # for files without colours, and for reconstructions


@np.errstate(over="ignore", invalid="ignore")  # what float32 cannot hold is refused as not finite
def load_mesh(path: Path) -> Mesh:
    """The file's mesh, normalised to the unit sphere.

    The file's axes are kept: +Y has to be up and the front has to look towards -Z already. Vertices
    are not merged (trimesh would, and change the surface).

    Raises BadInput, naming the file: missing, not a mesh, no faces, non-finite vertices, no extent,
    no area.
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
        mesh = normalise(mesh)
    except ValueError as error:
        raise BadInput(f"{path}: {error}") from error
    if not face_areas(mesh).any():
        raise BadInput(f"{path}: all {len(mesh.faces)} faces have no area; a shape needs a surface")
    return mesh


def _face_colors(part: Any) -> NDArray[np.uint8]:
    """uint8 [F, 3] of a trimesh part (it has no types); neutral grey where the file gives none."""
    count = len(part.faces)
    grey = np.broadcast_to(np.array(NEUTRAL_GREY, np.uint8), (count, 3))
    visual = part.visual
    if visual.kind is None:
        return grey
    try:
        if visual.kind == "texture":
            colors = _texture_colors(visual, part.faces)
            if any((colors == stand_in).all() for stand_in in _stand_ins()):
                return grey
        else:
            colors = np.asarray(visual.face_colors)
    except Exception:  # a broken texture costs the colours, not the object
        return grey
    return colors[:, :3].astype(np.uint8) if colors.shape[:1] == (count,) else grey


def _texture_colors(visual: Any, faces: NDArray[np.int64]) -> NDArray[np.uint8]:
    """RGBA [F, 4]: the texture in the middle of each face, else the material's one colour."""
    colors = None
    if visual.uv is not None:
        colors = visual.material.to_color(visual.uv[faces].mean(axis=1))
    if colors is None:
        colors = visual.material.main_color
    return np.broadcast_to(colors, (len(faces), 4))


def _stand_ins() -> tuple[NDArray[np.uint8], ...]:
    """RGBA [4] that trimesh makes up for a material without a colour, and for one it lacks."""
    from trimesh.visual.color import DEFAULT_COLOR
    from trimesh.visual.material import empty_material

    return DEFAULT_COLOR, empty_material().to_color(np.zeros((1, 2)))[0]
