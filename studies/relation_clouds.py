"""The clouds and views of the study `studies.metamorphic`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import count

from bench.catalogue.lookup import find
from data_prep.clouds.conditions import CONDITIONS
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.registry import Dataset
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.scene import PointCloud, View
from data_prep.shapes.catalogue import CLASSES

CONDITION_IDS = ("2048", "noise-0.05", "512")


@dataclass(frozen=True)
class CloudSpec:
    """A cloud of the study: an object of a dataset under a condition.

    dataset  kind of dataset, such as "folder", without its place on this machine
    """

    dataset: str
    object: SceneObject
    condition: str

    @property
    def key(self) -> tuple[str, str, str, str]:
        """Return dataset, class, object and condition."""
        return self.dataset, self.object.class_name, self.object.object_id, self.condition


def choose_clouds(datasets: Sequence[Dataset]) -> Iterator[CloudSpec]:
    """Yield the clouds of all datasets, one of each in turn while they have any.

    Raises BadInput for a dataset without any of the 13 classes.
    """
    remaining = [_clouds_of(dataset) for dataset in datasets]
    while remaining:
        for clouds in tuple(remaining):
            try:
                yield next(clouds)
            except StopIteration:
                remaining.remove(clouds)


def _clouds_of(dataset: Dataset) -> Iterator[CloudSpec]:
    """Yield the clouds of a dataset: the classes in turn, and the conditions in turn.

    Raises BadInput for a dataset without any of the 13 classes.
    """
    kind = dataset.id.partition(":")[0]
    known = [name for name in dataset.classes if name in CLASSES]
    if not known:
        raise BadInput(f"{dataset.id}: no class of {', '.join(CLASSES)}; name its sub-folders so")
    if dataset.infinite is not None:
        for i in count():
            index, of_class = divmod(i, len(known))
            shape = dataset.infinite(known[of_class], dataset.measured, index)
            yield CloudSpec(kind, shape, CONDITION_IDS[i % len(CONDITION_IDS)])
    classes = [dataset.objects(name, None, 0) for name in known]
    shapes = [
        of_class[i]
        for i in range(max(map(len, classes), default=0))
        for of_class in classes
        if i < len(of_class)
    ]
    for turn in range(len(CONDITION_IDS)):  # another condition for each object in each turn
        for i, shape in enumerate(shapes):
            yield CloudSpec(kind, shape, CONDITION_IDS[(i + turn) % len(CONDITION_IDS)])


@lru_cache(maxsize=1)
def cloud_and_view(spec: CloudSpec) -> tuple[PointCloud, View]:
    """Return the cloud and the view of a specification, the same for every method."""
    shape = spec.object
    cloud = shape.cloud(generator("metamorphic", "cloud", *spec.key[:3]))
    perturbation = find(spec.condition, CONDITIONS, "condition").perturbation
    cloud = perturbation.apply(cloud, generator("metamorphic", "condition", *spec.key))
    (view,) = shape.views(1, generator("metamorphic", "view", *spec.key))
    return cloud, view
