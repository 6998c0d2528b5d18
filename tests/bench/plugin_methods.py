"""Methods that another package announces. Spawned workers import this module by its name."""

from __future__ import annotations

import os
import signal
import time
from contextlib import contextmanager
from functools import partial

import numpy as np
import torch

from bench.catalogue import methods
from bench.catalogue.methods import Method
from data_prep import plugins
from data_prep.failures import BadInput, MissingDependency, StageFailure
from data_prep.plugins import METHODS
from data_prep.randomness import generator


class Telling:
    """Healthy. The first pixels of its images tell what it was given, in grey levels.

    `check` sees all of that before; it may raise, do worse, or make other images.
    """

    def __init__(self, check=lambda points, views, rng, images: images):
        self.check = check

    def prepare(self, cloud, rng):
        return cloud.points

    def draw(self, state, views, rng):
        images = np.ones((len(views), 128, 128, 3), np.float32)
        for image, view in zip(images, views, strict=True):
            radius = np.linalg.norm(state, axis=1).max(initial=0.0)
            message = (view.azimuth_deg, view.elevation_deg, len(state), 10 * radius)
            image[0, :4] = np.array(message)[:, None] / 255
        return self.check(state, views, rng, images)


def left_and_right(points, views, rng, images):
    """Fails on clouds with points on both sides: two are enough, and needed."""
    left, right = (points[:, 0] < -0.2).sum(), (points[:, 0] > 0.2).sum()
    if left and right:
        raise StageFailure("weigh", f"{left} points left and {right} right")
    return images


def crash_where_high(points, views, rng, images):
    if (points[:, 1] > 0.3).any():
        os.kill(os.getpid(), signal.SIGSEGV)
    return images


def several_views(points, views, rng, images):
    if len(views) > 1 and len(points) > 2:
        raise ValueError("one at a time")
    return images


def unlucky(points, views, rng, images):
    """With all random numbers but those of `bench render`."""
    if rng.random() != generator("render").random():
        raise ValueError("bad luck")
    return images


def round_(points, views, rng, images):
    """Half the azimuth and 90, so that a whole turn has room in the grey levels."""
    for image, view in zip(images, views, strict=True):
        image[0, 0] = (view.azimuth_deg / 2 + 90) / 255
    return images


def no_licence(device):
    raise MissingDependency("no licence; buy one")


def no_weights(device):
    raise BadInput("weights: cut short; fetch them again")


def announced(id_, load):
    return Method(id_, load, str, 1, "a stranger's")


def load_check(check, device):
    return Telling(check)


LOADED = []  # in a worker process


def load_counted(device):
    """Images tell how often the method was loaded in their process."""
    LOADED.append(device)

    def tell(points, views, rng, images):
        images[:, 0, 0] = len(LOADED) / 255
        return images

    return Telling(tell)


def no_library(points, views, rng, images):
    raise MissingDependency("no libGL: install libgl1")


def strict_numbers(points, views, rng, images):
    np.seterr(all="raise")  # for all that comes after in its process
    return images


def patched_torch(points, views, rng, images):
    torch.Tensor.mean = lambda tensor, *args, **options: torch.tensor(2.5).expand(tensor.shape[0])
    return images


def hang(*_):
    while True:
        time.sleep(60)


def segfault(*_):
    os.kill(os.getpid(), signal.SIGSEGV)


def memory_hog(*_):
    kept = []
    while True:
        kept.append(np.ones(2**23))  # 64 MiB, touched


def exception(*_):
    raise ValueError("12 of 34 parts are missing\nand more of that")


def wrong_shape(points, views, rng, images):
    return images[:, :64]


def nan(points, views, rng, images):
    images[:, 64] = np.nan
    return images


def blank(points, views, rng, images):
    return np.ones_like(images)


CHECKS = (
    *(hang, segfault, memory_hog, exception, wrong_shape, nan, blank),
    strict_numbers,
    patched_torch,
    no_library,
    left_and_right,
    crash_where_high,
    several_views,
    unlucky,
    round_,
)
PLUGINS = {
    "fake-healthy": lambda device: Telling(),
    "fake-counted": load_counted,
    "fake-no-licence": no_licence,
    "fake-no-weights": no_weights,
    **{f"fake-{c.__name__.strip('_').replace('_', '-')}": partial(load_check, c) for c in CHECKS},
}
for _id, _load in PLUGINS.items():
    globals()[_id.replace("-", "_")] = announced(_id, _load)


def announce(folder, plugins, group=METHODS):
    """Make a package in `folder` that announces plug-ins: id to "module:NAME".

    It is found where `folder` is on `sys.path`, in spawned workers too.
    """
    info = folder / "fake-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: fake\nVersion: 1.0\n")
    entries = "".join(f"{id_} = {place}\n" for id_, place in plugins.items())
    (info / "entry_points.txt").write_text(f"[{group}]\n{entries}")


@contextmanager
def installed(folder, monkeypatch):
    """As if the package of these methods had been installed, for this process and its workers."""
    announce(folder, {id_: f"{__name__}:{id_.replace('-', '_')}" for id_ in PLUGINS})
    monkeypatch.syspath_prepend(folder)
    caches = plugins.announced, methods._plugin
    for cache in caches:
        cache.cache_clear()
    yield
    for cache in caches:
        cache.cache_clear()
