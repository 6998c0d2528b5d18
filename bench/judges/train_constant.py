"""The fit of the best constant picture (see `baselines.constant`): gradient ascent on SSIM."""

from __future__ import annotations

import functools
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from baselines.constant import CONSTANT_PICTURE
from bench.commands.train import training_set
from bench.metrics.structural_similarity import C1, C2, SIGMA, WINDOW, ssim_per_image
from data_prep.datasets import ProceduralObject, Split
from data_prep.failures import BadInput
from data_prep.images import blank
from data_prep.whole_files import write_whole

BATCH = 64
LEARNING_RATE = 4.0  # levels of 255 a step at first; falls to nought
VALIDATION = (100, 8)  # objects, views


@dataclass(frozen=True)
class Scores:
    """Mean SSIM on chairs that the picture was not fitted to, and that of white beside it."""

    constant: float
    blank: float


def train_constant(
    objects: int, views: int, steps: int, seed: int, out: Path = CONSTANT_PICTURE
) -> Scores:
    """Fit to `objects` of the procedural train split, write the picture, score on validation.

    Raises BadInput where there is nothing to fit to.
    """
    for name, value in (("objects", objects), ("views", views), ("steps", steps)):
        if value < 1:
            raise BadInput(f"--{name} {value}: must be at least 1")
    picture = fit(_pictures("train", objects, views), steps, seed)
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG", optimize=True)
    write_whole(out, buffer.getvalue())
    truth = _pictures("validation", *VALIDATION)
    white = blank(1)[0]
    return Scores(*(mean_ssim(truth, chosen) for chosen in (picture, white)))


def fit(truth: NDArray[np.uint8], steps: int, seed: int) -> NDArray[np.uint8]:
    """The picture [H, W, 3] whose mean SSIM with pictures uint8 [N, H, W, 3] is highest, rounded.

    Adam on random batches with a cosine schedule, from the mean picture. SSIM is not concave: this
    is a local maximum.
    """
    order = torch.Generator().manual_seed(seed)
    pictures = torch.from_numpy(truth).permute(0, 3, 1, 2)
    start = torch.from_numpy(truth.mean(axis=0, dtype=np.float64)).float()
    picture = start.permute(2, 0, 1).clone().requires_grad_()
    optimizer = torch.optim.Adam([picture], lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for step in range(steps):
        rows = torch.randint(len(pictures), (min(BATCH, len(pictures)),), generator=order)
        value = torch_ssim(pictures[rows].float(), picture[None])
        optimizer.zero_grad(set_to_none=True)
        (-value).backward()
        optimizer.step()
        schedule.step()
        with torch.no_grad():
            picture.clamp_(0.0, 255.0)
        if step % 50 == 49 or step == steps - 1:
            print(f"step {step + 1}/{steps}: ssim {float(value.detach()):.4f}", flush=True)
    found = picture.detach().permute(1, 2, 0).numpy()
    return np.floor(found + np.float32(0.5)).astype(np.uint8)


def torch_ssim(a: Tensor, b: Tensor) -> Tensor:
    """Mean SSIM of pictures float32 [N, 3, H, W] in 0..255, N or 1 each; has a gradient.

    The protocol of `bench.metrics.structural_similarity`, in float32 and with the two factors that
    the product of its three comes to: it agrees to about 1e-4 and is for fitting, not for scoring.
    """
    mean_a, mean_b = _blur(a), _blur(b)
    # About white, which is most of a picture, so that little is lost where nothing is drawn.
    dark_a, dark_b = 255.0 - a, 255.0 - b
    var_a = (_blur(dark_a * dark_a) - (255.0 - mean_a) ** 2).clamp(min=0.0)
    var_b = (_blur(dark_b * dark_b) - (255.0 - mean_b) ** 2).clamp(min=0.0)
    cov = _blur(dark_a * dark_b) - (255.0 - mean_a) * (255.0 - mean_b)
    luminance = (2.0 * mean_a * mean_b + C1) / (mean_a**2 + mean_b**2 + C1)
    return (luminance * (2.0 * cov + C2) / (var_a + var_b + C2)).mean()


def mean_ssim(truth: NDArray[np.uint8], picture: NDArray[np.uint8]) -> float:
    """Mean SSIM of one picture [H, W, 3] with each of [N, H, W, 3], by the metric itself."""
    drawn = np.broadcast_to(picture, truth.shape)
    return float(ssim_per_image(truth, drawn).ssim.mean())


def _blur(images: Tensor) -> Tensor:
    """The Gaussian window of the protocol, valid windows only.

    As products with banded matrices: seven times as fast as convolutions of single planes.
    """
    height, width = images.shape[-2:]
    return _band(height) @ images @ _band(width).T


@functools.cache
def _band(length: int) -> Tensor:
    """[windows, length]: what a window takes of a row of pixels."""
    x = torch.arange(WINDOW) - (WINDOW - 1) / 2
    weights = torch.exp(-(x**2) / (2 * SIGMA**2))
    matrix = torch.zeros(length - WINDOW + 1, length)
    for i, row in enumerate(matrix):
        row[i : i + WINDOW] = weights / weights.sum()
    return matrix


def _pictures(split: Split, objects: int, views: int) -> NDArray[np.uint8]:
    chosen = tuple(ProceduralObject("chair", split, i) for i in range(objects))
    images = training_set(chosen, views).images
    return images.reshape(-1, *images.shape[2:])
