"""Meshes in files: the surface that points are drawn of, and the mesh that is drawn itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from bench.draw.choice import Notes
from bench.draw.value_colours import ValueScale
from data_prep.clouds.coarse_steps import note_on_steps
from data_prep.clouds.normalise import Placement, normalise, placed_points
from data_prep.clouds.orientations import upright
from data_prep.clouds.sampling import sample_faces
from data_prep.failures import BadInput, NoFaces
from data_prep.files.cloud_contents import CloudContents
from data_prep.files.clouds import CLOUD_SUFFIXES
from data_prep.files.mesh_contents import corner_means, grey_faces
from data_prep.files.mesh_resources import MeshResources
from data_prep.files.meshes import MOST_BYTES, SUFFIXES, mesh_of_ply, read_contents
from data_prep.randomness import generator
from data_prep.scene import NEUTRAL_GREY, Mesh

# The suffixes of files that hold a mesh; a PLY may also be a cloud.
MESH_SUFFIXES = tuple(suffix for suffix in SUFFIXES if suffix not in CLOUD_SUFFIXES)


def read_surface(path: Path) -> CloudContents:
    """Return the corners and triangles of a mesh, and the colours of these where it has any.

    Raises BadInput as `read_mesh` does.
    """
    try:
        read = read_contents(path)
    except NoFaces:
        raise BadInput(
            f"{path}: the mesh has no faces; save its points as PLY or XYZ, and give that file"
        ) from None
    used = np.zeros(len(read.vertices), bool)
    used[read.faces] = True
    coloured = bool((read.face_colors != NEUTRAL_GREY).any())
    return CloudContents(
        read.vertices[used],
        has_colors=coloured,
        faces=(np.cumsum(used) - 1)[read.faces],
        face_colors=read.face_colors if coloured else None,
        notes=read.notes,
    )


def with_textures(contents: CloudContents, path: Path) -> CloudContents:
    """Return the contents of a PLY with the colours of its textures in place of those it had."""
    if not contents.is_mesh or contents.texture_places is None:
        return contents
    painted = mesh_of_ply(contents, MeshResources(path.parent, MOST_BYTES))
    return replace(
        contents, has_colors=True, colors=None, face_colors=painted.face_colors, notes=painted.notes
    )


def points_on_surface(contents: CloudContents, count: int) -> tuple[CloudContents, Notes] | None:
    """Return points sampled on the triangles of a mesh, with their colours, and notes.

    None where no triangle has an area.
    """
    faces, whole = _whole_faces(contents)
    try:
        points, face, shares = sample_faces(
            contents.points[faces[whole]], generator("render", "surface"), count
        )
    except BadInput:
        return None
    face = np.flatnonzero(whole)[face]
    colors = None if contents.face_colors is None else contents.face_colors[face]
    if contents.colors is not None:
        mixed = np.einsum("ij,ijk->ik", shares, contents.colors[faces[face]].astype(float))
        colors = np.rint(mixed).astype(np.uint8)
    drawn = (
        f"a mesh of {len(faces)} triangles: {count} points of its surface are drawn, not its "
        f"{len(contents.points)} vertices; --points takes another number"
    )
    values = None
    if contents.values is not None:
        values = np.einsum("ij,ij->i", shares, contents.values[faces[face]])
    steps = note_on_steps(contents.points)
    unused = tuple(part for part in contents.unused if not part.endswith("faces"))
    sampled = CloudContents(points, unused, None, contents.has_colors, colors, values=values)
    return sampled, (drawn, steps) if steps else (drawn,)


def with_values(contents: CloudContents, scale: ValueScale) -> CloudContents:
    """Return a mesh in colours by its values: each triangle by the mean of its corners."""
    if contents.faces is None or contents.values is None:
        return contents
    means = contents.values[contents.faces].mean(axis=1)
    return replace(contents, colors=None, face_colors=scale.colors(means))


def mesh_itself(
    contents: CloudContents, up: str, front: str | None, as_is: bool
) -> tuple[Mesh, Placement, Notes]:
    """Return the mesh upright, in the unit sphere unless `as_is`, that sphere's place, and notes.

    Colours of corners become the mean colour of a triangle. Raises BadInput where the mesh cannot
    be brought to the unit sphere.
    """
    faces, whole = _whole_faces(contents)
    colors = grey_faces(len(faces))
    if contents.colors is not None:
        colors = corner_means(contents.colors, faces)
    if contents.face_colors is not None:
        colors = contents.face_colors
    finite = np.asarray(np.isfinite(contents.points).all(axis=1))
    corners = upright(np.where(finite[:, None], contents.points, 0.0), up, front)
    with np.errstate(over="ignore"):  # what float32 cannot hold is refused as not finite
        mesh = Mesh(corners.astype(np.float32), faces[whole].astype(np.int32), colors[whole])
    notes = (
        f"the mesh itself is drawn, {len(mesh.faces)} triangles; --method draws from points of its "
        "surface",
    )
    if not whole.all():
        missing = f"{np.count_nonzero(~whole)} of {len(faces)} triangles"
        notes = (f"{missing} are left out, a corner is not finite", *notes)
    if as_is:
        return mesh, Placement(np.zeros(3), 1.0), notes
    whole_mesh = normalise(mesh, corners)
    _, place = placed_points(corners[np.unique(mesh.faces)])
    return whole_mesh, place, notes


def _whole_faces(contents: CloudContents) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the triangles [F, 3], and which of them have finite corners, [F]."""
    faces = cast("NDArray[np.int64]", contents.faces)
    return faces, np.asarray(np.isfinite(contents.points[faces]).all(axis=(1, 2)))
