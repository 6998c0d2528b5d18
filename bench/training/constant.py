"""The fit of the best constant image (see `baselines.reference`): gradient ascent on SSIM."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from baselines.reference import CONSTANT_IMAGE
from bench.metrics.structural_similarity import ssim_per_image
from data_prep.datasets.registry import ProceduralObject, Split
from data_prep.datasets.training_set import training_set
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole
from data_prep.rendering.images import blank
from learning.image_losses import structural_similarity

BATCH = 64
LEARNING_RATE = 4.0  # levels of 255 a step at first; falls to zero
VALIDATION = (100, 8)  # objects, views


@dataclass(frozen=True)
class _ConstantScores:
    """The mean SSIM of the image on chairs that it was not fitted to, and that of white."""

    constant: float
    blank: float


def train_constant(
    objects: int, views: int, steps: int, seed: int, out: Path = CONSTANT_IMAGE
) -> _ConstantScores:
    """Fit the image to `objects` of the train split, write it, and return its scores.

    The split is procedural; the scores are those on validation.

    Raises BadInput where there is nothing to fit to.
    """
    for name, value in (("objects", objects), ("views", views), ("steps", steps)):
        if value < 1:
            raise BadInput(f"--{name} {value}: must be at least 1")
    image = fit(_images("train", objects, views), steps, seed)
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "PNG", optimize=True)
    write_whole(out, buffer.getvalue())
    truth = _images("validation", *VALIDATION)
    white = blank(1)[0]
    return _ConstantScores(*(mean_ssim(truth, chosen) for chosen in (image, white)))


def fit(truth: NDArray[np.uint8], steps: int, seed: int) -> NDArray[np.uint8]:
    """Return the rounded image [H, W, 3] with the highest mean SSIM with [N, H, W, 3], uint8.

    Adam on random batches with a cosine schedule, from the mean image. SSIM is not concave: this
    is a local maximum.
    """
    order = torch.Generator().manual_seed(seed)
    images = torch.from_numpy(truth).permute(0, 3, 1, 2)
    start = torch.from_numpy(truth.mean(axis=0, dtype=np.float64)).float()
    image = start.permute(2, 0, 1).clone().requires_grad_()
    optimizer = torch.optim.Adam([image], lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for step in range(steps):
        rows = torch.randint(len(images), (min(BATCH, len(images)),), generator=order)
        value = structural_similarity(images[rows] / 255, image[None] / 255, every=1)
        optimizer.zero_grad(set_to_none=True)
        (-value).backward()
        optimizer.step()
        schedule.step()
        with torch.no_grad():
            image.clamp_(0.0, 255.0)
        if step % 50 == 49 or step == steps - 1:
            print(f"step {step + 1}/{steps}: ssim {float(value.detach()):.4f}", flush=True)
    fitted = image.detach().permute(1, 2, 0).numpy()
    return np.floor(fitted + np.float32(0.5)).astype(np.uint8)


def mean_ssim(truth: NDArray[np.uint8], image: NDArray[np.uint8]) -> float:
    """Return the mean SSIM of an image [H, W, 3] with each of [N, H, W, 3], by the metric."""
    drawn = np.broadcast_to(image, truth.shape)
    return float(ssim_per_image(truth, drawn).ssim.mean())


def _images(split: Split, objects: int, views: int) -> NDArray[np.uint8]:
    chosen = tuple(ProceduralObject("chair", split, i) for i in range(objects))
    images = training_set(chosen, views).images
    return images.reshape(-1, *images.shape[2:])
