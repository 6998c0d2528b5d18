"""Meshes from files, reduced to the needs of a scene.

Formats: PLY, OBJ, OFF, STL, GLB and GLTF. Textures become one colour per face, transparency is
dropped, and several parts in one file become one mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from data_prep.clouds.normalise import normalise
from data_prep.clouds.orientations import OURS, Orientation
from data_prep.clouds.sampling import face_areas
from data_prep.failures import BadInput, NoFaces
from data_prep.files.cloud_contents import CloudContents, NotACloud
from data_prep.files.cloud_ply import read_ply
from data_prep.files.file_kinds import START_BYTES, mismatch
from data_prep.files.mesh_contents import (
    FaceColors,
    MeshContents,
    NotAMesh,
    corner_means,
    grey_faces,
)
from data_prep.files.mesh_gltf import read_gltf
from data_prep.files.mesh_obj import read_obj
from data_prep.files.mesh_off import read_off
from data_prep.files.mesh_resources import MeshResources
from data_prep.files.mesh_stl import read_stl
from data_prep.files.safe_read import read_file, reason_of
from data_prep.files.textures import TextureReader, colors_at, from_below
from data_prep.scene import Mesh

# A part of the keys of finished work. Raise it when a change here changes a mesh, so that the work
# is done again.
LOADER_VERSION = 2
# The most bytes of a file, and of its resources together.
MOST_BYTES = 2**30
# The most faces, and the most vertices, of a glTF, where each instance counts: a few bytes can ask
# for any number of them. Other formats are bounded by MOST_BYTES.
MOST_FACES = 50_000_000


@np.errstate(all="ignore")  # a value beyond float32 is refused as not finite
def load_mesh(path: Path, orientation: Orientation = OURS, within: Path | None = None) -> Mesh:
    """Return the mesh of a file, normalised to the unit sphere.

    orientation  the axes of the file that point up and to the front; by default +Y and -Z
    within       as in `read_mesh`

    Raises BadInput as `read_mesh` does, and for vertices that are not finite, and for a mesh
    without extent or area.
    """
    contents = read_contents(path, within)
    stored = _mesh(path, contents)
    turned = Mesh(orientation.to_ours(stored.vertices), stored.faces, stored.face_colors)
    try:
        mesh = normalise(turned, orientation.to_ours(contents.vertices))
    except ValueError as error:
        raise BadInput(f"{path}: {error}") from error
    if not face_areas(mesh).any():
        raise BadInput(f"{path}: all {len(mesh.faces)} faces have no area; a shape needs a surface")
    return mesh


@np.errstate(all="ignore")  # a value beyond float32 is refused as not finite
def read_mesh(path: Path, within: Path | None = None) -> Mesh:
    """Return the mesh of a file with its own axes and size.

    Vertices are not merged, as that would change the surface. Materials, textures and buffers are
    read from the mesh's own folder only, or from anywhere in `within`, a folder above it.

    Raises BadInput, which names the file, where it is missing, no regular file, too large or no
    mesh, and NoFaces for a mesh without faces. Time and memory grow with the size of the file, not
    with the sizes that it claims. As pictures are decoded by a library, an untrusted mesh should be
    read in a worker with limits all the same.
    """
    return _mesh(path, read_contents(path, within))


@np.errstate(all="ignore")  # files may hold numbers that are not finite, as places in textures
def read_contents(path: Path, within: Path | None = None) -> MeshContents:
    """Return the contents of a file as `read_mesh` does, before they are rounded to float32.

    They have notes on what the file names but could not be found or read.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise BadInput(f"{path}: no mesh by its name; use one of {', '.join(SUFFIXES)}")
    data = read_file(path, MOST_BYTES)
    if problem := mismatch(data[:START_BYTES], path.suffix):
        raise BadInput(f"{path}: {problem}")
    resources = MeshResources(path.parent, MOST_BYTES, within)
    try:
        contents = _READERS[path.suffix.lower()](data, resources)
    except (NotAMesh, NotACloud) as problem:
        raise BadInput(f"{path}: {problem}") from problem.__cause__
    except BadInput as error:  # of a file beside it
        raise BadInput(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        # The tree of a glTF has any number, word or list at any place.
        raise BadInput(
            f"{path}: not a readable mesh ({type(error).__name__}: {reason_of(error)}); write the "
            "file again"
        ) from error
    if not len(contents.faces):
        raise NoFaces(f"{path}: the mesh has no faces; a bare point cloud cannot be scored")
    return contents


def _mesh(path: Path, contents: MeshContents) -> Mesh:
    try:
        vertices = contents.vertices.astype(np.float32)
        return Mesh(vertices, contents.faces.astype(np.int32), contents.face_colors)
    except ValueError as error:
        raise BadInput(f"{path}: {error}") from error


def _read_ply(data: bytes, resources: MeshResources) -> MeshContents:
    """Return the faces of a PLY with the colours of its texture, its faces or its vertices."""
    return mesh_of_ply(read_ply(data, with_colors=True), resources)


def mesh_of_ply(read: CloudContents, resources: MeshResources) -> MeshContents:
    """Return the mesh that a PLY holds, in the colours that were read and those of its textures."""
    faces = np.empty((0, 3), np.int64) if read.faces is None else read.faces
    colors = grey_faces(len(faces))
    if read.colors is not None:
        colors = corner_means(read.colors, faces)
    if read.face_colors is not None:
        colors = read.face_colors
    notes = [*read.notes, *_paint_textures(read, colors, resources)]
    return MeshContents(read.points, faces, colors, tuple(notes))


def _paint_textures(read: CloudContents, colors: FaceColors, resources: MeshResources) -> list[str]:
    """Give the faces of a PLY the colours of its textures, in place, and return notes."""
    if read.texture_places is None:
        return []
    textures = TextureReader(resources.read)
    middles = from_below(read.texture_places.mean(axis=1))
    numbers = read.texture_of_face
    if numbers is None:
        numbers = np.zeros(len(middles), np.int64)
    for number, name in enumerate(read.textures):
        rows = np.flatnonzero(numbers == number)
        pixels = textures.pixels(name) if len(rows) else None
        if pixels is not None:
            colors[rows] = colors_at(pixels, middles[rows])
    notes = list(textures.notes)
    if read.texture_of_face is None and len(read.textures) > 1:
        notes.append(f"only the first of its {len(read.textures)} textures is used")
    return notes


_READERS: Mapping[str, Callable[[bytes, MeshResources], MeshContents]] = {
    ".ply": _read_ply,
    ".obj": read_obj,
    ".off": lambda data, _: read_off(data),
    ".stl": lambda data, _: read_stl(data),
    ".glb": lambda data, resources: read_gltf(data, resources, MOST_FACES),
    ".gltf": lambda data, resources: read_gltf(data, resources, MOST_FACES),
}
SUFFIXES = tuple(_READERS)
