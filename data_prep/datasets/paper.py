"""The paper's own data: clouds, images and cameras, in the layout that the original code unpacks.

    <class>_exp.json, all_exp.json                                   splits
    shape_net_core_uniform_samples_2048/<synset>/<id>.ply            clouds of 2,048 points
    shapenet_release/renders/<synset>/<id>/render_<k>_128.png        images, k = 0..19, RGBA
    shapenet_release/renders/<synset>/<id>/view.txt                  cameras, line k of image k

Clouds are ShapeNetCore.v1 with +Z up, as Blender imports it (`orientations.PAPER`). An azimuth of 0
stands on the clouds' +X, the front, and grows anticlockwise as seen from above: x = cos a cos e,
y = sin a cos e, z = sin e, as in the rendering scripts of the time (Su et al. 2015), whose view
files have the same columns. This reading is not confirmed: `bench data inspect` counts the points
that fall on the objects in the images, for this reading of the angles and for the others.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_prep.clouds.orientations import PAPER
from data_prep.clouds.sampling import AZIMUTH_RANGE_DEG, ELEVATION_RANGE_DEG, random_subset
from data_prep.datasets.dataset import Dataset, differences, first_names
from data_prep.datasets.objects import SceneObject, Split, StoredCloud
from data_prep.datasets.synsets import class_names
from data_prep.failures import BadInput
from data_prep.files.checksums import fingerprint_of
from data_prep.files.clouds import MOST_BYTES, load_points
from data_prep.files.safe_read import (
    MIB,
    files_in,
    folders_in,
    is_regular_file,
    plain_name,
    plain_text,
    read_text,
    shown,
)
from data_prep.randomness import generator
from data_prep.rendering.camera import project
from data_prep.rendering.images import read_image
from data_prep.scene import CLOUD_SIZE, IMAGE_SIZE, Mesh, PointCloud, View

CLOUDS = Path("shape_net_core_uniform_samples_2048")
RENDERS = Path("shapenet_release/renders")
_SPLIT_SUFFIX = "_exp.json"
_ALL_CLASSES = f"all{_SPLIT_SUFFIX}"
IMAGES = 20
VIEWS = "view.txt"
RADIUS = 0.5  # the radius of the sphere that images show, in the units of the clouds
_MOST_VIEW_BYTES = 2**16  # the largest view.txt; the original's have 20 lines of two numbers
_MOST_SPLIT_BYTES = 64 * MIB  # the largest split file; the original's, of 43,783 objects, has 2 MiB
_MOST_COLUMNS = 16  # the most numbers in a line of view.txt
_SPLITS: Sequence[Split] = ("train", "test")


@dataclass(frozen=True)
class PaperObject(StoredCloud):
    """A cloud with 20 images and their cameras, without a mesh.

    An object is used as a whole: where the cloud, the cameras or a requested image is missing or
    damaged, it fails with that reason in all its views.
    """

    class_name: str
    object_id: str
    cloud_file: Path
    renders: Path

    def fingerprint(self) -> str:
        """Return a checksum of the cloud, the cameras and the images."""
        version = f"paper {PAPER.columns} {PAPER.signs}"
        return fingerprint_of(version, self.cloud_file, self._resources, MOST_BYTES)

    def load(self) -> Mesh:
        """Raise BadInput: the object has no mesh."""
        raise BadInput(
            f"{self.cloud_file}: a cloud with images has no mesh; take shapenet:PATH for meshes"
        )

    def cloud(self, rng: np.random.Generator, count: int = CLOUD_SIZE) -> PointCloud:
        """Return the 2,048 points in the order of the file, or a random subset of `count`.

        Raises BadInput, naming the file, for any other number of points and for values that are not
        finite.
        """
        points = load_points(self.cloud_file)
        if len(points) != CLOUD_SIZE:
            raise BadInput(
                f"{self.cloud_file}: {len(points)} points, expected {CLOUD_SIZE}; fetch it again"
            )
        if not np.isfinite(points).all():
            raise BadInput(f"{self.cloud_file}: points that are not finite; fetch it again")
        with np.errstate(over="ignore"):
            # Scaled by a fixed factor and not normalised: the images show the sphere of radius 0.5
            # from the distance 2, which looks like our sphere of radius 1 from the distance 4.
            ours = (PAPER.to_ours(points) / RADIUS).astype(np.float32)
        return random_subset(PointCloud(ours), count, rng)

    def views(self, count: int, rng: np.random.Generator) -> tuple[View, ...]:
        """Return the cameras of the first images, or views of the front if they cannot be read.

        Raises BadInput for more than there are images.
        """
        del rng
        if count > IMAGES:
            raise BadInput(
                f"--views {count}: an object of this dataset has {IMAGES} images; give at most "
                f"--views {IMAGES}"
            )
        try:
            return self.cameras(count)
        except BadInput:  # `truth` says why
            return (View(0.0, 0.0),) * count

    def cameras(self, count: int) -> tuple[View, ...]:
        """Return the first cameras of view.txt in our angles. Raises BadInput for too few lines."""
        path = self.renders / VIEWS
        views = read_views(path)
        if len(views) < count:
            raise BadInput(
                f"{path}: {len(views)} lines, and {count} images are wanted; fetch it again"
            )
        return tuple(  # the sign changes, as our azimuth grows clockwise
            View(math.remainder(-view.azimuth_deg, 360.0), view.elevation_deg)
            for view in views[:count]
        )

    def image_files(self) -> tuple[Path, ...]:
        """Return the paths of the images, which may not exist."""
        return tuple(self.renders / image_name(k) for k in range(IMAGES))

    def truth(self, views: Sequence[View]) -> NDArray[np.uint8]:
        """Return the first images. Raises BadInput where an image or a camera cannot be read."""
        if self.cameras(len(views)) != tuple(views):
            raise BadInput(f"{self.renders / VIEWS}: has changed since the run began; start again")
        return np.stack([read_image(path)[0] for path in self.image_files()[: len(views)]])

    def _resources(self) -> Iterator[Path]:
        for path in (self.renders / VIEWS, *self.image_files()):
            if is_regular_file(path):
                yield path


def image_name(number: int) -> str:
    """Return the name of the file of an image."""
    return f"render_{number}_128.png"


def is_paper(root: Path) -> bool:
    """Return whether a folder looks like the paper's data."""
    return (root / CLOUDS).is_dir() or (root / RENDERS).is_dir()


def paper_dataset(spec: str, root: Path) -> Dataset:
    """Return the objects that the split files of a folder name.

    A class that has a split file of its own takes that, the others all_exp.json. Classes have the
    names of the 13 of the paper, else the first name in the split file. An object that a split
    names and the disk does not have fails.

    Raises BadInput where there is no split file, or one cannot be read.
    """
    files = [path for path in files_in(root, (".json",)) if path.name.endswith(_SPLIT_SUFFIX)]
    files.sort(key=lambda path: path.name == _ALL_CLASSES)  # the files of single classes first
    if not files:
        raise BadInput(
            f"{root}: no split file here; expected chair{_SPLIT_SUFFIX} or {_ALL_CLASSES} beside "
            f"{CLOUDS}/ and {RENDERS.parent}/"
        )
    irregular: list[str] = []
    classes: dict[str, PaperClass] = {}
    for path in files:
        for synset, paper_class in read_split(path).items():
            if synset not in classes:
                classes[synset] = paper_class
            elif classes[synset].splits != paper_class.splits:
                irregular.append(f"{path.name}: another split of {synset}; not used")
    names = class_names({synset: paper_class.name for synset, paper_class in classes.items()})
    splits: dict[Split, list[SceneObject]] = {split: [] for split in _SPLITS}
    for synset, paper_class in sorted(classes.items(), key=lambda item: names[item[0]]):
        for split, ids in paper_class.splits.items():
            splits[split] += [
                PaperObject(
                    names[synset],
                    object_id,
                    root / CLOUDS / synset / f"{object_id}.ply",
                    root / RENDERS / synset / object_id,
                )
                for object_id in ids
            ]
        irregular += _differences(root, names[synset], synset, paper_class.splits)
    split_files = first_names([path.name for path in files])
    return Dataset(
        spec,
        tuple(sorted(names.values())),
        tuple(obj for split in _SPLITS for obj in splits[split]),
        splits={split: tuple(splits[split]) for split in _SPLITS},
        layout=f"the paper's clouds and images, split by {split_files}",
        orientation=PAPER.message + ", twice as large",
        irregular=tuple(irregular),
    )


def _differences(
    root: Path, class_name: str, synset: str, named: Mapping[Split, Sequence[str]]
) -> list[str]:
    """Return lines on the differences between the split of a class and its folders."""
    clouds, renders = root / CLOUDS / synset, root / RENDERS / synset
    cloud_ids = [p.stem for p in files_in(clouds, (".ply",))] if clouds.is_dir() else []
    image_ids = [p.name for p in folders_in(renders)] if renders.is_dir() else []
    return [
        *(f"{class_name}, clouds: {line}" for line in differences(named, cloud_ids)),
        *(f"{class_name}, images: {line}" for line in differences(named, image_ids)),
    ]


# --- cameras and splits, as roatienza/pc2pix@46795a46 (loader.py, shapenet.py) reads them ---------


@dataclass(frozen=True)
class PaperClass:
    """A class of a split file: its name, and the ids of its training and test split."""

    name: str
    splits: Mapping[Split, tuple[str, ...]]


def read_views(path: Path) -> tuple[View, ...]:
    """Return the cameras of `view.txt`: line k holds azimuth and elevation of image k in degrees.

    Further numbers of a line are ignored, as in the original. The angles are returned as they stand
    in the file. Raises BadInput, naming file, line
    and value, for anything but angles, for gaps, and for an empty file.
    """
    text = read_text(path, _MOST_VIEW_BYTES)
    views = []
    for number, line in enumerate(text.rstrip().splitlines(), 1):
        fields = line.split()
        if not 2 <= len(fields) <= _MOST_COLUMNS:
            raise BadInput(
                f"{path}: line {number} has {len(fields)} numbers, expected azimuth and elevation; "
                "a line per image"
            )
        try:
            azimuth, elevation, *_ = [_number(field) for field in fields]
            views.append(View(azimuth, elevation))
        except ValueError as error:
            raise BadInput(f"{path}: line {number}: {error}; give degrees") from None
    if not views:
        raise BadInput(f"{path}: no views; give azimuth and elevation, a line per image")
    return tuple(views)


def read_split(path: Path, most_bytes: int = _MOST_SPLIT_BYTES) -> dict[str, PaperClass]:
    """Return the classes of a split file such as `chair_exp.json`, by synset ("03001627").

    The file holds {synset: {"name": ..., "train": [id, ...], "test": [id, ...]}}. Ids become parts
    of paths, so only plain names are accepted: no path, no ".", no control characters. Raises
    BadInput, naming file, value and remedy, for any other form, for an object that is listed twice,
    and for a file without classes.
    """
    text = read_text(path, most_bytes)
    try:
        tree = json.loads(text, object_pairs_hook=_without_doubles)
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{path}: not JSON that can be read ({error}); fetch it again") from None
    try:
        if not isinstance(tree, dict) or not tree:
            raise ValueError("no classes")
        return {plain_name(synset): _paper_class(synset, entry) for synset, entry in tree.items()}
    except ValueError as error:
        raise BadInput(
            f"{path}: {error}; expected {{synset: {{name, train: [ids], test: [ids]}}}}"
        ) from None


def _number(field: str) -> float:
    try:
        if "_" in field or not field.isascii():  # Python's own, 1_000
            raise ValueError
        return float(field)
    except ValueError:
        raise ValueError(f"{shown(field)} is not a number") from None


def _paper_class(synset: str, entry: Any) -> PaperClass:
    if not isinstance(entry, dict) or not isinstance(entry.get("name"), str):
        raise ValueError(f"class {shown(synset)} has no name")
    splits: dict[Split, tuple[str, ...]] = {}
    for split in _SPLITS:
        ids = entry.get(split)
        if not isinstance(ids, list):
            raise ValueError(f"class {shown(synset)} has no list {split!r}")
        splits[split] = tuple(plain_name(value) for value in ids)
    twice = _first_double(splits["train"] + splits["test"])
    if twice is not None:
        raise ValueError(f"class {shown(synset)} lists {shown(twice)} twice")
    return PaperClass(plain_text(entry["name"]), splits)


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    twice = _first_double([name for name, _ in pairs])
    if twice is not None:
        raise ValueError(f"{shown(twice)} is there twice")
    return dict(pairs)


def _first_double(names: Sequence[str]) -> str | None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None


# --- what `bench data inspect` tells of the files -------------------------------------------------

_WHITE = 250  # the grey level, 0..255, below which a channel shows that a pixel is of the object
# Ways in which the azimuths of view.txt might be meant: the sign that they are multiplied by, and
# the degrees that are then added. The first one is taken here.
READINGS = ((1, 0), (1, 90), (1, 180), (1, 270), (-1, 0), (-1, 90), (-1, 180), (-1, 270))


def find_problems(obj: PaperObject) -> Iterator[tuple[str, str]]:
    """Yield each problem of the object's files, and the file or the number that has it.

    For example ("an image of mode RGB, not RGBA", "render_3_128.png").
    """
    try:
        obj.cloud(generator("examine"))
    except BadInput as error:
        yield "the cloud cannot be used", _without_path(error, str(obj.cloud_file))
    view_file = obj.renders / VIEWS
    try:
        views = read_views(view_file)
    except BadInput as error:
        yield "the cameras cannot be read", _without_path(error, str(view_file))
    else:
        if len(views) != IMAGES:
            yield f"{VIEWS} has not {IMAGES} lines", f"{len(views)} lines"
        low, high = AZIMUTH_RANGE_DEG
        least, most = ELEVATION_RANGE_DEG
        beyond = [
            view
            for view in views
            if not (low <= view.azimuth_deg <= high and least <= view.elevation_deg <= most)
        ]
        if beyond:
            yield "angles beyond 180 and 40 degrees", f"{len(beyond)} views"
    for path in obj.image_files():
        try:
            _, mode = read_image(path)
        except BadInput as error:
            yield "an image cannot be used", _without_path(error, str(path.parent) + "/")
        else:
            if mode != "RGBA":
                yield f"an image of mode {mode}, not RGBA", path.name


def agreement(obj: PaperObject) -> NDArray[np.float64]:
    """Return the share of points that fall on the object in its images, for each reading.

    The result has a value for each of READINGS, the mean over all views.

    Raises BadInput where the object cannot be used.
    """
    cloud, views = obj.cloud(generator("examine")), obj.cameras(IMAGES)
    on_object = np.asarray((obj.truth(views) < _WHITE).any(axis=3))
    return np.array([_share(cloud, views, on_object, *reading) for reading in READINGS])


def _share(
    cloud: PointCloud, views: Sequence[View], on_object: NDArray[np.bool_], sense: int, turn: int
) -> float:
    hits = []
    for view, mask in zip(views, on_object, strict=True):
        read = View(sense * view.azimuth_deg + turn, view.elevation_deg)
        pixels, _ = project(cloud.points, read)
        column, row = np.floor(np.clip(pixels, -1, IMAGE_SIZE)).astype(int).T
        inside = (column >= 0) & (column < IMAGE_SIZE) & (row >= 0) & (row < IMAGE_SIZE)
        hit = np.zeros(len(cloud), bool)
        hit[inside] = mask[row[inside], column[inside]]
        hits.append(hit.mean())
    return float(np.mean(hits))


def _without_path(error: BadInput, path: str) -> str:
    return str(error).removeprefix(path).removeprefix(": ")
