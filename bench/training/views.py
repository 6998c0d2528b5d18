"""Training of the network behind `fd-views` (see `bench.judges.views`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from bench.judges import VIEWS_WEIGHTS
from bench.judges.answers import azimuth_error_deg, elevation_error_deg
from bench.judges.views import Labels, ViewsNetwork, to_file
from bench.training.classifier import CosineTrainer, JudgeConfig, view_answers
from data_prep.datasets.registry import ProceduralObject, Split
from data_prep.datasets.training_set import TrainingSet, training_set
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole
from data_prep.randomness import generator
from data_prep.shapes.catalogue import CLASSES
from data_prep.shapes.chair.spec import BACKS, draw_chair_spec
from learning.processes import is_first
from learning.training_loop import denormals_flushed, seeded

BATCH = 64
LEARNING_RATE = 2e-3
_AUGMENT_LEVELS = 0.1  # brightness of a training image's object varies by +-10 %
# Reconstructions and `fd-views-grey` are grey: the class has to be seen without colour, too.
_GREY_SHARE = 0.25
_LUMA = (0.299, 0.587, 0.114)  # Rec. 601
VALIDATION = 40, 8  # objects of a class, views of each
NO_LABEL = -100  # of the back, for what is no chair


@dataclass(frozen=True, eq=False)
class _ViewsScores:
    """The network's scores on objects of the validation split.

    confusion    int [C, C]: images by true (rows) and answered class
    family       share of images with the right family, over all classes
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
        """Return shares and errors, then the confusion matrix: a row for each true class."""
        counts = self.confusion.sum(axis=1)
        right = self.confusion.diagonal()
        lines = [
            f"right: class {right.sum() / counts.sum():.3f}, family {self.family:.3f}, "
            f"back of chairs {self.back:.3f}",
            f"{'':<12} right azimuth elevation  answered, % of the images of the class",
        ]
        for i, name in enumerate(self.classes):
            answered = " ".join(f"{100 * n / counts[i]:4.0f}" for n in self.confusion[i])
            lines.append(
                f"{name:<12} {right[i] / counts[i]:.3f} {self.azimuth_deg[i]:7.1f} "
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
    folder: Path = Path("training/views"),
) -> _ViewsScores:
    """Train on `objects` of each class (procedural train split), write the weights, score them.

    Adam with a cosine schedule to zero; cross-entropy for class, family and back, squared error for
    the direction of view; convolutions in bfloat16. A training in `folder` is continued. `out` is
    written whole, after the last step. Raises BadInput for fewer than one object, view or epoch,
    and as `learning.training_loop.run`.
    """
    for name, value in (("objects", objects), ("views", views), ("epochs", epochs)):
        if value < 1:
            raise BadInput(f"--{name} {value}: must be at least 1")
    known = labels()
    data, answers = _labelled(known, "train", objects, views)
    steps = epochs * math.ceil(data.images[..., 0, 0, 0].size / BATCH)
    trainer = ViewsTrainer((data.images, answers), JudgeConfig(steps, seed), known, BATCH)
    trainer.train(folder)
    if is_first():
        write_whole(out, to_file(trainer.network))
    return _score(trainer.network.eval(), *validation)


class ViewsTrainer(CosineTrainer):
    """The state that a step changes: images uint8 [N, V, H, W, 3] and answers, once in an epoch."""

    kind = "views"
    peak = LEARNING_RATE
    parts = ("network", "optimizer", "random")

    def __init__(
        self,
        learned: tuple[NDArray[np.uint8], dict[str, Tensor]],
        config: JudgeConfig,
        known: Labels,
        batch: int = BATCH,
    ) -> None:
        super().__init__(learned, config, batch)
        images, self.answers = learned
        self.images = torch.from_numpy(images).flatten(0, 1)
        self.network = seeded(config.seed, lambda: ViewsNetwork(known))
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=LEARNING_RATE)

    def take_step(self) -> dict[str, Tensor]:
        """Take a step on the next images and return the loss."""
        if not len(self.order):
            self.order = torch.randperm(len(self.images), generator=self.random)
        rows, self.order = self.order[: self.batch], self.order[self.batch :]
        with torch.autocast("cpu", torch.bfloat16):  # twice as fast; weights stay float32
            features = self.network(_varied(self.images[rows], self.random))
        targets = {name: answer[rows] for name, answer in self.answers.items()}
        loss = _loss(self.network, features.float(), targets)
        self.minimise(loss, self.optimizer, self.rate(int(self.steps_done)))
        self.steps_done += 1
        return {"loss": loss.detach()}


def labels() -> Labels:
    """Return the labels to be distinguished in the procedural set."""
    families = (f"{name}/{family}" for name, entry in CLASSES.items() for family in entry.families)
    return Labels(tuple(CLASSES), tuple(families), BACKS)


def _varied(images: Tensor, rng: torch.Generator) -> Tensor:
    """Return images uint8 [N, H, W, 3] as float32 [N, 3, H, W], some greyed or relit.

    Objects get lighter or darker; the white background stays white.
    """
    ink = 255.0 - images.permute(0, 3, 1, 2).float()
    grey = torch.rand(len(images), 1, 1, 1, generator=rng) < _GREY_SHARE
    luma = (ink * torch.tensor(_LUMA)[:, None, None]).sum(dim=1, keepdim=True)
    level = 1 + _AUGMENT_LEVELS * (2 * torch.rand(len(images), 1, 1, 1, generator=rng) - 1)
    return 255.0 - torch.where(grey, luma, ink) * level


def _labelled(
    known: Labels, split: Split, count: int, views: int
) -> tuple[TrainingSet, dict[str, Tensor]]:
    """Return images of `count` objects of each class, and the right answers about each image."""
    objects = [ProceduralObject(name, split, i) for name in known.classes for i in range(count)]
    data = training_set(tuple(objects), views, quiet=not is_first())
    view = torch.from_numpy(view_answers(data.azimuth_deg, data.elevation_deg))
    answers = np.repeat([_answers(known, obj) for obj in objects], views, axis=0)
    named = zip(("class", "family", "back"), torch.from_numpy(answers).unbind(1), strict=True)
    return data, dict(named) | {"view": view.flatten(0, 1)}


def _answers(known: Labels, obj: ProceduralObject) -> tuple[int, int, int]:
    """Return class, family and back of an object, as numbers of the heads' outputs."""
    key = ("procedural", obj.class_name, obj.split, obj.index)
    family = CLASSES[obj.class_name].draw(generator(*key)).family
    chair = obj.class_name == "chair"
    return (
        known.classes.index(obj.class_name),
        known.families.index(f"{obj.class_name}/{family}"),
        known.backs.index(draw_chair_spec(generator(*key)).back) if chair else NO_LABEL,
    )


def _loss(network: ViewsNetwork, features: Tensor, targets: dict[str, Tensor]) -> Tensor:
    answers = {name: head(features) for name, head in network.heads.items()}
    known = sum(_cross_entropy(answers[n], targets[n]) for n in ("class", "family", "back"))
    return known + 8.0 * functional.mse_loss(answers["view"], targets["view"])


def _cross_entropy(answers: Tensor, targets: Tensor) -> Tensor:
    """Return the mean over the images that have a label; zero where none has."""
    total = functional.cross_entropy(answers, targets, ignore_index=NO_LABEL, reduction="sum")
    return total / (targets != NO_LABEL).sum().clamp(min=1)


def _score(network: ViewsNetwork, objects: int, views: int) -> _ViewsScores:
    data, true = _labelled(network.labels, "validation", objects, views)
    images = torch.from_numpy(data.images).flatten(0, 1).permute(0, 3, 1, 2)
    with torch.inference_mode():
        features = torch.cat([network(part) for part in images.split(BATCH)])
        answers = {name: head(features).double().numpy() for name, head in network.heads.items()}
    classes = len(network.labels.classes)
    right = {n: answers[n].argmax(axis=1) == true[n].numpy() for n in ("family", "back")}
    confusion = np.zeros((classes, classes), np.int64)
    np.add.at(confusion, (true["class"].numpy(), answers["class"].argmax(axis=1)), 1)
    azimuth_error = azimuth_error_deg(answers["view"], data.azimuth_deg.ravel())
    elevation_error = elevation_error_deg(answers["view"], data.elevation_deg.ravel())
    return _ViewsScores(
        network.labels.classes,
        confusion,
        family=float(right["family"].mean()),
        back=_mean(right["back"][true["back"].numpy() != NO_LABEL]),
        azimuth_deg=_medians(azimuth_error, classes),
        elevation_deg=_medians(elevation_error, classes),
    )


def _medians(errors: NDArray[np.float64], classes: int) -> NDArray[np.float64]:
    """Return medians by class; all have equally many images, one class after the other."""
    return np.median(errors.reshape(classes, -1), axis=1)


def _mean(right: NDArray[np.bool_]) -> float:
    return float(right.mean()) if len(right) else math.nan
