"""A method that keeps the contract, and eight that break one point of it each."""

from __future__ import annotations

import os
import signal
import time
from functools import partial

import numpy as np

from bench.catalogue.methods import Method


class Plain:
    """A gradient that depends on the cloud and the view. Without points it refuses."""

    def prepare(self, cloud, rng):
        from data_prep.failures import StageFailure

        if not len(cloud) or not np.isfinite(cloud.points).all():
            raise StageFailure("input", "no points, or not finite")
        return float(np.tanh(np.abs(cloud.points.astype(np.float64)).mean()))

    def draw(self, state, views, rng):
        images = np.ones((len(views), 128, 128, 3), np.float32)
        for image, view in zip(images, views, strict=True):
            shade = 0.4 * state + 0.3 * (1 + np.cos(np.radians(view.azimuth_deg))) / 2
            image[32:96, 32:96] = np.linspace(shade, 0.9, 64)[:, None]
        return images


class WrongShape(Plain):
    def draw(self, state, views, rng):
        return super().draw(state, views, rng)[:, :64]


class OutOfRange(Plain):
    def draw(self, state, views, rng):
        return 255 * super().draw(state, views, rng)


class NotFinite(Plain):
    def draw(self, state, views, rng):
        images = super().draw(state, views, rng)
        images[:, 64, 64] = np.nan
        return images


class Unseeded(Plain):
    def draw(self, state, views, rng):
        noise = np.random.default_rng().random((len(views), 128, 128, 1), np.float32)
        return np.clip(super().draw(state, views, rng) - 0.1 * noise, 0, 1)


class LooksAtOtherViews(Plain):
    def draw(self, state, views, rng):
        return super().draw(state, views, rng) * np.float32(0.9 if len(views) > 1 else 0.8)


class Hangs(Plain):
    def prepare(self, cloud, rng):
        while not len(cloud):
            time.sleep(60)
        return super().prepare(cloud, rng)


class Dies(Plain):
    def prepare(self, cloud, rng):
        if len(cloud) == 1:
            os.kill(os.getpid(), signal.SIGSEGV)
        return super().prepare(cloud, rng)


class RaisesAnything(Plain):
    def prepare(self, cloud, rng):
        if len(cloud) == 3:
            raise KeyError("no triangle")
        return super().prepare(cloud, rng)


def _method(id_, kind):
    return Method(id_, load=partial(_load, kind), identity=str, version=1, source="made up")


def _load(kind, device):
    return kind()


KINDS = {
    "plain": Plain,
    "wrong-shape": WrongShape,
    "out-of-range": OutOfRange,
    "not-finite": NotFinite,
    "unseeded": Unseeded,
    "looks-at-other-views": LooksAtOtherViews,
    "hangs": Hangs,
    "dies": Dies,
    "raises-anything": RaisesAnything,
}
METHODS = {id_: _method(id_, kind) for id_, kind in KINDS.items()}
globals().update({id_.replace("-", "_").upper(): method for id_, method in METHODS.items()})
