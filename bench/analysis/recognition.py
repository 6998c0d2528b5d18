"""Whether an image shows the view, the object and the class that it should, by networks.

Pure functions of records and features. The judge (`bench.judges.judge`) gives the direction of view
and a shape code from an image alone: a method that ignores its cloud, or the view, may have good
SSIM, but is found out here. `true-mesh` goes through the same and shows how far the judge itself
errs. The classifier behind `fd-views` gives the class of an object, and how surely an image is
taken for what it shows is the paper's "class similarity" as a number. Its last layer is applied to
the features that a run has kept, so that nothing is drawn or loaded again.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import safe_open

from bench.judges.answers import VIEW_COLUMNS, Gallery, gallery
from bench.records.features import Features
from bench.records.record import GROUND_TRUTH
from data_prep.arrays import Floats
from data_prep.failures import BadInput


def true_gallery(answers: Features, class_name: str) -> Gallery:
    """The gallery of a class, from the judge's answers to the ground truth of a run."""
    truth = (GROUND_TRUTH, "", class_name)
    images = answers.images(*truth)
    found = answers.of(*truth, images) if images else np.empty((0, VIEW_COLUMNS))
    return gallery(class_name, images, found)


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
        """The probability [n], 0..1, that features [n, d] are given of showing this class.

        Softmax over the C classes, in float64. Raises KeyError for a class that the head does not
        know.
        """
        if class_name not in self.classes:
            raise KeyError(class_name)
        scores = features.astype(np.float64) @ self.weight.T + self.bias
        odds = np.exp(scores - scores.max(axis=1, keepdims=True))  # no overflow
        return odds[:, self.classes.index(class_name)] / odds.sum(axis=1)


def read_class_head(path: Path) -> ClassHead:
    """The head in the weights of `fd-views`. Raises BadInput for a file without one."""
    try:
        with safe_open(path, framework="np") as file:
            classes = tuple(json.loads((file.metadata() or {})["labels"])["classes"])
            weight, bias = (file.get_tensor(f"heads.class.{part}") for part in ("weight", "bias"))
    except Exception as error:  # safetensors raises types of its own
        reason = " ".join(str(error).split())
        raise BadInput(f"{path}: not the weights of fd-views ({reason}); reinstall") from error
    return ClassHead(classes, weight.astype(np.float64), bias.astype(np.float64))
