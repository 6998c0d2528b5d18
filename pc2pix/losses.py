"""Loss functions: Chamfer distance, angular error, the paper's Eq. 6 and 7, reconstruction.

Pure functions of tensors. `_Objective` holds what the paper and the code weigh differently.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import torch
from scipy.spatial import KDTree
from torch import Tensor
from torch.nn import functional

from learning.image_losses import weighted_error
from pc2pix.model import DiscriminatorOutput, sine_cosine

AZIMUTH_RANGE_RAD = 2 * math.pi  # normalised azimuth 0..1 is -180..180 degrees
ELEVATION_RANGE_RAD = 0.4444 * math.pi  # 0..1 is -40..40 degrees; the code rounds 4/9


def chamfer(a: Tensor, b: Tensor) -> Tensor:
    """Return the Chamfer distance of clouds, from a to b plus from b to a; a scalar.

    It is the mean squared distance to the nearest neighbour.

    a [B, N, 3] and b [B, M, 3], neither empty; means run over batch and points (the original's
    loss; no square root). Zero for equal sets, NaN where a coordinate is. Neighbours are found
    without a gradient; the distances are differences of the pairs found, so that no cancellation
    can make them inexact or negative.
    """
    with torch.no_grad():
        nearest_b, nearest_a = _nearest(a, b), _nearest(b, a)
    return (a - _rows(b, nearest_b)).square().sum(-1).mean() + (
        b - _rows(a, nearest_a)
    ).square().sum(-1).mean()


def _nearest(a: Tensor, b: Tensor) -> Tensor:
    """Return the index [B, N] of the point of b [B, M, 3] nearest to each of a [B, N, 3].

    Search trees on a CPU, where the [B, N, M] table of distances costs ten times as much; one
    batched matrix product elsewhere.
    """
    if a.device.type != "cpu":
        with torch.autocast(a.device.type, enabled=False):
            # |a - b|^2 less |a|^2, which is constant over the row searched
            return torch.baddbmm(b.square().sum(-1)[:, None], a, b.mT, alpha=-2).argmin(dim=2)
    if not (a.isfinite().all() and b.isfinite().all()):
        return torch.zeros(a.shape[:2], dtype=torch.int64)  # the result is NaN or infinite anyway
    threads = torch.get_num_threads()
    pairs = zip(a.numpy(), b.numpy(), strict=True)
    # Split in the middle, not at the median: where that is exactly 0 (half of a cloud in one
    # plane), SciPy 1.17 steps to the next number, which is denormal. Inside a training
    # (`learning.training_loop.denormals_flushed`) that is 0 again, and so on without end.
    trees = ((points, KDTree(targets, balanced_tree=False)) for points, targets in pairs)
    indices = [tree.query(points, workers=threads)[1] for points, tree in trees]
    return torch.from_numpy(np.stack(indices))


def _rows(points: Tensor, index: Tensor) -> Tensor:
    return points.gather(1, index[:, :, None].expand(-1, -1, 3))


def angular_error(predicted01: Tensor, target01: Tensor, range_rad: float) -> Tensor:
    """Return the mean absolute angle in radians, 0..pi, between normalised angles.

    Both have the same shape.

    L_theta = atan2(sin d / cos d) of the paper's section 3.2, with d = range_rad * difference:
    a whole turn counts as none, so azimuth 0.99 and 0.01 are 0.02 turns apart.
    """
    delta = range_rad * (target01 - predicted01)
    return torch.atan2(torch.sin(delta), torch.cos(delta)).abs().mean()


def azimuth_error(judged: Tensor, target01: Tensor) -> Tensor:
    """Return the error of an azimuth [B, 1] in radians, or of its sine and cosine [B, 2].

    The error of sine and cosine is the mean absolute difference, which has a gradient towards the
    target everywhere. The angular error of one number has none that agrees over a batch while all
    angles are judged alike, as they are at the start.
    """
    if judged.shape[1] == 1:
        return angular_error(judged, target01, AZIMUTH_RANGE_RAD)
    return functional.l1_loss(judged, sine_cosine(target01))


STRUCTURE_WEIGHT = 0.25


def reconstruction_error(drawn: Tensor, real: Tensor) -> Tensor:
    """Return the error of drawn images against real ones of the same cloud and view; a scalar.

    Images [B, 3, H, W] in [-1, 1], H and W at least 11. `learning.image_losses.weighted_error` on
    a scale of 0..1; whatever is not white is object. Works in float32. The score of the benchmark
    is part of this loss; the model card says so.
    """
    drawn, real = (drawn.float() + 1) / 2, (real.float() + 1) / 2
    is_object = (real < 1).any(dim=1, keepdim=True)
    return weighted_error(drawn, real, is_object, STRUCTURE_WEIGHT)


@dataclass(frozen=True)
class _Objective:
    """The weights of the terms of Eq. 6 and 7, and the error measured on the code.

    reconstruction_weight  of `reconstruction_error`; where it is not zero, real and drawn images
                           are of the same clouds and views, and the encoder is trained too
    """

    code_error: Literal["mse", "mae"]
    code_weight: float
    elevation_weight: float
    azimuth_weight: float
    source: str
    reconstruction_weight: float = 0.0


OBJECTIVES = {
    "acgan-paper": _Objective(
        "mse", 1.0, 1.0, 1.0, source="paper, Eq. 6, Eq. 7 and section 3.2 (unweighted sums, MSE)"
    ),
    "acgan-code": _Objective(
        "mae", 10.0, 10.0, 10.0, source="roatienza/pc2pix@23b7b46d (weights 1, 10, 10, 10; MAE)"
    ),
    # Heads of weight 10 beside a reconstruction term raised its error for hundreds of steps.
    "paired": _Objective(
        "mae", 1.0, 1.0, 1.0, source="ours: plus reconstruction", reconstruction_weight=50.0
    ),
}


class Conditioning(NamedTuple):
    """The condition of an image, c_1, c_2, c_3 of Eq. 6: what it was, or should be, made from."""

    code: Tensor  # [B, latent_dim]
    elevation01: Tensor  # [B, 1]
    azimuth01: Tensor  # [B, 1]


class LossTerms(NamedTuple):
    """The loss as scalars: `total` is weighted and minimised; the others are unweighted."""

    total: Tensor
    real: Tensor
    code: Tensor
    elevation: Tensor
    azimuth: Tensor


def _terms(
    judged: DiscriminatorOutput, condition: Conditioning, real: bool, objective: _Objective
) -> LossTerms:
    logit = judged.real_logit
    label = torch.ones_like(logit) if real else torch.zeros_like(logit)
    cross_entropy = functional.binary_cross_entropy_with_logits(logit, label)
    code_error = functional.mse_loss if objective.code_error == "mse" else functional.l1_loss
    code = code_error(judged.code, condition.code)
    elevation = angular_error(judged.elevation, condition.elevation01, ELEVATION_RANGE_RAD)
    azimuth = azimuth_error(judged.azimuth, condition.azimuth01)
    total = (
        cross_entropy
        + objective.code_weight * code
        + objective.elevation_weight * elevation
        + objective.azimuth_weight * azimuth
    )
    return LossTerms(total, cross_entropy, code, elevation, azimuth)


def discriminator_loss(
    on_real: DiscriminatorOutput,
    on_fake: DiscriminatorOutput,
    real: Conditioning,
    fake: Conditioning,
    objective: _Objective,
) -> LossTerms:
    """Return the terms of Eq. 6: cross entropy and reconstruction of conditions, both halves.

    The halves are added, as in Eq. 6; the original averages them, a factor of one half on
    everything, to which Adam is indifferent.
    """
    pairs = zip(
        _terms(on_real, real, True, objective),
        _terms(on_fake, fake, False, objective),
        strict=True,
    )
    return LossTerms(*(a + b for a, b in pairs))


def generator_loss(
    on_fake: DiscriminatorOutput, fake: Conditioning, objective: _Objective
) -> LossTerms:
    """Return the terms of Eq. 7: cross entropy to real, and the reconstruction of conditions."""
    return _terms(on_fake, fake, True, objective)
