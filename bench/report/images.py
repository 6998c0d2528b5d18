"""Images of the report: read from a finished run, chosen, captioned and encoded.

Clouds are made again, for a run keeps none.
"""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analysis.digits import decimals
from bench.catalogue.methods import FLOOR
from bench.catalogue.metrics import column, higher_is_better
from bench.records.frames import Artifact, stored_artifacts
from bench.records.job import GROUND_TRUTH, Job, JobName
from bench.report.styles import rivals
from bench.running.plan import plan
from bench.running.protocol import Protocol
from bench.running.work import cloud_under
from bench.tables.grid import number_text, row_mappings
from data_prep.failures import BadInput, StageFailure
from data_prep.rendering.dots import draw_dots
from data_prep.scene import PointCloud, View

_CACHED = 32  # jobs whose images are held in memory, about 1 MB each; and as many clouds


@dataclass(frozen=True, eq=False)
class Sources:
    """The images and clouds of a run, by the names of its jobs.

    artifacts  where the images of jobs are stored
    clouds     by the name of a job without its method, a job whose cloud is the same
    unseen     why clouds cannot be made again; empty where they can
    """

    artifacts: Mapping[JobName, Artifact]
    clouds: Mapping[JobName, Job]
    unseen: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "_read", lru_cache(_CACHED)(Artifact.read_images))
        object.__setattr__(self, "_sampled", lru_cache(_CACHED)(_sampled))

    def images(self, item: JobName) -> NDArray[np.uint8] | None:
        """Return the images [V, H, W, 3] of a job; None where they are missing or unreadable."""
        artifact = self.artifacts.get(item)
        return None if artifact is None else self._read(artifact)  # type: ignore[attr-defined]

    def cloud(self, item: JobName) -> PointCloud | None:
        """Return the cloud that a job has drawn; None where it cannot be made again."""
        job = self.clouds.get(item._replace(method=""))
        return None if job is None else self._sampled(job)  # type: ignore[attr-defined]


def open_sources(directory: Path, manifest: Mapping[str, Any], shown: Sequence[JobName]) -> Sources:
    """Open the images of a run, and the clouds of the objects and conditions of `shown`.

    Raises BadInput where its store cannot be read.
    """
    artifacts = stored_artifacts(directory)
    try:
        return Sources(artifacts, _cloud_jobs(manifest, shown), "")
    except BadInput as error:
        return Sources(artifacts, {}, f"The clouds cannot be made again: {error}.")


def _cloud_jobs(manifest: Mapping[str, Any], shown: Sequence[JobName]) -> dict[JobName, Job]:
    """Return a job for the cloud of each object and condition.

    Raises BadInput where the data set is not there.
    """
    conditions = dict.fromkeys(name.condition for name in shown if name.condition)
    objects = ("/".join(name.object) for name in shown)
    protocol = Protocol.from_manifest(manifest, (FLOOR,), conditions, objects)
    return {job.name._replace(method=""): job for job in plan(protocol).method_jobs}


def _sampled(job: Job) -> PointCloud | None:
    try:
        return cloud_under(job, job.condition)
    except (BadInput, StageFailure, OSError):  # the file has gone, or the condition has failed
        return None


OBJECTS_SHOWN = 4  # objects of a single class; of several classes one object of each is shown
_MOST_ACROSS = 8  # methods side by side; more stand below each other
_MOST_CASES = 240  # worst and best images on the page, which make up most of its bytes
EACH = 2  # worst images, and best ones, of a method at a condition; fewer where there are many
CLOUD, TRUTH = "cloud", "truth"  # heads of the columns of clouds and of true images


def shown_objects(records: pd.DataFrame) -> list[tuple[str, str]]:
    """Return the first objects with images as (class, object), not chosen by their looks."""
    ok = records[records["outcome"] == "ok"]
    pairs = ok[["class", "object"]].drop_duplicates().sort_values(["class", "object"])
    classes = pairs["class"].nunique()
    first = pairs.groupby("class", sort=True).head(OBJECTS_SHOWN if classes == 1 else 1)
    return [(str(c), str(o)) for c, o in zip(first["class"], first["object"], strict=True)]


def extremes(records: pd.DataFrame, metric: str) -> pd.DataFrame:
    """Return the worst and the best records, by a metric, of each method and condition.

    Up to EACH of both kinds are taken of each competing method under each condition, and of each
    class where these are few. Failed images have no part.

    Rows are in the order of the records' methods and conditions; their column `kind` is "worst" or
    "best". Of an object only its worst or best view is taken; a record is not both.
    """
    competing = rivals(dict.fromkeys(records["method"]))
    ok = records[(records["outcome"] == "ok") & records["method"].isin(competing)]
    ok = ok.dropna(subset=[column(metric)])
    keys = ["method", "condition"]
    groups = len(ok[[*keys, "class"]].drop_duplicates())
    # A worst and a best record of each class, where these are not too many; else of all classes.
    by_class = 2 * groups <= _MOST_CASES
    each = 1
    if by_class and groups:
        each = max(1, min(EACH, _MOST_CASES // (2 * groups)))
    extremes = []
    for _, group in ok.groupby([*keys, "class"] if by_class else keys, sort=False):
        order = [column(metric), "class", "object", "view"]
        rising = group.sort_values(
            order, ascending=[higher_is_better(metric), True, True, True], kind="stable"
        )
        worst = rising.drop_duplicates(["class", "object"]).head(each)
        rest = rising.drop(worst.index)
        best = rest.iloc[::-1].drop_duplicates(["class", "object"]).head(each)
        extremes += [worst.assign(kind="worst"), best.assign(kind="best")]
    if not extremes:
        return ok.assign(kind="")
    rank = {method: i for i, method in enumerate(competing)}
    together = pd.concat(extremes)
    return together.iloc[together["method"].map(rank).argsort(kind="stable")]


def grids(images: pd.DataFrame, sources: Sources, metric: str) -> list[dict[str, Any]]:
    """Return a grid for each of the first objects: the first view by each method and condition.

    A cell is (image, text beneath it), the text being the value by a metric or why there is no
    image; an image is (data URI, or "" without one, what it shows).
    """
    methods = rivals(dict.fromkeys(images["method"]))
    conditions = list(dict.fromkeys(map(str, images["condition"])))
    first = images[images["view"] == 0]
    sheets = []
    for class_name, obj in shown_objects(images):
        of_object = first[(first["class"] == class_name) & (first["object"] == obj)]
        record_of = {(row["method"], row["condition"]): row for row in row_mappings(of_object)}
        if not record_of:
            continue
        view, name = _view(next(iter(record_of.values()))), f"{class_name} {obj}"
        rows = []
        for condition in conditions:
            item = JobName(GROUND_TRUTH, condition, class_name, obj)
            cells = [
                (_cloud(sources, item, view, f"the cloud at {condition}, {name}"), "", CLOUD),
                (_drawn(sources, item.truth, 0, f"the truth, {name}"), "", TRUTH),
            ]
            for method in methods:
                record = record_of.get((method, condition))
                of_method = item._replace(method=method)
                cells.append((*_grid_cell(sources, of_method, record, metric), ""))
            rows.append(cells)
        down, across = conditions, [CLOUD, TRUTH, *methods]
        methods_down = len(methods) > _MOST_ACROSS
        if methods_down:
            down, across, rows = across, down, list(zip(*rows, strict=True))
        direction = f"azimuth {view.azimuth_deg:.0f}°, elevation {view.elevation_deg:.0f}°"
        sheets.append(
            {
                "title": name,
                "description": f"View 0: {direction}",
                "columns": across,
                "rows": list(zip(down, rows, strict=True)),
                "corner": "method" if methods_down else "condition",
            }
        )
    return sheets


def _grid_cell(
    sources: Sources, item: JobName, record: Mapping[str, Any] | None, metric: str
) -> tuple[tuple[str, str], str]:
    """Return the cell of a job as `grids`; `record` is that of its first view, None without one."""
    what = f"{item.method} at {item.condition}, {item.class_name} {item.object_id}"
    if record is None:
        return ("", f"{what}: not measured"), "not measured"
    if record["outcome"] != "ok":
        description = f"{record['outcome']}: {record['reason']}"
        return ("", f"{what}: {description}"), description
    score = _score(record, metric)
    return _drawn(sources, item, 0, f"{what}: {metric} {score}"), score


def _score(record: Mapping[str, Any], metric: str) -> str:
    return number_text(record[column(metric)], decimals(metric))


def cases(chosen: pd.DataFrame, sources: Sources, metric: str) -> list[dict[str, Any]]:
    """Return the cases that `extremes` has chosen, by method, with their clouds and true images.

    A group has the `method`, a `summary` of its values, and `rows` of (condition, and class where
    several are shown; cases).
    """
    several = chosen["class"].nunique() > 1
    groups = []
    for method, of_method in chosen.groupby("method", sort=False):
        counts = of_method.groupby(["condition", "kind"])["class"].nunique()
        by_class = several and bool((counts > 1).any())
        keys = ["condition", "class"] if by_class else ["condition"]
        ends = sorted(
            of_method[column(metric)].agg(["min", "max"]), reverse=not higher_is_better(metric)
        )
        worst, best = (number_text(end, decimals(metric)) for end in ends)
        summary = f"{metric} {worst} at worst, {best} at best"
        rows = []
        for names, of_row in of_method.groupby(keys, sort=False):
            of_names = [_case(record, sources, metric) for record in row_mappings(of_row)]
            rows.append((", ".join(map(str, names)), of_names))
        groups.append({"method": method, "summary": summary, "rows": rows})
    return groups


def _case(record: Mapping[str, Any], sources: Sources, metric: str) -> dict[str, Any]:
    """Return what the page shows of a worst or best record."""
    class_name, obj, view = record["class"], record["object"], record["view"]
    item = JobName(record["method"], record["condition"], class_name, obj)
    name = f"{class_name} {obj}, view {view}"
    at = _view(record)
    facts = {"azimuth, elevation": f"{at.azimuth_deg:.1f}°, {at.elevation_deg:.1f}°"}
    for part in ("prepare", "draw"):
        if math.isfinite(seconds := record[f"{part}_s"]):
            facts[part] = f"{1000 * seconds:.1f} ms"
    if record["notes"]:
        facts["notes"] = record["notes"]
    images = (
        (CLOUD, _cloud(sources, item, at, f"the cloud of {name}")),
        (TRUTH, _drawn(sources, item.truth, view, f"the truth of {name}")),
        ("drawn", _drawn(sources, item, view, f"{name} as {item.method} draws it")),
    )
    score = f"{metric} {_score(record, metric)}"
    return {"kind": record["kind"], "score": score, "name": name, "facts": facts, "images": images}


def _view(record: Mapping[str, Any]) -> View:
    return View(record["azimuth_deg"], record["elevation_deg"])


def _drawn(sources: Sources, item: JobName, view: int, description: str) -> tuple[str, str]:
    """Return an image of a job as data URI, with its description; "" where it is missing."""
    images = sources.images(item)
    if images is None or view >= len(images):
        return "", f"{description}; the image is no longer there"
    return data_uri(images[view]), description


def _cloud(sources: Sources, item: JobName, view: View, description: str) -> tuple[str, str]:
    """Return the cloud of a job in dots as data URI, with its description; "" without a cloud."""
    cloud = sources.cloud(item)
    if cloud is None:
        return "", f"{description}; it cannot be made again"
    return data_uri(draw_dots(cloud.points, [view])[0]), description


def data_uri(image: NDArray[np.uint8]) -> str:
    """Return an image [H, W, 3] as the data URI of a lossless WebP."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "WEBP", lossless=True, quality=100, method=2)
    return "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode()
