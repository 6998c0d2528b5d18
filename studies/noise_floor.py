"""The tolerances of golden values, from how far these move on another machine.

    python -m studies.noise_floor [cells] [--chairs 24] [--views 20] [--condition 2048]
    python -m studies.noise_floor chairs [--chairs 24] [--views 20] [--condition 2048,noise-0.10]

A cell is the value of one metric for one method, as tables of a run have it, over objects and views
of the validation split. It is measured again, with one thing changed at a time:

turn       The azimuth of every view is 0.1 degrees larger, for true and drawn images alike. This
           moves the rim of the unit sphere by 0.1 pixels, and stands for another driver, which
           samples edges at other places.
renderer   The true images are those of a ray-caster with the same camera and shading
           (`data_prep.rendering.raycast`), and not of OpenGL: once with the same 4 samples in a
           pixel, and once with their mirror image, which OpenGL also allows. The images of methods
           stay as they are. `true-mesh`, which draws by OpenGL, gets the ray-caster's images, and
           those of OpenGL are the truth.
rounding   One point in fifty is moved by one rounding error, as another processor may round. Only
           `chairs` does this, for reconstructions, where rounding decides whether there is a spike.

`cells` prints each cell with its moves, and the largest of them divided by the tolerance. This is
at most 0.33, because a tolerance is three times the largest effect, rounded up. `chairs` is for the
golden values of single objects, which move more than means over 24 chairs. It prints for each
method and metric, over all chairs and conditions, the standard deviation around zero of a chair's
move, and the two largest moves.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
import torch

from bench.catalogue.methods import find_method
from bench.catalogue.metrics import CONTROL_METRICS, IMAGE_METRICS, column
from bench.check.tolerances import tolerance
from data_prep.randomness import generator
from data_prep.rendering.raycast import OPENGL, cast
from data_prep.scene import PointCloud, UInt8Images
from studies.images import (
    METRICS,
    FeatureNetworks,
    SceneSet,
    all_scores,
    cells,
    draw_all,
    finite_mean,
    make_scene,
    render_all,
    turned,
)
from studies.tables import markdown

METHODS = ("pc2pix", "pc2pix@acgan", "splat", "constant", "blank")  # whose cells are measured
CEILING = "true-mesh"  # measured, too; its images are the true ones
# Places of the 4 samples in a pixel, mirrored: as good as those of OpenGL.
MIRRORED = tuple((column, 1 - row) for column, row in OPENGL)
# Names of what is changed.
TURN, ROUNDING = "turn", "rounding"
SAMPLES = {"renderer, same samples": OPENGL, "renderer, mirrored samples": MIRRORED}


# --- cells ----------------------------------------------------------------------------------------


class _Study:
    """The chairs, their cells without a change, and the networks that cells need."""

    def __init__(self, chairs: int, views: int, condition: str) -> None:
        self.encode = FeatureNetworks()
        self.scene = make_scene("chair", chairs, views, 0, condition)
        self.truth = render_all(self.scene.meshes, self.scene.views)
        self.images = self.draw(self.scene) | {CEILING: self.truth}
        self.cells = self.measure(self.truth, self.images)

    def measure(
        self,
        truth: UInt8Images,
        images: Mapping[str, UInt8Images],
        scene: SceneSet | None = None,
    ) -> pd.DataFrame:
        """Return cells, with a row for each method and a column for each metric.

        truth   the true images
        images  those of each method
        scene   that they show; None for that of the study
        """
        views = (scene or self.scene).views
        of_truth = self.encode(truth)
        columns = {}
        for method, drawn in images.items():
            columns[method] = cells(truth, of_truth, drawn, self.encode(drawn), views)
        return pd.DataFrame(columns).T

    def draw(self, scene: SceneSet) -> dict[str, UInt8Images]:
        """Return the images of each method, with all views of a chair in one batch."""
        images = {}
        for method in METHODS:
            images[method] = draw_all(find_method(method).load("cpu"), scene.clouds, scene.views)
        return images

    def moves(self) -> dict[str, pd.DataFrame]:
        """Return how far each cell moves by each change, as frames like that of `measure`."""
        again = {TURN: self.turned()} | {name: self.cast(name) for name in SAMPLES}
        return {change: (moved - self.cells).abs() for change, moved in again.items()}

    def turned(self) -> pd.DataFrame:
        """Return the cells with turned views."""
        scene = self.scene._replace(views=tuple(map(turned, self.scene.views)))
        truth = render_all(scene.meshes, scene.views)
        return self.measure(truth, self.draw(scene) | {CEILING: truth}, scene)

    def cast(self, samples: str) -> pd.DataFrame:
        """Return the cells with true images of the ray-caster.

        Those of the ceiling compare the ray-caster's images with OpenGL's.

        samples  a key of SAMPLES
        """
        pairs = zip(self.scene.meshes, self.scene.views, strict=True)
        truth = np.stack([cast(mesh, views, SAMPLES[samples]) for mesh, views in pairs])
        of_methods = self.measure(truth, {method: self.images[method] for method in METHODS})
        return pd.concat([of_methods, self.measure(self.truth, {CEILING: truth})])


def _budget(cells: pd.DataFrame, moves: Mapping[str, pd.DataFrame]) -> str:
    """Return a Markdown table with a line for each cell that has a tolerance and could move.

    A line has the cell, its move by each change, the tolerance, and the largest move divided by it.
    """
    rows = []
    by_change = [frame.to_dict("index") for frame in moves.values()]
    for method, row in cells[list(METRICS)].to_dict("index").items():
        for metric, value in row.items():
            allowed = tolerance(str(method), str(metric))
            if allowed is None or not np.isfinite(value):
                continue
            if method == CEILING and metric not in CONTROL_METRICS:
                continue  # on any machine one driver draws both images, so that this cannot move
            limit = allowed.absolute + allowed.relative * abs(value)
            moved = [frame[method][metric] for frame in by_change]
            texts = [_number(move, 2) for move in moved]
            share = f"{max(moved) / limit:.2f}"
            names = [str(method), str(metric)]
            rows.append([*names, _number(value, 4), *texts, _number(limit, 2), share])
    head = ["method", "metric", "cell", *moves, "allowed", "largest / allowed"]
    return markdown(head, rows, left=2)


def _number(value: float, digits: int) -> str:
    """Return a number with so many significant digits; "" where it is not finite."""
    return f"{value:.{digits}g}" if np.isfinite(value) else ""


# --- objects --------------------------------------------------------------------------------------

# The methods of each change, in the study of single chairs.
_OF_CHAIRS = {
    TURN: ("pc2pix", "pc2pix@acgan", "splat-net@chair", "splat", "constant", "blank"),
    ROUNDING: ("surface-apss",),
}
ONE_IN = 50  # one point in so many is moved by a rounding error

_Pair = tuple[UInt8Images, UInt8Images]  # true and drawn images [N, V, H, W, 3]


def nudged(cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    """Return the cloud with about one point in ONE_IN moved by a rounding error along each axis."""
    points = cloud.points.copy()
    chosen = rng.random(len(points)) < 1 / ONE_IN
    points[chosen] = np.nextafter(points[chosen], np.float32(np.inf))
    return replace(cloud, points=points)


def means(pair: _Pair) -> pd.DataFrame:
    """Return means over views that have a value: a row for each object, a column for each metric.

    pair  true and drawn images, both [N, V, H, W, 3]
    """
    truths, drawings = pair
    rows = []
    for truth, drawn in zip(truths, drawings, strict=True):
        values = all_scores(truth, drawn)
        rows.append({metric: finite_mean(values[column(metric)]) for metric in IMAGE_METRICS})
    return pd.DataFrame(rows)


def moves_of_chairs(
    scene: SceneSet, condition: str, methods: Mapping[str, Sequence[str]] = _OF_CHAIRS
) -> pd.DataFrame:
    """Return how far the values of each chair move, with a row for each change, method and chair.

    methods  those of each change
    """
    rng = generator("object noise", "nudge", condition)
    farther = tuple(turned(views) for views in scene.views)
    truth = render_all(scene.meshes, scene.views)
    truth_turned = render_all(scene.meshes, farther)
    others = [nudged(cloud, rng) for cloud in scene.clouds]
    moves = []
    for change, changed_methods in methods.items():
        for method in changed_methods:
            renderer = find_method(method).load("cpu")
            before = truth, draw_all(renderer, scene.clouds, scene.views)
            if change == TURN:
                after = truth_turned, draw_all(renderer, scene.clouds, farther)
            else:
                after = truth, draw_all(renderer, others, scene.views)
            moves.append((means(after) - means(before)).assign(change=change, method=method))
    return pd.concat(moves)


def _summary_of_chairs(moves: pd.DataFrame) -> str:
    """Return a Markdown table with a line for each method and a column for each metric.

    Each entry has the standard deviation of the moves around zero, the largest and the second
    largest.
    """

    def entry(values: pd.Series) -> str:
        size = np.sort(np.abs(values.dropna().to_numpy()))
        if len(size) < 2:
            return "-"
        return f"{np.sqrt(np.mean(size**2)):.2g}, {size[-1]:.2g}, {size[-2]:.2g}"

    rows = []
    for names, group in moves.groupby(["change", "method"], sort=False):
        rows.append([*names, *(entry(group[metric]) for metric in IMAGE_METRICS)])
    return markdown(["change", "method", *IMAGE_METRICS], rows, left=2)


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="How far golden values move elsewhere.")
    parser.add_argument("of", nargs="?", default="cells", choices=("cells", "chairs"))
    parser.add_argument("--chairs", type=int, default=24)
    parser.add_argument("--views", type=int, default=20)
    parser.add_argument("--condition", help="2048; of single chairs also noise-0.10")
    options = parser.parse_args()
    torch.set_num_threads(1)
    if options.of == "chairs":
        moves = [
            moves_of_chairs(make_scene("chair", options.chairs, options.views, 0, name), name)
            for name in (options.condition or "2048,noise-0.10").split(",")
        ]
        print(_summary_of_chairs(pd.concat(moves)), end="")
        return
    study = _Study(options.chairs, options.views, options.condition or "2048")
    print(_budget(study.cells, study.moves()), end="")


if __name__ == "__main__":
    main()
