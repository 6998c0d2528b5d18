"""Training of the network behind `fd-views` (see `bench.views_network`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save
from torch import Tensor
from torch.nn import functional

from bench.metric_table import VIEWS_WEIGHTS
from bench.train import training_set
from bench.views_network import ViewsNetwork
from bench.work import write_whole
from data_prep.datasets import ProceduralObject, Split
from data_prep.randomness import generator
from data_prep.shapes.chair_spec import BACKS, FAMILIES, draw_chair_spec
from data_prep.training_set import TrainingSet

BATCH = 64
LEARNING_RATE = 2e-3
AUGMENT_LEVELS = 0.1  # brightness of a training picture's object varies by +-10 %


@dataclass(frozen=True)
class Scores:
    """On objects not trained on: shares of right answers and median errors in degrees."""

    family: float
    back: float
    azimuth_deg: float
    elevation_deg: float


def train_views(
    objects: int, views: int, epochs: int, seed: int, out: Path = VIEWS_WEIGHTS
) -> Scores:
    """Train on `objects` of the procedural train split, write the weights, score on validation.

    Adam with a cosine schedule to nought; cross-entropy for family and back, squared error for the
    direction of view. The file is written whole, after the last step.
    """
    torch.manual_seed(seed)
    torch.set_flush_denormal(True)
    network = ViewsNetwork()
    data, answers = _labelled("train", objects, views)
    images = torch.from_numpy(data.images).flatten(0, 1)
    targets = {name: values.flatten(0, 1) for name, values in answers.items()}
    steps = epochs * (len(images) // BATCH)
    optimizer = torch.optim.Adam(network.parameters(), lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    order = torch.Generator().manual_seed(seed)
    total = 0.0
    for epoch in range(epochs):
        total = 0.0
        for rows in torch.randperm(len(images), generator=order).split(BATCH)[
            : len(images) // BATCH
        ]:
            batch = images[rows].permute(0, 3, 1, 2).float()
            level = 1 + AUGMENT_LEVELS * (2 * torch.rand(len(rows), 1, 1, 1, generator=order) - 1)
            features = network(255.0 - (255.0 - batch) * level)
            loss = _loss(network, features, {n: t[rows] for n, t in targets.items()})
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            optimizer.step()
            schedule.step()
            total += float(loss.detach())
        print(f"epoch {epoch + 1}/{epochs}: loss {total / (len(images) // BATCH):.4f}", flush=True)
    if not math.isfinite(total):
        raise FloatingPointError("the loss is not finite; nothing was written")
    state = {k: v.contiguous() for k, v in network.state_dict().items()}
    write_whole(out, save(state))
    return _score(network.eval())


def _labelled(split: Split, count: int, views: int) -> tuple[TrainingSet, dict[str, Tensor]]:
    objects = tuple(ProceduralObject("chair", split, i) for i in range(count))
    data = training_set(objects, views)
    specs = [draw_chair_spec(generator("procedural", "chair", split, i)) for i in range(count)]
    azimuth = np.radians(data.azimuth_deg)
    view = np.stack([np.sin(azimuth), np.cos(azimuth), data.elevation_deg / 40], axis=-1)
    labels = {
        "family": [FAMILIES.index(spec.family) for spec in specs],
        "back": [BACKS.index(spec.back) for spec in specs],
    }
    answers = {n: torch.tensor(v)[:, None].expand(-1, views) for n, v in labels.items()}
    return data, answers | {"view": torch.from_numpy(view.astype(np.float32))}


def _loss(network: ViewsNetwork, features: Tensor, targets: dict[str, Tensor]) -> Tensor:
    answers = {name: head(features) for name, head in network.heads.items()}
    classes = sum(functional.cross_entropy(answers[n], targets[n]) for n in ("family", "back"))
    return classes + 4.0 * functional.mse_loss(answers["view"], targets["view"])


def _score(network: ViewsNetwork) -> Scores:
    data, answers = _labelled("validation", 100, 8)
    images = torch.from_numpy(data.images).flatten(0, 1).permute(0, 3, 1, 2)
    with torch.inference_mode():
        features = torch.cat([network(part) for part in images.split(BATCH)])
        found = {name: head(features) for name, head in network.heads.items()}
    right = {n: float((found[n].argmax(1) == answers[n].flatten()).float().mean())
             for n in ("family", "back")}  # fmt: skip
    sin, cos, elevation = found["view"].double().numpy().T
    azimuth = np.degrees(np.arctan2(sin, cos))
    turn = (azimuth - data.azimuth_deg.ravel() + 180) % 360 - 180
    tilt = 40 * elevation - data.elevation_deg.ravel()
    return Scores(
        right["family"],
        right["back"],
        float(np.median(np.abs(turn))),
        float(np.median(np.abs(tilt))),
    )
