"""Conditions that keep the contract, and conditions that break one point of it each.

They are tested by their names, as `module:NAME`; `FAULTS` says what has to be found.
"""

from __future__ import annotations

import os
import random
import sys
from dataclasses import dataclass, replace

import numpy as np

from data_prep.clouds.conditions import Condition
from data_prep.scene import PointCloud

_SEEN = []
_KEPT = []


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
            case "no points":
                points = points[:0]
            case "many points":
                points = np.repeat(points, 100, axis=0)
            case "not finite":
                points[0, 0] = np.nan
            case "two columns":
                points = points[:, :2]
            case "far":
                points = points * 1000
            case "global numbers":
                points = points + np.random.normal(size=3).astype(np.float32)  # noqa: NPY002
            case "python's numbers":
                points = points + np.float32(random.random())
            case "own numbers":
                points = points + np.random.default_rng().normal(size=3).astype(np.float32)
            case "input":
                cloud.points.flags.writeable = True
                cloud.points[0] += 1
            case "remembers":
                _SEEN.append(None)
                points = points + np.float32(len(_SEEN))
            case "hash order":
                points = points + np.float32(hash("a string") % 7)
            case "leaks":
                _KEPT.append(np.ones(25 * 2**17))  # 25 MiB
            case "few":
                return replace(cloud, points=cloud.points[1000:])
            case "raises":
                raise ValueError("no room\nat all")
            case "exits":
                sys.exit(0)
            case "leaves":
                os._exit(0)
        return PointCloud(points, cloud.source)


class Unnamed(Moved):
    """A change whose `repr` is another in each process."""

    def __repr__(self):
        return object.__repr__(self)


ODD = (
    *("an array", "no points", "many points", "not finite", "two columns", "far", "input"),
    *("global numbers", "python's numbers", "own numbers", "remembers"),
    *("hash order", "leaks", "few", "raises", "exits", "leaves"),
)
PLUGINS = {
    "GOOD": Condition("good", Moved(), "made up"),
    **{
        fault.upper().replace(" ", "_").replace("'", ""): Condition(
            "a-" + fault.replace(" ", "-").replace("'", ""), Moved(fault), "made up"
        )
        for fault in ODD
    },
    "UNNAMED": Condition("unnamed", Unnamed(), "made up"),
    "NO_CHANGE": Condition("no-change", None, "made up"),
    "NO_VERSION": Condition("no-version", Moved(), "made up", version="2"),
    "NO_TEXT": Condition("no-text", Moved(), "made up", identity=lambda: 3),
    "NO_SOURCE": Condition("no-source", Moved(), ""),
}
globals().update(PLUGINS)

OWN = "take all randomness from `rng`"
# By name: the finding that tells the fault, what it says, and whether it blocks a run.
FAULTS = {
    "AN_ARRAY": ("clouds", "gives a ndarray, expected a PointCloud", True),
    "NO_POINTS": ("clouds", "gives 0 points, expected 1 to 100,000", True),
    "MANY_POINTS": ("clouds", "gives 204,800 points, expected 1 to 100,000", True),
    "NOT_FINITE": ("clouds", "gives 1 points that are not finite", True),
    "TWO_COLUMNS": ("clouds", "expected shape [N, 3], got [2048, 2]", True),
    "FAR": ("place", "; objects are in the unit sphere", False),
    "INPUT": ("clouds", "changes the cloud that it is given; work on a copy", True),
    "GLOBAL_NUMBERS": ("clouds", f"uses global random numbers; {OWN}", True),
    "PYTHONS_NUMBERS": ("clouds", f"uses global random numbers; {OWN}", True),
    "OWN_NUMBERS": ("repeatable", f"; {OWN}", True),
    "REMEMBERS": ("repeatable", "other points the second time", True),
    "HASH_ORDER": ("another process", "other points in another process", True),
    "LEAKS": ("calls", "25 MiB more with every call", True),
    "FEW": ("other clouds", "one point: gives 0 points, expected 1 to 100,000; return at", False),
    "RAISES": ("clouds", "no room", True),
    "LEAVES": ("clouds", "crash: os._exit(0) was called", True),
    "UNNAMED": ("another process", "not the same frozen dataclass of its parameters", True),
    "NO_CHANGE": ("identity", "NoneType has no function apply", True),
    "NO_VERSION": ("identity", "version is '2', expected a whole number", True),
    "NO_TEXT": ("identity", "identity() gives a int, expected a str", True),
    "NO_SOURCE": ("identity", "source is empty; name the origin", False),
}
