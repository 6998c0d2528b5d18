"""The losses of drawn images, and the patch discriminator."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.parametrizations import spectral_norm

from baselines.splat_net.network import shading_of
from learning.image_losses import FOREGROUND_WEIGHT, weighted_error

# Weights of terms of the loss, relative to the absolute error of the image in colour.
STRUCTURE_WEIGHT = 0.5  # of 1 - SSIM
COVERAGE_WEIGHT = 0.1  # of the cross entropy of the coverage
GREY_WEIGHT = 0.5  # of the errors of the image in grey
TILT_WEIGHT = 0.3  # of the error of tilts
WHOLE = 254.5 / 255  # coverage, 0..1, from which on a pixel counts as covered wholly by the object
# Added to 1 - cos(t) before the root is taken, whose slope at 0 is infinite. The true grey has 8
# bits, so that tilts below some 10 degrees are one grey level anyway.
_FLAT = 0.01
_NO_LENGTH = 1e-6  # added to lengths of features before dividing by them
# A function that returns maps of deep features [B, C, h, w] of images [B, 3, S, S] in 0..255.
FeatureMaps = Callable[[Tensor], Sequence[Tensor]]


@dataclass(frozen=True)
class _SplatNetObjective:
    """The terms of a training's loss, and their weights.

    patch_weight  weights of the verdict of the judge of patches, on clean clouds and on those with
                  the strongest noise; in between it rises linearly with the standard deviation of
                  the noise. The less a cloud tells, the more images are possible, and the more
                  their mean is blurred; the judge makes the network draw a likely one instead.
                  None: there is no judge
    source        the terms in words, for the card of the weights
    plain         whether the image error is the mean absolute error, the same for all pixels and
                  without SSIM
    colours       whether the judge sees the image in colour beside the one in grey. A cloud has no
                  colours, so such a judge rewards guesses, which come out in blotches. Without it,
                  colours that the shape does not decide become the median of the possible ones
    tilts         whether the error of tilts counts (`tilt_error`)
    features      weight of the distance of deep features (`feature_error`)
    """

    patch_weight: tuple[float, float] | None
    source: str
    plain: bool = False
    colours: bool = False
    tilts: bool = False
    features: float = 0.0

    def image_error(self, drawn: Tensor, real: Tensor, coverage: Tensor) -> Tensor:
        """Return the error of drawn images [B, C, S, S] against real ones, a scalar.

        coverage  [B, 1, S, S] in 0..1: the pixels of the object count more

        It is `learning.image_losses.weighted_error`, or the mean absolute error for a plain
        objective. The former has SSIM, which is a score of the benchmark; the model card says so.
        """
        if self.plain:
            return functional.l1_loss(drawn, real)
        return weighted_error(drawn, real, coverage > 0, STRUCTURE_WEIGHT)

    def judged(self, colour: Tensor, grey: Tensor) -> Tensor:
        """Return what the judge sees, [B, `judged_channels`, S, S]: the grey image, or both.

        colour  [B, 3, S, S]
        grey    [B, 1, S, S]
        """
        return torch.cat([colour, grey], dim=1) if self.colours else grey

    @property
    def judged_channels(self) -> int:
        """Return the number of channels that the judge sees."""
        return 4 if self.colours else 1


OBJECTIVES = {
    "l1": _SplatNetObjective(
        patch_weight=None, source="weighted L1 + SSIM + cross entropy of the coverage"
    ),
    "l1-patch": _SplatNetObjective(
        patch_weight=(0.05, 0.2),
        source="l1, and hinge losses of patches in grey (after Isola et al. 2017)",
    ),
    "relief": _SplatNetObjective(
        patch_weight=(0.1, 0.2),
        source="l1-patch, with more weight of patches on clean clouds, and the error of tilts",
        tilts=True,
    ),
    "perceptual": _SplatNetObjective(
        patch_weight=(0.1, 0.2),
        source=(
            "relief, and the distance of features of EfficientNet-Lite0 (after Johnson et al. 2016)"
        ),
        tilts=True,
        features=2.0,
    ),
    "pix2pix": _SplatNetObjective(
        patch_weight=(0.01, 0.01),
        source="L1 and patches, 100 to 1 (Isola et al. 2017), here with hinge losses",
        plain=True,
        colours=True,
    ),
}


@dataclass(frozen=True, eq=False)
class Truth:
    """The true images of B views, with values in 0..1.

    colour    [B, 3, S, S]
    grey      [B, 1, S, S]
    coverage  [B, 1, S, S]
    """

    colour: Tensor
    grey: Tensor
    coverage: Tensor


def coverage_error(logits: Tensor, coverage: Tensor) -> Tensor:
    """Return the mean cross entropy of coverage, a scalar; pixels of the object count more.

    logits    [B, 1, S, S]
    coverage  [B, 1, S, S], the true one, 0..1
    """
    weight = torch.where(coverage > 0, FOREGROUND_WEIGHT, 1.0)
    return functional.binary_cross_entropy_with_logits(logits, coverage, weight=weight)


def tilt_error(cover: Tensor, grey: Tensor, coverage: Tensor) -> Tensor:
    """Return the mean error of the surface's tilt plus that of its differences, a scalar.

    The tilt is the angle between a surface's normal and the view. Because the light shines along
    the view, a face tilted by 45 degrees still has .85 of the full brightness, and errors of
    brightness hardly show facets and creases. So tilts t are compared, as sqrt(1 - cos(t)), which
    is nearly proportional to t, and the differences of tilts between neighbouring pixels. Only
    pixels that the object covers wholly count.

    cover     [B, 1, S, S]: the drawn grey of what covers a pixel, without the background
    grey      [B, 1, S, S]: the true grey image
    coverage  [B, 1, S, S]: the true coverage
    """
    whole = (coverage > WHOLE).float()
    error = _tilt(cover) - _tilt(grey)
    total = (whole * error.abs()).sum() / whole.sum().clamp(min=1)
    for axis in (2, 3):
        pairs = whole.shape[axis] - 1
        both = whole.narrow(axis, 0, pairs) * whole.narrow(axis, 1, pairs)
        differences = (error.narrow(axis, 1, pairs) - error.narrow(axis, 0, pairs)).abs()
        total = total + (both * differences).sum() / both.sum().clamp(min=1)
    return total


def feature_error(drawn: Tensor, real: Tensor, maps: FeatureMaps) -> Tensor:
    """Return the mean squared distance between deep features of drawn and real images, a scalar.

    The features of a pixel are scaled to length 1. This is LPIPS (Zhang et al. 2018) without its
    learned weights of channels.

    drawn, real  grey images [B, 1, S, S] in 0..1
    """
    with torch.no_grad():
        targets = maps(255 * real.expand(-1, 3, -1, -1))
    errors = [
        (_directions(a) - _directions(b)).square().sum(dim=1).mean()
        for a, b in zip(maps(255 * drawn.expand(-1, 3, -1, -1)), targets, strict=True)
    ]
    return torch.stack(errors).mean()


def _directions(features: Tensor) -> Tensor:
    """Return features [B, C, h, w] scaled to length 1 at every pixel; zeros stay zeros."""
    features = features.float()
    return features / (torch.linalg.vector_norm(features, dim=1, keepdim=True) + _NO_LENGTH)


def _tilt(grey: Tensor) -> Tensor:
    """Return about sqrt(1 - cos(t)), where t is the tilt that a grey pixel in 0..1 shows."""
    cosine = shading_of(grey).pow(2.2)
    return (1 - cosine + _FLAT).sqrt()


class PatchJudge(nn.Sequential):
    """The patch discriminator: it tells of patches of an image how real they look.

    Its input is [B, channels, S, S], its output [B, 1, S/8, S/8]: positive for real patches.
    """

    def __init__(self, channels: int) -> None:
        def layer(cin: int, cout: int, stride: int) -> nn.Module:
            return spectral_norm(nn.Conv2d(cin, cout, 4, stride, 1))

        slope = 0.2
        super().__init__(
            layer(channels, 24, 2), nn.LeakyReLU(slope), layer(24, 48, 2), nn.LeakyReLU(slope),
            layer(48, 96, 2), nn.LeakyReLU(slope), nn.Conv2d(96, 1, 3, padding=1),
        )  # fmt: skip


def judge_error(on_real: Tensor, on_drawn: Tensor) -> Tensor:
    """Return the judge's hinge loss, a scalar, of its outputs for real and for drawn images."""
    return functional.relu(1 - on_real).mean() + functional.relu(1 + on_drawn).mean()
