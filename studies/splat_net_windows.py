"""What splat-net saves by windows: cost and images beside those of whole images.

    python -m studies.splat_net_windows [--weights chair,chair-tiny] [--conditions 2048,512,...]
        [--chairs 6] [--views 20] [--rounds 5] [--threads 1]

Validation chairs in float32, drawn with windows (`baselines.splat_net.window`) and without, in
turns in one process. A line for each network and condition: processor time of all threads for an
image, medians over chairs and rounds, without and with windows; the ratio, and the smallest and
largest of a round; and the largest difference in grey levels.
"""

from __future__ import annotations

import argparse
import time
from functools import partial
from statistics import median

import numpy as np
import torch

from baselines.splat_net.projection import Projection
from baselines.splat_net.renderer import SplatNetRenderer
from baselines.splat_net.weights import load_weights
from baselines.splat_net.window import Box
from bench.catalogue.lookup import find
from data_prep.clouds.conditions import CONDITIONS
from data_prep.clouds.sampling import random_views, sample_surface
from data_prep.datasets.registry import ProceduralObject
from data_prep.randomness import generator as random_numbers
from data_prep.rendering.images import to_uint8
from studies.arguments import names, positive
from studies.turns import in_turns, load, ratio

PAPERS = ("2048", "1024", "512", "noise-0.05", "noise-0.10")


class WholeImages(SplatNetRenderer):
    """Without windows."""

    def boxes(self, seen: Projection) -> list[Box]:
        """The images."""
        return [Box(0, self.size, 0, self.size)] * len(super().boxes(seen))


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--weights", type=names, default=("chair", "chair-tiny"))
    options.add_argument("--conditions", type=names, default=PAPERS, help="comma-separated")
    options.add_argument("--chairs", type=positive, default=6)
    options.add_argument("--views", type=positive, default=20)
    options.add_argument("--rounds", type=positive, default=5)
    options.add_argument("--threads", type=positive, default=1)
    given = options.parse_args()
    torch.set_num_threads(given.threads)
    print(f"torch {torch.__version__}, {given.threads} thread(s), {load()}")
    print(f"{'ms an image':<24}{'whole':>8}{'windows':>9}{'ratio':>8}  of a round   levels")
    for name in given.weights:
        for condition in given.conditions:
            report(name, condition, given.chairs, given.views, given.rounds)


def report(name: str, condition: str, chairs: int, views: int, rounds: int) -> None:
    """A line of a network and a condition."""
    perturbation = find(condition, CONDITIONS, "condition").perturbation
    weights = load_weights(name)
    renderers = WholeImages(weights), SplatNetRenderer(weights)
    seconds: tuple[list[float], list[float]] = ([], [])
    apart = 0
    for i in range(chairs):
        rng = random_numbers("splat-net-windows", i)
        cloud = sample_surface(ProceduralObject("chair", "validation", i).load(), rng)
        state = renderers[0].prepare(perturbation.apply(cloud, rng))
        shown = random_views(views, rng)
        draws = [partial(renderer.draw, state, shown) for renderer in renderers]
        taken = in_turns(draws, rounds, now=time.process_time)
        for kept, more in zip(seconds, taken, strict=True):
            kept += more
        one, other = (to_uint8(draw()).astype(int) for draw in draws)
        apart = max(apart, int(np.abs(one - other).max()))
    whole, windows = (1e3 * median(taken) / views for taken in seconds)
    line = f"{name + ', ' + condition:<24}{whole:8.2f}{windows:9.2f}{ratio(*seconds)}"
    print(f"{line}{apart:6d}", flush=True)


if __name__ == "__main__":
    main()
