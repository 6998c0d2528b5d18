"""The change of the cells of Table 5 from one machine to another.

    python -m studies.class_noise [--objects 10] [--views 10]

Golden values of the suite `thirteen-classes` need tolerances of their own: its metrics are partly
others than those of chairs, and so are its shapes. Objects of the validation split, at `2048`,
measured twice with one thing changed:

turn      every view by 0.1 degree more of azimuth, true and drawn images alike, as another driver
          samples edges elsewhere (`studies.noise_floor`).
rounding  one point in fifty moved by one rounding error, as another processor rounds elsewhere:
          for reconstructions, where it decides about a spike.

For each method and metric: the largest move of a class, and that of the mean over classes; for
rounding also the standard deviation of an object's move, largest class, for what is a mean over
objects. About five minutes on one thread.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analysis.recognition import read_class_head
from bench.catalogue.methods import find_method
from bench.catalogue.metrics import column
from bench.judges import VIEWS_WEIGHTS
from bench.judges.views import load_views_network, view_features
from bench.metrics.frechet import frechet_distance
from bench.metrics.image_scores import scores
from bench.metrics.kernel_distance import kernel_distance
from data_prep.clouds.sampling import random_views, sample_surface
from data_prep.datasets.registry import ProceduralObject
from data_prep.randomness import generator
from data_prep.scene import PointCloud
from data_prep.shapes.catalogue import CLASSES
from studies.images import draw_all, render_all, turned
from studies.tables import markdown

TURNED = ("pc2pix@all", "pc2pix", "splat", "blank")
ROUNDED = ("surface-apss", "surface-fit")
MEANS = ("ssim", "luminance", "contrast", "structure", "silhouette-iou", "class-confidence")
CELL = ["change", "method", "metric"]
ONE_IN = 50


@dataclass(frozen=True, eq=False)
class ClassImages:
    """The images [N, V, H, W, 3] of the objects of a class, and their true ones."""

    class_name: str
    truth: NDArray[np.uint8]
    drawn: NDArray[np.uint8]


class Measure:
    """The metrics of Table 5, applied to samples."""

    def __init__(self) -> None:
        self.network = load_views_network(VIEWS_WEIGHTS)
        self.head = read_class_head(VIEWS_WEIGHTS)

    def objects(self, sample: ClassImages) -> dict[str, NDArray[np.float64]]:
        """Return the metrics that are means, for each object [N]."""
        per_object = [scores(t, d) for t, d in zip(sample.truth, sample.drawn, strict=True)]
        confidence = self.head.confidence(self._features(sample.drawn), sample.class_name)
        by_object = confidence.reshape(sample.drawn.shape[:2]).mean(axis=1)
        return {
            metric: by_object
            if metric == "class-confidence"
            else np.array([scored[column(metric)].mean() for scored in per_object])
            for metric in MEANS
        }

    def distances(self, sample: ClassImages) -> dict[str, float]:
        """Return the distances of the set."""
        x, y = self._features(sample.truth), self._features(sample.drawn)
        return {"fd-views": frechet_distance(x, y), "kd-views": kernel_distance(x, y)}

    def _features(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        return view_features(self.network, images.reshape(-1, *images.shape[2:]))


def nudged(cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    """Return the cloud with one point in `ONE_IN` moved by one rounding error an axis."""
    points = cloud.points.copy()
    chosen = rng.random(len(points)) < 1 / ONE_IN
    points[chosen] = np.nextafter(points[chosen], np.float32(np.inf))
    return replace(cloud, points=points)


def pairs(class_name: str, objects: int, views: int) -> dict[tuple[str, str], list[ClassImages]]:
    """Return by change and method the sample as it is, and changed."""
    seen = [random_views(views, generator("class noise", class_name, i)) for i in range(objects)]
    meshes = [ProceduralObject(class_name, "validation", i).load() for i in range(objects)]
    clouds = [
        sample_surface(mesh, generator("class noise", "cloud", class_name, i))
        for i, mesh in enumerate(meshes)
    ]
    farther = [turned(of_object) for of_object in seen]
    truth, truth_turned = render_all(meshes, seen), render_all(meshes, farther)
    samples: dict[tuple[str, str], list[ClassImages]] = {}
    for method in TURNED + ROUNDED:
        renderer = find_method(method).load("cpu")
        plain = ClassImages(class_name, truth, draw_all(renderer, clouds, seen))
        if method in TURNED:
            again = ClassImages(class_name, truth_turned, draw_all(renderer, clouds, farther))
            samples["turn", method] = [plain, again]
        else:
            rng = generator("class noise", "nudge", class_name)
            others = [nudged(cloud, rng) for cloud in clouds]
            again = ClassImages(class_name, truth, draw_all(renderer, others, seen))
            samples["rounding", method] = [plain, again]
    return samples


def moves(class_name: str, objects: int, views: int, measure: Measure) -> list[dict[str, object]]:
    """Return a row for each method and metric: value, move of the cell, deviation of an object."""
    rows: list[dict[str, object]] = []
    for (change, method), (plain, changed) in pairs(class_name, objects, views).items():
        where: dict[str, object] = {"change": change, "method": method, "class": class_name}
        before, after = measure.objects(plain), measure.objects(changed)
        for metric, values in before.items():
            by = after[metric] - values
            rows.append(where | {"metric": metric, "value": values.mean(), "by": by.mean(),
                                 "deviation": by.std(ddof=1)})  # fmt: skip
        first, second = measure.distances(plain), measure.distances(changed)
        for metric, value in first.items():
            rows.append(where | {"metric": metric, "value": value, "by": second[metric] - value})
    return rows


def summary(rows: pd.DataFrame) -> str:
    """Return the largest move of a class, of the mean over classes, and relative to the cell."""
    table = rows.assign(size=rows["by"].abs(), share=(rows["by"] / rows["value"]).abs())
    by = table.groupby(CELL, sort=False)
    largest = pd.DataFrame(
        {
            "largest class": by["size"].max(),
            "of itself": by["share"].max(),
            "average": by["by"].mean().abs(),
            "deviation of an object": by["deviation"].max(),
        }
    )
    rows_of_table = [
        [*names, *("-" if np.isnan(value) else f"{value:.2g}" for value in values)]
        for names, values in zip(largest.index, largest.to_numpy(), strict=True)
    ]
    return markdown([*CELL, *largest.columns], rows_of_table, left=len(CELL))


def main() -> None:
    """Run the study from the command line."""
    import torch

    parser = argparse.ArgumentParser(description="How far the cells of Table 5 move by little.")
    parser.add_argument("--objects", type=int, default=10)
    parser.add_argument("--views", type=int, default=10)
    options = parser.parse_args()
    torch.set_num_threads(1)
    measure = Measure()
    rows = [r for n in CLASSES for r in moves(n, options.objects, options.views, measure)]
    print(summary(pd.DataFrame(rows)), end="")


if __name__ == "__main__":
    main()
