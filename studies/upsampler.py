"""Scores of the up-sampler on validation objects, which show the progress of its training.

    python -m studies.upsampler NAME [--weights FILE] [--losses training/upsampler/losses.csv]
    python -m studies.upsampler NAME --opponent METHOD

The first command adds a line with this name to `baselines/upsampler/weights/log.csv`. It has the
means of the last 50 lines of losses.csv, and the scores of the images of upsampled-wrap. For the
points that the network adds to a cloud, sixteen for each, it has the mean distance from the true
surface, in thousandths of the object's radius, and the mean angle between their normals and the
true ones, in degrees. The second command adds a line with the scores of another method, for the
same clouds and views.

The objects are two of each class of `procedural:validation`, with four views each; the true images
are in grey.
"""

from __future__ import annotations

import argparse
import csv
import io
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from baselines.reconstruction.denoised import MOST_POINTS
from baselines.reconstruction.stages import used_points
from baselines.reconstruction.surface import NORMAL_NEIGHBOURS
from baselines.upsampler.data import nearest_on_surface
from baselines.upsampler.projection import LearnedSurface
from baselines.upsampler.renderer import UpsampledWrapRenderer
from bench.catalogue.conditions import find_condition
from bench.catalogue.methods import find_method
from bench.metrics.lpips_network import lpips
from bench.metrics.structural_similarity import ssim_per_image
from bench.tables.table import csv_text
from data_prep.datasets.objects import GreyObject, SceneObject
from data_prep.datasets.registry import open_dataset
from data_prep.files.atomic_write import write_whole
from data_prep.randomness import generator
from data_prep.rendering.images import to_uint8
from data_prep.scene import PointCloud

CONDITIONS = ("2048", "512", "noise-0.05", "noise-0.10")
OBJECTS, VIEWS = 2, 4  # objects of each class, and views of each object
FOR_ONE = 16  # points that the network adds around each point of a cloud
LOG = Path(__file__).resolve().parents[1] / "baselines" / "upsampler" / "weights" / "log.csv"
_TRAINING = ("steps", "distance", "normals", "validation")
_MEASURED = ("points", "degrees", "ssim", "lpips")
COLUMNS = ("name", *_TRAINING, *(f"{m} {c}" for c in CONDITIONS for m in _MEASURED))
# Last lines of losses.csv whose means are taken. A line has the losses of one step, of every tenth.
_LAST = 50


def validation_objects() -> Iterator[SceneObject]:
    """Yield the validation objects, whose true images are in grey."""
    dataset = open_dataset("procedural:validation")
    for name in dataset.classes:
        for obj in dataset.objects(name, OBJECTS, OBJECTS, "validation"):
            yield GreyObject(obj)


def measured(method_id: str, objects: Iterable[SceneObject]) -> dict[str, float]:
    """Return the mean scores of a method, by column of the log.

    For upsampled-wrap these include the errors of the points that its network adds.

    Raises StageFailure where the method fails on one of the objects.
    """
    renderer = find_method(method_id).load("cpu")
    rows: dict[str, list[float]] = {}
    for obj in objects:
        key = (obj.class_name, obj.object_id)
        views = obj.views(VIEWS, generator("validation views", *key))
        whole, truth = obj.cloud_and_truth(generator("validation cloud", *key), views)
        for name in CONDITIONS:
            rng = generator("validation condition", name, *key)
            cloud = find_condition(name).perturbation.apply(whole, rng)
            images = to_uint8(renderer.draw(renderer.prepare(cloud, rng), views, rng))
            scores = {
                "ssim": float(ssim_per_image(images, truth).ssim.mean()),
                "lpips": float(lpips(images, truth, single=True).mean()),
            }
            if isinstance(renderer, UpsampledWrapRenderer):
                scores |= of_points(renderer, cloud, obj, rng)
            for measure, value in scores.items():
                rows.setdefault(f"{measure} {name}", []).append(value)
    return {column: float(np.mean(values)) for column, values in rows.items()}


def of_points(
    renderer: UpsampledWrapRenderer, cloud: PointCloud, obj: SceneObject, rng: np.random.Generator
) -> dict[str, float]:
    """Return the mean errors of the points that the network adds to a cloud.

    They are the distance from the surface of the object, and the angle between normals there.
    """
    points, _ = used_points(cloud, NORMAL_NEIGHBOURS + 1, MOST_POINTS, "surfaces")
    dense = LearnedSurface(renderer.network, points).upsampled(FOR_ONE)
    mesh = obj.load()
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    places = dense.points.astype(np.float64)
    nearest, normals = nearest_on_surface(corners, places, rng)
    cosine = np.abs((dense.normals * normals).sum(axis=1)).clip(0, 1)
    away = np.linalg.norm(places - nearest, axis=1)
    return {"points": 1000 * away.mean(), "degrees": np.degrees(np.arccos(cosine)).mean()}


def with_line(text: str, line: dict[str, Any]) -> str:
    """Return the text of the log with a line, which replaces one of the same name."""
    rows = {row["name"]: row for row in csv.DictReader(io.StringIO(text))}
    rows[line["name"]] = {column: _short(line.get(column, "")) for column in COLUMNS}
    return csv_text(COLUMNS, (row.values() for row in rows.values()))


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def last_losses(path: Path) -> dict[str, Any]:
    """Return the number of steps of a training, and the means of its last losses by name."""
    losses = pd.read_csv(path)
    last = losses.tail(_LAST)
    means = {name: float(last[name].mean()) for name in _TRAINING[1:]}
    return {"steps": int(losses["step"].iloc[-1]), **means}


def main() -> None:
    """Measure a network or another method, and add a line to the log."""
    assert __doc__
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name")
    parser.add_argument("--weights", type=Path)
    parser.add_argument("--losses", type=Path)
    parser.add_argument("--opponent")
    given = parser.parse_args()
    upsampled = f"upsampled-wrap@{given.weights}" if given.weights else "upsampled-wrap"
    training = last_losses(given.losses) if given.losses else {}
    line = {
        "name": given.name,
        **training,
        **measured(given.opponent or upsampled, validation_objects()),
    }
    before = LOG.read_text(encoding="utf-8") if LOG.exists() else ""
    write_whole(LOG, with_line(before, line).encode())
    print(csv_text(COLUMNS, [[_short(line.get(column, "")) for column in COLUMNS]]))


if __name__ == "__main__":
    main()
