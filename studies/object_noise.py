"""The move of what is measured of single objects, and of classes, from one machine to another.

    python -m studies.object_noise chairs [--objects 24] [--views 20] [--conditions 2048,noise-0.10]
    python -m studies.object_noise classes [--objects 10] [--views 10]

Golden values by object, and those of the suite `thirteen-classes`, need tolerances of their own: a
mean over 24 chairs moves less than one of them, and classes have other metrics and shapes. Objects
of the validation split (of classes at `2048`), measured twice with one thing changed:

turn      every view by 0.1 degree more of azimuth, true and drawn images alike, as another driver
          samples edges elsewhere (`studies.noise_floor`).
rounding  one point in fifty moved by one rounding error, as another processor rounds elsewhere:
          for reconstructions, where it decides about a spike.

`chairs`: for each method and metric, over all chairs and conditions, the standard deviation of a
chair's move around zero, and the two largest. About ten minutes on one thread.

`classes`: for each method and metric the largest move of a class, and that of the mean over
classes; for rounding also the standard deviation of an object's move, largest class, for what is a
mean over objects. About five minutes on one thread.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analysis.recognition import read_class_head
from bench.catalogue.methods import find_method
from bench.catalogue.metrics import IMAGE_METRICS, column
from bench.judges import VIEWS_WEIGHTS
from bench.judges.views import load_views_network, view_features
from bench.metrics.frechet import frechet_distance
from bench.metrics.image_scores import scores
from bench.metrics.kernel_distance import kernel_distance
from data_prep.clouds.sampling import random_views, sample_surface
from data_prep.datasets.registry import ProceduralObject
from data_prep.randomness import generator
from data_prep.scene import PointCloud, UInt8Images
from data_prep.shapes.catalogue import CLASSES
from studies.cells import ChairSet, finite_mean, make_chairs
from studies.images import all_scores, draw_all, render_all, turned
from studies.tables import markdown

TURN, ROUNDING = "turn", "rounding"
OF_CHAIRS = {
    TURN: ("pc2pix", "pc2pix@acgan", "splat-net@chair", "splat", "constant", "blank"),
    ROUNDING: ("surface-apss",),
}
OF_CLASSES = {
    TURN: ("pc2pix@all", "pc2pix", "splat", "blank"),
    ROUNDING: ("surface-apss", "surface-fit"),
}
MEANS = ("ssim", "luminance", "contrast", "structure", "silhouette-iou", "class-confidence")
CELL = ["change", "method", "metric"]
ONE_IN = 50

Moves = dict[tuple[str, str, str], NDArray[np.float64]]  # by change, method and metric: [chairs]


class ObjectImages(NamedTuple):
    """Images [N, V, H, W, 3] of objects by a method, and their true ones."""

    truth: UInt8Images
    drawn: UInt8Images


def nudged(cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    """Return the cloud with one point in `ONE_IN` moved by one rounding error an axis."""
    points = cloud.points.copy()
    chosen = rng.random(len(points)) < 1 / ONE_IN
    points[chosen] = np.nextafter(points[chosen], np.float32(np.inf))
    return replace(cloud, points=points)


def samples(
    scene: ChairSet, rng: np.random.Generator, methods: Mapping[str, Sequence[str]]
) -> Iterator[tuple[str, str, ObjectImages, ObjectImages]]:
    """Yield each change and method with the objects as they are, and changed."""
    farther = [turned(of_object) for of_object in scene.views]
    truth, truth_turned = (render_all(scene.meshes, views) for views in (scene.views, farther))
    others = [nudged(cloud, rng) for cloud in scene.clouds]
    for change, changed_methods in methods.items():
        for method in changed_methods:
            renderer = find_method(method).load("cpu")
            before = ObjectImages(truth, draw_all(renderer, scene.clouds, scene.views))
            if change == TURN:
                after = ObjectImages(truth_turned, draw_all(renderer, scene.clouds, farther))
            else:
                after = ObjectImages(truth, draw_all(renderer, others, scene.views))
            yield change, method, before, after


def means(sample: ObjectImages) -> dict[str, NDArray[np.float64]]:
    """Return image metrics as means over a chair's views, [chairs].

    The means are over views that have a value; NaN where none has one.
    """
    scored = [all_scores(t, d) for t, d in zip(*sample, strict=True)]
    return {
        metric: np.array(
            [finite_mean(scores_of_chair[column(metric)]) for scores_of_chair in scored]
        )
        for metric in IMAGE_METRICS
    }


def moves_of_chairs(
    scene: ChairSet, condition: str, methods: Mapping[str, Sequence[str]] = OF_CHAIRS
) -> Moves:
    """Return how far the values of each chair move."""
    rng = generator("object noise", "nudge", condition)
    differences: Moves = {}
    for change, method, plain, changed in samples(scene, rng, methods):
        before, after = means(plain), means(changed)
        for metric in IMAGE_METRICS:
            differences[change, method, metric] = after[metric] - before[metric]
    return differences


def summary_of_chairs(moves: Moves) -> str:
    """Return a Markdown table with a line for each method and a column for each metric.

    A cell has the deviation, the largest and the second largest move.
    """
    rows = []
    for change, method in dict.fromkeys(key[:2] for key in moves):
        cells = []
        for metric in IMAGE_METRICS:
            values = moves[change, method, metric]
            size = np.sort(np.abs(values[np.isfinite(values)]))
            if len(size) < 2:
                cells.append("-")
                continue
            deviation = np.sqrt(np.mean(size**2))
            cells.append(f"{deviation:.2g}, {size[-1]:.2g}, {size[-2]:.2g}")
        rows.append([change, method, *cells])
    return markdown(["change", "method", *IMAGE_METRICS], rows, left=2)


class ClassMeasure:
    """The metrics of Table 5, applied to objects of a class."""

    def __init__(self) -> None:
        self.network = load_views_network(VIEWS_WEIGHTS)
        self.head = read_class_head(VIEWS_WEIGHTS)

    def objects(self, class_name: str, sample: ObjectImages) -> dict[str, NDArray[np.float64]]:
        """Return the metrics that are means, for each object [N]."""
        per_object = [scores(t, d) for t, d in zip(*sample, strict=True)]
        confidence = self.head.confidence(self._features(sample.drawn), class_name)
        by_object = confidence.reshape(sample.drawn.shape[:2]).mean(axis=1)
        return {
            metric: by_object
            if metric == "class-confidence"
            else np.array([scored[column(metric)].mean() for scored in per_object])
            for metric in MEANS
        }

    def distances(self, sample: ObjectImages) -> dict[str, float]:
        """Return the distances of the set."""
        x, y = self._features(sample.truth), self._features(sample.drawn)
        return {"fd-views": frechet_distance(x, y), "kd-views": kernel_distance(x, y)}

    def _features(self, images: UInt8Images) -> NDArray[np.float32]:
        return view_features(self.network, images.reshape(-1, *images.shape[2:]))


def make_class(class_name: str, objects: int, views: int) -> ChairSet:
    """Return the first validation objects of a class."""
    meshes = tuple(ProceduralObject(class_name, "validation", i).load() for i in range(objects))
    return ChairSet(
        meshes,
        tuple(
            sample_surface(mesh, generator("class noise", "cloud", class_name, i))
            for i, mesh in enumerate(meshes)
        ),
        tuple(random_views(views, generator("class noise", class_name, i)) for i in range(objects)),
    )


def moves_of_class(
    class_name: str, objects: int, views: int, measure: ClassMeasure
) -> list[dict[str, object]]:
    """Return a row for each method and metric: value, move of the cell, deviation of an object."""
    scene = make_class(class_name, objects, views)
    rng = generator("class noise", "nudge", class_name)
    rows: list[dict[str, object]] = []
    for change, method, plain, changed in samples(scene, rng, OF_CLASSES):
        where: dict[str, object] = {"change": change, "method": method, "class": class_name}
        before, after = measure.objects(class_name, plain), measure.objects(class_name, changed)
        for metric, values in before.items():
            by = after[metric] - values
            rows.append(where | {"metric": metric, "value": values.mean(), "by": by.mean(),
                                 "deviation": by.std(ddof=1)})  # fmt: skip
        first, second = measure.distances(plain), measure.distances(changed)
        for metric, value in first.items():
            rows.append(where | {"metric": metric, "value": value, "by": second[metric] - value})
    return rows


def summary_of_classes(rows: pd.DataFrame) -> str:
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

    parser = argparse.ArgumentParser(description="How far values of objects move by little.")
    parser.add_argument("of", choices=("chairs", "classes"))
    parser.add_argument("--objects", type=int, help="24 chairs, 10 of a class")
    parser.add_argument("--views", type=int, help="20 of a chair, 10 of others")
    parser.add_argument("--conditions", default="2048,noise-0.10", help="of chairs")
    options = parser.parse_args()
    torch.set_num_threads(1)
    if options.of == "classes":
        measure = ClassMeasure()
        objects, views = options.objects or 10, options.views or 10
        rows = [row for n in CLASSES for row in moves_of_class(n, objects, views, measure)]
        print(summary_of_classes(pd.DataFrame(rows)), end="")
        return
    by_condition = [
        moves_of_chairs(
            make_chairs(options.objects or 24, options.views or 20, 0, condition), condition
        )
        for condition in options.conditions.split(",")
    ]
    together = {
        key: np.concatenate([moved[key] for moved in by_condition]) for key in by_condition[0]
    }
    print(summary_of_chairs(together), end="")


if __name__ == "__main__":
    main()
