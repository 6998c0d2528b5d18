"""Scores of reconstructions with other constants, on validation objects.

    python -m studies.reconstruction_constants OUT.csv wrap:2:0.005 alpha:2 poisson [--chairs 60]
        [--others 26] [--conditions 2048,512] [--seconds 540]
    python -m studies.reconstruction_constants OUT.csv --baseline wrap:2:0.005

A setting is `wrap:BALL:OFFSET`, `alpha:BALL` or `poisson:DEPTH` on the smoothed cloud, which is
computed once for all of them, or the id of a method. Balls are in spacings of the cloud. Each
object has the cloud and the views (four) that a run with seed 0 gives it.

Rows that OUT.csv has are kept; after `--seconds` the command ends, and the same command goes on.
Without settings it prints the table of what is there, as differences to `--baseline`.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from baselines.reconstruction.alpha_shape import alpha_mesh
from baselines.reconstruction.alpha_wrap import wrapped
from baselines.reconstruction.denoised import Cleaned, cleaned
from baselines.reconstruction.poisson import trimmed_poisson
from bench.catalogue.lookup import find
from bench.catalogue.methods import find_method
from bench.metrics.lpips_network import Activations, Lpips, load_lpips
from bench.metrics.lpips_weights import find_lpips_weights
from bench.metrics.structural_similarity import ssim_per_image
from data_prep.clouds.conditions import CONDITIONS
from data_prep.datasets.grey import grey
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.registry import open_dataset
from data_prep.failures import StageFailure
from data_prep.randomness import generator
from data_prep.rendering.mesh import draw_mesh
from data_prep.rendering.opengl import render
from data_prep.scene import Mesh, PointCloud, UInt8Images, View
from studies.arguments import names

CONDITIONS_MEASURED = ("2048", "1024", "512", "noise-0.05", "noise-0.10")
VIEWS = 4
COLUMNS = (
    *("class", "object", "condition", "setting", "faces", "seconds"),
    *("ssim", "lpips", "ssim_grey", "lpips_grey"),
)


@dataclass(frozen=True)
class ScoredObject:
    """An object with its views and true images, in colour and in grey."""

    object: SceneObject
    views: tuple[View, ...]
    truth: tuple[UInt8Images, UInt8Images]
    encoded: tuple[Activations, Activations]

    @property
    def names(self) -> tuple[str, str]:
        """Return class and id of the object."""
        return self.object.class_name, self.object.object_id

    def cloud(self, condition: str) -> PointCloud:
        """Return the perturbed cloud that a run with seed 0 has."""
        sampled = self.object.cloud(generator(0, "cloud", *self.names))
        perturbation = find(condition, CONDITIONS, "condition").perturbation
        return PointCloud(perturbation.apply(sampled, generator(0, condition, *self.names)).points)


def scene_of(obj: SceneObject, network: Lpips) -> ScoredObject:
    """Return the scene of an object, with the views that a run with seed 0 has."""
    views = obj.views(VIEWS, generator(0, "views", obj.class_name, obj.object_id))
    mesh = obj.load()
    coloured, unpainted = render(mesh, views), render(grey(mesh), views)
    encoded = network.encode(coloured), network.encode(unpainted)
    return ScoredObject(obj, views, (coloured, unpainted), encoded)


def validation_objects(chairs: int, others: int) -> list[SceneObject]:
    """Return the first chairs and the first others of all classes in turn, evenly mixed."""
    dataset = open_dataset("procedural:validation")
    classes = [name for name in dataset.classes if name != "chair"]
    rounds = -(-others // len(classes))
    by_class = [dataset.objects(name, rounds, rounds) for name in classes] if rounds else []
    kinds = [
        dataset.objects("chair", chairs, chairs) if chairs else (),
        [obj for of_round in zip(*by_class, strict=True) for obj in of_round][:others],
    ]
    placed = [((i + 0.5) / len(kind), obj) for kind in kinds for i, obj in enumerate(kind)]
    return [obj for _, obj in sorted(placed, key=lambda pair: pair[0])]


class Clouds:
    """A cloud and the smoothed one, which is computed once where a setting needs it."""

    def __init__(self, cloud: PointCloud) -> None:
        self.cloud = cloud

    @cached_property
    def clean(self) -> Cleaned:
        """Return the cloud as the denoised methods have it."""
        return cleaned(self.cloud, 1.0)

    def mesh(self, setting: str) -> Mesh:
        """Return the mesh by a setting. Raises StageFailure as the method does."""
        kind, *constants = setting.split(":")
        clean = self.clean
        values = [
            float(text) if text[0] != "s" else float(text[1:]) * clean.spacing for text in constants
        ]
        match kind, values:
            case "wrap", [ball, offset]:
                return wrapped(clean.points, ball * clean.spacing, offset).mesh
            case "alpha", [ball]:
                return alpha_mesh(clean.points, ball * clean.spacing)
            case "poisson", [depth]:
                return trimmed_poisson(clean.points, int(depth)).mesh
        renderer = find_method(setting).load("cpu")
        return renderer.prepare(self.cloud, np.random.default_rng(0)).mesh


def row(
    scene: ScoredObject, clouds: Clouds, condition: str, setting: str, network: Lpips
) -> tuple[object, ...]:
    """Return the values of `COLUMNS`, means over the views; a failure is a white image."""
    start = time.perf_counter()
    try:
        mesh = clouds.mesh(setting)
    except StageFailure:
        mesh = None
    seconds = time.perf_counter() - start
    white = np.full_like(scene.truth[0], 255)
    images = draw_mesh(mesh, scene.views) if mesh else white
    drawn, scores = network.encode(images), []
    for truth, encoded in zip(scene.truth, scene.encoded, strict=True):
        scores += [ssim_per_image(truth, images).ssim, network.distance(encoded, drawn)]
    means = (float(np.mean(score)) for score in scores)
    return (*scene.names, condition, setting, len(mesh.faces) if mesh else 0, seconds, *means)


def measure(
    objects: Sequence[SceneObject],
    conditions: Sequence[str],
    settings: Sequence[str],
    done: set[tuple[str, ...]],
) -> Iterator[tuple[object, ...]]:
    """Yield the rows that are not `done`, keys of class, object, condition and setting."""
    network = load_lpips(find_lpips_weights())
    for obj in objects:
        names_of = (obj.class_name, obj.object_id)
        missing = [(c, s) for c in conditions for s in settings if (*names_of, c, s) not in done]
        scene = scene_of(obj, network) if missing else None
        for condition in dict.fromkeys(condition for condition, _ in missing):
            assert scene is not None
            clouds = Clouds(scene.cloud(condition))
            _ = clouds.clean  # its time is not a setting's
            for setting in [s for c, s in missing if c == condition]:
                yield row(scene, clouds, condition, setting, network)


def table(rows: pd.DataFrame, baseline: str | None) -> str:
    """Return means over objects by setting and condition, or differences to a setting."""
    values = list(COLUMNS[4:])
    key = ["class", "object", "condition"]
    if baseline:
        base = rows[rows.setting == baseline].set_index(key)[values]
        rows = rows.set_index([*key, "setting"])[values].sub(base).dropna().reset_index()
    grouped = rows.groupby(["condition", "setting"])[values]
    return grouped.mean().join(grouped.size().rename("objects")).round(4).to_string()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("settings", nargs="*")
    parser.add_argument("--chairs", type=int, default=60)
    parser.add_argument("--others", type=int, default=26)
    parser.add_argument("--conditions", type=names, default=CONDITIONS_MEASURED)
    parser.add_argument("--seconds", type=float, default=540.0)
    parser.add_argument("--baseline")
    given = parser.parse_args()
    start = time.monotonic()
    fresh = not given.out.exists()
    with given.out.open("a+", newline="") as file:
        file.seek(0)
        done = {tuple(line[:4]) for line in csv.reader(file)}
        writer = csv.writer(file)
        if fresh:
            writer.writerow(COLUMNS)
        objects = validation_objects(given.chairs, given.others) if given.settings else []
        for values in measure(objects, given.conditions, given.settings, done):
            writer.writerow([round(v, 5) if isinstance(v, float) else v for v in values])
            file.flush()
            if time.monotonic() - start > given.seconds:
                break
    print(table(pd.read_csv(given.out), given.baseline))


if __name__ == "__main__":
    main()
