"""Measures of paths and sums of codes: pure functions of images and clouds."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from bench.judges.views import ViewsNetwork, view_features
from bench.metrics.structural_similarity import ssim_per_image
from data_prep.arrays import Floats
from data_prep.scene import UInt8Images
from pc2pix.losses import chamfer

Clouds = NDArray[np.float32]  # [N, 2048, 3], unit-sphere coordinates


def unevenness(steps: Floats) -> float:
    """Return the largest of the steps [K - 1] of a path over their mean: 1 where all are equal.

    At most K - 1, for a single jump; NaN for a path without any move.
    """
    mean = steps.mean()
    return float(steps.max() / mean) if mean > 0 else float("nan")


def image_steps(images: UInt8Images) -> Floats:
    """Return the RMS difference of neighbours [K - 1], 0..1, along a path of K images."""
    values = images.astype(np.float64) / 255
    return np.sqrt(np.square(np.diff(values, axis=0)).mean(axis=(1, 2, 3)))


def cloud_steps(clouds: Clouds) -> Floats:
    """Return the Chamfer distance of neighbours [K - 1] along a path of K clouds."""
    return chamfer_distances(clouds[:-1], clouds[1:])


def chamfer_distances(a: Clouds, b: Clouds) -> Floats:
    """Return the Chamfer distance [N] of each pair of clouds, in squared radii, as in training.

    It is the mean squared distance to the nearest neighbour, from a to b plus from b to a.
    """
    return np.array(
        [
            float(chamfer(torch.tensor(p)[None], torch.tensor(q)[None]))
            for p, q in zip(a, b, strict=True)
        ]
    )


def distances_to_nearer_end(clouds: Clouds) -> Floats:
    """Return the Chamfer distances [K - 2] of a path's inner clouds to the nearer end."""
    between = clouds[1:-1]
    to_ends = [
        chamfer_distances(between, np.broadcast_to(end, between.shape))
        for end in (clouds[0], clouds[-1])
    ]
    return np.minimum(*to_ends)


def cross_fade(start: NDArray[np.uint8], end: NDArray[np.uint8], positions: int) -> UInt8Images:
    """Return rounded weighted means [positions, H, W, 3] of two images [H, W, 3]; exact ends."""
    share = np.linspace(0, 1, positions)[:, None, None, None]
    return np.floor((1 - share) * start + share * end + 0.5).astype(np.uint8)


def family_confidence(network: ViewsNetwork, images: UInt8Images) -> Floats:
    """Return the classifier's largest probability of a structural family [N]."""
    features = torch.from_numpy(view_features(network, images))
    with torch.inference_mode():
        return network.heads["family"](features).double().softmax(dim=1).amax(dim=1).numpy()


def ssim_values(truth: UInt8Images, images: UInt8Images) -> Floats:
    """Return SSIM [N] of each pair of images, by the protocol of the benchmark."""
    return ssim_per_image(truth, images).ssim


def cosine(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    """Return the cosine of the angle between two vectors [d]; NaN where one is zero."""
    x, y = a.astype(np.float64), b.astype(np.float64)
    length = np.linalg.norm(x) * np.linalg.norm(y)
    return float(x @ y / length) if length > 0 else float("nan")
