"""The judge of drawn images: from where a chair is seen, and which chair it is.

It is a network that has seen true images only. From an image it predicts the direction of view, to
be compared with the requested one, and a shape code, by which the object can be told from others.
It looks at brightness alone, because methods draw in other colours than the truth, and was trained
on blurred, repainted and damaged images, because methods draw those. It was trained on the
procedural train split; the weights are bundled, and docs/maintaining.md has their card.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from data_prep.failures import BadInput
from data_prep.scene import IMAGE_SIZE
from learning.exact import exact_inference
from learning.weights import read_safetensors

FEATURES = 192
CODE = 32
BATCH = 20


class JudgeNetwork(nn.Module):
    """The network from darkness [N, 1, 128, 128] in 0..1 (white is 0) to answers [N, 3 + CODE].

    See `judge` for the answers.
    """

    def __init__(self) -> None:
        super().__init__()
        self.body = nn.Sequential(
            _layer(1, 24, 5, 2),  # side 64
            _layer(24, 48, 3, 2),  # 32
            _layer(48, 96, 3, 2),  # 16
            _Residual(96),
            _layer(96, 160, 3, 2),  # 8
            _Residual(160),
            _layer(160, 256, 3, 2),  # 4
            _layer(256, 96, 1, 1),
            # Where something is shows the view as much as what it is: no average over places.
            nn.Flatten(),
            nn.Linear(96 * 4 * 4, FEATURES),
            nn.ReLU(),
        )
        self.view = nn.Linear(FEATURES, 3)
        self.code = nn.Linear(FEATURES, CODE)
        # A tenth faster on CPUs, in training and after.
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, darkness: Tensor) -> Tensor:
        """Return answers float32 [N, 3 + CODE]."""
        return self.answers(self.body(darkness))

    def answers(self, features: Tensor) -> Tensor:
        """Return answers [N, 3 + CODE] from `body`'s output [N, FEATURES]; codes have length 1."""
        return torch.cat([self.view(features), functional.normalize(self.code(features))], dim=1)


class _Residual(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.change = nn.Sequential(
            _layer(channels, channels, 3, 1),
            nn.Conv2d(channels, channels, 3, padding=1, bias=False),
            nn.BatchNorm2d(channels),
        )

    def forward(self, x: Tensor) -> Tensor:
        return functional.relu(x + self.change(x))


def _layer(channels: int, width: int, kernel: int, stride: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(channels, width, kernel, stride, padding=kernel // 2, bias=False),
        nn.BatchNorm2d(width),
        nn.ReLU(),
    )


def load_judge_network(path: Path) -> JudgeNetwork:
    """Return the network with weights from a safetensors file, ready for inference.

    Raises BadInput where the file cannot be read or does not fit the network.
    """
    network = JudgeNetwork()
    try:
        network.load_state_dict(read_safetensors(path)[0])  # kernels are kept in half precision
    except Exception as error:  # safetensors and torch raise types of their own
        reason = " ".join(str(error).split())
        raise BadInput(
            f"{path}: not the weights of the judge network ({reason}); install pc2pix-bench again"
        ) from error
    return network.eval()


def judge(network: JudgeNetwork, images: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the judge's answers to images uint8 [N, 128, 128, 3]: float32 [N, 3 + CODE].

    Columns 0 and 1 are sine and cosine of the azimuth, column 2 the elevation over 40 degrees, the
    rest a shape code of length 1; the closer two codes (Euclidean), the likelier the same object.
    Sine and cosine are not normalised: where a chair looks alike from several sides they shrink.
    On the device where the network is, in batches of at most 20 and in full float32
    (`learning.exact`); an image's answer does not depend on its neighbours.
    Raises ValueError for images of another size or type.
    """
    if images.dtype != np.uint8 or images.shape[1:] != (IMAGE_SIZE, IMAGE_SIZE, 3):
        shape = f"{images.dtype} {list(images.shape)}"
        raise ValueError(f"images must be uint8 [N, {IMAGE_SIZE}, {IMAGE_SIZE}, 3], got {shape}")
    answers = np.empty((len(images), 3 + CODE), np.float32)
    device = network.view.weight.device
    with exact_inference():
        for start in range(0, len(images), BATCH):
            grey = torch.from_numpy(greyscale(images[start : start + BATCH])).to(device)
            answers[start : start + BATCH] = network(darkness(grey)).cpu().numpy()
    return answers


def greyscale(images: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return luma (Rec. 601) of sRGB images uint8 [..., 3]: uint8 [...], rounded half up.

    In whole numbers, so that grey is exactly itself. Raises ValueError for another type or number
    of channels.
    """
    if images.dtype != np.uint8 or images.shape[-1:] != (3,):
        shape = f"{images.dtype} {list(images.shape)}"
        raise ValueError(f"images must be uint8 [..., 3], got {shape}")
    weighted = images.astype(np.int32) @ np.array([299, 587, 114], np.int32)
    return ((weighted + 500) // 1000).astype(np.uint8)


def darkness(grey: Tensor) -> Tensor:
    """Return the network's input, float32 [N, 1, 128, 128], of luma uint8 [N, 128, 128].

    The white background is zero, as is the padding of the convolutions.
    """
    return 1.0 - grey[:, None].to(torch.float32) / 255.0
