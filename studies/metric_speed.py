"""Speed of the metrics beside other implementations, and how far their values differ.

    python -m studies.metric_speed [--threads 1] [--rounds 9] [--frechet-rounds 1]
                                      [--sizes 100,250,500,1000,2000,3000,10000]

ssim      `bench.metrics.structural_similarity` with all components, against scikit-image with the
          same protocol, which gives SSIM alone; 20 pairs: noise, and chairs against what methods
          draw of them. Where both images agree ours computes nothing: white around a chair,
          unless a network draws haze.
frechet   `bench.metrics.frechet` at d = 2,048 against the usual route, as in pytorch-fid:
          covariances and the matrix root of their product by SciPy; where that is not finite, again
          with 1e-6 on the diagonals. Features are like a network's: correlated, half of them 0. Two
          sets of n.
interval  of the Fréchet distance: a distance anew for every object left out, against what
          `bench.metrics.frechet` shares.
scores    milliseconds an image of all image metrics, of parts of them, and of the networks.

The two sides of a ratio take turns in one process (A, B, A, B ...), after one round that does not
count (of the usual route: none); numbers are medians over the rounds. With one thread times are CPU
time, which other processes hardly change; with more they are wall time, and the machine has to be
left alone. SciPy 1.17 takes 11-17 s for a root: some three minutes, of them two for those.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Callable, Sequence
from functools import partial
from statistics import median
from typing import Any

import numpy as np
import scipy
import torch
from numpy.typing import NDArray
from skimage.metrics import structural_similarity
from threadpoolctl import threadpool_limits

from bench.catalogue.methods import find_method
from bench.catalogue.metrics import EXTRACTORS
from bench.metrics.frechet import JackknifeMoments, frechet_distance, left_out_distances
from bench.metrics.image_scores import FURTHER_SCORES, scores
from bench.metrics.inception_weights import WeightsUnavailable
from bench.metrics.silhouette import foreground, silhouette_iou
from bench.metrics.structural_similarity import ssim_per_image, ssim_per_image_and_mask
from bench.metrics.thin_parts import thin_scores
from data_prep.arrays import Floats
from data_prep.clouds.sampling import random_views, sample_surface
from data_prep.datasets.registry import ProceduralObject
from data_prep.randomness import generator
from data_prep.scene import UInt8Images
from studies.arguments import numbers
from studies.images import draw_all, render_all
from studies.turns import Work, in_turns, load, ratio

PAIRS = 20
CHAIRS, VIEWS = 4, 5  # make as many
METHODS = ("splat", "pc2pix", "pc2pix@acgan", "blank")
FEATURES = 2048
SIZES = (100, 250, 500, 1000, 2000, 3000, 10000)
INTERVALS = ((480, 64, 24), (2000, 64, 100), (480, 2048, 24))  # images, features, objects


Watch = Callable[..., list[list[float]]]  # `in_turns` on one clock


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--threads", type=int, default=1)
    options.add_argument("--rounds", type=int, default=9)
    options.add_argument("--frechet-rounds", type=int, default=1)
    options.add_argument("--sizes", type=numbers, default=SIZES)
    given = options.parse_args()
    torch.set_num_threads(given.threads)
    clock, now = "CPU time", time.process_time
    if given.threads > 1:
        clock, now = "wall time", time.perf_counter
    watch = partial(in_turns, now=now)
    print(
        f"NumPy {np.__version__}, SciPy {scipy.__version__}, {given.threads} thread(s), "
        f"{clock}, {load()}"
    )
    with threadpool_limits(given.threads):
        pairs = image_pairs()
        report_ssim(watch, pairs, given.rounds)
        report_scores(watch, pairs["chairs, pc2pix"], given.rounds)
        report_frechet(watch, given.sizes, given.frechet_rounds)
        report_intervals(watch)


def image_pairs() -> dict[str, tuple[UInt8Images, UInt8Images]]:
    """Return PAIRS pairs of images by name: noise, and true images of chairs with drawn ones."""
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (2, PAIRS, 128, 128, 3), np.uint8)
    pairs = {"noise, other noise": (noise[0], noise[1])}
    chairs = [ProceduralObject("chair", "validation", i).load() for i in range(CHAIRS)]
    views = [random_views(VIEWS, generator("metric speed", "views", i)) for i in range(CHAIRS)]
    clouds = [
        sample_surface(chair, generator("metric speed", "cloud", i))
        for i, chair in enumerate(chairs)
    ]
    truth = np.concatenate(render_all(chairs, views))
    for method in METHODS:
        drawn = draw_all(find_method(method).load("cpu"), clouds, views)
        pairs[f"chairs, {method}"] = (truth, np.concatenate(drawn))
    return pairs


def by_scikit_image(a: UInt8Images, b: UInt8Images) -> Floats:
    """Return SSIM [N] by the same protocol."""
    return np.array(
        [
            structural_similarity(
                *pair,
                gaussian_weights=True,
                sigma=1.5,
                use_sample_covariance=False,
                data_range=255,
                channel_axis=-1,
            )
            for pair in zip(a, b, strict=True)
        ]
    )


def report_ssim(
    watch: Watch, pairs: dict[str, tuple[UInt8Images, UInt8Images]], rounds: int
) -> None:
    """Print milliseconds a pair of both, and their ratio."""
    print(
        f"\n{'ssim, ms a pair':<26}{'scikit-image':>13}{'ours':>8}{'ratio':>8}  of a round", end=""
    )
    print("     largest difference")
    for name, (a, b) in pairs.items():
        ours, theirs = watch(
            [lambda a=a, b=b: ssim_per_image(a, b), lambda a=a, b=b: by_scikit_image(a, b)], rounds
        )
        apart = np.abs(ssim_per_image(a, b).ssim - by_scikit_image(a, b)).max()
        scale = 1e3 / len(a)
        print(
            f"{name:<26}{scale * median(theirs):13.2f}{scale * median(ours):8.2f}"
            f"{ratio(theirs, ours)}  {apart:.1e}",
            flush=True,
        )


def report_scores(watch: Watch, pair: tuple[UInt8Images, UInt8Images], rounds: int) -> None:
    """Print the cost of an image, by score and network."""
    truth, drawn = pair
    masks = foreground(truth)
    works: dict[str, Work] = {
        "all scores": lambda: scores(truth, drawn),
        "ssim and ssim-object": lambda: ssim_per_image_and_mask(truth, drawn, masks),
        "thin parts": lambda: thin_scores(truth, drawn),
        "silhouette-iou": lambda: silhouette_iou(truth, drawn),
        "foreground": lambda: foreground(truth),
    }
    for name, score in FURTHER_SCORES.items():
        try:
            score(truth[:1], drawn[:1])
        except WeightsUnavailable:
            continue
        works[name] = partial(score, truth, drawn)
    for source in EXTRACTORS:
        try:
            extract = source.load(str(source.weights(None)), "cpu")
        except WeightsUnavailable:
            continue
        # In another order each time: extractors know the last images again.
        turn = itertools.count()
        works[f"features of {source.id}"] = lambda extract=extract, turn=turn: extract(
            np.roll(drawn, next(turn), axis=0)
        )
    print("\nscores, ms an image")
    taken = watch(list(works.values()), rounds)
    for name, seconds in zip(works, taken, strict=True):
        print(f"{name:<26}{1e3 * median(seconds) / len(truth):8.3f}", flush=True)


def features(seed: int, n: int, d: int) -> NDArray[np.float32]:
    """Return features [n, d] like those of a network: of rank and noise, half of them 0."""
    rng = np.random.default_rng(seed)
    mix = np.random.default_rng(0).standard_normal((64, d)) / 10
    values = 0.4 * rng.standard_normal((n, d)) + rng.standard_normal((n, 64)) @ mix
    return np.maximum(values, 0).astype(np.float32)


def by_matrix_root(x: NDArray[Any], y: NDArray[Any]) -> float:
    """Return the distance by the usual route (mseitzer/pytorch-fid, fid_score.py).

    The time includes the covariances.
    """
    x, y = x.astype(np.float64), y.astype(np.float64)
    s1, s2 = np.cov(x, rowvar=False), np.cov(y, rowvar=False)
    root = scipy.linalg.sqrtm(s1 @ s2)
    if not np.isfinite(root).all():
        offset = 1e-6 * np.eye(len(s1))
        root = scipy.linalg.sqrtm((s1 + offset) @ (s2 + offset))
    shift = x.mean(axis=0) - y.mean(axis=0)
    return float(shift @ shift + np.trace(s1) + np.trace(s2) - 2 * np.trace(root).real)


def report_frechet(watch: Watch, sizes: Sequence[int], rounds: int) -> None:
    """Print seconds of both routes by number of samples, and how far results are apart."""
    frechet_distance(features(1, 100, FEATURES), features(2, 100, FEATURES))  # BLAS starts up
    print(
        f"\n{f'frechet, d = {FEATURES}, s':<26}{'matrix root':>13}{'ours':>8}{'ratio':>8}", end=""
    )
    print("  of a round     ours, and the difference")
    for n in sizes:
        x, y = features(1, n, FEATURES), np.float32(1.1) * features(2, n, FEATURES)
        distances: dict[str, float] = {}

        def ours(x=x, y=y, distances=distances) -> None:
            distances["ours"] = frechet_distance(x, y)

        def usual(x=x, y=y, distances=distances) -> None:
            distances["usual"] = by_matrix_root(x, y)

        taken, theirs = watch([ours, usual], rounds, idle=0)
        print(
            f"{f'n = {n}':<26}{median(theirs):13.2f}{median(taken):8.3f}{ratio(theirs, taken)}"
            f"  {distances['ours']:.6f} {distances['usual'] - distances['ours']:+.1e}",
            flush=True,
        )


def one_by_one(x: NDArray[Any], y: NDArray[Any], groups: NDArray[np.intp]) -> Floats:
    """Return `left_out_distances` as defined: a distance anew for every object."""
    kept = [groups != group for group in np.unique(groups)]
    return np.array([frechet_distance(x[rows], y[rows]) for rows in kept])


def shared(x: NDArray[Any], y: NDArray[Any], groups: NDArray[np.intp]) -> Floats:
    """Return the distances by the shared computation of the tables."""
    return left_out_distances(JackknifeMoments(x, groups), JackknifeMoments(y, groups))


def report_intervals(watch: Watch) -> None:
    """Print seconds of an interval's distances: one by one, and shared."""
    print(f"\n{'interval, s':<26}{'one by one':>13}{'shared':>8}  largest difference")
    for n, d, objects in INTERVALS:
        x, y = features(1, n, d), np.float32(1.1) * features(2, n, d)
        groups = np.repeat(np.arange(objects), n // objects)
        works = [partial(work, x, y, groups) for work in (one_by_one, shared)]
        expected, actual = (work() for work in works)
        apart = float(np.abs(actual - expected).max())
        taken = watch(works, 3, idle=0)
        times = "".join(
            f"{median(seconds):{width}.3f}" for seconds, width in zip(taken, (13, 8), strict=True)
        )
        print(f"{f'{n} x {d}, {objects} objects':<26}{times}  {apart:.1e}", flush=True)


if __name__ == "__main__":
    main()
