"""Images of many objects at once, their scores, and views that are turned a little."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.metrics import lpips
from bench.metrics.image_scores import scores
from data_prep.rendering.images import to_uint8
from data_prep.rendering.opengl import render
from data_prep.scene import Mesh, PointCloud, Renderer, UInt8Images, View

TURN_DEG = 0.1  # 0.1 px at the rim of the unit sphere: what another driver may amount to


def draw_all(
    renderer: Renderer, clouds: Sequence[PointCloud], views: Sequence[Sequence[View]]
) -> UInt8Images:
    """Return images of clouds, each from its views, by a method that draws no random numbers."""
    unused = np.random.default_rng(0)
    return np.stack(
        [
            to_uint8(renderer.draw(renderer.prepare(cloud, unused), of_cloud, unused))
            for cloud, of_cloud in zip(clouds, views, strict=True)
        ]
    )


def render_all(meshes: Sequence[Mesh], views: Sequence[Sequence[View]]) -> UInt8Images:
    """Return the true images of meshes, each from its views."""
    return np.stack([render(*pair) for pair in zip(meshes, views, strict=True)])


def all_scores(truth: UInt8Images, drawn: UInt8Images) -> dict[str, NDArray[np.float64]]:
    """Return every image metric [V] of images [V, H, W, 3], named as the columns of a record."""
    return scores(truth, drawn) | {"lpips": lpips(truth, drawn, single=True)}


def turned(views: Sequence[View]) -> tuple[View, ...]:
    """Return the views with TURN_DEG more of azimuth."""
    return tuple(replace(view, azimuth_deg=view.azimuth_deg + TURN_DEG) for view in views)
