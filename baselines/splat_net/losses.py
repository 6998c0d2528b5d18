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

STRUCTURE_WEIGHT = 0.5
COVERAGE_WEIGHT = 0.1
GREY_WEIGHT = 0.5
TILT_WEIGHT = 0.3
WHOLE = 254.5 / 255  # coverage of a pixel whose samples are all of the object
# The true grey has 8 bits: at a tilt of 0 the next grey level is a tilt of some 10 degrees.
_FLAT = 0.01
_NO_LENGTH = 1e-6
FeatureMaps = Callable[[Tensor], Sequence[Tensor]]  # of images [B, 3, S, S] in 0..255


@dataclass(frozen=True)
class _SplatNetObjective:
    """The terms of a training's loss and their weights.

    patch_weight  that of the judge of patches on clean clouds, and on those with the strongest
                  noise of the training; between the two it rises with the standard deviation. The
                  less the points say, the more the mean of all images that are possible is
                  blurred, and the more counts that an image is likely. None: there is no judge
    plain         the absolute error of all pixels alike, and no SSIM
    colours       the judge sees the colours beside the grey image. The cloud has none: a judge of
                  colours rewards guesses, in blotches; without, colours that the shape does not
                  decide become the median of those that are possible
    tilts         the error of tilts counts, too (`tilt_error`)
    features      weight of the distance of deep features (`feature_error`)
    """

    patch_weight: tuple[float, float] | None
    source: str
    plain: bool = False
    colours: bool = False
    tilts: bool = False
    features: float = 0.0

    def image_error(self, drawn: Tensor, real: Tensor, coverage: Tensor) -> Tensor:
        """Return the error of images [B, C, S, S], given coverage [B, 1, S, S] in 0..1; a scalar.

        Unless it is plain, `learning.image_losses.weighted_error`: the score of the benchmark is
        part of it, and the model card says so.
        """
        if self.plain:
            return functional.l1_loss(drawn, real)
        return weighted_error(drawn, real, coverage > 0, STRUCTURE_WEIGHT)

    def judged(self, colour: Tensor, grey: Tensor) -> Tensor:
        """Return the judge's input [B, `judged_channels`, S, S]: the grey image, or both.

        The images are [B, 3, S, S] and [B, 1, S, S].
        """
        return torch.cat([colour, grey], dim=1) if self.colours else grey

    @property
    def judged_channels(self) -> int:
        """Return the number of channels of `judged`."""
        return 4 if self.colours else 1


OBJECTIVES = {
    "l1": _SplatNetObjective(None, "weighted L1 + SSIM + cross entropy of the coverage"),
    "l1-patch": _SplatNetObjective(
        (0.05, 0.2), "l1, and hinge losses of patches in grey (after Isola et al. 2017)"
    ),
    "relief": _SplatNetObjective(
        (0.1, 0.2),
        "l1-patch, with more weight of patches on clean clouds, and the error of tilts",
        tilts=True,
    ),
    "perceptual": _SplatNetObjective(
        (0.1, 0.2),
        "relief, and the distance of features of EfficientNet-Lite0 (after Johnson et al. 2016)",
        tilts=True,
        features=2.0,
    ),
    "pix2pix": _SplatNetObjective(
        (0.01, 0.01),
        "L1 and patches, 100 to 1 (Isola et al. 2017), here with hinge losses",
        plain=True,
        colours=True,
    ),
}


@dataclass(frozen=True, eq=False)
class Truth:
    """The true images of B clouds and views, in 0..1.

    colour    [B, 3, S, S]
    grey      [B, 1, S, S]
    coverage  [B, 1, S, S]
    """

    colour: Tensor
    grey: Tensor
    coverage: Tensor


def coverage_error(logits: Tensor, coverage: Tensor) -> Tensor:
    """Return the cross entropy of coverage [B, 1, S, S], weighted as in `weighted_error`."""
    weight = torch.where(coverage > 0, FOREGROUND_WEIGHT, 1.0)
    return functional.binary_cross_entropy_with_logits(logits, coverage, weight=weight)


def tilt_error(cover: Tensor, grey: Tensor, coverage: Tensor) -> Tensor:
    """Return the mean error of the tilt and of its differences between neighbours; a scalar.

    The light shines along the view: a face tilted by 45 degrees still has .85 of the full
    brightness, so that brightness hardly tells facets and creases. The tilt t is compared as
    sqrt(1 - cos(t)), which is nearly proportional to it, in pixels that are covered whole.

    cover     [B, 1, S, S]: what covers a pixel in grey, drawn
    grey      [B, 1, S, S]: the true grey image
    coverage  [B, 1, S, S]
    """
    whole = (coverage > WHOLE).float()
    error = _tilt(cover) - _tilt(grey)
    total = (whole * error.abs()).sum() / whole.sum().clamp(min=1)
    for axis in (2, 3):
        first, second = (slice(None, -1), slice(1, None))
        at = [(slice(None),) * axis + (part,) for part in (first, second)]
        both = whole[at[0]] * whole[at[1]]
        differences = (error[at[1]] - error[at[0]]).abs()
        total = total + (both * differences).sum() / both.sum().clamp(min=1)
    return total


def feature_error(drawn: Tensor, real: Tensor, maps: FeatureMaps) -> Tensor:
    """Return the mean squared distance of deep features, each pixel's of length 1; a scalar.

    That is LPIPS without its heads (Zhang et al. 2018). Grey images [B, 1, S, S] in 0..1.
    """
    with torch.no_grad():
        targets = maps(255 * real.expand(-1, 3, -1, -1))
    errors = [
        (_directions(a) - _directions(b)).square().sum(dim=1).mean()
        for a, b in zip(maps(255 * drawn.expand(-1, 3, -1, -1)), targets, strict=True)
    ]
    return torch.stack(errors).mean()


def _directions(features: Tensor) -> Tensor:
    """Return features [B, C, h, w] of length 1; those of length 0 stay."""
    features = features.float()
    return features / (torch.linalg.vector_norm(features, dim=1, keepdim=True) + _NO_LENGTH)


def _tilt(grey: Tensor) -> Tensor:
    """Return sqrt(1 - cos(t)) of the tilts t that grey pixels 0..1 show."""
    cosine = shading_of(grey).pow(2.2)
    return (1 - cosine + _FLAT).sqrt()


class PatchJudge(nn.Sequential):
    """The patch discriminator: images [B, channels, S, S] -> realness [B, 1, S/8, S/8]."""

    def __init__(self, channels: int) -> None:
        def layer(cin: int, cout: int, stride: int) -> nn.Module:
            return spectral_norm(nn.Conv2d(cin, cout, 4, stride, 1))

        slope = 0.2
        super().__init__(
            layer(channels, 24, 2), nn.LeakyReLU(slope), layer(24, 48, 2), nn.LeakyReLU(slope),
            layer(48, 96, 2), nn.LeakyReLU(slope), nn.Conv2d(96, 1, 3, padding=1),
        )  # fmt: skip


def judge_error(on_real: Tensor, on_drawn: Tensor) -> Tensor:
    """Return the hinge loss of the judge; a scalar."""
    return functional.relu(1 - on_real).mean() + functional.relu(1 + on_drawn).mean()
