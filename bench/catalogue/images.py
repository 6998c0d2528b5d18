"""Methods entered by images: a folder of images that were drawn of an export's clouds elsewhere.

    method.toml                          what the author states (`Claims`)
    CONDITION/CLASS/OBJECT/VIEW.png      an image: 00.png, 01.png, ... are the views of `views.csv`

Files come from strangers: their headers are checked before a run starts, and links may not lead out
of the folder. Nothing that the author states can be checked here but its form, so tables call the
times *claimed*. A run repeats the facts in its manifest: it can be read where the tree is not.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, fields
from functools import partial
from hashlib import sha256
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.catalogue.methods import IMAGES_PREFIX, Method
from data_prep.datasets.objects import SceneObject
from data_prep.failures import BadInput, StageFailure
from data_prep.files.checksums import file_sha256
from data_prep.files.safe_read import (
    files_in,
    folders_in,
    plain_text,
    read_text,
    reason_of,
    shown,
)
from data_prep.plugins import is_id
from data_prep.rendering.images import check_opaque_png, read_opaque_png, to_float
from data_prep.scene import CloudOrigin, Images, PointCloud, UInt8Images, View

if TYPE_CHECKING:  # it reads clouds of all formats, which tables need not
    from data_prep.datasets.exported import ExportedObject

CLAIMS = "method.toml"
ENTERED = "entered"  # in manifests: facts by method, and under TREE the folder of the images
TREE = "tree"
MOST_BYTES = 64 * 2**10  # of a file of facts
_MOST_S = 1e6  # of a claimed time: twelve days
MOST_NAMED = 3  # in a line about images that are not used
_CHECKSUM = re.compile("[0-9a-f]{64}")


@dataclass(frozen=True)
class Claims:
    """The facts about a method that was run elsewhere, as its author states them.

    name               id of the method in tables, kebab-case
    source             one line about what it does and where it comes from
    trained_on         the objects that a network has seen; "nothing" where it learns nothing
    hardware           the machine of the times
    prepare_s, draw_s  seconds for a cloud, and for one view of it
    licence            of the images
    export             checksum of the export whose clouds it drew
                       (`data_prep.datasets.exported.checksum_of`)
    version            version or commit of the method; "" for none. Another version is another
                       method on a leaderboard of runs
    """

    name: str
    source: str
    trained_on: str
    hardware: str
    prepare_s: float
    draw_s: float
    licence: str
    export: str
    version: str = ""

    @property
    def about(self) -> str:
        """Return the description for people, in one line."""
        return (
            f"{self.source}; entered by images, drawn elsewhere on {self.hardware}, its times are "
            f"claimed; licence of the images: {self.licence}"
        )


def read_claims(tree: Path, taken: Collection[str]) -> Claims:
    """Return the facts in the `method.toml` of a tree.

    Raises BadInput, naming the file, for one that is missing or no TOML, for a key that is missing
    or unknown, for a value of another form, and for a name that is `taken`.
    """
    path = tree / CLAIMS
    if not tree.is_dir():
        raise BadInput(f"{tree}: no such folder; give a tree of images with its {CLAIMS}")
    text = read_text(path, MOST_BYTES)
    try:
        stated = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: of a number of 5,000 digits
        raise BadInput(f"{path}: not TOML ({reason_of(error)}); correct it") from error
    claims = _checked_claims(stated, str(path))
    if claims.name in taken:
        raise BadInput(
            f"{path}: name {shown(claims.name)} is an id of this installation; give another name"
        )
    return claims


def _checked_claims(stated: Mapping[str, Any], where: str) -> Claims:
    known = {field.name: field for field in fields(Claims)}
    if others := [key for key in stated if key not in known]:
        raise BadInput(f"{where}: unknown key {shown(others[0])}; the keys are {', '.join(known)}")
    values: dict[str, Any] = {}
    for key, field in known.items():
        if key in stated:
            values[key] = _checked(key, stated[key], field.type == "float", where)
        elif field.default is MISSING:
            raise BadInput(f"{where}: no key {key}; add it, as docs/extending.md shows")
    if not is_id(values["name"]):
        raise BadInput(
            f"{where}: name {shown(values['name'])} is not kebab-case (a-z, 0-9 and single "
            "hyphens), and it names files; rename it"
        )
    if not _CHECKSUM.fullmatch(values["export"]):
        raise BadInput(
            f"{where}: export {shown(values['export'])} is no sha256; copy the identifier in the "
            "croissant.json of the export"
        )
    return Claims(**values)


def _checked(key: str, value: Any, is_number: bool, where: str) -> str | float:
    if is_number:
        whole_or_float = isinstance(value, (int, float)) and not isinstance(value, bool)
        if whole_or_float and 0 <= value <= _MOST_S:
            return float(value)
        raise BadInput(
            f"{where}: {key} {shown(repr(value))} is no number of seconds from 0 to {_MOST_S:g}; "
            "give one"
        )
    try:
        return plain_text(value)
    except ValueError as error:
        raise BadInput(f"{where}: {key} {error}; give a short text in one line") from None


def manifest_entry(trees: Mapping[str, tuple[Path, Claims]]) -> dict[str, Any]:
    """Return the entry of a manifest for methods entered by images; nothing without any."""
    facts = {
        name: {TREE: str(root)} | {key: fact for key, fact in asdict(claims).items() if fact != ""}
        for name, (root, claims) in trees.items()
    }
    return {ENTERED: facts} if facts else {}


def entered_claims(manifest: Mapping[str, Any], method_id: str) -> Claims | None:
    """Return the facts of a method entered by images, as a run's manifest has them.

    None for another method, and for an entry that is damaged.
    """
    stated = _entry(manifest, method_id)
    try:
        return _checked_claims({k: v for k, v in stated.items() if k != TREE}, ENTERED)
    except BadInput:
        return None


def address_of(manifest: Mapping[str, Any], method_id: str) -> str:
    """Return the text by which a method of a run is found: its id, or "images:" and its tree."""
    tree = _entry(manifest, method_id).get(TREE)
    return f"{IMAGES_PREFIX}{tree}" if isinstance(tree, str) else method_id


def _entry(manifest: Mapping[str, Any], method_id: str) -> Mapping[str, Any]:
    entered = manifest.get(ENTERED)
    stated = entered.get(method_id) if isinstance(entered, Mapping) else None
    return stated if isinstance(stated, Mapping) else {}


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

    def checksum(self, condition: str, obj: ExportedObject, count: int) -> str:
        """Return a checksum of the first `count` images of a cloud; missing ones count as such."""
        paths = self._images(condition, obj, count)
        sums = [(name, file_sha256(path)) for name, path in paths.items()]
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

        `export` is the checksum of the export that the dataset is, or None. Raises BadInput for a
        dataset that is no export, or another than that of the images; for a tree without an image
        for the run; for a link that leads out of the tree; and for a file of an image that is no
        opaque image of the benchmark's size. Missing images are no error: they become failures.
        """
        if export is None:
            raise BadInput(
                f"{self.address}: has images of an export, and {dataset} is none; give --dataset "
                "exported:PATH, the export that they were drawn from"
            )
        if export != self.claims.export:
            raise BadInput(
                f"{self.root / CLAIMS}: export {self.claims.export[:12]}... is not that of "
                f"{dataset} ({export[:12]}...): {self._difference(objects)}; draw those of this "
                "export"
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

    def _difference(self, objects: Iterable[ExportedObject]) -> str:
        """Say how the clouds that were drawn differ from those of an export."""
        views = {f"{obj.class_name}/{obj.object_id}": len(obj.images) for obj in objects}
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
        return "the images are of other clouds or views, of another --seed perhaps"

    def unused(self, objects: Iterable[SceneObject], conditions: Collection[str]) -> str:
        """Return a line about folders and arrays that a run with these objects does not read.

        It is empty where there are none. Images beyond the views of the run are not counted.
        """
        wanted = {_base(c, obj.class_name, obj.object_id) for obj in objects for c in conditions}
        above = {str(parent) for name in wanted for parent in PurePosixPath(name).parents}
        others = list(self._others("", wanted, above))
        if not others:
            return ""
        more = f" and {len(others) - MOST_NAMED} more" if len(others) > MOST_NAMED else ""
        named = ", ".join(map(shown, others[:MOST_NAMED]))
        return f"{self.claims.name}: the run has no use for {named}{more} in {self.root}"

    def _others(self, at: str, wanted: Collection[str], above: Collection[str]) -> Iterator[str]:
        """Yield the folders and arrays at a place that are not of these objects."""
        for path in (*folders_in(self.root / at), *files_in(self.root / at, (".npz",))):
            name = str(PurePosixPath(at) / path.name)
            if name in above and path.suffix != ".npz":
                yield from self._others(name, wanted, above)
            elif name not in wanted:
                yield name

    def _images(self, condition: str, obj: ExportedObject, count: int) -> dict[str, Path]:
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


def entered_method(folder: Path, taken: Collection[str]) -> Method:
    """Return the method whose images are in a folder; `taken` are ids that it must not have.

    Raises BadInput as `read_claims`. The images are in the keys of jobs, the identity is the
    version that the author states.
    """
    root = folder.absolute()
    claims = read_claims(root, taken)
    tree = ImageTree(root, claims)
    return Method(
        claims.name,
        load=partial(_load, tree),
        identity=partial(str, f"{claims.version or 'no version'}, entered by images"),
        version=1,
        source=claims.about,
        trained_on=claims.trained_on,
        images=tree,
    )


def _load(tree: ImageTree, device: str) -> ImageTree:
    del device
    return tree
