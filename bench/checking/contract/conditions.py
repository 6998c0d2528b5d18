"""The contract of a condition: clouds that a run can use, from `rng` alone."""

from __future__ import annotations

import pickle
import random
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from bench.catalogue.conditions import UnusableCloud, applied
from bench.checking.contract.findings import ContractViolation
from bench.checking.contract.methods import KEPT_MIB, growth_mib, resident_mib
from bench.checking.contract.session import CheckStep, Passed
from bench.checking.contract.targets import find_target
from data_prep.clouds.conditions import Condition, Perturbation
from data_prep.clouds.extremes import Count, Equal, Flattened
from data_prep.datasets.registry import ProceduralObject
from data_prep.failures import BadInput, StageFailure
from data_prep.randomness import generator
from data_prep.scene import PointCloud

OBJECTS = 3  # whose clouds are checked
CALLS = 8
FAR = 2.0  # the camera stands at 4, and noise of 20 % of the radius keeps points within 2
# Clouds of files and of other datasets, which a condition meets as well.
OTHERS: Mapping[str, Perturbation] = {
    "one point": Count(1),
    "three points": Count(3),
    "equal points": Equal(),
    "points in a plane": Flattened(2),
    "20,000 points": Count(20_000),
}


def condition_steps(evidence: Any) -> list[CheckStep]:
    """Return all steps for a condition; `evidence` is that of `first_evidence` elsewhere."""
    return [
        CheckStep("clouds", check_clouds),
        CheckStep("repeatable", check_repeatable),
        CheckStep("another process", partial(check_elsewhere, elsewhere=evidence)),
        CheckStep("place", check_place, blocks=False),  # a run takes points anywhere
        CheckStep("other clouds", check_others, blocks=False),  # they become failed records
        CheckStep("calls", check_calls),
    ]


def _condition(name: str) -> Condition:
    condition = find_target(name)
    assert isinstance(condition, Condition)
    return condition


def _cloud(index: int = 0) -> PointCloud:
    """Return the cloud of a chair, with its mesh, as a run gives it to a condition."""
    return ProceduralObject("chair", "validation", index).cloud(generator("contract"))


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
    """Check version, identity and parameters, which name finished work."""
    condition = _condition(name)
    if type(condition.version) is not int:
        raise ContractViolation(f"version is {condition.version!r}, expected a whole number")
    identity = condition.identity()
    if not isinstance(identity, str):
        raise ContractViolation(f"identity() gives a {type(identity).__name__}, expected a str")
    if condition.key != (again := condition.key):
        raise ContractViolation(
            f"is {condition.key!r}, then {again!r}; finished work would be lost"
        )
    if not callable(getattr(condition.perturbation, "apply", None)):
        kind = type(condition.perturbation).__name__
        raise ContractViolation(f"{kind} has no function apply(cloud, rng)")
    if not isinstance(condition.source, str) or not condition.source:
        raise ContractViolation("source is empty; name the origin of the condition", blocks=False)
    return Passed(f"version {condition.version}, {condition.key}")


def first_evidence(name: str, backwards: bool = False) -> Mapping[str, Any]:
    """Return the key and two clouds, to compare with those of another process."""
    clouds = {i: _perturbed(name, _cloud(i)).points for i in ((1, 0) if backwards else (0, 1))}
    return {"key": _condition(name).key} | {f"cloud {i}": clouds[i] for i in (0, 1)}


def check_clouds(name: str) -> Passed:
    """Perturb clouds, and check what comes back."""
    counts = [len(_perturbed(name, _cloud(index), str(index))) for index in range(OBJECTS)]
    least, most = min(counts), max(counts)
    points = f"{least:,}" if least == most else f"{least:,} to {most:,}"
    return Passed(f"{len(_cloud()):,} points become {points}, float32 [N, 3], finite")


def check_repeatable(name: str) -> Passed:
    """Perturb a cloud twice with the same random numbers, and once with others."""
    first, second = (_perturbed(name, _cloud()).points for _ in range(2))
    if not np.array_equal(first, second):
        raise ContractViolation("other points the second time; take all randomness from `rng`")
    for other in range(1, OBJECTS):
        _perturbed(name, _cloud(other))
    if not np.array_equal(first, _perturbed(name, _cloud()).points):
        raise ContractViolation("other points after other clouds; keep nothing of a cloud")
    is_random = not np.array_equal(first, _perturbed(name, _cloud(), "other numbers").points)
    return Passed(f"the same points each time, {'by' if is_random else 'whatever is'} `rng`")


def check_elsewhere(name: str, elsewhere: Mapping[str, Any] | str) -> Passed:
    """Compare with another process, on two threads, that has perturbed in another order."""
    here = first_evidence(name)
    if isinstance(elsewhere, str):
        raise ContractViolation(f"perturbed here, but not in another process: {elsewhere}")
    if here["key"] != elsewhere["key"]:
        raise ContractViolation(
            f"is {here['key']!r}, in another process {elsewhere['key']!r}; finished work would be "
            "lost: make the perturbation a frozen dataclass of its parameters"
        )
    for cloud in ("cloud 0", "cloud 1"):
        if not np.array_equal(here[cloud], elsewhere[cloud]):
            raise ContractViolation(
                "other points in another process, on two threads, in another order of clouds"
            )
    return Passed("the same points in two processes, in another order")


def check_place(name: str) -> Passed:
    """Check that points stay where objects are, in the unit sphere or near it."""
    radii = [
        float(np.linalg.norm(_perturbed(name, _cloud(index), str(index)).points, axis=1).max())
        for index in range(OBJECTS)
    ]
    if max(radii) > FAR:
        raise ContractViolation(
            f"the farthest point lies at {max(radii):.3g}; objects are in the unit sphere"
        )
    return Passed(f"the farthest point lies at {max(radii):.3f}; objects are in the unit sphere")


def check_others(name: str) -> Passed:
    """Perturb other clouds than those of the protocol."""
    for other, change in OTHERS.items():
        cloud = change.apply(_cloud(), generator("contract", other))
        try:
            _perturbed(name, cloud, other)
        except (StageFailure, BadInput):  # refused by name
            continue
        except Exception as error:
            raise ContractViolation(
                f"{other}: {error}; return at least a point, or raise StageFailure(stage, problem)"
            ) from error
    return Passed(", ".join(OTHERS))


def check_calls(name: str) -> Passed:
    """Perturb often, and check that memory does not grow."""
    kept = []
    for call in range(CALLS):
        _perturbed(name, _cloud(call % OBJECTS))
        kept.append(resident_mib())
    growth = growth_mib(kept)
    if growth > KEPT_MIB:
        raise ContractViolation(f"{growth:.0f} MiB more with every cloud")
    return Passed(f"memory grows by {growth:.1f} MiB a cloud")
