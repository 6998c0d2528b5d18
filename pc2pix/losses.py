"""Loss functions: Chamfer distance, error of angles, the paper's Eq. 6 and 7, reconstruction.

The weights of terms, which differ between the paper and its code, are in `OBJECTIVES`.
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

# Radians that the normalised angles 0..1 stand for: azimuths of -180..180 degrees, and elevations
# of -40..40 degrees, for which the original code rounds 4/9 to 0.4444.
AZIMUTH_RANGE_RAD = 2 * math.pi
ELEVATION_RANGE_RAD = 0.4444 * math.pi


def chamfer(a: Tensor, b: Tensor) -> Tensor:
    """Return the Chamfer distance of clouds, a scalar, as in the original code.

    It is the mean squared distance of the points of `a` from the nearest points of `b`, plus that
    from `b` to `a`. Means are over batch and points. It is 0 for equal sets of points, and NaN
    where a coordinate is NaN.

    a  [B, N, 3], N > 0
    b  [B, M, 3], M > 0
    """
    with torch.no_grad():
        nearest_b, nearest_a = _nearest(a, b), _nearest(b, a)
    # Distances are computed from differences of the pairs, because those that the search may
    # compute as |a|^2 - 2 ab + |b|^2 are inexact, and can be negative.
    from_a = (a - _rows(b, nearest_b)).square().sum(-1).mean()
    from_b = (b - _rows(a, nearest_a)).square().sum(-1).mean()
    return from_a + from_b


def _nearest(a: Tensor, b: Tensor) -> Tensor:
    """Return for each point of `a` [B, N, 3] the index of the nearest of `b` [B, M, 3], [B, N].

    On a CPU search trees find it, because a table [B, N, M] of distances takes ten times as long.
    On other devices the table is one batched matrix product.
    """
    if a.device.type != "cpu":
        with torch.autocast(a.device.type, enabled=False):
            # |b|^2 - 2 ab is |a - b|^2 less |a|^2, which is the same for all points of b.
            return torch.baddbmm(b.square().sum(-1)[:, None], a, b.mT, alpha=-2).argmin(dim=2)
    if not (a.isfinite().all() and b.isfinite().all()):
        return torch.zeros(a.shape[:2], dtype=torch.int64)  # the distance will not be finite anyway
    threads = torch.get_num_threads()
    indices = []
    for points, targets in zip(a.numpy(), b.numpy(), strict=True):
        # The tree splits boxes in the middle and not at the median of their points. Where the
        # median is exactly 0 (half of a cloud lies in one plane), SciPy 1.17 splits at the next
        # larger number, which is denormal. A training flushes denormal numbers to 0
        # (`learning.training_loop.denormals_flushed`), and SciPy would search without end.
        tree = KDTree(targets, balanced_tree=False)
        _, nearest = tree.query(points, workers=threads)
        indices.append(nearest)
    return torch.from_numpy(np.stack(indices))


def _rows(points: Tensor, index: Tensor) -> Tensor:
    """Return the points of clouds [B, M, 3] with indices [B, N], [B, N, 3]."""
    return points.gather(1, index[:, :, None].expand(-1, -1, 3))


def angular_error(predicted01: Tensor, target01: Tensor, range_rad: float) -> Tensor:
    """Return the mean absolute difference of angles in radians, 0..pi, a scalar.

    predicted01, target01  normalised angles, 0..1, of the same shape
    range_rad              radians that 0..1 stands for

    This is L_theta = atan2(sin d / cos d) of the paper's section 3.2 with d = range_rad *
    difference. Whole turns do not count: the azimuths 0.99 and 0.01 are 0.02 turns apart.
    """
    delta = range_rad * (target01 - predicted01)
    return torch.atan2(torch.sin(delta), torch.cos(delta)).abs().mean()


def azimuth_error(judged: Tensor, target01: Tensor) -> Tensor:
    """Return the mean error of azimuths, a scalar.

    judged    the azimuths that the discriminator tells: normalised [B, 1], whose error is an angle
              in radians, or sine and cosine [B, 2], whose error is their mean absolute difference
    target01  the true azimuths, normalised, [B, 1]

    At the start of a training the discriminator tells the same azimuth for all images. The angular
    errors of single images then have gradients in both directions, which cancel over a batch. Those
    of sine and cosine do not, because they point towards the targets everywhere.
    """
    if judged.shape[1] == 1:
        return angular_error(judged, target01, AZIMUTH_RANGE_RAD)
    return functional.l1_loss(judged, sine_cosine(target01))


STRUCTURE_WEIGHT = 0.25  # weight of 1 - SSIM beside the absolute error in `reconstruction_error`


def reconstruction_error(drawn: Tensor, real: Tensor) -> Tensor:
    """Return the error of drawn images against real ones of the same cloud and view, a scalar.

    drawn, real  images [B, 3, H, W] in [-1, 1], H and W at least 11

    It is `learning.image_losses.weighted_error` of images in 0..1, computed in float32; real pixels
    that are not white belong to the object. SSIM, a score of the benchmark, is a part of it, and
    the model card says so.
    """
    drawn, real = (drawn.float() + 1) / 2, (real.float() + 1) / 2
    is_object = (real < 1).any(dim=1, keepdim=True)
    return weighted_error(drawn, real, is_object, STRUCTURE_WEIGHT)


@dataclass(frozen=True)
class _Objective:
    """The weights of the terms of Eq. 6 and 7.

    code_error             error of the code: mean squared or mean absolute
    source                 where the weights come from, for the card of the trained network
    reconstruction_weight  weight of `reconstruction_error`. Where it is not 0, real and drawn
                           images are of the same clouds and views, and the encoder is trained, too
    """

    code_error: Literal["mse", "mae"]
    code_weight: float
    elevation_weight: float
    azimuth_weight: float
    source: str
    reconstruction_weight: float = 0.0


OBJECTIVES = {
    "acgan-paper": _Objective(
        code_error="mse",
        code_weight=1.0,
        elevation_weight=1.0,
        azimuth_weight=1.0,
        source="paper, Eq. 6, Eq. 7 and section 3.2 (unweighted sums, MSE)",
    ),
    "acgan-code": _Objective(
        code_error="mae",
        code_weight=10.0,
        elevation_weight=10.0,
        azimuth_weight=10.0,
        source="roatienza/pc2pix@23b7b46d (weights 1, 10, 10, 10; MAE)",
    ),
    # With weights of 10 for code and angles the error of reconstruction rose for hundreds of steps.
    "paired": _Objective(
        code_error="mae",
        code_weight=1.0,
        elevation_weight=1.0,
        azimuth_weight=1.0,
        source="ours: plus reconstruction",
        reconstruction_weight=50.0,
    ),
}


class Conditioning(NamedTuple):
    """The conditions that images show, or should show: c_1, c_2 and c_3 of Eq. 6.

    code         [B, latent_dim], of the cloud
    elevation01  [B, 1], normalised
    azimuth01    [B, 1], normalised
    """

    code: Tensor
    elevation01: Tensor
    azimuth01: Tensor


class LossTerms(NamedTuple):
    """A loss and its terms, as scalars.

    total      the weighted sum of the others, which is minimised
    real       cross entropy of whether images are real, without a weight, as are the following
    code       error of the code
    elevation  error of the elevation, in radians
    azimuth    error of the azimuth, see `azimuth_error`
    """

    total: Tensor
    real: Tensor
    code: Tensor
    elevation: Tensor
    azimuth: Tensor


def _terms(
    judged: DiscriminatorOutput, condition: Conditioning, real: bool, objective: _Objective
) -> LossTerms:
    """Return the terms for images that should be judged as `real`, or else as drawn."""
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
    return LossTerms(
        total=total, real=cross_entropy, code=code, elevation=elevation, azimuth=azimuth
    )


def discriminator_loss(
    on_real: DiscriminatorOutput,
    on_fake: DiscriminatorOutput,
    real: Conditioning,
    fake: Conditioning,
    objective: _Objective,
) -> LossTerms:
    """Return the terms of Eq. 6, the loss of the discriminator.

    on_real, on_fake  what it tells of real and of drawn images
    real, fake        what these images show

    The terms of real and drawn images are added, as in Eq. 6. The original code takes their mean,
    half of it; Adam's steps do not depend on such a factor.
    """
    of_real = _terms(on_real, real, True, objective)
    of_fake = _terms(on_fake, fake, False, objective)
    return LossTerms(
        total=of_real.total + of_fake.total,
        real=of_real.real + of_fake.real,
        code=of_real.code + of_fake.code,
        elevation=of_real.elevation + of_fake.elevation,
        azimuth=of_real.azimuth + of_fake.azimuth,
    )


def generator_loss(
    on_fake: DiscriminatorOutput, fake: Conditioning, objective: _Objective
) -> LossTerms:
    """Return the terms of Eq. 7, the loss of the generator.

    on_fake  what the discriminator tells of drawn images
    fake     what these images should show
    """
    return _terms(on_fake, fake, True, objective)
