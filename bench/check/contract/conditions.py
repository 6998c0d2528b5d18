"""The contract of a condition: it gives clouds that a run can use, and is random by `rng` only."""

from __future__ import annotations

import pickle
import random

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.conditions import UnusableCloud, applied
from bench.check.contract.findings import ContractViolation, checked_identity
from bench.check.contract.methods import EXTREMES, chair
from bench.check.contract.session import CheckStep, Passed
from bench.check.contract.targets import find_target
from data_prep.clouds.conditions import Condition
from data_prep.failures import BadInput, StageFailure
from data_prep.randomness import generator
from data_prep.scene import PointCloud

OBJECTS = 3  # the number of chairs whose clouds are perturbed
# The distance from the centre, in radii of the unit sphere, from which a point counts as far away.
# The camera is 4 away, and noise of 20 % of the radius moves points by less than 1.
FAR = 2.0
# Unusual clouds that a condition is tried on, too, as users' files and other datasets have them.
OTHERS = ("one point", "three points", "equal points", "points in a plane", "20,000 points")


def _condition(name: str) -> Condition:
    condition = find_target(name)
    assert isinstance(condition, Condition)
    return condition


def _perturbed(name: str, cloud: PointCloud, seed: str = "condition") -> PointCloud:
    """Return a cloud as a run perturbs it, with the same random numbers each time."""
    before = _global_states()
    try:
        result = applied(_condition(name), cloud, generator("contract", seed))
    except UnusableCloud as error:
        raise ContractViolation(str(error)) from error
    if before != _global_states():
        raise ContractViolation("uses global random numbers; take all randomness from `rng`")
    return result


def _global_states() -> bytes:
    """Return the states of the global generators of Python and NumPy."""
    return pickle.dumps((random.getstate(), np.random.get_state()))  # noqa: NPY002


def check_identity(name: str) -> Passed:
    """Check version, identity and parameters, by which a run knows its finished jobs again."""
    condition = _condition(name)
    checked_identity(condition.version, condition.identity)
    if not callable(getattr(condition.perturbation, "apply", None)):
        kind = type(condition.perturbation).__name__
        raise ContractViolation(f"{kind} has no function apply(cloud, rng)")
    if not isinstance(condition.source, str) or not condition.source:
        raise ContractViolation("source is empty; name the origin of the condition", blocks=False)
    return Passed(f"version {condition.version}, {condition.key}")


def use(name: str, number: int) -> NDArray[np.float32]:
    """Return the points of a perturbed cloud."""
    return _perturbed(name, chair(number % OBJECTS)).points


def _perturbed_chairs(name: str) -> list[PointCloud]:
    return [_perturbed(name, chair(index), str(index)) for index in range(OBJECTS)]


def check_clouds(name: str) -> Passed:
    """Perturb clouds, and check that usable clouds come back."""
    counts = list(map(len, _perturbed_chairs(name)))
    least, most = min(counts), max(counts)
    points = f"{least:,}" if least == most else f"{least:,} to {most:,}"
    return Passed(f"{len(chair()):,} points become {points}, float32 [N, 3], finite")


def check_place(name: str) -> Passed:
    """Check that points stay in the unit sphere, where objects are, or near it."""
    farthest = max(np.linalg.norm(c.points, axis=1).max() for c in _perturbed_chairs(name))
    if farthest > FAR:
        raise ContractViolation(
            f"the farthest point lies at {farthest:.3g}; keep points within {FAR:g}, as objects "
            "are in the unit sphere"
        )
    return Passed(f"the farthest point lies at {farthest:.3f}; objects are in the unit sphere")


def check_others(name: str) -> Passed:
    """Perturb unusual clouds, and check that each is perturbed or refused."""
    for other in OTHERS:
        cloud = EXTREMES[other].apply(chair(), generator("contract", other))
        try:
            _perturbed(name, cloud, other)
        except (StageFailure, BadInput):  # the condition refuses the cloud and says why
            continue
        except Exception as error:
            raise ContractViolation(
                f"{other}: {error}; return at least a point, or raise StageFailure(stage, problem)"
            ) from error
    return Passed(", ".join(OTHERS))


FIRST = (
    CheckStep("clouds", check_clouds),
    CheckStep("place", check_place, blocks=False),  # a run takes points that lie anywhere
    CheckStep("other clouds", check_others, blocks=False),  # a run goes on, as their jobs fail
)
