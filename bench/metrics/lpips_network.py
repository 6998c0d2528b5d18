"""LPIPS v0.1 (Zhang et al. 2018, https://arxiv.org/abs/1801.03924): a distance by deep features.

Both images go through a network trained on photographs (ImageNet). At five layers the activations
of each pixel are scaled to length 1, their squared differences weighted by a trained head, averaged
over the pixels, and summed over the layers. Nothing in it was trained on objects of this project.

ST-LPIPS (Ghildyal and Liu 2022, https://arxiv.org/abs/2207.13686) forgives shifts of a pixel: the
same by an AlexNet whose first convolution has a stride of 1, and in which a binomial blur (Zhang
2019, https://arxiv.org/abs/1904.11486) takes every step of 2. Its maxima have a stride of 1.

Protocol (richzhang/PerceptualSimilarity, version 0.1): uint8 / 127.5 - 1, then shifted and scaled
by fixed numbers per channel; no resizing, so that layers see what a 128 x 128 image shows.

The mean of the last of these layers over the pixels, before it is scaled, are the features of
`fd-alexnet` and `kd-alexnet`. They are not Inception's, and their distances are not FID.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from bench.metrics.image_arrays import require_bytes, require_rgb, require_same_shape, require_some
from bench.metrics.packaged_weights import Net, find_lpips_weights, read_lpips_weights
from learning.exact import exact_inference

BATCH = 10  # images in one call of the network: another number may move a value by 1e-7
# Subtracted from red, green and blue, and what they are then divided by. They are float32 as in the
# original: in float64 the eighth digit of a distance differs.
_SHIFT = np.array([-0.030, -0.088, -0.188], np.float32)
SCALE = np.array([0.458, 0.448, 0.450], np.float32)
TINY = 1e-10  # added to the lengths of activations before the division by them, as in the original


class _Conv(NamedTuple):
    """A convolution with ReLU.

    kernel   side of the window
    stride   pixels from one window to the next
    padding  pixels of 0 around the image
    pooled   whether a maximum over windows (pooling) precedes
    seen     whether its activations are compared
    """

    kernel: int
    stride: int
    padding: int
    pooled: bool
    seen: bool

    def applied(self, x: Tensor, kernel: Tensor, bias: Tensor) -> Tensor:
        """Return the convolution of activations [N, c, h, w], before the ReLU."""
        return functional.conv2d(x, kernel, bias, stride=self.stride, padding=self.padding)


class _Trunk(NamedTuple):
    """The layers of a network before the heads, as a table.

    name     of the network in the file of weights
    layers   its convolutions, the first one first
    pool     window and stride of the maximum (pooling), in pixels
    least    smallest side of an image, in pixels
    blurred  whether a blur takes the steps of 2: after each pooling, and between the first
             convolution and its ReLU
    """

    name: str
    layers: tuple[_Conv, ...]
    pool: tuple[int, int]
    least: int
    blurred: bool = False

    def pooled(self, x: Tensor) -> Tensor:
        """Return the maxima over windows of activations [N, c, h, w], blurred where it is."""
        x = functional.max_pool2d(x, *self.pool)
        return _blurred(x) if self.blurred else x


def _vgg(*, pooled: bool = False, seen: bool = False) -> _Conv:
    """Return a convolution of VGG16."""
    return _Conv(kernel=3, stride=1, padding=1, pooled=pooled, seen=seen)


def _alex(stride: int) -> tuple[_Conv, ...]:
    """Return the convolutions of AlexNet, the first with this stride."""
    return (
        _Conv(kernel=11, stride=stride, padding=2, pooled=False, seen=True),
        _Conv(kernel=5, stride=1, padding=2, pooled=True, seen=True),
        _Conv(kernel=3, stride=1, padding=1, pooled=True, seen=True),
        _Conv(kernel=3, stride=1, padding=1, pooled=False, seen=True),
        _Conv(kernel=3, stride=1, padding=1, pooled=False, seen=True),
    )


TRUNKS: dict[Net, _Trunk] = {
    "alex": _Trunk("AlexNet_0", _alex(stride=4), pool=(3, 2), least=31),
    "vgg": _Trunk(
        "VGG16_0",
        (
            _vgg(),
            _vgg(seen=True),
            _vgg(pooled=True),
            _vgg(seen=True),
            _vgg(pooled=True),
            _vgg(),
            _vgg(seen=True),
            _vgg(pooled=True),
            _vgg(),
            _vgg(seen=True),
            _vgg(pooled=True),
            _vgg(),
            _vgg(seen=True),
        ),
        pool=(2, 2),
        least=16,
    ),
    "shift-tolerant": _Trunk("AlexNet_0", _alex(stride=1), pool=(3, 1), least=21, blurred=True),
}


@dataclass(frozen=True, eq=False)
class _Activations:
    """The activations of the network for N images.

    layers    activations [N, c, h, w] of five layers; those of each pixel are scaled to length 1,
              or are 0
    features  [N, d], the mean of the last layer over pixels, before it is scaled
    """

    layers: tuple[Tensor, ...]
    features: Tensor


class Lpips:
    """The distance LPIPS: a network, and the heads that weigh its layers.

    On a GPU convolutions are computed in full float32, too (`learning.exact`).
    """

    def __init__(
        self,
        path: Path,
        net: Net = "alex",
        dtype: torch.dtype = torch.float32,
        device: str = "cpu",
    ) -> None:
        """Read the weights of the network and of its heads from a file.

        dtype   precision of the network
        device  PyTorch's name of it

        Raises BadInput where the file is not the published checkpoint of this network.
        """
        self.dtype, self.device = dtype, device
        self._trunk = trunk = TRUNKS[net]
        checkpoint = read_lpips_weights(path, net)

        def read(*names: str) -> Tensor:
            array = functools.reduce(dict.__getitem__, names, checkpoint)
            return torch.from_numpy(array).to(device, torch.float64)

        # Of each convolution the kernel [cout, cin, K, K], channels last, and the bias [cout].
        self._kernels: list[tuple[Tensor, Tensor]] = []
        for i in range(len(trunk.layers)):
            kernel = read(trunk.name, f"Conv_{i}", "kernel").permute(3, 2, 0, 1)
            bias = read(trunk.name, f"Conv_{i}", "bias")
            kernel = kernel.to(dtype, memory_format=torch.channels_last)
            self._kernels.append((kernel, bias.to(dtype)))
        self._last: list[tuple[NDArray[np.uint8], _Activations]] = []
        heads = range(sum(conv.seen for conv in trunk.layers))
        self._heads = [
            read(f"NetLinLayer_{i}", "Conv_0", "kernel").to(dtype).reshape(1, -1, 1, 1)
            for i in heads
        ]
        self._shift, self._scale = (
            torch.from_numpy(values).to(device, dtype).reshape(3, 1, 1)
            for values in (_SHIFT, SCALE)
        )

    @exact_inference()
    def encode(self, images: NDArray[np.uint8]) -> _Activations:
        """Return the activations for images uint8 [N, H, W, 3], N > 0, computed in batches.

        The activations of the last two stacks of images are kept. In a run the same true images
        are compared with those of one method after the other, and the features of a method's images
        are asked for after their distances.

        Raises ValueError for another type or shape, and for sides below the trunk's least.
        """
        require_rgb(images, self._trunk.least)
        for i, (known, seen) in enumerate(self._last):
            if np.array_equal(known, images):
                self._last.append(self._last.pop(i))
                return seen
        parts = [self._see(images[i : i + BATCH]) for i in range(0, len(images), BATCH)]
        *layers, features = (torch.cat(some) for some in zip(*parts, strict=True))
        self._last = [*self._last[-1:], (images.copy(), _Activations(tuple(layers), features))]
        return self._last[-1][1]

    def _see(self, images: NDArray[np.uint8]) -> list[Tensor]:
        # A copy by NumPy: torch refuses negative strides, those of mirrored images.
        x = torch.from_numpy(images.copy()).to(self.device).permute(0, 3, 1, 2).to(self.dtype)
        x = (x / 127.5 - 1.0 - self._shift) / self._scale
        layers = []
        for i, (conv, kernel) in enumerate(zip(self._trunk.layers, self._kernels, strict=True)):
            x = conv.applied(self._trunk.pooled(x) if conv.pooled else x, *kernel)
            if self._trunk.blurred and i == 0:
                x = _blurred(x)
            x = x.relu_()
            if conv.seen:
                layers.append(x / (torch.linalg.vector_norm(x, dim=1, keepdim=True) + TINY))
        return [*layers, x.mean(dim=(2, 3))]

    @exact_inference()
    def distance(self, a: _Activations, b: _Activations) -> NDArray[np.float64]:
        """Return LPIPS [N] of N pairs, >= 0; 0 for identical images, symmetric."""
        total = torch.zeros(len(a.features), dtype=torch.float64, device=self.device)
        for head, layer, counterpart in zip(self._heads, a.layers, b.layers, strict=True):
            difference = layer - counterpart
            total += (difference.square_() * head).sum(dim=1).double().mean(dim=(1, 2))
        return total.cpu().numpy()


def _blurred(x: Tensor) -> Tensor:
    """Return the binomial blur of [N, c, h, w] at every second pixel, its border reflected."""
    return halved(functional.pad(x, (2, 2, 2, 2), mode="reflect"), padding=0)


def halved(x: Tensor, padding: int) -> Tensor:
    """Return the mean about every second pixel of [N, c, h, w], weighted by 1/4, 1/2, 1/4."""
    window = torch.tensor((0.25, 0.5, 0.25), dtype=x.dtype, device=x.device)
    kernel = torch.outer(window, window).expand(x.shape[1], 1, 3, 3)
    return functional.conv2d(x, kernel, stride=2, padding=padding, groups=x.shape[1])


def lpips(
    a: NDArray[np.uint8],
    b: NDArray[np.uint8],
    net: Net = "alex",
    *,
    single: bool = False,
    device: str = "cpu",
) -> NDArray[np.float64]:
    """Return LPIPS, or ST-LPIPS, of two images, or of pairs; lower is better.

    Parameters
    ----------
    a, b : uint8 array, [N, H, W, 3] or [H, W, 3]
        Images and their counterparts, with sides from 31 px ("alex"), 16 px ("vgg") or 21 px
        ("shift-tolerant").
    net : {"alex", "vgg", "shift-tolerant"}
        The network; with "shift-tolerant" the distance is ST-LPIPS.
    single : bool
        Compute in float32, as runs do: some five times as fast, and equal to 1e-5.
    device : str
        PyTorch's name of the device that computes.

    Returns
    -------
    float64 array [N], or a number
        Distance of each pair, >= 0; 0 for identical images.

    Raises
    ------
    ValueError
        For another `net`, for arrays that are not uint8 or of another shape or differ in shape,
        for too small images, and where there are none.
    WeightsUnavailable
        Where the package with the weights is not installed.
    BadInput
        Where its file is not the published one.
    """
    if net not in TRUNKS:
        raise ValueError(f"net must be {' or '.join(TRUNKS)}, got {net!r}")
    require_bytes(a, b)
    require_same_shape(a, b)
    if a.ndim == 3:
        return lpips(a[None], b[None], net, single=single, device=device)[0]
    require_rgb(a, TRUNKS[net].least)
    require_some(a)
    dtype = torch.float32 if single else torch.float64
    network = load_lpips(find_lpips_weights(net), net, dtype, device)
    # Images in one call of `encode`, which keeps the activations of the last two stacks: those of
    # VGG16 take the most memory.
    together = BATCH if net == "vgg" else 4 * BATCH
    parts = [np.empty(0)]
    for start in range(0, len(a), together):
        part = slice(start, start + together)
        parts.append(network.distance(network.encode(a[part]), network.encode(b[part])))
    return np.concatenate(parts)


@functools.lru_cache(maxsize=2)
def load_lpips(
    path: Path, net: Net = "alex", dtype: torch.dtype = torch.float32, device: str = "cpu"
) -> Lpips:
    """Return an `Lpips`; the last two are kept.

    Raises as the class.
    """
    return Lpips(path, net, dtype, device)
