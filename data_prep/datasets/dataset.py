"""A dataset: objects by class and split, and what was found in its folder.

Where a source has a split list, the list decides what is measured: what it names and is not there
becomes an object that fails with "no such file", so that nothing is dropped in silence. What is
there and not named is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from warnings import warn

from data_prep.datasets.objects import SceneObject, Split
from data_prep.failures import BadInput

MOST_NAMED = 3  # in a line of a report


@dataclass(frozen=True)
class Dataset:
    """Objects by class. `classes` is empty where the source does not tell classes apart.

    finite       all objects; None: as many as one asks `infinite` for
    splits       the objects of each split; empty where the source has none: all are taken
    measured     the split that is taken where none is asked for
    layout       what the source looks like, in words
    orientation  how its objects stood, and what was done about it
    irregular    what is missing or odd, a line each; nothing of it keeps the dataset from its use
    seed         of the run that clouds and views were exported from; None where a run decides
    """

    id: str
    classes: tuple[str, ...]
    finite: tuple[SceneObject, ...] | None
    splits: Mapping[Split, tuple[SceneObject, ...]] = field(default_factory=dict)
    measured: Split = "test"
    layout: str = ""
    orientation: str = ""
    irregular: tuple[str, ...] = ()
    infinite: Callable[[str, Split, int], SceneObject] | None = None
    seed: int | None = None

    def objects(
        self,
        class_name: str,
        limit: int | None,
        endless_limit: int,
        split: Split | None = None,
    ) -> tuple[SceneObject, ...]:
        """The first `limit` objects of a class, in a fixed order.

        Without a limit: all there are, or `endless_limit` where the source has no end. A source
        without splits gives the same objects for each; one without classes gives all its objects
        for any class. Raises BadInput for a class that the source does not have, and for a split
        that has none of it.
        """
        split = split or self.measured
        if self.classes and class_name not in self.classes:
            raise BadInput(
                f"{self.id}: no class '{class_name}' (a sub-folder of that name); "
                f"found {', '.join(self.classes)}"
            )
        if self.infinite is not None:
            count = endless_limit if limit is None else limit
            return tuple(self.infinite(class_name, split, i) for i in range(count))
        pool = self.splits.get(split, ()) if self.splits else self.finite or ()
        found = tuple(o for o in pool if not self.classes or o.class_name == class_name)
        if not found:
            there = ", ".join(name for name, objects in self.splits.items() if objects)
            raise BadInput(
                f"{self.id}: no {class_name} in the split '{split}'; there are objects in {there}"
            )
        return found[:limit]


@dataclass(frozen=True)
class DatasetReader:
    """A kind of dataset that another package adds: `ID:PATH` on the command line.

    read   the dataset's name as it was given, and its folder: all that is in it. Raises BadInput
           for what it cannot use
    about  one line for people
    """

    id: str
    read: Callable[[str, Path], Dataset]
    about: str


@dataclass
class DatasetListing:
    """What a reader has found of a source, class by class, before it is a Dataset."""

    objects: list[SceneObject] = field(default_factory=list)
    splits: dict[Split, list[SceneObject]] = field(default_factory=dict)
    irregular: list[str] = field(default_factory=list)

    def add_listed(
        self,
        class_name: str,
        there: Mapping[str, SceneObject],
        named: Mapping[Split, Sequence[str]],
        absent: Callable[[str], SceneObject],
    ) -> None:
        """The objects of a class by their ids, and the ids that a list names for each split.

        An id that is named and not there becomes `absent` of it: an object that fails.
        """
        self.objects += there.values()
        self.irregular += [f"{class_name}: {line}" for line in differences(named, list(there))]
        for split, ids in named.items():
            self.splits.setdefault(split, []).extend(there.get(i) or absent(i) for i in ids)

    def dataset(self, spec: str, layout: str, orientation: str) -> Dataset:
        """All of it; the classes are those of the objects."""
        return Dataset(
            spec,
            tuple(sorted({obj.class_name for obj in self.objects})),
            tuple(self.objects),
            splits={split: tuple(found) for split, found in self.splits.items()},
            layout=layout,
            orientation=orientation,
            irregular=tuple(self.irregular),
        )


def listed(names: Sequence[str]) -> str:
    """Some names, for a line of a report."""
    more = len(names) - MOST_NAMED
    return ", ".join(names[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")


def differences(named: Mapping[Split, Sequence[str]], there: Sequence[str]) -> list[str]:
    """What list and disk do not agree on, a line each: `named` are the ids of each split."""
    on_disk, lines = set(there), []
    for split, ids in named.items():
        missing = [name for name in ids if name not in on_disk]
        if missing:
            lines.append(f"{len(missing)} of the split '{split}' are not there: {listed(missing)}")
    every = {name for ids in named.values() for name in ids}
    extra = sorted(on_disk - every)
    if extra:
        lines.append(f"{len(extra)} are in no split and left out: {listed(extra)}")
    return lines


def __getattr__(name: str) -> type[DatasetListing]:
    """Return `DatasetListing` under its old name, with a DeprecationWarning."""
    if name != "Found":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    warn(
        f"{__name__}.Found is now DatasetListing; the old name goes with the next version",
        DeprecationWarning,
        2,
    )
    return DatasetListing
