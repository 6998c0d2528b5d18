"""Conditions that keep the contract, and conditions that break one point of it each.

They are tested by their names, as `module:NAME`; `FAULTS` says what has to be found.
"""

from __future__ import annotations

import itertools
import os
import random
import sys
from dataclasses import dataclass, replace

import numpy as np

from data_prep.clouds.conditions import Condition
from data_prep.scene import PointCloud

_COUNT = itertools.count()


@dataclass(frozen=True)
class Moved:
    """A change of the cloud with something wrong about it."""

    fault: str = ""

    def apply(self, cloud, rng):
        points = cloud.points + rng.normal(scale=0.01, size=cloud.points.shape)
        points = points.astype(np.float32)
        match self.fault:
            case "an array":
                return points
            case "few":
                return replace(cloud, points=cloud.points[1000:])
            case "input":
                cloud.points.flags.writeable = True
                cloud.points[0] += 1
            case "not finite":
                points[0, 0] = np.nan
            case "raises":
                raise ValueError("no room\nat all")
        change = CHANGES.get(self.fault, lambda points: points)
        return PointCloud(change(points), cloud.source)


CHANGES = {
    "no points": lambda points: points[:0],
    "many points": lambda points: np.repeat(points, 100, axis=0),
    "two columns": lambda points: points[:, :2],
    "far": lambda points: points * 1000,
    "global numbers": lambda points: points + np.float32(np.random.normal()),  # noqa: NPY002
    "python's numbers": lambda points: points + np.float32(random.random()),
    "own numbers": lambda points: points + np.float32(np.random.default_rng().normal()),
    "remembers": lambda points: points + np.float32(next(_COUNT)),
    "exits": lambda points: sys.exit(0),
    "leaves": lambda points: os._exit(0),
}


OWN = "take all randomness from `rng`"
# By what is wrong: the finding that tells it, what it says, and whether it blocks a run.
ODD = {
    "an array": ("clouds", "gives a ndarray, expected a PointCloud", True),
    "no points": ("clouds", "gives 0 points, expected 1 to 100,000", True),
    "many points": ("clouds", "gives 204,800 points, expected 1 to 100,000", True),
    "not finite": ("clouds", "gives 1 points that are not finite", True),
    "two columns": ("clouds", "expected shape [N, 3], got [2048, 2]", True),
    "far": ("place", ", as objects are in the unit sphere", False),
    "input": ("clouds", "changes the cloud that it is given; work on a copy", True),
    "global numbers": ("clouds", f"uses global random numbers; {OWN}", True),
    "python's numbers": ("clouds", f"uses global random numbers; {OWN}", True),
    "own numbers": ("repeatable", f"; {OWN}", True),
    "remembers": ("repeatable", "other points the second time", True),
    "few": ("other clouds", "one point: gives 0 points, expected 1 to 100,000; return at", False),
    "raises": ("clouds", "no room", True),
    "exits": ("clouds", "SystemExit", True),
    "leaves": ("clouds", "crash: os._exit(0) was called", True),
}
NAMES = {fault: fault.replace(" ", "-").replace("'", "") for fault in ODD}
PLUGINS = {
    "GOOD": Condition("good", Moved(), "made up"),
    **{
        name.upper().replace("-", "_"): Condition(f"a-{name}", Moved(fault), "made up")
        for fault, name in NAMES.items()
    },
    "NO_CHANGE": Condition("no-change", None, "made up"),
    "NO_VERSION": Condition("no-version", Moved(), "made up", version="2"),
    "NO_TEXT": Condition("no-text", Moved(), "made up", identity=lambda: 3),
    "NO_SOURCE": Condition("no-source", Moved(), ""),
}
globals().update(PLUGINS)

FAULTS = {
    **{NAMES[fault].upper().replace("-", "_"): told for fault, told in ODD.items()},
    "NO_CHANGE": ("identity", "NoneType has no function apply", True),
    "NO_VERSION": ("identity", "version is '2', expected a whole number", True),
    "NO_TEXT": ("identity", "identity() gives a int, expected a str", True),
    "NO_SOURCE": ("identity", "source is empty; name the origin", False),
}
