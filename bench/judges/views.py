"""The network behind `fd-views`: a small classifier of rendered views of the procedural set.

From a 128 x 128 image it predicts the class of an object, its structural family, the kind of a
chair's back and the direction of view. The 64 averages before its last layer are the features. They
are used where the published Inception weights are not at hand, and distances of them are never
called FID. The metric `class-confidence` is computed from what the network predicts of the class.
It was trained on the procedural train split. The weights are bundled; their file says which classes
and families the network distinguishes, and docs/maintaining.md has their card.
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
from learning.tensor_files import read_safetensors

FEATURES = 64  # the number of features of an image
BATCH = 20  # the most images that the network sees at a time
_CHANNELS = (32, 64, 128, 128)  # the widths of the layers, each of which halves the image's side
_LABELS = "labels"  # the entry of the file's header with the labels, as JSON


@dataclass(frozen=True)
class Labels:
    """The labels that the network distinguishes, each in the order of the outputs of a head.

    classes   the classes of objects
    families  the structural families of all classes, as "class/family"
    backs     the kinds of backs that chairs have
    """

    classes: tuple[str, ...]
    families: tuple[str, ...]
    backs: tuple[str, ...]


class ViewsNetwork(nn.Module):
    """The network that takes images, uint8 [N, 3, 128, 128], and gives features [N, 64].

    Its `heads` are linear layers that make predictions of the features.
    """

    def __init__(self, labels: Labels) -> None:
        super().__init__()
        self.labels = labels
        layers: list[nn.Module] = []
        channels = 3
        for width in _CHANNELS:  # the sides go 128 -> 64 -> 32 -> 16 -> 8
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
                # Sine and cosine of the azimuth, and the elevation in units of 40 degrees.
                "view": nn.Linear(FEATURES, 3),
            }
        )

    def forward(self, images: Tensor) -> Tensor:
        """Return the features, float32 [N, 64], >= 0."""
        # White becomes 0, so that the padding of the convolutions continues the background.
        x = 1.0 - images.to(torch.float32) / 255.0
        return self.body(x).mean(dim=(2, 3))


def load_views_network(path: Path) -> ViewsNetwork:
    """Return the network with weights from a safetensors file, ready for inference.

    Raises BadInput where the file cannot be read or does not fit the network.
    """
    try:
        state, header = read_safetensors(path)
        names = json.loads(header[_LABELS])
        labels = Labels(**{kind: tuple(entries) for kind, entries in names.items()})
        network = ViewsNetwork(labels)
        network.load_state_dict(state)
    except Exception as error:  # any, because safetensors and torch raise types of their own
        reason = " ".join(str(error).split())
        raise BadInput(
            f"{path}: not the weights of fd-views ({reason}); install pc2pix-bench again"
        ) from error
    return network.eval()


def view_features(network: ViewsNetwork, images: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the features, float32 [N, 64], of images uint8 [N, 128, 128, 3].

    The network runs on its device, in batches of at most 20 images and in full float32
    (`learning.exact`). Raises ValueError for images of another type, since floats in 0..1 would be
    taken for black; and for another size, since their features would be like those of an object of
    another size.
    """
    if images.dtype != np.uint8 or images.shape[1:] != (IMAGE_SIZE, IMAGE_SIZE, 3):
        shape = f"{images.dtype} {list(images.shape)}"
        raise ValueError(f"images must be uint8 [N, {IMAGE_SIZE}, {IMAGE_SIZE}, 3], got {shape}")
    features = np.empty((len(images), FEATURES), np.float32)
    device = next(network.parameters()).device
    with exact_inference():
        for start in range(0, len(images), BATCH):
            # Copied first, because torch refuses arrays with negative strides, as mirrored images
            # have.
            part = torch.from_numpy(images[start : start + BATCH].copy()).to(device)
            features[start : start + BATCH] = network(part.permute(0, 3, 1, 2)).cpu().numpy()
    return features
