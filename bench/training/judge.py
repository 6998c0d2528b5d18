"""Training of the judge of drawn images (see `bench.judges.judge`), on true images alone.

Two images of one chair shall have codes closer to each other than to those of the other chairs
of the batch (InfoNCE). So that this cannot be had by colour, each image is repainted and damaged
on its own (`augment`), and the same features have to tell the rough shape of the chair's cloud.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.torch import save
from torch import Tensor, nn
from torch.nn import functional

from bench.judges import JUDGE_WEIGHTS
from bench.judges.answers import azimuth_error_deg, elevation_error_deg, found, gallery
from bench.judges.judge import FEATURES, JudgeNetwork, darkness, greyscale, judge
from bench.training.classifier import CosineTrainer, JudgeConfig, view_answers
from data_prep.datasets.objects import GreyObject
from data_prep.datasets.registry import ProceduralObject, Split
from data_prep.datasets.training_set import training_set
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole
from learning import checkpoint
from learning.processes import is_first
from learning.training_loop import denormals_flushed, seeded

OBJECTS = 48  # a batch is two images of each
LEARNING_RATE = 2e-3
WARM_UP = 0.05  # of all steps
_WEIGHT_DECAY = 0.05
_TEMPERATURE = 0.1
_VIEW_WEIGHT = 6.0  # makes the terms of the loss alike in size half-way through the training
_SHAPE_WEIGHT = 0.5
_SHAPE_CELLS = 8  # a side of the grid that describes a cloud
_SHAPE_NUMBERS = 24
VALIDATION = (100, 8)  # objects, views
_VALIDATIONS = 16  # in a training
_WORST_MERIT = -5.0  # of the scores of a validation: below any
_CHUNK = 250  # objects rendered at a time: colours are let go before they fill the memory


@dataclass(frozen=True)
class JudgeScores:
    """The scores on objects not trained on: median errors in degrees, and the share recognised.

    An object is recognised where, of all validation objects, its mean code over the other true
    views is the nearest to the image's (Euclidean).
    """

    azimuth_deg: float
    elevation_deg: float
    retrieval: float


@dataclass(frozen=True, eq=False)
class JudgeData:
    """The images of N objects from V views each, without colours, and their clouds.

    painted        uint8 [N, V, 128, 128], luma of the true images
    neutral        uint8 [N, V, 128, 128], the same objects in uniform grey
    azimuth_deg    float64 [N, V], -180..180
    elevation_deg  float64 [N, V], -40..40
    clouds         float32 [N, 2048, 3], unit-sphere coordinates
    """

    painted: NDArray[np.uint8]
    neutral: NDArray[np.uint8]
    azimuth_deg: NDArray[np.float64]
    elevation_deg: NDArray[np.float64]
    clouds: NDArray[np.float32]


@dataclass(frozen=True)
class JudgeSizes:
    """The objects of a batch, and the objects and views of the validation."""

    batch: int = OBJECTS
    validation: tuple[int, int] = VALIDATION


@denormals_flushed()
def train_judge(
    objects: int,
    views: int,
    steps: int,
    seed: int,
    out: Path = JUDGE_WEIGHTS,
    folder: Path = Path("training/judge"),
    sizes: JudgeSizes = JudgeSizes(),
) -> dict[str, JudgeScores]:
    """Train on `objects` of the train split; return the scores of the weights in `out`.

    The split is procedural.

    The scores are for validation images as they are ("true"), "blurred" (sigma 1.5 px) and in
    uniform grey ("neutral"). AdamW with a cosine schedule to zero. A training in `folder` is
    continued. `out` is written whole, at the end: the weights whose validation was best, where 4
    degrees of azimuth weigh as much as a tenth of the objects found. Raises BadInput for fewer
    objects or views than a batch holds, and as `learning.training_loop.run`.
    """
    if objects < sizes.batch or views < 2 or steps < 1:
        raise BadInput(
            f"--objects {objects} --views {views} --steps {steps}: "
            f"give at least {sizes.batch} objects, 2 views and 1 step"
        )
    data = judge_data("train", objects, views)
    validation = judge_data("validation", *sizes.validation)
    trainer = JudgeTrainer(data, JudgeConfig(steps, seed), validation, sizes.batch)
    trainer.train(folder)
    if is_first():
        write_whole(out, save(trainer.best))
    network = JudgeNetwork()
    network.load_state_dict(trainer.best)
    network.eval()
    return {
        name: _score_judge(network, validation, queries)
        for name, queries in {
            "true": validation.painted,
            "blurred": blurred(validation.painted, 1.5),
            "neutral": validation.neutral,
        }.items()
    }


class JudgeTrainer(CosineTrainer):
    """The state that a step changes, and the weights whose validation was best so far."""

    kind = "judge"
    peak = LEARNING_RATE
    parts = ("network", "shape", "optimizer", "random")
    kept = ("best_merit", "order", "steps_done")

    def __init__(
        self,
        data: JudgeData,
        config: JudgeConfig,
        validation: JudgeData,
        objects: int = OBJECTS,
        score: Callable[[JudgeNetwork, JudgeData], JudgeScores] | None = None,
    ) -> None:
        super().__init__(data, config, batch=2 * objects)
        self.validation, self.objects = validation, objects
        self.score = score or _score_judge
        # `shape` is an aid to the training only
        self.network, self.shape = seeded(
            config.seed, lambda: (JudgeNetwork(), nn.Linear(FEATURES, _SHAPE_NUMBERS))
        )
        self.painted = torch.from_numpy(data.painted)
        self.neutral = torch.from_numpy(data.neutral)
        self.view = torch.from_numpy(view_answers(data.azimuth_deg, data.elevation_deg))
        self.shapes = torch.from_numpy(shape_descriptors(data.clouds))
        parameters = [*self.network.parameters(), *self.shape.parameters()]
        self.optimizer = torch.optim.AdamW(parameters, LEARNING_RATE, weight_decay=_WEIGHT_DECAY)
        self.best = _compact(self.network)
        self.best_merit = torch.tensor(_WORST_MERIT, dtype=torch.float64)

    def state(self) -> dict[str, Tensor]:
        """Return the state with the best weights."""
        return super().state() | {f"best.{name}": value for name, value in self.best.items()}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Restore what `state` has returned."""
        super().restore(state)
        self.best = checkpoint.sub_state(state, "best")

    def learning_rates(self, steps: int) -> str:
        """Return the whole schedule in words."""
        return f"{super().learning_rates(steps)}, rising over the first {self._warm_up()}"

    def _warm_up(self) -> int:
        return max(1, round(WARM_UP * self.config.steps))

    def rate(self, done: int) -> float:
        """Return the learning rate of the step after `done` steps."""
        return min(self.peak * ((done + 1) / self._warm_up()), super().rate(done))

    def take_step(self) -> dict[str, Tensor]:
        """Take a step on two images of each object of a batch, sometimes with a validation."""
        loss = self._loss()
        self.minimise(loss, self.optimizer, self.rate(int(self.steps_done)))
        self.steps_done += 1
        step, steps = int(self.steps_done), self.config.steps
        if step % math.ceil(steps / _VALIDATIONS) == 0 or step == steps:
            self._validate(f"step {step}/{steps}")
        return {"loss": loss.detach()}

    def _validate(self, step: str) -> None:
        scores = self.score(self.network.eval(), self.validation)
        self.network.train()
        if self.processes.rank == 0:
            print(f"{step}: {scores}", file=sys.stderr, flush=True)
        merit = scores.retrieval - scores.azimuth_deg / 40
        if merit > self.best_merit:
            self.best_merit.fill_(merit)
            self.best = _compact(self.network)

    def _loss(self) -> Tensor:
        if len(self.order) < self.objects:
            self.order = torch.randperm(len(self.view), generator=self.random)
        objects, self.order = self.order[: self.objects], self.order[self.objects :]
        chosen = torch.rand(self.view.shape[1], self.objects, generator=self.random).argsort(0)[:2]
        rows, columns = objects.repeat(2), chosen.flatten()
        # A mirrored chair from the other side: both its images, hence a chair like any other.
        mirrored = (torch.rand(self.objects, generator=self.random) < 0.5).repeat(2)
        images = augment(
            darkness(self.painted[rows, columns]),
            darkness(self.neutral[rows, columns]),
            self.random,
        )
        images = torch.where(mirrored[:, None, None, None], images.flip(3), images)
        view = self.view[rows, columns]
        view[:, 0] = torch.where(mirrored, -view[:, 0], view[:, 0])
        with torch.autocast("cpu", torch.bfloat16):
            features = self.network.body(images.contiguous(memory_format=torch.channels_last))
        features = features.float()
        answers = self.network.answers(features)
        return (
            contrast(answers[:, 3:])
            + _VIEW_WEIGHT * functional.smooth_l1_loss(answers[:, :3], view, beta=0.1)
            + _SHAPE_WEIGHT
            * functional.smooth_l1_loss(self.shape(features), self.shapes[mirrored.long(), rows])
        )


def contrast(codes: Tensor) -> Tensor:
    """Return InfoNCE of codes [2 N, d] of length 1; rows i and i + N are the same object.

    The mean of -log of the share that the partner has among all others, by exp(cosine / 0.1).
    """
    likeness = codes @ codes.T / _TEMPERATURE
    likeness = likeness.masked_fill(torch.eye(len(codes), dtype=torch.bool), -math.inf)
    return functional.cross_entropy(likeness, torch.arange(len(codes)).roll(len(codes) // 2))


def augment(painted: Tensor, neutral: Tensor, random: torch.Generator) -> Tensor:
    """Return images as a method may draw them: darkness [N, 1, 128, 128] in 0..1.

    Each image is changed on its own terms.

    `painted` and `neutral` are darkness of the same images in their colours and in uniform grey.
    Colours fade towards grey, brightness, contrast and gamma of the object change while white stays
    white; some images lose thin parts or a patch, some are blurred or were drawn smaller, and the
    background is not quite clean.
    """
    count = len(painted)

    def uniform(low: float, high: float) -> Tensor:
        return low + (high - low) * torch.rand(count, 1, 1, 1, generator=random)

    def some(share: float) -> Tensor:
        return (torch.rand(count, generator=random) < share).nonzero().flatten()

    x = torch.lerp(neutral, painted, uniform(-0.6, 1.4).clamp(0, 1))  # each end in 3 of 10
    x = x.clamp_min(1e-6) ** torch.exp(uniform(-0.5, 0.5)) * torch.exp(uniform(-0.5, 0.3))
    thin = some(0.15)
    eroded = -functional.max_pool2d(-x[thin], 3, 1, 1)  # lines of up to 2 px go
    x[thin] = torch.minimum(functional.max_pool2d(eroded, 3, 1, 1), x[thin])
    for i in some(0.25).tolist():
        high, wide, top, left = (torch.rand(4, generator=random) * 24 + 4).int().tolist()
        top, left = 4 * top - 16, 4 * left - 16  # 0..95
        x[i, :, top : top + high, left : left + wide] = 0
    smaller = some(0.2)
    side = int(torch.randint(40, 112, (1,), generator=random))
    small = functional.interpolate(x[smaller], (side, side), mode="area")
    x[smaller] = functional.interpolate(small, x.shape[2:], mode="bilinear")
    soft = some(0.55)
    x[soft] = blur(x[soft], uniform(0.3, 2.0).flatten()[soft])
    clouding = torch.randn(count, 1, 8, 8, generator=random) * uniform(-0.04, 0.04).clamp_min(0)
    x = x + functional.interpolate(clouding, x.shape[2:], mode="bilinear")
    x = x + torch.randn(x.shape, generator=random) * uniform(-0.03, 0.04).clamp_min(0)
    return x.clamp(0, 1)


def blur(images: Tensor, sigma_px: Tensor) -> Tensor:
    """Return [N, 1, H, W] with a Gaussian blur of sigma [N] pixels each, 0 < sigma <= 2.

    Outside the image the darkness is zero.
    """
    reach = torch.arange(-6.0, 7.0)
    kernel = torch.exp(-0.5 * (reach / sigma_px[:, None]) ** 2)
    kernel = (kernel / kernel.sum(1, keepdim=True))[:, None]
    x, count = images.transpose(0, 1), len(images)
    if count == 0:
        return images
    x = functional.conv2d(x, kernel[:, :, :, None], padding=(6, 0), groups=count)
    return functional.conv2d(x, kernel[:, :, None, :], padding=(0, 6), groups=count).transpose(0, 1)


def blurred(grey: NDArray[np.uint8], sigma_px: float) -> NDArray[np.uint8]:
    """Return luma uint8 [..., 128, 128], blurred and rounded."""
    flat = torch.from_numpy(grey.reshape(-1, *grey.shape[-2:]))
    parts = [blur(darkness(p), torch.full((len(p),), sigma_px)) for p in flat.split(64)]
    light = 255 * (1 - torch.cat(parts)[:, 0])
    return (light + 0.5).floor().clamp(0, 255).to(torch.uint8).numpy().reshape(grey.shape)


def shape_descriptors(clouds: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return rough shapes of clouds [N, P, 3] in the unit sphere: float32 [2, N, _SHAPE_NUMBERS].

    Row 0 is for the objects, row 1 for their mirror images (x to -x). The square root of the share
    of points in each cell of a grid, on its first principal components over all, each with variance
    1; where the objects are fewer than the components, the rest is zero.
    """
    count, cells = len(clouds), _SHAPE_CELLS
    place = np.clip((clouds + 1) / 2 * cells, 0, cells - 1e-3).astype(int)
    index = (place[..., 0] * cells + place[..., 1]) * cells + place[..., 2]
    grid = np.stack([np.bincount(row, minlength=cells**3) for row in index]) / clouds.shape[1]
    grid = np.sqrt(grid).reshape(count, cells, cells, cells)
    both = np.concatenate([grid, grid[:, ::-1]]).reshape(2 * count, -1)
    left, values, _ = np.linalg.svd(both - both.mean(0), full_matrices=False)
    kept = min(_SHAPE_NUMBERS, int((values > 1e-6 * values[0]).sum()))
    numbers = np.zeros((2 * count, _SHAPE_NUMBERS), np.float32)
    numbers[:, :kept] = left[:, :kept] * math.sqrt(2 * count)
    return numbers.reshape(2, count, -1)


def judge_data(split: Split, count: int, views: int) -> JudgeData:
    """Return the first `count` chairs of a split of the procedural set, rendered twice."""
    objects = [ProceduralObject("chair", split, i) for i in range(count)]
    painted, neutral, angles, clouds = [], [], [], []
    for start in range(0, count, _CHUNK):
        chunk = objects[start : start + _CHUNK]
        rendered = training_set(tuple(chunk), views, quiet=not is_first())
        painted.append(greyscale(rendered.images))
        angles.append((rendered.azimuth_deg, rendered.elevation_deg))
        clouds.append(rendered.clouds)
        neutral.append(
            greyscale(
                training_set(tuple(map(GreyObject, chunk)), views, quiet=not is_first()).images
            )
        )
    azimuth, elevation = (np.concatenate(each) for each in zip(*angles, strict=True))
    return JudgeData(
        np.concatenate(painted), np.concatenate(neutral), azimuth, elevation, np.concatenate(clouds)
    )


def _score_judge(
    network: JudgeNetwork, truth: JudgeData, queries: NDArray[np.uint8] | None = None
) -> JudgeScores:
    """Return the scores for `queries`, luma uint8 [N, V, 128, 128]; by default the true ones.

    Codes of objects are always means over true images.
    """
    true = _judge_luma(network, truth.painted)
    return scores_of(truth, true, true if queries is None else _judge_luma(network, queries))


def scores_of(
    truth: JudgeData, true: NDArray[np.float32], queries: NDArray[np.float32]
) -> JudgeScores:
    """Return the scores of answers [N V, 3 + CODE] to queries, given the answers to true images."""
    shown = [(f"{chair:06d}", view) for chair, view in np.ndindex(truth.azimuth_deg.shape)]
    return JudgeScores(
        float(np.median(azimuth_error_deg(queries, truth.azimuth_deg.ravel()))),
        float(np.median(elevation_error_deg(queries, truth.elevation_deg.ravel()))),
        float(found(gallery("chair", shown, true), queries, shown).mean()),
    )


def _judge_luma(network: JudgeNetwork, grey: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return answers [N V, 3 + CODE] to luma [N, V, 128, 128]."""
    return judge(network, grey.reshape(-1, *grey.shape[2:], 1).repeat(3, axis=-1))


def _compact(network: JudgeNetwork) -> dict[str, Tensor]:
    """Return the state with kernels in half precision: 3 MB.

    Statistics keep their range.
    """
    return {
        name: (value.half() if value.ndim > 1 else value).contiguous().clone()
        for name, value in network.state_dict().items()
    }
