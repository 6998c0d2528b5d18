"""The move of a single object's values from one machine to another.

    python -m studies.object_noise [--chairs 24] [--views 20] [--conditions 2048,noise-0.10]

Golden values by object need tolerances of their own: a mean over 24 chairs moves less than one of
them. Chairs of the validation split, measured twice with one thing changed:

turn      every view by 0.1 degree more of azimuth, true and drawn images alike, as another driver
          samples edges elsewhere (`studies.noise_floor`).
rounding  one point in fifty moved by one rounding error, as another processor rounds elsewhere:
          for reconstructions, where it decides about a spike (`studies.class_noise`).

For each method and metric, over all chairs and conditions: the standard deviation of a chair's move
around zero, and the two largest. About ten minutes on one thread.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.methods import find_method
from bench.catalogue.metrics import IMAGE_METRICS, column
from data_prep.randomness import generator
from data_prep.scene import UInt8Images
from studies.cells import ChairSet, finite_mean, make_chairs
from studies.class_noise import nudged
from studies.images import all_scores, draw_all, render_all, turned
from studies.tables import markdown

TURN, ROUNDING = "turn", "rounding"
METHODS = {
    TURN: ("pc2pix", "pc2pix@acgan", "splat-net@chair", "splat", "constant", "blank"),
    ROUNDING: ("surface-apss",),
}
Moves = dict[tuple[str, str, str], NDArray[np.float64]]  # by change, method and metric: [chairs]


def means(truth: UInt8Images, drawn: UInt8Images) -> dict[str, NDArray[np.float64]]:
    """Return image metrics of [chairs, views, H, W, 3] as means over a chair's views, [chairs].

    The means are over views that have a value; NaN where none has one.
    """
    scored = [all_scores(t, d) for t, d in zip(truth, drawn, strict=True)]
    return {
        metric: np.array(
            [finite_mean(scores_of_chair[column(metric)]) for scores_of_chair in scored]
        )
        for metric in IMAGE_METRICS
    }


def moves(scene: ChairSet, condition: str, methods: Mapping[str, Sequence[str]] = METHODS) -> Moves:
    """Return how far the values of each chair move."""
    farther = tuple(turned(of_chair) for of_chair in scene.views)
    truth, truth_turned = (render_all(scene.meshes, views) for views in (scene.views, farther))
    rng = generator("object noise", "nudge", condition)
    others = tuple(nudged(cloud, rng) for cloud in scene.clouds)
    differences: Moves = {}
    for change, changed_methods in methods.items():
        for method in changed_methods:
            renderer = find_method(method).load("cpu")
            before = means(truth, draw_all(renderer, scene.clouds, scene.views))
            if change == TURN:
                after = means(truth_turned, draw_all(renderer, scene.clouds, farther))
            else:
                after = means(truth, draw_all(renderer, others, scene.views))
            for metric in IMAGE_METRICS:
                differences[change, method, metric] = after[metric] - before[metric]
    return differences


def summary(moves_of_chairs: Moves) -> str:
    """Return a Markdown table with a line for each method and a column for each metric.

    A cell has the deviation, the largest and the second largest move.
    """
    rows = []
    for change, method in dict.fromkeys(key[:2] for key in moves_of_chairs):
        cells = []
        for metric in IMAGE_METRICS:
            values = moves_of_chairs[change, method, metric]
            size = np.sort(np.abs(values[np.isfinite(values)]))
            if len(size) < 2:
                cells.append("-")
                continue
            deviation = np.sqrt(np.mean(size**2))
            cells.append(f"{deviation:.2g}, {size[-1]:.2g}, {size[-2]:.2g}")
        rows.append([change, method, *cells])
    return markdown(["change", "method", *IMAGE_METRICS], rows, left=2)


def main() -> None:
    """Run the study from the command line."""
    import torch

    parser = argparse.ArgumentParser(description="How far the values of a chair move by little.")
    parser.add_argument("--chairs", type=int, default=24)
    parser.add_argument("--views", type=int, default=20)
    parser.add_argument("--conditions", default="2048,noise-0.10")
    options = parser.parse_args()
    torch.set_num_threads(1)
    by_condition = [
        moves(make_chairs(options.chairs, options.views, 0, condition), condition)
        for condition in options.conditions.split(",")
    ]
    together = {
        key: np.concatenate([moved[key] for moved in by_condition]) for key in by_condition[0]
    }
    print(summary(together), end="")


if __name__ == "__main__":
    main()
