"""The contract of a dataset: its objects are the same whenever and wherever it is opened."""

from __future__ import annotations

import pickle
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bench.check.contract.findings import ContractViolation
from bench.check.contract.session import CheckStep, Passed
from bench.check.contract.targets import DatasetSource, find_target
from data_prep.datasets.dataset import Dataset
from data_prep.datasets.objects import SceneObject
from data_prep.randomness import generator
from data_prep.scene import IMAGE_SIZE

CLASSES = 3  # the number of classes whose objects are checked
OF_A_CLASS = 2  # the number of objects of each of these classes whose clouds and images are checked


@cache
def _dataset(name: str) -> Dataset:
    return _open(name)


def _open(name: str) -> Dataset:
    source = find_target(name)
    assert isinstance(source, DatasetSource)
    return source.open()


def _all_objects(dataset: Dataset) -> list[SceneObject]:
    """Return all objects of all splits, or a sample where the dataset has no end."""
    if dataset.finite is None:
        return _sample(dataset)
    return [*dataset.finite, *(obj for split in dataset.splits.values() for obj in split)]


def _sample(dataset: Dataset) -> list[SceneObject]:
    """Return the objects to check. Raises BadInput for a class without objects."""
    objects = []
    for class_name in (dataset.classes or ("",))[:CLASSES]:
        objects += dataset.objects(class_name, OF_A_CLASS, OF_A_CLASS)
    return objects


def _named(obj: SceneObject) -> str:
    return f"{obj.class_name}/{obj.object_id}"


def check_identity(name: str) -> Passed:
    """Open the dataset twice, and compare its objects."""
    first, again = _dataset(name), _open(name)
    if not isinstance(first, Dataset):
        raise ContractViolation(f"opening it gives a {type(first).__name__}, expected a Dataset")
    names = [[_named(obj) for obj in _all_objects(dataset)] for dataset in (first, again)]
    if names[0] != names[1]:
        raise ContractViolation(
            f"has {len(names[0])} objects, and {len(names[1])} or others when it is opened again; "
            "list the same objects in the same order each time"
        )
    return Passed(f"{len(_sample(first))} of {len(names[0])} objects looked at")


def use(name: str, number: int) -> NDArray[np.float32]:
    """Return the points of an object."""
    objects = _sample(_dataset(name))
    return objects[number % len(objects)].cloud(generator("contract", number)).points


def check_objects(name: str) -> Passed:
    """Check that names and fingerprints are unique and stay the same."""
    dataset = _dataset(name)
    objects = _sample(dataset)
    if not objects:
        raise ContractViolation("has no objects")
    for pool in (dataset.finite or (), *dataset.splits.values()):
        if len({_named(obj) for obj in pool}) < len(pool):
            raise ContractViolation("two objects have the same class and id")
    prints = [obj.fingerprint() for obj in objects]
    if prints != [obj.fingerprint() for obj in _sample(_open(name))]:
        raise ContractViolation(
            "objects have other fingerprints when it is opened again, so that a run could not use "
            "its finished jobs; make them from the contents alone"
        )
    if len(set(prints)) < len(prints):
        raise ContractViolation("two objects have the same fingerprint")
    return Passed("ids and fingerprints are unique and stay")


def check_pickling(name: str) -> Passed:
    """Pickle objects, as on the way to a worker."""
    for obj in _sample(_dataset(name)):
        twin = pickle.loads(pickle.dumps(obj))
        if twin != obj or twin.fingerprint() != obj.fingerprint():
            raise ContractViolation(
                f"{_named(obj)}: is another object after pickling; make its class a dataclass"
            )
    return Passed("objects survive the way to a worker")


def check_clouds(name: str) -> Passed:
    """Check that each cloud has finite points, and fills the unit sphere."""
    farthest = 0.0
    for obj in _sample(_dataset(name)):
        cloud = obj.cloud(generator("contract", obj.object_id))
        if not len(cloud):
            raise ContractViolation(f"{_named(obj)}: its cloud has no points")
        if not np.isfinite(cloud.points).all():
            raise ContractViolation(f"{_named(obj)}: its cloud has points that are not finite")
        farthest = max(farthest, float(np.linalg.norm(cloud.points, axis=1).max()))
    if not 0.2 < farthest < 1.001:
        raise ContractViolation(
            f"the farthest point lies at {farthest:.3g}; bring objects to the unit sphere"
        )
    return Passed(f"finite, the farthest point at {farthest:.3f}")


def check_views(name: str) -> Passed:
    """Draw three views twice, and compare them."""
    for obj in _sample(_dataset(name)):
        views, again = (obj.views(3, generator("contract", obj.object_id)) for _ in range(2))
        if len(views) != 3 or views != again:
            raise ContractViolation(
                f"{_named(obj)}: {len(views)} of 3 views, or others the second time; take all "
                "randomness from `rng`"
            )
    return Passed("as many as asked for, the same each time")


def _check_truth(name: str) -> Passed:
    """Check the true images of each object."""
    objects, images = _sample(_dataset(name)), []
    for obj in objects:
        if not obj.has_truth:
            continue
        truth = np.asarray(obj.truth(obj.views(2, generator("contract", obj.object_id))))
        if truth.dtype != np.uint8 or truth.shape != (2, IMAGE_SIZE, IMAGE_SIZE, 3):
            raise ContractViolation(
                f"{_named(obj)}: {truth.dtype} {list(truth.shape)}, expected uint8 "
                f"[2, {IMAGE_SIZE}, {IMAGE_SIZE}, 3]"
            )
        if (truth == 255).all():
            raise ContractViolation(
                f"{_named(obj)}: its true images are white, as if it were not there"
            )
        images.append(truth)
    if any(np.array_equal(a, b) for a, b in pairwise(images)):
        raise ContractViolation("two objects have the same images")
    return Passed(f"{len(images)} of {len(objects)} objects have true images")


def _check_both(name: str) -> Passed:
    """Check that `cloud_and_truth` gives what `cloud` and `truth` give one by one."""
    objects = [obj for obj in _sample(_dataset(name)) if obj.has_truth]
    for obj in objects[:OF_A_CLASS]:
        views = obj.views(2, generator("contract", obj.object_id))
        cloud, truth = obj.cloud_and_truth(generator("contract"), views)
        if not np.array_equal(cloud.points, obj.cloud(generator("contract")).points):
            raise ContractViolation(f"{_named(obj)}: cloud_and_truth gives another cloud")
        if not np.array_equal(truth, obj.truth(views)):
            raise ContractViolation(f"{_named(obj)}: cloud_and_truth gives other images")
    return Passed("bit for bit what cloud and truth give")


FIRST = (
    CheckStep("objects", check_objects),
    CheckStep("pickling", check_pickling),
    CheckStep("clouds", check_clouds),
    CheckStep("views", check_views),
    CheckStep("truth", _check_truth),
    CheckStep("cloud and truth", _check_both),
)
