"""How surely a picture is taken for what it shows: the paper's "class similarity", as a number.

The classifier behind `fd-views` tells the class of an object from a picture. Its last layer is
applied to the features that a run has kept, so that nothing is drawn or loaded again: pure NumPy.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import safe_open

from data_prep.failures import BadInput

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ClassHead:
    """The layer that tells the class from features of length d.

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
