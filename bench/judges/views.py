"""The network behind `fd-views`: a small classifier of rendered views of the procedural set.

From a 128 x 128 image it predicts the class of an object, its structural family, the back of a
chair and the direction of view; the 64 averages before its last layer are the features. It stands
in where the published Inception weights are not at hand, and its distances are never called FID.
Its answer about the class is what `class-confidence` is made of. It was trained on the procedural
train split; the weights are bundled, their file says what the network distinguishes, and
docs/maintaining.md has their card.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from data_prep.failures import BadInput
from data_prep.scene import IMAGE_SIZE
from learning.exact import exact_inference
from learning.weights import read_safetensors

FEATURES = 64
BATCH = 20
_CHANNELS = (32, 64, 128, 128)
_LABELS = "labels"


@dataclass(frozen=True)
class Labels:
    """The labels that the network distinguishes, in the order of the outputs of its heads.

    families  as "class/family", of all classes
    backs     of chairs
    """

    classes: tuple[str, ...]
    families: tuple[str, ...]
    backs: tuple[str, ...]


class ViewsNetwork(nn.Module):
    """The network from uint8 images [N, 3, 128, 128] to features [N, 64].

    `heads` maps features to answers.
    """

    def __init__(self, labels: Labels) -> None:
        super().__init__()
        self.labels = labels
        layers: list[nn.Module] = []
        channels = 3
        for width in _CHANNELS:  # each halves the side: 128 -> 64 -> 32 -> 16 -> 8
            layers += [
                nn.Conv2d(channels, width, 3, stride=2, padding=1, bias=False),
                nn.BatchNorm2d(width),
                nn.ReLU(),
            ]
            channels = width
        layers += [
            nn.Conv2d(channels, FEATURES, 3, padding=1, bias=False),
            nn.BatchNorm2d(FEATURES),
            nn.ReLU(),
        ]
        self.body = nn.Sequential(*layers)
        self.heads = nn.ModuleDict(
            {
                "class": nn.Linear(FEATURES, len(labels.classes)),
                "family": nn.Linear(FEATURES, len(labels.families)),
                "back": nn.Linear(FEATURES, len(labels.backs)),
                "view": nn.Linear(FEATURES, 3),  # sine and cosine of azimuth, elevation / 40
            }
        )

    def forward(self, images: Tensor) -> Tensor:
        """Return features [N, 64] float32, >= 0."""
        x = 1.0 - images.to(torch.float32) / 255.0  # the white background is zero
        return self.body(x).mean(dim=(2, 3))


def load_views_network(path: Path) -> ViewsNetwork:
    """Return the network with weights from a safetensors file, ready for inference.

    Raises BadInput where the file cannot be read or does not fit the network.
    """
    try:
        state, header = read_safetensors(path)
        labels = json.loads(header[_LABELS])
        network = ViewsNetwork(Labels(**{name: tuple(entries) for name, entries in labels.items()}))
        network.load_state_dict(state)
    except Exception as error:  # safetensors and torch raise types of their own
        reason = " ".join(str(error).split())
        raise BadInput(
            f"{path}: not the weights of fd-views ({reason}); install pc2pix-bench again"
        ) from error
    return network.eval()


def view_features(network: ViewsNetwork, images: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return features float32 [N, 64] of images uint8 [N, 128, 128, 3].

    On the device where the network is, in batches of at most 20 and in full float32
    (`learning.exact`).
    Raises ValueError for anything else: floats in 0..1 would pass for black, and the averages of
    images of another size for those of another object.
    """
    if images.dtype != np.uint8 or images.shape[1:] != (IMAGE_SIZE, IMAGE_SIZE, 3):
        shape = f"{images.dtype} {list(images.shape)}"
        raise ValueError(f"images must be uint8 [N, {IMAGE_SIZE}, {IMAGE_SIZE}, 3], got {shape}")
    features = np.empty((len(images), FEATURES), np.float32)
    device = next(network.parameters()).device
    with exact_inference():
        for start in range(0, len(images), BATCH):
            # A copy by NumPy: torch refuses negative strides, those of mirrored images.
            part = torch.from_numpy(images[start : start + BATCH].copy()).to(device)
            features[start : start + BATCH] = network(part.permute(0, 3, 1, 2)).cpu().numpy()
    return features
