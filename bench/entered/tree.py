"""A folder of images that were drawn of the clouds of an export elsewhere.

    method.toml                          what the author states (`bench.entered.claims`)
    CONDITION/CLASS/OBJECT/VIEW.png      an image: 00.png, 01.png, ... are the views of `views.csv`

Files come from strangers: their headers are checked before a run starts, and links may not lead out
of the folder.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path, PurePosixPath

import numpy as np

from bench.entered.claims import CLAIMS, IMAGES_PREFIX, Claims
from data_prep.datasets.objects import SceneObject
from data_prep.failures import BadInput, StageFailure
from data_prep.files.checksums import file_sha256
from data_prep.files.safe_read import files_in, folders_in, shown
from data_prep.rendering.images import check_opaque_png, read_opaque_png, to_float
from data_prep.scene import CloudOrigin, Images, PointCloud, UInt8Images, View

_MOST_NAMED = 3  # names in a line about images that are not used


@dataclass(frozen=True)
class ImageTree:
    """A folder of images of the clouds of an export, `root` (absolute), and its author's claims."""

    root: Path
    claims: Claims

    @property
    def address(self) -> str:
        """Return the text by which a command finds the method."""
        return f"{IMAGES_PREFIX}{self.root}"

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> CloudOrigin:
        """Return the place of a cloud in its run. Raises StageFailure for another cloud."""
        del rng
        if cloud.origin is None:
            raise StageFailure("images", "the cloud is not one of a run on an export")
        return cloud.origin

    def draw(
        self, state: CloudOrigin, views: Sequence[View], rng: np.random.Generator | None = None
    ) -> Images:
        """Return the images from these views, which are among those of the cloud.

        Raises StageFailure for the first that is missing, and BadInput for a file that cannot be
        used.
        """
        del rng
        base = _base(state.condition, state.class_name, state.object_id)
        number = {view: i for i, view in enumerate(state.views)}
        images: list[UInt8Images] = []
        for name in (_image(base, number[view]) for view in views):
            path = self._inside(name)
            if path is None:
                raise StageFailure("images", f"no image at {name}")
            images.append(read_opaque_png(path))
        return to_float(np.stack(images))

    def checksum(self, condition: str, obj: SceneObject, count: int) -> str:
        """Return a checksum of the first `count` images of a cloud; missing ones count as such."""
        paths = self._images(condition, obj, count)
        sums = [(name, file_sha256(path)) for name, path in paths.items()]
        return sha256(repr(sums).encode()).hexdigest()

    def check(
        self,
        dataset: str,
        export: str | None,
        objects: Iterable[SceneObject],
        conditions: Sequence[str],
        views: int,
    ) -> None:
        """Check that a run can use the tree; of images, the headers.

        `export` is the checksum of the export that the dataset is, or that its inputs would have;
        None where neither is known. Raises BadInput for None, and for another than that of the
        images; for a tree without an image for the run; for a link that leads out of the tree; and
        for a file of an image that is no opaque image of the benchmark's size. Missing images are
        no error: they become failures.
        """
        if export is None:
            raise BadInput(
                f"{self.address}: has images of an export, and {dataset} is none; give --dataset "
                "exported:PATH, the export that they were drawn from, or join them to a finished "
                "run by 'bench add', which compares its clouds and true images with the export"
            )
        if export != self.claims.export:
            raise BadInput(
                f"{self.root / CLAIMS}: export {self.claims.export[:12]}... is not that of "
                f"{dataset} ({export[:12]}...): {self._difference(objects, views)}; draw those of "
                "this export"
            )
        count = 0
        for obj in objects:
            for condition in conditions:
                for path in self._images(condition, obj, views).values():
                    check_opaque_png(path)
                    count += 1
        if not count:
            raise BadInput(
                f"{self.root}: no image for this run: nothing at CONDITION/CLASS/OBJECT/VIEW.png "
                f"under {', '.join(conditions)}; write them there, as docs/extending.md shows"
            )

    def _difference(self, objects: Iterable[SceneObject], count: int) -> str:
        """Say how the clouds that were drawn differ from those of a run with `count` views."""
        from data_prep.datasets.exported import ExportedObject

        views = {}
        for obj in objects:
            of_export = len(obj.images) if isinstance(obj, ExportedObject) else count
            views[f"{obj.class_name}/{obj.object_id}"] = of_export
        drawn = {
            f"{class_name.name}/{obj.name}": len(list(obj.glob("*.png")))
            for condition in folders_in(self.root)
            for class_name in folders_in(condition)
            for obj in folders_in(class_name)
        }
        for name in sorted(drawn.keys() - views.keys()):
            return f"the images are of other objects ({shown(name)} is none of the run)"
        for name, count in drawn.items():
            if count > views[name]:
                return f"{shown(name)} has {count} images, and {views[name]} views in the run"
        return "the images are of other clouds or views, perhaps of another --seed or protocol"

    def unused(self, objects: Iterable[SceneObject], conditions: Collection[str]) -> str:
        """Return a line about folders and arrays that a run with these objects does not read.

        It is empty where there are none. Images beyond the views of the run are not counted.
        """
        wanted = {_base(c, obj.class_name, obj.object_id) for obj in objects for c in conditions}
        above = {str(parent) for name in wanted for parent in PurePosixPath(name).parents}
        others = list(self._others("", wanted, above))
        if not others:
            return ""
        more = f" and {len(others) - _MOST_NAMED} more" if len(others) > _MOST_NAMED else ""
        named = ", ".join(map(shown, others[:_MOST_NAMED]))
        return f"{self.claims.name}: the run has no use for {named}{more} in {self.root}"

    def _others(self, at: str, wanted: Collection[str], above: Collection[str]) -> Iterator[str]:
        """Yield the folders and arrays at a place that are not of these objects."""
        for path in (*folders_in(self.root / at), *files_in(self.root / at, (".npz",))):
            name = str(PurePosixPath(at) / path.name)
            if name in above and path.suffix != ".npz":
                yield from self._others(name, wanted, above)
            elif name not in wanted:
                yield name

    def _images(self, condition: str, obj: SceneObject, count: int) -> dict[str, Path]:
        """Return those of the first `count` images of a cloud that are there, by their names."""
        base = _base(condition, obj.class_name, obj.object_id)
        paths = {name: self._inside(name) for name in (_image(base, i) for i in range(count))}
        return {name: path for name, path in paths.items() if path is not None}

    def _inside(self, name: str) -> Path | None:
        """Return the path of a file of the tree; None where there is none.

        Raises BadInput for a link that leads out of the tree.
        """
        path = self.root / name
        if not os.path.lexists(path):
            return None
        real = Path(os.path.realpath(path))
        if not real.is_relative_to(os.path.realpath(self.root)):
            raise BadInput(f"{path}: leads out of the tree, to {real}; copy the file into it")
        return path


def _base(condition: str, class_name: str, object_id: str) -> str:
    """Return the place of an object in a tree. Raises BadInput for one outside."""
    names = (condition, class_name, object_id)
    path = PurePosixPath(*names)
    if path.is_absolute() or ".." in path.parts:
        raise BadInput(f"{shown('/'.join(names))}: leads out of a tree; export it by another name")
    return str(path)


def _image(base: str, view: int) -> str:
    return f"{base}/{view:02d}.png"
