"""Methods entered by images: a folder of images that were drawn of an export's clouds elsewhere.

    method.toml                          what the author states (`bench.catalogue.claims`)
    CONDITION/CLASS/OBJECT/VIEW.png      an image: 00.png, 01.png, ... are the views of `views.csv`
    CONDITION/CLASS/OBJECT.npz           or all of an object: `images`, uint8 [V, 128, 128, 3]

Files come from strangers: their headers are checked before a run starts, and links may not lead out
of the folder.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from pathlib import Path, PurePosixPath

import numpy as np

from bench.catalogue.claims import CLAIMS, PREFIX, Claims, read_claims
from bench.catalogue.method import Method
from data_prep.datasets.exported import ExportedObject
from data_prep.datasets.objects import SceneObject
from data_prep.failures import BadInput, StageFailure
from data_prep.files.checksums import file_sha256
from data_prep.files.safe_read import files_in, folders_in, shown
from data_prep.rendering.images import to_float
from data_prep.rendering.opaque_images import (
    check_image_array,
    check_opaque_png,
    read_image_array,
    read_opaque_png,
)
from data_prep.scene import CloudOrigin, Images, PointCloud, UInt8Images, View

MOST_NAMED = 3  # in a line about images that are not used
_ARRAY, _IMAGE = ".npz", ".png"


@dataclass(frozen=True)
class ImageTree:
    """A folder of images of the clouds of an export, and what its author states.

    Attributes
    ----------
    root : Path
        The folder, absolute.
    claims : Claims
    """

    root: Path
    claims: Claims

    @property
    def address(self) -> str:
        """Return the text by which a command finds the method."""
        return f"{PREFIX}{self.root}"

    def read(self, origin: CloudOrigin, views: Sequence[View]) -> UInt8Images:
        """Return the images of a cloud from these of its views, [V, 128, 128, 3].

        Raises StageFailure for the first that is missing, and BadInput for a file that cannot be
        used.
        """
        base = _base(origin.condition, origin.class_name, origin.object_id)
        number = {view: i for i, view in enumerate(origin.views)}
        numbers = [number[view] for view in views]
        if (array := self._inside(f"{base}{_ARRAY}")) is not None:
            return read_image_array(array, len(origin.views))[numbers]
        images = []
        for name in (_image(base, i) for i in numbers):
            path = self._inside(name)
            if path is None:
                raise StageFailure("images", f"no image at {name}")
            images.append(read_opaque_png(path))
        return np.stack(images)

    def checksum(self, condition: str, obj: ExportedObject, count: int) -> str:
        """Return a checksum of the first `count` images of a cloud; missing ones count as such."""
        base = _base(condition, obj.class_name, obj.object_id)
        names = [f"{base}{_ARRAY}", *_images(base, count)]
        paths = ((name, self._inside(name)) for name in names)
        sums = [(name, file_sha256(path)) for name, path in paths if path is not None]
        return sha256(repr(sums).encode()).hexdigest()

    def check(
        self,
        dataset: str,
        export: str | None,
        objects: Iterable[ExportedObject],
        conditions: Sequence[str],
        views: int,
    ) -> None:
        """Check that a run can use the tree; of images, the headers.

        Parameters
        ----------
        dataset : str
            The dataset of the run.
        export : str or None
            Checksum of the export that it is; None for another dataset.
        objects : iterable of ExportedObject
        conditions : sequence of str
        views : int
            Images of each object.

        Raises
        ------
        BadInput
            For a dataset that is no export, or another than that of the images; for a tree without
            an image for the run; for a link that leads out of the tree; and for a file of an image
            that is no opaque image of the benchmark's size. Missing images are no error: they
            become failures.
        """
        if export is None:
            raise BadInput(
                f"{self.address}: has images of an export, and {dataset} is none; score them by "
                "'bench run --dataset exported:PATH' of the export that they were drawn from"
            )
        if export != self.claims.export:
            raise BadInput(
                f"{self.root / CLAIMS}: export {self.claims.export[:12]}... is not that of "
                f"{dataset} ({export[:12]}...): the images are of other clouds or views; draw "
                "those of this export"
            )
        count = 0
        for obj in objects:
            for condition in conditions:
                count += self._check_object(condition, obj, views)
        if not count:
            raise BadInput(
                f"{self.root}: no image for this run: nothing at CONDITION/CLASS/OBJECT/VIEW.png "
                f"under {', '.join(conditions)}; write them there, as docs/entering.md shows"
            )

    def unused(self, objects: Iterable[SceneObject], conditions: Collection[str]) -> str:
        """Return a line about folders and arrays that a run with these objects does not read.

        It is empty where there are none. Images beyond the views of the run are not counted.
        """
        wanted = {_base("", obj.class_name, obj.object_id) for obj in objects}
        leading = {str(parent) for name in wanted for parent in PurePosixPath(name).parents}
        others: list[str] = []
        for folder in folders_in(self.root):
            if folder.name in conditions:
                others += self._others(folder, "", wanted, leading)
            else:
                others.append(folder.name)
        if not others:
            return ""
        more = f" and {len(others) - MOST_NAMED} more" if len(others) > MOST_NAMED else ""
        named = ", ".join(map(shown, others[:MOST_NAMED]))
        return f"{self.claims.name}: the run has no use for {named}{more} in {self.root}"

    def _others(
        self, condition: Path, at: str, wanted: Collection[str], leading: Collection[str]
    ) -> Iterator[str]:
        """Yield the folders and arrays below `at` of a condition that are not of these objects."""
        for path in (*folders_in(condition / at), *files_in(condition / at, (_ARRAY,))):
            name = str(PurePosixPath(at) / path.name)
            if name in leading and path.suffix != _ARRAY:
                yield from self._others(condition, name, wanted, leading)
            elif name.removesuffix(_ARRAY) not in wanted:
                yield f"{condition.name}/{name}"

    def _check_object(self, condition: str, obj: ExportedObject, views: int) -> int:
        """Check the files of a cloud, and return how many of its images are there."""
        base = _base(condition, obj.class_name, obj.object_id)
        array = self._inside(f"{base}{_ARRAY}")
        paths = [path for name in _images(base, views) if (path := self._inside(name))]
        if array is None:
            for path in paths:
                check_opaque_png(path)
            return len(paths)
        if paths:
            raise BadInput(
                f"{array}: {paths[0]} is there, too, and an object has one or the other; remove one"
            )
        check_image_array(array, len(obj.exported_views))
        return views

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
    return f"{base}/{view:02d}{_IMAGE}"


def _images(base: str, count: int) -> list[str]:
    return [_image(base, view) for view in range(count)]


@dataclass(frozen=True)
class ImageTreeRenderer:
    """A renderer that reads its images."""

    tree: ImageTree

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> CloudOrigin:
        """Return the place of a cloud in its run. Raises StageFailure for another cloud."""
        del rng
        if cloud.origin is None:
            raise StageFailure("images", "the cloud is not one of a run on an export")
        return cloud.origin

    def draw(
        self, state: CloudOrigin, views: Sequence[View], rng: np.random.Generator | None = None
    ) -> Images:
        """Return the images from these views, which are among those of the cloud."""
        del rng
        return to_float(self.tree.read(state, views))


def entered_method(folder: Path, taken: Collection[str]) -> Method:
    """Return the method whose images are in a folder; `taken` are ids that it must not have.

    Raises BadInput as `bench.catalogue.claims.read_claims`.
    """
    root = folder.absolute()
    tree = ImageTree(root, read_claims(root, taken))
    claims = tree.claims
    return Method(
        claims.name,
        load=partial(_load, tree),
        identity=partial(_identity, claims),
        version=1,
        source=claims.about,
        trained_on=claims.trained_on,
        images=tree,
    )


def _load(tree: ImageTree, device: str) -> ImageTreeRenderer:
    del device
    return ImageTreeRenderer(tree)


def _identity(claims: Claims) -> str:
    """Return the version that the author states; the images are in the keys of jobs."""
    return f"{claims.version or 'no version'}, entered by images"
