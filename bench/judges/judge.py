"""The judge of drawn images, a network that tells from where a chair is seen and which chair it is.

From an image it predicts the direction of view, to be compared with the requested one, and a shape
code, by which the object can be told from others. It was trained on true images of the procedural
train split alone; these were also blurred, repainted and damaged, as drawn images are. It sees
brightness and no colours, because methods draw in other colours than those of the truth. The
weights are bundled, and docs/maintaining.md has their card.
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
from learning.tensor_files import read_safetensors

FEATURES = 192  # the width of the last layer before the answers
CODE = 32  # the length of a shape code
BATCH = 20  # the most images that the network sees at a time


class JudgeNetwork(nn.Module):
    """The network that takes the darkness of images and gives answers.

    The darkness is float32 [N, 1, 128, 128] in 0..1, where white is 0. The answers [N, 3 + CODE]
    are explained at `judge`.
    """

    def __init__(self) -> None:
        super().__init__()
        self.body = nn.Sequential(
            _layer(1, 24, 5, 2),  # the output has 64 x 64 places
            _layer(24, 48, 3, 2),  # 32 x 32
            _layer(48, 96, 3, 2),  # 16 x 16
            _Residual(96),
            _layer(96, 160, 3, 2),  # 8 x 8
            _Residual(160),
            _layer(160, 256, 3, 2),  # 4 x 4
            _layer(256, 96, 1, 1),
            # No average over the places: the view can be told from where in the image something is
            # as well as from what it is.
            nn.Flatten(),
            nn.Linear(96 * 4 * 4, FEATURES),
            nn.ReLU(),
        )
        self.view = nn.Linear(FEATURES, 3)
        self.code = nn.Linear(FEATURES, CODE)
        # This layout is a tenth faster on CPUs, in training and in inference.
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, darkness: Tensor) -> Tensor:
        """Return answers float32 [N, 3 + CODE]."""
        return self.answers(self.body(darkness))

    def answers(self, features: Tensor) -> Tensor:
        """Return answers [N, 3 + CODE], whose codes have length 1, from the output of `body`."""
        return torch.cat([self.view(features), functional.normalize(self.code(features))], dim=1)


class _Residual(nn.Module):
    """Two convolutions whose output is added to their input."""

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
    """Return a convolution from `channels` to `width` channels, with batch norm and ReLU."""
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
        state, _ = read_safetensors(path)  # kernels, which the file has in half precision, too
        network.load_state_dict(state)
    except Exception as error:  # any, because safetensors and torch raise types of their own
        reason = " ".join(str(error).split())
        raise BadInput(
            f"{path}: not the weights of the judge network ({reason}); install pc2pix-bench again"
        ) from error
    return network.eval()


def judge(network: JudgeNetwork, images: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the judge's answers to images uint8 [N, 128, 128, 3]: float32 [N, 3 + CODE].

    columns 0, 1    sine and cosine of the azimuth; they are not normalised, and shrink where a
                    chair looks alike from several sides
    column 2        the elevation, in units of 40 degrees
    columns from 3  a shape code of length 1; the smaller the Euclidean distance of two codes, the
                    likelier they are of the same object

    The network runs on its device, in batches of at most 20 images and in full float32
    (`learning.exact`). An image's answer does not depend on the other images of its batch. Raises
    ValueError for images of another size or type.
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
    """Return the luma (Rec. 601) of sRGB images uint8 [..., 3] as uint8 [...], rounded half up.

    It is computed in whole numbers, so that grey pixels keep their value exactly. Raises ValueError
    for another type or number of channels.
    """
    if images.dtype != np.uint8 or images.shape[-1:] != (3,):
        shape = f"{images.dtype} {list(images.shape)}"
        raise ValueError(f"images must be uint8 [..., 3], got {shape}")
    weighted = images.astype(np.int32) @ np.array([299, 587, 114], np.int32)
    return ((weighted + 500) // 1000).astype(np.uint8)


def darkness(grey: Tensor) -> Tensor:
    """Return the network's input, float32 [N, 1, 128, 128], from luma uint8 [N, 128, 128].

    White becomes 0, so that the padding of the convolutions, which is 0, continues the background.
    """
    return 1.0 - grey[:, None].to(torch.float32) / 255.0
