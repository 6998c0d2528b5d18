"""Recognition by networks: the view, the object and the class that an image shows.

The judge (`bench.judges.judge`) gives the direction of view and a shape code from an image alone: a
method that ignores its cloud, or the view, may have a good SSIM, but is recognised here.
`true-mesh` goes through the same and shows how far the judge itself errs. The classifier behind
`fd-views` gives the class: its confidence is the paper's "class similarity" as a number.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from safetensors import safe_open

from bench.analysis.distances import FEATURES_AT_ONCE, FeatureDistances, ImageSet
from bench.catalogue.metrics import RECOGNITION_METRICS, column
from bench.judges.answers import VIEW_COLUMNS, Gallery, gallery
from bench.records.frames import Features
from bench.records.record import GROUND_TRUTH
from data_prep.arrays import Floats
from data_prep.failures import BadInput


def true_gallery(answers: Features, class_name: str) -> Gallery:
    """Return the gallery of a class: the judge's answers to the true images of a run."""
    truth = (GROUND_TRUTH, "", class_name)
    images = answers.images(*truth)
    codes = answers.of(*truth, images) if images else np.empty((0, VIEW_COLUMNS))
    return gallery(class_name, images, codes)


@dataclass(frozen=True, eq=False)
class ClassHead:
    """The layer that predicts the class from features of length d.

    classes  the C classes, in the order of the rows
    weight   float64 [C, d]
    bias     float64 [C]
    """

    classes: tuple[str, ...]
    weight: Floats
    bias: Floats

    def confidence(self, features: NDArray[Any], class_name: str) -> Floats:
        """Return the probabilities [n], 0..1, that features [n, d] show this class.

        Softmax over the C classes, in float64. Raises KeyError for an unknown class.
        """
        if class_name not in self.classes:
            raise KeyError(class_name)
        scores = features.astype(np.float64) @ self.weight.T + self.bias
        odds = np.exp(scores - scores.max(axis=1, keepdims=True))  # no overflow
        return odds[:, self.classes.index(class_name)] / odds.sum(axis=1)


def read_class_head(path: Path) -> ClassHead:
    """Read the layer that predicts the class from the weights of `fd-views`.

    Raises BadInput for a file without one.
    """
    try:
        with safe_open(path, framework="np") as file:
            classes = tuple(json.loads((file.metadata() or {})["labels"])["classes"])
            weight, bias = (file.get_tensor(f"heads.class.{part}") for part in ("weight", "bias"))
    except Exception as error:  # safetensors raises types of its own
        reason = " ".join(str(error).split())
        raise BadInput(
            f"{path}: not the weights of fd-views ({reason}); install pc2pix-bench again"
        ) from error
    return ClassHead(classes, weight.astype(np.float64), bias.astype(np.float64))


def confidences(
    image_sets: Iterable[ImageSet], features: FeatureDistances, head: ClassHead
) -> Iterator[pd.DataFrame]:
    """Yield the images of each set with a column of the classifier's confidence in their class.

    The head is applied to the features that a run has kept: nothing is drawn or loaded again.
    """
    (metric,) = RECOGNITION_METRICS
    for image_set in image_sets:
        method, condition, class_name = image_set
        images = features.images(*image_set)
        values = []
        for start in range(0, len(images), FEATURES_AT_ONCE):
            part = images[start : start + FEATURES_AT_ONCE]
            values.append(head.confidence(features.of(*image_set, part), class_name))
        if images:
            frame = pd.DataFrame(images, columns=["object", "view"])
            frame = frame.assign(method=method, condition=condition, **{"class": class_name})
            yield frame.assign(**{column(metric): np.concatenate(values)})
