"""Conditions of this project and of other packages: how they are found, named and grouped.

A condition is a change of the clouds that methods are given, such as fewer points or noise.
Conditions that vary one property of a cloud step by step are a *family*. A family also says which
values of this property the networks saw in training, so that figures and tables can mark where a
network draws clouds unlike those of its training.

Another package announces a condition by an entry point of the group `pc2pix_bench.conditions`,
whose name is the condition's id. Worker processes load it by this id, as they load methods, so that
no object of the package has to be pickled.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from data_prep.clouds.conditions import (
    Condition,
    GaussianNoise,
    Missing,
    MorePoints,
    Outliers,
    Stride,
    Unchanged,
    UnevenDensity,
)
from data_prep.failures import BadInput, MissingDependency, StageFailure, unknown
from data_prep.plugins import announced, load_entry_point
from data_prep.rendering.scanned import Scanned

if TYPE_CHECKING:  # NumPy is slow to import, and `bench list` does not need it
    import numpy as np

    from data_prep.clouds.conditions import Perturbation
    from data_prep.scene import PointCloud

CONDITIONS = (
    Condition("2048", Unchanged(), "paper, Tables 3 and 4"),
    Condition("1024", Stride(2), "paper, Tables 3 and 4; stride as in the original code"),
    Condition("512", Stride(4), "paper, Tables 3 and 4; stride as in the original code"),
    Condition("noise-0.05", GaussianNoise(0.05), "paper, Tables 3 and 4"),
    Condition("noise-0.10", GaussianNoise(0.10), "paper, Tables 3 and 4"),
    Condition("256", Stride(8), "ours: fewer points"),
    Condition("128", Stride(16), "ours: fewer points"),
    Condition("noise-0.15", GaussianNoise(0.15), "ours: more noise"),
    Condition("noise-0.20", GaussianNoise(0.20), "ours: more noise"),
    Condition("outliers-0.01", Outliers(0.01), "ours: points that mean nothing"),
    Condition("outliers-0.05", Outliers(0.05), "ours: points that mean nothing"),
    Condition("outliers-0.10", Outliers(0.10), "ours: points that mean nothing"),
    Condition("missing-0.25", Missing(0.25), "ours: an object seen in part"),
    Condition("missing-0.50", Missing(0.50), "ours: an object seen in part"),
    Condition("density-3", UnevenDensity(3), "ours: 1,024 points, dense on one side"),
    Condition("density-10", UnevenDensity(10), "ours: 1,024 points, dense on one side"),
    Condition("8192", MorePoints(8192), "ours: more points"),
    Condition("32768", MorePoints(32768), "ours: more points"),
    Condition("one-side", Scanned(1), "ours: a scan, 2,048 points that one camera sees"),
    Condition("three-views", Scanned(3), "ours: a scan, 2,048 points that three cameras see"),
)
ALL = "all"  # what `bench data export` takes for "every condition of this project"
# The ids that no condition of another package may have.
OUR_CONDITIONS = frozenset({ALL, *(condition.id for condition in CONDITIONS)})
GAP = 0.6  # space between two kinds of conditions on an axis, in steps of that axis
# The most points that a condition of another package may return: about 50 times the cloud of the
# protocol. With more, methods take minutes for a cloud.
MOST_POINTS = 100_000


@dataclass(frozen=True)
class PluginPerturbation:
    """The perturbation of a condition of another package, which each worker loads by its id.

    condition  the id of the condition
    key        `Condition.key`, a text with all that the perturbed clouds depend on. It is a part of
               the keys by which finished work is found again
    """

    condition: str
    key: str

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return the perturbed cloud.

        Raises StageFailure where the package raises an exception or returns no usable cloud, and
        MissingDependency where the package is not installed in this process, or is not of the
        version with which the work was planned.
        """
        try:
            return applied(_planned_condition(self), cloud, rng)
        except (MissingDependency, MemoryError):
            raise
        except BaseException as error:  # the package's code may raise anything, SystemExit too
            reason = str(error).splitlines()[0] if str(error) else "no message"
            if not isinstance(error, UnusableCloud):
                reason = f"{type(error).__name__}: {reason}"
            raise StageFailure(f"condition {self.condition}", reason) from error


def needs_mesh(perturbation: Perturbation) -> bool:
    """Return whether a perturbation samples the mesh behind a cloud anew."""
    return isinstance(perturbation, MorePoints | Scanned)


def stream_of(condition: str, perturbation: Perturbation) -> str:
    """Return the name of a condition's random numbers, which is its id in most cases.

    Conditions with more points share theirs, so that each has the points of the smaller ones. Scans
    share theirs, so that the first camera of several is the camera of one.
    """
    match perturbation:
        case MorePoints():
            return "more points"
        case Scanned():
            return "scan"
    return condition


class UnusableCloud(Exception):
    """The error for a perturbed cloud that a run cannot use; the message says why."""


def applied(condition: Condition, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    """Return a cloud as a condition of another package perturbs it, after checking the result.

    Raises UnusableCloud where the result is not a PointCloud, has no points, more than MOST_POINTS
    points or a point that is not finite, and where the condition changes the cloud that it was
    given. Exceptions of the package's own code are passed on.
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
    """Return the condition with this id, of this project or of an installed package.

    Raises BadInput for an unknown id, with the nearest known one in the message; for a package that
    announces a condition which it does not contain; and for an id that packages may not use.
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
    except (Exception, SystemExit) as error:  # the package's code may raise anything
        raise BadInput(
            f"condition '{condition_id}': the package that announces it cannot say by which key "
            f"its clouds are known ({type(error).__name__}: {error}); fix that package or remove it"
        ) from error
    return Condition(condition_id, change, condition.source)


def known_condition(condition_id: str) -> Condition | None:
    """Return the condition with this id; None where its package is not installed or is broken."""
    try:
        return find_condition(condition_id)
    except BadInput:
        return None


@cache
def _planned_condition(change: PluginPerturbation) -> Condition:
    """Return the condition that a worker needs for planned work.

    Raises MissingDependency where its package is not installed in this process, or has another
    version of the condition than the one with which the work was planned.
    """
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
    """Return the `Condition` object of another package; each process loads it once.

    Raises BadInput where `find_condition` does.
    """
    type_name = "data_prep.clouds.conditions.Condition"
    return load_entry_point("condition", condition_id, Condition, type_name, OUR_CONDITIONS)


class _ConditionName(NamedTuple):
    """The names of a condition in figures and tables.

    kind     the kind of change, such as "noise". Conditions of one kind stand together on an axis.
             "" for a condition that this project does not know
    short    the name where the kind is named already, such as "5 %"
    words    the name where nothing else is said, such as "noise 5 % of the radius"
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
    """Return the names of a condition; for one that this project does not know they are its id."""
    from data_prep.scene import CLOUD_SIZE  # here, for it imports NumPy: see TYPE_CHECKING above

    match next((c.perturbation for c in CONDITIONS if c.id == condition_id), None):
        case Unchanged():
            kind, short = "points", f"{CLOUD_SIZE:,}"
            words = f"{short} points"
        case Stride(step):
            kind, short = "points", f"{-(-CLOUD_SIZE // step):,}"  # the quotient rounded up
            words = f"{short} of {CLOUD_SIZE:,} points"
        case GaussianNoise(sigma):
            kind, short = "noise", _percent(sigma)
            words = f"noise {short} of the radius"
        case Outliers(share):
            kind, short = "outliers", _percent(share)
            words = f"{short} outliers"
        case Missing(share):
            kind, short = "missing", _percent(share)
            words = f"{short} missing on one side"
        case MorePoints(count):
            kind, short = "points", f"{count:,}"
            words = f"{short} points"
        case Scanned(cameras):
            kind, short = "scan", "from one side" if cameras == 1 else f"from {cameras} sides"
            words = f"seen {short}"
        case UnevenDensity(ratio):
            kind, short = "density", f"{ratio:g} : 1"
            words = f"{CLOUD_SIZE // 2:,} points, {ratio:g} times as dense at one end"
        case _:
            kind, short, words = "", condition_id, condition_id
    return _ConditionName(kind=kind, short=short, words=words)


def _percent(share: float) -> str:
    return f"{100 * share:g} %"


def condition_words(condition_id: str) -> str:
    """Return the name of a condition where nothing else is said, such as "5 % outliers".

    For a condition that this project does not know, it is the id.
    """
    return condition_name(condition_id).words


def axis_positions(conditions: Sequence[str]) -> list[float]:
    """Return the positions of conditions on an axis, in their order.

    The first is at 0 and each next one is a step of 1 further, with GAP more where its kind is
    another than that of the condition before it.
    """
    positions: list[float] = []
    gaps = 0.0
    kind_before = None
    for number, condition in enumerate(conditions):
        kind = condition_name(condition).kind
        if number > 0 and kind != kind_before:
            gaps += GAP
        positions.append(number + gaps)
        kind_before = kind
    return positions


def conditions_in_words(conditions: Iterable[str], every: Sequence[str]) -> str:
    """Return which of the conditions `every` are meant, as briefly as possible.

    Examples: "every condition", "every condition but 512 of 2,048 points" (where at most a quarter
    is left out), "any noise" (where a kind is complete), else their names one by one.
    """
    meant = set(conditions)
    if meant == set(every) and len(every) > 1:
        return "every condition"
    others = [condition for condition in every if condition not in meant]
    if others and 4 * len(others) <= len(every):
        return f"every condition but {conditions_in_words(others, every)}"
    by_kind: dict[str, list[str]] = {}
    for condition in every:
        by_kind.setdefault(condition_name(condition).kind, []).append(condition)
    parts = []
    for kind, of_kind in by_kind.items():
        if kind and len(of_kind) > 1 and meant.issuperset(of_kind):
            parts.append("any number of points" if kind == "points" else f"any {kind}")
            continue
        parts += [condition_words(condition) for condition in of_kind if condition in meant]
    return ", ".join(parts)


@dataclass(frozen=True)
class Family:
    """Conditions along a numeric axis, from clouds like those of trainings to others.

    axis         the property that is varied, with its unit, as the label of the axis
    steps        pairs of a value on the axis and the id of the condition with this value; the
                 values rise or fall all along
    trained      triples of a network, and the lowest and the highest value that its training
                 clouds had
    logarithmic  whether the axis is logarithmic
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
        return tuple(
            network for network, lowest, highest in self.trained if not lowest <= value <= highest
        )


# The ranges in `trained` come from these places: for `splat-net@chair` from the constants of
# learning/clouds.py, for `pc2pix` from the card of its bundled weights (pc2pix/weights/chair.md).
# Though pc2pix was trained on at most 1,024 points, its range of points ends at 2,048: of a larger
# cloud it sees 1,024 points at a time.
FAMILIES = (
    Family(
        "points",
        "points",
        steps=((2048, "2048"), (1024, "1024"), (512, "512"), (256, "256"), (128, "128")),
        trained=(("splat-net@chair", 512, 2048), ("pc2pix", 256, 2048)),
        logarithmic=True,
    ),
    Family(
        "many-points",
        "many points",
        steps=((2048, "2048"), (8192, "8192"), (32768, "32768")),
        trained=(("splat-net@chair", 512, 2048), ("pc2pix", 256, 2048)),
        logarithmic=True,
    ),
    Family(
        "noise",
        "noise: standard deviation, in radii of the unit sphere",
        steps=(
            (0.0, "2048"),
            (0.05, "noise-0.05"),
            (0.10, "noise-0.10"),
            (0.15, "noise-0.15"),
            (0.20, "noise-0.20"),
        ),
        trained=(("splat-net@chair", 0.0, 0.12), ("pc2pix", 0.0, 0.10)),
    ),
    Family(
        "outliers",
        "outliers: share of the points",
        steps=(
            (0.0, "2048"),
            (0.01, "outliers-0.01"),
            (0.05, "outliers-0.05"),
            (0.10, "outliers-0.10"),
        ),
        trained=(("splat-net@chair", 0.0, 0.0), ("pc2pix", 0.0, 0.0)),
    ),
    Family(
        "missing",
        "missing on one side: share of the points",
        steps=((0.0, "2048"), (0.25, "missing-0.25"), (0.50, "missing-0.50")),
        trained=(("splat-net@chair", 0.0, 0.0), ("pc2pix", 0.0, 0.0)),
    ),
    Family(  # all of its clouds have 1,024 points; the evenly thinned one is the condition "1024"
        "density",
        "density: densest end to sparsest, of 1,024 points",
        steps=((1.0, "1024"), (3.0, "density-3"), (10.0, "density-10")),
        trained=(("splat-net@chair", 1.0, 1.0), ("pc2pix", 1.0, 1.0)),
        logarithmic=True,
    ),
)


def families_of(conditions: Iterable[str]) -> tuple[Family, ...]:
    """Return the families that have at least two of these conditions, with only their steps."""
    wanted = set(conditions)
    families = []
    for family in FAMILIES:
        steps = tuple((value, id_) for value, id_ in family.steps if id_ in wanted)
        if len(steps) > 1:
            families.append(replace(family, steps=steps))
    return tuple(families)
