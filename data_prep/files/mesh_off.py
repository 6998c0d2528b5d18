"""Meshes in OFF, with the colours of their faces or vertices.

No library is used: trimesh and meshio expect one row a line, and trimesh leaves out the colours.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_prep.files.mesh_contents import (
    FaceColors,
    MeshContents,
    NotAMesh,
    corner_means,
    grey_faces,
)
from data_prep.files.mesh_materials import decoded
from data_prep.files.polygons import beyond_vertices, triangles_of_polygons
from data_prep.files.safe_read import shown
from data_prep.files.text_numbers import numbers_in
from data_prep.scene import NEUTRAL_GREY

# The word at the start: whether vertices have places in a texture, colours, normals, a fourth
# coordinate. It may be missing, and the counts may follow without a space, as in ModelNet.
_KIND = re.compile(r"\s*(ST)?(C)?(N)?(4)?n?OFF\s*", re.IGNORECASE)
_COMMENT = re.compile(r"#[^\r\n]*")


@dataclass(frozen=True)
class _Rows:
    """The rows of a file.

    vertices       float64 [V, 3]
    vertex_colors  uint8 [V, 3]; None for a file whose vertices have none
    corners        int64 [C]: the vertices of all faces, one after another
    lengths        int64 [P]: the number of corners of each face
    face_colors    uint8 [P, 3]; None for a file whose faces have none
    notes          lines on what was left out
    """

    vertices: NDArray[np.float64]
    vertex_colors: NDArray[np.uint8] | None
    corners: NDArray[np.int64]
    lengths: NDArray[np.int64]
    face_colors: NDArray[np.uint8] | None
    notes: tuple[str, ...] = ()


def read_off(data: bytes) -> MeshContents:
    """Return the faces of an OFF in the order of the file.

    Most programs write a row a line. Numbers that are divided into lines anyhow are read, too, but
    for colours, which could not be told from the next row then. Colours are whole numbers to 255,
    or fractions to 1; those of faces count before those of vertices.

    Raises NotAMesh for a file that is no OFF, whose counts do not agree with its numbers, or that
    has a vertex that is not there.
    """
    text = _COMMENT.sub("", decoded(data))
    kind = _KIND.match(text)
    if kind is None:
        raise NotAMesh("does not begin with OFF; write the file again")
    text = text[kind.end() :]
    if text.startswith("BINARY"):
        raise NotAMesh("a binary OFF, and only those of text are read; save it as text, or as PLY")
    if kind[4]:
        raise NotAMesh("an OFF of four coordinates; give one of three")
    before_colors = 6 if kind[3] else 3  # x, y and z, and a normal where N says so
    lines = [line for line in text.splitlines() if line.strip()]
    rows = _rows_of_lines(lines, before_colors, colored=bool(kind[2]))
    if rows is None:
        if kind[1] or kind[2]:
            raise NotAMesh(
                "its rows are not the vertices and faces that its counts say; write the file again"
            )
        rows = _rows_of_words(text.split(), before_colors)
    if problem := beyond_vertices(rows.corners, len(rows.vertices)):
        raise NotAMesh(problem)
    positions, polygons = triangles_of_polygons(rows.vertices[rows.corners], rows.lengths)
    faces = rows.corners[positions]
    colors = grey_faces(len(faces))
    if rows.vertex_colors is not None:
        colors = corner_means(rows.vertex_colors, faces)
    if rows.face_colors is not None:
        colors = rows.face_colors[polygons]
    return MeshContents(rows.vertices, faces, colors, rows.notes)


def _rows_of_lines(lines: Sequence[str], before_colors: int, colored: bool) -> _Rows | None:
    """Return the rows of a file that has one a line; None for any other file."""
    head = lines[0].split() if lines else []
    if not 2 <= len(head) <= 3 or not all(map(str.isdigit, head)):
        return None
    vertex_count, face_count = int(head[0]), int(head[1])
    last = 1 + vertex_count + face_count
    if len(lines) < last:
        return None
    of_vertices, of_faces = lines[1 : 1 + vertex_count], lines[1 + vertex_count : last]
    vertices = _vertices(of_vertices, before_colors)
    if vertices is None:
        return None
    faces = _faces(of_faces)
    if faces is None:
        return None
    corners, lengths, behind = faces
    of_colors = [line.split()[before_colors:] for line in of_vertices] if colored else []
    vertex_colors, notes = _colors_with_notes(of_colors, "vertices")
    face_colors, of_face_colors = _colors_with_notes(behind, "faces")
    notes += of_face_colors
    if of_vertices and not colored and len(of_vertices[0].split()) > before_colors:
        notes.append("further numbers of its vertices are not used, as its first word names none")
    if len(lines) > last:
        notes.append(f"{len(lines) - last} rows behind the last face are left out")
    return _Rows(vertices, vertex_colors, corners, lengths, face_colors, tuple(notes))


def _colors_with_notes(
    rows: Sequence[Sequence[str]], name: str
) -> tuple[FaceColors | None, list[str]]:
    """Return the colours [N, 3] of the words behind vertices or faces, and notes; None for none."""
    notes = []
    if any(0 < len(row) < 3 for row in rows):
        notes.append(f"colours of its {name} by their number in a list are left out")
    if not any(len(row) >= 3 for row in rows):
        return None, notes
    colors = _colors(rows)
    if colors is None:
        notes.append(f"the words behind its {name} are no colours, and are left out")
    return colors, notes


def _vertices(lines: Sequence[str], width: int) -> NDArray[np.float64] | None:
    """Return x, y and z of rows of at least `width` numbers; None where one has fewer."""
    widths = {len(line.split()) for line in lines}
    if not widths:
        return np.empty((0, 3))
    if min(widths) < width:
        return None
    if len(widths) == 1:
        table = numbers_in(" ".join(lines))
        if table is not None and table.size == len(lines) * min(widths):
            return table.reshape(len(lines), -1)[:, :3]
    return _table([line.split()[:3] for line in lines])


def _faces(
    lines: Sequence[str],
) -> tuple[NDArray[np.int64], NDArray[np.int64], list[list[str]]] | None:
    """Return the corners, the number of corners of each face, and the words behind these.

    Return None where a row has fewer corners than it says. The list of words is empty where no row
    has any.
    """
    flat = numbers_in(" ".join(lines), np.int64)
    four_each = all(len(line.split()) == 4 for line in lines)
    if flat is not None and flat.size == 4 * len(lines) and four_each and (flat[::4] == 3).all():
        return flat.reshape(-1, 4)[:, 1:].ravel(), np.full(len(lines), 3), []
    corners: list[int] = []
    lengths: list[int] = []
    behind: list[list[str]] = []
    for line in lines:
        words = line.split()
        try:
            row = [int(word) for word in words[: int(words[0]) + 1]]
        except ValueError:
            return None
        if len(row) != row[0] + 1:
            return None
        corners += row[1:]
        lengths.append(row[0])
        behind.append(words[row[0] + 1 :])
    return np.array(corners, np.int64), np.array(lengths, np.int64), behind


def _rows_of_words(words: Sequence[str], width: int) -> _Rows:
    """Return the rows of a file whose lines mean nothing, without colours."""
    at = 3
    try:
        vertex_count, face_count = int(words[0]), int(words[1])
        if vertex_count < 0 or face_count < 0 or vertex_count * width > len(words):
            raise IndexError
        numbers = words[at : at + vertex_count * width]
        rows = [numbers[i : i + 3] for i in range(0, len(numbers), width)]
        at += vertex_count * width
        corners: list[int] = []
        lengths: list[int] = []
        for _ in range(face_count):
            length = int(words[at])
            row = words[at + 1 : at + 1 + length]
            if length < 1 or len(row) < length:
                raise IndexError
            corners += map(int, row)
            lengths.append(length)
            at += 1 + length
    except (ValueError, IndexError):
        raise NotAMesh(
            f"its rows are not the vertices and faces that its counts {shown(' '.join(words[:3]))} "
            "say; it is damaged or cut short, fetch it again"
        ) from None
    more = len(words) - at
    notes = (f"{more} numbers behind the last face are left out",) if more else ()
    return _Rows(
        _table(rows), None, np.array(corners, np.int64), np.array(lengths, np.int64), None, notes
    )


def _table(rows: Sequence[Sequence[str]]) -> NDArray[np.float64]:
    """Return the numbers [N, 3] of rows. Raises NotAMesh for a word that is none."""
    table = np.empty((len(rows), 3))
    for index, row in enumerate(rows):
        try:
            table[index] = [float(word.replace("_", "x")) for word in row]  # no program's 1_000
        except ValueError:
            raise NotAMesh(
                f"vertex {index}: {shown(' '.join(row))} are no numbers such as -1234.5; correct "
                "the line"
            ) from None
    return table


def _colors(rows: Sequence[Sequence[str]]) -> FaceColors | None:
    """Return the colours [N, 3] of rows, neutral grey for a row without; None for other words.

    Numbers of a file are fractions to 1 where one of them has a point or none is above 1; else they
    are bytes.
    """
    numbers = np.full((len(rows), 3), np.nan)
    try:
        for index, row in enumerate(rows):
            if len(row) >= 3:
                numbers[index] = [float(word) for word in row[:3]]
    except ValueError:
        return None
    given = np.asarray(np.isfinite(numbers).all(axis=1))
    has_points = any("." in word for row in rows for word in row[:3])
    fractions = has_points or float(numbers[given].max(initial=0.0)) <= 1
    channels = np.clip(np.floor(numbers * (255 if fractions else 1) + 0.5), 0, 255)
    return np.where(given[:, None], channels, NEUTRAL_GREY).astype(np.uint8)
