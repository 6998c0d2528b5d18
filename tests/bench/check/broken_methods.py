"""Methods that keep the contract, and methods that break one point of it each.

They are tested by their names, as `module:NAME`; `FAULTS` says what has to be found.
"""

from __future__ import annotations

import itertools
import os
import signal
import sys
import time
from functools import partial
from typing import Any

import numpy as np

from bench.catalogue.methods import Method
from data_prep.failures import BadInput, MissingDependency, StageFailure
from data_prep.scene import PointCloud

SIDE = 128


class Plain:
    """A gradient that depends on the cloud and the view. Without points it refuses."""

    def prepare(self, cloud, rng) -> Any:
        if not len(cloud) or not np.isfinite(cloud.points).all():
            raise StageFailure("input", "no points, or not finite")
        return float(np.tanh(np.abs(cloud.points.astype(np.float64)).mean()))

    def draw(self, state, views, rng):
        images = np.ones((len(views), SIDE, SIDE, 3), np.float32)
        for image, view in zip(images, views, strict=True):
            shade = 0.4 * state + 0.3 * (1 + np.cos(np.radians(view.azimuth_deg))) / 2
            image[32:96, 32:96] = np.linspace(shade, 0.9, 64)[:, None]
        return images


def method(kind, *arguments, **fields):
    """A method that loads such a renderer."""
    known = {"identity": str, "version": 1, "source": "made up"}
    load = fields.pop("load", partial(_load, kind, arguments))
    return Method(kind.__name__, load, **(known | fields))


def _load(kind, arguments, device):
    return kind(*arguments)


# --- methods that keep the contract ---------------------------------------------------------------


class StochasticDraw(Plain):
    """Takes random numbers for every image, in their order, as the docs allow."""

    def draw(self, state, views, rng):
        images = super().draw(state, views, rng)
        return images * (1 - 0.2 * rng.random((len(views), SIDE, SIDE, 1), np.float32))


class StochasticChildren(Plain):
    """Takes them from children of the generator."""

    def draw(self, state, views, rng):
        images = super().draw(state, views, rng)
        for image, child in zip(images, rng.spawn(len(views)), strict=True):
            image *= 1 - 0.2 * child.random((SIDE, SIDE, 1), np.float32)
        return images


class StochasticPrepare(Plain):
    """Looks at a random half of the points."""

    def prepare(self, cloud, rng):
        half = rng.permutation(cloud.points)[: (len(cloud) + 1) // 2]
        return super().prepare(PointCloud(half), rng)


GOOD = ("Plain", "StochasticDraw", "StochasticChildren", "StochasticPrepare")

# --- images ---------------------------------------------------------------------------------------


class Altered(Plain):
    """Returns `change(images)` in place of its images."""

    def __init__(self, change):
        self.change = change

    def draw(self, state, views, rng):
        return self.change(super().draw(state, views, rng))


def _with_nan(images):
    images[:, 64, 64] = np.nan
    return images


def _with_noise(images):
    noise = np.random.default_rng().random((len(images), SIDE, SIDE, 1), np.float32)
    return np.clip(images - 0.1 * noise, 0, 1)


class ChangesPoints(Plain):
    def prepare(self, cloud, rng):
        cloud.points.flags.writeable = True
        cloud.points[:] = cloud.points / 2
        return super().prepare(cloud, rng)


class ReadsSource(Plain):
    def prepare(self, cloud, rng):
        points = cloud.points if cloud.source is None else cloud.source.vertices
        return super().prepare(PointCloud(points), rng)


# --- randomness and views -------------------------------------------------------------------------


class UnseededBesideSeeded(StochasticDraw):
    """Takes `rng`, too, and another generator for more than eight views."""

    def draw(self, state, views, rng):
        images = super().draw(state, views, rng)
        factor = np.random.default_rng().uniform(0.5, 0.9) if len(views) > 8 else 1
        return images * np.float32(factor)


class ChangesState(Plain):
    def prepare(self, cloud, rng):
        return [super().prepare(cloud, rng)]

    def draw(self, state, views, rng):
        state[0] *= 0.8
        return super().draw(state[0], views, rng)


class IgnoresViews(Plain):
    def draw(self, state, views, rng):
        return np.repeat(super().draw(state, views[:1], rng), len(views), axis=0)


class NoViews(Plain):
    def draw(self, state, views, rng):
        return np.stack([super(NoViews, self).draw(state, [view], rng)[0] for view in views])


# --- clouds ---------------------------------------------------------------------------------------


class IgnoresCloud(Plain):
    def draw(self, state, views, rng):
        return super().draw(0.5, views, rng)


class RemembersTheBrightest(Plain):
    """Keeps something of the clouds before."""

    most = 0.0

    def prepare(self, cloud, rng):
        self.most = max(self.most, super().prepare(cloud, rng))
        return self.most


class RaisesAnything(Plain):
    def prepare(self, cloud, rng):
        if len(cloud) == 3:
            raise KeyError("no triangle")
        return super().prepare(cloud, rng)


class DrawsNaN(Plain):
    def prepare(self, cloud, rng):
        return float(np.tanh(np.abs(cloud.points).max(initial=0.5)))


class HangsAtNaN(Plain):
    """It hangs where MeshLab does."""

    def prepare(self, cloud, rng):
        while not np.isfinite(cloud.points).all():
            time.sleep(60)
        return super().prepare(cloud, rng)


class Acts(Plain):
    """A method that calls `act`, which leaves a trace or ends its process, on clouds of a size."""

    def __init__(self, act, points=2048):
        self.act, self.points = act, points

    def prepare(self, cloud, rng):
        if len(cloud) == self.points:
            self.act()
        return super().prepare(cloud, rng)


# --- ends -----------------------------------------------------------------------------------------


def _kill(number):
    os.kill(os.getpid(), number)
    time.sleep(60)


def _hang():
    while True:
        time.sleep(60)


def _spin():
    while True:
        pass


def _hog():
    kept = []
    while True:
        kept.append(np.ones(2**23))  # 64 MiB, touched


class NoDraw:
    def prepare(self, cloud, rng):
        return None

    draw = None


class NeedsAnArgument(Plain):
    def __init__(self, weights):
        self.weights = weights


_COUNT = itertools.count()


def _bad_weights(device):
    raise BadInput("weights.bin: cut short; fetch them again")


def _no_library(device):
    raise MissingDependency("no licence; buy one")


PLUGINS = {
    "WRONG_SHAPE": method(Altered, lambda images: images[:, :64]),
    "OUT_OF_RANGE": method(Altered, lambda images: 255 * images),
    "OTHER_SIZES": method(Plain, sizes=(128, 256)),
    "NOT_FINITE": method(Altered, _with_nan),
    "FLOAT64": method(Altered, lambda images: images.astype(np.float64)),
    "BLANK": method(Altered, np.ones_like),
    "UNSEEDED": method(Altered, _with_noise),
    "OTHER_VIEWS": method(
        Altered, lambda images: images * np.float32(0.9 if len(images) > 1 else 0.8)
    ),
    "IGNORES_CLOUD": method(IgnoresCloud),
    "SEES_NO_CLOUD": method(Plain, sees_cloud=False),
    "EXITS": method(Acts, partial(sys.exit, 0)),
    "LEAVES": method(Acts, partial(os._exit, 0)),
    "CRASHES": method(Acts, partial(_kill, signal.SIGSEGV), 1),
    "HANGS_WITHOUT_POINTS": method(Acts, _hang, 0),
    "SPINS": method(Acts, _spin, 0),
    "HOGS": method(Acts, _hog),
    "LOADS_NOTHING": method(Plain, load=_bad_weights),
    "NO_LIBRARY": method(Plain, load=_no_library),
    "LOADS_NONE": method(Plain, load=lambda device: None),
    "OTHER_IDENTITY": method(Plain, identity=lambda: str(next(_COUNT))),
    "IDENTITY_IS_NONE": method(Plain, identity=lambda: None),
    "VERSION_IS_TEXT": method(Plain, version="1.0"),
}
globals().update(PLUGINS)

# The finding that names each fault, a part of its text, and whether it blocks a run.
FAULTS = {
    "WRONG_SHAPE": ("images", "images of shape (3, 64, 128, 3), expected (3, 128", True),
    "OTHER_SIZES": ("images", "unexpected keyword argument 'size'", True),
    "OUT_OF_RANGE": ("images", "expected 0 .. 1", True),
    "NOT_FINITE": ("images", "9 pixel values are not finite", True),
    "FLOAT64": ("images", "images are float64, expected float32", True),
    "BLANK": ("images", "3 of 3 images are blank", True),
    "ChangesPoints": ("images", "the points of the cloud were changed", True),
    "ReadsSource": ("images", "cloud.source is read, which is None in a run", True),
    "UNSEEDED": ("repeatable", "take all randomness from `rng`", True),
    "UnseededBesideSeeded": ("batches", "take all randomness from `rng`", True),
    "OTHER_VIEWS": ("batches", "an image may not depend on the other views", True),
    "ChangesState": ("batches", "do not change the state in draw", True),
    "IgnoresViews": ("batches", "the same image from 20 views", True),
    "NoViews": ("no views", "ValueError: need at least one array to stack", False),
    "IGNORES_CLOUD": ("inputs", "the same images for every cloud; declare", True),
    "SEES_NO_CLOUD": ("inputs", "sees_cloud=False, but with a quarter of the points", True),
    "RemembersTheBrightest": ("calls", "other images after ", True),
    "RaisesAnything": ("three points", "KeyError: 'no triangle'; raise StageFailure", True),
    "DrawsNaN": ("a point at NaN", "values that are not finite", False),
    "HangsAtNaN": ("a point at NaN", "timeout: no result within", False),
    "EXITS": ("images", "SystemExit(0)", True),
    "LEAVES": ("images", "crash: os._exit(0) was called", True),
    "CRASHES": ("one point", "crash: the worker died (SIGSEGV)", True),
    "HANGS_WITHOUT_POINTS": ("no points", "timeout: no result within", True),
    "SPINS": ("no points", "timeout: no result within 5 s of processor time", True),
    "HOGS": ("images", "memory: ", True),
    "NoDraw": ("import", "expected a Method", True),
    "NeedsAnArgument": ("loading", "missing 1 required positional argument: 'weights'", True),
    "LOADS_NOTHING": ("loading", "weights.bin: cut short; fetch them again", True),
    "NO_LIBRARY": ("loading", "no licence; buy one", True),
    "LOADS_NONE": ("loading", "NoneType has no function prepare", True),
    "OTHER_IDENTITY": ("identity", "a run could not use its finished jobs", True),
    "IDENTITY_IS_NONE": ("identity", "identity() gives a NoneType, expected a str", True),
    "VERSION_IS_TEXT": ("identity", "version is '1.0', expected a whole number", True),
}
# Modules with a faulty line: the line, the finding, a part of its text, and whether it blocks.
MODULES = {
    "slow": (
        "import time; time.sleep(2.5)",
        "import",
        "do what takes long in the functions",
        False,
    ),
    "heavy": ("import pandas", "import", "loads pandas; import them in", False),
    "leaves": ("import os; os._exit(0)", "import", "os._exit(0) was called", True),
    "raises": ("1 / 0", "import", "ZeroDivisionError: division by zero", True),
}
MODULE = """
{line}
from tests.bench.check.broken_methods import Plain
"""
