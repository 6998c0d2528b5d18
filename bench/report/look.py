"""What the viewer of a page shows: clouds that turn, and images of them in all views of a run."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
import pandas as pd

from bench.analysis.paper import network_of
from bench.catalogue.metrics import column, higher_is_better
from bench.records.job import GROUND_TRUTH, JobName
from bench.report.images import Sources, data_uri, shown_objects
from bench.report.styles import rivals
from data_prep.clouds.sampling import random_rows
from data_prep.scene import PointCloud

MOST_OBJECTS = 2  # objects in the viewer of a report: each has clouds and images at all conditions
MOST_DOTS = 4096  # points of a cloud in a report, which has many clouds: 33 kB of text each
# Characters of a method's images, as text, up to which the next method is shown, too: with them the
# report of a default run is at most half as large again as without.
MOST_TEXT = 1_500_000
_MOST_VIEWS = 100  # views one below the other in an image: a WebP has at most 16,383 rows
_STEPS = 32767  # of a coordinate in 16 bits, from 0 to the farthest of all


def cloud_entry(cloud: PointCloud, most: int) -> dict[str, Any]:
    """Return a cloud for the viewer: `points` and `colours` as base64, and the `scale` of points.

    most  the most points; of a larger cloud some are taken at random, the same ones each time
    """
    cloud = cloud.take(np.flatnonzero(np.isfinite(cloud.points).all(axis=1)))
    cloud = cloud.take(random_rows(len(cloud), most))
    scale = float(np.abs(cloud.points).max(initial=1.0))
    points = np.rint(cloud.points / scale * _STEPS).astype("<i2")
    colours = None if cloud.colors is None else base64.b64encode(cloud.colors.tobytes()).decode()
    return {
        "scale": scale,
        "points": base64.b64encode(points.tobytes()).decode(),
        "colours": colours,
    }


def of_cloud(cloud: PointCloud, name: str, most: int) -> dict[str, Any]:
    """Return what the viewer shows of a cloud alone."""
    shown = {"name": name, "views": [], "truth": "", "images": {}}
    shown["clouds"] = {"": cloud_entry(cloud, most)}
    return {"objects": [shown], "conditions": [""], "methods": [""]}


def of_run(images: pd.DataFrame, sources: Sources, metric: str) -> dict[str, Any] | None:
    """Return what the viewer shows of a run; None where no method that competes has an image.

    images  a row for each image, in the order of the run
    metric  by its mean the best methods are shown, as many as have room, and pc2pix among them
    """
    conditions = list(dict.fromkeys(map(str, images["condition"])))
    means = images.groupby("method")[column(metric)].mean().dropna()
    means = means[rivals(means.index)]
    best_first = [*means.sort_values(ascending=not higher_is_better(metric)).index]
    if network := network_of(best_first):
        others = [method for method in best_first if method != network]
        best_first = [*others[:1], network, *others[1:]]
    objects = [_object(images, sources, *obj) for obj in shown_objects(images)[:MOST_OBJECTS]]
    methods, text = [], 0
    for method in best_first:
        if text > MOST_TEXT:
            break
        methods.append(method)
        for shown, condition in ((one, at) for one in objects for at in conditions):
            name = shown["job"]._replace(method=method, condition=condition)
            strip = _strip(sources, name, len(shown["views"]))
            shown["images"].setdefault(condition, {})[method] = strip
            text += len(strip)
    for shown in objects:
        name = shown.pop("job")
        for condition in conditions:
            cloud = sources.cloud(name._replace(condition=condition))
            if cloud is not None:
                shown["clouds"][condition] = cloud_entry(cloud, MOST_DOTS)
    return {"objects": objects, "conditions": conditions, "methods": methods} if methods else None


def _object(images: pd.DataFrame, sources: Sources, class_name: str, obj: str) -> dict[str, Any]:
    """Return an object with its views and true images; `job` is the name of a job of it."""
    of_object = images[(images["class"] == class_name) & (images["object"] == obj)]
    views = of_object.drop_duplicates("view").sort_values("view")[:_MOST_VIEWS]
    name = JobName("", "", class_name, obj)
    return {
        "job": name,
        "name": f"{class_name} {obj}",
        "views": views[["azimuth_deg", "elevation_deg"]].round(2).to_numpy().tolist(),
        "truth": _strip(sources, name._replace(method=GROUND_TRUTH), len(views)),
        "images": {},
        "clouds": {},
    }


def _strip(sources: Sources, name: JobName, count: int) -> str:
    """Return the first images of a job one below the other, as a data URI; "" without them."""
    images = sources.images(name)
    if images is None or len(images) < count:
        return ""
    return data_uri(images[:count].reshape(-1, *images.shape[2:]))
