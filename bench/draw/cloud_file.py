"""A file of a cloud: how it is read, brought to the unit sphere, and thinned, with notes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from bench.draw.choice import Notes
from bench.draw.orientation_hints import looks_like_a_line, looks_lying
from data_prep.clouds.coarse_steps import note_on_steps
from data_prep.clouds.far_points import far_points, note_on_far
from data_prep.clouds.normalise import Placement, placed_points
from data_prep.clouds.orientations import upright
from data_prep.clouds.sampling import random_rows, sample_faces
from data_prep.failures import BadInput
from data_prep.files.cloud_contents import CloudContents
from data_prep.files.cloud_text import GUESSED
from data_prep.files.clouds import read_cloud
from data_prep.randomness import generator
from data_prep.scene import CLOUD_SIZE, PointCloud

_Z_UP = (".las", ".laz", ".e57")  # suffixes of the formats of surveys, in which z is the height
# Where each kind of file has its colours, for the message on a file without them.
_WHERE_COLOURS = (
    "a PLY has red, green and blue, a text six columns or r, g and b in its first line, an array "
    "[N, 6]; or draw without --colour file"
)
FileColours = Literal["auto", "file", "grey"]


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
        None keeps all.
    drop_invalid : bool
        Whether to leave out points that are not finite; else they are refused, unless `as_is`.
    drop_far : bool
        Whether to leave out points far from all others; else a note tells of them, unless `as_is`.
    colours : str
        "auto": the cloud has the colours of its points where the file has any; "file": a file
        without them is refused; "grey": they are not read.
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
    colours: FileColours = "auto"
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
        if contents.is_mesh:
            contents = self._on_surface(contents, notes)
        if self.colours == "file" and contents.colors is None:
            raise BadInput(f"{self.path}: no colours of its points; {_WHERE_COLOURS}")
        notes = [*_unused(contents), *notes]
        points = upright(contents.points, self.up, self.front)
        kept = np.arange(len(points))
        if self.drop_invalid:
            kept = np.flatnonzero(np.isfinite(points).all(axis=1))
        far, of_far = far_with_notes(points[kept], self.drop_far, "--drop-far")
        if self.drop_far or not self.as_is:
            notes += of_far
        if self.drop_far:
            kept = kept[~far]
        if self.most is not None:
            kept = kept[random_rows(len(kept), self.most)]
        cloud, place = self._scaled(points[kept])
        notes += self._notes_on_shape(cloud, has_far=bool(far.any()) and not self.drop_far)
        if contents.colors is not None:
            cloud = replace(cloud, colors=contents.colors[kept])
        named = tuple(f"{self.path}: {note}" for note in notes)
        return LoadedCloud(cloud, named, place)

    def _contents(self) -> tuple[CloudContents, list[str]]:
        """Return the contents of the file, and notes on them.

        Raises BadInput for a file that cannot be used. Columns that are taken for colours and are
        none are left out with a note, unless colours have to be read.
        """
        if self.colours == "grey":
            contents = read_cloud(self.path)
            return contents, list(contents.notes)
        try:
            contents = read_cloud(self.path, with_colors=True)
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

    def _notes_on_shape(self, cloud: PointCloud, has_far: bool) -> Iterator[str]:
        """Yield a note where columns or axes of the file seem to be mistaken for others.

        has_far  whether some points are far from the rest; the rest is then so small in the cloud
                 that its shape tells nothing
        """
        if not has_far and looks_like_a_line(cloud):
            yield "its points lie on a line; check which columns are x, y and z"
        if self.up_unknown and (self.path.suffix.lower() in _Z_UP or looks_lying(cloud)):
            yield "its z axis seems to point up; give --up z, or --up y if it does not"

    def _on_surface(self, contents: CloudContents, notes: list[str]) -> CloudContents:
        """Return points sampled on the surface of a mesh in place of its vertices; add a note."""
        faces = cast("NDArray[np.int64]", contents.faces)
        whole = np.isfinite(contents.points[faces]).all(axis=(1, 2))
        count, rng = self.most or CLOUD_SIZE, generator("render", "surface")
        try:
            points, face, shares = sample_faces(contents.points[faces[whole]], rng, count)
        except BadInput:  # the faces have no area; the vertices are drawn
            return contents
        face = np.flatnonzero(whole)[face]
        colors = None if contents.face_colors is None else contents.face_colors[face]
        if contents.colors is not None:
            mixed = np.einsum("ij,ijk->ik", shares, contents.colors[faces[face]].astype(float))
            colors = np.rint(mixed).astype(np.uint8)
        notes.append(
            f"a mesh of {len(faces)} triangles: {count} points of its surface are drawn, not its "
            f"{len(contents.points)} vertices; --points takes another number"
        )
        notes += filter(None, [note_on_steps(contents.points)])
        unused = tuple(part for part in contents.unused if not part.endswith("faces"))
        return CloudContents(points, unused, None, contents.has_colors, colors)

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

    cloud  the points, with their colours where these were asked for and the file has some
    notes  lines on what was left out or guessed
    place  where its unit sphere lies in the file, turned upright
    """

    cloud: PointCloud
    notes: Notes
    place: Placement


def _unused(contents: CloudContents) -> Iterator[str]:
    """Yield a note on each part of the contents that is not used."""
    for part in contents.unused:
        is_faces = part.endswith("faces")
        if contents.colors is not None and not is_faces:
            if part.endswith(GUESSED):  # colours that no line names are a guess, too
                yield f"{part}; its colours are a guess, too, which --colour grey leaves out"
            continue
        note = f"{part} are not used; only the coordinates of its points are"
        if is_faces:
            note += "; they make no surface of most of these"
        yield note
