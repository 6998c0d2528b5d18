"""Paths between codes (the paper's Figure 5), and their measures."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from bench.judges.views import ViewsNetwork
from bench.suites.latent.chairs import ChairPair
from bench.suites.latent.figures import Strip, StripTile
from bench.suites.latent.measures import (
    Clouds,
    chamfer_distances,
    cloud_steps,
    cross_fade,
    distances_to_nearer_end,
    family_confidence,
    image_steps,
    ssim_values,
    unevenness,
)
from bench.suites.latent.network import LatentNetwork, sample_chair
from bench.suites.latent.tables import ALL, LatentValue
from data_prep.randomness import generator
from data_prep.scene import UInt8Images
from pc2pix.latent import interpolate

CODE, FADE, NOISE, TRUTH = "code", "cross-fade", "noise", "truth"

PATHS = {
    CODE: "straight line between the whitened codes of two test chairs, decoded and drawn",
    FADE: "the images at its two ends faded into each other: no chair in between, and yet even",
    NOISE: "straight line between two random codes, each number from N(0, 1)",
    TRUTH: "true images of the two chairs: what the classifier makes of the real thing",
}
PATH_METRICS = {
    "picture-unevenness": "largest step over mean step between neighbouring images (root mean "
    "square); 1 is even",
    "picture-step": "mean step between neighbouring images, in 0..1",
    "cloud-unevenness": "largest step over mean step between neighbouring decoded clouds (Chamfer)",
    "cloud-step": "mean step between neighbouring decoded clouds",
    "end-cloud": "Chamfer distance of the decoded clouds at the ends to the original ones",
    "end-ssim": "SSIM of the images at the ends with the true ones",
    "end-to-end": "Chamfer distance between the decoded clouds at the two ends",
    "to-nearer-end": "Chamfer distance of what is decoded in between to the nearer decoded end",
    "family-confidence": "largest probability that the classifier of `fd-views` gives to a "
    "structural family, mean along the path",
    "family-confidence-min": "the smallest along the path",
}
PATH_REMARK = (
    "Means over paths with 95 % intervals. Chamfer distances are in squared radii of the unit "
    "sphere: mean squared distance to the nearest point, there and back. "
    "An even path is no achievement by itself: a cross-fade is even, and so is a network that "
    "draws next to nothing of a code. Read evenness beside the length of the steps, and beside "
    "the classifier's confidence, which asks whether the images in between still show some kind "
    "of thing. All ends are chairs, hence no confidence in a class: `family-confidence` is about "
    "structural families, of any class. A classifier can be sure of nonsense, too."
)


def walk(
    network: LatentNetwork, classifier: ViewsNetwork, pair: ChairPair, seed: int, positions: int
) -> tuple[list[LatentValue], Strip]:
    """Return the values of a path between two chairs with its baselines, and its strip."""
    chairs = (pair.start, pair.end)
    ends = [sample_chair(network, chair, seed) for chair in chairs]
    start, end = (
        network.encode(chair.id, sample.cloud) for chair, sample in zip(chairs, ends, strict=True)
    )
    line = interpolate(start, end, positions)
    clouds, images = network.decode(line), network.draw(line)
    true_clouds = np.stack([sample.cloud.points for sample in ends])
    true_images = np.stack([sample.image for sample in ends])
    faded = cross_fade(images[0], images[-1], positions)
    random_line = interpolate(*_random_codes(pair, start, seed), positions)
    measured = {
        CODE: _evenness(classifier, images)
        | _cloud_path(clouds)
        | {
            "end-cloud": chamfer_distances(clouds[[0, -1]], true_clouds).mean(),
            "end-ssim": ssim_values(true_images, images[[0, -1]]).mean(),
        },
        FADE: _evenness(classifier, faded),
        NOISE: _evenness(classifier, network.draw(random_line))
        | _cloud_path(network.decode(random_line)),
        TRUTH: _confidence(classifier, true_images),
    }
    values = [
        LatentValue(network.method, what, ALL, pair.id, metric, float(value))
        for what, by_metric in measured.items()
        for metric, value in by_metric.items()
    ]
    between = [
        StripTile(f"{i}/{positions - 1}", cloud, image)
        for i, (cloud, image) in enumerate(zip(clouds, images, strict=True))
    ]
    first, last = (StripTile("original", sample.cloud.points, sample.image) for sample in ends)
    label = f"{pair.start.spec.family}\nto {pair.end.spec.family}"
    return values, Strip(label, (first, *between, last))


def _random_codes(pair: ChairPair, like: Tensor, seed: int) -> tuple[Tensor, Tensor]:
    """Return two codes [1, d] of independent numbers from N(0, 1), as those of whitened codes."""
    rng = generator(seed, "latent noise", pair.id)
    drawn = rng.standard_normal((2, like.shape[1])).astype(np.float32)
    start, end = torch.from_numpy(drawn).to(like.device).split(1)
    return start, end


def _evenness(classifier: ViewsNetwork, images: UInt8Images) -> dict[str, float]:
    steps = image_steps(images)
    return {
        "picture-unevenness": unevenness(steps),
        "picture-step": float(steps.mean()),
    } | _confidence(classifier, images)


def _confidence(classifier: ViewsNetwork, images: UInt8Images) -> dict[str, float]:
    values = family_confidence(classifier, images)
    return {"family-confidence": float(values.mean()), "family-confidence-min": float(values.min())}


def _cloud_path(clouds: Clouds) -> dict[str, float]:
    steps = cloud_steps(clouds)
    return {
        "cloud-unevenness": unevenness(steps),
        "cloud-step": float(steps.mean()),
        "end-to-end": float(chamfer_distances(clouds[:1], clouds[-1:])[0]),
        "to-nearer-end": float(distances_to_nearer_end(clouds).mean()),
    }
