"""What a dataset has to keep to."""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from bench.checking.contract.findings import Broken, Finding, tried
from data_prep.datasets import open_dataset
from data_prep.randomness import generator
from data_prep.scene import IMAGE_SIZE
from data_prep.scene_objects import SceneObject


def dataset_findings(spec: str, most: int = 6) -> Iterator[Finding]:
    """All findings about a dataset, by up to `most` of its objects.

    Raises BadInput where it cannot be read.
    """
    dataset = open_dataset(spec)
    classes = dataset.classes or ("",)
    objects = [obj for name in classes[:3] for obj in dataset.objects(name, 2, 2)][:most]
    yield Finding(bool(objects), "objects", f"{len(objects)} of {len(classes)} classes looked at")
    again = open_dataset(spec)
    same = [obj for name in classes[:3] for obj in again.objects(name, 2, 2)][:most]

    def identities() -> str:
        prints = [obj.fingerprint() for obj in objects]
        if prints != [obj.fingerprint() for obj in same]:
            raise Broken("other fingerprints when it is opened again; finished work would be lost")
        if len({(obj.class_name, obj.object_id) for obj in objects}) < len(objects):
            raise Broken("two objects have the same class and id")
        if len(set(prints)) < len(prints):
            raise Broken("two objects have the same fingerprint")
        return "ids and fingerprints are unique and stay"

    def travels() -> str:
        for obj in objects:
            twin = pickle.loads(pickle.dumps(obj))
            if twin != obj or twin.fingerprint() != obj.fingerprint():
                raise Broken(f"{obj.object_id}: another object after pickling; make it a dataclass")
        return "objects survive the way to a worker"

    yield tried("identity", identities)
    yield tried("pickling", travels)
    for name, check in {"clouds": _clouds, "views": _views, "truth": _truths}.items():
        yield tried(name, lambda check=check: check(objects))


def _named(obj: SceneObject) -> str:
    return f"{obj.class_name}/{obj.object_id}"


def _clouds(objects: Sequence[SceneObject]) -> str:
    farthest = 0.0
    for obj in objects:
        cloud, again = (obj.cloud(generator("contract", obj.object_id)) for _ in range(2))
        if not len(cloud) or not np.isfinite(cloud.points).all():
            raise Broken(f"{_named(obj)}: {len(cloud)} points, or not finite")
        if not np.array_equal(cloud.points, again.points):
            raise Broken(f"{_named(obj)}: another cloud the second time; use `rng` alone")
        farthest = max(farthest, float(np.linalg.norm(cloud.points, axis=1).max()))
    if not 0.2 < farthest < 1.001:
        raise Broken(f"the farthest point lies at {farthest:.3g}; bring objects to the unit sphere")
    return f"finite, the same each time, the farthest point at {farthest:.3f}"


def _views(objects: Sequence[SceneObject]) -> str:
    for obj in objects:
        views, again = (obj.views(3, generator("contract", obj.object_id)) for _ in range(2))
        if len(views) != 3 or views != again:
            raise Broken(f"{_named(obj)}: {len(views)} of 3 views, or others the second time")
    return "as many as asked for, the same each time"


def _truths(objects: Sequence[SceneObject]) -> str:
    shown = []
    for obj in objects:
        if not obj.has_truth:
            continue
        views = obj.views(2, generator("contract", obj.object_id))
        images = np.asarray(obj.truth(views))
        if images.dtype != np.uint8 or images.shape != (2, IMAGE_SIZE, IMAGE_SIZE, 3):
            raise Broken(f"{_named(obj)}: {images.dtype} {list(images.shape)}, expected uint8")
        if (images == 255).all():
            raise Broken(f"{_named(obj)}: white images; the object is not seen")
        shown.append(images)
    if any(np.array_equal(a, b) for a, b in pairwise(shown)):
        raise Broken("two objects have the same images")
    return f"{len(shown)} of {len(objects)} objects have true images"
