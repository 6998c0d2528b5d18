"""The network for inference, with normalisation folded into its convolutions.

It draws what `SplatNet` draws in evaluation mode, up to the rounding of the precision.
"""

from __future__ import annotations

import copy

import torch
from torch import Tensor

from baselines.splat_net.network import NEUTRAL, PLANES, SplatNet, shading_of
from baselines.splat_net.sharpening import take_meshes
from learning.convolution import Precision, dtype_of, fold_normalisation

GROUP = 10  # images that pass together: in fewer, calls cost more


class FoldedSplatNet:
    """The folded network, a copy. Raises ValueError for another precision."""

    def __init__(self, network: SplatNet, precision: Precision = "float32") -> None:
        self.dtype = dtype_of(precision)
        self.network = copy.deepcopy(network)
        fold_normalisation(self.network)
        self.network.to(self.dtype)

    def __call__(self, channels: Tensor, points: Tensor | None = None) -> Tensor:
        """Return images float32 [P, S, S, 3] in 0..1 by the albedo, or else by the first head.

        The channels [P, C, S, S] are of `dtype`. `points` are not used.
        """
        return self.images_of(*self.planes(channels))

    def coverage(self, channels: Tensor, points: Tensor | None = None) -> Tensor:
        """Return the share of each pixel that is covered, float32 [P, S, S, 1], of such images."""
        return self.coverage_of(self.planes(channels)[0])

    @staticmethod
    def images_of(planes: Tensor, albedo: Tensor | None) -> Tensor:
        """Return the images [P, S, S, 3] of what `planes` returns."""
        alpha, missing = planes[:, 0], planes[:, 1:].expand(-1, 3, -1, -1)
        if albedo is not None:
            missing = 1 - shading_of(1 - missing) * albedo
        white = alpha.new_ones(())
        images = torch.empty((*alpha.shape, 3), device=planes.device)
        for image, colour in zip(images.unbind(3), missing.unbind(1), strict=True):
            torch.addcmul(white, alpha, colour, value=-1, out=image)
        return images

    def coverage_of(self, planes: Tensor) -> Tensor:
        """Return the coverage [P, S, S, 1] of the first of what `planes` returns."""
        alpha = planes[:, 0]
        if self.network.config.heads == ("grey",):
            # Nothing in neutral grey is brighter than that: what a brighter cover lets through is
            # the white background, which the network draws beside outlines in alpha and cover.
            alpha = alpha * (planes[:, 1] / (1 - NEUTRAL)).clamp(max=1.0)
        return alpha[..., None]

    def planes(self, channels: Tensor) -> tuple[Tensor, Tensor | None]:
        """Return alpha and 1 less the first head [P, planes, S, S], 0..1, and any albedo."""
        config = self.network.config
        output = self.network(channels).float()
        first, others = output[:, : 1 + PLANES[config.heads[0]]], output[:, -PLANES["albedo"] :]
        alpha, cover = first[:, :1], first[:, 1:]
        planes = torch.cat([alpha, -cover], dim=1).sigmoid_()  # 1 - s(x) = s(-x)
        if config.inputs.meshes:
            planes = take_meshes(planes, channels, config.inputs)
        return planes, others.sigmoid() if "albedo" in config.heads else None
