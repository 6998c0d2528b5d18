"""Scores of images against the true ones: those of every run, and those that users ask for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bench.metrics.flip import flip
from bench.metrics.invented import invented_holes, invented_parts
from bench.metrics.peak_signal_to_noise import psnr
from bench.metrics.silhouette import Pairs, overlap
from bench.metrics.structural_similarity import ssim_per_image_and_mask
from bench.metrics.thin_parts import thin_scores

# Takes true and drawn images, uint8 [V, H, W, 3] each, and returns a score of each drawn one [V].
_Score = Callable[[NDArray[np.uint8], NDArray[np.uint8]], NDArray[np.float64]]


def _dists(
    truth: NDArray[np.uint8], images: NDArray[np.uint8], device: str = "cpu"
) -> NDArray[np.float64]:
    # Imported here, because torch takes seconds.
    from bench.metrics.dists import dists
    from learning.training_loop import prepare_device

    return dists(truth, images, single=True, device=str(prepare_device(device)))


def _st_lpips(
    truth: NDArray[np.uint8], images: NDArray[np.uint8], device: str = "cpu"
) -> NDArray[np.float64]:
    from bench.metrics.lpips_network import lpips
    from learning.training_loop import prepare_device

    device = str(prepare_device(device))
    return lpips(truth, images, "shift-tolerant", single=True, device=device)


# The metrics that no suite has. `bench run --metrics` and `bench score` take them of the images in
# the store of a run.
FURTHER_SCORES: Mapping[str, _Score] = {
    "flip": flip,
    "dists": _dists,
    "st-lpips": _st_lpips,
    "invented-holes": invented_holes,
    "invented-parts": invented_parts,
}


def further_score(metric: str, device: str) -> _Score:
    """Return the function for one of FURTHER_SCORES.

    device  where its network runs, if it has one: "auto", "cpu" or "cuda"
    """
    if metric == "dists":
        return partial(_dists, device=device)
    if metric == "st-lpips":
        return partial(_st_lpips, device=device)
    return FURTHER_SCORES[metric]


def scores(truth: NDArray[np.uint8], images: NDArray[np.uint8]) -> dict[str, NDArray[np.float64]]:
    """Return scores [V] of images uint8 [V, H, W, 3], by the names of the columns in records.

    A score is NaN where an image has none. `ssim_object` is the mean of the SSIM map over the
    windows that contain a pixel of the true silhouette or of the drawn one. The map is computed
    once for all scores of SSIM, and the silhouettes once for all scores that need them. Raises
    ValueError where an array is not uint8 or not [V, H, W, 3], where the shapes differ, and where
    there is nothing to compare.
    """
    pairs = Pairs(truth, images)
    drawn = pairs.drawn(pairs.shown)
    whole, of_object = ssim_per_image_and_mask(truth, images, pairs.shown | drawn)
    thin = thin_scores(pairs)
    return whole._asdict() | {
        "psnr": psnr(truth, images),
        "ssim_object": of_object,
        "silhouette_iou": overlap(pairs.shown, drawn),
        "thin_recall": thin.recall,
        "thin_precision": thin.precision,
    }
