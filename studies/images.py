"""Images of many objects at once, their scores, and views that are turned a little."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.lookup import find
from bench.metrics import lpips
from bench.metrics.image_scores import scores
from data_prep.clouds.conditions import CONDITIONS
from data_prep.datasets.objects import SceneObject
from data_prep.randomness import generator
from data_prep.rendering.dots import draw_dots
from data_prep.rendering.images import to_uint8
from data_prep.rendering.opengl import render
from data_prep.scene import Mesh, PointCloud, Renderer, UInt8Images, View

# Conditions of a sheet, with the titles of their columns, and its view.
CONDITION_TITLES = {"2048": "2,048 points", "noise-0.10": "noise 10 %"}
VIEW = View(azimuth_deg=30, elevation_deg=20)
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


def row_titles(methods: Sequence[str]) -> list[str]:
    """Return the titles of the columns of `draw_row`, given those of the methods."""
    titles = ["truth"]
    for condition in CONDITION_TITLES.values():
        titles += [f"cloud,\n{condition}", *methods]
    return titles


def draw_row(shape: SceneObject, renderers: Sequence[Renderer]) -> Iterator[UInt8Images]:
    """Yield the row of an object in a sheet, image by image [H, W, 3].

    The first is the true image; the cloud and the images of all methods follow for each of
    CONDITION_TITLES.
    """
    yield shape.truth([VIEW])[0]
    sampled = shape.cloud(generator("readme", shape.object_id))
    for condition in CONDITION_TITLES:
        perturbation = find(condition, CONDITIONS, "condition").perturbation
        cloud = perturbation.apply(sampled, generator("readme", condition, shape.object_id))
        yield draw_dots(cloud.points, [VIEW])[0]
        for renderer in renderers:
            yield draw_all(renderer, [cloud], [[VIEW]])[0, 0]
