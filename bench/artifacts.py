"""Where finished pictures and features are, and what they are of.

An artifact is a compressed .npz, written whole or not at all by `bench.work`: `images`, uint8
[V, S, S, 3], and one array [V, d] for each feature extractor.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Artifact:
    """What is in the file `path`: a method's pictures of an object under a condition, or the ground
    truth of one (method GROUND_TRUTH, no condition)."""

    method: str
    condition: str
    class_name: str
    object_id: str
    path: Path

    @property
    def object(self) -> tuple[str, str]:
        """Class and name."""
        return self.class_name, self.object_id

    def pictures(self) -> NDArray[np.uint8]:
        """All views [V, S, S, 3]."""
        return read_artifact(self.path)["images"]


def read_artifact(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an artifact: `images` and one per feature extractor."""
    with np.load(path, allow_pickle=False) as arrays:
        return dict(arrays)
