"""Meshes in Wavefront OBJ, with the colours of their materials.

No library is used. trimesh resolves indices that count backwards against the end of the file and
takes index 0 for the last vertex; it and meshio divide concave polygons by fans, and find materials
by one spelling of their names alone; pymeshlab ends the process on some files.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from data_prep.files.cloud_contents import NotACloud, colors_of
from data_prep.files.mesh_contents import (
    FaceColors,
    MeshContents,
    NotAMesh,
    corner_means,
    grey_faces,
)
from data_prep.files.mesh_materials import (
    Material,
    decoded,
    library_names,
    read_materials,
)
from data_prep.files.mesh_resources import MeshResources
from data_prep.files.polygons import triangles_of_polygons
from data_prep.files.safe_read import shown
from data_prep.files.text_numbers import numbers_in
from data_prep.files.textures import TextureReader, colors_at, from_below

_COMMENT = re.compile(r"(?:^|(?<=\s))#.*")  # 1.#IND of Windows is none
_ROW_OF_NUMBERS = re.compile(r"\s*(?:v|vt|vn|vp|f|fo|l|p)\s", re.IGNORECASE)
# Lines that may have a comment: in a name, as in "Material #25", a # is a part of it.
_MAY_HAVE_COMMENT = re.compile(rf"\s*#|{_ROW_OF_NUMBERS.pattern}", re.IGNORECASE)
_CORNER = re.compile(r"(-?[0-9]+)(?:/(-?[0-9]+)?(?:/-?[0-9]*)?)?")
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]+(?:[eE][+-]?[0-9]+)?")
_FREE_FORMS = ("curv", "curv2", "surf")  # keywords of curves and surfaces that are no polygons
_NO_PLACE = -1  # for a corner without a place in a texture
_BEYOND = -2  # for a corner whose place is not in the file


@dataclass
class _Lines:
    """The lines of a file by what they say, each with its number.

    vertices, places  the rows of `v` and `vt`
    faces             the rows of `f`: the number of the line, how many vertices and places stand
                      before it, and the text behind the keyword
    materials         for each `usemtl` the number of faces before it, and the name
    libraries         the texts behind `mtllib`
    free_forms        whether there are curves or surfaces that are no polygons
    """

    vertices: list[tuple[int, str]] = field(default_factory=list)
    places: list[tuple[int, str]] = field(default_factory=list)
    faces: list[tuple[int, int, int, str]] = field(default_factory=list)
    materials: list[tuple[int, str]] = field(default_factory=list)
    libraries: list[str] = field(default_factory=list)
    free_forms: bool = False


def read_obj(data: bytes, resources: MeshResources) -> MeshContents:
    """Return the faces of an OBJ in the order of the file.

    The colour of a face is that of its material's texture in its middle, else the mean of the
    colours of its vertices (six numbers in a row of `v`), else the diffuse colour of its material.

    Raises NotAMesh for a row that is no vertex or no face, and for an index of 0 or of a vertex
    that is not there.
    """
    lines = _sorted_lines(data)
    if not lines.vertices:
        raise NotAMesh("no line of it is a vertex (v x y z); it is no OBJ, or has no vertices")
    vertices, vertex_colors, notes = _vertices(lines.vertices)
    corners, places, lengths = _corners(lines.faces, len(vertices), len(lines.places))
    positions, polygons = triangles_of_polygons(vertices[corners], lengths)
    faces = corners[positions]
    colors = grey_faces(len(faces))
    if vertex_colors is not None:
        colors = corner_means(vertex_colors, faces)
    if lines.free_forms:
        notes.append("curves and surfaces that are no polygons are left out")
    if lines.materials and len(faces):
        middles = _middles(lines.places, places[positions])
        painted = _Paint(lines.libraries, resources)
        painted.paint(colors, vertex_colors is None, middles, _materials_of(lines, polygons))
        notes += painted.notes
        beyond = (places == _BEYOND).sum()
        if beyond:
            notes.append(f"{beyond} corners have places in a texture that are not there")
    return MeshContents(vertices, faces, colors, tuple(notes))


def _sorted_lines(data: bytes) -> _Lines:
    text = decoded(data).replace("\t", " ")
    lines = _Lines()
    for number, line in _joined_lines(text):
        keyword, _, rest = line.strip().partition(" ")
        keyword = keyword.lower()
        if keyword == "v":
            lines.vertices.append((number, rest))
        elif keyword in ("f", "fo"):  # `fo` is the name that old files have
            before = len(lines.vertices), len(lines.places)
            lines.faces.append((number, *before, rest))
        elif keyword == "vt":
            lines.places.append((number, rest))
        elif keyword == "usemtl":
            lines.materials.append((len(lines.faces), rest.strip()))
        elif keyword == "mtllib":
            lines.libraries.append(rest.strip())
        elif keyword in _FREE_FORMS:
            lines.free_forms = True
    return lines


def _joined_lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield the lines without comments, each with the number of its last part.

    A line that ends with a backslash goes on in the next one.
    """
    begun = ""
    # The last line may end with a backslash, too: an empty one behind it ends it.
    for number, line in enumerate((text + "\n").split("\n"), 1):
        if "#" in line and _MAY_HAVE_COMMENT.match(begun + line):
            line = _COMMENT.sub("", line)
        whole = begun + line
        if not whole.rstrip().endswith("\\"):
            yield number, whole
            begun = ""
            continue
        begun = whole.rstrip()[:-1]
        if _ROW_OF_NUMBERS.match(begun):  # the break parts two numbers; a name may be cut anywhere
            begun += " "


def _vertices(
    rows: Sequence[tuple[int, str]],
) -> tuple[NDArray[np.float64], NDArray[np.uint8] | None, list[str]]:
    """Return the vertices [V, 3], their colours [V, 3] if all of them have some, and notes."""
    widths = [len(row.split()) for _, row in rows]
    width = min(widths)
    if width < 3:
        number = rows[widths.index(width)][0]
        raise NotAMesh(
            f"line {number}: a vertex of {width} numbers, expected x, y and z; write the file again"
        )
    notes = []
    if width < 6 <= max(widths):
        notes.append("only some vertices have colours; these colours are left out")
    table = numbers_in(" ".join(row for _, row in rows)) if width == max(widths) else None
    if table is None or table.size != width * len(rows):
        width = 6 if width >= 6 else 3
        table = np.array(
            [[_number(field, number) for field in row.split()[:width]] for number, row in rows]
        )
    table = table.reshape(len(rows), width)
    if width < 6:
        return table[:, :3], None, notes
    try:
        return table[:, :3], colors_of(table[:, 3:6]), notes
    except NotACloud as problem:
        return table[:, :3], None, [*notes, f"drawn without colours of vertices: {problem}"]


def _number(text: str, line: int) -> float:
    """Return the number of a field; NaN for those that Windows writes so (1.#IND, 1.#QNAN)."""
    if ".#" in text:
        return float("nan")
    try:
        if "_" not in text:  # float() takes 1_000, which no program writes into files
            return float(text)
    except ValueError:
        pass
    if _DECIMAL_COMMA.fullmatch(text):
        raise NotAMesh(
            f"line {line}: {shown(text)} has a decimal comma; write numbers with a point"
        )
    raise NotAMesh(f"line {line}: {shown(text)} is no number; correct the line")


def _corners(
    rows: Sequence[tuple[int, int, int, str]], vertex_count: int, place_count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the vertex and the place in the texture of each corner, and the lengths of faces.

    The place is _NO_PLACE for a corner that has none, and _BEYOND for one that is not there.
    """
    at_once = _uniform_corners(rows)
    if at_once is not None:
        corners, places, lengths = at_once
        wrong = (corners < 0) | (corners >= vertex_count)
        if not wrong.any():
            places[places >= place_count] = _BEYOND
            return corners, places, lengths
    pairs: list[tuple[int, int]] = []
    for number, vertices_before, places_before, row in rows:
        for word in row.split():
            match = _CORNER.fullmatch(word)
            if match is None:
                raise NotAMesh(
                    f"line {number}: {shown(word)} is no corner of a face (v, v/vt, v//vn or "
                    "v/vt/vn); correct the line"
                )
            vertex, place = int(match[1]), int(match[2] or 0)
            index = vertex - 1 if vertex > 0 else vertices_before + vertex
            if vertex == 0 or not 0 <= index < vertex_count:
                raise _no_vertex(number, vertex, vertex_count)
            of_place = place - 1 if place > 0 else places_before + place
            if not 0 <= of_place < place_count:
                of_place = _BEYOND
            pairs.append((index, of_place if place else _NO_PLACE))
    table = np.array(pairs, np.int64).reshape(-1, 2)
    lengths = np.array([len(row.split()) for *_, row in rows], np.int64)
    return table[:, 0], table[:, 1], lengths


def _uniform_corners(
    rows: Sequence[tuple[int, int, int, str]],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]] | None:
    """Return what `_corners` does where all corners are written alike and none counts backwards.

    Return None for other rows. A large file is read so in a fifth of the time.
    """
    lengths = np.array([len(row.split()) for *_, row in rows], np.int64)
    count = int(lengths.sum())
    text = " ".join(" ".join(row for *_, row in rows).split()) + " "
    if not count or "-" in text or not text.isascii():
        return None
    if text.startswith("/") or " /" in text:  # a corner without a vertex
        return None
    # The marks behind the numbers of a corner, such as "/", "/" and " " for v/vt/vn, tell how it is
    # written; those of all corners have to agree.
    marks = np.frombuffer(text.encode(), np.uint8)
    marks = marks[(marks == ord("/")) | (marks == ord(" "))]
    of_corner = int(np.flatnonzero(marks == ord(" "))[0]) + 1  # marks of the first corner
    if len(marks) != count * of_corner:
        return None
    marks = marks.reshape(count, of_corner)
    if of_corner > 3 or (marks != marks[0]).any():
        return None
    numbers = numbers_in(text.replace("/", " "), np.int64)
    if numbers is None or numbers.size % count:
        return None
    numbers = numbers.reshape(count, -1) - 1
    has_place = of_corner > 1 and numbers.shape[1] > 1 and "//" not in text
    places = numbers[:, 1].copy() if has_place else np.full(count, _NO_PLACE)
    return numbers[:, 0], places, lengths


def _no_vertex(line: int, index: int, count: int) -> NotAMesh:
    if index == 0:
        return NotAMesh(
            f"line {line}: a face has index 0, and OBJ counts vertices from 1; add 1 to the "
            "indices of all faces, or write the file again"
        )
    return NotAMesh(
        f"line {line}: a face has vertex {index}, and there are {count}; the file is damaged or "
        "cut short, fetch it again"
    )


def _middles(
    rows: Sequence[tuple[int, str]], places: NDArray[np.int64]
) -> NDArray[np.float64] | None:
    """Return the place [F, 2] in the texture of the middle of each face; NaN for a face without.

    Return None where no face has a place.
    """
    known = (places >= 0).all(axis=1)
    if not known.any():
        return None
    table = np.full((len(rows), 2), np.nan)
    for row, (_, text) in enumerate(rows):
        with suppress(ValueError):  # a place that cannot be read leaves its faces without one
            fields = [float(value) for value in text.split()[:2]]
            table[row, : len(fields)] = fields
    middles = np.full((len(places), 2), np.nan)
    middles[known] = table[places[known]].mean(axis=1)
    return middles


def _materials_of(lines: _Lines, polygons: NDArray[np.int64]) -> dict[str, NDArray[np.int64]]:
    """Return the triangles of each material, by its name."""
    starts = np.array([start for start, _ in lines.materials])
    switch = np.searchsorted(starts, polygons, side="right") - 1  # -1 before the first usemtl
    triangles: dict[str, list[NDArray[np.int64]]] = {}
    order = np.argsort(switch, kind="stable")
    bounds = np.searchsorted(switch[order], np.arange(len(starts) + 1))
    for number, (_, name) in enumerate(lines.materials):
        triangles.setdefault(name, []).append(order[bounds[number] : bounds[number + 1]])
    return {name: np.concatenate(parts) for name, parts in triangles.items()}


class _Paint:
    """The materials of an OBJ, and notes on what was not found."""

    def __init__(self, libraries: Sequence[str], resources: MeshResources) -> None:
        self._materials: dict[str, Material] = {}
        self._textures = TextureReader(resources.read)
        self._notes: list[str] = []
        self._all_libraries_read = True
        read: set[str] = set()
        for text in libraries:
            for name in library_names(text, resources.find):
                if name in read:
                    continue
                read.add(name)
                data = resources.read(name)
                if data is None:
                    self._notes.append(f"the materials {shown(name)} are not there")
                    self._all_libraries_read = False
                else:
                    # Of two libraries with a material of one name the first counts.
                    self._materials = read_materials(data) | self._materials

    @property
    def notes(self) -> list[str]:
        """Return lines on what was not found or could not be read."""
        return self._notes + self._textures.notes

    def paint(
        self,
        colors: FaceColors,
        diffuse: bool,
        middles: NDArray[np.float64] | None,
        triangles: dict[str, NDArray[np.int64]],
    ) -> None:
        """Give faces the colours of their materials, in place.

        diffuse    whether diffuse colours count; textures always do
        middles    float64 [F, 2]: the places of faces in textures, NaN for none; None for no face
        triangles  the faces of each material
        """
        in_any_case = {name.casefold(): m for name, m in self._materials.items()}
        for name, rows in triangles.items():
            material = self._materials.get(name) or in_any_case.get(name.casefold())
            if material is None:
                if len(rows) and self._all_libraries_read:  # else the library has a note already
                    self._notes.append(f"the material {shown(name)} is in none of its libraries")
                continue
            if diffuse:
                if material.problem and len(rows):
                    self._notes.append(f"the material {shown(name)} {material.problem}")
                if material.diffuse is not None:
                    colors[rows] = material.diffuse
            if not material.texture or middles is None:
                continue
            pixels = self._textures.pixels(material.texture)
            rows = rows[np.isfinite(middles[rows]).all(axis=1)]
            if pixels is not None and len(rows):
                places = middles[rows] * material.scale + material.shift
                colors[rows] = colors_at(pixels, from_below(places))
