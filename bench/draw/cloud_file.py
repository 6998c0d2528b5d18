"""A file of a cloud or mesh: how it is read, brought to the unit sphere, thinned, with notes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.methods import find_method
from bench.draw.choice import Notes
from bench.draw.mesh_file import (
    MESH_SUFFIXES,
    mesh_itself,
    points_on_surface,
    read_surface,
    with_textures,
    with_values,
)
from bench.draw.orientation_hints import lies_on_a_map, looks_like_a_line, looks_lying
from bench.draw.value_colours import HEIGHT, ValueScale, column_of, no_column, scale_of
from data_prep.clouds.coarse_steps import note_on_steps
from data_prep.clouds.far_points import far_points, note_on_far
from data_prep.clouds.normalise import Placement, placed_points
from data_prep.clouds.orientations import OURS, Orientation, orientation_of
from data_prep.clouds.sampling import random_rows
from data_prep.failures import BadInput
from data_prep.files.cloud_contents import CloudContents, NoColumn
from data_prep.files.cloud_text import GUESSED
from data_prep.files.clouds import read_cloud
from data_prep.scene import CLOUD_SIZE, Mesh, PointCloud

_Z_UP = (".las", ".laz", ".e57")  # suffixes of the formats of surveys, in which z is the height
# Where each kind of file has its colours, for the message on a file without them.
_WHERE_COLOURS = (
    "a PLY has red, green and blue, a text six columns or r, g and b in its first line, an array "
    "[N, 6]; or draw without --colour file"
)


def check_count(name: str, count: int | None) -> None:
    """Raise BadInput for a number of things that is no whole number from 1, and not None."""
    whole = isinstance(count, int | np.integer) and not isinstance(count, bool)
    if count is not None and not (whole and count >= 1):
        raise BadInput(f"{name} {count!r}: must be a whole number from 1, or None")


@dataclass(frozen=True)
class CloudFile:
    """A file with points, and how they become a cloud.

    Attributes
    ----------
    path : Path
        The file; its suffix names the format.
    as_is : bool
        Whether to keep the units of the file (in float32); else points are brought to the unit
        sphere.
    up, front : str
        Axes of the file, see `data_prep.clouds.orientations.upright`.
    most : int or None
        Largest number of points; of more points, as many are chosen at random, the same each time.
        None keeps all. Of a mesh as many points of its surface are taken; of None 2,048.
    drop_invalid : bool
        Whether to leave out points that are not finite; else they are refused, unless `as_is`.
    drop_far : bool
        Whether to leave out points far from all others; else a note tells of them, unless `as_is`.
    colours : str
        "auto": the cloud has the colours of its points where the file has any; "file": a file
        without them is refused; "grey": they are not read. "height", along `up`, or the name of a
        column of the file: colours by these numbers, see `bench.draw.value_colours`.
    up_unknown : bool
        Whether `up` is a guess: then a note tells where the cloud looks as if z were up.

    Raises
    ------
    data_prep.failures.BadInput
        For a `most` that is no whole number from 1.
    """

    path: Path
    as_is: bool
    up: str = "y"
    front: str | None = None
    most: int | None = None
    drop_invalid: bool = False
    drop_far: bool = False
    colours: str = "auto"
    up_unknown: bool = False

    def __post_init__(self) -> None:
        check_count("most", self.most)

    def load(self) -> PointCloud:
        """Return the cloud.

        Raises
        ------
        data_prep.failures.BadInput
            For a file without a cloud, and for a cloud that cannot be brought to the unit sphere.
        """
        return self.load_all().cloud

    def load_with_notes(self) -> tuple[PointCloud, Notes]:
        """Return the cloud as `load` does, and a note on each part of the file that is left out."""
        loaded = self.load_all()
        return loaded.cloud, loaded.notes

    def load_all(self) -> LoadedCloud:
        """Return the cloud as `load` does, and notes on the file."""
        contents, notes = self._contents()
        notes += self._notes_on_invalid(contents)
        orientation = orientation_of(self.up, self.front)
        if self.colours == HEIGHT:
            contents = replace(contents, values=orientation.to_ours(contents.points)[:, 1])
        stored, mesh, mesh_place, of_mesh = contents, None, None, [*notes]
        surface = None
        if contents.is_mesh:
            surface = points_on_surface(contents, self.most or CLOUD_SIZE)
        if surface is not None:
            contents, on_points = surface
            notes += on_points
        elif self.path.suffix.lower() in MESH_SUFFIXES:
            raise BadInput(f"{self.path}: no face has an area; a shape needs a surface")
        if self.colours == "file" and contents.colors is None:
            raise BadInput(f"{self.path}: no colours of its points; {_WHERE_COLOURS}")
        notes = [*_unused(contents, bool(column_of(self.colours))), *notes]
        points = orientation.to_ours(contents.points)
        kept, has_far, of_far = self._kept_rows(points)
        notes += of_far
        cloud, place = self._scaled(points[kept])
        on_shape = [*self._notes_on_shape(cloud, place, has_far and not self.drop_far)]
        colors = None if contents.colors is None else contents.colors[kept]
        if colors is not None and len(colors) and surface is None and not colors.any():
            notes.append(
                "all points are black, as where a scan has room for colours and none in it; "
                "--colour grey leaves them out"
            )
        if contents.values is not None:
            # The height has the range of all the mesh, whose tips the points may miss.
            whole = stored.values if surface is not None and self.colours == HEIGHT else None
            values = contents.values[kept]
            scale, on_values = self._scale(values if whole is None else whole, stored.columns)
            notes += on_values
            of_mesh += on_values
            colors, stored = scale.colors(values), with_values(stored, scale)
        if surface is not None:
            mesh, mesh_place, on_mesh = self._mesh_itself(stored)
            of_mesh += on_mesh
        return LoadedCloud(
            replace(cloud, colors=colors, source=mesh),
            tuple(f"{self.path}: {note}" for note in (*notes, *on_shape)),
            place,
            tuple(f"{self.path}: {note}" for note in (*of_mesh, *on_shape)),
            mesh_place,
            orientation,
        )

    def _kept_rows(self, points: NDArray[np.float64]) -> tuple[NDArray[np.int64], bool, Notes]:
        """Return the rows of upright points that are drawn, whether some are far, and notes."""
        kept = np.arange(len(points))
        if self.drop_invalid:
            kept = np.flatnonzero(np.isfinite(points).all(axis=1))
        far, notes = far_with_notes(points[kept], self.drop_far, "--drop-far")
        if self.drop_far:
            kept = kept[~far]
        if self.most is not None:
            kept = kept[random_rows(len(kept), self.most)]
        return kept, bool(far.any()), notes if self.drop_far or not self.as_is else ()

    def _scale(
        self, values: NDArray[np.float64], names: tuple[str, ...]
    ) -> tuple[ValueScale, Notes]:
        try:
            return scale_of(self.colours, values, names)
        except BadInput as error:
            raise BadInput(f"{self.path}: {error}") from error

    def _contents(self) -> tuple[CloudContents, list[str]]:
        """Return the contents of the file, and notes on them.

        Raises BadInput for a file that cannot be used. Columns that are taken for colours and are
        none are left out with a note, unless colours have to be read.
        """
        column = column_of(self.colours)
        if self.path.suffix.lower() in MESH_SUFFIXES:
            if column:
                raise BadInput(f"{self.path}: {no_column(column, ())}")
            contents = read_surface(self.path)
            if self.colours in ("grey", HEIGHT):
                contents = replace(contents, face_colors=None)
            return contents, list(contents.notes)
        if column:
            try:
                contents = read_cloud(self.path, column=column)
            except NoColumn as error:
                raise BadInput(f"{self.path}: {no_column(column, error.names)}") from None
            return contents, list(contents.notes)
        if self.colours in ("grey", HEIGHT):
            contents = read_cloud(self.path)
            return contents, list(contents.notes)
        try:
            contents = with_textures(read_cloud(self.path, with_colors=True), self.path)
            return contents, list(contents.notes)
        except BadInput as error:
            if self.colours == "file":
                raise
            contents = read_cloud(self.path)  # where it is not for its colours, this raises again
            reason = str(error).removeprefix(f"{self.path}: ")
            return contents, [*contents.notes, f"drawn without colours: {reason}"]

    def _notes_on_invalid(self, contents: CloudContents) -> Notes:
        """Return a note where points that are not finite are left out.

        Raises BadInput for such points unless they are left out (`drop_invalid`) or the cloud is
        kept as it is (`as_is`).
        """
        valid = np.asarray(np.isfinite(contents.points).all(axis=1))
        if valid.all():
            return ()
        count = f"{np.count_nonzero(~valid)} of {len(valid)} points"
        if self.drop_invalid:
            return (f"{count} are left out, they are not finite",)
        if self.as_is:
            return ()
        first, lines = int(np.flatnonzero(~valid)[0]), contents.lines
        where = f"is point {first + 1}" if lines is None else f"in line {lines[first]}"
        raise BadInput(
            f"{self.path}: {count} are not finite (the first {where}); remove them, or leave "
            "them out with --drop-invalid"
        )

    def _notes_on_shape(self, cloud: PointCloud, place: Placement, has_far: bool) -> Iterator[str]:
        """Yield a note where columns or axes of the file seem to be mistaken for others.

        place    where the unit sphere of the cloud lies in the file
        has_far  whether some points are far from the rest; the rest is then so small in the cloud
                 that its shape tells nothing
        """
        if not has_far and looks_like_a_line(cloud):
            yield "its points lie on a line; check which columns are x, y and z"
        if not self.up_unknown:
            return
        of_a_survey = self.path.suffix.lower() in _Z_UP
        if of_a_survey or lies_on_a_map(place) or looks_lying(cloud):
            yield "its z axis seems to point up; give --up z, or --up y if it does not"

    def _mesh_itself(self, contents: CloudContents) -> tuple[Mesh, Placement, Notes]:
        try:
            return mesh_itself(contents, self.up, self.front, self.as_is)
        except BadInput as error:
            raise BadInput(f"{self.path}: {error}") from error

    def _scaled(self, points: NDArray[np.float64]) -> tuple[PointCloud, Placement]:
        if self.as_is:
            with np.errstate(over="ignore"):  # numbers too large for float32 become infinite
                return PointCloud(points.astype(np.float32)), Placement(np.zeros(3), 1.0)
        try:
            return placed_points(points)
        except BadInput as error:
            raise BadInput(f"{self.path}: {error}") from error


def far_with_notes(
    points: NDArray[np.float64], drop: bool, option: str
) -> tuple[NDArray[np.bool_], Notes]:
    """Return which points are far from the rest, bool [N], with notes on them.

    A further note tells of coordinates that lie in coarse steps.

    drop    whether the caller leaves the far points out, which the note then says
    option  the option that leaves them out, which the note names where `drop` is False
    """
    far = far_points(points)
    notes = [note_on_steps(points[~far])]
    if far.any() and drop:
        count = f"{np.count_nonzero(far)} of {len(far)} points"
        notes.insert(0, f"{count} are left out, they lie far from the rest")
    elif far.any():
        notes.insert(0, f"{note_on_far(points, far)}; {option} leaves them out")
    return far, tuple(filter(None, notes))


@dataclass(frozen=True, eq=False)
class LoadedCloud:
    """A cloud that was read from a file.

    cloud        the points, with their colours where these were asked for and the file has some;
                 the `source` of points on a mesh is this mesh
    notes        lines on what was left out or guessed, where the points are drawn
    place        where their unit sphere lies in the file, turned upright
    mesh_notes   the notes where the mesh itself is drawn
    mesh_place   where the unit sphere of the mesh lies; None where there is no mesh
    orientation  the axes of the file
    """

    cloud: PointCloud
    notes: Notes
    place: Placement
    mesh_notes: Notes = ()
    mesh_place: Placement | None = None
    orientation: Orientation = OURS

    def place_for(self, method_id: str) -> Placement:
        """Return where the unit sphere lies of what a method draws, the points or the mesh."""
        if self.mesh_place is not None and find_method(method_id).sees_mesh:
            return self.mesh_place
        return self.place


def _unused(contents: CloudContents, by_column: bool) -> Iterator[str]:
    """Yield a note on each part of the contents that is not used.

    by_column  whether a column gives the colours: then it is none of what is not used
    """
    for part in contents.unused:
        is_faces = part.endswith("faces")
        if by_column and not is_faces:
            continue
        if contents.colors is not None and not is_faces:
            if part.endswith(GUESSED):  # colours that no line names are a guess, too
                yield f"{part}; its colours are a guess, too, which --colour grey leaves out"
            continue
        note = f"{part} are not used; only the coordinates of its points are"
        if is_faces:
            note += "; they make no surface of most of these"
        yield note
