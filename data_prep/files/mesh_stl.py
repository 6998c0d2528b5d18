"""Meshes in STL, binary or text."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from data_prep.files.mesh_contents import FaceColors, MeshContents, NotAMesh, grey_faces
from data_prep.files.polygons import triangles_of_polygons
from data_prep.files.safe_read import shown
from data_prep.files.text_numbers import numbers_in

_HEADER_BYTES = 84  # 80 of any text, and the number of triangles
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_BEGIN = re.compile(r"outer\s+loop")
_BEGIN_BYTES = re.compile(rb"outer\s+loop", re.IGNORECASE)
_LOOP = re.compile(r"outer\s+loop(.*?)endloop", re.DOTALL)  # names of solids may be any words


def read_stl(data: bytes) -> MeshContents:
    """Return the triangles of an STL, each with corners of its own, in the order of the file.

    A binary file may have colours in the 16 bits behind each triangle, as Materialise Magics writes
    them with the word COLOR= in the header. A text may go without its last `endsolid`.

    Raises NotAMesh for a file that is cut short, or is neither a binary STL nor one of text.
    """
    claimed = int.from_bytes(data[80:_HEADER_BYTES], "little")
    size = _HEADER_BYTES + claimed * _FACET.itemsize
    # A binary file may begin with "solid", too, and then its size tells.
    begins_as_text = data.lstrip()[:5].lower() == b"solid" or b"facet" in data[:1000]
    if begins_as_text and len(data) != size:
        is_binary = b"\0" in data and not _BEGIN_BYTES.search(data)
        if not is_binary:
            return _read_text(data)
    if len(data) < size or len(data) < _HEADER_BYTES:
        raise NotAMesh(
            f"no STL of text, and as a binary one it would have {claimed} triangles, {size} bytes, "
            f"of which {len(data)} are there; it is damaged or cut short, fetch it again"
        )
    facets = np.frombuffer(data, _FACET, claimed, _HEADER_BYTES)
    vertices = facets["corners"].reshape(-1, 3).astype(np.float64)
    faces = np.arange(len(vertices), dtype=np.int64).reshape(-1, 3)
    more = len(data) - size
    notes = [f"{more} bytes behind the last triangle are left out"] if more else []
    colors = _colors(data[:80], facets["attribute"])
    if colors is None and (facets["attribute"] >> 15).any():
        notes.append(
            "its triangles may have colours that are not read: only those of Magics (COLOR=) are"
        )
    colors = grey_faces(len(faces)) if colors is None else colors
    return MeshContents(vertices, faces, colors, tuple(notes))


def _colors(header: bytes, attributes: NDArray[np.uint16]) -> FaceColors | None:
    """Return the colours of triangles by the rule of Materialise Magics; None where it has none.

    The header has the colour of the whole object; 15 bits of an attribute are red, green and blue
    of 5 bits each, from the lowest on, and the highest bit is 0 for a colour of the triangle's own.
    """
    start = header.find(b"COLOR=")
    if not 0 <= start <= len(header) - 10:
        return None
    of_object = np.frombuffer(header, np.uint8, 3, start + 6)
    channels = (attributes[:, None] >> np.array([0, 5, 10], np.uint16)) & 31
    of_face = (channels * 255 // 31).astype(np.uint8)
    return np.where((attributes >> 15 == 0)[:, None], of_face, of_object)


def _read_text(data: bytes) -> MeshContents:
    """Return the facets of a text. A loop of more than three vertices is divided into triangles."""
    text = data.lower().decode("latin-1")
    loops = _LOOP.findall(text)
    begun = len(_BEGIN.findall(text))
    if begun != len(loops):
        raise NotAMesh(
            f"{begun} loops begin and {len(loops)} end; it is damaged or cut short, fetch it again"
        )
    corners = [loop.split("vertex")[1:] for loop in loops]
    rows = [row for loop in corners for row in loop]
    lengths = np.array([len(loop) for loop in corners], np.int64)
    table = numbers_in(" ".join(rows))
    if table is None or table.size != 3 * len(rows) or any(len(row.split()) != 3 for row in rows):
        raise _no_numbers(rows)
    vertices = table.reshape(-1, 3)
    faces, _ = triangles_of_polygons(vertices, lengths)
    return MeshContents(vertices, faces, grey_faces(len(faces)))


def _no_numbers(rows: list[str]) -> NotAMesh:
    """Return the error on the first vertex that is not three numbers."""
    for index, row in enumerate(rows):
        text = " ".join(row.split())
        numbers = numbers_in(text)
        if numbers is None or numbers.size != 3:
            remedy = "write numbers with a point, not a comma" if "," in text else "correct it"
            return NotAMesh(f"vertex {index}: {shown(text)} is not three numbers; {remedy}")
    return NotAMesh("its vertices are not three numbers each; write the file again")
