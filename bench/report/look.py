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
from bench.tables.markdown import visible
from data_prep.clouds.sampling import random_rows
from data_prep.scene import PointCloud

MOST_OBJECTS, MOST_METHODS, MOST_POINTS = 2, 3, 4096
# Images of methods, about 6 kB of text each: with them the report of a default run is not half as
# large again. Of more the first views are shown, but always FEWEST_VIEWS.
MOST_IMAGES, FEWEST_VIEWS = 240, 4
_STEPS = 32767  # of a coordinate in 16 bits, from 0 to the farthest of all


def cloud_entry(cloud: PointCloud, most: int) -> dict[str, Any]:
    """Return a cloud for the viewer: `points` and `colours` as base64, and the `scale` of points.

    most  the most points; of a larger cloud some are taken at random, the same ones each time
    """
    cloud = cloud.take(np.flatnonzero(np.isfinite(cloud.points).all(axis=1)))
    cloud = cloud.take(random_rows(len(cloud), most))
    scale = float(np.abs(cloud.points).max(initial=1.0))
    points = np.rint(cloud.points / scale * _STEPS).astype("<i2")
    colours = "" if cloud.colors is None else base64.b64encode(cloud.colors.tobytes()).decode()
    return {
        "scale": scale,
        "points": base64.b64encode(points.tobytes()).decode(),
        "colours": colours,
    }


def of_run(images: pd.DataFrame, sources: Sources, metric: str) -> dict[str, Any] | None:
    """Return what the viewer shows of a run; None where no method that competes has an image.

    images  a row for each image, in the order of the run
    metric  by its mean the best methods are chosen, and pc2pix in place of the last of them
    """
    means = images.groupby("method")[column(metric)].mean().dropna().sort_values()
    best_first = rivals(means.index[::-1] if higher_is_better(metric) else means.index)
    methods, network = best_first[:MOST_METHODS], network_of(best_first)
    if network and network not in methods:
        methods[-1] = network
    conditions = list(dict.fromkeys(map(str, images["condition"])))
    count = max(FEWEST_VIEWS, MOST_IMAGES // (len(conditions) * MOST_OBJECTS * MOST_METHODS))
    objects = []
    for class_name, name in shown_objects(images)[:MOST_OBJECTS]:
        of_object = images[(images["class"] == class_name) & (images["object"] == name)]
        views = of_object.drop_duplicates("view").sort_values("view")[:count]
        job = JobName(GROUND_TRUTH, "", class_name, name)
        entry: dict[str, Any] = {"name": visible(f"{class_name} {name}"), "clouds": {}}
        entry["views"] = views[["azimuth_deg", "elevation_deg"]].round(2).to_numpy().tolist()
        entry["truth"] = _strip(sources, job, count)
        entry["images"] = {condition: {} for condition in conditions}
        for condition in conditions:
            job = job._replace(condition=condition)
            cloud = sources.cloud(job)
            if cloud is not None:
                entry["clouds"][condition] = cloud_entry(cloud, MOST_POINTS)
            for method in methods:
                of_method = job._replace(method=method)
                entry["images"][condition][method] = _strip(sources, of_method, count)
        objects.append(entry)
    return {"objects": objects, "conditions": conditions, "methods": methods} if methods else None


def _strip(sources: Sources, job: JobName, count: int) -> str:
    """Return the first images of a job one below the other, as a data URI; "" without them."""
    images = sources.images(job)
    return "" if images is None else data_uri(images[:count].reshape(-1, *images.shape[2:]))
