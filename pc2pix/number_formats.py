"""Inference of pc2pix in narrower number formats, with the range of values of every layer.

The networks run wholly in the
format asked for: weights, BatchNorm statistics, the cloud, the angles and everything between are
cast to it, and PyTorch computes in it on the CPU (sums inside a product may be kept wider; what a
layer hands on is not). float64 is the reference that the others are compared with.

A layer is recognised by its bias, which PyTorch's functions get as they are even where a kernel is
derived on the way (`pc2pix.model.upsample_then_conv`). So the networks need not know of this.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.overrides import TorchFunctionMode

from data_prep.scene import Points, View
from pc2pix.model import NOISE_DIM
from pc2pix.renderer import normalised_angles, parts, pick_points
from pc2pix.weights import Weights

Format = Literal["float64", "float32", "bfloat16", "float16"]
FORMATS: dict[Format, torch.dtype] = {
    "float64": torch.float64,
    "float32": torch.float32,
    "bfloat16": torch.bfloat16,
    "float16": torch.float16,
}
GREY_LEVELS = 255


@dataclass(frozen=True)
class LayerRange:
    """The range of a layer's output, over all its values.

    name        as in the network, `generator.blocks.2.conv1`. "input of NAME" stands before the
                layer where its input is not finite though all layers before were: a cast, a sum or
                a mean between the layers overflowed
    largest     of the absolute values that are finite; 0 where none is
    non_finite  how many values are infinite or NaN
    """

    name: str
    largest: float
    non_finite: int


@dataclass(frozen=True, eq=False)
class Inference:
    """One cloud drawn in one format.

    code      whitened, float64 [latent_dim], in standard deviations of the training codes
    images    float64 [V, 128, 128, 3] in [0, 1], not rounded to grey levels
    layers    in the order in which they ran
    """

    code: NDArray[np.float64]
    images: NDArray[np.float64]
    layers: tuple[LayerRange, ...]

    @property
    def overflowed(self) -> str | None:
        """Return the first layer with a value that is not finite; None where all are finite."""
        return next((layer.name for layer in self.layers if layer.non_finite), None)

    @property
    def refused(self) -> str | None:
        """Return the stage at which `Pc2pixRenderer` refuses this code or image, or None."""
        if not np.isfinite(self.code).all():
            return "encode"
        return None if np.isfinite(self.images).all() else "generate"


class AbsoluteDifferences(NamedTuple):
    """The absolute differences of two arrays, over all values."""

    largest: float
    mean: float


@torch.inference_mode()
def infer(weights: Weights, points: Points, views: Sequence[View], fmt: Format) -> Inference:
    """Encode a cloud float32 [N, 3], N > 0, and draw it from at least one view, in one format.

    Same steps as `pc2pix.renderer.Pc2pixRenderer` with z = "zero", but nothing is refused: values
    that are not finite go on through the layers, so that one sees where they come from. `weights`
    stay as they are.
    """
    dtype = FORMATS[fmt]
    encoder = copy.deepcopy(weights.encoder).to(dtype)
    generator = copy.deepcopy(weights.generator).to(dtype)
    mean, std = weights.code_mean.to(dtype), weights.code_std.to(dtype)
    fed = pick_points(points)[None] if encoder.cloud_size else parts(points)
    angles = torch.tensor(normalised_angles(views), dtype=torch.float64)
    elevation01, azimuth01 = angles.to(dtype).split(1, dim=1)
    noise = torch.zeros(len(views), NOISE_DIM, dtype=dtype)
    names = _names("encoder", encoder) | _names("generator", generator)
    with _Watch(names) as watch:
        code = encoder(torch.tensor(fed, dtype=dtype)).mean(dim=0, keepdim=True)
        code = (code - mean) / std
        output = generator(noise, code.expand(len(views), -1), elevation01, azimuth01)
    images = (output.double().permute(0, 2, 3, 1).numpy() + 1) / 2
    return Inference(code[0].double().numpy(), images, tuple(watch.layers))


def deviation(
    values: NDArray[np.float64], reference: NDArray[np.float64]
) -> AbsoluteDifferences | None:
    """Return the absolute differences of two arrays of one shape; None if any is not finite."""
    if not (np.isfinite(values).all() and np.isfinite(reference).all()):
        return None
    apart = np.abs(values - reference)
    return AbsoluteDifferences(float(apart.max()), float(apart.mean()))


def _names(prefix: str, network: nn.Module) -> dict[int, str]:
    """Return the layer that each bias belongs to, by the identity of the tensor."""
    return {
        id(parameter): f"{prefix}.{name.removesuffix('.bias')}"
        for name, parameter in network.named_parameters()
        if name.endswith(".bias")
    }


class _Watch(TorchFunctionMode):
    """A recorder of the range of every layer that runs while it is active."""

    def __init__(self, names: dict[int, str]) -> None:
        super().__init__()
        self.names = names
        self.layers: list[LayerRange] = []

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Any,
        args: tuple[Any, ...] = (),
        kwargs: dict[str, Any] | None = None,
    ) -> Any:
        kwargs = kwargs or {}
        given = (*args, *kwargs.values())
        name = next((self.names[id(a)] for a in given if id(a) in self.names), None)
        if name is None:
            return func(*args, **kwargs)
        fed = _range(f"input of {name}", args[0])
        if fed.non_finite and not any(layer.non_finite for layer in self.layers):
            self.layers.append(fed)
        out = func(*args, **kwargs)
        self.layers.append(_range(name, out))
        return out


def _range(name: str, values: Tensor) -> LayerRange:
    finite = values.isfinite()
    largest = values.abs().where(finite, 0).max()
    return LayerRange(name, float(largest), int(values.numel() - finite.sum()))
