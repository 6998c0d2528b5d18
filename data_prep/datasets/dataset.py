"""Datasets: objects by class and split, and the problems of their folders."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from data_prep.datasets.objects import SceneObject, Split
from data_prep.failures import BadInput

MOST_NAMED = 3  # the most names in a line of a report, which gives the number of the others


@dataclass(frozen=True)
class Dataset:
    """The objects of a source by class and split.

    Attributes
    ----------
    id : str
        Name on the command line, such as "folder:PATH".
    classes : tuple of str
        Names of the classes; empty where the source does not tell classes apart.
    finite : tuple of SceneObject or None
        All objects; None where `infinite` makes as many as are asked for.
    splits : mapping of str to tuple of SceneObject
        Objects of each split; empty where the source has no splits: then all objects are taken.
    measured : str
        The split that is taken by default.
    layout : str
        Layout of the source in words.
    orientation : str
        Axes of its objects and how they were turned, in words.
    irregular : tuple of str
        Lines on missing and odd parts of the source, none of which prevents its use.
    left_out : str
        A line on files that are not part of any object; empty where there are none.
    infinite : callable or None
        Function from class, split and index to an object.
    seed : int or None
        Seed of the run that clouds and views were exported from; None where a run decides.
    checksum : str or None
        Checksum of exported clouds and views; None where a run makes them.
    """

    id: str
    classes: tuple[str, ...]
    finite: tuple[SceneObject, ...] | None
    splits: Mapping[Split, tuple[SceneObject, ...]] = field(default_factory=dict)
    measured: Split = "test"
    layout: str = ""
    orientation: str = ""
    irregular: tuple[str, ...] = ()
    left_out: str = ""
    infinite: Callable[[str, Split, int], SceneObject] | None = None
    seed: int | None = None
    checksum: str | None = None

    def objects(
        self,
        class_name: str,
        limit: int | None,
        endless_limit: int,
        split: Split | None = None,
    ) -> tuple[SceneObject, ...]:
        """Return the first objects of a class, in a fixed order.

        class_name     one of `classes`. A source without classes returns all its objects for any
                       class.
        limit          number of objects; None for all, or `endless_limit` of an infinite source
        endless_limit  number of objects of an infinite source where `limit` is None
        split          split of the objects; None for `measured`. A source without splits ignores
                       it.

        Raises BadInput if the source does not have the class, or no object of it in the split.
        """
        split = split or self.measured
        if self.classes and class_name not in self.classes:
            raise BadInput(
                f"{self.id}: no class '{class_name}' (a sub-folder of that name); "
                f"found {', '.join(self.classes)}{self._remedy_of_class()}"
            )
        if self.infinite is not None:
            count = endless_limit if limit is None else limit
            return tuple(self.infinite(class_name, split, i) for i in range(count))
        pool = self.splits.get(split, ()) if self.splits else self.finite or ()
        matching = tuple(o for o in pool if not self.classes or o.class_name == class_name)
        if not matching:
            filled = ", ".join(name for name, objects in self.splits.items() if objects)
            raise BadInput(
                f"{self.id}: no {class_name} in the split '{split}'; there are objects in {filled}"
            )
        return matching[:limit]

    def _remedy_of_class(self) -> str:
        """Return a remedy where a folder has no sub-folder for the class; "" for other sources."""
        if not self.id.startswith("folder:"):
            return ""
        flat = f"{self.id.rstrip('/')}/{self.classes[0]}"  # it has no classes, so it fits any
        return f"; --suite own-meshes takes all of them, a suite of one class {flat}"


@dataclass(frozen=True)
class DatasetReader:
    """A kind of dataset that another package adds: `ID:PATH` on the command line.

    Attributes
    ----------
    id : str
        Kind of the dataset in kebab-case.
    read : callable
        Function from the name on the command line and its folder to a `Dataset`. It raises
        BadInput for a folder that it cannot use.
    about : str
        Description in one line.
    """

    id: str
    read: Callable[[str, Path], Dataset]
    about: str


@dataclass
class DatasetListing:
    """The objects that a reader collects class by class, and lines on what is odd about them.

    Where a source has a split list, the list decides. An object that it names, but that is not on
    the disk, becomes an object that fails, so that none is dropped without a word. An object that
    it does not name is left out.
    """

    objects: list[SceneObject] = field(default_factory=list)
    splits: dict[Split, list[SceneObject]] = field(default_factory=dict)
    irregular: list[str] = field(default_factory=list)

    def add_listed(
        self,
        class_name: str,
        on_disk: Mapping[str, SceneObject],
        named: Mapping[Split, Sequence[str]],
        absent: Callable[[str], SceneObject],
    ) -> None:
        """Add the objects of a class, and divide them by a split list.

        on_disk  the objects that are there, by id
        named    the ids that the list names, by split
        absent   the function that returns, for an id that is not on the disk, an object that fails
        """
        self.objects += on_disk.values()
        self.irregular += [f"{class_name}: {line}" for line in differences(named, list(on_disk))]
        for split, ids in named.items():
            self.splits.setdefault(split, []).extend(on_disk.get(i) or absent(i) for i in ids)

    def dataset(self, spec: str, layout: str, orientation: str) -> Dataset:
        """Return the dataset of all collected objects and of their classes."""
        return Dataset(
            spec,
            tuple(sorted({obj.class_name for obj in self.objects})),
            tuple(self.objects),
            splits={split: tuple(objects) for split, objects in self.splits.items()},
            layout=layout,
            orientation=orientation,
            irregular=tuple(self.irregular),
        )


def first_names(names: Sequence[str]) -> str:
    """Return the first names and the number of the others, for a line of a report."""
    text = ", ".join(names[:MOST_NAMED])
    more = len(names) - MOST_NAMED
    return f"{text} and {more} more" if more > 0 else text


def differences(named: Mapping[Split, Sequence[str]], on_disk: Sequence[str]) -> list[str]:
    """Return lines on the ids of a split list that are not on the disk, and on the reverse."""
    existing, lines = set(on_disk), []
    for split, ids in named.items():
        missing = [name for name in ids if name not in existing]
        if missing:
            count = f"{len(missing)} of the split '{split}'"
            lines.append(f"{count} are not there: {first_names(missing)}")
    extra = sorted(existing - {name for ids in named.values() for name in ids})
    if extra:
        lines.append(f"{len(extra)} are in no split and left out: {first_names(extra)}")
    return lines
