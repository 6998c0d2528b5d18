"""Meshes from files, read by trimesh and reduced to the needs of a scene.

Formats: PLY, OBJ, OFF, STL, GLB and GLTF. Textures become one colour per face, transparency is
dropped, and several parts in one file become one mesh.
"""

from __future__ import annotations

import io
import json
import logging
import os
import re
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from data_prep.clouds.normalise import normalise
from data_prep.clouds.orientations import OURS, Orientation
from data_prep.clouds.sampling import face_areas
from data_prep.failures import BadInput, NoFaces
from data_prep.files.cloud_contents import NotACloud
from data_prep.files.cloud_ply import read_ply
from data_prep.files.safe_read import open_file, reason_of
from data_prep.scene import NEUTRAL_GREY, Mesh

# A part of the keys of finished work. Raise it when a change here changes a mesh, so that the work
# is done again.
LOADER_VERSION = 1
SUFFIXES = (".ply", ".obj", ".off", ".stl", ".glb", ".gltf")

# The most bytes of a file, of its resources together, and of the buffer views of a glTF.
MOST_BYTES = 2**30
MOST_FACES = 50_000_000  # the most faces of a mesh, where each instance of a part counts
# The most pixels of a texture (8,192 x 8,192). Its file may be small, but takes 1.4 GiB of memory
# while it is decoded.
MOST_PIXELS = 2**26
_MOST_ZEROS = 2**24  # the most numbers that a glTF may leave out, in whose place trimesh puts zeros


@np.errstate(all="ignore")  # a value beyond float32 is refused as not finite
def load_mesh(path: Path, orientation: Orientation = OURS, within: Path | None = None) -> Mesh:
    """Return the mesh of a file, normalised to the unit sphere.

    orientation  the axes of the file that point up and to the front; by default +Y and -Z
    within       as in `read_mesh`

    Raises BadInput as `read_mesh` does, and for vertices that are not finite, and for a mesh
    without extent or area.
    """
    stored, unrounded = _read(path, within)
    turned = Mesh(orientation.to_ours(stored.vertices), stored.faces, stored.face_colors)
    try:
        mesh = normalise(turned, orientation.to_ours(unrounded))
    except ValueError as error:
        raise BadInput(f"{path}: {error}") from error
    if not face_areas(mesh).any():
        raise BadInput(f"{path}: all {len(mesh.faces)} faces have no area; a shape needs a surface")
    return mesh


@np.errstate(all="ignore")  # a value beyond float32 is refused as not finite
def read_mesh(path: Path, within: Path | None = None) -> Mesh:
    """Return the mesh of a file with its own axes and size.

    Vertices are not merged: trimesh would do so by default, which changes the surface. Materials,
    textures and buffers are read from the mesh's own folder only, or from anywhere in `within`, a
    folder above it.

    Raises BadInput, which names the file, where it is missing, no regular file, too large or no
    mesh, and NoFaces for a mesh without faces. Time and memory grow with the size of the file, not
    with the sizes that it claims. As its parsers are libraries all the same, an untrusted mesh
    should be read in a worker with limits.
    """
    return _read(path, within)[0]


def _read(path: Path, within: Path | None) -> tuple[Mesh, NDArray[np.float64]]:
    """Return the mesh as `read_mesh`, and its vertices before they are rounded to float32."""
    if path.suffix.lower() not in SUFFIXES:
        raise BadInput(f"{path}: no mesh by its name; use one of {', '.join(SUFFIXES)}")
    with open_file(path, MOST_BYTES) as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # libraries warn about files; what matters is raised below
        try:
            parts = _parts(file, path, within)
        except BadInput:
            raise
        except Exception as error:  # the parsers of trimesh may raise any exception
            reason = str(error) if isinstance(error, NotACloud) else reason_of(error)
            raise BadInput(
                f"{path}: not a readable mesh ({reason}); use one of {', '.join(SUFFIXES)}"
            ) from error
        if not parts:
            raise NoFaces(f"{path}: the mesh has no faces; a bare point cloud cannot be scored")
        try:
            return _joined(parts)
        except ValueError as error:
            raise BadInput(f"{path}: {error}") from error


def _parts(file: BinaryIO, path: Path, within: Path | None) -> list[Any]:
    """Return the trimesh.Trimesh parts with faces, each at the place of its node."""
    import trimesh
    from PIL import EpsImagePlugin

    from data_prep.files.mesh_resources import MeshResources

    # Without this, Pillow would execute a texture in PostScript with Ghostscript.
    EpsImagePlugin.gs_binary = False
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # no tracebacks about textures
    kind = path.suffix.lower()
    if kind in (".glb", ".gltf"):
        _check_gltf(file, kind)
    if kind == ".ply":
        file = _in_double(file)
    resources = MeshResources(path.parent, MOST_BYTES, within)
    try:
        scene = trimesh.load_scene(file, file_type=kind, resolver=resources, process=False)
    except (ValueError, NameError) as error:  # NameError: lists of vertices with another name
        if kind != ".ply" or isinstance(error, BadInput):
            raise
        file.seek(0)
        scene = trimesh.Scene(_polygons(file.read()))
    for geometry in scene.geometry.values():
        material = getattr(getattr(geometry, "visual", None), "material", None)
        for image in (getattr(material, name, None) for name in _TEXTURES):
            if image is not None and image.width * image.height > MOST_PIXELS:
                raise BadInput(
                    f"{path}: a texture of {image.width} x {image.height} pixels, at most "
                    f"{MOST_PIXELS} are read; give a smaller one"
                )
    faces = 0
    for node in scene.graph.nodes_geometry:
        faces += len(getattr(scene.geometry[scene.graph[node][1]], "faces", ()))
        if faces > MOST_FACES:
            raise BadInput(f"{path}: more than {MOST_FACES} faces; give a coarser mesh")
    parts = [g for g in scene.dump() if isinstance(g, trimesh.Trimesh) and len(g.faces)]
    if kind == ".off" and parts:
        file.seek(0)
        # Where a colour is broken, the object is kept without its colours.
        with suppress(ValueError, IndexError, OverflowError):
            _paint_off(parts[0], file.read())
    return parts


def _paint_off(part: Any, data: bytes) -> None:
    """Give the mesh of an OFF the colours of its vertices and faces, which trimesh leaves out."""
    from trimesh.geometry import triangulate_quads
    from trimesh.util import comment_strip, decode_text

    kind, _, body = comment_strip(decode_text(data)).partition("OFF")
    lines = [line for line in body.splitlines() if line.strip()]
    corners = int(lines[0].split()[0])
    if "C" in kind:
        first = 6 if "N" in kind else 3  # after the normal
        colors = [_off_color(line.split()[first:]) for line in lines[1 : 1 + corners]]
        part.visual.vertex_colors = np.array(colors, np.uint8)
    rows = [line.split() for line in lines[1 + corners :]][: int(lines[0].split()[1])]
    painted = [row[1 + int(row[0]) :] for row in rows]
    if any(len(values) >= 3 for values in painted):
        # trimesh returns triangles in another order than the faces. To find the face of each, the
        # corners are replaced by consecutive numbers, which no two faces share.
        sizes = [len(row) - 1 - len(values) for row, values in zip(rows, painted, strict=True)]
        ends = np.cumsum(sizes)
        owner = np.repeat(np.arange(len(rows)), np.diff(ends, prepend=0))
        numbered = [list(range(end - n, end)) for end, n in zip(ends, sizes, strict=True)]
        faces = owner[triangulate_quads(numbered)[:, 0]]
        part.visual.face_colors = np.array([_off_color(v) for v in painted], np.uint8)[faces]


def _off_color(values: Sequence[str]) -> tuple[int, ...]:
    """Return red, green and blue as bytes: an OFF has whole numbers to 255, or fractions to 1."""
    if len(values) < 3:
        return NEUTRAL_GREY
    full = 255 if any("." in value for value in values[:3]) else 1
    return tuple(min(255, max(0, round(float(value) * full))) for value in values[:3])


def _polygons(data: bytes) -> Any:
    """Return the mesh of a PLY that trimesh cannot read: of polygons, or with unusual names."""
    import trimesh

    read = read_ply(data, with_colors=True)
    return trimesh.Trimesh(
        read.points,
        read.faces,
        face_colors=read.face_colors,
        vertex_colors=read.colors if read.face_colors is None else None,
        process=False,
    )


def _in_double(file: BinaryIO) -> BinaryIO:
    """Return a PLY whose coordinates, if they are text, are not cut to float32 by trimesh."""
    if not re.match(rb"ply\s+format\s+ascii\b", file.read(100)):
        file.seek(0)
        return file
    file.seek(0)
    header, end, rows = file.read().partition(b"end_header")
    header = re.sub(rb"property\s+float(32)?\s+(?=[xyz]\s)", b"property double ", header)
    return io.BytesIO(header + end + rows)


# Names under which trimesh's materials have images.
_TEXTURES = (
    "image",
    "baseColorTexture",
    "emissiveTexture",
    "metallicRoughnessTexture",
    "normalTexture",
    "occlusionTexture",
)
# Numbers of an element of an accessor, by its type.
_GLTF_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


def _check_gltf(file: BinaryIO, kind: str) -> None:
    """Raise ValueError, KeyError or TypeError for a glTF that trimesh must not read.

    trimesh allocates memory for the sizes that buffer views, and accessors without a view, claim;
    and for a .gltf that is no JSON it reads another file, model.gltf.
    """
    tree = json.loads(_first_chunk(file) if kind == ".glb" else file.read())
    file.seek(0)
    views = sum(view["byteLength"] for view in tree.get("bufferViews", ()))
    empty = (a for a in tree.get("accessors", ()) if "bufferView" not in a)
    zeros = sum(a["count"] * _GLTF_COLUMNS[a["type"]] for a in empty)
    if not (0 <= views <= MOST_BYTES and 0 <= zeros <= _MOST_ZEROS):
        raise ValueError(f"buffer views of {views} bytes, {zeros} numbers without one")


def _first_chunk(file: BinaryIO) -> bytes:
    """Return the JSON of a GLB, its first chunk.

    Raises ValueError where a chunk reaches beyond the end of the file.
    """
    size = os.fstat(file.fileno()).st_size
    text, at = b"", 12
    while at + 8 <= size:
        file.seek(at)
        length = int.from_bytes(file.read(4), "little")
        if at + 8 + length > size:
            raise ValueError(f"a chunk of {length} bytes reaches beyond the end")
        if at == 12:
            file.seek(at + 8)
            text = file.read(length)
        at += 8 + length
    return text


def _joined(parts: Sequence[Any]) -> tuple[Mesh, NDArray[np.float64]]:
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    vertices = np.concatenate([part.vertices for part in parts])
    faces = np.concatenate([part.faces + o for part, o in zip(parts, offsets, strict=True)])
    return Mesh(vertices, faces, np.concatenate([_face_colors(part) for part in parts])), vertices


def _face_colors(part: Any) -> NDArray[np.uint8]:
    """Return the colours uint8 [F, 3] of a trimesh part, neutral grey where the file has none."""
    from trimesh.visual.color import DEFAULT_COLOR
    from trimesh.visual.material import empty_material

    count = len(part.faces)
    grey = np.broadcast_to(np.array(NEUTRAL_GREY, np.uint8), (count, 3))
    visual = part.visual
    if visual.kind is None:
        return grey
    try:
        if visual.kind == "texture":
            colors = _texture_colors(visual, part.faces)
            # Colours that trimesh gives to a material without a colour, and to a missing material.
            stand_ins = DEFAULT_COLOR, empty_material().to_color(np.zeros((1, 2)))[0]
            if any((colors == stand_in).all() for stand_in in stand_ins):
                return grey
        else:
            colors = np.asarray(visual.face_colors)
    except Exception:  # where a texture is broken, the object is kept in grey
        return grey
    return colors[:, :3].astype(np.uint8) if colors.shape[:1] == (count,) else grey


def _texture_colors(visual: Any, faces: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Return RGBA [F, 4]: the texture in the middle of each face, else the material's colour."""
    colors = None
    if visual.uv is not None:
        colors = visual.material.to_color(visual.uv[faces].mean(axis=1))
    if colors is None:
        colors = visual.material.main_color
    return np.broadcast_to(colors, (len(faces), 4))
