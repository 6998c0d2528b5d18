"""The Inception network behind FID: the graph of 2015-12-05 with its published weights.

It is the "pool_3" feature extractor of TTUR (bioinf-jku/TTUR, `inception-2015-12-05.tgz`), with the
state dict of torch-fidelity 0.4 (toshas/torch-fidelity, `weights-inception-2015-12-05`). Szegedy et
al. 2015, https://arxiv.org/abs/1512.00567, describe the network. The trained graph differs from
Inception v3 as it was published later, and each of the first three differences moves every FID:

* Images are resized to 299 x 299 by the bilinear rule of TensorFlow 1, then become (x - 128) / 128.
  By this rule pixel i of the output is read at position i * in / out, without half-pixel centres
  and without antialiasing.
* Average pooling does not count the padding.
* The last block pools by maximum.
* The classifier has 1,008 outputs, which FID does not use.

Only distances of features from this network with these weights are called FID.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor, nn

from bench.metrics.image_arrays import require_rgb
from bench.metrics.inception_weights import WEIGHTS_SHA256, read_weights
from learning.exact import exact_inference

FEATURES = 2048  # the number of features of an image
_INPUT_SIZE = 299  # the side, in pixels, of the images that the network sees


class _Conv(NamedTuple):
    """A convolution without bias, followed by batch norm (eps 1e-3) and ReLU."""

    name: str  # the name in the state dict
    out: int  # the number of output channels
    kernel: tuple[int, int]  # height and width
    stride: int
    padded: bool  # whether the input is padded, so that with stride 1 its size stays the same


class _Branch(NamedTuple):
    """A branch of a block: a pooling, then convolutions one after the other, then some in parallel.

    Each of these parts may be missing.
    """

    pool: str  # "" for none, or a kind of pooling that `_pool` knows
    chain: tuple[_Conv, ...]  # the convolutions one after the other
    fork: tuple[_Conv, ...]  # the convolutions in parallel, whose outputs are concatenated


class _Mixed(NamedTuple):
    """A block of branches in parallel, whose outputs are concatenated in this order."""

    name: str
    branches: tuple[_Branch, ...]


def _conv(text: str) -> _Conv:
    """Return the convolution that a text describes, as in "Conv2d_1a_3x3 32 3x3 half".

    These are the name, the number of output channels, and height and width of the kernel. The last
    word is "half" for stride 2 without padding, "valid" for stride 1 without padding; where it is
    missing, the stride is 1 and the input is padded.
    """
    name, out, kernel, *kind = text.split()
    height, width = map(int, kernel.split("x"))
    return _Conv(
        name=name,
        out=int(out),
        kernel=(height, width),
        stride=2 if kind == ["half"] else 1,
        padded=not kind,
    )


def _mixed(name: str, table: str) -> _Mixed:
    """Return the block that a table describes.

    Each line is a branch, as in "average: conv, conv / conv, conv": the kind of pooling, the
    convolutions one after the other, and those in parallel. Each part may be missing.
    """
    branches = []
    for line in table.strip().splitlines():
        pool, _, convolutions = line.strip().rpartition(":")
        chain, _, fork = convolutions.partition("/")
        branches.append(_Branch(pool, _convs(chain), _convs(fork)))
    return _Mixed(name, tuple(branches))


def _convs(text: str) -> tuple[_Conv, ...]:
    """Return the convolutions that a text describes, with commas between them; "" for none."""
    return tuple(_conv(part) for part in text.split(",") if part.strip())


def _mixed_35(name: str, pooled: int) -> _Mixed:
    table = """
        branch1x1 64 1x1
        branch5x5_1 48 1x1, branch5x5_2 64 5x5
        branch3x3dbl_1 64 1x1, branch3x3dbl_2 96 3x3, branch3x3dbl_3 96 3x3
        average: branch_pool {} 1x1"""
    return _mixed(name, table.format(pooled))


def _mixed_17(name: str, inner: int) -> _Mixed:
    table = """
        branch1x1 192 1x1
        branch7x7_1 {0} 1x1, branch7x7_2 {0} 1x7, branch7x7_3 192 7x1
        branch7x7dbl_1 {0} 1x1, branch7x7dbl_2 {0} 7x1, branch7x7dbl_3 {0} 1x7,\
            branch7x7dbl_4 {0} 7x1, branch7x7dbl_5 192 1x7
        average: branch_pool 192 1x1"""
    return _mixed(name, table.format(inner))


def _mixed_8(name: str, pool: str) -> _Mixed:
    table = """
        branch1x1 320 1x1
        branch3x3_1 384 1x1 / branch3x3_2a 384 1x3, branch3x3_2b 384 3x1
        branch3x3dbl_1 448 1x1, branch3x3dbl_2 384 3x3\
            / branch3x3dbl_3a 384 1x3, branch3x3dbl_3b 384 3x1
        {}: branch_pool 192 1x1"""
    return _mixed(name, table.format(pool))


_REDUCE = "reduce"  # the pooling that halves the side

# The stages of the network. The numbers in comments are the side of a stage's output, and the
# number of its channels.
_NETWORK: tuple[_Conv | _Mixed | str, ...] = (
    _conv("Conv2d_1a_3x3 32 3x3 half"),  # 149
    _conv("Conv2d_2a_3x3 32 3x3 valid"),  # 147
    _conv("Conv2d_2b_3x3 64 3x3"),
    _REDUCE,  # 73
    _conv("Conv2d_3b_1x1 80 1x1"),
    _conv("Conv2d_4a_3x3 192 3x3 valid"),  # 71
    _REDUCE,  # 35
    _mixed_35("Mixed_5b", pooled=32),  # 256 channels
    _mixed_35("Mixed_5c", pooled=64),  # 288
    _mixed_35("Mixed_5d", pooled=64),
    _mixed(  # 17, 768 channels
        "Mixed_6a",
        """
        branch3x3 384 3x3 half
        branch3x3dbl_1 64 1x1, branch3x3dbl_2 96 3x3, branch3x3dbl_3 96 3x3 half
        reduce:""",
    ),
    _mixed_17("Mixed_6b", inner=128),
    _mixed_17("Mixed_6c", inner=160),
    _mixed_17("Mixed_6d", inner=160),
    _mixed_17("Mixed_6e", inner=192),
    _mixed(  # 8, 1,280 channels
        "Mixed_7a",
        """
        branch3x3_1 192 1x1, branch3x3_2 320 3x3 half
        branch7x7x3_1 192 1x1, branch7x7x3_2 192 1x7, branch7x7x3_3 192 7x1,\
            branch7x7x3_4 192 3x3 half
        reduce:""",
    ),
    _mixed_8("Mixed_7b", pool="average"),  # 2,048 channels
    _mixed_8("Mixed_7c", pool="max"),
)


def _pool(x: Tensor, kind: str) -> Tensor:
    """Return the pooled x; x itself for the kind ""."""
    if kind == "average":
        return F.avg_pool2d(x, 3, stride=1, padding=1, count_include_pad=False)
    if kind == "max":
        return F.max_pool2d(x, 3, stride=1, padding=1)
    if kind == _REDUCE:
        return F.max_pool2d(x, 3, stride=2)
    return x


class _ConvUnit(nn.Module):
    """The layers of a `_Conv` on an input of some channels."""

    def __init__(self, spec: _Conv, channels: int) -> None:
        super().__init__()
        height, width = spec.kernel
        padding = (height // 2, width // 2) if spec.padded else (0, 0)
        self.conv = nn.Conv2d(channels, spec.out, spec.kernel, spec.stride, padding, bias=False)
        self.bn = nn.BatchNorm2d(spec.out, eps=1e-3)

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(self.bn(self.conv(x)), inplace=True)


class _MixedBlock(nn.Module):
    """The layers of a `_Mixed` on an input of some channels."""

    def __init__(self, spec: _Mixed, channels: int) -> None:
        super().__init__()
        self._branches = spec.branches
        self.channels = 0  # the number of output channels
        for branch in spec.branches:
            width = channels
            for unit in branch.chain:
                self.add_module(unit.name, _ConvUnit(unit, width))
                width = unit.out
            for unit in branch.fork:
                self.add_module(unit.name, _ConvUnit(unit, width))
            self.channels += sum(unit.out for unit in branch.fork) or width

    def forward(self, x: Tensor) -> Tensor:
        outputs: list[Tensor] = []
        for branch in self._branches:
            outputs += self._run(branch, x)
        return torch.cat(outputs, 1)

    def _run(self, branch: _Branch, x: Tensor) -> Iterator[Tensor]:
        """Yield the outputs of a branch: one, or one of each parallel convolution."""
        x = _pool(x, branch.pool)
        for unit in branch.chain:
            x = self.get_submodule(unit.name)(x)
        if not branch.fork:
            yield x
        for unit in branch.fork:
            yield self.get_submodule(unit.name)(x)


class FidInception(nn.Module):
    """The Inception network of FID, which takes images uint8 [N, 3, H, W], of any size and number.

    It gives features [N, 2048] of the dtype of its weights, which is float32 unless it is changed.
    The state dict has the 566 keys of the published file, with those of the classifier, which is
    not used. The network is always in evaluation mode and has no gradients. `load_inception`
    returns the trained network; a new instance has random weights.

    Raises
    ------
    ValueError
        Where the images are not uint8 [N, 3, H, W].
    """

    def __init__(self) -> None:
        super().__init__()
        channels = 3
        for stage in _NETWORK:
            if isinstance(stage, _Conv):
                self.add_module(stage.name, _ConvUnit(stage, channels))
                channels = stage.out
            elif isinstance(stage, _Mixed):
                block = _MixedBlock(stage, channels)
                self.add_module(stage.name, block)
                channels = block.channels
        self.fc = nn.Linear(channels, 1008)
        self.requires_grad_(False)
        self.eval()

    def train(self, mode: bool = True) -> FidInception:
        """Stay in evaluation mode, since batch statistics would change the features."""
        super().train(False)
        return self

    def forward(self, images: Tensor) -> Tensor:
        """Return the features [N, 2048] of images uint8 [N, 3, H, W]. Raises as the class says."""
        if images.dtype != torch.uint8 or images.ndim != 4 or images.shape[1] != 3:
            raise ValueError(
                f"images must be uint8 [N, 3, H, W], got {images.dtype} {list(images.shape)}"
            )
        x = images.to(self.fc.weight.dtype)
        for dim in (3, 2):
            x = _stretch(x, _INPUT_SIZE, dim)
        x = (x - 128.0) / 128.0
        for stage in _NETWORK:
            x = _pool(x, stage) if isinstance(stage, str) else self.get_submodule(stage.name)(x)
        return x.mean(dim=(2, 3))


def _stretch(x: Tensor, size: int, dim: int) -> Tensor:
    """Return x with one dimension resized to `size`, linearly as in TensorFlow 1."""
    # Positions are float32 as in TensorFlow; in float64 they would differ by up to 1e-5 pixels.
    length = x.shape[dim]
    step = float(np.float32(length / size))
    position = torch.arange(size, dtype=torch.float32, device=x.device) * step
    below = position.floor().long()
    above = (below + 1).clamp(max=length - 1)
    shape = [1] * x.ndim
    shape[dim] = size
    fraction = (position - below).to(x.dtype).reshape(shape)
    low = x.index_select(dim, below)
    return low + (x.index_select(dim, above) - low) * fraction


def inception_features(
    model: FidInception, images: NDArray[np.uint8], batch: int = 20
) -> NDArray[np.float32]:
    """Return the features [N, 2048] of images uint8 [N, H, W, 3], computed on the model's device.

    batch  how many images the network sees at a time; take the same number for all images that are
           compared, since for another one PyTorch may choose other convolution kernels, which moves
           features by float32 rounding (1e-6 of the largest)

    Raises ValueError where the images are not uint8 [N, H, W, 3].
    """
    require_rgb(images)
    device = model.fc.weight.device
    features = np.empty((len(images), FEATURES), dtype=np.float32)
    with exact_inference():
        for start in range(0, len(images), batch):
            part = torch.tensor(images[start : start + batch], device=device).permute(0, 3, 1, 2)
            features[start : start + batch] = model(part).cpu().numpy()
    return features


def load_inception(path: Path, sha256: str = WEIGHTS_SHA256) -> FidInception:
    """Return the network with the published weights, ready for inference.

    path    the file of the weights, as `inception_weights.find_weights` returns it
    sha256  the checksum that the file has to have

    The checksum is that of the same bytes that are loaded, and no pickled code is run. Raises
    BadInput where the file cannot be read or is not the published one.
    """
    model = FidInception()
    data = io.BytesIO(read_weights(path, sha256))
    model.load_state_dict(torch.load(data, map_location="cpu", weights_only=True))
    # On a CPU this layout is 1.4 times as fast as the default one. Features differ by rounding
    # (5e-7).
    return model.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
