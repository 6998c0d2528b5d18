"""Sums of codes, A - B + C (the paper's Figure 6), and their distance to the answer D."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from bench.suites.latent.chairs import CHANGES, Triple, specified_chairs
from bench.suites.latent.figures import Strip, StripTile
from bench.suites.latent.measures import chamfer_distances, cosine, ssim_values
from bench.suites.latent.network import LatentNetwork, cloud_of, sample_chair
from bench.suites.latent.tables import LatentValue
from data_prep.progress import progress
from pc2pix.latent import add_difference

SUM, NOTHING, TRAIN, ANSWER = "a-b+c", "c", "nearest-train", "d"

ANSWERS = {
    SUM: "A - B + C",
    NOTHING: "C, left as it is: the floor",
    TRAIN: "the train chair whose code is nearest to A - B + C",
    ANSWER: "the code of D itself: the ceiling for this encoder, decoder and generator",
}
SUM_METRICS = {
    "cloud": "Chamfer distance of the decoded cloud to the cloud of D",
    "ssim": "SSIM of the drawn image with the true one of D",
    "code": "root-mean-square difference to the code of D, in standard deviations",
    "cloud-gain": "how much smaller `cloud` is than doing nothing, paired; above 0 is better",
    "ssim-gain": "how much larger `ssim` is than doing nothing, paired; above 0 is better",
    "cosine": "of the angle between A - B and D - C: 1 where the change is one direction in the "
    "space of codes, 0 where it has nothing in common from chair to chair",
}
SUM_REMARK = (
    "A is B with one change, D is C with the same change, so that A - B + C has a right answer. "
    + "Changes: "
    + "; ".join(f"{change.id}: {change.about}" for change in CHANGES)
    + ". Means over triples with 95 % intervals."
)


def add_up(
    network: LatentNetwork, triple: Triple, train: Tensor, seed: int
) -> tuple[list[LatentValue], Strip]:
    """Return the values of A - B + C with its baselines, and its strip; `train` is [N, d]."""
    chairs = (triple.a, triple.b, triple.c, triple.d)
    sampled = [sample_chair(network, chair, seed) for chair in chairs]
    a, b, c, d = (
        network.encode(chair.id, sample.cloud)
        for chair, sample in zip(chairs, sampled, strict=True)
    )
    total = add_difference(a, b, c)
    nearest = train[(train - total).square().sum(dim=1).argmin()][None]
    codes = {SUM: total, NOTHING: c, TRAIN: nearest, ANSWER: d}
    stacked = torch.cat(list(codes.values()))
    clouds, images = network.decode(stacked), network.draw(stacked)
    answer, count = sampled[-1], len(codes)
    to_cloud = chamfer_distances(clouds, np.stack([answer.cloud.points] * count))
    to_image = ssim_values(np.stack([answer.image] * count), images)
    to_code = (stacked - d).square().mean(dim=1).sqrt().cpu().numpy()
    floor = list(codes).index(NOTHING)
    values = []
    for i, what in enumerate(codes):
        by_metric = {"cloud": to_cloud[i], "ssim": to_image[i], "code": to_code[i]}
        if i != floor:
            by_metric["cloud-gain"] = to_cloud[floor] - to_cloud[i]
            by_metric["ssim-gain"] = to_image[i] - to_image[floor]
        if what == SUM:
            by_metric["cosine"] = cosine((a - b)[0].cpu().numpy(), (d - c)[0].cpu().numpy())
        values += [
            LatentValue(network.method, what, triple.change, triple.id, metric, float(value))
            for metric, value in by_metric.items()
        ]
    terms = torch.cat([a, b, c])
    shown = zip(
        ("A", "− B", "+ C"), network.decode(terms), network.draw(terms), sampled[:3], strict=True
    )
    tiles = [StripTile(title, cloud, image, sample.image) for title, cloud, image, sample in shown]
    tiles.append(StripTile("= A − B + C", clouds[0], images[0]))
    tiles.append(StripTile("D by its code", clouds[-1], images[-1], answer.image))
    return values, Strip(triple.change, tuple(tiles))


def train_codes(network: LatentNetwork, count: int) -> Tensor:
    """Return the codes [count, d] of the first chairs of the train split."""
    with progress(f"train chairs, {network.method}", count) as advance:
        codes = []
        for chair in specified_chairs("train", count):
            codes.append(network.encode(chair.id, cloud_of(chair.load(), chair, seed=0)))
            advance(0)
    return torch.cat(codes)
