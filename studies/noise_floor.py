"""How far golden values move on another machine: what their tolerances are made of.

    python -m studies.noise_floor [cells] [--chairs 24] [--views 20] [--condition 2048]
    python -m studies.noise_floor chairs [--chairs 24] [--views 20] [--condition 2048,noise-0.10]

A cell is the value of one metric for one method, over objects x views of the validation split, as
in the tables of a run. It is measured again with one thing changed at a time:

turn       every view by 0.1 degree more of azimuth, true and drawn images alike: 0.1 px at the
           rim of the unit sphere, as another driver samples edges elsewhere.
renderer   the true images by rays with the same camera and shading
           (`data_prep.rendering.raycast`), not by OpenGL: with the same 4 samples a pixel, and with
           their mirror image, which OpenGL allows. The images of methods stay as they are; for
           `true-mesh`, which draws by the renderer, they are those of the ray-caster and the truth
           is OpenGL's.
rounding   of `chairs` alone, one point in fifty moved by one rounding error, as another processor
           rounds elsewhere: for reconstructions, where it decides about a spike.

`cells` prints each cell with its moves and the largest of them over the tolerance, which is at most
0.33: a tolerance is three times the largest effect, rounded up. `chairs` is for golden values by
object, as a mean over 24 chairs moves less than one of them. It prints for each method and metric,
over all chairs and conditions, the standard deviation of a chair's move around zero, and the two
largest.
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
from bench.checking.tolerances import tolerance
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

METHODS = ("pc2pix", "pc2pix@acgan", "splat", "constant", "blank")
CEILING = "true-mesh"
# 4 samples as good as those of OpenGL, but elsewhere.
MIRRORED = tuple((column, 1 - row) for column, row in OPENGL)
TURN, ROUNDING = "turn", "rounding"
SAMPLES = {"renderer, same samples": OPENGL, "renderer, mirrored samples": MIRRORED}


# --- cells ----------------------------------------------------------------------------------------


class _Study:
    """The chairs, what was measured of them first, and the networks."""

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
        """Return the cells of images by method: methods down, metrics across."""
        views, of_truth = (scene or self.scene).views, self.encode(truth)
        return pd.DataFrame(
            {
                method: cells(truth, of_truth, drawn, self.encode(drawn), views)
                for method, drawn in images.items()
            }
        ).T

    def draw(self, scene: SceneSet) -> dict[str, UInt8Images]:
        """Return the images of each method, all views of a chair in one batch."""
        return {
            method: draw_all(find_method(method).load("cpu"), scene.clouds, scene.views)
            for method in METHODS
        }

    def moves(self) -> dict[str, pd.DataFrame]:
        """Return how far each cell moved, by source: methods down, metrics across."""
        again = {TURN: self.turned()} | {name: self.cast(name) for name in SAMPLES}
        return {source: (moved - self.cells).abs() for source, moved in again.items()}

    def turned(self) -> pd.DataFrame:
        """Return the cells with every view a little farther round."""
        scene = self.scene._replace(views=tuple(map(turned, self.scene.views)))
        truth = render_all(scene.meshes, scene.views)
        return self.measure(truth, self.draw(scene) | {CEILING: truth}, scene)

    def cast(self, samples: str) -> pd.DataFrame:
        """Return the cells with true images by rays, and the ceiling's against OpenGL's."""
        pairs = zip(self.scene.meshes, self.scene.views, strict=True)
        truth = np.stack([cast(mesh, views, SAMPLES[samples]) for mesh, views in pairs])
        of_methods = self.measure(truth, {m: self.images[m] for m in METHODS})
        return pd.concat([of_methods, self.measure(self.truth, {CEILING: truth})])


def _budget(cells: pd.DataFrame, moves: Mapping[str, pd.DataFrame]) -> str:
    """Return a line for each cell with a golden tolerance that could move.

    It says by how much it moved, and how much is allowed.
    """
    rows = []
    by_source = [moves[source].to_dict("index") for source in moves]
    for method, row in cells[[*METRICS]].to_dict("index").items():
        for metric, value in row.items():
            allowed = tolerance(str(method), str(metric))
            if allowed is None or not np.isfinite(value):
                continue
            if method == CEILING and metric not in CONTROL_METRICS:  # one driver draws both images
                continue
            limit = allowed.absolute + allowed.relative * abs(value)
            moved = [source[method][metric] for source in by_source]
            numbers = [_number(value, 4), *(_number(m, 2) for m in moved), _number(limit, 2)]
            rows.append([str(method), str(metric), *numbers, f"{max(moved) / limit:.2f}"])
    head = ["method", "metric", "cell", *moves, "allowed", "largest / allowed"]
    return markdown(head, rows, left=2)


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}g}" if np.isfinite(value) else ""


# --- objects --------------------------------------------------------------------------------------

_OF_CHAIRS = {
    TURN: ("pc2pix", "pc2pix@acgan", "splat-net@chair", "splat", "constant", "blank"),
    ROUNDING: ("surface-apss",),
}
ONE_IN = 50

_Pair = tuple[UInt8Images, UInt8Images]  # true and drawn images [N, V, H, W, 3]


def nudged(cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    """Return the cloud with one point in `ONE_IN` moved by one rounding error an axis."""
    points = cloud.points.copy()
    chosen = rng.random(len(points)) < 1 / ONE_IN
    points[chosen] = np.nextafter(points[chosen], np.float32(np.inf))
    return replace(cloud, points=points)


def means(pair: _Pair) -> pd.DataFrame:
    """Return means over the views that have a value: objects down, metrics across."""
    scored = [all_scores(truth, drawn) for truth, drawn in zip(*pair, strict=True)]
    return pd.DataFrame(
        [{m: finite_mean(values[column(m)]) for m in IMAGE_METRICS} for values in scored]
    )


def moves_of_chairs(
    scene: SceneSet, condition: str, methods: Mapping[str, Sequence[str]] = _OF_CHAIRS
) -> pd.DataFrame:
    """Return how far the values of each chair move, a row for each change, method and chair."""
    rng = generator("object noise", "nudge", condition)
    farther = tuple(map(turned, scene.views))
    truth, truth_turned = (render_all(scene.meshes, views) for views in (scene.views, farther))
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

    A cell has the deviation, the largest and the second largest move.
    """

    def cell(values: pd.Series) -> str:
        size = np.sort(np.abs(values.dropna().to_numpy()))
        if len(size) < 2:
            return "-"
        return f"{np.sqrt(np.mean(size**2)):.2g}, {size[-1]:.2g}, {size[-2]:.2g}"

    rows = [
        [*names, *(cell(group[metric]) for metric in IMAGE_METRICS)]
        for names, group in moves.groupby(["change", "method"], sort=False)
    ]
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
