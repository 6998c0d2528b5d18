"""Conditions: of the project and of other packages, their names in words, and their families.

A family is one property of a cloud that is varied step by step. What networks were trained on
stands beside it, so that figures and tables can say where they are beyond it.

A package announces a condition by an entry point of the group `pc2pix_bench.conditions`, whose name
is the id. Workers find it by that id, as they find methods: nothing of the package is pickled.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from data_prep.clouds.conditions import (
    CONDITIONS,
    Condition,
    GaussianNoise,
    Missing,
    Outliers,
    Stride,
    Unchanged,
    UnevenDensity,
)
from data_prep.failures import BadInput, MissingDependency, StageFailure, unknown
from data_prep.plugins import announced, load_entry_point

if TYPE_CHECKING:  # `bench list` answers at once
    import numpy as np

    from data_prep.scene import PointCloud

ALL = "all"  # every condition of this project, for `bench data export`
OUR_CONDITIONS = frozenset({ALL, *(condition.id for condition in CONDITIONS)})
GAP = 0.6  # of a step of an axis, between kinds of conditions
MOST_POINTS = 100_000  # about 50 times the cloud of the protocol; methods take minutes beyond


@dataclass(frozen=True)
class PluginPerturbation:
    """The change of a condition of another package, found again by its id in each worker.

    condition  the id, by which a worker loads the perturbation
    key        all that the clouds depend on (`Condition.key`), for the key of finished work
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
    not finite, and for a condition that changes its input.
    """
    import numpy as np

    from data_prep.scene import PointCloud

    before = cloud.points.copy()
    result = condition.perturbation.apply(cloud, rng)
    if not isinstance(result, PointCloud):
        raise UnusableCloud(f"gives a {type(result).__name__}, expected a PointCloud")
    points = result.points  # PointCloud itself refuses other shapes, but a subclass may not
    shape, kind = np.shape(points), getattr(points, "dtype", type(points).__name__)
    if not isinstance(points, np.ndarray) or kind != np.float32 or shape[1:] != (3,):
        raise UnusableCloud(f"gives points of type {kind} {list(shape)}, expected float32 [N, 3]")
    if not 1 <= len(points) <= MOST_POINTS:
        raise UnusableCloud(f"gives {len(points):,} points, expected 1 to {MOST_POINTS:,}")
    if count := int((~np.isfinite(points)).any(axis=1).sum()):
        raise UnusableCloud(f"gives {count} points that are not finite")
    if not np.array_equal(before, cloud.points, equal_nan=True):
        raise UnusableCloud("changes the cloud that it is given; work on a copy")
    return result


def find_condition(condition_id: str) -> Condition:
    """Return the condition with this id, of the project or of an installed package.

    Raises BadInput for an unknown id, naming the nearest, and where a package announces a condition
    that it does not have, or by an id that is refused.
    """
    for condition in CONDITIONS:
        if condition.id == condition_id:
            return condition
    if condition_id not in announced("condition"):
        known = [*(condition.id for condition in CONDITIONS), *announced("condition")]
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
    if name not in announced("condition"):
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
    return load_entry_point("condition", condition_id, Condition, named, OUR_CONDITIONS)


class _ConditionName(NamedTuple):
    """The names of a condition; conditions of one kind stand together on an axis.

    kind     the kind of the change; "" for a condition that is not known
    short    name beside others of its kind
    words    name that needs nothing beside it
    """

    kind: str
    short: str
    words: str

    @property
    def brief(self) -> str:
        """Return the name for a narrow column: "noise 5 %", "2,048"."""
        kind = self.kind if self.kind != "points" else ""
        return f"{kind} {self.short}".lstrip()


def condition_name(condition_id: str) -> _ConditionName:
    """Return the names of a condition; of one that is not known its id."""
    from data_prep.scene import CLOUD_SIZE  # `bench list` needs no NumPy

    match next((c.perturbation for c in CONDITIONS if c.id == condition_id), None):
        case Unchanged():
            name = ("points", f"{CLOUD_SIZE:,}", f"{CLOUD_SIZE:,} points")
        case Stride(step):
            count = f"{-(-CLOUD_SIZE // step):,}"
            name = ("points", count, f"{count} of {CLOUD_SIZE:,} points")
        case GaussianNoise(sigma):
            name = ("noise", _percent(sigma), f"noise {_percent(sigma)} of the radius")
        case Outliers(share):
            name = ("outliers", _percent(share), f"{_percent(share)} outliers")
        case Missing(share):
            name = ("missing", _percent(share), f"{_percent(share)} missing on one side")
        case UnevenDensity(ratio):
            words = f"{CLOUD_SIZE // 2:,} points, {ratio:g} times as dense at one end"
            name = ("density", f"{ratio:g} : 1", words)
        case _:
            name = ("", condition_id, condition_id)
    return _ConditionName(*name)


def _percent(share: float) -> str:
    return f"{100 * share:g} %"


def condition_words(condition_id: str) -> str:
    """Return a condition in words that need nothing beside them; the id of an unknown one."""
    return condition_name(condition_id).words


def places(conditions: Sequence[str]) -> list[float]:
    """Return places on an axis, a step apart, with a gap where another kind of change begins."""
    kinds = [condition_name(condition).kind for condition in conditions]
    at, gaps = [], 0.0
    for i, kind in enumerate(kinds):
        gaps += GAP * (i > 0 and kind != kinds[i - 1])
        at.append(i + gaps)
    return at


def listed(conditions: Iterable[str], every: Sequence[str]) -> str:
    """Return conditions in words: all of `every` but some, all of a kind, or one by one."""
    chosen = set(conditions)
    if chosen == set(every) and len(every) > 1:
        return "every condition"
    others = [condition for condition in every if condition not in chosen]
    if others and 4 * len(others) <= len(every):
        return f"every condition but {listed(others, every)}"
    by_kind: dict[str, list[str]] = {}
    for condition in every:
        by_kind.setdefault(condition_name(condition).kind, []).append(condition)
    parts = []
    for kind, of_kind in by_kind.items():
        if kind and len(of_kind) > 1 and chosen.issuperset(of_kind):
            parts.append("any number of points" if kind == "points" else f"any {kind}")
        else:
            parts += [condition_words(c) for c in of_kind if c in chosen]
    return ", ".join(parts)


@dataclass(frozen=True)
class Family:
    """Conditions along a numeric axis, in the order in which clouds get worse.

    axis         what is varied, with its unit
    steps        (value on the axis, condition), values rising or falling
    trained      by network, the least and the most that it was shown in training
    logarithmic  whether equal factors are equal steps
    """

    id: str
    axis: str
    steps: tuple[tuple[float, str], ...]
    trained: tuple[tuple[str, float, float], ...]
    logarithmic: bool = False

    @property
    def values(self) -> tuple[float, ...]:
        """Return the values on the axis."""
        return tuple(value for value, _ in self.steps)

    @property
    def conditions(self) -> tuple[str, ...]:
        """Return the conditions in the order of the axis."""
        return tuple(condition for _, condition in self.steps)

    def unseen_by(self, value: float) -> tuple[str, ...]:
        """Return the networks whose training had no cloud with this value on the axis."""
        return tuple(name for name, least, most in self.trained if not least <= value <= most)


# Of `splat-net@chair` the constants of learning/clouds.py; of `pc2pix` its bundled weights
# (pc2pix/weights/chair.md): it was shown at most 1,024 points, and of more it sees 1,024 at a time.
FAMILIES = (
    Family(
        "points",
        "points",
        ((2048, "2048"), (1024, "1024"), (512, "512"), (256, "256"), (128, "128")),
        trained=(("splat-net@chair", 512, 2048), ("pc2pix", 256, 2048)),
        logarithmic=True,
    ),
    Family(
        "noise",
        "noise: standard deviation, in radii of the unit sphere",
        (
            (0.0, "2048"),
            *((0.05, "noise-0.05"), (0.10, "noise-0.10")),
            *((0.15, "noise-0.15"), (0.20, "noise-0.20")),
        ),
        trained=(("splat-net@chair", 0.0, 0.12), ("pc2pix", 0.0, 0.10)),
    ),
    Family(
        "outliers",
        "outliers: share of the points",
        (
            (0.0, "2048"),
            *((0.01, "outliers-0.01"), (0.05, "outliers-0.05"), (0.10, "outliers-0.10")),
        ),
        trained=(("splat-net@chair", 0.0, 0.0), ("pc2pix", 0.0, 0.0)),
    ),
    Family(
        "missing",
        "missing on one side: share of the points",
        ((0.0, "2048"), (0.25, "missing-0.25"), (0.50, "missing-0.50")),
        trained=(("splat-net@chair", 0.0, 0.0), ("pc2pix", 0.0, 0.0)),
    ),
    Family(  # of 1,024 points all: beside them stands the stride
        "density",
        "density: densest end to sparsest, of 1,024 points",
        ((1.0, "1024"), (3.0, "density-3"), (10.0, "density-10")),
        trained=(("splat-net@chair", 1.0, 1.0), ("pc2pix", 1.0, 1.0)),
        logarithmic=True,
    ),
)


def families_of(conditions: Iterable[str]) -> tuple[Family, ...]:
    """Return the families with at least two of these conditions, reduced to them."""
    wanted = set(conditions)
    reduced = (
        replace(family, steps=tuple(step for step in family.steps if step[1] in wanted))
        for family in FAMILIES
    )
    return tuple(family for family in reduced if len(family.steps) > 1)
