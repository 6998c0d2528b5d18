"""Training of the network behind `fd-views` (see `bench.views_network`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from bench.metric_table import VIEWS_WEIGHTS
from bench.train import training_set
from bench.views_network import Labels, ViewsNetwork, to_file
from data_prep.datasets import ProceduralObject, Split
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.shapes.catalogue import CLASSES
from data_prep.shapes.chair_spec import BACKS, draw_chair_spec
from data_prep.training_set import TrainingSet
from data_prep.whole_files import write_whole
from learning.training_loop import denormals_flushed

BATCH = 64
LEARNING_RATE = 2e-3
AUGMENT_LEVELS = 0.1  # brightness of a training picture's object varies by +-10 %
# Reconstructions and `fd-views-grey` are grey: the class has to be seen without colour, too.
GREY_SHARE = 0.25
LUMA = (0.299, 0.587, 0.114)  # Rec. 601
VALIDATION = 40, 8  # objects of a class, views of each
NO_LABEL = -100  # of the back, for what is no chair


@dataclass(frozen=True, eq=False)
class Scores:
    """On objects of the validation split: what the network tells right.

    confusion    int [C, C]: pictures by true (rows) and answered class
    family       share of pictures with the right family, over all classes
    back         of the chairs, with the right back
    azimuth_deg, elevation_deg  median errors [C] in degrees; where a class looks alike from several
                 sides (round tables, most lamps) no azimuth is right
    """

    classes: tuple[str, ...]
    confusion: NDArray[np.int64]
    family: float
    back: float
    azimuth_deg: NDArray[np.float64]
    elevation_deg: NDArray[np.float64]

    def to_text(self) -> str:
        """Shares and errors, then the confusion matrix: a row for each true class."""
        pictures = self.confusion.sum(axis=1)
        right = self.confusion.diagonal()
        lines = [
            f"right: class {right.sum() / pictures.sum():.3f}, family {self.family:.3f}, "
            f"back of chairs {self.back:.3f}",
            f"{'':<12} right azimuth elevation  answered, % of the pictures of the class",
        ]
        for i, name in enumerate(self.classes):
            answered = " ".join(f"{100 * n / pictures[i]:4.0f}" for n in self.confusion[i])
            lines.append(
                f"{name:<12} {right[i] / pictures[i]:.3f} {self.azimuth_deg[i]:7.1f} "
                f"{self.elevation_deg[i]:9.1f}  {answered}"
            )
        return "\n".join(lines)


@denormals_flushed()
def train_views(
    objects: int,
    views: int,
    epochs: int,
    seed: int,
    out: Path = VIEWS_WEIGHTS,
    validation: tuple[int, int] = VALIDATION,
) -> Scores:
    """Train on `objects` of each class (procedural train split), write the weights, score them.

    Adam with a cosine schedule to nought; cross-entropy for class, family and back, squared error
    for the direction of view; convolutions in bfloat16. The file is written whole, after the last
    step. Raises BadInput for fewer than one object, view or epoch.
    """
    for name, value in (("objects", objects), ("views", views), ("epochs", epochs)):
        if value < 1:
            raise BadInput(f"--{name} {value}: must be at least 1")
    torch.manual_seed(seed)
    network = ViewsNetwork(labels())
    data, answers = _labelled(network.labels, "train", objects, views)
    images = torch.from_numpy(data.images).flatten(0, 1)
    steps = epochs * math.ceil(len(images) / BATCH)
    optimizer = torch.optim.Adam(network.parameters(), lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    order = torch.Generator().manual_seed(seed)
    for epoch in range(epochs):
        total = 0.0
        for rows in torch.randperm(len(images), generator=order).split(BATCH):
            with torch.autocast("cpu", torch.bfloat16):  # twice as fast; weights stay float32
                features = network(_varied(images[rows], order))
            loss = _loss(network, features.float(), {n: t[rows] for n, t in answers.items()})
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            optimizer.step()
            schedule.step()
            total += float(loss.detach())
        print(f"epoch {epoch + 1}/{epochs}: loss {total * epochs / steps:.4f}", flush=True)
        if not math.isfinite(total):
            raise FloatingPointError("the loss is not finite; nothing was written")
    write_whole(out, to_file(network))
    return _score(network.eval(), *validation)


def labels() -> Labels:
    """What there is to tell apart in the procedural set."""
    families = (f"{name}/{family}" for name, of in CLASSES.items() for family in of.families)
    return Labels(tuple(CLASSES), tuple(families), BACKS)


def _varied(images: Tensor, rng: torch.Generator) -> Tensor:
    """Pictures uint8 [N, H, W, 3] as float32 [N, 3, H, W], some greyed, objects lighter or darker.

    The white background stays white.
    """
    ink = 255.0 - images.permute(0, 3, 1, 2).float()
    grey = torch.rand(len(images), 1, 1, 1, generator=rng) < GREY_SHARE
    luma = (ink * torch.tensor(LUMA)[:, None, None]).sum(dim=1, keepdim=True)
    level = 1 + AUGMENT_LEVELS * (2 * torch.rand(len(images), 1, 1, 1, generator=rng) - 1)
    return 255.0 - torch.where(grey, luma, ink) * level


def _labelled(
    told: Labels, split: Split, count: int, views: int
) -> tuple[TrainingSet, dict[str, Tensor]]:
    """Pictures of `count` objects of each class, and the right answers about each picture."""
    objects = [ProceduralObject(name, split, i) for name in told.classes for i in range(count)]
    data = training_set(tuple(objects), views)
    azimuth = np.radians(data.azimuth_deg)
    view = np.stack([np.sin(azimuth), np.cos(azimuth), data.elevation_deg / 40], axis=-1)
    answers = np.repeat([_answers(told, obj) for obj in objects], views, axis=0)
    named = zip(("class", "family", "back"), torch.from_numpy(answers).unbind(1), strict=True)
    return data, dict(named) | {"view": torch.from_numpy(view.astype(np.float32)).flatten(0, 1)}


def _answers(told: Labels, obj: ProceduralObject) -> tuple[int, int, int]:
    """Class, family and back of an object, as numbers of the heads' outputs."""
    key = ("procedural", obj.class_name, obj.split, obj.index)
    family = CLASSES[obj.class_name].draw(generator(*key)).family
    chair = obj.class_name == "chair"
    return (
        told.classes.index(obj.class_name),
        told.families.index(f"{obj.class_name}/{family}"),
        told.backs.index(draw_chair_spec(generator(*key)).back) if chair else NO_LABEL,
    )


def _loss(network: ViewsNetwork, features: Tensor, targets: dict[str, Tensor]) -> Tensor:
    answers = {name: head(features) for name, head in network.heads.items()}
    told = sum(_cross_entropy(answers[n], targets[n]) for n in ("class", "family", "back"))
    return told + 8.0 * functional.mse_loss(answers["view"], targets["view"])


def _cross_entropy(answers: Tensor, targets: Tensor) -> Tensor:
    """Mean over the pictures that have a label; nought where none has."""
    total = functional.cross_entropy(answers, targets, ignore_index=NO_LABEL, reduction="sum")
    return total / (targets != NO_LABEL).sum().clamp(min=1)


def _score(network: ViewsNetwork, objects: int, views: int) -> Scores:
    data, true = _labelled(network.labels, "validation", objects, views)
    images = torch.from_numpy(data.images).flatten(0, 1).permute(0, 3, 1, 2)
    with torch.inference_mode():
        features = torch.cat([network(part) for part in images.split(BATCH)])
        found = {name: head(features).double().numpy() for name, head in network.heads.items()}
    classes = len(network.labels.classes)
    right = {n: found[n].argmax(axis=1) == true[n].numpy() for n in ("family", "back")}
    confusion = np.zeros((classes, classes), np.int64)
    np.add.at(confusion, (true["class"].numpy(), found["class"].argmax(axis=1)), 1)
    sin, cos, elevation = found["view"].T
    turn = (np.degrees(np.arctan2(sin, cos)) - data.azimuth_deg.ravel() + 180) % 360 - 180
    tilt = 40 * elevation - data.elevation_deg.ravel()
    return Scores(
        network.labels.classes,
        confusion,
        family=float(right["family"].mean()),
        back=_mean(right["back"][true["back"].numpy() != NO_LABEL]),
        azimuth_deg=_medians(np.abs(turn), classes),
        elevation_deg=_medians(np.abs(tilt), classes),
    )


def _medians(errors: NDArray[np.float64], classes: int) -> NDArray[np.float64]:
    """By class; every class has equally many pictures, one class after the other."""
    return np.median(errors.reshape(classes, -1), axis=1)


def _mean(right: NDArray[np.bool_]) -> float:
    return float(right.mean()) if len(right) else math.nan
