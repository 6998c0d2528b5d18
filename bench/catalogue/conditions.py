"""Conditions by their ids: those of the project, and those of other packages.

A package announces a condition by an entry point of the group `pc2pix_bench.conditions`, whose name
is the id. Workers find it by that id, as they find methods: nothing of the package is pickled.
"""

from __future__ import annotations

import pickle
import random
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from bench.catalogue.gone import unknown
from data_prep import plugins
from data_prep.clouds.conditions import CONDITIONS, Condition
from data_prep.failures import BadInput, MissingDependency, StageFailure
from data_prep.plugins import entry_point_names, load_entry_point

if TYPE_CHECKING:  # `bench list` answers at once
    import numpy as np

    from data_prep.scene import PointCloud

ALL = "all"  # every condition of this project, for `bench data export`
OUR_CONDITIONS = frozenset({ALL, *(condition.id for condition in CONDITIONS)})
MOST_POINTS = 100_000  # about 50 times the cloud of the protocol; methods take minutes beyond


@dataclass(frozen=True)
class PluginPerturbation:
    """The change of a condition of another package, found again by its id in each worker.

    Attributes
    ----------
    condition : str
        The id, by which a worker loads the perturbation.
    key : str
        Everything that the clouds depend on (`Condition.key`), for the key of finished work.
    """

    condition: str
    key: str

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return the perturbed cloud.

        Raises StageFailure for anything but a usable one, and MissingDependency where the package
        is not installed, or is another version than in the process that has planned the work.
        """
        try:
            return applied(_planned_condition(self), cloud, rng)
        except (MissingDependency, MemoryError):
            raise
        except BaseException as error:  # code of a package, which may call exit()
            reason = str(error).splitlines()[0] if str(error) else "no message"
            if not isinstance(error, UnusableCloud):
                reason = f"{type(error).__name__}: {reason}"
            raise StageFailure(f"condition {self.condition}", reason) from error


class UnusableCloud(Exception):
    """A perturbed cloud that no run takes; the message tells why."""


def applied(condition: Condition, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    """Return a cloud perturbed by a condition of another package, and checked.

    Raises an exception for a result that is no cloud, that has no point, too many or one that is
    not finite, and for a condition that changes its input or draws global random numbers.
    """
    import numpy as np

    from data_prep.scene import PointCloud

    before = cloud.points.copy()
    with _global_numbers_watched():
        result = condition.perturbation.apply(cloud, rng)
    if not isinstance(result, PointCloud):
        raise UnusableCloud(f"gives a {type(result).__name__}, expected a PointCloud")
    points = result.points  # PointCloud itself refuses other shapes, but a subclass may not
    if not isinstance(points, np.ndarray) or points.dtype != np.float32:
        kind = getattr(points, "dtype", type(points).__name__)
        raise UnusableCloud(f"gives points of type {kind}, expected float32")
    if points.ndim != 2 or points.shape[1] != 3:
        raise UnusableCloud(f"gives points of shape {list(points.shape)}, expected [N, 3]")
    if not 1 <= len(points) <= MOST_POINTS:
        raise UnusableCloud(f"gives {len(points):,} points, expected 1 to {MOST_POINTS:,}")
    if count := int((~np.isfinite(points)).any(axis=1).sum()):
        raise UnusableCloud(f"gives {count} points that are not finite")
    if not np.array_equal(before, cloud.points, equal_nan=True):
        raise UnusableCloud("changes the cloud that it is given; work on a copy")
    return result


@contextmanager
def _global_numbers_watched() -> Iterator[None]:
    """Raise UnusableCloud where the block draws from, or seeds, a global generator."""
    before = _global_states()
    yield
    if before != _global_states():
        raise UnusableCloud("uses global random numbers; take all randomness from `rng`")


def _global_states() -> bytes:
    """Return the states of the global generators of Python and NumPy."""
    import numpy as np

    return pickle.dumps((random.getstate(), np.random.get_state()))  # noqa: NPY002


@cache
def condition_ids() -> tuple[str, ...]:
    """Return the ids of the conditions that installed packages announce, sorted; load none."""
    return entry_point_names(plugins.CONDITIONS)


def find_condition(condition_id: str) -> Condition:
    """Return the condition with this id, of the project or of an installed package.

    Raises BadInput for an unknown id, naming the nearest, and where a package announces a condition
    that it does not have, or by an id that is refused.
    """
    for condition in CONDITIONS:
        if condition.id == condition_id:
            return condition
    if condition_id not in condition_ids():
        known = [*(condition.id for condition in CONDITIONS), *condition_ids()]
        raise unknown(condition_id, known, "condition")
    condition = load_condition(condition_id)
    try:
        change = PluginPerturbation(condition_id, condition.key)
    except (Exception, SystemExit) as error:  # of another package
        raise BadInput(
            f"condition '{condition_id}': its identity cannot be told ({type(error).__name__}: "
            f"{error}); fix or remove that package"
        ) from error
    return Condition(condition_id, change, condition.source)  # the key is part of the change


def known_condition(condition_id: str) -> Condition | None:
    """Return the condition with this id; None if its package is gone or broken."""
    try:
        return find_condition(condition_id)
    except BadInput:
        return None


@cache
def _planned_condition(change: PluginPerturbation) -> Condition:
    """Return the condition of planned work. Raises MissingDependency where it is another here."""
    name = change.condition
    if name not in condition_ids():
        raise MissingDependency(f"condition '{name}': its package is not installed here")
    condition = load_condition(name)
    if condition.key != change.key:
        raise MissingDependency(
            f"condition '{name}': is {condition.key} here, and {change.key} where the run was "
            "started; install the same version of its package"
        )
    return condition


@cache
def load_condition(condition_id: str) -> Condition:
    """Return a condition of another package as it is there, loaded once a process.

    Raises BadInput as `find_condition` does.
    """
    named = "data_prep.clouds.conditions.Condition"
    groups = (plugins.CONDITIONS,)
    return load_entry_point(groups, condition_id, "condition", Condition, named, OUR_CONDITIONS)
